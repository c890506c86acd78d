//! A command, and what it works with: the form of every file of a command here.

use super::answer::CommandEnd;
use super::display::watch;
use super::log::{Log, Talk};
use super::reading;
use crate::error::{Error, Offers, Result};
use crate::system::paths::Paths;
use crate::system::progress::Progress;
use std::io::Write;
use std::path::PathBuf;

/// A command with the options that were typed.
pub(super) trait Command {
    /// Every path that was typed, with what the command does with it; the gate before the work reads them here.
    ///
    /// Errors: `Usage` for a name that says that it is something else.
    fn paths(&self) -> Result<Paths>;

    /// The options that can help against a failure.
    fn offers(&self) -> Offers {
        Offers::default()
    }

    /// The exit code of an earlier run that has done the same, if its report proves that, with what to say then.
    fn done_before(&self) -> Option<(u8, String)> {
        None
    }

    /// True if what the mesh has lost does not change the exit code.
    fn ignores_losses(&self) -> bool {
        false
    }

    /// Does the work, says what was done, and writes the report that was asked for.
    fn run(&self, session: &mut Session) -> Result<CommandEnd>;
}

/// The surroundings of a command.
pub(super) struct Session<'a> {
    /// The form of what is said.
    pub(super) talk: &'a Talk,
    /// Counters for the outside, and its request to stop.
    pub(super) progress: &'a Progress,
    /// The lines that are said.
    pub(super) log: &'a mut Log,
    /// True on the command line; false for a caller in the same process, for whom nothing is printed.
    pub(super) prints: bool,
    /// The whole command line.
    pub(super) line: fn() -> clap::Command,
    /// Runs another command, given as words that begin with the program's name; gives its exit code.
    pub(super) run_words: fn(&[String], &mut Session) -> Result<u8>,
}

impl Session<'_> {
    /// Shows the progress while `work` runs.
    pub(super) fn watch<T>(&mut self, work: impl FnOnce() -> T) -> T {
        watch(self.talk, self.progress, self.log, work)
    }

    /// The same while `work` opens inputs.
    pub(super) fn watch_reading<T>(
        &mut self,
        inputs: Result<Vec<PathBuf>>,
        work: impl FnOnce() -> T,
    ) -> T {
        // What cannot be looked up is refused by the work.
        reading::begin(&inputs.unwrap_or_default(), self.progress);
        self.watch(work)
    }

    /// Prints on standard output.
    pub(super) fn print(&self, text: &str) -> Result<()> {
        match self.prints {
            true => std::io::stdout().write_all(text.as_bytes()).map_err(Error::stdout),
            false => Ok(()),
        }
    }

    /// Says what the work has noted as warnings; a caller in the same process takes the notes.
    pub(super) fn warn_of_notes(&mut self) {
        if self.prints {
            for line in self.progress.take_notes() {
                self.log.say(format!("warning: {line}"));
            }
        }
    }
}
