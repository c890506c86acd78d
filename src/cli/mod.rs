//! The command line: what was typed becomes a call into the library; the only place that prints.

mod answer;
mod arguments;
pub mod call;
mod compare;
pub mod convert;
mod converted;
mod demo;
mod display;
mod extract;
mod faces;
mod info;
mod job;
mod levels;
mod log;
mod measure;
mod method;
mod near;
mod new_texture;
mod out_of_memory;
mod outcome;
pub mod pace;
mod pages;
mod placing;
mod plan;
mod progressive;
mod refine;
mod render;
mod report;
mod serve;
mod signals;
mod simplify;
mod status;
mod synth;
mod terminal;
mod tiles;
mod work;

use crate::error::{Error, Offers};
use crate::system::parallel::guarded;
use crate::system::paths::{Paths, Role};
use crate::system::progress::Progress;
use clap::{CommandFactory, Parser};
use log::{Log, Said, Talk, complain, say_end};
pub use out_of_memory::Allocator;
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
struct Typed {
    #[command(subcommand)]
    command: Command,
    #[command(flatten)]
    talk: Talk,
}

#[derive(Debug, clap::Subcommand)]
#[allow(clippy::large_enum_variant)] // There is one.
enum Command {
    Simplify(simplify::Args),
    Convert(convert::Args),
    Info(info::Args),
    Tiles(tiles::Args),
    Extract(extract::Args),
    Refine(refine::Args),
    Measure(measure::Args),
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

/// Runs the command line of this process and gives its exit code.
pub fn main() -> u8 {
    main_from(std::env::args_os())
}

/// Runs a command line, the name of the program first, as the only work of this process; gives its exit code.
///
/// SIGINT and SIGTERM are listened to from then on.
pub fn main_from(words: impl IntoIterator<Item = std::ffi::OsString>) -> u8 {
    let words: Vec<std::ffi::OsString> = words.into_iter().collect();
    let mut typed = match Typed::try_parse_from(&words) {
        Ok(typed) => typed,
        Err(error) => {
            // Help and version are answers, not errors; clap knows which stream each belongs to.
            print_typed(&error, &words);
            return if error.use_stderr() { 2 } else { 0 };
        }
    };
    if let Command::Plan(args) = &mut typed.command {
        args.words = words.iter().map(|word| word.to_string_lossy().into_owned()).collect();
    }
    let progress = Arc::new(Progress::default());
    let offers = typed.command.offers();
    raise_open_files();
    crate::system::memory::share_one_heap();
    let show = typed.talk.progress;
    let begin = || {
        signals::listen(&progress, show, offers)?;
        typed.command.check_paths(&typed.talk)?;
        Log::new(&typed.talk)
    };
    let began = std::time::Instant::now();
    if let Command::Simplify(args) = &typed.command
        && let Some(code) = args.done_before()
        && let Ok(mut log) = Log::new(&typed.talk)
    {
        log.say(format!(
            "{}: already done with the same settings; --force does it again",
            args.output.display()
        ));
        say_end(&mut log, show, code, began);
        return code;
    }
    let mut log = match begin() {
        Ok(log) => log,
        Err(error) => {
            let code = complain(&mut std::io::stderr(), show, &error, offers);
            say_end(&mut std::io::stderr(), show, code, began);
            return code;
        }
    };
    let code = guarded(|| dispatch(&typed.command, &typed.talk, &progress, &mut log))
        .map(|code| match (log.say_losses(&progress.losses(), code), &typed.command) {
            // Scripts wait for the unit, whatever its mesh has lost.
            (_, Command::Work(_)) => code,
            (code, _) => code,
        })
        .unwrap_or_else(|error| complain(&mut log, show, &error, offers));
    say_end(&mut log, show, code, began);
    code
}

/// Prints help, or what is wrong with the words; in colour unless one of them could play tricks on the terminal.
fn print_typed(error: &clap::Error, words: &[std::ffi::OsString]) {
    let is_plain = words.iter().all(|word| {
        let word = word.to_string_lossy();
        terminal::shown(&word) == word
    });
    // Nothing can be reported if the stream is closed.
    if is_plain {
        let _ = error.print();
        return;
    }
    // The same words without their tricks are as wrong as they were.
    let safe = words.iter().map(|word| terminal::shown(&word.to_string_lossy()).into_owned());
    let text = match Typed::try_parse_from(safe) {
        Err(same) => same.to_string(),
        Ok(_) => error.kind().to_string(),
    };
    let lines: Vec<_> = text.lines().map(terminal::shown).collect();
    let _ = writeln!(std::io::stderr(), "{}", lines.join("\n"));
}

impl Command {
    /// The paths that were typed, with what the command does with each.
    fn paths(&self) -> crate::Result<Paths> {
        match self {
            Command::Simplify(args) => args.paths(),
            Command::Convert(args) => args.paths(),
            Command::Info(args) => Ok(args.paths()),
            Command::Tiles(args) => args.paths(),
            Command::Extract(args) => args.paths(),
            Command::Refine(args) => args.paths(),
            Command::Measure(args) => args.paths(),
            Command::Compare(args) => args.paths(),
            Command::Render(args) => args.paths(),
            Command::Report(args) => args.paths(),
            Command::Synth(args) => args.paths(),
            Command::Serve(args) => Ok(args.paths()),
            Command::Status(args) => Ok(args.paths()),
            Command::Plan(args) => args.paths(),
            Command::Work(args) => Ok(args.paths()),
            Command::Demo(args) => Ok(args.paths()),
            Command::Completions(_) => Ok(Paths::default()),
            Command::Man(args) => Ok(args.paths()),
        }
    }

    /// Refuses paths that clash or cannot be used, before anything is written, the log included.
    fn check_paths(&self, talk: &Talk) -> crate::Result<()> {
        self.paths()?.with_option(Role::Log, "--log-file", talk.log_file.as_ref()).check()
    }

    /// Returns the options that can help against a failure of this command.
    fn offers(&self) -> Offers {
        match self {
            Command::Simplify(_) | Command::Tiles(_) => Offers { resumes: true, temp_dir: true },
            Command::Work(_) => Offers { resumes: true, temp_dir: false },
            Command::Convert(_) | Command::Info(_) | Command::Measure(_) => {
                Offers { resumes: false, temp_dir: true }
            }
            Command::Compare(_)
            | Command::Extract(_)
            | Command::Refine(_)
            | Command::Render(_)
            | Command::Report(_)
            | Command::Synth(_)
            | Command::Serve(_)
            | Command::Status(_)
            | Command::Plan(_)
            | Command::Demo(_)
            | Command::Completions(_)
            | Command::Man(_) => Offers::default(),
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
        Command::Info(args) => info::run(args, &mut std::io::stdout(), progress),
        Command::Tiles(args) => tiles::run(args, talk, progress, log),
        Command::Extract(args) => extract::run(args, talk, progress, log),
        Command::Refine(args) => refine::run(args, talk, progress, log),
        Command::Measure(args) => measure::run(args, talk, progress, log).map(|()| 0),
        Command::Compare(args) => compare::run(args, progress, log).map(|()| 0),
        Command::Report(args) => report::run(args, progress, log).map(|()| 0),
        Command::Render(args) => render::run(args, progress, &mut Said(log)).map(|()| 0),
        Command::Synth(args) => synth::run(args, progress, &mut Said(log)).map(|()| 0),
        Command::Serve(args) => serve::run(args, progress, log).map(|()| 0),
        Command::Status(args) => status::run(args, progress).map(|()| 0),
        Command::Plan(args) => plan::run(args, talk, log).map(|()| 0),
        Command::Work(args) => {
            let read_plan = |words: &[String]| match Typed::try_parse_from(words).ok()?.command {
                Command::Plan(plan) => Some(plan),
                _ => None,
            };
            work::run(args, &read_plan, talk, progress, log).map(|()| 0)
        }
        Command::Completions(args) => pages::completions(args, Typed::command()).map(|()| 0),
        Command::Man(args) => pages::man(args, Typed::command()).map(|()| 0),
        Command::Demo(args) => demo::run(args, log, |words, log| {
            let typed = Typed::try_parse_from(words).map_err(|e| Error::Usage(e.to_string()))?;
            typed.command.check_paths(talk)?;
            dispatch(&typed.command, talk, progress, log)
        }),
    }
}

/// Takes as many open files as the hard limit gives; failing that, a run needs only a dozen.
fn raise_open_files() {
    use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
    let limit = getrlimit(Resource::Nofile);
    let _ = setrlimit(Resource::Nofile, Rlimit { current: limit.maximum, maximum: limit.maximum });
}
