//! Commands for a caller in the same process: words in, the report out.
//!
//! For bindings to other languages. Nothing is printed, no signal is listened to, nothing exits: progress is read from
//! the `Progress` that the caller gives, and a stop is asked for there. Words mean what they mean on the command line.

pub use super::answer::Answer;
use super::answer::CommandEnd;
use super::log::{EXIT_SHORT, Log, Talk};
use super::render;
use super::session::{Command, Session};
use super::{CommandLine, Typed, check_paths, session};
use crate::config::Config;
use crate::error::{Error, Result};
use crate::mesh::Mesh;
use crate::render::{Picture, render_mesh};
use crate::system::parallel::guarded;
use crate::system::paths::Paths;
use crate::system::progress::Progress;
use clap::Parser;
use std::ffi::OsString;

/// Runs `simplify`, `measure`, `info`, `convert`, `render`, `synth`, `tiles`, `extract` or `transfer`.
///
/// Errors: those of the command; `Usage` for words that cannot be read and for other commands; `Internal` for a panic.
pub fn call(words: &[OsString], progress: &Progress) -> Result<Answer> {
    let typed = parse(words)?;
    if !typed.command.is_callable() {
        return Err(Error::Usage("this command is for the command line only".to_owned()));
    }
    let command = typed.command.as_command();
    check_paths(command, &typed.talk)?;
    progress.take_losses();
    let (talk, mut log) = (Talk::silent(), Log::silent());
    let mut session = Session { prints: false, ..session(&talk, progress, &mut log) };
    let CommandEnd { report, code } = guarded(|| command.run(&mut session))?;
    let is_short = code == EXIT_SHORT || progress.losses().has_whole();
    Ok(Answer { report, is_short })
}

/// The settings of a `simplify` that is not run.
pub fn config(words: &[OsString]) -> Result<Config> {
    match parse(words)?.command {
        Typed::Simplify(args) => args.config(),
        _ => Err(Error::Usage("only 'simplify' has settings of a run".to_owned())),
    }
}

/// The picture that `render` would write; of `mesh` instead of the files that the words name, if there is one.
pub fn picture(words: &[OsString], mesh: Option<&Mesh>, progress: &Progress) -> Result<Picture> {
    draw(&render_args(words)?, mesh, progress)
}

/// Makes the same picture and writes it.
pub fn picture_file(
    words: &[OsString],
    mesh: Option<&Mesh>,
    progress: &Progress,
) -> Result<Picture> {
    let args = render_args(words)?;
    match mesh {
        Some(_) => args.output_paths(Paths::new(args.force))?.check()?,
        None => args.paths()?.check()?,
    }
    let picture = draw(&args, mesh, progress)?;
    render::write(&args, &picture)?;
    Ok(picture)
}

fn render_args(words: &[OsString]) -> Result<render::Args> {
    match parse(words)?.command {
        Typed::Render(args) => Ok(args),
        _ => Err(Error::Usage("only 'render' makes pictures".to_owned())),
    }
}

fn draw(args: &render::Args, mesh: Option<&Mesh>, progress: &Progress) -> Result<Picture> {
    guarded(|| match mesh {
        Some(_) if args.color_by.is_some() => {
            Err(Error::Usage("--color-by paints files, not meshes in memory".to_owned()))
        }
        Some(mesh) => {
            let threads = super::arguments::threads(args.threads).get();
            render_mesh(mesh, &args.view(), threads, progress)
        }
        None => render::picture(args, progress).map(|(picture, _)| picture),
    })
}

fn parse(words: &[OsString]) -> Result<CommandLine> {
    let words: Vec<OsString> =
        std::iter::once("stonecut".into()).chain(words.iter().cloned()).collect();
    let mut line = CommandLine::try_parse_from(&words).map_err(|e| super::arguments::usage(&e))?;
    line.command.keep_words(&words);
    Ok(line)
}
