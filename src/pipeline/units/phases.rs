//! The phases of a job in units: what each reads from the records of the others, which stages it runs.
//!
//! `partition`, `finish` and `rest` are the run of one process, stopped early and taken up later; the partition may be done
//! in parts before (`parts`), and rounds are done between them (`rounds`).

use super::kind::Kind;
use super::task::Task;
use crate::config::{Config, JobOptions, Until};
use crate::error::{Error, Result};
use crate::pipeline::kernel_side::Facts;
use crate::pipeline::prepare::prepare;
use crate::pipeline::run_report::{RunReport, StageReport};
use crate::pipeline::run_steps;
use crate::stages::components::Components;
use crate::stages::partition::Partition;
use crate::store::cells::{PackFile, StoreInfo, check_pack};
use crate::store::job::Job;
use crate::store::job::units::{Attempt, Frozen, Record, Unit, UnitFile, UnitJob};
use crate::store::stage_context::StageContext;
use crate::system::memory::BASE_BYTES;
use crate::system::program;
use crate::system::progress::Progress;
use serde::de::DeserializeOwned;
use std::collections::BTreeMap;

/// Names of outcomes that are not those of a stage.
pub(super) const FACTS: &str = "facts";
const REPORT: &str = "report";

/// Returns whether nothing comes after a unit.
pub(super) fn is_last(unit: &Unit) -> bool {
    unit.phase == "rest"
}

/// Does the work of a unit; gives its outcomes and the files that it leaves, and the report of the run in the end.
pub(super) fn run(
    job: &UnitJob,
    attempt: &Attempt,
    task: &Task,
    config: &Config,
    progress: &Progress,
) -> Result<(Record, Option<RunReport>)> {
    let earlier = earlier(job, task, progress)?;
    let phase = PhaseRun { job, attempt, config, progress, earlier };
    let plain = |record| (record, None);
    match task.unit.phase.as_str() {
        "scan" => phase.scan(task).map(plain),
        "tree" => phase.tree().map(plain),
        "scatter" => phase.scatter(task).map(plain),
        "share" => phase.share(task).map(plain),
        "partition" => phase.partition().map(plain),
        "finish" => phase.finish().map(plain),
        "rest" => phase.rest().map(|(record, report)| (record, Some(report))),
        other => match Kind::find(other) {
            Some((Kind::Recut, round)) => phase.recut(round).map(plain),
            Some((Kind::Pilot, round)) => phase.pilot(round, task).map(plain),
            Some((Kind::Trial, round)) => phase.trial(round, task).map(plain),
            Some((Kind::Batch, round)) => phase.batch(round, task).map(plain),
            None => Err(Error::Usage(format!("this program knows no phase '{other}'"))),
        },
    }
}

/// True if a phase has to know of one before it.
fn needs(phase: &str, before: &str) -> bool {
    match (Kind::find(phase), Kind::find(before)) {
        (Some((Kind::Recut, round)), Some(before)) => before == (Kind::Batch, round - 1),
        (Some((_, round)), Some((_, before))) => round == before,
        (Some((kind, round)), None) => {
            let is_first = round == 0 && kind != Kind::Recut;
            // The packs of the parts, but not what only the cells were made from.
            before == "partition" || (is_first && !["scan", "tree"].contains(&before))
        }
        (None, _) => true,
    }
}

/// The records of all units that come before this one and matter to it, by phase; what else their attempts have left is
/// removed by phases of one unit.
fn earlier(
    job: &UnitJob,
    task: &Task,
    progress: &Progress,
) -> Result<BTreeMap<String, Vec<(Unit, Record)>>> {
    let mut earlier = BTreeMap::new();
    let phases = task.frozen.phases.iter().take_while(|phase| phase.name != task.unit.phase);
    for phase in phases.filter(|phase| needs(&task.unit.phase, &phase.name)) {
        let units = task.frozen.units_of(&phase.name).into_iter();
        let require = |unit: Unit| job.require(&unit, progress).map(|record| (unit, record));
        let records: Vec<(Unit, Record)> = units.map(require).collect::<Result<_>>()?;
        if task.frozen.units_of(&task.unit.phase).len() == 1 {
            job.sweep(&records)?;
        }
        earlier.insert(phase.name.clone(), records);
    }
    Ok(earlier)
}

pub(super) struct PhaseRun<'a> {
    job: &'a UnitJob,
    attempt: &'a Attempt<'a>,
    pub(super) config: &'a Config,
    pub(super) progress: &'a Progress,
    pub(super) earlier: BTreeMap<String, Vec<(Unit, Record)>>,
}

impl PhaseRun<'_> {
    /// A job with what was found before.
    pub(super) fn guest(&self, more: BTreeMap<String, serde_json::Value>) -> Job {
        let is_single = |name: &str| {
            ["tree", "partition", "finish"].contains(&name) || name.starts_with("recut-")
        };
        let records = self.earlier.iter().filter(|(name, _)| is_single(name)).flat_map(|(_, r)| r);
        let mut outcomes: BTreeMap<String, serde_json::Value> =
            records.flat_map(|(_, record)| record.outcomes.clone()).collect();
        self.name_packs(&mut outcomes);
        outcomes.extend(more);
        let folder = self.job.units_folder();
        Job::guest(&folder, self.job.disk(), self.attempt.prefix(), outcomes)
    }

    pub(super) fn context<'a>(&'a self, job: &'a Job) -> StageContext<'a> {
        StageContext {
            job,
            progress: self.progress,
            threads: self.config.threads.get(),
            memory_bytes: self.config.memory_bytes.saturating_sub(BASE_BYTES),
            checkpoint_every: self.config.checkpoint_every,
        }
    }

    /// The settings of a run that ends early.
    fn until(&self, until: Until) -> Config {
        let job = JobOptions { until: Some(until), ..self.config.job };
        Config { job, ..self.config.clone() }
    }

    /// Cells on disk, and all that is to be known of them before the first round.
    fn partition(self) -> Result<Record> {
        let config = self.until(Until::Cells);
        let prepared = prepare(&config)?;
        let facts = Facts::new(&prepared.source, prepared.plan.target);
        let triangles = facts.n_triangles;
        let job = self.guest(BTreeMap::new());
        job.record(FACTS, &facts)?;
        self.join_parts(&prepared.source, &job)?;
        run_steps(&job, prepared, self.progress)?;
        let store = store_of(&job)?;
        let files = store.packs.into_iter().chain(store.verdicts);
        let files = files.filter(|file| job.owns(&file.pack)).map(unit_file).collect();
        Ok(Record { outcomes: job.recorded(), files, triangles, ..Record::default() })
    }

    /// Everything from the survivors of the last round in units to the result, or to that of the first level of a chain.
    fn finish(self) -> Result<Record> {
        let config = self.until(Until::Stitch);
        let prepared = prepare(&config)?;
        let job = self.guest(self.rounds()?);
        run_steps(&job, prepared, self.progress)?;
        let files = self.attempt.files()?;
        Ok(Record { outcomes: job.recorded(), files, ..Record::default() })
    }

    /// The output; for a chain its further levels before it.
    fn rest(self) -> Result<(Record, RunReport)> {
        let prepared = prepare(self.config)?;
        self.job.begin_to_write()?;
        let job = self.guest(self.rounds()?);
        let report = run_steps(&job, prepared, self.progress)?.report();
        let mut report =
            report.ok_or_else(|| Error::Internal("the run has no report".to_owned()))?;
        let began = self.earlier.values().flatten().map(|(_, record)| record.span[0]);
        report.seconds = (program::now() - began.fold(f64::INFINITY, f64::min)).max(report.seconds);
        report.triangles_per_second = report.input.triangles as f64 / report.seconds.max(1e-9);
        let value = serde_json::to_value(report.written()).expect("plain data");
        let outcomes = BTreeMap::from([(REPORT.to_owned(), value)]);
        let triangles = report.input.triangles;
        Ok((Record { outcomes, triangles, ..Record::default() }, report))
    }
}

/// Units as one stage.
pub(super) fn stage_report(
    name: &str,
    units: &[(Unit, Record)],
    triangles_out: u64,
) -> StageReport {
    let records = || units.iter().map(|(_, record)| record);
    let began = records().map(|record| record.span[0]).fold(f64::INFINITY, f64::min);
    let ended = records().map(|record| record.span[1]).fold(0.0, f64::max);
    StageReport {
        name: name.to_owned(),
        part: StageReport::part_of(name).to_owned(),
        seconds: (ended - began).max(0.0),
        triangles_in: records().map(|record| record.triangles).sum(),
        triangles_out,
        bytes_read: records().map(|record| record.bytes_read).sum(),
        bytes_written: records().map(|record| record.bytes_written).sum(),
        peak_memory_bytes: records().map(|record| record.peak_memory_bytes).max().unwrap_or(0),
        peak_temp_bytes: 0,
    }
}

/// A pack as a file of a unit.
pub(super) fn unit_file(file: PackFile) -> UnitFile {
    UnitFile { pack: file.pack, bytes: file.pack_bytes }
}

pub(super) fn found<T: DeserializeOwned>(job: &Job, name: &str) -> Result<T> {
    let missing = || Error::Internal(format!("an earlier phase has left no '{name}'"));
    job.outcome(name)?.ok_or_else(missing)
}

/// The cells of the first round, as they were left by the last stage before it.
pub(super) fn store_of(job: &Job) -> Result<StoreInfo> {
    match job.outcome::<(Components, StageReport)>("components")? {
        Some((components, _)) => Ok(components.store),
        None => Ok(found::<(Partition, StageReport)>(job, "partition")?.0.store),
    }
}

/// Reads all files of a record and checks them.
pub(super) fn is_whole(job: &UnitJob, frozen: &Frozen, record: &Record) -> Result<bool> {
    let last = frozen.phases.last().map_or_else(Vec::new, |phase| frozen.units_of(&phase.name));
    let is_over = job.done()?.iter().any(|unit| last.contains(unit));
    // Nothing needs them any more; they are gone.
    if is_over {
        return Ok(true);
    }
    for file in &record.files {
        match check_pack(job.disk(), &job.units_folder().join(&file.pack), file.bytes) {
            Ok(()) => {}
            Err(Error::Corrupt { .. }) => return Ok(false),
            Err(error) => return Err(error),
        }
    }
    Ok(true)
}
