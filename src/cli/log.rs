//! The lines and the exit code of a command: standard error, the log file, and how much is said.

use super::terminal::{shown, write_shown};
use crate::error::{Error, Offers};
use std::io::Write;

/// Exit code of a run that ended, but short of the target or with dropped faces.
pub const EXIT_SHORT: u8 = 3;

/// The choices of `--progress`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Show {
    /// A bar on a terminal, else lines.
    Auto,
    /// A bar.
    Bar,
    /// A line every ten seconds and at every stage.
    Plain,
    /// A JSON object a line on standard error.
    Json,
    /// Nothing.
    None,
}

/// Output settings of a command: progress, colour, log.
#[derive(Clone, Debug, clap::Args)]
pub struct Talk {
    /// Form of the progress on standard error [default: a bar on a terminal, else lines].
    #[arg(long, value_enum, default_value = "auto", global = true)]
    pub(super) progress: Show,
    /// Say nothing but errors.
    #[arg(short, long, global = true)]
    pub(super) quiet: bool,
    /// Say more: every stage and its figures.
    #[arg(short, long, global = true)]
    pub(super) verbose: bool,
    /// Write what is said to this file too.
    #[arg(long, value_name = "FILE", global = true)]
    pub(super) log_file: Option<std::path::PathBuf>,
}

/// Says what went wrong and what to do about it; gives the exit code.
pub(super) fn complain(log: &mut dyn Write, error: &Error, offers: Offers) -> u8 {
    // Other commands end without a word where the reader of a pipe has had enough.
    if !matches!(error, Error::OutputClosed) {
        let advice = error.advice(offers).map_or(String::new(), |advice| format!("; {advice}"));
        // Nothing can be reported if standard error is closed too.
        let _ = writeln!(log, "{}", shown(&format!("stonecut: {error}{advice}")));
    }
    error.exit_code()
}

/// Standard error and the log file, if there is one; `--quiet` keeps everything but errors from the former.
pub struct Log {
    file: Option<std::fs::File>,
    quiet: bool,
}

impl Log {
    pub(super) fn new(talk: &Talk) -> crate::Result<Log> {
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

    /// Says a line, as a terminal may have it, unless `--quiet`; it always reaches the log file.
    pub fn say(&mut self, line: impl std::fmt::Display) {
        let line = line.to_string();
        let line = shown(&line);
        if !self.quiet {
            let _ = writeln!(std::io::stderr(), "{line}");
        }
        if let Some(file) = &mut self.file {
            let _ = writeln!(file, "{line}");
        }
    }
}

/// A log to write to that `--quiet` silences.
pub(super) struct Said<'a>(pub(super) &'a mut Log);

impl Write for Said<'_> {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        match (self.0.quiet, &mut self.0.file) {
            (false, _) => self.0.write_all(bytes)?,
            (true, Some(file)) => file.write_all(bytes)?,
            (true, None) => {}
        }
        Ok(bytes.len())
    }

    fn write_fmt(&mut self, arguments: std::fmt::Arguments<'_>) -> std::io::Result<()> {
        write_shown(self, arguments)
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

    fn write_fmt(&mut self, arguments: std::fmt::Arguments<'_>) -> std::io::Result<()> {
        write_shown(self, arguments)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        std::io::stderr().flush()
    }
}
