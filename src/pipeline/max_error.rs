//! `--max-error`: as few triangles as a bound on the distance allows, the bound proven.
//!
//! The kernel keeps the bound collapse by collapse (`kernel::bound`), so that one or two runs are enough as a rule.
//! Between the points that it looks at the surface can still be a little farther away, so the written file gets a
//! certificate as `stonecut measure --certify` gives it. Where its upper end is beyond the bound, the run is repeated
//! with a bound that is tighter at the places that the certificate names, and if that does not help, everywhere. Every
//! trial is recorded in the job folder, so the same command continues.
//! Only a result that is proven to keep the bound ever gets the output's name. Components that `--min-component` drops
//! do not count: the certificate is against a copy of the input without them. Memory and disk: those of one run, one
//! more output, and that copy.

use super::concluded::abandon;
use super::derived::{DerivedRun, derive, trial_path, within};
use super::prepare::{Prepared, prepare};
use crate::config::{Attributes, Config, JobOptions, Normals, Target, Texture};
use crate::error::Result;
use crate::io::{OutputFormat, OutputKind};
use crate::kernel::{self, EarlierRun, Tight, Tightened};
use crate::measure::{Beyond, Certificate, Certify, compare};
use crate::pipeline::run_report::{BoundReport, RunReport, TrialReport};
use crate::pipeline::verify::{self, MeasuredPair};
use crate::stages::stitch::is_tree_record;
use crate::store::job::rewind;
use crate::system::disk::Disk;
use crate::system::progress::Progress;
use crate::system::units::show_length;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

/// Trials at most; the second or third one keeps the bound as a rule.
const MOST_TRIALS: usize = 20;
/// After this many trials the bound is tightened everywhere.
const LOCAL_TRIALS: usize = 17;

/// Stages that every trial has in common, besides the trees of later rounds: the first round uses a small share of the
/// bound, and is tighter nowhere.
const FIRST_STAGES: [&str; 5] =
    ["partition", "components", "has area", "channel lengths", "round 0"];

/// Samples a side where the measurement was not asked for: the certificate finds the farthest place, and these give the
/// root mean square to a percent.
const SAMPLES: u64 = 25_000;

/// A trial as the job records it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Trial {
    /// Number of the trial, from 1.
    number: usize,
    report: RunReport,
    /// Distances at samples, both ways.
    max: f64,
    rms: f64,
    /// The Hausdorff distance enclosed; absent where one side has no surface.
    certificate: Option<Certificate>,
    /// Places beyond the bound, if they are few.
    beyond: Vec<Beyond>,
}

/// Simplifies as far as the two-sided Hausdorff distance is proven to stay within `bound` (input units).
///
/// `None` when `--until` ended a run early: every run stops there, and the same command goes on.
/// The report's `target_met` is false, and there is no output, if not even the last and tightest trial keeps the bound.
/// Takes the time of one to `MOST_TRIALS` runs and certificates.
pub fn simplify(
    bound: f64,
    prepared: Prepared,
    config: &Config,
    progress: &Progress,
) -> Result<Option<RunReport>> {
    verify::refuse_unreadable(config)?;
    let marks = crate::store::job::fingerprint::input_marks(&config.input)?;
    derive(prepared.source, &marks, config, progress, |run, source| {
        let n_input = source.n_triangles();
        // Every trial opens the input itself.
        drop(source);
        try_in_turn(run, bound, n_input)
    })
}

/// Runs trials until one keeps the bound, which becomes the output.
fn try_in_turn(run: &DerivedRun, bound: f64, n_input: u64) -> Result<Option<RunReport>> {
    let DerivedRun { job, disk, config, progress, .. } = run;
    let kept = run.inner_path("kept.ply")?;
    let kept = match config.min_component {
        None => None,
        Some(_) => Some(run.part("kept", || write_kept(kept, n_input, config, progress))?),
    };
    let mut trials: Vec<Trial> = Vec::new();
    let mut tightened = Tightened::default();
    let earlier = EarlierRun::default();
    while trials.len() < MOST_TRIALS && !trials.last().is_some_and(|trial| trial.ends(bound)) {
        let number = trials.len() + 1;
        if let Some(last) = trials.last() {
            if last.beyond.is_empty() || last.number >= LOCAL_TRIALS {
                tightened.tighten_everywhere(bound, last.upper());
            }
            let ball = |one: &Beyond| Tight {
                place: one.point,
                radius: one.size,
                margin: one.distance - bound,
            };
            tightened.tighten(bound, last.beyond.iter().map(ball), last.report.rounds > 0);
        }
        let name = format!("trial {number}");
        let found = match job.outcome(&name)? {
            Some(found) => found,
            None => {
                let kernel = kernel_of(bound, &tightened, &earlier, config);
                // The collapses of a first trial of an earlier process are not known any more.
                let is_one_cell = trials.first().is_some_and(|first| first.report.rounds == 0);
                if is_one_cell && kernel.earlier.is_some() && !earlier.is_known() {
                    let first = kernel_of(bound, &Tightened::default(), &earlier, config);
                    if run_within(1, true, (bound, first), config, progress)?.is_none() {
                        return Ok(None);
                    }
                }
                match run_trial(number, (bound, kernel), kept.as_deref(), config, progress) {
                    Ok(Some(found)) => {
                        job.record(&name, &found)?;
                        found
                    }
                    Ok(None) => return Ok(None),
                    Err(error) if trials.is_empty() => return Err(abandon(job, error)),
                    Err(error) => return Err(error),
                }
            }
        };
        if !found.keeps(bound) {
            disk.remove(&trial_path(config, &number.to_string()))?;
            let places = match found.beyond.len() {
                0 => String::new(),
                n => format!(" in {n} places"),
            };
            progress.note(format!(
                "up to {:.3} of the bound away{places}: again, tighter there",
                found.upper() / bound
            ));
        }
        trials.push(found);
    }
    let best = trials.last().filter(|trial| trial.keeps(bound));
    let mut report = match best {
        Some(best) => {
            let path = trial_path(config, &best.number.to_string());
            run.deliver(&path)?;
            best.report.clone()
        }
        None => {
            let (upper, last) = match trials.last() {
                Some(last) => (last.upper(), last.report.clone()),
                None => unreachable!("the first trial has ended, or its error was given back"),
            };
            let output = crate::pipeline::run_report::OutputReport {
                path: config.output.display().to_string(),
                ..Default::default()
            };
            let stop_reason = format!(
                "no result keeps the bound of {}: the last of {} trials was up to {} away; nothing was written",
                show_length(bound),
                trials.len(),
                show_length(upper)
            );
            RunReport { target_met: false, stop_reason, output, ..last }
        }
    };
    report.output.path = config.output.display().to_string();
    report.seconds = 0.0;
    report.hausdorff = best.and_then(|trial| trial.certificate.clone());
    report.max_error = Some(BoundReport {
        bound,
        tracked_max: best.and_then(|trial| trial.report.max_error.as_ref()?.tracked_max),
        measured_max: best.map(|trial| trial.max),
        measured_rms: best.map(|trial| trial.rms),
        trials: trials
            .iter()
            .map(|trial| TrialReport {
                triangles: trial.report.output.triangles,
                max: trial.upper(),
                seconds: trial.report.seconds,
            })
            .collect(),
    });
    Ok(Some(report))
}

/// Writes the geometry of the input without small components among the trials; gives back its path.
fn write_kept(
    output: PathBuf,
    n_input: u64,
    config: &Config,
    progress: &Progress,
) -> Result<PathBuf> {
    let inner = Config {
        target: Target::Triangles(n_input),
        job: JobOptions { force: true, ..JobOptions::default() },
        error_field: false,
        progressive: None,
        map: None,
        format: OutputFormat { kind: Some(OutputKind::Ply), ..OutputFormat::default() },
        drop_texture: true,
        texture: Texture::Keep,
        drop_faces: true,
        attributes: Attributes { normals: Normals::Drop, ..Attributes::default() },
        kernel: kernel::Options {
            topology: kernel::Topology::Keep,
            fit: kernel::Fit::Off,
            ..kernel::Options::default()
        },
        ..within(config, output.clone(), "kept")
    };
    let prepared = prepare(&inner)?;
    super::simplify(prepared, progress)?;
    Ok(output)
}

/// Options of the kernel for one trial, which repeats what the first one did as far as only balls are tighter.
fn kernel_of(
    bound: f64,
    tightened: &Tightened,
    earlier: &EarlierRun,
    config: &Config,
) -> kernel::Options {
    let distance = tightened.share * bound;
    let is_tighter = tightened.share < Tightened::default().share;
    kernel::Options {
        bound: Some(kernel::Bound { distance, channel: None, patience: 1.0 }),
        tight: Arc::from(tightened.places.as_slice()),
        earlier: (!is_tighter).then(|| earlier.clone()),
        ..config.kernel.clone()
    }
}

/// Runs one trial, from the beginning if it `restarts`; gives its output and its report. `None` if `--until` ended the run early.
fn run_within(
    number: usize,
    restarts: bool,
    (bound, kernel): (f64, kernel::Options),
    config: &Config,
    progress: &Progress,
) -> Result<Option<(PathBuf, RunReport)>> {
    let output = trial_path(config, &number.to_string());
    let inner = Config {
        kernel,
        // Goes with the trials.
        job: JobOptions { keep_temp: true, force: true, restart: restarts, ..config.job },
        trial_of: Some(bound),
        // Measured later, once.
        ..within(config, output.clone(), "job")
    };
    // The same cells in later rounds: most of what is not near a tighter ball comes out as it did before.
    let is_common = |name: &str| FIRST_STAGES.contains(&name) || is_tree_record(name);
    rewind(&inner.job_folder, &Disk::default(), is_common, number)?;
    let prepared = prepare(&inner)?;
    let started = Instant::now();
    let Some(mut report) = super::simplify(prepared, progress)? else { return Ok(None) };
    // Its own: the first stages are those of the trial before.
    report.seconds = started.elapsed().as_secs_f64();
    Ok(Some((output, report)))
}

/// Runs and measures one trial: against `kept`, if that is another mesh than the input. `None` if `--until` ended the run
/// early.
fn run_trial(
    number: usize,
    goal: (f64, kernel::Options),
    kept: Option<&Path>,
    config: &Config,
    progress: &Progress,
) -> Result<Option<Trial>> {
    let bound = goal.0;
    let Some((output, mut report)) = run_within(number, false, goal, config, progress)? else {
        return Ok(None);
    };
    let started = Instant::now();
    let measured = match kept {
        Some(kept) => Config { input: kept.into(), ..config.clone() },
        None => config.clone(),
    };
    let pair = MeasuredPair::open(&measured, &output)?;
    let mut request = pair.request(config, &config.job_folder);
    request.options.certify = Some(Certify { tolerance: verify::TOLERANCE, bound: Some(bound) });
    if !config.checks.verify {
        request.options.samples = SAMPLES;
        request.options.distances_only = true;
    }
    let comparison = compare::compare(&request, progress)?;
    let deviation = &comparison.measured.deviation;
    let max = deviation.forward.distance.max.max(deviation.backward.distance.max);
    let rms = deviation.rms;
    if config.checks.verify {
        let seconds = started.elapsed().as_secs_f64();
        report.measured = Some(Box::new(compare::Report::new(&request, &comparison, seconds)));
    }
    let certificate = comparison.measured.certificate.filter(|enclosed| enclosed.upper.is_finite());
    let beyond = certificate.as_ref().map_or(Vec::new(), |enclosed| enclosed.beyond.clone());
    let trial = Trial { number, report, max, rms, certificate, beyond };
    if config.error_field && trial.keeps(bound) {
        super::error_field::raise(&request, &Disk::default(), progress)?;
    }
    Ok(Some(trial))
}

impl Trial {
    /// Upper end of the certificate, infinite without one.
    fn upper(&self) -> f64 {
        self.certificate.as_ref().map_or(f64::INFINITY, |enclosed| enclosed.upper)
    }

    /// True if the result is proven to keep the bound; false for NaN.
    fn keeps(&self, bound: f64) -> bool {
        self.upper() <= bound
    }

    /// True if no further trial is due: the bound is kept, or nothing was left to tighten.
    fn ends(&self, bound: f64) -> bool {
        self.keeps(bound) || self.report.output.triangles == self.report.input.triangles
    }
}
