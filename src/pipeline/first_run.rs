//! The run before a pass over a result: into a file in the job folder, which the pass then opens.
//!
//! `optimize` and `pairs` do this, each with its job; an interrupted run continues in the job of the run before.

use super::run_report::StageReport;
use crate::config::Config;
use crate::error::Result;
use crate::io::ply::{MeshSource, ReadOptions};
use crate::io::{OutputFormat, OutputKind, StageOptions};
use crate::store::job::TRIALS;
use crate::system::disk::folder_of;
use crate::system::memory::peak_bytes;
use std::path::Path;
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

/// Opens a mesh for a pass.
pub(super) fn open(path: &Path, config: &Config, skip_bad: bool) -> Result<MeshSource> {
    let read = ReadOptions { skip_bad, ..ReadOptions::default() };
    let stage = StageOptions { read, ..StageOptions::new(folder_of(&config.job_folder)) };
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
    }
}
