//! The lines and the exit code of a command: standard error, the log file, and how much is said.

use crate::error::{Error, Offers};
use crate::system::losses::{Ledger, Severity};
use crate::system::terminal::{shown, write_shown};
use serde_json::{Value, json};
use std::io::Write;
use std::time::Instant;

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
    /// A JSON object a line on standard error, every second and at every stage, and nothing else there; --quiet does not silence it.
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
    /// Say nothing but errors, and why an exit code is not 0.
    #[arg(short, long, global = true)]
    pub(super) quiet: bool,
    /// Say more: every stage and its figures.
    #[arg(short, long, global = true)]
    pub(super) verbose: bool,
    /// Write what is said to this file too.
    #[arg(long, value_name = "FILE", global = true)]
    pub(super) log_file: Option<std::path::PathBuf>,
}

impl Talk {
    /// Nothing is said.
    pub(super) fn silent() -> Talk {
        Talk { progress: Show::None, quiet: true, verbose: false, log_file: None }
    }
}

/// Says what went wrong and what to do about it, as an event where progress is shown as JSON; gives the exit code.
pub(super) fn complain(log: &mut dyn Write, show: Show, error: &Error, offers: Offers) -> u8 {
    // Other commands end without a word where the reader of a pipe has had enough.
    if matches!(error, Error::OutputClosed) {
        return error.exit_code();
    }
    // Nothing can be reported if standard error is closed too.
    let _ = match show {
        Show::Json => {
            writeln!(log, "{}", event("error", failure(error, offers)))
        }
        _ => {
            let advice = error.advice(offers).map_or(String::new(), |advice| format!("; {advice}"));
            writeln!(log, "{}", shown(&format!("stonecut: {error}{advice}")))
        }
    };
    error.exit_code()
}

/// A failure as an event says it.
fn failure(error: &Error, offers: Offers) -> Value {
    json!({
        "error": error.to_string(), "code": error.code(), "advice": error.advice(offers),
        "exit_code": error.exit_code(),
    })
}

/// The facts of the last event of `--progress json`: the report of a command, or its failure.
pub(super) fn end_of(outcome: Result<(Value, u8), &Error>, offers: Offers) -> Value {
    match outcome {
        Ok((report, code)) => json!({ "report": report, "exit_code": code }),
        Err(error) => failure(error, offers),
    }
}

/// Writes the last event of `--progress json`.
pub(super) fn say_end(log: &mut dyn Write, show: Show, mut fields: Value, began: Instant) {
    if show == Show::Json {
        fields["seconds"] = began.elapsed().as_secs_f64().into();
        let _ = writeln!(log, "{}", event("end", fields));
    }
}

/// An object of `--progress json`.
fn event(name: &str, mut fields: Value) -> Value {
    fields["event"] = name.into();
    fields
}

/// Standard error and the log file, if there is one; `--quiet` keeps everything but errors from the former.
pub struct Log {
    file: Option<std::fs::File>,
    quiet: bool,
    is_json: bool,
    /// The beginning of a line that `Said` has not heard the end of.
    begun: Vec<u8>,
    /// Lines that `--quiet` keeps back until the exit code is known.
    reasons: Vec<String>,
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
        let is_json = talk.progress == Show::Json;
        Ok(Log { file, quiet: talk.quiet, is_json, begun: Vec::new(), reasons: Vec::new() })
    }

    /// A log that keeps everything to itself.
    pub(super) fn silent() -> Log {
        Log { file: None, quiet: true, is_json: false, begun: Vec::new(), reasons: Vec::new() }
    }

    /// Says a line, as a terminal may have it, unless `--quiet`; it always reaches the log file.
    pub fn say(&mut self, line: impl std::fmt::Display) {
        let line = line.to_string();
        if self.is_json {
            return self.event("note", json!({ "note": line.trim() }));
        }
        let line = shown(&line);
        if !self.quiet {
            let _ = writeln!(std::io::stderr(), "{line}");
        }
        if let Some(file) = &mut self.file {
            let _ = writeln!(file, "{line}");
        }
    }

    /// Says a line that gives the reason of an exit code, if it comes to one; `--quiet` waits for that.
    pub(super) fn say_reason(&mut self, line: impl std::fmt::Display) {
        let line = line.to_string();
        self.say(&line);
        if self.quiet && !self.is_json {
            self.reasons.push(line);
        }
    }

    /// Says what `--quiet` has kept back of the reasons of an exit code.
    pub(super) fn give_reasons(&mut self, code: u8) {
        for line in self.reasons.drain(..).filter(|_| code != 0) {
            let _ = writeln!(std::io::stderr(), "{}", shown(line.trim_start()));
        }
    }
}

impl Log {
    /// Writes an event of `--progress json`; nothing in other forms of progress.
    pub(super) fn event(&mut self, name: &str, fields: Value) {
        if self.is_json {
            let _ = writeln!(self, "{}", event(name, fields));
        }
    }

    /// Says the plan of a run.
    pub(super) fn plan(&mut self, lines: Vec<String>, plan: &impl serde::Serialize) {
        match self.is_json {
            true => self.event("plan", json!({ "plan": plan })),
            false => lines.into_iter().for_each(|line| self.say(line)),
        }
    }

    /// Writes the report of a run as the event `summary`; false in other forms of progress, where nothing is written.
    pub(super) fn summary(&mut self, report: &impl serde::Serialize) -> bool {
        self.event("summary", json!({ "report": report }));
        self.is_json
    }

    /// Says what the input had and the output has not, a line each; gives the exit code of a command that has ended with `code`.
    pub(super) fn say_losses(&mut self, losses: &Ledger, code: u8) -> u8 {
        for loss in losses.entries() {
            let how = match loss.severity {
                Severity::Notice => "note",
                Severity::Partial => "lost in part",
                Severity::Whole => "lost",
            };
            match (self.is_json, loss.severity) {
                (true, _) => self.event("loss", json!({ "loss": loss })),
                (_, Severity::Whole) => self.say_reason(format!("  {how}: {loss}")),
                _ => self.say(format!("  {how}: {loss}")),
            }
        }
        if code == 0 && losses.has_whole() { EXIT_SHORT } else { code }
    }
}

/// A log to write to that `--quiet` silences.
pub(super) struct Said<'a>(pub(super) &'a mut Log);

impl Write for Said<'_> {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        if self.0.is_json {
            self.0.begun.extend_from_slice(bytes);
            while let Some(end) = self.0.begun.iter().position(|&b| b == b'\n') {
                let line: Vec<u8> = self.0.begun.drain(..=end).collect();
                self.0.say(String::from_utf8_lossy(&line));
            }
            return Ok(bytes.len());
        }
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
