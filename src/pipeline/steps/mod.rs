//! The steps of one run of `simplify`, one method each; each says which one comes next.
//!
//! Opens what a stage needs from the outcome of the one before, removes what is not needed any more, and sums up what all of
//! them did. Decides nothing about meshes.

mod baked;
mod map;
mod partition;
mod report;
mod rounds;
mod write;

use super::kernel_side::{Facts, kernel_side};
use super::prepare::Prepared;
use super::run_report::{LevelReport, RunReport, TextureReport};
use super::sealed_stages::SealedStages;
use crate::bake::BakeReport;
use crate::config::{Config, Target};
use crate::error::Result;
use crate::io::TexturePlan;
use crate::kernel::{self, QualityCurve};
use crate::stages::components::ComponentSizes;
use crate::stages::partition::Partition;
use crate::stages::stitch::NextStep;
use crate::store::cells::{
    CellStore, Dropped, StoreInfo, SurvivorInfo, SurvivorPack, VertexLayout,
};
use crate::store::job::Job;
use crate::store::stage_context::StageContext;
use crate::system::pending_file::Seen;
use crate::system::progress::Progress;
pub(super) use report::faults;
use std::collections::BTreeMap;
use std::time::Instant;

/// A step of a run, with what it begins from.
#[allow(clippy::large_enum_variant)] // There is one at a time.
pub(super) enum RunStep {
    /// The input becomes cells on disk, without small components.
    Partition,
    /// Cells are simplified, each alone.
    Simplify(StoreInfo, NextStep),
    /// Survivors become new cells, whose seams cross the old ones.
    Stitch(SurvivorInfo, NextStep),
    /// Everything joins in memory and meets the target exactly.
    Finish(Left),
    /// A result gets its file; `from` is what the finish took in.
    Write { result: SurvivorInfo, from: Option<Left> },
    /// Nothing is left to be done.
    End(Ended),
}

/// End of a run.
pub(super) enum Ended {
    /// The output is there.
    Done(Box<RunReport>),
    /// `--until` ended the run.
    Early,
    /// The texture of the input left this many triangles, too many, where a new one can be made; nothing was written.
    ShortOfTarget(u64),
}

impl Ended {
    /// The report of a run that came to its end.
    pub(super) fn report(self) -> Option<RunReport> {
        match self {
            Ended::Done(report) => Some(*report),
            Ended::Early | Ended::ShortOfTarget(_) => None,
        }
    }
}

/// The mesh on disk before a step.
#[derive(Clone)]
pub(super) enum Left {
    /// Cells of the input.
    Cells(StoreInfo),
    /// Survivors of a round, or the result of the level before in a chain.
    Survivors(Box<SurvivorInfo>),
}

impl Left {
    /// Triangles of it.
    pub(super) fn triangles(&self) -> u64 {
        match self {
            Left::Cells(store) => store.triangles,
            Left::Survivors(survivors) => survivors.triangles,
        }
    }
}

/// A run between two steps. Stages are sealed in the job, timed and reported.
pub(super) struct SimplifyRun<'a> {
    stages: SealedStages<'a>,
    run: StageContext<'a>,
    /// The settings, every value final.
    config: &'a Config,
    prepared: Prepared,
    started: Instant,
    /// The file for the vertices on seams, as it was before the input was opened.
    seams: Option<Seen>,
    /// The outcome of the first step, once it is done.
    partition: Partition,
    component_sizes: Option<ComponentSizes>,
    /// Textures of the levels that are not written yet.
    textures: std::vec::IntoIter<TexturePlan>,
    texture_report: Option<TextureReport>,
    bake_report: Option<BakeReport>,
    /// Levels that are written.
    levels: Vec<LevelReport>,
    layout: VertexLayout,
    kernel: kernel::Options,
    /// Level of a chain that is at work, from 0, and the triangles wanted in it.
    level: usize,
    target: u64,
    /// Rounds before this level.
    rounds_before: u32,
    /// True if only a bound on the error ends the run.
    is_bound_only: bool,
    /// Triangles before the last round.
    before: u64,
    rounds_done: u32,
    shared_by_round: Vec<u64>,
    charts_vanished: u64,
    /// Faces and vertices that the first loading of cells dropped.
    dropped: Option<Dropped>,
    /// Survivors of all rounds and the finish, if a map is asked for.
    passed: Vec<SurvivorInfo>,
    /// Estimates from the probes of each round and of the finish.
    quality: QualityCurve,
    /// Statistics of the finish's fit.
    fit: Option<kernel::FitStatistics>,
    /// Largest distance from the input, as the bound saw it.
    reach: f64,
    /// Vertices on texture seams after the last round or the finish.
    seam_vertices: u64,
    /// Refused collapses, and changes of the topology, by kind, over all rounds and the finish.
    rejects: BTreeMap<String, u64>,
    changes: BTreeMap<String, u64>,
}

impl<'a> SimplifyRun<'a> {
    pub(super) fn new(
        job: &'a Job,
        mut prepared: Prepared,
        config: &'a Config,
        progress: &'a Progress,
    ) -> Self {
        let plan = &prepared.plan;
        let (layout, kernel) = kernel_side(&Facts::new(&prepared.source, plan.target), config);
        let run = StageContext {
            job,
            progress,
            threads: config.threads.get(),
            memory_bytes: plan.usable_memory_bytes,
            checkpoint_every: config.checkpoint_every,
        };
        let textures = std::mem::take(&mut prepared.textures);
        SimplifyRun {
            stages: SealedStages::new(run, plan.n_stages),
            run,
            config,
            started: Instant::now(),
            seams: prepared.seams.take(),
            partition: Partition::default(),
            component_sizes: None,
            texture_report: textures.first().map(TextureReport::of),
            textures: textures.into_iter(),
            bake_report: None,
            levels: Vec::new(),
            layout,
            kernel,
            level: 0,
            target: plan.target,
            rounds_before: 0,
            is_bound_only: matches!(config.target, Target::MaxError(_)),
            before: u64::MAX,
            rounds_done: 0,
            shared_by_round: Vec::new(),
            charts_vanished: 0,
            dropped: None,
            seam_vertices: 0,
            passed: Vec::new(),
            quality: QualityCurve::default(),
            fit: None,
            reach: 0.0,
            rejects: BTreeMap::new(),
            changes: BTreeMap::new(),
            prepared,
        }
    }

    fn store(&self, info: StoreInfo) -> Result<CellStore> {
        CellStore::open(self.run.disk(), self.run.job.folder(), info, self.layout.clone())
    }

    fn survivors(&self, info: SurvivorInfo) -> Result<SurvivorPack> {
        SurvivorPack::open(self.run.disk(), self.run.job.folder(), info, self.layout.clone())
    }

    fn count(&mut self, done: &SurvivorInfo) {
        let triangles = done.triangles;
        let done = &done.statistics;
        self.dropped.get_or_insert(done.dropped);
        self.charts_vanished += done.charts_vanished;
        self.seam_vertices = done.seam_vertices;
        self.fit = done.fit;
        self.reach = done.reach;
        self.quality.add_round(&done.curve, done.quality, triangles);
        // What is left is what the last round or the finish has left.
        self.changes.retain(|name, _| !name.contains("_left"));
        for (sums, counts) in
            [(&mut self.rejects, &done.rejects), (&mut self.changes, &done.changes)]
        {
            for (name, n) in counts {
                *sums.entry(name.clone()).or_default() += n;
            }
        }
    }
}
