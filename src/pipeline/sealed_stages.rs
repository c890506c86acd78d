//! The stages of any run: each is sealed in the job folder, timed and reported.

use super::run_report::StageReport;
use crate::error::Result;
use crate::store::stage_context::StageContext;
use crate::system::memory::{give_back, peak_bytes};
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::time::Instant;

/// The stages of a run up to now.
pub(super) struct SealedStages<'a> {
    pub(super) run: StageContext<'a>,
    /// A report for each stage that is done.
    pub(super) reports: Vec<StageReport>,
    /// Stages that are expected.
    n_stages: u32,
}

impl<'a> SealedStages<'a> {
    pub(super) fn new(run: StageContext<'a>, n_stages: u32) -> Self {
        SealedStages { run, reports: Vec::new(), n_stages }
    }

    /// The most bytes of temporary files at one time, before an interruption too.
    pub(super) fn peak_temp_bytes(&self) -> u64 {
        let own = self.run.disk().peak_bytes();
        self.reports.iter().map(|report| report.peak_temp_bytes).fold(own, u64::max)
    }

    /// Triangles of the input for each second of the stages, before an interruption too; `seconds` are those of this run.
    pub(super) fn rate(&self, n_triangles: u64, seconds: f64) -> f64 {
        let of_stages: f64 = self.reports.iter().map(|report| report.seconds).sum();
        n_triangles as f64 / seconds.max(of_stages).max(1e-9)
    }

    /// Announces a stage that counts up to `total`.
    pub(super) fn begin(&self, name: &'static str, total: u64) {
        let number = self.reports.len() as u32 + 1;
        self.run.progress.begin(name, number, self.n_stages.max(number), total);
    }

    /// Runs a stage, or takes its outcome from the manifest, where it stands as `key`; `count` tells the triangles of
    /// an outcome.
    pub(super) fn stage<T: Serialize + DeserializeOwned>(
        &mut self,
        (key, name): (&str, &'static str),
        triangles_in: u64,
        count: impl Fn(&T) -> u64,
        work: impl FnOnce(&StageContext) -> Result<T>,
    ) -> Result<T> {
        let run = self.run;
        self.begin(name, triangles_in);
        run.progress.check()?;
        let (outcome, report): (T, StageReport) = run.job.sealed(key, || {
            let (read, written, start) =
                (run.disk().bytes_read(), run.disk().bytes_written(), Instant::now());
            let outcome = work(&run)?;
            give_back();
            let report = StageReport {
                name: name.to_owned(),
                part: StageReport::part_of(name).to_owned(),
                seconds: start.elapsed().as_secs_f64(),
                triangles_in,
                triangles_out: count(&outcome),
                bytes_read: run.disk().bytes_read() - read,
                bytes_written: run.disk().bytes_written() - written,
                peak_memory_bytes: peak_bytes(),
                peak_temp_bytes: run.disk().peak_bytes(),
            };
            Ok((outcome, report))
        })?;
        self.reports.push(report);
        Ok(outcome)
    }
}
