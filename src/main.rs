//! The `stonecut` command: hands over to `stonecut::cli` and turns its answer into an exit code.

#[global_allocator]
static ALLOCATOR: stonecut::cli::Allocator = stonecut::cli::Allocator;

fn main() -> std::process::ExitCode {
    std::process::ExitCode::from(stonecut::cli::main_from(std::env::args_os()))
}
