//! The phases of rounds: for the first one a pilot and batches of cells, for each later one new cells with their
//! thresholds, and batches of these.
//!
//! Only rounds to a threshold that a pilot finds are done so. Where a round is not of that kind (a small mesh, a target
//! near what there is), or where counts fall other than planned, its phases have nothing to do, and `rest` goes on from
//! there.

use super::phases::{FACTS, Run, found, phase_of_round, stage_report, store_of, unit_file};
use super::task::Task;
use crate::config::Config;
use crate::error::Result;
use crate::kernel;
use crate::pipeline::kernel_side::{Facts, kernel_side};
use crate::pipeline::run_report::StageReport;
use crate::stages::simplify::{self, Goal};
use crate::stages::stitch::{self, Step};
use crate::store::cells::{CellStore, StoreInfo, SurvivorInfo, SurvivorPack};
use crate::store::job::Job;
use crate::store::job::units::{Record, Unit, UnitFile};
use std::collections::BTreeMap;
use std::time::Instant;

/// Name of the outcome of a batch.
const BATCH: &str = "batch";

impl Run<'_> {
    /// The thresholds of the first round.
    pub(super) fn pilot(self) -> Result<Record> {
        let job = self.guest(BTreeMap::new());
        self.find_thresholds(0, &job)?;
        Ok(Record { outcomes: job.recorded(), ..Record::default() })
    }

    fn find_thresholds(&self, round: u32, job: &Job) -> Result<()> {
        let Some(Round { store, goal, options }) = Round::of(round, job, self.config)? else {
            return Ok(());
        };
        self.progress.begin("pilot", 1, 1, 0);
        simplify::find_thresholds(&store, goal, &options, &self.context(job))
    }

    /// New cells for a later round, and its thresholds.
    pub(super) fn recut(self, round: u32) -> Result<Record> {
        let job = self.guest(self.rounds()?);
        let facts: Facts = found(&job, FACTS)?;
        let size = self.config.cell_triangles;
        let before: Option<(SurvivorInfo, StageReport)> =
            job.outcome(&format!("round {}", round - 1))?;
        let Some((left, _)) = before else { return Ok(Record::default()) };
        let Step::Round(_) = stitch::next_step(left.triangles, facts.target, size, round) else {
            return Ok(Record::default());
        };
        let (triangles, began) = (left.triangles, Instant::now());
        self.progress.begin("repartition", 1, 1, triangles);
        let (layout, _) = kernel_side(&facts, self.config);
        let run = self.context(&job);
        let survivors = SurvivorPack::open(run.disk(), job.folder(), left, layout)?;
        let store = stitch::recut(&survivors, size, round, &run)?;
        let files = store.packs.iter().cloned().map(unit_file).collect();
        let report = StageReport {
            seconds: began.elapsed().as_secs_f64(),
            triangles_in: triangles,
            ..stage_report("repartition", &[], store.triangles)
        };
        job.record(&format!("recut {round}"), &(store, report))?;
        self.find_thresholds(round, &job)?;
        // The survivors before are known from the records of their units.
        let recorded = job.recorded();
        Ok(Record { outcomes: recorded, files, triangles, ..Record::default() })
    }

    /// One batch of the cells of a round.
    pub(super) fn batch(self, round: u32, task: &Task) -> Result<Record> {
        let job = self.guest(BTreeMap::new());
        let Some(Round { store, goal, options }) = Round::of(round, &job, self.config)? else {
            return Ok(Record::default());
        };
        let n_batches = task.frozen.units_of(&task.unit.phase).len();
        let tallies = &store.info().cells;
        let cells = simplify::batches(tallies, n_batches)[task.unit.index as usize].clone();
        if cells.is_empty() {
            return Ok(Record::default());
        }
        let triangles = tallies[cells.clone()].iter().map(|cell| cell.triangles).sum();
        let run = self.context(&job);
        self.progress.begin(if round == 0 { "simplify" } else { "round" }, 1, 1, triangles);
        let left = simplify::simplify_batch(&store, goal, &options, &run, cells)?;
        let files = left.packs.iter();
        let files = files.map(|f| UnitFile { pack: f.pack.clone(), bytes: f.pack_bytes }).collect();
        job.record(BATCH, &left)?;
        Ok(Record { outcomes: job.recorded(), files, triangles, ..Record::default() })
    }

    /// The outcomes of the rounds before this phase, as one process would have recorded them.
    pub(super) fn rounds(&self) -> Result<BTreeMap<String, serde_json::Value>> {
        let mut rounds = BTreeMap::new();
        for round in 0..self.earlier.len() as u32 {
            let batches = self.earlier.get(&phase_of_round(round)).map_or(&[][..], Vec::as_slice);
            if batches.iter().all(|(_, record)| record.outcomes.is_empty()) {
                continue;
            }
            let left = joined(batches)?;
            let name = if round == 0 { "simplify" } else { "round" };
            let report = stage_report(name, batches, left.triangles);
            let value = serde_json::to_value((left, report)).expect("plain data");
            rounds.insert(format!("round {round}"), value);
        }
        Ok(rounds)
    }
}

/// The survivors of all batches.
fn joined(batches: &[(Unit, Record)]) -> Result<SurvivorInfo> {
    let filled = batches.iter().filter(|(_, record)| !record.outcomes.is_empty());
    let parts: Vec<SurvivorInfo> =
        filled.map(|(_, record)| record.outcome(BATCH)).collect::<Result<_>>()?;
    Ok(SurvivorInfo::joined(parts))
}

/// A round that goes to a threshold that a pilot finds.
struct Round {
    store: CellStore,
    goal: Goal,
    options: kernel::Options,
}

impl Round {
    /// The round of this number, if its cells are there and it is of that kind.
    fn of(round: u32, job: &Job, config: &Config) -> Result<Option<Round>> {
        let facts: Facts = found(job, FACTS)?;
        let info = match round {
            0 => store_of(job)?,
            _ => match job.outcome::<(StoreInfo, StageReport)>(&format!("recut {round}"))? {
                Some((info, _)) => info,
                None => return Ok(None),
            },
        };
        let step = stitch::next_step(info.triangles, facts.target, config.cell_triangles, round);
        let Step::Round(goal) = step else { return Ok(None) };
        let (layout, mut options) = kernel_side(&facts, config);
        if let Some(weights) = job.outcome("channel lengths")? {
            options.weights = weights;
        }
        options.use_share_of_bound(stitch::bound_share(round), stitch::PATIENCE);
        let triangles = stitch::within_reach(goal, info.triangles, info.shared_vertices);
        let store = CellStore::open(job.disk(), job.folder(), info, layout)?;
        Ok(Some(Round { store, goal: Goal { round, triangles }, options }))
    }
}
