//! The command line: what was typed becomes a call into the library.

pub mod convert;
pub mod synth;

use crate::progress::Progress;
use clap::Parser;

/// Simplifies triangle meshes of any size.
#[derive(Debug, Parser)]
#[command(name = "stonecut", version)]
struct Typed {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, clap::Subcommand)]
enum Command {
    Convert(convert::Args),
    Synth(synth::Args),
}

/// Runs the command line of this process and gives its exit code.
pub fn main() -> u8 {
    let typed = Typed::parse();
    let progress = Progress::default();
    let mut log = std::io::stderr();
    let outcome = match &typed.command {
        Command::Convert(args) => convert::run(args, &mut log),
        Command::Synth(args) => synth::run(args, &progress, &mut log),
    };
    match outcome {
        Ok(()) => 0,
        Err(error) => {
            let _ = std::io::Write::write_fmt(&mut log, format_args!("stonecut: {error}\n"));
            error.exit_code()
        }
    }
}
