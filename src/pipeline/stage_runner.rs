//! The stages of one run of `simplify`, one method each.
//!
//! `pipeline` says in which order. Opens what a stage needs from the outcome of the one before, removes what
//! is not needed any more, and sums up what all of them did. Decides nothing about meshes.

mod baked;
mod report;

use super::concluded::WRITING;
use super::kernel_side::{Facts, kernel_side};
use super::quality::QualityCurve;
use super::sealed_stages::SealedStages;
use crate::config::{Config, Target};
use crate::error::{Error, Result};
use crate::io::ply::{MeshSource, OutputHeader, Place};
use crate::io::{OutputFormat, OutputKind, TexturePlan};
use crate::kernel;
use crate::pipeline::fit;
use crate::pipeline::plan::Plan;
use crate::pipeline::run_report::StageReport;
use crate::stages::components::{self, Components};
use crate::stages::partition::{self, Partition};
use crate::stages::simplify::{self, Goal};
use crate::stages::stitch::{self, Parts, Recording, Step};
use crate::stages::write::{self, Form, Written};
use crate::store::cells::{
    CellStore, Dropped, StoreInfo, SurvivorFile, SurvivorInfo, SurvivorPack, Survivors,
    VertexLayout,
};
use crate::store::job::Job;
use crate::store::job::fingerprint::unchanged;
use crate::store::stage_context::StageContext;
use crate::system::parallel::guarded;
use crate::system::pending_file;
use crate::system::progress::Progress;
use std::collections::BTreeMap;
use std::path::Path;
use std::time::Instant;

/// The mesh on disk before a step.
#[derive(Clone)]
pub(super) enum Left {
    /// Cells of the input.
    Cells(StoreInfo),
    /// Survivors of a round, or the result of the level before in a chain.
    Survivors(SurvivorInfo),
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

/// The stages of one run: each is sealed in the job, timed and reported.
pub(super) struct Stages<'a> {
    stages: SealedStages<'a>,
    pub(super) run: StageContext<'a>,
    config: &'a Config,
    layout: VertexLayout,
    kernel: kernel::Options,
    /// Level of a chain that is at work, from 0, and the triangles wanted in it.
    level: usize,
    pub(super) target: u64,
    /// Rounds before this level.
    rounds_before: u32,
    /// True if only a bound on the error ends the run.
    is_bound_only: bool,
    /// Triangles before the last round.
    before: u64,
    pub(super) rounds_done: u32,
    shared_by_round: Vec<u64>,
    charts_vanished: u64,
    /// Faces and vertices that the first loading of cells dropped.
    pub(super) dropped: Option<Dropped>,
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
    input_bytes: u64,
}

impl<'a> Stages<'a> {
    pub(super) fn new(
        config: &'a Config,
        plan: &Plan,
        job: &'a Job,
        progress: &'a Progress,
        source: &MeshSource,
    ) -> Self {
        let (layout, kernel) = kernel_side(&Facts::new(source, plan), config);
        let run = StageContext {
            job,
            progress,
            threads: config.threads.get(),
            memory_bytes: plan.usable_memory_bytes,
            checkpoint_every: config.checkpoint_every,
        };
        Stages {
            stages: SealedStages::new(run, plan.n_stages),
            run,
            config,
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
            quality: QualityCurve::default(),
            fit: None,
            reach: 0.0,
            rejects: BTreeMap::new(),
            changes: BTreeMap::new(),
            input_bytes: source.file_bytes(),
        }
    }

    /// Goes on to a level of a chain, which begins from what the level before has left.
    pub(super) fn begin_level(&mut self, level: usize, plan: &Plan) {
        let Some(&target) = level.checked_sub(1).and_then(|k| plan.coarser.get(k)) else { return };
        (self.level, self.target) = (level, target);
        (self.rounds_before, self.before) = (self.rounds_done, u64::MAX);
        fit::decide(&mut self.kernel, self.config, plan.triangles_in, target);
    }

    pub(super) fn partition(
        &mut self,
        source: &MeshSource,
        marks: &BTreeMap<String, String>,
    ) -> Result<Partition> {
        let config = self.config;
        let (size, n) = (self.config.cell_triangles, source.n_triangles());
        let partition = self.stages.stage(
            ("partition", "partition"),
            n,
            |p: &Partition| p.store.triangles,
            |run| {
                // Nothing reads the input after this.
                let outcome = guarded(|| partition::partition(source, size, run));
                unchanged(&config.input, marks, outcome)
            },
        )?;
        if let Some(report) = self.stages.reports.last_mut() {
            report.bytes_read += self.input_bytes;
        }
        self.shared_by_round.push(partition.store.shared_vertices);
        Ok(partition)
    }

    /// Finds the components and leaves out what is too small, if that was asked for.
    pub(super) fn components(&mut self, partition: &Partition) -> Result<Option<Components>> {
        let Some(min) = self.config.min_component else { return Ok(None) };
        let least = components::Least::of(min, partition.bounds.diagonal());
        let (info, layout) = (partition.store.clone(), self.layout.clone());
        let found = self.stages.stage(
            ("components", "components"),
            partition.store.triangles,
            |c: &Components| c.store.triangles,
            |run| {
                let store = CellStore::open(run.disk(), run.job.folder(), info, layout)?;
                components::find(&store, least, run)
            },
        )?;
        components::tidy_up(&self.run)?;
        let sizes = &found.sizes;
        self.run.progress.note(format!(
            "components {}, {} are dropped; of fewer triangles than {}",
            sizes.found,
            sizes.dropped,
            components::below_list(sizes)
        ));
        Ok(Some(found))
    }

    /// Finds what channels with a weight count for; once, and then the same for every round.
    pub(super) fn weigh(&mut self, info: &StoreInfo) -> Result<()> {
        if self.layout.n_weighted() == 0 {
            return Ok(());
        }
        let (run, target) = (self.run, self.target);
        self.kernel.weights = run.job.sealed("channel lengths", || {
            simplify::channel_lengths(&self.store(info.clone())?, target, &run)
        })?;
        Ok(())
    }

    pub(super) fn next_step(&self, triangles_now: u64) -> Step {
        let cell = self.config.cell_triangles;
        let rounds = self.rounds_done - self.rounds_before;
        if self.is_bound_only {
            return stitch::next_step_within_bound(triangles_now, self.before, cell, rounds);
        }
        let step = stitch::next_step(triangles_now, self.target, cell, rounds);
        // A bound may hold where the target does not.
        let is_stuck = triangles_now as f64 > 0.97 * self.before as f64;
        match step {
            Step::Round(_) | Step::ExactRound if self.kernel.bound.is_some() && is_stuck => {
                Step::Done
            }
            step => step,
        }
    }

    pub(super) fn store(&self, info: StoreInfo) -> Result<CellStore> {
        CellStore::open(self.run.disk(), self.run.job.folder(), info, self.layout.clone())
    }

    fn survivors(&self, info: SurvivorInfo) -> Result<SurvivorPack> {
        SurvivorPack::open(self.run.disk(), self.run.job.folder(), info, self.layout.clone())
    }

    /// True if the input has an area; found once, since stores are removed on the way.
    pub(super) fn has_area(&self, info: &StoreInfo) -> Result<bool> {
        let run = self.run;
        run.job.sealed("has area", || self.store(info.clone())?.has_area(run.progress))
    }

    /// One round over all cells; the store it came from is removed.
    pub(super) fn simplify(&mut self, info: StoreInfo, step: Step) -> Result<SurvivorInfo> {
        let round = self.rounds_done;
        let (goal, is_exact) = match step {
            Step::Round(goal) => {
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
                match is_exact {
                    _ if is_bound_only => {
                        simplify::simplify_cells_within_bound(&store, goal, &options, run)
                    }
                    true => simplify::simplify_cells_exactly(&store, goal, &options, run),
                    false => simplify::simplify_cells(&store, goal, &options, run),
                }
            },
        )?;
        packs.iter().try_for_each(|file| self.run.job.discard(&file.pack))?;
        self.rounds_done += 1;
        self.count(&left);
        Ok(left)
    }

    /// Cuts survivors into new cells; their pack is removed.
    pub(super) fn recut(&mut self, info: SurvivorInfo) -> Result<StoreInfo> {
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
        Ok(store)
    }

    /// Joins everything in memory and meets the target exactly; what it takes in stays.
    pub(super) fn finish(&mut self, source: &MeshSource, left: &Left) -> Result<SurvivorInfo> {
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
                match left {
                    Left::Survivors(left) => {
                        let left = SurvivorPack::open(disk, folder, left.clone(), layout.clone())?;
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
        Ok(result)
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

    /// True if what the last round has left stays for another attempt.
    fn is_kept(&self) -> bool {
        self.config.trial_of.is_some() && self.rounds_done <= 1
    }

    fn discard(&self, packs: &[SurvivorFile]) -> Result<()> {
        packs.iter().try_for_each(|file| self.run.job.discard(&file.pack))
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
        for (sums, counts) in
            [(&mut self.rejects, &done.rejects), (&mut self.changes, &done.changes)]
        {
            for (name, n) in counts {
                *sums.entry(name.clone()).or_default() += n;
            }
        }
    }

    /// Header and form of a file of survivors of an input.
    fn form(&self, source: &MeshSource, format: OutputFormat) -> (OutputHeader, Form) {
        let header = OutputHeader {
            comments: source.plain_comments(),
            obj_infos: source.obj_infos().to_vec(),
            ..OutputHeader::new(source.schema().clone(), 0, 0)
        };
        let form = Form {
            format,
            faces: source.carried().cloned().unwrap_or_default(),
            normals: self.config.attributes.normals,
            has_reach: self.config.error_field,
        };
        (header, form)
    }

    pub(super) fn write(
        &mut self,
        source: &MeshSource,
        textures: Option<TexturePlan>,
        result: &SurvivorInfo,
    ) -> Result<Written> {
        let written_key = format!("written {}", self.level);
        let path = self.output().to_path_buf();
        if let Some(written) = self.run.job.outcome::<Written>(&written_key)? {
            require_written(&path, written, self.run.job.folder())?;
            return Ok(written);
        }
        let settings = self.config.settings_of_level(self.level).into_iter();
        let kind = Some(self.kind()?);
        let (header, form) = self.form(source, OutputFormat { kind, ..self.config.format });
        let header = OutputHeader {
            settings: settings.map(|(k, v)| format!("{k}={v}")).collect::<Vec<_>>().join(" "),
            textures,
            sort_memory_bytes: write::sort_memory_bytes(&self.run),
            ..header
        };
        let pack = self.survivors(result.clone())?;
        let (disk, replace) = (self.run.disk().clone(), self.config.force);
        let place = Place { path, disk, replace };
        let run = self.run;
        let (written, ()) = self.as_write_stage(result.triangles, |_| {
            Ok((write::write(&pack, place, header, form, &run)?, ()))
        })?;
        self.adopt_progressive()?;
        if self.level < self.config.coarser.len() {
            // The next level takes the pack away that this file came from.
            self.run.job.record(&written_key, &written)?;
        }
        Ok(written)
    }

    /// Runs `write`, which makes an output of `triangles` triangles, as a stage that is noted when it begins and is
    /// never taken from the manifest: the output may have been moved away since.
    fn as_write_stage<T>(
        &mut self,
        triangles: u64,
        write: impl FnOnce(&Self) -> Result<(Written, T)>,
    ) -> Result<(Written, T)> {
        if self.run.job.outcome::<()>(WRITING)?.is_none() {
            self.run.job.record(WRITING, &())?;
        }
        self.stages.begin("write", triangles);
        let (read, start) = (self.run.disk().bytes_read(), Instant::now());
        let (written, made) = write(self)?;
        self.stages.reports.push(StageReport {
            name: "write".to_owned(),
            part: "write".to_owned(),
            seconds: start.elapsed().as_secs_f64(),
            triangles_in: triangles,
            triangles_out: written.triangles,
            bytes_read: self.run.disk().bytes_read() - read,
            bytes_written: written.bytes,
            peak_memory_bytes: crate::system::memory::peak_bytes(),
            peak_temp_bytes: self.run.disk().peak_bytes(),
        });
        Ok((written, made))
    }

    /// Gives the progressive mesh its name, unless an earlier run that was cut off has.
    fn adopt_progressive(&self) -> Result<()> {
        let Some(progressive) = &self.config.progressive else { return Ok(()) };
        let made = self.run.job.path(stitch::PROGRESSIVE);
        let path = progressive.path.clone();
        if !made.exists() && path.exists() {
            return Ok(());
        }
        let (disk, replace) = (self.run.disk().clone(), self.config.force);
        pending_file::adopt(&made, Place { path, disk, replace })
    }

    /// Output of the level at work.
    pub(super) fn output(&self) -> &Path {
        let coarser = self.level.checked_sub(1).map(|k| &self.config.coarser[k].output);
        coarser.unwrap_or(&self.config.output)
    }

    fn kind(&self) -> Result<OutputKind> {
        self.config.format.kind.map_or_else(|| OutputKind::of(&self.config.output), Ok)
    }
}

/// Refuses to go on behind a level whose file is gone: what it was made from is gone, too.
fn require_written(path: &Path, written: Written, job_folder: &Path) -> Result<()> {
    let found = std::fs::metadata(path).ok().map(|meta| meta.len());
    if found == Some(written.bytes) {
        return Ok(());
    }
    let path = path.display();
    let what = match found {
        None => format!("its first part wrote {path}, which is gone"),
        Some(_) => format!("its first part wrote {path}, which has changed since"),
    };
    let what = format!("{what}; put the file back, or start over with --restart");
    Err(Error::StateMismatch { path: job_folder.into(), what })
}
