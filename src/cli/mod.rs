//! The command line: what was typed becomes a call into the library; the only place that prints.

mod answer;
pub(crate) mod arguments;
pub mod call;
mod compare;
mod conflicts;
pub mod convert;
mod converted;
mod demo;
mod display;
mod extract;
mod faces;
mod info;
mod inputs;
pub(crate) mod job;
mod levels;
mod log;
mod measure;
mod method;
mod near;
mod new_texture;
mod out_of_memory;
mod outcome;
mod pages;
mod placing;
mod plan;
mod progressive;
mod reading;
mod receipt;
mod refine;
mod render;
mod report;
pub mod serve;
mod session;
mod signals;
mod simplify;
mod solid;
mod split;
mod status;
mod synth;
mod tiles;
mod transfer;
mod tree_receipt;
mod used;
mod verify;
mod work;

use crate::error::{Error, Offers, Result};
use crate::system::parallel::guarded;
use crate::system::paths::Role;
use crate::system::progress::Progress;
use crate::system::terminal::shown;
use clap::error::ErrorKind::MissingRequiredArgument;
use clap::{CommandFactory, Parser};
use log::{Log, Show, Talk, complain, end_of, say_end};
pub use out_of_memory::Allocator;
use session::{Command, Session};
use std::io::Write;
use std::sync::Arc;

/// Simplifies triangle meshes of any size, out of core, into one mesh without seams.
///
/// Exit codes: 0 done; 1 failed; 2 wrong usage; 3 done, but short of the target, or all images, colours or values of a kind are
/// lost; 4 bad input; 5 no disk
/// space; 6 not enough memory; 7 another run holds the job; 8 the job belongs to other settings;
/// 9 internal fault, state kept; 10 the disk takes no files or fails; 130, 143 stopped by SIGINT, SIGTERM;
/// 141 whoever read standard output has closed it.
#[derive(Debug, Parser)]
#[command(name = "stonecut", version)]
struct CommandLine {
    #[command(subcommand)]
    command: Typed,
    #[command(flatten)]
    talk: Talk,
}

#[derive(Debug, clap::Subcommand)]
#[allow(clippy::large_enum_variant)] // There is one.
enum Typed {
    Simplify(simplify::Args),
    Convert(convert::Args),
    Info(info::Args),
    Tiles(tiles::Args),
    Extract(extract::Args),
    Refine(refine::Args),
    Transfer(transfer::Args),
    Measure(measure::Args),
    Verify(verify::Args),
    Compare(compare::Args),
    Render(render::Args),
    Report(report::Args),
    Synth(synth::Args),
    Serve(serve::Args),
    Status(status::Args),
    Plan(Box<plan::Args>),
    Work(work::Args),
    Demo(demo::Args),
    Completions(pages::Completions),
    Man(pages::Man),
}

/// Runs a command line, the name of the program first, as the only work of this process; gives its exit code.
///
/// SIGINT and SIGTERM are listened to from then on.
pub fn main_from(words: impl IntoIterator<Item = std::ffi::OsString>) -> u8 {
    let words: Vec<std::ffi::OsString> = words.into_iter().collect();
    let mut typed = match CommandLine::try_parse_from(&words) {
        Ok(typed) => typed,
        Err(error) => {
            // Help and version are answers, not errors; clap knows which stream each belongs to.
            if error.use_stderr() && wants_events(&words) {
                return refuse(
                    &arguments::usage(&error),
                    Offers::default(),
                    std::time::Instant::now(),
                );
            }
            // What was not said by clap has no use for the words on how to type a command.
            match error.kind() {
                MissingRequiredArgument if error.context().next().is_none() => {
                    let error = arguments::usage(&error);
                    complain(&mut std::io::stderr(), Show::None, &error, Offers::default());
                }
                _ => print_typed(&error, &words),
            }
            return if error.use_stderr() { 2 } else { 0 };
        }
    };
    if let Typed::Plan(args) = &mut typed.command {
        args.words = words.iter().map(|word| word.to_string_lossy().into_owned()).collect();
    }
    typed.command.keep_words(&words);
    let progress = Arc::new(Progress::default());
    let (command, talk) = (typed.command.as_command(), &typed.talk);
    let (offers, show) = (command.offers(), talk.progress);
    raise_open_files();
    crate::system::memory::share_one_heap();
    let begin = || {
        signals::listen(&progress, show, offers)?;
        check_paths(command, talk)?;
        Log::new(talk)
    };
    let began = std::time::Instant::now();
    if let Some((code, line)) = command.done_before()
        && let Ok(mut log) = Log::new(talk)
    {
        log.say_reason(line);
        log.give_reasons(code);
        say_end(&mut log, show, end_of(Ok((serde_json::Value::Null, code)), offers), began);
        return code;
    }
    let mut log = match begin() {
        Ok(log) => log,
        Err(error) if show == Show::Json => return refuse(&error, offers, began),
        Err(error) => return complain(&mut std::io::stderr(), show, &error, offers),
    };
    let outcome = guarded(|| command.run(&mut session(talk, &progress, &mut log)));
    let (code, end) = match outcome {
        Ok(done) => {
            let code = log.say_losses(&progress.losses(), done.code);
            let code = if command.ignores_losses() { done.code } else { code };
            (code, end_of(Ok((done.report, code)), offers))
        }
        Err(error) => (complain(&mut log, show, &error, offers), end_of(Err(&error), offers)),
    };
    log.give_reasons(code);
    say_end(&mut log, show, end, began);
    code
}

/// Says as events why nothing is done; gives the exit code.
fn refuse(error: &Error, offers: Offers, began: std::time::Instant) -> u8 {
    let code = complain(&mut std::io::stderr(), Show::Json, error, offers);
    say_end(&mut std::io::stderr(), Show::Json, end_of(Err(error), offers), began);
    code
}

/// True if `--progress json` is among words that cannot be read as a whole.
fn wants_events(words: &[std::ffi::OsString]) -> bool {
    let pairs = words.windows(2);
    let is_pair = |pair: &[std::ffi::OsString]| pair[0] == "--progress" && pair[1] == "json";
    words.iter().any(|word| word == "--progress=json") || pairs.into_iter().any(is_pair)
}

/// The surroundings of a command of this command line.
fn session<'a>(talk: &'a Talk, progress: &'a Progress, log: &'a mut Log) -> Session<'a> {
    Session { talk, progress, log, prints: true, line: CommandLine::command, run_words }
}

fn run_words(words: &[String], session: &mut Session) -> Result<u8> {
    let line = CommandLine::try_parse_from(words).map_err(|e| Error::Usage(e.to_string()))?;
    let command = line.command.as_command();
    check_paths(command, session.talk)?;
    command.run(session).map(|done| done.code)
}

/// Refuses paths that clash or cannot be used, before anything is written, the log included.
fn check_paths(command: &dyn Command, talk: &Talk) -> Result<()> {
    command.paths()?.with_option(Role::Log, "--log-file", talk.log_file.as_ref()).check()
}

/// Prints help, or what is wrong with the words; in colour unless one of them could play tricks on the terminal.
fn print_typed(error: &clap::Error, words: &[std::ffi::OsString]) {
    let is_plain = words.iter().all(|word| {
        let word = word.to_string_lossy();
        shown(&word) == word
    });
    // Nothing can be reported if the stream is closed.
    if is_plain {
        let _ = error.print();
        return;
    }
    // The same words without their tricks are as wrong as they were.
    let safe = words.iter().map(|word| shown(&word.to_string_lossy()).into_owned());
    let text = match CommandLine::try_parse_from(safe) {
        Err(same) => same.to_string(),
        Ok(_) => error.kind().to_string(),
    };
    let lines: Vec<_> = text.lines().map(shown).collect();
    let _ = writeln!(std::io::stderr(), "{}", lines.join("\n"));
}

impl Typed {
    fn as_command(&self) -> &dyn Command {
        match self {
            Typed::Simplify(args) => args,
            Typed::Convert(args) => args,
            Typed::Info(args) => args,
            Typed::Tiles(args) => args,
            Typed::Extract(args) => args,
            Typed::Refine(args) => args,
            Typed::Transfer(args) => args,
            Typed::Measure(args) => args,
            Typed::Verify(args) => args,
            Typed::Compare(args) => args,
            Typed::Render(args) => args,
            Typed::Report(args) => args,
            Typed::Synth(args) => args,
            Typed::Serve(args) => args,
            Typed::Status(args) => args,
            Typed::Plan(args) => args.as_ref(),
            Typed::Work(args) => args,
            Typed::Demo(args) => args,
            Typed::Completions(args) => args,
            Typed::Man(args) => args,
        }
    }

    /// Notes the whole command line for a receipt.
    fn keep_words(&mut self, words: &[std::ffi::OsString]) {
        match self {
            Typed::Simplify(args) => args.receipt.words = words.to_vec(),
            Typed::Tiles(args) => args.receipt.words = words.to_vec(),
            _ => {}
        }
    }

    /// True if a caller in the same process can run it, too.
    fn is_callable(&self) -> bool {
        use Typed::{Convert, Extract, Info, Measure, Render, Simplify, Synth, Tiles, Transfer};
        matches!(
            self,
            Simplify(_)
                | Measure(_)
                | Info(_)
                | Convert(_)
                | Render(_)
                | Synth(_)
                | Tiles(_)
                | Extract(_)
                | Transfer(_)
        )
    }
}

/// Takes as many open files as the hard limit gives; failing that, a run needs only a dozen.
fn raise_open_files() {
    use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
    let limit = getrlimit(Resource::Nofile);
    let _ = setrlimit(Resource::Nofile, Rlimit { current: limit.maximum, maximum: limit.maximum });
}
