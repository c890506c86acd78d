//! `--optimize`: a result of any method as usual, then made to fit the original better at the same count.
//!
//! The result goes into a file in the job folder first, so a run that was interrupted continues there, and begins the
//! optimisation, which works in memory, from its start. Points of the original come out of cells that vanish afterwards.

pub(super) mod check;

use super::concluded::{WRITING, abandon, concluded};
use super::first_run::{open, settings, stage};
use super::methods::{self, PreparedMethod};
use super::prepare::{Prepared, prepare};
use super::run_report::{OutputReport, RunReport};
use super::{pairs, verify};
use crate::config::{Config, Method};
use crate::error::Result;
use crate::io::ply::{FaceBlock, MeshSource, VertexBlock};
use crate::measure::temp_store::Cutting;
use crate::mesh::Mesh;
use crate::methods::Made;
use crate::optimize::{self, Drawing, Settings};
use crate::store::job::fingerprint::{input_marks, job_identity, unchanged};
use crate::store::job::{Job, TRIALS};
use crate::system::disk::Disk;
use crate::system::memory::{BASE_BYTES, peak_bytes};
use crate::system::parallel::guarded;
use crate::system::progress::Progress;
use std::path::Path;
use std::time::Instant;

/// Steps that progress counts after the result: points, sweeps, writing.
const N_STEPS: u32 = 3;

/// Simplifies by the collapse of edges, then optimises the result.
pub fn simplify(prepared: Prepared, config: &Config, progress: &Progress) -> Result<RunReport> {
    let source = prepared.source;
    guarded(|| run(source, config, progress))
}

/// The same by another method.
pub fn simplify_by_method(
    prepared: PreparedMethod,
    config: &Config,
    progress: &Progress,
) -> Result<RunReport> {
    let source = prepared.into_source();
    guarded(|| run(source, config, progress))
}

fn run(source: MeshSource, config: &Config, progress: &Progress) -> Result<RunReport> {
    let started = Instant::now();
    let disk = Disk::default();
    let marks = input_marks(&config.input)?;
    let identity = job_identity(&source, &marks, config);
    // The run before opens the input itself.
    drop(source);
    if let Some(report) = concluded(&disk, &identity, config)? {
        return Ok(report);
    }
    let job = Job::open(&config.job_folder, &disk, &identity, config.restart)?;
    disk.create_dir(&job.path(TRIALS))?;
    let path = job.path(TRIALS).join("result.ply");
    let report = job.sealed("result", || run_before(&path, config, progress));
    let mut report = match report {
        Ok(report) => report,
        Err(error) => return Err(abandon(&job, error)),
    };
    job.clear_scratch()?;
    let result = open(&path, config, false)?;
    let codec = result.schema().kernel_codec(&config.attributes.labels);
    let mut made = load(&result, config, progress)?;
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
            disk: Some(&disk),
        },
        progress,
    };
    let drawn = optimize::draw(&input, drawing);
    let samples = unchanged(&config.input, &marks, drawn)?;
    let n_input = report.input.triangles;
    report.stages.push(stage("points", start, (n_input, n_input), (input.file_bytes(), 0)));
    drop(input);
    let start = Instant::now();
    let sweeps = config.optimize.unwrap_or(0);
    progress.begin("optimize", 2, N_STEPS, u64::from(sweeps));
    let settings = Settings { sweeps, threads: config.threads.get(), progress };
    let outcome = optimize::optimize(&mut made.mesh, &mut made.records, samples, settings)?;
    report.stages.push(stage("optimize", start, (n_triangles, n_triangles), (0, 0)));
    let start = Instant::now();
    if job.outcome::<()>(WRITING)?.is_none() {
        job.record(WRITING, &())?;
    }
    progress.begin("write", N_STEPS, N_STEPS, n_triangles);
    let bytes = methods::write::write(&result, &made, &codec, config, &disk, progress)?;
    report.stages.push(stage("write", start, (n_triangles, n_triangles), (0, bytes)));
    report.output = OutputReport {
        path: config.output.display().to_string(),
        vertices: made.mesh.positions.len() as u64,
        triangles: n_triangles,
    };
    report.optimization = Some(outcome);
    report.settings = identity.settings;
    report.seconds = started.elapsed().as_secs_f64();
    report.triangles_per_second = n_input as f64 / report.seconds.max(1e-9);
    report.peak_memory_bytes = peak_bytes();
    report.peak_temp_bytes = report.peak_temp_bytes.max(disk.peak_bytes());
    drop(made);
    verify::end(&job, config, progress, &mut report)?;
    Ok(report)
}

/// Runs the method into a file in the job folder.
fn run_before(path: &Path, config: &Config, progress: &Progress) -> Result<RunReport> {
    let inner = Config { optimize: None, ..settings(path, config) };
    if inner.method != Method::Collapse {
        return methods::simplify(methods::prepare(&inner, progress)?, &inner, progress);
    }
    if inner.pairs {
        return pairs::simplify(prepare(&inner)?, &inner, progress);
    }
    let report = super::simplify(prepare(&inner)?, &inner, progress)?;
    let Some(report) = report else {
        unreachable!("a run before an optimisation does not end early")
    };
    Ok(report)
}

/// Reads the result with what its vertices carry.
fn load(source: &MeshSource, config: &Config, progress: &Progress) -> Result<Made> {
    let schema = source.schema();
    let codec = schema.kernel_codec(&config.attributes.labels);
    let record_bytes = schema.record_bytes();
    let mut mesh = Mesh { n_channels: codec.n_channels(), ..Mesh::default() };
    let mut records = Vec::new();
    let mut block = VertexBlock::default();
    for index in 0..source.n_vertex_blocks() {
        progress.check()?;
        source.read_vertices(index, &mut block)?;
        for record in block.records.chunks_exact(record_bytes) {
            mesh.positions.push(schema.position(record));
            let start = mesh.channels.len();
            mesh.channels.resize(start + mesh.n_channels, 0.0);
            codec.decode_channels(record, &mut mesh.channels[start..]);
        }
        if !schema.properties.is_empty() {
            records.extend_from_slice(&block.records);
        }
    }
    let mut block = FaceBlock::default();
    for index in 0..source.n_face_blocks() {
        progress.check()?;
        source.read_faces(index, &mut block)?;
        // The result has fewer vertices than 2^32: it fits into memory as it is.
        mesh.triangles.extend(block.triangles.iter().map(|t| t.map(|v| v as u32)));
    }
    Ok(Made { mesh, records, ..Made::default() })
}
