# The stonecut command and nothing else: docker run --rm -v "$PWD:/io" stonecut simplify scan.ply small.ply --ratio 1%
FROM rust:1-slim AS build
RUN apt-get update && apt-get install --yes --no-install-recommends musl-tools
RUN rustup target add x86_64-unknown-linux-musl
WORKDIR /src
COPY . .
RUN cargo build --release --target x86_64-unknown-linux-musl --package stonecut

FROM scratch
COPY --from=build /src/target/x86_64-unknown-linux-musl/release/stonecut /stonecut
WORKDIR /io
ENTRYPOINT ["/stonecut"]
