//! `--optimize`: a result of any method as usual, then made to fit the original better at the same count.
//!
//! The result goes into a file in the job folder first, so a run that was interrupted continues there, and begins the
//! optimisation, which works in memory, from its start. Points of the original come out of cells that vanish afterwards.

pub(super) mod check;

use super::derived::{DerivedRun, derive, open, settings};
use super::prepare::prepare;
use super::run_report::{OutputReport, RunReport, StageReport};
use super::{methods, pairs};
use crate::config::{Config, Method};
use crate::error::Result;
use crate::io::ply::MeshSource;
use crate::measure::load::load_with;
use crate::measure::temp_store::Cutting;
use crate::methods::Made;
use crate::optimize::{self, Drawing, Settings};
use crate::store::job::fingerprint::{input_marks, unchanged};
use crate::system::memory::BASE_BYTES;
use crate::system::progress::Progress;
use std::path::Path;
use std::time::Instant;

/// Steps that progress counts after the result: points, sweeps, writing.
const N_STEPS: u32 = 3;

/// Simplifies the input by any method, then optimises the result.
pub fn simplify(source: MeshSource, config: &Config, progress: &Progress) -> Result<RunReport> {
    let marks = input_marks(&config.input)?;
    let report = derive(source, &marks, config, progress, |run, source| {
        // The run before opens the input itself.
        drop(source);
        optimize_result(run).map(Some)
    })?;
    Ok(report.expect("an optimisation does not end early"))
}

fn optimize_result(run: &DerivedRun) -> Result<RunReport> {
    let DerivedRun { job, disk, config, progress, marks } = run;
    let path = run.inner_path("result.ply")?;
    let mut report = run.part("result", || run_before(&path, config, progress))?;
    report.seconds = 0.0;
    job.clear_scratch()?;
    let result = open(&path.as_path().into(), config, false)?;
    let codec = result.schema().kernel_codec(&config.attributes.labels);
    let mesh = load_with(&result, Some(&codec), config.threads.get(), progress)?.mesh;
    let mut made = Made { mesh, ..Made::default() };
    if !result.schema().properties.is_empty() {
        result.each_vertex_block(|block| {
            made.records.extend_from_slice(&block.records);
            Ok(())
        })?;
    }
    let n_triangles = made.mesh.triangles.len() as u64;
    let start = Instant::now();
    progress.begin("points", 1, N_STEPS, report.input.triangles);
    let input = open(&config.input, config, config.skip_bad)?;
    let in_memory = check::needed_bytes(&result, n_triangles);
    let drawing = Drawing {
        n_triangles,
        origin: optimize::centre(&made.mesh),
        cutting: Cutting {
            cell_triangles: config.cell_triangles,
            temp_dir: job.folder(),
            threads: config.threads.get(),
            memory_bytes: (config.memory_bytes - BASE_BYTES).saturating_sub(in_memory / 2),
            disk: Some(disk),
        },
        progress,
    };
    let drawn = optimize::draw(&input, drawing);
    let samples = unchanged(&config.input, marks, drawn)?;
    let n_input = report.input.triangles;
    report.stages.push(StageReport::since(
        "points",
        start,
        (n_input, n_input),
        (input.file_bytes(), 0),
    ));
    drop(input);
    let start = Instant::now();
    let sweeps = config.optimize.unwrap_or(0);
    progress.begin("optimize", 2, N_STEPS, u64::from(sweeps));
    let settings = Settings { sweeps, threads: config.threads.get(), progress };
    let outcome = optimize::optimize(&mut made.mesh, &mut made.records, samples, settings)?;
    report.stages.push(StageReport::since("optimize", start, (n_triangles, n_triangles), (0, 0)));
    report.stages.push(run.write(&result, &made, &codec, N_STEPS)?);
    report.output = OutputReport {
        path: config.output.display().to_string(),
        vertices: made.mesh.positions.len() as u64,
        triangles: n_triangles,
    };
    report.optimization = Some(outcome);
    Ok(report)
}

/// Runs the method into a file in the job folder.
fn run_before(path: &Path, config: &Config, progress: &Progress) -> Result<RunReport> {
    let inner = Config { optimize: None, ..settings(path, config) };
    if inner.method != Method::Collapse {
        return methods::simplify(methods::prepare(&inner, progress)?, &inner, progress);
    }
    if inner.pairs {
        return pairs::simplify(prepare(&inner)?.source, &inner, progress);
    }
    let report = super::simplify(prepare(&inner)?, progress)?;
    let Some(report) = report else {
        unreachable!("a run before an optimisation does not end early")
    };
    Ok(report)
}
