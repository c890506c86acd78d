//! The program: from a scan larger than memory to one small mesh.
//!
//! Partition the input into cells on disk, simplify the cells in parallel, stitch until no seam is left,
//! write. Every stage is sealed in the job folder before the next one begins, so the same command continues
//! wherever an earlier run stopped.

pub(crate) mod bake;
mod concluded;
mod derived;
mod error_field;
pub mod extract;
mod fit;
pub mod in_memory;
mod kernel_side;
pub(crate) mod max_error;
pub mod methods;
pub mod optimize;
pub mod pairs;
pub mod plan;
mod prepare;
pub mod refine;
pub mod run_report;
mod sealed_stages;
mod steps;
pub mod tiles;
pub mod transfer;
pub mod units;
pub(crate) mod verify;

use crate::error::Result;
use crate::store::job::Job;
use crate::store::job::fingerprint::job_identity;
use crate::system::disk::Disk;
use crate::system::parallel::guarded;
use crate::system::progress::Progress;
use concluded::concluded;
pub use concluded::has_begun_to_write;
pub use prepare::{Prepared, prepare};
use run_report::RunReport;
use std::path::Path;
use steps::{Ended, RunStep, SimplifyRun};

/// Simplifies the input that is prepared; `None` when `--until` ended the run early.
pub fn simplify(prepared: Prepared, progress: &Progress) -> Result<Option<RunReport>> {
    simplify_on(&Disk::default(), prepared, progress)
}

/// The same through a given disk, so that a test can make it fail. A panic on the way becomes an error.
pub fn simplify_on(
    disk: &Disk,
    prepared: Prepared,
    progress: &Progress,
) -> Result<Option<RunReport>> {
    guarded(|| {
        let retry = prepared.retry.clone();
        match (run(disk, prepared, progress)?, retry) {
            (Ended::ShortOfTarget(left), Some(retry)) => {
                progress.note(format!(
                    "the input's charts leave {left} triangles: again with a new texture (--texture bake)"
                ));
                run(disk, prepare(&retry)?, progress)
            }
            (ended, _) => Ok(ended),
        }
    })
    .map(Ended::report)
}

/// Runs the steps in the job of the settings, or finds that an earlier run has.
fn run(disk: &Disk, prepared: Prepared, progress: &Progress) -> Result<Ended> {
    let Prepared { config, source, marks, .. } = &prepared;
    let identity = job_identity(source, marks, config);
    if let Some(report) = concluded(disk, &identity, config)? {
        return Ok(Ended::Done(Box::new(report)));
    }
    let job = Job::open(&config.job_folder, disk, &identity, config.job.restart)?;
    post(&job, &config.output, source.n_triangles(), progress);
    run_steps(&job, prepared, progress)
}

/// Runs the steps whose outcomes the job does not have yet.
fn run_steps(job: &Job, prepared: Prepared, progress: &Progress) -> Result<Ended> {
    let config = prepared.config.clone();
    // With more memory, what the allocator keeps back does no harm.
    if config.memory_bytes < 2 * prepared.plan.needed_memory_bytes {
        crate::system::memory::keep_nothing_back();
    }
    let mut run = SimplifyRun::new(job, prepared, &config, progress);
    let mut step = RunStep::Partition;
    loop {
        step = match step {
            RunStep::Partition => run.partition()?,
            RunStep::Simplify(cells, goal) => run.simplify(cells, goal)?,
            RunStep::Stitch(survivors, goal) => run.stitch(survivors, goal)?,
            RunStep::Finish(left) => run.finish(left)?,
            RunStep::Write { result, from } => run.write(result, from)?,
            RunStep::End(ended) => return Ok(ended),
        };
    }
}

/// Posts the progress of a job where `status` finds it.
fn post(job: &Job, output: &Path, triangles: u64, progress: &Progress) {
    if let Some(board) = job.board() {
        let output = std::path::absolute(output).unwrap_or_else(|_| output.to_path_buf());
        progress.post_in(&board, serde_json::json!({ "output": output, "triangles": triangles }));
    }
}
