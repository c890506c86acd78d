//! Progress counters and cooperative cancellation of a running stage.
//!
//! Stages only count; they never print. The command line reads the counters from a separate thread and
//! draws a bar, writes lines or JSON, or does nothing.

use crate::error::{Error, Result};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicI32, AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

/// Counters of the running stage and the request to stop; shared by all threads of a run.
#[derive(Debug, Default)]
pub struct Progress {
    stage: Mutex<Stage>,
    done: AtomicU64,
    stop_signal: AtomicI32,
    /// Folders of scratch data that the process owes to remove, whenever it ends.
    scratch: Mutex<Vec<PathBuf>>,
    notes: Mutex<Vec<String>>,
}

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
    }

    /// Begins the running stage again from 0, with another total, where its first part was counted in other units.
    pub fn count_from_zero(&self, total: u64) {
        self.stage.lock().unwrap_or_else(PoisonError::into_inner).total = total;
        self.done.store(0, Ordering::Relaxed);
    }

    /// Counts finished work units.
    pub fn add(&self, units: u64) {
        self.done.fetch_add(units, Ordering::Relaxed);
    }

    /// Leaves a line for people about what was found, to be shown while the run goes on.
    pub fn note(&self, line: String) {
        self.notes.lock().unwrap_or_else(PoisonError::into_inner).push(line);
    }

    /// The lines that were left since the last call.
    pub fn take_notes(&self) -> Vec<String> {
        std::mem::take(&mut *self.notes.lock().unwrap_or_else(PoisonError::into_inner))
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
