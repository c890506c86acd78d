//! The phases of rounds: new cells (but for the first round), a pilot over a sample of them, a trial of all of them where a
//! total is to be met exactly, and batches of them that are simplified.
//!
//! Every process that needs the levels of a round finds them from the records of its pilot and trial: the same on all
//! machines. Where counts fall other than planned, the phases of a round have nothing to do, and `finish` goes on from there.

use super::kind::Kind;
use super::phases::{FACTS, PhaseRun, found, stage_report, store_of, unit_file};
use super::task::Task;
use crate::config::Config;
use crate::error::Result;
use crate::kernel;
use crate::pipeline::kernel_side::{Facts, kernel_side};
use crate::pipeline::run_report::StageReport;
use crate::stages::partition::Partition;
use crate::stages::simplify::{self, CellRun, ExactLevels, Goal, Levels, PilotPart};
use crate::stages::stitch::{self, NextStep};
use crate::store::cells::{CellStore, StoreInfo, SurvivorInfo, SurvivorPack};
use crate::store::job::Job;
use crate::store::job::units::{Record, Unit, UnitFile};
use crate::store::stage_context::StageContext;
use serde::de::DeserializeOwned;
use std::collections::BTreeMap;
use std::ops::Range;
use std::time::Instant;

/// Names of the outcomes of a unit of a pilot, of a trial, of a batch.
const PILOT: &str = "pilot";
const TRIAL: &str = "trial";
const BATCH: &str = "batch";

impl PhaseRun<'_> {
    /// Some cells of a round's sample on their way down.
    pub(super) fn pilot(self, round: u32, task: &Task) -> Result<Record> {
        let job = self.guest(BTreeMap::new());
        let Some(at) = Round::of(round, &job, self.config)? else { return Ok(Record::default()) };
        self.progress.begin("pilot", 1, 1, 0);
        let part = (task.unit.index as usize, task.frozen.units_of(&task.unit.phase).len());
        let part = simplify::pilot_part(&at.cell_run(&self.context(&job)), part)?;
        job.record(PILOT, &part)?;
        Ok(Record { outcomes: job.recorded(), ..Record::default() })
    }

    /// A trial of one batch of the cells of an exact round.
    pub(super) fn trial(self, round: u32, task: &Task) -> Result<Record> {
        let job = self.guest(BTreeMap::new());
        let at = Round::of(round, &job, self.config)?.filter(|at| at.is_exact);
        let Some(at) = at else { return Ok(Record::default()) };
        let cells = at.batch(task);
        let thresholds = self.thresholds(&at)?;
        let run = self.context(&job);
        self.progress.begin("trial", 1, 1, at.triangles(&cells));
        let counts = simplify::trial(&at.cell_run(&run), &thresholds, cells)?;
        job.record(TRIAL, &counts)?;
        Ok(Record { outcomes: job.recorded(), ..Record::default() })
    }

    /// New cells for a later round.
    pub(super) fn recut(self, round: u32) -> Result<Record> {
        let job = self.guest(self.rounds()?);
        let facts: Facts = found(&job, FACTS)?;
        let size = self.config.cell_triangles;
        let before: Option<(SurvivorInfo, StageReport)> =
            job.outcome(&format!("round {}", round - 1))?;
        let Some((left, _)) = before else { return Ok(Record::default()) };
        match stitch::next_step(left.triangles, facts.target, size, round) {
            NextStep::Round(_) | NextStep::ExactRound => {}
            NextStep::Finish | NextStep::Done => return Ok(Record::default()),
        }
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
        // The survivors before are known from the records of their units.
        Ok(Record { outcomes: job.recorded(), files, triangles, ..Record::default() })
    }

    /// One batch of the cells of a round.
    pub(super) fn batch(self, round: u32, task: &Task) -> Result<Record> {
        let job = self.guest(BTreeMap::new());
        let Some(at) = Round::of(round, &job, self.config)? else { return Ok(Record::default()) };
        let Some(levels) = self.levels(&at)? else { return Ok(Record::default()) };
        let cells = at.batch(task);
        if cells.is_empty() {
            return Ok(Record::default());
        }
        let (triangles, run) = (at.triangles(&cells), self.context(&job));
        self.progress.begin(if round == 0 { "simplify" } else { "round" }, 1, 1, triangles);
        let left = simplify::simplify_batch(&at.cell_run(&run), &levels, cells)?;
        let files = left.packs.iter();
        let files = files.map(|f| UnitFile { pack: f.pack.clone(), bytes: f.pack_bytes }).collect();
        job.record(BATCH, &left)?;
        Ok(Record { outcomes: job.recorded(), files, triangles, ..Record::default() })
    }

    /// The levels of a round; `None` if it needs a trial that was not planned.
    fn levels(&self, at: &Round) -> Result<Option<Levels>> {
        let thresholds = self.thresholds(at)?;
        if !at.is_exact {
            return Ok(Some(Levels::Threshold(thresholds)));
        }
        let trial = Kind::Trial.of_round(at.goal.round);
        if !self.earlier.contains_key(&trial) {
            return Ok(None);
        }
        let counts: Vec<Vec<Vec<u64>>> = self.outcomes(&trial, TRIAL)?;
        let counts = counts.concat();
        let levels = ExactLevels::choose(&thresholds, &counts, &at.store, at.goal);
        Ok(Some(Levels::Exact(levels)))
    }

    fn thresholds(&self, at: &Round) -> Result<simplify::Thresholds> {
        let parts: Vec<PilotPart> = self.outcomes(&Kind::Pilot.of_round(at.goal.round), PILOT)?;
        simplify::thresholds_of(&at.store, at.goal, parts)
    }

    /// An outcome of all units of a phase that have done anything, in their order.
    fn outcomes<T: DeserializeOwned>(&self, phase: &str, name: &str) -> Result<Vec<T>> {
        let units = self.earlier.get(phase).map_or(&[][..], Vec::as_slice);
        filled(units).map(|record| record.outcome(name)).collect()
    }

    /// The outcomes of the rounds before this phase, as one process would have recorded them.
    pub(super) fn rounds(&self) -> Result<BTreeMap<String, serde_json::Value>> {
        let mut rounds = BTreeMap::new();
        for round in 0..self.earlier.len() as u32 {
            let phase = Kind::Batch.of_round(round);
            let batches = self.earlier.get(&phase).map_or(&[][..], Vec::as_slice);
            if filled(batches).next().is_none() {
                continue;
            }
            let left = SurvivorInfo::joined(self.outcomes::<SurvivorInfo>(&phase, BATCH)?);
            let name = if round == 0 { "simplify" } else { "round" };
            let report = stage_report(name, batches, left.triangles);
            let value = serde_json::to_value((left, report)).expect("plain data");
            rounds.insert(format!("round {round}"), value);
        }
        Ok(rounds)
    }
}

/// The records of units that had something to do.
fn filled(units: &[(Unit, Record)]) -> impl Iterator<Item = &Record> {
    units.iter().map(|(_, record)| record).filter(|record| !record.outcomes.is_empty())
}

/// A round to levels that a pilot finds.
struct Round {
    store: CellStore,
    goal: Goal,
    options: kernel::Options,
    /// True if a trial of every cell comes between.
    is_exact: bool,
}

impl Round {
    /// The round of this number, if its cells are there and there is such a round.
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
        let (triangles, is_exact) = match step {
            NextStep::Round(goal) => {
                (stitch::within_reach(goal, info.triangles, info.shared_vertices), false)
            }
            NextStep::ExactRound => (facts.target, true),
            NextStep::Finish | NextStep::Done => return Ok(None),
        };
        let (layout, mut options) = kernel_side(&facts, config);
        if let Some(weights) = job.outcome("channel lengths")? {
            options.weights = weights;
        }
        if let Some(size) = config.close {
            let (partition, _) = found::<(Partition, StageReport)>(job, "partition")?;
            options.close = size.length(partition.bounds.diagonal());
        }
        options.use_share_of_bound(stitch::bound_share(round), stitch::PATIENCE);
        let store = CellStore::open(job.disk(), job.folder(), info, layout)?;
        Ok(Some(Round { store, goal: Goal { round, triangles }, options, is_exact }))
    }

    fn cell_run<'a>(&'a self, context: &'a StageContext<'a>) -> CellRun<'a> {
        let Round { store, goal, options, .. } = self;
        CellRun { store, goal: *goal, options, beside: None, context }
    }

    /// The cells of a unit.
    fn batch(&self, task: &Task) -> Range<usize> {
        let n_batches = task.frozen.units_of(&task.unit.phase).len();
        let batches = simplify::batches(&self.store.info().cells, n_batches);
        batches[task.unit.index as usize].clone()
    }

    fn triangles(&self, cells: &Range<usize>) -> u64 {
        self.store.info().cells[cells.clone()].iter().map(|cell| cell.triangles).sum()
    }
}
