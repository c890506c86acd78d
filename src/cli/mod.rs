//! The command line: what was typed becomes a call into the library; the only place that prints.

pub mod convert;
mod demo;
mod display;
mod info;
pub mod measure;
pub mod render;
mod report;
mod simplify;
mod status;
pub mod synth;

use crate::error::Error;
use crate::formats::StageOptions;
use crate::parallel::guarded;
use crate::ply::MeshSource;
use crate::progress::Progress;
use clap::Parser;
use display::Show;
use signal_hook::consts::{SIGINT, SIGTERM};
use std::io::Write;
use std::sync::Arc;

/// Exit code of a run that ended, but short of the target or with dropped faces.
pub const EXIT_SHORT: u8 = 3;

/// Simplifies triangle meshes of any size, out of core, into one connected mesh.
///
/// Exit codes: 0 done; 1 failed; 2 wrong usage; 3 done, but short of the target; 4 bad input; 5 no disk
/// space; 6 not enough memory; 7 another run holds the job; 8 the job belongs to other settings;
/// 9 internal fault, state kept; 10 the disk takes no files or fails; 130, 143 stopped by SIGINT, SIGTERM.
#[derive(Debug, Parser)]
#[command(name = "stonecut", version)]
struct Typed {
    #[command(subcommand)]
    command: Command,
    #[command(flatten)]
    talk: Talk,
}

/// How the command talks to people and programs.
#[derive(Clone, Debug, clap::Args)]
pub struct Talk {
    /// How progress is shown on standard error [default: a bar on a terminal, else lines].
    #[arg(long, value_enum, default_value = "auto", global = true)]
    progress: Show,
    /// Say nothing but errors.
    #[arg(short, long, global = true)]
    quiet: bool,
    /// Say more: every stage and its figures.
    #[arg(short, long, global = true)]
    verbose: bool,
    /// Write what is said to this file too.
    #[arg(long, value_name = "FILE", global = true)]
    log_file: Option<std::path::PathBuf>,
}

#[derive(Debug, clap::Subcommand)]
enum Command {
    Simplify(simplify::Args),
    Convert(convert::Args),
    Info(info::Args),
    Measure(measure::Args),
    Render(render::Args),
    Report(report::Args),
    Synth(synth::Args),
    Status(status::Args),
    Demo(demo::Args),
}

/// Runs the command line of this process and gives its exit code.
pub fn main() -> u8 {
    let typed = match Typed::try_parse() {
        Ok(typed) => typed,
        Err(error) => {
            // Help and version are answers, not errors; clap knows which stream each belongs to.
            let _ = error.print();
            return if error.use_stderr() { 2 } else { 0 };
        }
    };
    let progress = Arc::new(Progress::default());
    raise_open_files();
    let mut log = match Log::new(&typed.talk) {
        Ok(log) => log,
        Err(error) => return complain(&mut std::io::stderr(), &error),
    };
    if let Err(error) = listen_to_signals(&progress) {
        return complain(&mut log, &error);
    }
    guarded(|| dispatch(&typed.command, &typed.talk, &progress, &mut log))
        .unwrap_or_else(|error| complain(&mut log, &error))
}

fn dispatch(
    command: &Command,
    talk: &Talk,
    progress: &Progress,
    log: &mut Log,
) -> crate::Result<u8> {
    match command {
        Command::Simplify(args) => simplify::run(args, talk, progress, log),
        Command::Convert(args) => convert::run(args, &mut Said(log)),
        Command::Info(args) => info::run(args, &mut std::io::stdout(), progress).map(|()| 0),
        Command::Measure(args) => measure::run(args, talk, progress, log).map(|()| 0),
        Command::Report(args) => report::run(args, progress, log).map(|()| 0),
        Command::Render(args) => render::run(args, progress, &mut Said(log)).map(|()| 0),
        Command::Synth(args) => synth::run(args, progress, &mut Said(log)).map(|()| 0),
        Command::Status(args) => status::run(args).map(|()| 0),
        Command::Demo(args) => demo::run(args, talk, progress, log),
    }
}

fn complain(log: &mut dyn Write, error: &Error) -> u8 {
    // Nobody is left to tell if standard error is gone too.
    let _ = writeln!(log, "stonecut: {error}");
    error.exit_code()
}

/// How long the workers of a resumable run have to reach the end of a block or cell after a signal.
const GRACE: std::time::Duration = std::time::Duration::from_millis(500);

/// The first SIGINT or SIGTERM asks the workers to stop; the second ends the process at once, which loses
/// nothing either: whatever is sealed stays sealed. So does `GRACE` after the first, where a run can be
/// resumed: a large cell, a finish or a slow disk would hold it up for longer than anybody waits.
fn listen_to_signals(progress: &Arc<Progress>) -> crate::Result<()> {
    let mut signals = signal_hook::iterator::Signals::new([SIGINT, SIGTERM])
        .map_err(|e| Error::io(".", "cannot listen to signals", e))?;
    let progress = Arc::clone(progress);
    std::thread::spawn(move || {
        let mut is_first = true;
        for signal in signals.forever() {
            if !is_first {
                signal_hook::low_level::exit(128 + signal);
            }
            is_first = false;
            progress.request_stop(signal);
            let progress = Arc::clone(&progress);
            std::thread::spawn(move || {
                std::thread::sleep(GRACE);
                if progress.is_resumable() {
                    complain(&mut std::io::stderr(), &Error::Interrupted { signal });
                    signal_hook::low_level::exit(128 + signal);
                }
            });
        }
    });
    Ok(())
}

/// Takes as many open files as the hard limit gives; failing that, a run needs only a dozen.
fn raise_open_files() {
    use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
    let limit = getrlimit(Resource::Nofile);
    let _ = setrlimit(Resource::Nofile, Rlimit { current: limit.maximum, maximum: limit.maximum });
}

/// Standard error and the log file, if there is one; `--quiet` keeps everything but errors from the former.
pub struct Log {
    file: Option<std::fs::File>,
    quiet: bool,
}

impl Log {
    fn new(talk: &Talk) -> crate::Result<Log> {
        let file = match &talk.log_file {
            Some(path) => Some(
                std::fs::OpenOptions::new()
                    .create(true)
                    .append(true)
                    .open(path)
                    .map_err(|e| Error::io(path, "cannot open log file", e))?,
            ),
            None => None,
        };
        Ok(Log { file, quiet: talk.quiet })
    }

    /// Says a line unless `--quiet`; it always reaches the log file.
    pub fn say(&mut self, line: impl std::fmt::Display) {
        if !self.quiet {
            let _ = writeln!(std::io::stderr(), "{line}");
        }
        if let Some(file) = &mut self.file {
            let _ = writeln!(file, "{line}");
        }
    }
}

/// A log to write to that `--quiet` silences.
struct Said<'a>(&'a mut Log);

impl Write for Said<'_> {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        match (self.0.quiet, &mut self.0.file) {
            (false, _) => self.0.write_all(bytes)?,
            (true, Some(file)) => file.write_all(bytes)?,
            (true, None) => {}
        }
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.0.flush()
    }
}

impl Write for Log {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        if let Some(file) = &mut self.file {
            file.write_all(bytes)?;
        }
        std::io::stderr().write_all(bytes)?;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        std::io::stderr().flush()
    }
}

/// Opens a mesh of any format; what is no plain PLY is unpacked into the working folder for the time being.
fn open_mesh(path: &std::path::Path) -> crate::Result<MeshSource> {
    MeshSource::open_staged(path, &StageOptions::new("."))
}

/// Parses `--memory`: a size, or a share of the tightest limit in force.
fn parse_memory(text: &str) -> Result<u64, String> {
    let limit = crate::memory::limit_bytes();
    match text.strip_suffix('%') {
        Some(_) => Ok((crate::units::parse_ratio(text)? * limit as f64) as u64),
        None => crate::units::parse_bytes(text),
    }
}

/// The memory budget: as given, or the default share of the tightest limit.
fn memory_budget(given: Option<u64>) -> u64 {
    given.unwrap_or_else(|| {
        (crate::memory::limit_bytes() as f64 * crate::memory::DEFAULT_SHARE) as u64
    })
}
