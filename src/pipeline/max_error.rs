//! `--max-error`: as few triangles as a bound on the measured deviation allows.
//!
//! Costs of collapses are no bound, so whole runs are tried: simplify to a count, measure the written file
//! against the input as `stonecut measure` does, choose the next count. Every trial is recorded in the job
//! folder, so the same command continues. Only a result that was measured to keep the bound ever gets the
//! output's name. Components that `--min-component` drops do not count: the measure is a copy of the input
//! without them. Memory and disk: those of one run, one more output, and that copy.

use super::prepare::{Prepared, WRITING, prepare};
use crate::config::{Attributes, Config, Normals, Target};
use crate::error::{Error, Result};
use crate::io::{OutputFormat, OutputKind};
use crate::kernel;
use crate::measure::compare;
use crate::pipeline::run_report::{BoundReport, RunReport, TrialReport};
use crate::pipeline::verify::{self, Pair};
use crate::store::job::fingerprint::job_identity;
use crate::store::job::{Job, TRIALS};
use crate::system::disk::Disk;
use crate::system::pending_file::{self, Place};
use crate::system::progress::Progress;
use crate::system::units::show_length;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Trials never go beyond this; most searches end after three to six.
const MOST_TRIALS: usize = 16;
/// From this trial on the bracket is halved, in case the deviation follows no law.
const HALVE_FROM: usize = 7;
/// What is aimed at, as a share of the bound: between 1/2 and 1 is good enough.
const AIM: f64 = 0.75;
/// The largest deviation falls about with the count to the power of -0.8 (measured: -0.6 to -1).
const COUNT_EXPONENT: f64 = 1.0 / 0.8;
/// A bracket as narrow as this holds nothing better.
const NARROW: f64 = 1.03;

/// A trial as the job records it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Trial {
    asked: u64,
    report: RunReport,
    max: f64,
    rms: f64,
}

/// Simplifies as far as the two-sided deviation, measured, stays within `bound` (input units).
///
/// The report's `target_met` is false, and there is no output, if not even the input as it would be written
/// keeps the bound. Takes the time of three to six runs and measurements.
pub fn simplify(
    bound: f64,
    prepared: Prepared,
    config: &Config,
    progress: &Progress,
) -> Result<Option<RunReport>> {
    verify::refuse_unreadable(config)?;
    let started = Instant::now();
    let disk = Disk::default();
    let n_input = prepared.source.n_triangles();
    let marks = crate::store::job::fingerprint::input_marks(&config.input)?;
    let identity = job_identity(&prepared.source, &marks, config);
    // Every trial opens the input anew.
    drop(prepared);
    let job = Job::open(&config.job_folder, &disk, &identity, config.restart)?;
    disk.create_dir(&job.path(TRIALS))?;
    let kept = match config.min_component {
        None => None,
        Some(_) => match job.sealed("kept", || write_kept(n_input, config, progress)) {
            Ok(kept) => Some(kept),
            Err(error) => return Err(super::abandon(job, error)),
        },
    };
    let mut search = Search { bound, n_input, tried: Vec::new() };
    let mut trials: Vec<Trial> = Vec::new();
    while let Some(asked) = search.next() {
        let name = format!("trial {}", trials.len() + 1);
        let kept = kept.as_deref();
        let found = match job.sealed(&name, || run_trial(asked, kept, config, progress)) {
            Ok(found) => found,
            Err(error) if trials.is_empty() => return Err(super::abandon(job, error)),
            Err(error) => return Err(error),
        };
        search.add(&found);
        trials.push(found);
        if let Some(loser) = search.loser() {
            disk.remove(&trial_path(config, loser))?;
        }
    }
    let best = search.best().and_then(|asked| trials.iter().find(|trial| trial.asked == asked));
    let mut report = match best {
        Some(best) => {
            keep(&job, &disk, config, best)?;
            RunReport {
                target: best.report.output.triangles,
                target_met: true,
                stop_reason: "within the bound".to_owned(),
                ..best.report.clone()
            }
        }
        None => {
            let last = trials.last().map_or(f64::INFINITY, |trial| trial.max);
            let report = trials.last().map(|trial| trial.report.clone()).unwrap_or_default();
            let output = crate::pipeline::run_report::OutputReport {
                path: config.output.display().to_string(),
                ..Default::default()
            };
            let bound = show_length(bound);
            let stop_reason = format!(
                "no result keeps the bound of {bound}: with {n_input} triangles, the input as it would be written, the deviation is {last}; nothing was written"
            );
            RunReport { target: n_input, target_met: false, stop_reason, output, ..report }
        }
    };
    report.output.path = config.output.display().to_string();
    report.settings = identity.settings;
    report.seconds = started.elapsed().as_secs_f64();
    report.triangles_per_second = n_input as f64 / report.seconds.max(1e-9);
    report.peak_memory_bytes = crate::system::memory::peak_bytes();
    report.max_error = Some(BoundReport {
        bound,
        measured_max: best.map(|trial| trial.max),
        measured_rms: best.map(|trial| trial.rms),
        trials: trials
            .iter()
            .map(|trial| TrialReport {
                triangles: trial.report.output.triangles,
                max: trial.max,
                seconds: trial.report.seconds,
            })
            .collect(),
    });
    if !config.keep_temp {
        job.remove()?;
    }
    Ok(Some(report))
}

/// The winner becomes the output; a run that was stopped in between finds that it has it already.
fn keep(job: &Job, disk: &Disk, config: &Config, best: &Trial) -> Result<()> {
    let path = trial_path(config, best.asked);
    let was_writing = job.outcome::<()>(WRITING)?.is_some();
    if !was_writing {
        job.record(WRITING, &())?;
    }
    if was_writing && !path.exists() && config.output.exists() {
        return Ok(());
    }
    let place = Place { path: config.output.clone(), disk: disk.clone(), replace: config.force };
    pending_file::adopt(&path, place)
}

/// Where a trial writes: in the job folder, with the output's extension, which decides the format.
fn trial_path(config: &Config, asked: u64) -> PathBuf {
    let mut name = std::ffi::OsString::from(asked.to_string());
    if let Some(extension) = config.output.extension() {
        name.push(".");
        name.push(extension);
    }
    config.job_folder.join(TRIALS).join(name)
}

/// Writes the geometry of the input without small components among the trials; gives back its path.
fn write_kept(n_input: u64, config: &Config, progress: &Progress) -> Result<PathBuf> {
    let output = config.job_folder.join(TRIALS).join("kept.ply");
    let inner = Config {
        target: Target::Triangles(n_input),
        output: output.clone(),
        job_folder: config.job_folder.join(TRIALS).join("kept"),
        keep_temp: false,
        verify: false,
        force: true,
        restart: false,
        format: OutputFormat { kind: Some(OutputKind::Ply), ..OutputFormat::default() },
        drop_texture: true,
        drop_faces: true,
        attributes: Attributes { normals: Normals::Drop, ..Attributes::default() },
        kernel: kernel::Options {
            topology: kernel::Topology::Keep,
            fit: kernel::Fit::Off,
            ..kernel::Options::default()
        },
        ..config.clone()
    };
    let prepared = prepare(&inner)?;
    super::simplify(prepared, &inner, progress)?;
    Ok(output)
}

/// Runs and measures one trial: against `kept`, if that is another mesh than the input.
fn run_trial(
    asked: u64,
    kept: Option<&Path>,
    config: &Config,
    progress: &Progress,
) -> Result<Trial> {
    let inner = Config {
        target: Target::Triangles(asked),
        output: trial_path(config, asked),
        job_folder: config.job_folder.join(TRIALS).join("job"),
        keep_temp: false,
        force: true,
        restart: false,
        // Measured below, once.
        verify: false,
        ..config.clone()
    };
    let prepared = prepare(&inner)?;
    let mut report = match super::simplify(prepared, &inner, progress) {
        Ok(report) => report.unwrap_or_default(),
        // So few triangles are none: no result, but no reason to end the search either.
        Err(Error::Empty { .. }) => {
            let report = RunReport::default();
            return Ok(Trial { asked, report, max: f64::MAX, rms: f64::MAX });
        }
        Err(error) => return Err(error),
    };
    let started = Instant::now();
    let measured = match kept {
        Some(kept) => Config { input: kept.to_path_buf(), ..config.clone() },
        None => config.clone(),
    };
    let pair = Pair::open(&measured, &inner.output)?;
    let request = pair.request(config, &config.job_folder);
    let comparison = compare::compare(&request, progress)?;
    let deviation = &comparison.measured.deviation;
    let max = deviation.forward.distance.max.max(deviation.backward.distance.max);
    let rms = deviation.rms;
    if config.verify {
        let seconds = started.elapsed().as_secs_f64();
        report.measured = Some(Box::new(compare::Report::new(&request, &comparison, seconds)));
    }
    Ok(Trial { asked, report, max, rms })
}

/// Which count to try next; knows nothing of meshes.
struct Search {
    bound: f64,
    n_input: u64,
    tried: Vec<Tried>,
}

#[derive(Clone, Copy)]
struct Tried {
    asked: u64,
    got: u64,
    max: f64,
    /// Whether the kernel came down to what was asked.
    is_met: bool,
}

impl Search {
    fn add(&mut self, trial: &Trial) {
        let (got, is_met) = (trial.report.output.triangles, trial.report.target_met);
        self.tried.push(Tried { asked: trial.asked, got, max: trial.max, is_met });
    }

    /// Written so that NaN does not keep it.
    fn keeps(&self, tried: &Tried) -> bool {
        tried.max <= self.bound && tried.got > 0
    }

    fn best_tried(&self) -> Option<Tried> {
        let kept = self.tried.iter().filter(|tried| self.keeps(tried));
        kept.min_by_key(|tried| (tried.got, tried.asked)).copied()
    }

    /// The trial with the fewest triangles of those that keep the bound.
    fn best(&self) -> Option<u64> {
        self.best_tried().map(|tried| tried.asked)
    }

    /// The trial whose file the last one made useless: its own, or that of the best before it.
    fn loser(&self) -> Option<u64> {
        let (last, earlier) = self.tried.split_last()?;
        let before = Search { tried: earlier.to_vec(), ..*self }.best();
        if self.best() == Some(last.asked) { before } else { Some(last.asked) }
    }

    fn next(&self) -> Option<u64> {
        let n = self.tried.len();
        let high = self.best_tried();
        let below = |tried: &&Tried| high.is_none_or(|high| tried.asked < high.asked);
        let low = self.tried.iter().filter(|tried| !self.keeps(tried)).filter(below);
        let low = low.max_by_key(|tried| tried.asked).copied();
        let aim = AIM * self.bound;
        let guess = |from: Tried, least: f64, most: f64| {
            let factor = (from.max / aim).powf(COUNT_EXPONENT);
            let factor = if from.max > 0.0 { factor.clamp(least, most) } else { least };
            from.asked as f64 * factor
        };
        let wanted = match (low, high) {
            (None, None) => self.n_input as f64 / 10.0,
            (Some(low), None) if low.asked >= self.n_input => return None,
            (Some(low), None) => {
                // Out of trials is no reason to give nothing at all: the input itself comes last.
                if n + 1 >= MOST_TRIALS { f64::INFINITY } else { guess(low, 1.2, 16.0) }
            }
            (low, Some(high)) => {
                let enough = high.max >= 0.5 * self.bound && high.max > 0.0 || !high.is_met;
                if enough || n >= MOST_TRIALS || high.asked <= 2 {
                    return None;
                }
                match low {
                    None => guess(high, 1.0 / 16.0, 1.0 / 1.2),
                    Some(low) => {
                        let (a, b) = (low.asked.max(1) as f64, high.asked as f64);
                        if b / a <= NARROW || high.asked - low.asked <= 2 {
                            return None;
                        }
                        let share = (low.max / aim).ln() / (low.max / high.max).ln();
                        let share = if n >= HALVE_FROM || share.is_nan() { 0.5 } else { share };
                        a * (b / a).powf(share.clamp(0.15, 0.85))
                    }
                }
            }
        };
        let next = (wanted.min(self.n_input as f64) as u64).max(2);
        self.tried.iter().all(|tried| tried.asked != next).then_some(next)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Follows a law of the deviation to the end; what it settled on, and the number of trials.
    fn settle(bound: f64, law: impl Fn(u64) -> f64) -> (Option<Tried>, usize) {
        let mut search = Search { bound, n_input: 1_000_000, tried: Vec::new() };
        while let Some(asked) = search.next() {
            let max = law(asked);
            search.tried.push(Tried { asked, got: asked, max, is_met: true });
            assert!(search.tried.len() <= MOST_TRIALS);
        }
        (search.best_tried(), search.tried.len())
    }

    #[test]
    fn the_search_ends_between_half_the_bound_and_the_bound() {
        for exponent in [-0.5, -0.8, -1.3] {
            for bound in [1e-5, 1e-3, 0.3] {
                // The input itself does not deviate.
                let law = |count| match count {
                    1_000_000 => 0.0,
                    _ => (count as f64 / 1000.0_f64).powf(exponent) * 0.01,
                };
                let (best, n) = settle(bound, law);
                let best = best.unwrap();
                assert!(best.max <= bound, "{exponent} {bound}");
                let dense = best.max < 0.5 * bound;
                let is_least = best.asked <= 2 || best.asked as f64 > 1e6 / NARROW;
                assert!(
                    !dense || is_least || law(best.asked - best.asked / 20) > bound,
                    "{exponent} {bound}: {} {n}",
                    best.max
                );
                assert!(n <= 9 || is_least, "{exponent} {bound}: {n} trials");
            }
        }
    }

    #[test]
    fn a_leap_is_narrowed_down_and_the_impossible_given_up() {
        let (best, _) = settle(1.0, |count| if count < 123_456 { 9.0 } else { 0.1 });
        let asked = best.unwrap().asked;
        assert!((123_456..127_500).contains(&asked), "{asked}");
        assert!(settle(0.0, |_| 1e-9).0.is_none());
        assert_eq!(settle(0.0, |_| 0.0).0.unwrap().asked, 2);
    }
}
