//! The program: from a scan larger than memory to one small mesh.
//!
//! Partition the input into cells on disk, simplify the cells in parallel, stitch until no seam is left,
//! write. Every stage is sealed in the job folder before the next one begins, so the same command continues
//! wherever an earlier run stopped. Only this file names two stages.

pub mod max_error;
pub mod plan;
mod quality;
pub mod run_report;
pub mod seam_points;
mod stage_runner;
pub mod verify;

use crate::config::{Config, Target, Until};
use crate::error::{Error, Result};
use crate::io::ply::{MeshSource, ReadOptions};
use crate::io::{StageOptions, SurveyOptions, faces_to_vertices, survey_faces};
use crate::stages::components::ComponentSizes;
use crate::stages::stitch::Step;
use crate::store::job::fingerprint::{input_marks, job_identity, unchanged};
use crate::store::job::{self, Job};
use crate::system::disk::Disk;
use crate::system::disk::folder_of;
use crate::system::parallel::guarded;
use crate::system::progress::Progress;
use plan::{Plan, check_split};
use run_report::RunReport;
use stage_runner::{Stages, faults};
use std::collections::BTreeMap;
use std::path::Path;
use std::time::Instant;

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
        check_labels(&source, &config.attributes.labels)?;
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
    config.target.check(source.n_triangles())?;
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
        return max_error::simplify(bound, prepared, config, progress);
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
    guarded(|| run_stages(disk, prepared, config, progress))
}

fn run_stages(
    disk: &Disk,
    prepared: Prepared,
    config: &Config,
    progress: &Progress,
) -> Result<Option<RunReport>> {
    let started = Instant::now();
    let Prepared { source, plan, marks } = prepared;
    let identity = job_identity(&source, &marks, config);
    let job = Job::open(&config.job_folder, disk, &identity, config.restart)?;
    let mut stages = Stages::new(config, &plan, &job, progress, &source);

    let partition = match stages.partition(&source, &marks) {
        Ok(partition) if partition.store.triangles == 0 => {
            let what = format!(
                "all of its {} faces are degenerate: there is no triangle with three corners of its own",
                source.n_face_rows()
            );
            Err(Error::bad_input(&config.input, what))
        }
        other => other,
    };
    let partition = match partition {
        Ok(partition) => partition,
        Err(error) => {
            drop(stages);
            return Err(abandon(job, error));
        }
    };
    if config.until == Some(Until::Partition) {
        return Ok(None);
    }
    let components = stages.components(&partition)?;
    let mut store = match &components {
        Some(found) => found.store.clone(),
        None => partition.store.clone(),
    };
    if let (0, Some(found)) = (store.triangles, &components) {
        drop(stages);
        return Err(abandon(job, nothing_left(config, &found.sizes)));
    }
    if !stages.has_area(&store)? {
        drop(stages);
        let what = format!(
            "all of its {} triangles have no area: their corners lie in one place or on one line; nothing was written",
            store.triangles
        );
        return Err(abandon(job, Error::bad_input(&config.input, what)));
    }
    if let Some(path) = &config.seams {
        crate::pipeline::seam_points::write(&stages.store(store.clone())?, path, &stages.run)?;
    }
    let mut step = stages.next_step(store.triangles);
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
    if result.triangles == 0 || result.statistics.is_flat {
        let left = match result.triangles {
            0 => "no triangle is left".to_owned(),
            n => format!("the {n} triangles that are left have no area"),
        };
        let what = format!(
            "{left} at a target of {}; ask for more, or look at the input with 'info --check'; \
             nothing was written",
            plan.target
        );
        drop(stages);
        return Err(abandon(job, Error::Empty { path: config.output.clone(), what }));
    }
    if config.until == Some(Until::Stitch) {
        return Ok(None);
    }
    let written = stages.write(&source, &result)?;

    let mut report = stages.report(&source, config, &partition, written, started);
    report.input.faults = faults(&source, &partition, dropped.unwrap_or(result.statistics.dropped));
    report.components = components.map(|found| found.sizes);
    if config.verify {
        verify::verify(config, &stages.run, &mut report)?;
    }
    drop(stages);
    if !config.keep_temp {
        job.remove()?;
    }
    Ok(Some(report))
}

/// Removes a job that no command can continue: with a bad input or an empty result, whatever helps (another input,
/// `--skip-bad`, another target) makes another job. All other errors leave it as it is.
pub(crate) fn abandon(job: Job, error: Error) -> Error {
    if matches!(error, Error::BadInput { .. } | Error::Empty { .. }) {
        // What cannot be removed costs space; the error that led here matters more.
        let _ = job.remove();
    }
    error
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

/// Recorded before the output is written: an output that is found later may be this job's own.
pub(crate) const WRITING: &str = "writing";

/// Refuses labels that name nothing.
fn check_labels(source: &MeshSource, labels: &[String]) -> Result<()> {
    let vertices = source.schema().properties.iter().map(|p| p.name.clone());
    let known: Vec<String> =
        vertices.chain(source.face_properties().into_iter().map(|p| p.name)).collect();
    let Some(unknown) = labels.iter().find(|label| !known.contains(label)) else { return Ok(()) };
    Err(Error::Usage(format!(
        "--label {unknown}: neither vertices nor faces have such a property; they have {}",
        if known.is_empty() { "none".to_owned() } else { known.join(", ") }
    )))
}

/// Whether an output that is found may be that of the job in this folder.
pub fn has_begun_to_write(job_folder: &Path) -> bool {
    job::view(job_folder).is_ok_and(|view| view.outcomes.contains_key(WRITING))
}

/// The writer itself compares: a run that died between its rename and its end has left the same bytes.
fn refuse_to_overwrite(config: &Config) -> Result<()> {
    let may_be_ours = || !config.restart && has_begun_to_write(&config.job_folder);
    if config.output.exists() && !config.force && !may_be_ours() {
        let path = config.output.display();
        return Err(Error::Usage(format!("{path} exists; give --force to replace it")));
    }
    Ok(())
}
