//! The command line: what was typed becomes a call into the library; the only place that prints.

pub mod convert;
mod demo;
mod display;
mod info;
pub mod measure;
mod out_of_memory;
pub mod render;
mod report;
mod signals;
mod simplify;
mod status;
pub mod synth;

use crate::error::{Error, Offers};
use crate::io::StageOptions;
use crate::io::ply::MeshSource;
use crate::system::parallel::guarded;
use crate::system::paths::{Paths, Role};
use crate::system::progress::Progress;
use crate::system::units::show_bytes;
use clap::Parser;
use display::Show;
pub use out_of_memory::Allocator;
use std::io::Write;
use std::num::NonZeroUsize;
use std::sync::Arc;

/// Exit code of a run that ended, but short of the target or with dropped faces.
pub const EXIT_SHORT: u8 = 3;

/// Simplifies triangle meshes of any size, out of core, into one connected mesh.
///
/// Exit codes: 0 done; 1 failed; 2 wrong usage; 3 done, but short of the target; 4 bad input; 5 no disk
/// space; 6 not enough memory; 7 another run holds the job; 8 the job belongs to other settings;
/// 9 internal fault, state kept; 10 the disk takes no files or fails; 130, 143 stopped by SIGINT, SIGTERM;
/// 141 whoever read standard output has closed it.
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
    let offers = typed.command.offers();
    raise_open_files();
    let begin = || {
        signals::listen(&progress, offers)?;
        typed.command.check_paths(&typed.talk)?;
        Log::new(&typed.talk)
    };
    let mut log = match begin() {
        Ok(log) => log,
        Err(error) => return complain(&mut std::io::stderr(), &error, offers),
    };
    guarded(|| dispatch(&typed.command, &typed.talk, &progress, &mut log))
        .unwrap_or_else(|error| complain(&mut log, &error, offers))
}

impl Command {
    /// The paths that were typed, with what the command does with each.
    fn paths(&self) -> crate::Result<Paths> {
        match self {
            Command::Simplify(args) => args.paths(),
            Command::Convert(args) => args.paths(),
            Command::Info(args) => Ok(args.paths()),
            Command::Measure(args) => args.paths(),
            Command::Render(args) => args.paths(),
            Command::Report(args) => args.paths(),
            Command::Synth(args) => args.paths(),
            Command::Status(args) => Ok(args.paths()),
            Command::Demo(args) => Ok(args.paths()),
        }
    }

    /// Refuses paths that clash or cannot be used, before anything is written, the log included.
    fn check_paths(&self, talk: &Talk) -> crate::Result<()> {
        self.paths()?.with_option(Role::Log, "--log-file", talk.log_file.as_ref()).check()
    }

    /// What can be done about a failure of this command.
    fn offers(&self) -> Offers {
        match self {
            Command::Simplify(_) => Offers { resumes: true, temp_dir: true },
            Command::Convert(_) | Command::Info(_) | Command::Measure(_) => {
                Offers { resumes: false, temp_dir: true }
            }
            Command::Render(_)
            | Command::Report(_)
            | Command::Synth(_)
            | Command::Status(_)
            | Command::Demo(_) => Offers::default(),
        }
    }
}

fn dispatch(
    command: &Command,
    talk: &Talk,
    progress: &Progress,
    log: &mut Log,
) -> crate::Result<u8> {
    match command {
        Command::Simplify(args) => simplify::run(args, talk, progress, log),
        Command::Convert(args) => convert::run(args, progress, &mut Said(log)),
        Command::Info(args) => info::run(args, &mut std::io::stdout(), progress).map(|()| 0),
        Command::Measure(args) => measure::run(args, talk, progress, log).map(|()| 0),
        Command::Report(args) => report::run(args, progress, log).map(|()| 0),
        Command::Render(args) => render::run(args, progress, &mut Said(log)).map(|()| 0),
        Command::Synth(args) => synth::run(args, progress, &mut Said(log)).map(|()| 0),
        Command::Status(args) => status::run(args).map(|()| 0),
        Command::Demo(args) => demo::run(args, talk, progress, log),
    }
}

/// Says what went wrong and what to do about it; gives the exit code.
fn complain(log: &mut dyn Write, error: &Error, offers: Offers) -> u8 {
    // Other commands end without a word where the reader of a pipe has had enough.
    if !matches!(error, Error::OutputClosed) {
        let advice = error.advice(offers).map_or(String::new(), |advice| format!("; {advice}"));
        // Nobody is left to tell if standard error is gone too.
        let _ = writeln!(log, "stonecut: {error}{advice}");
    }
    error.exit_code()
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

/// Opens a mesh of any format; what is no plain PLY is unpacked into `temp_dir` for the time being.
fn open_mesh(path: &std::path::Path, temp_dir: &std::path::Path) -> crate::Result<MeshSource> {
    MeshSource::open_staged(path, &StageOptions::new(temp_dir))
}

/// The threads to work with: as many as asked for, by default one a core.
///
/// More than `MOST_THREADS_PER_CORE` a core would only take memory, each with its own buffers.
fn threads(given: Option<NonZeroUsize>) -> NonZeroUsize {
    let cores = NonZeroUsize::new(crate::system::memory::cores()).unwrap_or(NonZeroUsize::MIN);
    let most = cores.saturating_mul(MOST_THREADS_PER_CORE);
    given.unwrap_or(cores).min(most)
}

const MOST_THREADS_PER_CORE: NonZeroUsize = NonZeroUsize::new(4).expect("above 0");

/// Refuses an output whose name says that it is something else.
fn require_ending(name: &str, path: &std::path::Path, endings: &[&str]) -> crate::Result<()> {
    let ending = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
    if path == std::path::Path::new("-") || ending.is_some_and(|e| endings.contains(&e.as_str())) {
        return Ok(());
    }
    let endings = endings.join(" or .");
    Err(Error::Usage(format!("{name} {}: give it a name that ends in .{endings}", path.display())))
}

/// Parses `--memory`: a size, or a share of the tightest limit in force.
fn parse_memory(text: &str) -> Result<u64, String> {
    let limit = crate::system::memory::limit_bytes();
    match text.strip_suffix('%') {
        Some(_) => Ok((crate::system::units::parse_ratio(text)? * limit as f64) as u64),
        None => crate::system::units::parse_bytes(text),
    }
}

/// Parses `--cell-triangles`.
fn parse_cell(text: &str) -> Result<u64, String> {
    match crate::system::units::parse_count(text)? {
        0..1000 => Err("cells below 1000 triangles are nothing but seam".to_owned()),
        count => Ok(count),
    }
}

/// The memory budget: as given, but within the tightest limit, or the default share of that.
fn memory_budget(given: Option<u64>) -> u64 {
    crate::system::memory::budget_bytes(given, crate::system::memory::limit_bytes())
}

/// Says so where less is taken than `--memory` asks for.
fn warn_of_limit(given: Option<u64>, log: &mut Log) {
    let limit = crate::system::memory::limit_bytes();
    let taken = crate::system::memory::budget_bytes(given, limit);
    if let Some(given) = given.filter(|&given| given > taken) {
        log.say(format!(
            "warning: --memory {} is more than this process may use (limit {}); {} are taken",
            show_bytes(given).replace(' ', ""),
            show_bytes(limit),
            show_bytes(taken)
        ));
    }
}
