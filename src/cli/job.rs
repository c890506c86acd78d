//! The job of `simplify`: run, and recognised where an earlier run has done it.
//!
//! The proof is in the report of that run (`done`) and in a note on its output: the same settings, input and files beside it with the same
//! marks, and outputs that nothing has changed since, with the files of `--map`, `--seams` and `--progressive`. Where the file system keeps no
//! notes and there is no report, the output is in the way.

use super::log::EXIT_SHORT;
use super::outcome::close;
use crate::config::{Config, Method};
use crate::error::Result;
use crate::io::OutputKind;
use crate::pipeline::methods::{self, PreparedMethod};
use crate::pipeline::run_report::{DoneRecord, RunReport};
use crate::pipeline::{self, Prepared, max_error, optimize, pairs};
use crate::store::job::fingerprint::{file_marks, marks_now};
use crate::system::disk::{note_of, read_regular, set_note};
use crate::system::first_bytes::MOST_REPORT_BYTES;
use crate::system::losses::{Loss, LossKind};
use crate::system::progress::{Progress, StageSeconds};
use serde_json::json;
use std::collections::BTreeMap;
use std::path::Path;
use xxhash_rust::xxh3::xxh3_64;

/// A job that is prepared.
pub(crate) enum ReadyJob {
    /// The collapse, by itself or within another run.
    Collapse(Box<Prepared>),
    /// Another method.
    Method(Box<PreparedMethod>),
}

/// Opens the input and plans the job.
pub(crate) fn prepare(config: &Config, progress: &Progress) -> Result<ReadyJob> {
    match config.method {
        Method::Collapse => {
            let mut ready = pipeline::prepare(config)?;
            ready.plan.refine(&ready.source, &ready.config)?;
            Ok(ReadyJob::Collapse(Box::new(ready)))
        }
        _ => methods::prepare(config, progress).map(|ready| ReadyJob::Method(Box::new(ready))),
    }
}

impl ReadyJob {
    /// The stages that the plan expects.
    pub(crate) fn expected(&self) -> Vec<StageSeconds> {
        match self {
            ReadyJob::Collapse(ready) => ready.plan.stage_seconds.clone(),
            ReadyJob::Method(ready) => ready.plan.stage_seconds(),
        }
    }

    /// The plan in lines, and as JSON.
    pub(super) fn plan(&self, config: &Config) -> (Vec<String>, serde_json::Value) {
        match self {
            ReadyJob::Collapse(ready) => (ready.plan.lines(config), json!(ready.plan)),
            ReadyJob::Method(ready) => (ready.plan.lines(config), json!(ready.plan)),
        }
    }
}

/// Runs a job that is prepared; `None` where `--until` ended it.
pub(crate) fn run_job(
    ready: ReadyJob,
    config: &Config,
    progress: &Progress,
) -> Result<Option<RunReport>> {
    if config.lock.is_some() && config.kind()? == OutputKind::Glb {
        let why = "GLB counts from its own middle in steps or floats: parts of a whole no longer fit to the last bit";
        let loss = Loss::new(LossKind::Precision, "places of locked vertices", why);
        progress.lose(loss.remedy("PLY, OBJ and STL keep them"));
    }
    let prepared = match ready {
        ReadyJob::Collapse(prepared) => *prepared,
        ReadyJob::Method(prepared) => {
            progress.lose_all(&prepared.losses());
            let mut report = match config.optimize {
                Some(_) => optimize::simplify(prepared.into_source(), config, progress),
                None => methods::simplify(*prepared, config, progress),
            }?;
            close(&mut report, config, progress);
            return Ok(Some(report));
        }
    };
    progress.lose_all(&prepared.source.losses());
    let marks = prepared.marks.clone();
    let mut report = match config.kernel.bound {
        Some(bound) => max_error::simplify(bound.distance, prepared, config, progress),
        None if config.optimize.is_some() => {
            optimize::simplify(prepared.source, config, progress).map(Some)
        }
        None if config.pairs => pairs::simplify(prepared.source, config, progress).map(Some),
        None => pipeline::simplify(prepared, progress),
    }?;
    if let Some(report) = &mut report {
        close(report, config, progress);
        let is_less = report.is_short() || report.losses.has_whole();
        report.done = record(config, marks, if is_less { EXIT_SHORT } else { 0 });
        if let (Some(done), false) = (&report.done, config.output == Path::new("-")) {
            serde_json::to_vec(&sealed(done.clone()))
                .iter()
                .for_each(|note| set_note(&config.output, note));
        }
    }
    Ok(report)
}

/// The record of a run that is over; `None` where an output cannot be looked at.
fn record(config: &Config, input: BTreeMap<String, String>, exit_code: u8) -> Option<DoneRecord> {
    if config.input == Path::new("-") {
        return None;
    }
    let marks =
        |path: &std::path::PathBuf| Some((path.display().to_string(), file_marks(path).ok()?));
    let outputs = config.outputs().map(|path| marks(&path.to_path_buf()));
    let mut outputs = outputs.collect::<Option<BTreeMap<_, _>>>()?;
    // A file beside that is gone afterwards is missing from the next record.
    let progressive = config.progressive.as_ref().map(|progressive| &progressive.path);
    let sides = [&config.checks.seams, &config.map].into_iter().flatten().chain(progressive);
    outputs.extend(sides.filter_map(marks));
    Some(DoneRecord { settings: settings(config), input, outputs, exit_code })
}

/// Everything that another run of the same command would have in common with this one.
fn settings(config: &Config) -> BTreeMap<String, String> {
    let mut settings = config.settings();
    for (name, value) in [
        ("input", format!("{:?}", std::path::absolute(&*config.input).ok())),
        ("format", format!("{:?}", config.format)),
        ("verify", format!("{:?}", config.checks.verify)),
        ("seams", format!("{:?}", config.checks.seams)),
        ("progressive", format!("{:?}", config.progressive)),
        ("map", format!("{:?}", config.map)),
        ("version", env!("CARGO_PKG_VERSION").to_owned()),
    ] {
        settings.insert(name.to_owned(), value);
    }
    settings
}

/// The record in a note: file systems keep few bytes, and a checksum of the settings is enough.
fn sealed(done: DoneRecord) -> DoneRecord {
    let checksum = xxh3_64(format!("{:?}", done.settings).as_bytes());
    let settings = BTreeMap::from([("checksum".to_owned(), format!("{checksum:016x}"))]);
    DoneRecord { settings, ..done }
}

/// The exit code of an earlier run that has done this job, if its report or, where none was asked for, the note on its output proves that.
pub(super) fn done_before(config: &Config, report: Option<&Path>) -> Option<u8> {
    let done: DoneRecord = match report {
        Some(report) => {
            let text = read_regular(report, MOST_REPORT_BYTES).ok()?;
            serde_json::from_slice::<RunReport>(&text).ok()?.done?
        }
        None => serde_json::from_slice(&note_of(&config.output)?).ok()?,
    };
    let input = marks_now(&config.input, &done.input).ok()?;
    let is_input = done.input.iter().all(|(name, value)| input.get(name) == Some(value));
    let now = record(config, done.input.clone(), done.exit_code)?;
    let now = if report.is_some() { now } else { sealed(now) };
    (is_input && now == done).then_some(done.exit_code)
}

/// The stages of a job that are done, by name.
pub(super) fn stages_done(config: &Config) -> Vec<String> {
    let outcomes = crate::store::job::view(&config.job_folder).map(|view| view.outcomes);
    outcomes.unwrap_or_default().into_keys().collect()
}
