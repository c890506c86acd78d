//! The `stonecut` command: hands over to `stonecut::cli` and turns its answer into an exit code.

fn main() -> std::process::ExitCode {
    std::process::ExitCode::from(stonecut::cli::main())
}
