//! `--pairs`: the collapse to some times the target, pairs of vertices in memory, the collapse to the target.
//!
//! Gaps matter where they are as wide as triangles are long, thus near the target. So the cells on disk and the kernel stay as they
//! are, memory is by the size of the result, and the kernel places what is left. Both meshes on the way lie in the job
//! folder, sealed: a run that was interrupted continues behind them.

pub(super) mod counts;

use super::derived::{DerivedRun, derive, open, settings, trial_path};
use super::methods;
use super::prepare::prepare;
use super::run_report::{OutputReport, RunReport, StageReport};
use crate::config::{Attributes, Config, Normals, Target};
use crate::error::{Error, Result};
use crate::io::OutputFormat;
use crate::io::ply::MeshSource;
use crate::kernel;
use crate::methods::pairs;
use crate::methods::{MethodReport, PairsReport};
use crate::store::job::fingerprint::input_marks;
use crate::system::disk::Disk;
use crate::system::progress::Progress;
use counts::Counts;
use std::path::Path;
use std::time::Instant;

/// Simplifies by the collapse of edges, with contractions of pairs on the way.
pub fn simplify(source: MeshSource, config: &Config, progress: &Progress) -> Result<RunReport> {
    let marks = input_marks(&config.input)?;
    let target = config.target.triangles(source.n_triangles());
    let counts = Counts::new(source.n_triangles(), target);
    let report = derive(source, &marks, config, progress, |run, source| {
        // The run before opens the input itself.
        drop(source);
        in_turn(run, counts, target).map(Some)
    })?;
    Ok(report.expect("a run with pairs does not end early"))
}

/// The collapse, pairs, and the collapse again.
fn in_turn(run: &DerivedRun, counts: Counts, target: u64) -> Result<RunReport> {
    let DerivedRun { job, disk, config, progress, .. } = run;
    let fine = run.inner_path("result.ply")?;
    let mut report = run.part("result", || {
        let inner = settings(&fine, config);
        let inner = Config { pairs: false, target: Target::Triangles(counts.before), ..inner };
        collapse(&inner, progress)
    })?;
    let joined = run.inner_path("joined.ply")?;
    let (pairs, stages) =
        run.part("pairs", || contract(&fine, &joined, counts, config, disk, progress))?;
    let made = trial_path(config, "last");
    let kind = config.kind()?;
    let last = Config {
        input: joined.into(),
        output: made.clone(),
        target: Target::Triangles(target),
        format: OutputFormat { kind: Some(kind), ..config.format },
        skip_bad: false,
        min_component: None,
        kernel: kernel::Options { fit: fit(config), ..config.kernel.clone() },
        ..settings(&fine, config)
    };
    let is_there = made.exists() || run.is_delivered(&made)?;
    let last = match job.outcome::<RunReport>("last")? {
        Some(done) if is_there => done,
        _ => {
            let done = collapse(&last, progress)?;
            job.record("last", &done)?;
            done
        }
    };
    run.deliver(&made)?;
    job.clear_scratch()?;
    report.stages.extend(stages);
    report.stages.extend(last.stages);
    report.pairs = Some(pairs);
    report.output =
        OutputReport { path: config.output.display().to_string(), ..last.output.clone() };
    report.quality = last.quality;
    (report.target, report.target_met) = (target, last.target_met);
    (report.stop_reason, report.fit) = (last.stop_reason, last.fit);
    report.seconds = 0.0;
    Ok(report)
}

/// A run of the collapse, to its end.
fn collapse(config: &Config, progress: &Progress) -> Result<RunReport> {
    let report = super::simplify(prepare(config)?, progress)?;
    let Some(report) = report else { unreachable!("a run without --until does not end early") };
    Ok(report)
}

/// The last collapse begins from a mesh of some times the target: vertices are fitted to that, unless the fit is off.
fn fit(config: &Config) -> kernel::Fit {
    match config.kernel.fit {
        kernel::Fit::Off => kernel::Fit::Off,
        kernel::Fit::On | kernel::Fit::Auto => kernel::Fit::On,
    }
}

/// Contracts pairs of the mesh at `fine` into a file at `joined`.
fn contract(
    fine: &Path,
    joined: &Path,
    counts: Counts,
    config: &Config,
    disk: &Disk,
    progress: &Progress,
) -> Result<(PairsReport, Vec<StageReport>)> {
    let source = open(&fine.into(), config, false)?;
    let codec = source.schema().kernel_codec(&config.attributes.labels);
    let n_before = source.n_triangles();
    let start = Instant::now();
    let wanted = pairs::Settings { target: counts.joined, codec: &codec };
    let made = pairs::contract_pairs(&source, wanted, progress)?;
    let n_out = made.mesh.triangles.len() as u64;
    if n_out == 0 {
        let what = "no triangle is left; ask for more; nothing was written".to_owned();
        return Err(Error::Empty { path: config.output.clone(), what });
    }
    let inner = settings(joined, config);
    let attributes = Attributes { normals: Normals::Keep, ..config.attributes.clone() };
    let inner = Config { attributes, ..inner };
    let bytes = methods::write::write(&source, &made, &codec, &inner, disk, progress)?;
    let stage = StageReport::since("pairs", start, (n_before, n_out), (source.file_bytes(), bytes));
    let MethodReport::Pairs(report) = made.report else {
        unreachable!("pairs report their contractions");
    };
    Ok((report, vec![stage]))
}
