//! The steps from cells to a result: rounds over cells, new cells between them, the finish.

use super::{Ended, Left, RunStep, SimplifyRun};
use crate::config::Until;
use crate::error::Result;
use crate::pipeline::fit;
use crate::stages::simplify::{self, CellRun, Goal};
use crate::stages::stitch::{self, NextStep, Parts, Recording};
use crate::store::cells::{
    CellStore, StoreInfo, SurvivorFile, SurvivorInfo, SurvivorPack, Survivors,
};

impl SimplifyRun<'_> {
    /// Begins a level of a chain from what the level before has left; the first one from the cells of the input.
    pub(super) fn begin_level(&mut self, level: usize, left: Left) -> Result<RunStep> {
        let plan = &self.prepared.plan;
        if let Some(&target) = level.checked_sub(1).and_then(|k| plan.coarser.get(k)) {
            (self.level, self.target) = (level, target);
            (self.rounds_before, self.before) = (self.rounds_done, u64::MAX);
            fit::decide(&mut self.kernel, self.config, plan.triangles_in, target);
        }
        let step = self.next(left)?;
        if let RunStep::Simplify(store, _) = &step {
            self.weigh(store)?;
        }
        // One finish takes in all cells: nothing is simplified before it.
        let is_alone = matches!(step, RunStep::Finish(_)) && self.rounds_done == 0;
        Ok(match self.config.job.until {
            Some(Until::Cells) => RunStep::End(Ended::Early),
            Some(Until::Simplify) if is_alone => RunStep::End(Ended::Early),
            _ => step,
        })
    }

    /// The step that comes next on the way to the target.
    fn next(&self, left: Left) -> Result<RunStep> {
        let next = self.next_round(left.triangles());
        Ok(match (next, left) {
            (NextStep::Finish, left) => RunStep::Finish(left),
            (NextStep::Done, Left::Survivors(result)) => {
                RunStep::Write { result: *result, from: None }
            }
            (NextStep::Done, Left::Cells(_)) => unreachable!("without a finish there was a round"),
            (_, Left::Cells(cells)) => RunStep::Simplify(cells, next),
            (_, Left::Survivors(survivors)) => RunStep::Stitch(*survivors, next),
        })
    }

    /// Finds what channels with a weight count for; once, and then the same for every round.
    fn weigh(&mut self, info: &StoreInfo) -> Result<()> {
        if self.layout.n_weighted() == 0 {
            return Ok(());
        }
        let (run, target) = (self.run, self.target);
        self.kernel.weights = run.job.sealed("channel lengths", || {
            simplify::channel_lengths(&self.store(info.clone())?, target, &run)
        })?;
        Ok(())
    }

    fn next_round(&self, triangles_now: u64) -> NextStep {
        let cell = self.config.cell_triangles;
        let rounds = self.rounds_done - self.rounds_before;
        if self.is_bound_only {
            return stitch::next_step_within_bound(triangles_now, self.before, cell, rounds);
        }
        let step = stitch::next_step(triangles_now, self.target, cell, rounds);
        // A bound may hold where the target does not.
        let is_stuck = triangles_now as f64 > 0.97 * self.before as f64;
        match step {
            NextStep::Round(_) | NextStep::ExactRound
                if self.kernel.bound.is_some() && is_stuck =>
            {
                NextStep::Done
            }
            step => step,
        }
    }

    /// One round over all cells; the store it came from is removed.
    pub(in crate::pipeline) fn simplify(
        &mut self,
        info: StoreInfo,
        next: NextStep,
    ) -> Result<RunStep> {
        let round = self.rounds_done;
        let (goal, is_exact) = match next {
            NextStep::Round(goal) => {
                (stitch::within_reach(goal, info.triangles, info.shared_vertices), false)
            }
            _ => (self.target, true),
        };
        let goal = Goal { round, triangles: goal };
        let is_bound_only = self.is_bound_only;
        self.before = info.triangles;
        let name = if round == 0 { "simplify" } else { "round" };
        let mut options = self.kernel.clone();
        options.use_share_of_bound(stitch::bound_share(round), stitch::PATIENCE);
        let (layout, n) = (self.layout.clone(), info.triangles);
        let packs = info.packs.clone();
        let left = self.stages.stage(
            (&format!("round {round}"), name),
            n,
            |s: &SurvivorInfo| s.triangles,
            |run| {
                let store = CellStore::open(run.disk(), run.job.folder(), info, layout)?;
                let options = &options;
                let round = CellRun { store: &store, goal, options, beside: None, context: run };
                match is_exact {
                    _ if is_bound_only => simplify::simplify_cells_within_bound(&round),
                    true => simplify::simplify_cells_exactly(&round),
                    false => simplify::simplify_cells(&round),
                }
            },
        )?;
        packs.iter().try_for_each(|file| self.run.job.discard(&file.pack))?;
        self.rounds_done += 1;
        self.count(&left);
        self.pass(&left);
        if self.config.job.until == Some(Until::Simplify) && self.rounds_done == 1 {
            return Ok(RunStep::End(Ended::Early));
        }
        self.next(Left::Survivors(Box::new(left)))
    }

    /// Cuts survivors into new cells; their pack is removed.
    pub(in crate::pipeline) fn stitch(
        &mut self,
        info: SurvivorInfo,
        next: NextStep,
    ) -> Result<RunStep> {
        let (round, size, n) = (self.rounds_done, self.config.cell_triangles, info.triangles);
        let packs = info.packs.clone();
        let layout = self.layout.clone();
        let store = self.stages.stage(
            (&format!("recut {round}"), "repartition"),
            n,
            |s: &StoreInfo| s.triangles,
            |run| {
                let survivors = SurvivorPack::open(run.disk(), run.job.folder(), info, layout)?;
                stitch::recut(&survivors, size, round, run)
            },
        )?;
        if !self.is_kept() {
            self.discard(&packs)?;
        }
        self.shared_by_round.push(store.shared_vertices);
        Ok(RunStep::Simplify(store, next))
    }

    /// Joins everything in memory and meets the target exactly; what it takes in stays.
    pub(in crate::pipeline) fn finish(&mut self, left: Left) -> Result<RunStep> {
        let source = &self.prepared.source;
        let (comments, settings) = (source.plain_comments(), self.config.settings());
        let recording = self.config.progressive.as_ref().map(|progressive| Recording {
            comments: &comments,
            obj_infos: source.obj_infos(),
            settings: &settings,
            normals: self.config.attributes.normals,
            bits: progressive.bits,
        });
        let target = if self.is_bound_only { 0 } else { self.target };
        let options = self.kernel.clone();
        let n = left.triangles();
        let layout = self.layout.clone();
        // A level's result is the next one's source.
        let (key, name) = match self.level {
            0 => ("finish".to_owned(), "result.survivors".to_owned()),
            level => (format!("finish {level}"), format!("result-{level}.survivors")),
        };
        let result = self.stages.stage(
            (&key, "finish"),
            n,
            |s: &SurvivorInfo| s.triangles,
            |run| {
                let (disk, folder) = (run.disk(), run.job.folder());
                match &left {
                    Left::Survivors(left) => {
                        let left =
                            SurvivorPack::open(disk, folder, (**left).clone(), layout.clone())?;
                        let parts = Parts {
                            cells: &left.info().cells,
                            layout: &layout,
                            load: &|c| left.load(c),
                        };
                        stitch::finish(parts, &name, target, &options, recording.as_ref(), run)
                    }
                    Left::Cells(info) => {
                        let store = CellStore::open(disk, folder, info.clone(), layout.clone())?;
                        let load = |cell| {
                            store.load_tidy(cell).map(|cell| Survivors::all_of(cell, &layout))
                        };
                        let parts =
                            Parts { cells: &store.info().cells, layout: &layout, load: &load };
                        stitch::finish(parts, &name, target, &options, recording.as_ref(), run)
                    }
                }
            },
        )?;
        self.count(&result);
        self.pass(&result);
        Ok(RunStep::Write { result, from: Some(left) })
    }

    /// Removes what a finish took in.
    pub(super) fn remove(&self, left: &Left) -> Result<()> {
        match left {
            _ if self.is_kept() => Ok(()),
            Left::Cells(store) => {
                store.packs.iter().try_for_each(|file| self.run.job.discard(&file.pack))
            }
            Left::Survivors(survivors) => self.discard(&survivors.packs),
        }
    }

    /// True if what a round has left stays for another attempt.
    fn is_kept(&self) -> bool {
        self.config.trial_of.is_some()
    }

    fn discard(&self, packs: &[SurvivorFile]) -> Result<()> {
        // A map is composed of what all rounds have left.
        match self.config.map {
            Some(_) => Ok(()),
            None => packs.iter().try_for_each(|file| self.run.job.discard(&file.pack)),
        }
    }
}
