//! Context of every stage besides its own input: the job, the counters, threads and memory.

use crate::job::Job;
use std::time::Duration;
use stonecut_system::disk::Disk;
use stonecut_system::progress::Progress;

/// The surroundings of a stage. None of it may reach a result.
#[derive(Clone, Copy, Debug)]
pub struct StageContext<'a> {
    /// The job folder, its files and its manifest.
    pub job: &'a Job,
    /// Counters for the outside, and its request to stop.
    pub progress: &'a Progress,
    /// Worker threads.
    pub threads: usize,
    /// Memory that the stage may take, in bytes.
    pub memory_bytes: u64,
    /// Progress within a stage is made durable so often.
    pub checkpoint_every: Duration,
}

impl StageContext<'_> {
    /// The file system of the job.
    pub fn disk(&self) -> &Disk {
        self.job.disk()
    }
}
