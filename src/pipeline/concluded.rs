//! The end of a run whose outputs stand: its report is recorded, then its job folder goes. A run that is stopped in between is not
//! done again: the same command finds the report, and clears up the rest.

use super::run_report::RunReport;
use crate::config::Config;
use crate::error::{Error, Result};
use crate::store::job::{self, Identity, Job};
use crate::system::disk::Disk;
use serde::{Deserialize, Serialize};
use std::os::unix::fs::MetadataExt;
use std::path::Path;

/// Recorded before the output is written: an output that is found later may be this job's own.
pub(super) const WRITING: &str = "writing";

/// Record of a run that is over.
#[derive(Serialize, Deserialize)]
struct Conclusion {
    report: RunReport,
    /// Length and time of the last change of each output.
    outputs: Vec<Option<[i64; 3]>>,
}

fn outputs(config: &Config) -> Vec<Option<[i64; 3]>> {
    let mark = |path: &std::path::PathBuf| {
        let meta = std::fs::symlink_metadata(path).ok()?;
        Some([meta.len() as i64, meta.mtime(), meta.mtime_nsec()])
    };
    config.outputs().map(mark).collect()
}

/// Removes the job folder of a run whose outputs stand.
pub(super) fn conclude(job: &Job, config: &Config, report: &RunReport) -> Result<()> {
    job.conclude(&Conclusion { report: report.clone(), outputs: outputs(config) })
}

/// The report of a run that was stopped while it removed its job folder, if its outputs are as it left them; the folder goes now.
///
/// Errors: `Usage` if an output is there after all that is not of this run.
pub(super) fn concluded(
    disk: &Disk,
    identity: &Identity,
    config: &Config,
) -> Result<Option<RunReport>> {
    if config.job.restart {
        return Ok(None);
    }
    let found: Option<Conclusion> = Job::concluded(&config.job_folder, disk, identity)?;
    let report = found.filter(|over| over.outputs == outputs(config)).map(|over| over.report);
    if report.is_none() {
        // The folder that made an output look like that of this run may be gone now.
        refuse_to_overwrite(config)?;
        let is_there = config.outputs().any(|output| output.exists());
        if is_there && job::is_remainder(&config.job_folder, &config.output) {
            // The job begins again. That the output may be its own outlives another stop.
            Job::begin_with(&config.job_folder, disk, identity, WRITING)?;
        }
    }
    Ok(report)
}

/// True if an existing output may be that of the job in this folder, or of the one whose last traces lie there.
pub fn has_begun_to_write(job_folder: &Path, output: &Path) -> bool {
    job::units::has_begun(job_folder)
        || job::view(job_folder).is_ok_and(|view| {
            [WRITING, job::OVER].iter().any(|name| view.outcomes.contains_key(*name))
        })
        || job::is_remainder(job_folder, output)
}

/// The writer itself compares: a run that died between its rename and its end has left the same bytes.
pub(super) fn refuse_to_overwrite(config: &Config) -> Result<()> {
    let may_be_ours =
        || !config.job.restart && has_begun_to_write(&config.job_folder, &config.output);
    let existing = config.outputs().find(|output| output.exists());
    if let (Some(path), false) = (existing, config.job.force || may_be_ours()) {
        let path = path.display();
        return Err(Error::Usage(format!("{path} exists; give --force to replace it")));
    }
    Ok(())
}

/// Removes a job that no command can continue: with a bad input or an empty result, whatever helps (another input,
/// `--skip-bad`, another target) makes another job. All other errors leave it as it is.
pub(crate) fn abandon(job: &Job, error: Error) -> Error {
    if is_final(&error) {
        // What cannot be removed costs space; the error that led here matters more.
        let _ = job.remove();
    }
    error
}

/// True if the same command would fail again.
pub(crate) fn is_final(error: &Error) -> bool {
    matches!(error, Error::BadInput { .. } | Error::Empty { .. })
}
