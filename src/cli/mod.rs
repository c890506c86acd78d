//! The command line: what was typed, who does it, and where the answer goes.

pub mod info;
pub mod measure;

use crate::progress::Progress;
use clap::Parser;
use std::process::ExitCode;

#[derive(Parser)]
#[command(name = "stonecut", version, about)]
struct RawArgs {
    #[command(subcommand)]
    command: Command,
}

#[derive(clap::Subcommand)]
enum Command {
    /// Tells what a mesh file holds, and whether it is sound
    Info(info::Args),
    /// Measures how far a simplified mesh deviates from its original
    Measure(measure::Args),
}

/// Runs the command that was typed; the exit codes are documented in the README.
#[allow(clippy::print_stderr)]
pub fn run() -> ExitCode {
    let args = RawArgs::parse();
    let progress = Progress::default();
    let mut out = std::io::stdout().lock();
    let outcome = match &args.command {
        Command::Info(args) => info::run(args, &mut out, &progress),
        Command::Measure(args) => measure::run(args, &mut out, &progress),
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("stonecut: {error}");
            ExitCode::from(error.exit_code())
        }
    }
}
