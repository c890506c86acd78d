//! Progress counters and cooperative cancellation of a running stage.
//!
//! Stages only count; they never print. The command line reads the counters from a separate thread and
//! draws a bar, writes lines or JSON, or does nothing.

use super::losses::{Ledger, Loss, LossKind};
use crate::error::{Error, Result};
use serde_json::Value;
use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicI32, AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Counters of the running stage and the request to stop; shared by all threads of a run.
#[derive(Debug, Default)]
pub struct Progress {
    stage: Mutex<Stage>,
    done: AtomicU64,
    stop_signal: AtomicI32,
    /// Folders of scratch data that the process owes to remove, whenever it ends.
    scratch: Mutex<Vec<PathBuf>>,
    notes: Mutex<Vec<String>>,
    losses: Mutex<Ledger>,
    board: Mutex<Option<Board>>,
    expected: Mutex<Vec<StageSeconds>>,
}

/// A file that says how far a run is, for those who look at its job from outside.
#[derive(Debug)]
struct Board {
    file: File,
    /// Bytes of the file that stay.
    start: u64,
    /// Facts about the run.
    facts: Value,
    began: Instant,
    shown_at: Instant,
}

/// Time between two looks at a board that show a change.
const BOARD_INTERVAL: Duration = Duration::from_millis(500);

/// A stage, and the seconds that a plan expects of it.
pub type StageSeconds = (&'static str, f64);

/// The stage at work.
#[derive(Clone, Debug, Default)]
pub struct Stage {
    /// Its name in the report: `scan`, `partition`, `simplify`, ...
    pub name: &'static str,
    /// 1 for the first stage of the run.
    pub number: u32,
    /// Number of stages that the run is expected to have.
    pub n_stages: u32,
    /// Work units of the stage, in input triangles.
    pub total: u64,
}

impl Progress {
    /// Begins a stage of `total` work units.
    pub fn begin(&self, name: &'static str, number: u32, n_stages: u32, total: u64) {
        *self.stage.lock().unwrap_or_else(PoisonError::into_inner) =
            Stage { name, number, n_stages, total };
        self.done.store(0, Ordering::Relaxed);
        self.post(true);
    }

    /// Keeps a line of JSON on the stage at work in a file, behind what is there: `facts`, stage and finished work units.
    ///
    /// A file that cannot be written is left alone: the run matters more.
    pub fn post_in(&self, path: &Path, facts: Value) {
        let opened = std::fs::OpenOptions::new().write(true).open(path);
        let board = opened.ok().and_then(|file| {
            let start = file.metadata().ok()?.len();
            let began = Instant::now();
            Some(Board { file, start, facts, began, shown_at: began })
        });
        *self.board.lock().unwrap_or_else(PoisonError::into_inner) = board;
        self.post(true);
    }

    fn post(&self, is_new: bool) {
        let Ok(mut board) = self.board.try_lock() else { return };
        let Some(board) = board.as_mut() else { return };
        if !is_new && board.shown_at.elapsed() < BOARD_INTERVAL {
            return;
        }
        board.shown_at = Instant::now();
        let (stage, done) = self.read();
        // What was done last is of use once the run is over.
        if stage.name.is_empty() {
            return;
        }
        let mut line = board.facts.clone();
        line["stage"] = stage.name.into();
        line["stage_number"] = stage.number.into();
        line["stages"] = stage.n_stages.into();
        line["units_done"] = done.into();
        line["units"] = stage.total.into();
        line["expected"] = serde_json::json!(self.expected());
        line["seconds"] = board.began.elapsed().as_secs_f64().into();
        let text = format!("{line}\n");
        let written = board.file.write_all_at(text.as_bytes(), board.start);
        let _ = written.and_then(|()| board.file.set_len(board.start + text.len() as u64));
    }

    /// Tells the stages that the plan expects, in turn, for those who show what is left.
    pub fn expect(&self, stages: Vec<StageSeconds>) {
        *self.expected.lock().unwrap_or_else(PoisonError::into_inner) = stages;
    }

    /// The stages that the plan expects; none where there is no plan.
    pub fn expected(&self) -> Vec<StageSeconds> {
        self.expected.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Begins the running stage again from 0, with another total, where its first part was counted in other units.
    pub fn count_from_zero(&self, total: u64) {
        self.stage.lock().unwrap_or_else(PoisonError::into_inner).total = total;
        self.done.store(0, Ordering::Relaxed);
    }

    /// Counts finished work units.
    pub fn add(&self, units: u64) {
        self.done.fetch_add(units, Ordering::Relaxed);
        self.post(false);
    }

    /// Leaves a line for people about what was found, to be shown while the run goes on.
    pub fn note(&self, line: String) {
        self.notes.lock().unwrap_or_else(PoisonError::into_inner).push(line);
    }

    /// The lines that were left since the last call.
    pub fn take_notes(&self) -> Vec<String> {
        std::mem::take(&mut *self.notes.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Enters what the input had and the output has not in the ledger of the run: the one way of saying so.
    ///
    /// The command line prints it, every report lists it, and a loss of a whole kind ends the command with exit code 3.
    pub fn lose(&self, loss: Loss) {
        self.ledger().lose(loss);
    }

    /// Enters what a reader, a plan or a writer has gathered; the same again does not count twice.
    pub fn lose_all(&self, losses: &Ledger) {
        self.ledger().merge(losses);
    }

    /// Makes losses of a kind that the output was not wanted for notices.
    pub fn excuse(&self, kind: LossKind) {
        self.ledger().excuse(kind);
    }

    /// The losses so far.
    pub fn losses(&self) -> Ledger {
        self.ledger().clone()
    }

    /// The losses so far, which are forgotten: another command begins.
    pub fn take_losses(&self) -> Ledger {
        std::mem::take(&mut *self.ledger())
    }

    fn ledger(&self) -> std::sync::MutexGuard<'_, Ledger> {
        self.losses.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The running stage and its finished work units.
    pub fn read(&self) -> (Stage, u64) {
        let stage = self.stage.lock().unwrap_or_else(PoisonError::into_inner).clone();
        (stage, self.done.load(Ordering::Relaxed))
    }

    /// Asks every worker to stop at its next safe point.
    pub fn request_stop(&self, signal: i32) {
        self.stop_signal.store(signal, Ordering::Relaxed);
    }

    /// Notes a folder that must not outlive the process, for whoever ends it in the middle of its work.
    pub fn owe(&self, folder: &Path) {
        self.owed().push(folder.to_path_buf());
    }

    /// Removes a folder that was noted; what cannot be removed is left.
    pub fn settle(&self, folder: &Path) {
        let _ = std::fs::remove_dir_all(folder);
        self.owed().retain(|owed| owed != folder);
    }

    /// Removes all folders that are still owed: the process is about to end.
    pub fn settle_all(&self) {
        self.owed().drain(..).for_each(|folder| {
            // A worker may add a file meanwhile; what stays is swept by the next command of its kind.
            let _ = (0..3).any(|_| std::fs::remove_dir_all(&folder).is_ok());
        });
    }

    fn owed(&self) -> std::sync::MutexGuard<'_, Vec<PathBuf>> {
        self.scratch.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Fails once a stop was requested; workers call it between blocks and cells.
    pub fn check(&self) -> Result<()> {
        match self.stop_signal.load(Ordering::Relaxed) {
            0 => Ok(()),
            signal => Err(Error::Interrupted { signal }),
        }
    }
}
