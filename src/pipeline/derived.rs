//! Runs that are made of other runs: `optimize`, `pairs`, `max_error`; and those of other methods, which begin and end alike.
//!
//! A run within writes into a file in the job folder, which a pass then opens, or which becomes the output; an interrupted run
//! continues in the job of the run within.

use super::concluded::{WRITING, abandon, concluded};
use super::methods::write::write;
use super::run_report::{RunReport, StageReport};
use super::verify;
use crate::config::{CheckOptions, Config, JobOptions};
use crate::error::Result;
use crate::io::ply::{MeshSource, ReadOptions};
use crate::io::{InputPaths, OutputFormat, OutputKind, StageOptions};
use crate::mesh::codec::VertexCodec;
use crate::mesh::property::Origin;
use crate::methods::Made;
use crate::store::job::fingerprint::job_identity;
use crate::store::job::{Job, TRIALS};
use crate::system::disk::{Disk, folder_of};
use crate::system::memory::peak_bytes;
use crate::system::parallel::guarded;
use crate::system::pending_file::{self, Place};
use crate::system::progress::Progress;
use std::collections::BTreeMap;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// A run while its parts run.
pub(super) struct DerivedRun<'a> {
    pub(super) job: Job,
    pub(super) disk: Disk,
    /// The settings of the whole; floats that are labels in the input are named in them.
    pub(super) config: &'a Config,
    pub(super) progress: &'a Progress,
    /// Fingerprint of the input.
    pub(super) marks: &'a BTreeMap<String, String>,
}

/// Opens the job of a run and does the `work`, or finds that an earlier run has done it. Then sums up, verifies if that was
/// asked for, and gives up the job folder. `None` if the work ended early.
pub(super) fn derive(
    source: MeshSource,
    marks: &BTreeMap<String, String>,
    config: &Config,
    progress: &Progress,
    work: impl FnOnce(&DerivedRun, MeshSource) -> Result<Option<RunReport>>,
) -> Result<Option<RunReport>> {
    guarded(|| {
        let (started, disk, n_input) = (Instant::now(), Disk::default(), source.n_triangles());
        let identity = job_identity(&source, marks, config);
        if let Some(report) = concluded(&disk, &identity, config)? {
            return Ok(Some(report));
        }
        let job = Job::open(&config.job_folder, &disk, &identity, config.job.restart)?;
        let run = DerivedRun { job, disk, config: &labelled(&source, config), progress, marks };
        let Some(mut report) = work(&run, source)? else { return Ok(None) };
        report.settings = identity.settings;
        // Of a method, the survey before the job counts.
        report.seconds += started.elapsed().as_secs_f64();
        report.triangles_per_second = n_input as f64 / report.seconds.max(1e-9);
        report.peak_memory_bytes = peak_bytes();
        report.peak_temp_bytes = report.peak_temp_bytes.max(run.disk.peak_bytes());
        verify::end(&run.job, config, progress, &mut report)?;
        Ok(Some(report))
    })
}

/// The settings, with the labels that a survey of the input has found: in a coarse mesh they may no longer look like ones.
fn labelled(source: &MeshSource, config: &Config) -> Config {
    let mut config = config.clone();
    let found =
        source.schema().properties.iter().filter(|p| p.is_patchy && p.origin == Origin::Vertex);
    for name in found.map(|p| &p.name) {
        if !config.attributes.labels.contains(name) {
            config.attributes.labels.push(name.clone());
        }
    }
    config
}

impl DerivedRun<'_> {
    /// A path for the result of a run within, in a folder that is made for those.
    pub(super) fn inner_path(&self, name: &str) -> Result<PathBuf> {
        self.disk.create_dir(&self.job.path(TRIALS))?;
        Ok(self.job.path(TRIALS).join(name))
    }

    /// The recorded outcome of a part, or that of `work`. A failure that is final ends the job.
    pub(super) fn part<T: serde::Serialize + serde::de::DeserializeOwned>(
        &self,
        name: &str,
        work: impl FnOnce() -> Result<T>,
    ) -> Result<T> {
        self.job.sealed(name, work).map_err(|error| abandon(&self.job, error))
    }

    /// Writes a mesh in memory as the output; gives the stage.
    pub(super) fn write(
        &self,
        source: &MeshSource,
        made: &Made,
        codec: &VertexCodec,
        n_steps: u32,
    ) -> Result<StageReport> {
        let (start, n) = (Instant::now(), made.mesh.triangles.len() as u64);
        self.note_writing()?;
        self.progress.begin("write", n_steps, n_steps, n);
        let bytes = write(source, made, codec, self.config, &self.disk, self.progress)?;
        Ok(StageReport::since("write", start, (n, n), (0, bytes)))
    }

    /// Records that an output that is found from now on may be that of this job.
    fn note_writing(&self) -> Result<()> {
        match self.job.outcome::<()>(WRITING)? {
            Some(()) => Ok(()),
            None => self.job.record(WRITING, &()),
        }
    }

    /// True if the result has moved from `path` to the output.
    pub(super) fn is_delivered(&self, path: &Path) -> Result<bool> {
        let was_writing = self.job.outcome::<()>(WRITING)?.is_some();
        Ok(was_writing && !path.exists() && self.config.output.exists())
    }

    /// The result at `path` becomes the output; a run that was stopped in between finds that it has it already.
    pub(super) fn deliver(&self, path: &Path) -> Result<()> {
        if self.is_delivered(path)? {
            return Ok(());
        }
        self.note_writing()?;
        let (output, disk) = (self.config.output.clone(), self.disk.clone());
        pending_file::adopt(path, Place { path: output, disk, replace: self.config.job.force })
    }
}

/// Settings of a run within, into `output`, with a job of this name; all else as it was asked for.
pub(super) fn within(config: &Config, output: PathBuf, job: &str) -> Config {
    Config {
        output,
        job_folder: config.job_folder.join(TRIALS).join(job),
        job: JobOptions { keep_temp: false, force: true, restart: false, ..config.job },
        checks: CheckOptions { verify: false, ..config.checks.clone() },
        ..config.clone()
    }
}

/// Settings of a run within into a PLY file at `path`, that a pass opens.
pub(super) fn settings(path: &Path, config: &Config) -> Config {
    let format = OutputFormat {
        kind: Some(OutputKind::Ply),
        coordinate: config.format.coordinate,
        ..OutputFormat::default()
    };
    Config { format, ..within(config, path.to_path_buf(), "job") }
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

/// Opens a mesh for a pass.
pub(super) fn open(path: &InputPaths, config: &Config, skip_bad: bool) -> Result<MeshSource> {
    let placing = if *path == config.input { config.placing.clone() } else { Default::default() };
    let read = ReadOptions { skip_bad, placing, ..ReadOptions::default() };
    let stage = StageOptions { read, ..StageOptions::new(folder_of(&config.job_folder)) };
    let stage = stage.within(config.memory_bytes);
    MeshSource::open_staged(path, &stage)
}
