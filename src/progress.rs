//! What a running stage tells the outside, and how the outside tells it to stop.
//!
//! Stages only count; they never print. The command line reads the counters from a thread of its own and
//! draws a bar, writes lines or JSON, or does nothing.

use crate::error::{Error, Result};
use std::sync::atomic::{AtomicBool, AtomicI32, AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

/// Counters of the running stage and the request to stop; shared by all threads of a run.
#[derive(Debug, Default)]
pub struct Progress {
    stage: Mutex<Stage>,
    done: AtomicU64,
    stop_signal: AtomicI32,
    /// Whether what runs may end at any moment without loss or litter.
    is_resumable: AtomicBool,
}

/// The stage at work.
#[derive(Clone, Debug, Default)]
pub struct Stage {
    /// Its name in the report: `scan`, `partition`, `simplify`, ...
    pub name: &'static str,
    /// 1 for the first stage of the run.
    pub number: u32,
    /// How many stages the run is expected to have.
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

    /// Counts finished work units.
    pub fn add(&self, units: u64) {
        self.done.fetch_add(units, Ordering::Relaxed);
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

    /// Says whether the process may be ended in the middle of what it does now: a resumable run loses nothing
    /// by it, a scratch folder would be left behind.
    pub fn set_resumable(&self, is_resumable: bool) {
        self.is_resumable.store(is_resumable, Ordering::Relaxed);
    }

    /// Whether what runs may be ended at any moment.
    pub fn is_resumable(&self) -> bool {
        self.is_resumable.load(Ordering::Relaxed)
    }

    /// Fails once a stop was requested; workers call it between blocks and cells.
    pub fn check(&self) -> Result<()> {
        match self.stop_signal.load(Ordering::Relaxed) {
            0 => Ok(()),
            signal => Err(Error::Interrupted { signal }),
        }
    }
}
