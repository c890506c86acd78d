//! The program: from a scan larger than memory to one small mesh.
//!
//! Partition the input into cells on disk, simplify the cells in parallel, stitch until no seam is left,
//! write. Every stage is sealed in the job folder before the next one begins, so the same command continues
//! wherever an earlier run stopped. Only this file names two stages.

use crate::cells::{
    CellStore, Dropped, StoreInfo, SurvivorInfo, SurvivorPack, Survivors, VertexLayout,
};
use crate::config::{Config, Target, Until};
use crate::disk::Disk;
use crate::error::{Error, Result};
use crate::formats::{
    OutputFormat, OutputKind, StageOptions, SurveyOptions, faces_to_vertices, survey_faces,
};
use crate::identity::{input_marks, unchanged};
use crate::job::{self, Identity, Job};
use crate::kernel;
use crate::parallel::guarded;
use crate::partition::{self, Partition};
use crate::plan::{Plan, check_split, folder_of};
use crate::ply::{MeshSource, OutputHeader, Place, ReadOptions};
use crate::progress::Progress;
use crate::run::Run;
use crate::schema::Meaning;
use crate::simplify::{self, Goal};
use crate::stitch::{self, Parts, Step};
use crate::summary::{FaceReport, InputReport, OutputReport, RunReport, SeamReport, StageReport};
use crate::verify;
use crate::within;
use crate::write::{self, Form, Written};
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::collections::BTreeMap;
use std::time::Instant;
use xxhash_rust::xxh3::xxh3_64;

/// An input that has been opened and planned for; nothing has been written yet.
#[derive(Debug)]
pub struct Prepared {
    /// The open input.
    pub source: MeshSource,
    /// What the run will do and need.
    pub plan: Plan,
    /// By what the input is known again; taken before it was opened.
    pub marks: BTreeMap<String, String>,
}

/// Opens the input and plans the run. What is no plain PLY file is first unpacked beside the output.
pub fn prepare(config: &Config) -> Result<Prepared> {
    refuse_to_overwrite(config)?;
    if config.verify {
        verify::refuse_unreadable(config)?;
    }
    let marks = input_marks(&config.input)?;
    let read = ReadOptions { skip_bad: config.skip_bad, ..ReadOptions::default() };
    let mut stage = StageOptions { read, ..StageOptions::new(folder_of(&config.job_folder)) };
    stage.memory_bytes = stage.memory_bytes.min(config.memory_bytes / 2);
    let source = MeshSource::open_staged(&config.input, &stage).and_then(|source| {
        let survey = SurveyOptions {
            drop_texture: config.drop_texture,
            drop_properties: config.drop_faces,
            labels: &config.attributes.labels,
        };
        let carry = survey_faces(&source, &survey)?;
        if !config.drop_texture && !carry.texture {
            source.require_no_texture()?;
        }
        check_split(&source, &carry, config)?;
        faces_to_vertices(source, carry, &stage)
    });
    let source = unchanged(&config.input, &marks, source)?;
    let codec = source.schema().kernel_codec(&config.attributes.labels);
    config.attributes.weights.check(&codec.meanings(source.schema()))?;
    let plan = Plan::new(&source, config)?;
    plan.check_disk(config)?;
    Ok(Prepared { source, plan, marks })
}

/// Simplifies `config.input` into `config.output`; `None` when `--until` ended the run early.
pub fn simplify(
    prepared: Prepared,
    config: &Config,
    progress: &Progress,
) -> Result<Option<RunReport>> {
    if let Target::MaxError(bound) = config.target {
        return within::simplify(bound, prepared, config, progress);
    }
    simplify_on(&Disk::default(), prepared, config, progress)
}

/// The same through a given disk, so that a test can make it fail. A panic on the way becomes an error.
pub fn simplify_on(
    disk: &Disk,
    prepared: Prepared,
    config: &Config,
    progress: &Progress,
) -> Result<Option<RunReport>> {
    progress.set_resumable(true);
    let outcome = guarded(|| run_stages(disk, prepared, config, progress));
    progress.set_resumable(false);
    outcome
}

fn run_stages(
    disk: &Disk,
    prepared: Prepared,
    config: &Config,
    progress: &Progress,
) -> Result<Option<RunReport>> {
    let started = Instant::now();
    let Prepared { source, plan, marks } = prepared;
    let identity = identity(&source, &marks, config);
    let job = Job::open(&config.job_folder, disk, &identity, config.restart)?;
    let mut stages = Stages::new(config, &plan, &job, progress, &source);

    let partition = stages.partition(&source, &marks)?;
    if config.until == Some(Until::Partition) {
        return Ok(None);
    }
    let mut store = partition.store.clone();
    if let Some(path) = &config.seams {
        crate::seams::write(&stages.store(store.clone())?, path, &stages.run)?;
    }
    let mut step = stages.next_step(partition.store.triangles);
    if step != Step::Finish {
        stages.weigh(&store)?;
    }
    let mut survivors = None;
    let mut dropped = None;
    while let Step::Round(_) | Step::ExactRound = step {
        if let Some(earlier) = survivors.take() {
            store = stages.recut(earlier)?;
        }
        let left = stages.simplify(store.clone(), step)?;
        if config.until == Some(Until::Simplify) && stages.rounds_done == 1 {
            return Ok(None);
        }
        step = stages.next_step(left.triangles);
        dropped.get_or_insert(left.statistics.dropped);
        survivors = Some(left);
    }
    let result = match (step, survivors) {
        (Step::Finish, survivors) => stages.finish(&store, survivors)?,
        (_, Some(left)) => left,
        (_, None) => unreachable!("without a finish there was a round"),
    };
    if config.until == Some(Until::Stitch) {
        return Ok(None);
    }
    let written = stages.write(&source, &result)?;

    let mut report = stages.report(&source, config, &partition, written, started);
    report.input.faults = faults(&source, &partition, dropped.unwrap_or(result.statistics.dropped));
    if config.verify {
        verify::verify(config, &stages.run, &mut report)?;
    }
    drop(stages);
    if !config.keep_temp {
        job.remove()?;
    }
    Ok(Some(report))
}

/// The stages of one run: each is sealed in the job, timed and reported.
struct Stages<'a> {
    run: Run<'a>,
    config: &'a Config,
    layout: VertexLayout,
    kernel: kernel::Options,
    target: u64,
    rounds_done: u32,
    shared_by_round: Vec<u64>,
    charts_vanished: u64,
    /// What the finish's fit did.
    fit: Option<kernel::FitStatistics>,
    /// Vertices on texture seams after the last round or the finish.
    seam_vertices: u64,
    /// Refused collapses, and changes of the topology, by kind, over all rounds and the finish.
    rejects: BTreeMap<String, u64>,
    changes: BTreeMap<String, u64>,
    reports: Vec<StageReport>,
    n_stages: u32,
    input_bytes: u64,
}

impl<'a> Stages<'a> {
    fn new(
        config: &'a Config,
        plan: &Plan,
        job: &'a Job,
        progress: &'a Progress,
        source: &MeshSource,
    ) -> Self {
        let rounds = plan.rounds.len() as u32;
        // Partition, write, every round, every recut between rounds, and the finish.
        let n_stages = 2 + rounds + rounds.saturating_sub(1) + u32::from(plan.finish);
        Stages {
            run: Run {
                job,
                progress,
                threads: config.threads.get(),
                memory_bytes: plan.usable_memory_bytes,
                checkpoint_every: config.checkpoint_every,
            },
            config,
            layout: VertexLayout::for_kernel(
                source.schema(),
                source.n_vertices(),
                &config.attributes.labels,
                &config.attributes.weights,
            ),
            kernel: kernel::Options {
                confined: confined(source, config),
                region: region(source, config),
                // Whether it is worth its time is a question of the whole job, not of what the finish sees.
                fit: config.kernel.fit.decided(plan.triangles_in, plan.target),
                ..config.kernel.clone()
            },
            target: plan.target,
            rounds_done: 0,
            shared_by_round: Vec::new(),
            charts_vanished: 0,
            seam_vertices: 0,
            fit: None,
            rejects: BTreeMap::new(),
            changes: BTreeMap::new(),
            reports: Vec::new(),
            n_stages,
            input_bytes: source.file_bytes(),
        }
    }

    /// Runs a stage, or takes its outcome from the manifest; `count` tells the triangles of an outcome.
    fn stage<T: Serialize + DeserializeOwned>(
        &mut self,
        key: &str,
        name: &'static str,
        triangles_in: u64,
        count: impl Fn(&T) -> u64,
        work: impl FnOnce(&Run) -> Result<T>,
    ) -> Result<T> {
        let run = self.run;
        let number = self.reports.len() as u32 + 1;
        run.progress.begin(name, number, self.n_stages.max(number), triangles_in);
        run.progress.check()?;
        let (outcome, report): (T, StageReport) = run.job.sealed(key, || {
            let (read, written, start) =
                (run.disk().bytes_read(), run.disk().bytes_written(), Instant::now());
            let outcome = work(&run)?;
            let report = StageReport {
                name: name.to_owned(),
                seconds: start.elapsed().as_secs_f64(),
                triangles_in,
                triangles_out: count(&outcome),
                bytes_read: run.disk().bytes_read() - read,
                bytes_written: run.disk().bytes_written() - written,
                peak_memory_bytes: crate::memory::peak_bytes(),
            };
            Ok((outcome, report))
        })?;
        self.reports.push(report);
        Ok(outcome)
    }

    fn partition(
        &mut self,
        source: &MeshSource,
        marks: &BTreeMap<String, String>,
    ) -> Result<Partition> {
        let config = self.config;
        let (size, n) = (self.config.cell_triangles, source.n_faces());
        let partition = self.stage(
            "partition",
            "partition",
            n,
            |p: &Partition| p.store.triangles,
            |run| {
                // Nothing reads the input after this.
                let outcome = guarded(|| partition::partition(source, size, run));
                unchanged(&config.input, marks, outcome)
            },
        )?;
        if let Some(report) = self.reports.last_mut() {
            report.bytes_read += self.input_bytes;
        }
        self.shared_by_round.push(partition.store.shared_vertices);
        Ok(partition)
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

    fn next_step(&self, triangles_now: u64) -> Step {
        stitch::next_step(triangles_now, self.target, self.config.cell_triangles, self.rounds_done)
    }

    fn store(&self, info: StoreInfo) -> Result<CellStore> {
        CellStore::open(self.run.disk(), self.run.job.folder(), info, self.layout.clone())
    }

    fn survivors(&self, info: SurvivorInfo) -> Result<SurvivorPack> {
        SurvivorPack::open(self.run.disk(), self.run.job.folder(), info, self.layout.clone())
    }

    /// One round over all cells; the store it came from is removed.
    fn simplify(&mut self, info: StoreInfo, step: Step) -> Result<SurvivorInfo> {
        let round = self.rounds_done;
        let (goal, is_exact) = match step {
            Step::Round(goal) => (goal, false),
            _ => (self.target, true),
        };
        let goal = Goal { round, triangles: goal };
        let name = if round == 0 { "simplify" } else { "stitch" };
        let (options, layout, n) = (self.kernel.clone(), self.layout.clone(), info.triangles);
        let pack = self.run.job.path(&info.pack);
        let left = self.stage(
            &format!("round {round}"),
            name,
            n,
            |s: &SurvivorInfo| s.triangles,
            |run| {
                let store = CellStore::open(run.disk(), run.job.folder(), info, layout)?;
                match is_exact {
                    true => simplify::simplify_cells_exactly(&store, goal, &options, run),
                    false => simplify::simplify_cells(&store, goal, &options, run),
                }
            },
        )?;
        self.run.disk().remove(&pack)?;
        self.rounds_done += 1;
        self.count(&left);
        Ok(left)
    }

    /// Cuts survivors into new cells; their pack is removed.
    fn recut(&mut self, info: SurvivorInfo) -> Result<StoreInfo> {
        let (round, size, n) = (self.rounds_done, self.config.cell_triangles, info.triangles);
        let pack = self.run.job.path(&info.pack);
        let layout = self.layout.clone();
        let store = self.stage(
            &format!("recut {round}"),
            "stitch",
            n,
            |s: &StoreInfo| s.triangles,
            |run| {
                let survivors = SurvivorPack::open(run.disk(), run.job.folder(), info, layout)?;
                stitch::recut(&survivors, size, round, run)
            },
        )?;
        self.run.disk().remove(&pack)?;
        self.shared_by_round.push(store.shared_vertices);
        Ok(store)
    }

    /// Joins everything in memory and meets the target exactly.
    fn finish(
        &mut self,
        store: &StoreInfo,
        survivors: Option<SurvivorInfo>,
    ) -> Result<SurvivorInfo> {
        let (target, options) = (self.target, self.kernel.clone());
        let n = survivors.as_ref().map_or(store.triangles, |s| s.triangles);
        let source_pack = survivors.as_ref().map_or(&store.pack, |s| &s.pack);
        let pack = self.run.job.path(source_pack);
        let (layout, info) = (self.layout.clone(), store.clone());
        let result = self.stage(
            "finish",
            "stitch",
            n,
            |s: &SurvivorInfo| s.triangles,
            |run| {
                let (disk, folder) = (run.disk(), run.job.folder());
                match survivors {
                    Some(left) => {
                        let left = SurvivorPack::open(disk, folder, left, layout.clone())?;
                        let parts = Parts {
                            cells: &left.info().cells,
                            layout: &layout,
                            load: &|c| left.load(c),
                        };
                        stitch::finish(parts, target, &options, run)
                    }
                    None => {
                        let store = CellStore::open(disk, folder, info, layout.clone())?;
                        let load = |cell| store.load_tidy(cell).map(Survivors::from);
                        let parts =
                            Parts { cells: &store.info().cells, layout: &layout, load: &load };
                        stitch::finish(parts, target, &options, run)
                    }
                }
            },
        )?;
        self.run.disk().remove(&pack)?;
        self.count(&result);
        Ok(result)
    }

    fn count(&mut self, done: &SurvivorInfo) {
        let done = &done.statistics;
        self.charts_vanished += done.charts_vanished;
        self.seam_vertices = done.seam_vertices;
        self.fit = done.fit;
        for (sums, counts) in
            [(&mut self.rejects, &done.rejects), (&mut self.changes, &done.changes)]
        {
            for (name, n) in counts {
                *sums.entry(name.clone()).or_default() += n;
            }
        }
    }

    fn write(&mut self, source: &MeshSource, result: &SurvivorInfo) -> Result<Written> {
        let header = OutputHeader {
            comments: source.comments().to_vec(),
            obj_infos: source.obj_infos().to_vec(),
            settings: settings(self.config)
                .iter()
                .map(|(k, v)| format!("{k}={v}"))
                .collect::<Vec<_>>()
                .join(" "),
            ..OutputHeader::new(source.schema().clone(), 0, 0)
        };
        let pack = self.survivors(result.clone())?;
        let folder = self.run.job.folder();
        let place = Place {
            path: self.config.output.clone(),
            disk: self.run.disk().clone(),
            // Of the job, not of the process: a later run overwrites what a killed one has left.
            tag: format!("{:08x}", xxh3_64(folder.as_os_str().as_encoded_bytes()) as u32),
            replace: self.config.force,
        };
        if self.run.job.outcome::<()>(WRITING)?.is_none() {
            self.run.job.record(WRITING, &())?;
        }
        // Never taken from the manifest: the output may have been moved away since.
        let run = self.run;
        let number = self.reports.len() as u32 + 1;
        run.progress.begin("write", number, self.n_stages.max(number), result.triangles);
        let (read, start) = (run.disk().bytes_read(), Instant::now());
        let kind = Some(self.kind()?);
        let form = Form {
            format: OutputFormat { kind, ..self.config.format },
            faces: source.carried().cloned().unwrap_or_default(),
            normals: self.config.attributes.normals,
        };
        let written = write::write(&pack, place, header, form, &run)?;
        self.reports.push(StageReport {
            name: "write".to_owned(),
            seconds: start.elapsed().as_secs_f64(),
            triangles_in: result.triangles,
            triangles_out: written.triangles,
            bytes_read: run.disk().bytes_read() - read,
            bytes_written: written.bytes,
            peak_memory_bytes: crate::memory::peak_bytes(),
        });
        Ok(written)
    }

    fn kind(&self) -> Result<OutputKind> {
        self.config.format.kind.map_or_else(|| OutputKind::of(&self.config.output), Ok)
    }

    fn report(
        &self,
        source: &MeshSource,
        config: &Config,
        partition: &Partition,
        written: Written,
        started: Instant,
    ) -> RunReport {
        let seconds = started.elapsed().as_secs_f64();
        let met = written.triangles <= self.target;
        let has_seams = self.layout.codec.has_seams(source.schema());
        RunReport {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            input: InputReport {
                path: config.input.display().to_string(),
                bytes: source.file_bytes(),
                vertices: source.n_vertices(),
                triangles: source.n_faces(),
                bounds: partition.bounds,
                ..InputReport::default()
            },
            settings: settings(config),
            cells: partition.store.cells.len() as u32,
            rounds: self.rounds_done,
            seconds,
            triangles_per_second: source.n_faces() as f64 / seconds.max(1e-9),
            peak_memory_bytes: crate::memory::peak_bytes(),
            peak_temp_bytes: self.run.disk().peak_bytes(),
            output: OutputReport {
                path: config.output.display().to_string(),
                vertices: written.vertices,
                triangles: written.triangles,
            },
            rejects: self.rejects.clone(),
            changes: self.changes.clone(),
            fit: self.fit,
            seams: SeamReport {
                shared_vertices: self.shared_by_round.first().copied().unwrap_or(0),
                shared_vertices_by_round: self.shared_by_round.clone(),
                texture_seam_vertices: has_seams.then_some(self.seam_vertices),
                charts_vanished: has_seams.then_some(self.charts_vanished),
                place: partition.seam_place,
            },
            face_properties: match (source.carried(), self.kind()) {
                (Some(carry), Ok(kind)) => FaceReport::list(carry, kind),
                _ => Vec::new(),
            },
            target: self.target,
            target_met: met,
            stop_reason: if met { "target" } else { "nothing legal left to collapse" }.to_owned(),
            measured: None,
            stages: self.reports.clone(),
            max_error: None,
        }
    }
}

/// Faults of the input that were dropped, by name.
fn faults(source: &MeshSource, partition: &Partition, dropped: Dropped) -> BTreeMap<String, u64> {
    let found = source.faults();
    BTreeMap::from([
        ("degenerate_faces".to_owned(), partition.degenerate_faces),
        ("duplicate_faces".to_owned(), dropped.duplicate_faces),
        ("unreferenced_vertices".to_owned(), dropped.unreferenced_vertices),
        ("bad_faces".to_owned(), partition.bad_faces + found.bad_faces),
        ("bad_vertices".to_owned(), found.bad_vertices),
        ("missing_faces".to_owned(), found.missing_faces),
        ("missing_vertices".to_owned(), found.missing_vertices),
    ])
}

/// Texture coordinates, and the number of their image or region, mean nothing outside of their chart.
fn confined(source: &MeshSource, config: &Config) -> Vec<bool> {
    let codec = source.schema().kernel_codec(&config.attributes.labels);
    let image = Meaning::Scalar("texnumber".to_owned());
    let meanings = codec.meanings(source.schema());
    let confined = |m: &Meaning| [Meaning::Texture, Meaning::Region, image.clone()].contains(m);
    meanings.iter().map(confined).collect()
}

/// Recorded before the output is written: an output that is found later may be this job's own.
pub(crate) const WRITING: &str = "writing";

/// The channel with the number of the region that a face belongs to.
fn region(source: &MeshSource, config: &Config) -> Option<usize> {
    let codec = source.schema().kernel_codec(&config.attributes.labels);
    codec.meanings(source.schema()).iter().position(|m| *m == Meaning::Region)
}

/// The writer itself compares: a run that died between its rename and its end has left the same bytes.
fn refuse_to_overwrite(config: &Config) -> Result<()> {
    let may_be_ours =
        || job::view(&config.job_folder).is_ok_and(|view| view.outcomes.contains_key(WRITING));
    if config.output.exists() && !config.force && (config.restart || !may_be_ours()) {
        let path = config.output.display();
        return Err(Error::Usage(format!("{path} exists; give --force to replace it")));
    }
    Ok(())
}

/// Every setting that changes the result.
fn settings(config: &Config) -> BTreeMap<String, String> {
    BTreeMap::from([
        ("target".to_owned(), format!("{:?}", config.target)),
        ("cell-triangles".to_owned(), config.cell_triangles.to_string()),
        ("skip-bad".to_owned(), config.skip_bad.to_string()),
        ("placement".to_owned(), format!("{:?}", config.kernel.placement).to_lowercase()),
        ("merge-distance".to_owned(), config.kernel.merge_distance.to_string()),
        ("weight".to_owned(), config.attributes.weights.to_string()),
        ("faces".to_owned(), if config.drop_faces { "drop" } else { "carry" }.to_owned()),
        ("label".to_owned(), config.attributes.labels.join(",")),
        ("normals".to_owned(), format!("{:?}", config.attributes.normals).to_lowercase()),
        ("topology".to_owned(), format!("{:?}", config.kernel.topology).to_lowercase()),
        ("fit".to_owned(), format!("{:?}", config.kernel.fit).to_lowercase()),
    ])
}

/// What the job's files are only valid for.
pub(crate) fn identity(
    source: &MeshSource,
    marks: &BTreeMap<String, String>,
    config: &Config,
) -> Identity {
    let mut marks = marks.clone();
    marks.insert("vertices".to_owned(), source.n_vertices().to_string());
    marks.insert("faces".to_owned(), source.n_faces().to_string());
    let input = std::path::absolute(&config.input).unwrap_or_else(|_| config.input.clone());
    let input = input.display().to_string();
    Identity { input, input_marks: marks, settings: settings(config) }
}
