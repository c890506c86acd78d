//! Runs within a run: into a file in the job folder, which a pass then opens, or which becomes the output.
//!
//! `optimize`, `pairs` and `max_error` do this, each with its job; an interrupted run continues in the job of the run within.

use super::concluded::WRITING;
use super::run_report::StageReport;
use crate::config::Config;
use crate::error::Result;
use crate::io::ply::{MeshSource, ReadOptions};
use crate::io::{OutputFormat, OutputKind, StageOptions};
use crate::store::job::{Job, TRIALS};
use crate::system::disk::{Disk, folder_of};
use crate::system::memory::peak_bytes;
use crate::system::pending_file::{self, Place};
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Settings of a run into `path`, all else as it was asked for.
pub(super) fn settings(path: &Path, config: &Config) -> Config {
    Config {
        output: path.to_path_buf(),
        job_folder: config.job_folder.join(TRIALS).join("job"),
        keep_temp: false,
        verify: false,
        force: true,
        restart: false,
        format: OutputFormat {
            kind: Some(OutputKind::Ply),
            coordinate: config.format.coordinate,
            ..OutputFormat::default()
        },
        ..config.clone()
    }
}

/// Path that a trial writes to: in the job folder, with the output's extension, which decides the format.
pub(super) fn trial_path(config: &Config, name: &str) -> PathBuf {
    let mut name = OsString::from(name);
    if let Some(extension) = config.output.extension() {
        name.push(".");
        name.push(extension);
    }
    config.job_folder.join(TRIALS).join(name)
}

/// True if the result has moved from `path` to the output.
pub(super) fn is_delivered(job: &Job, config: &Config, path: &Path) -> Result<bool> {
    let was_writing = job.outcome::<()>(WRITING)?.is_some();
    Ok(was_writing && !path.exists() && config.output.exists())
}

/// The result at `path` becomes the output; a run that was stopped in between finds that it has it already.
pub(super) fn deliver(job: &Job, disk: &Disk, config: &Config, path: &Path) -> Result<()> {
    if is_delivered(job, config, path)? {
        return Ok(());
    }
    if job.outcome::<()>(WRITING)?.is_none() {
        job.record(WRITING, &())?;
    }
    let place = Place { path: config.output.clone(), disk: disk.clone(), replace: config.force };
    pending_file::adopt(path, place)
}

/// Opens a mesh for a pass.
pub(super) fn open(path: &Path, config: &Config, skip_bad: bool) -> Result<MeshSource> {
    let placing = if path == config.input { config.placing.clone() } else { Default::default() };
    let read = ReadOptions { skip_bad, placing, ..ReadOptions::default() };
    let stage = StageOptions { read, ..StageOptions::new(folder_of(&config.job_folder)) };
    let stage = stage.within(config.memory_bytes);
    MeshSource::open_staged(path, &stage)
}

/// The report of a stage that ends now.
pub(super) fn stage(
    name: &str,
    start: Instant,
    (triangles_in, triangles_out): (u64, u64),
    (bytes_read, bytes_written): (u64, u64),
) -> StageReport {
    StageReport {
        name: name.to_owned(),
        part: name.to_owned(),
        seconds: start.elapsed().as_secs_f64(),
        triangles_in,
        triangles_out,
        bytes_read,
        bytes_written,
        peak_memory_bytes: peak_bytes(),
        peak_temp_bytes: 0,
    }
}
