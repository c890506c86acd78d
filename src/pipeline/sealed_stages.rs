//! The stages of any run: each is sealed in the job folder, timed and reported.

use super::run_report::StageReport;
use crate::error::Result;
use crate::store::stage_context::StageContext;
use crate::system::memory::give_back;
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
    /// Seconds of stages that earlier processes have done.
    earlier_seconds: f64,
}

impl<'a> SealedStages<'a> {
    pub(super) fn new(run: StageContext<'a>, n_stages: u32) -> Self {
        SealedStages { run, reports: Vec::new(), n_stages, earlier_seconds: 0.0 }
    }

    /// The most bytes of temporary files at one time, before an interruption too.
    pub(super) fn peak_temp_bytes(&self) -> u64 {
        let own = self.run.disk().peak_bytes();
        self.reports.iter().map(|report| report.peak_temp_bytes).fold(own, u64::max)
    }

    /// Seconds since `started`, and those of the stages that earlier processes have done; triangles of the input for each of them.
    pub(super) fn seconds(&self, started: Instant, n_triangles: u64) -> (f64, f64) {
        let seconds = started.elapsed().as_secs_f64() + self.earlier_seconds;
        (seconds, n_triangles as f64 / seconds.max(1e-9))
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
        let (outcome, report): (T, StageReport) = match run.job.outcome(key)? {
            Some(done) => {
                let (_, report): &(T, StageReport) = &done;
                self.earlier_seconds += report.seconds;
                done
            }
            None => {
                let (disk, start) = (run.disk(), Instant::now());
                let (read, written) = (disk.bytes_read(), disk.bytes_written());
                let outcome = work(&run)?;
                give_back();
                let bytes = (disk.bytes_read() - read, disk.bytes_written() - written);
                let report = StageReport {
                    peak_temp_bytes: disk.peak_bytes(),
                    ..StageReport::since(name, start, (triangles_in, count(&outcome)), bytes)
                };
                let done = (outcome, report);
                run.job.record(key, &done)?;
                done
            }
        };
        self.reports.push(report);
        Ok(outcome)
    }
}
