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

#[cfg(test)]
mod tests {
    use super::*;

    fn words(text: &str) -> Vec<OsString> {
        text.split_whitespace().map(OsString::from).collect()
    }

    #[test]
    fn settings_come_from_the_same_words_as_on_the_command_line() {
        let config = config(&words("simplify a.ply b.ply --ratio 2% --topology keep --fit off"));
        let settings = config.expect("well written").settings();
        assert_eq!(settings["target"], "ratio=0.02");
        assert_eq!((settings["topology"].as_str(), settings["fit"].as_str()), ("keep", "off"));
    }

    #[test]
    fn what_cannot_be_read_is_a_usage_error_in_one_line() {
        for text in ["simplify a.ply b.ply", "measure a.ply", "simplify a b --ratio 7", "x"] {
            let error = call(&words(text), &Progress::default()).unwrap_err();
            assert_eq!(error.exit_code(), 2, "{text}");
            assert!(!error.to_string().contains("Usage:"), "{error}");
        }
        for text in ["demo", "status folder", "report a.json -o a.html"] {
            assert!(parse(&words(text)).is_ok(), "{text}");
            let error = call(&words(text), &Progress::default()).unwrap_err();
            assert!(error.to_string().contains("command line only"), "{text}: {error}");
        }
    }

    #[test]
    fn a_mesh_is_made_looked_at_simplified_measured_and_drawn() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name).display().to_string();
        let (made, small) = (path("a.ply"), path("b.ply"));
        let progress = Progress::default();
        let call = |text: String| call(&words(&text), &progress).unwrap();
        let answer = call(format!("synth statue {made} --triangles 5000"));
        let n = answer.report["output"]["triangles"].as_u64().unwrap();
        assert!(n >= 5000);
        assert_eq!(call(format!("info {made}")).report["triangles"], n);
        let plan = call(format!("simplify {made} {small} --triangles 500 --dry-run")).report;
        assert_eq!((plan["triangles_in"].as_u64(), plan["target"].as_u64()), (Some(n), Some(500)));
        let done = call(format!("simplify {made} {small} --triangles 500"));
        assert!(!done.is_short && done.report["output"]["triangles"].as_u64().unwrap() <= 500);
        let measured = call(format!("measure {made} {small} --samples 2000")).report;
        assert!(measured["rms"].as_f64().unwrap() > 0.0);
        let drawn = words(&format!("render {small} -o {} --size 64x48", path("c.png")));
        let from_file = picture(&drawn, None, &progress).unwrap();
        assert_eq!((from_file.width, from_file.height), (64, 48));
        assert!(!std::path::Path::new(&path("c.png")).exists());
        assert_eq!(picture_file(&drawn, None, &progress).unwrap(), from_file);
        assert!(std::path::Path::new(&path("c.png")).exists());
    }
}
