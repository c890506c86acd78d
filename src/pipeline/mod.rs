//! The program: from a scan larger than memory to one small mesh.
//!
//! Partition the input into cells on disk, simplify the cells in parallel, stitch until no seam is left,
//! write. Every stage is sealed in the job folder before the next one begins, so the same command continues
//! wherever an earlier run stopped.

pub(crate) mod bake;
mod concluded;
pub mod extract;
mod first_run;
mod fit;
pub mod in_memory;
mod kernel_side;
mod layout;
pub(crate) mod max_error;
mod method_reports;
pub mod methods;
pub mod optimize;
pub mod pairs;
pub mod plan;
mod prepare;
mod quality;
pub mod refine;
pub mod run_report;
mod sealed_stages;
pub(crate) mod seam_points;
mod source_facts;
mod stage_runner;
pub mod tiles;
pub mod units;
pub(crate) mod verify;

use crate::config::{Config, Target, Texture, Until};
use crate::error::{Error, Result};
use crate::io::ply::MeshSource;
use crate::mesh::bounds::Bounds;
use crate::stages::components::ComponentSizes;
use crate::stages::stitch::{Step, begins_from_result};
use crate::store::cells::SurvivorInfo;
use crate::store::job::Job;
use crate::store::job::fingerprint::job_identity;
use crate::system::disk::Disk;
use crate::system::parallel::guarded;
use crate::system::progress::Progress;
pub use concluded::has_begun_to_write;
use concluded::{conclude, concluded};
pub use prepare::{Prepared, prepare};
use run_report::{RunReport, TextureReport};
use source_facts::faults;
use stage_runner::{Left, Stages};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Simplifies `config.input` into `config.output`; `None` when `--until` ended the run early.
pub fn simplify(
    prepared: Prepared,
    config: &Config,
    progress: &Progress,
) -> Result<Option<RunReport>> {
    simplify_on(&Disk::default(), prepared, config, progress)
}

/// The same through a given disk, so that a test can make it fail. A panic on the way becomes an error.
pub fn simplify_on(
    disk: &Disk,
    prepared: Prepared,
    config: &Config,
    progress: &Progress,
) -> Result<Option<RunReport>> {
    guarded(|| run_stages(disk, prepared, config, progress))
}

fn run_stages(
    disk: &Disk,
    prepared: Prepared,
    config: &Config,
    progress: &Progress,
) -> Result<Option<RunReport>> {
    let settled = prepared.settled(config);
    let identity = job_identity(&prepared.source, &prepared.marks, &settled);
    if let Some(report) = concluded(disk, &identity, &settled)? {
        return Ok(Some(report));
    }
    let job = Job::open(&settled.job_folder, disk, &identity, settled.restart)?;
    post(&job, &settled.output, prepared.source.n_triangles(), progress);
    match run_stages_in(&job, prepared, &settled, progress)? {
        Ended::Done(report) => Ok(Some(*report)),
        Ended::Early => Ok(None),
        Ended::ShortOfTarget(left) => {
            drop(job);
            progress.note(format!(
                "the input's charts leave {left} triangles: again with a new texture (--texture bake)"
            ));
            let config = Config { texture: Texture::Bake, restart: true, ..config.clone() };
            run_stages(disk, prepare(&config)?, &config, progress)
        }
    }
}

/// Posts the progress of a job where `status` finds it.
fn post(job: &Job, output: &Path, triangles: u64, progress: &Progress) {
    if let Some(board) = job.board() {
        let output = std::path::absolute(output).unwrap_or_else(|_| output.to_path_buf());
        progress.post_in(&board, serde_json::json!({ "output": output, "triangles": triangles }));
    }
}

/// End of the stages of a run.
enum Ended {
    /// The output is there.
    Done(Box<RunReport>),
    /// `--until` ended the run.
    Early,
    /// The texture of the input left this many triangles, too many, where a new one can be made; nothing was written.
    ShortOfTarget(u64),
}

impl Ended {
    /// The report of a run that came to its end.
    fn report(self) -> Option<RunReport> {
        match self {
            Ended::Done(report) => Some(*report),
            Ended::Early | Ended::ShortOfTarget(_) => None,
        }
    }
}

/// Runs the stages whose outcomes the job does not have yet.
fn run_stages_in(
    job: &Job,
    prepared: Prepared,
    config: &Config,
    progress: &Progress,
) -> Result<Ended> {
    let started = Instant::now();
    let Prepared { source, plan, textures, marks, can_bake, texture, seams, .. } = prepared;
    // With more memory, what the allocator keeps back does no harm.
    if config.memory_bytes < 2 * plan.needed_memory_bytes {
        crate::system::memory::keep_nothing_back();
    }
    let mut stages = Stages::new(config, &plan, job, progress, &source);

    let partition = match stages.partition(&source, &marks) {
        Ok(partition) if partition.store.triangles == 0 => {
            let what = format!(
                "all of its {} faces are degenerate: no triangle has three different corners",
                source.n_face_rows()
            );
            Err(Error::bad_input(&config.input, what))
        }
        other => other,
    };
    let partition = match partition {
        Ok(partition) => partition,
        Err(error) => return Err(abandon(job, error)),
    };
    source.remarks()?.into_iter().for_each(|remark| progress.lose(remark));
    if config.until == Some(Until::Partition) {
        return Ok(Ended::Early);
    }
    if let Err(error) = hold_sizes(config, texture, &partition.bounds) {
        return Err(abandon(job, error));
    }
    let components = stages.components(&partition)?;
    let store = match &components {
        Some(found) => found.store.clone(),
        None => partition.store.clone(),
    };
    if let (0, Some(found)) = (store.triangles, &components) {
        return Err(abandon(job, nothing_left(config, &found.sizes)));
    }
    if !stages.has_area(&store)? {
        let what = format!(
            "all of its {} triangles have no area beyond the rounding of their coordinates: their corners lie in one place \
             or on one line within it; nothing was written",
            store.triangles
        );
        return Err(abandon(job, Error::bad_input(&config.input, what)));
    }
    if let (Some(path), Some(seen)) = (&config.seams, &seams) {
        // The cells go with the first round.
        let name = format!("seams {}", path.display());
        if job.outcome::<()>(&name)?.is_none() || !path.exists() {
            crate::pipeline::seam_points::write(&stages.store(store.clone())?, seen, &stages.run)?;
            job.record(&name, &())?;
        }
    }
    let mut left = Left::Cells(store);
    let mut levels = Vec::new();
    let mut of_textures = textures.first().map(TextureReport::of);
    let mut baked = None;
    let mut textures = textures.into_iter();
    for level in 0..=config.coarser.len() {
        stages.begin_level(level, &plan);
        let Some((taken_in, result)) = reduce(&mut stages, &source, left, config.until)? else {
            return Ok(Ended::Early);
        };
        if result.triangles == 0 || result.statistics.is_flat {
            let error = empty_result(&result, stages.target, stages.output().to_path_buf());
            return Err(abandon(job, error));
        }
        let next = plan.coarser.get(level);
        let is_needed = next.is_some_and(|&next| !begins_from_result(result.triangles, next));
        let kept = match taken_in {
            Some(left) if !is_needed => {
                stages.remove(&left)?;
                None
            }
            other => other,
        };
        let is_short = result.triangles > stages.target;
        if is_short && can_bake && config.coarser.is_empty() {
            return Ok(Ended::ShortOfTarget(result.triangles));
        }
        if config.until == Some(Until::Stitch) {
            return Ok(Ended::Early);
        }
        let written = match config.texture {
            Texture::Bake => {
                let done = stages.write_baked(&source, &marks, &result)?;
                if let Some(done) = done.report {
                    (of_textures, baked) = (Some(done.textures), Some(done.bake));
                }
                done.written
            }
            Texture::Auto | Texture::Keep => stages.write(&source, textures.next(), &result)?,
        };
        levels.push(stages.level_report(&source, written));
        left = kept.unwrap_or(Left::Survivors(result));
    }

    let mut report = stages.report(&source, config, &partition, levels, started);
    (report.textures, report.bake) = (of_textures, baked);
    report.input.faults = faults(&source, &partition, stages.dropped.unwrap_or_default());
    report.components = components.map(|found| found.sizes);
    if config.verify {
        verify::verify(config, &stages.run, &mut report)?;
    }
    if !config.keep_temp {
        conclude(job, config, &report)?;
    }
    Ok(Ended::Done(Box::new(report)))
}

/// The rounds and the finish of one level: what the finish took in, if there was one, and the result; `None` when
/// `--until` ends the run after the first round.
fn reduce(
    stages: &mut Stages,
    source: &MeshSource,
    mut left: Left,
    until: Option<Until>,
) -> Result<Option<(Option<Left>, SurvivorInfo)>> {
    let mut step = stages.next_step(left.triangles());
    if let (Left::Cells(store), true) = (&left, step != Step::Finish) {
        stages.weigh(store)?;
    }
    if until == Some(Until::Cells) {
        return Ok(None);
    }
    // One finish takes in all cells: nothing is simplified before it.
    if until == Some(Until::Simplify) && step == Step::Finish && stages.rounds_done == 0 {
        return Ok(None);
    }
    while let Step::Round(_) | Step::ExactRound = step {
        let cells = match left {
            Left::Cells(store) => store,
            Left::Survivors(earlier) => stages.recut(earlier)?,
        };
        let survivors = stages.simplify(cells, step)?;
        if until == Some(Until::Simplify) && stages.rounds_done == 1 {
            return Ok(None);
        }
        step = stages.next_step(survivors.triangles);
        left = Left::Survivors(survivors);
    }
    match (step, left) {
        (Step::Finish, left) => {
            let result = stages.finish(source, &left)?;
            Ok(Some((Some(left), result)))
        }
        (_, Left::Survivors(left)) => Ok(Some((None, left))),
        (_, Left::Cells(_)) => unreachable!("without a finish there was a round"),
    }
}

/// Refuses sizes that what was asked for cannot reckon with: texels, charts and boxes of crossings are floats, and bounds take fourth
/// powers of lengths.
fn hold_sizes(config: &Config, texture: Texture, bounds: &Bounds) -> Result<()> {
    let kernel = &config.kernel;
    if texture == Texture::Bake || config.bake.normals {
        bounds.hold(&config.input, "a new texture or normal map", [1e-36, 1e36])?;
    }
    if kernel.no_self_intersections {
        bounds.hold(&config.input, "--no-self-intersections", [0.0, 1e36])?;
    }
    if kernel.bound.is_some() || matches!(config.target, Target::MaxError(_)) {
        bounds.hold(&config.input, "--max-error", [0.0, 1e50])?;
    }
    Ok(())
}

/// An empty result is never a success; files of finer levels stay.
fn empty_result(result: &SurvivorInfo, target: u64, output: PathBuf) -> Error {
    let left = match result.triangles {
        0 => "no triangle is left".to_owned(),
        n => format!("the {n} triangles that are left have no area"),
    };
    let what = format!(
        "{left} at a target of {target}; ask for more, or look at the input with 'info --check'; \
         nothing was written"
    );
    Error::Empty { path: output, what }
}

/// Removes a job that no command can continue: with a bad input or an empty result, whatever helps (another input,
/// `--skip-bad`, another target) makes another job. All other errors leave it as it is.
pub(crate) fn abandon(job: &Job, error: Error) -> Error {
    if is_final(&error) {
        // What cannot be removed costs space; the error that led here matters more.
        let _ = job.remove();
    }
    error
}

/// True if the same command would fail again.
pub(crate) fn is_final(error: &Error) -> bool {
    matches!(error, Error::BadInput { .. } | Error::Empty { .. })
}

/// An empty result is never a success.
fn nothing_left(config: &Config, sizes: &ComponentSizes) -> Error {
    let min = config.min_component.map_or_else(String::new, |min| min.to_string());
    let what = format!(
        "--min-component {min} would drop all {} components, the largest of {} triangles; give a smaller value; \
         nothing was written",
        sizes.found, sizes.largest
    );
    Error::Empty { path: config.output.clone(), what }
}
