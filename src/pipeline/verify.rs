//! `simplify --verify`: measures the finished output against the input and certifies how far they are apart at most,
//! for the run's report. Counts there, too, whether a result is solid that was to be (`--close`, `--orient`, ...).
//!
//! From the input file: the job's own cells are freed one by one as they are simplified, so at the end
//! there is nothing left to measure against. Runs before the job folder goes, so that an interrupted
//! verification is taken up again by the same command. Changes neither input nor output.

use crate::config::Config;
use crate::error::{Error, Result};
use crate::io::InputPaths;
use crate::io::ply::{MeshSource, ReadOptions};
use crate::io::{OutputKind, SIDES, StageOptions};
use crate::kernel::is_off_volume;
use crate::measure::compare::{self, Report, Request};
use crate::measure::labelled_regions::{LabelledRegion, RegionLimits, regions};
use crate::measure::solid::{self, Solid};
use crate::measure::{Certify, Options, check};
use crate::mesh::bounds::Bounds;
use crate::mesh::face_properties::FacePolicy;
use crate::pipeline::run_report::{RunReport, StageReport};
use crate::store::job::Job;
use crate::store::stage_context::StageContext;
use crate::system::disk::folder_of;
use crate::system::progress::Progress;
use std::collections::HashMap;
use std::path::Path;
use std::time::Instant;

/// Width of the certificate, relative to its upper end.
pub(crate) const TOLERANCE: f64 = 0.01;

/// Refuses what cannot be read again after the run.
pub fn refuse_unreadable(config: &Config) -> Result<()> {
    let standard = Path::new("-");
    let what = if config.input == standard {
        "standard input cannot be read again"
    } else if config.output == standard {
        "standard output cannot be read"
    } else if config.kind()? == OutputKind::Glb {
        "GLB rounds positions; write a PLY and convert it"
    } else {
        return Ok(());
    };
    Err(Error::Usage(format!("the result cannot be measured (--verify, --max-error): {what}")))
}

/// The input and the output of a run, opened again from their files.
pub struct MeasuredPair {
    pub(crate) original: MeshSource,
    pub(crate) simplified: MeshSource,
}

impl MeasuredPair {
    /// Opens the input as the run did, and what it wrote.
    pub fn open(config: &Config, output: &Path) -> Result<MeasuredPair> {
        let (original, simplified) = (
            open(config, config.input.clone(), config.read_options())?,
            open(config, output.into(), ReadOptions::default())?,
        );
        Ok(MeasuredPair { original, simplified })
    }

    /// The comparison of both with the threads and the memory of the run; temporary files go into `temp_dir`.
    pub fn request(&self, config: &Config, temp_dir: &Path) -> Request<'_> {
        Request {
            original: &self.original,
            simplified: &self.simplified,
            options: Options { threads: config.threads.get(), ..Options::default() },
            memory_bytes: config.memory_bytes,
            cell_triangles: config.cell_triangles,
            temp_dir: temp_dir.to_path_buf(),
            heat: false,
        }
    }

    fn file_bytes(&self) -> u64 {
        self.original.file_bytes() + self.simplified.file_bytes()
    }
}

fn open(config: &Config, path: InputPaths, read: ReadOptions) -> Result<MeshSource> {
    let stage = StageOptions { read, ..StageOptions::new(folder_of(&config.job_folder)) };
    MeshSource::open_staged(path, &stage.within(config.memory_bytes))
}

/// The end of a run that holds nothing any more: looks at its output as was asked for, and gives up its job folder.
pub fn end(job: &Job, config: &Config, progress: &Progress, report: &mut RunReport) -> Result<()> {
    let run = StageContext {
        job,
        progress,
        threads: config.threads.get(),
        memory_bytes: config.memory_bytes,
        checkpoint_every: config.checkpoint_every,
    };
    look(config, &run, report)?;
    if !config.job.keep_temp {
        super::concluded::conclude(job, config, report)?;
    }
    Ok(())
}

/// Measures every output if that was asked for and has not been done, and counts whether it is solid where it was to be.
pub fn look(config: &Config, run: &StageContext, report: &mut RunReport) -> Result<()> {
    if config.checks.verify && report.measured.is_none() {
        verify(config, run, report)?;
    }
    let asks =
        config.close.is_some() || config.kernel.orient || config.kernel.no_self_intersections;
    if asks && config.trial_of.is_none() && config.output != Path::new("-") {
        let start = Instant::now();
        for (level, output) in config.outputs().enumerate() {
            let solid = Some(look_at(output, config, run, report)?);
            report.solid = solid;
            if let Some(level) = report.levels.get_mut(level) {
                level.solid = solid;
            }
        }
        report.seconds += start.elapsed().as_secs_f64();
    }
    if has_walls(report) && config.trial_of.is_none() && refuse_unreadable(config).is_ok() {
        for output in config.outputs() {
            let (opened, off) = faulty_regions(output, config, run)?;
            report.opened_region_edges = report.opened_region_edges.max(opened);
            report.regions_off_volume = report.regions_off_volume.max(off);
        }
    }
    Ok(())
}

/// Returns whether faces of the result have the regions on both their sides.
fn has_walls(report: &RunReport) -> bool {
    let is_carried = |side: &str| {
        let mut properties = report.face_properties.iter();
        properties.any(|p| p.name == side && p.carried != FacePolicy::Dropped)
    };
    SIDES.into_iter().all(is_carried)
}

/// A region of this many triangles holds its volume to 2 %.
const ENOUGH_FOR_VOLUME: u64 = 100;

/// Counts the edges at which regions are open in an output that were closed in the input, and the regions of another volume than there.
fn faulty_regions(output: &Path, config: &Config, run: &StageContext) -> Result<(u64, u64)> {
    run.job.clear_scratch()?;
    let limits = RegionLimits { temp_dir: run.job.folder(), memory_bytes: run.memory_bytes };
    let find = |path, read| {
        let found = regions(&open(config, path, read)?, limits, run.progress)?;
        Ok::<_, Error>(found.unwrap_or_default())
    };
    let after = find(output.into(), ReadOptions::default())?;
    let are_coarse = after.largest.iter().any(|region| region.triangles < ENOUGH_FOR_VOLUME);
    // The input only where something may be wrong: it may be large.
    if after.open_edges == 0 && !are_coarse {
        return Ok((0, 0));
    }
    let before = find(config.input.clone(), config.read_options())?;
    if before.open_edges > 0 {
        return Ok((0, 0));
    }
    let volumes: HashMap<i64, f64> =
        after.largest.iter().map(|region| (region.label, region.volume)).collect();
    let is_off = |region: &&LabelledRegion| {
        region.triangles >= ENOUGH_FOR_VOLUME
            && volumes
                .get(&region.label)
                .is_some_and(|&volume| is_off_volume(volume / region.volume))
    };
    Ok((after.open_edges, before.largest.iter().filter(is_off).count() as u64))
}

/// Counts what was not to be in an output.
fn look_at(
    output: &Path,
    config: &Config,
    run: &StageContext,
    report: &RunReport,
) -> Result<Solid> {
    run.job.clear_scratch()?;
    let [low, high] = report.input.bounds;
    let largest = config.close.map(|size| size.length(Bounds { low, high }.diagonal()));
    let cutting = check::cutting(run.job.folder(), run.threads, run.memory_bytes, true);
    let source = open(config, output.into(), ReadOptions::default())?;
    let found = solid::look(&source, largest.unwrap_or(f64::INFINITY), cutting, run.progress)?;
    let refuses = config.kernel.no_self_intersections;
    let is_manifold = found.non_manifold_edges == 0 && found.touching_vertices.unwrap_or(0) == 0;
    // Walls face as their regions lie.
    let has_walls = has_walls(report);
    let found = Solid {
        bodies_inside_out: found.bodies_inside_out.filter(|_| config.kernel.orient && !has_walls),
        ..found
    };
    let met = (largest.is_none() || found.open_edges == 0)
        && (largest.is_none() || !refuses || is_manifold)
        && (!config.kernel.orient || found.inconsistent_edges == 0)
        && found.bodies_inside_out.unwrap_or(0) == 0
        && (!refuses || found.self_intersections == 0);
    Ok(Solid { met, ..found })
}

/// Adds what was measured of every output to the report as one more stage each; its seconds then include them.
fn verify(config: &Config, run: &StageContext, report: &mut RunReport) -> Result<()> {
    for (level, output) in config.outputs().enumerate() {
        verify_output(output, config, run, report)?;
        if let Some(level) = report.levels.get_mut(level) {
            level.rms = report.measured.as_ref().map(|measured| measured.deviation.rms);
            level.hausdorff = report.hausdorff.clone();
        }
    }
    Ok(())
}

fn verify_output(
    output: &Path,
    config: &Config,
    run: &StageContext,
    report: &mut RunReport,
) -> Result<()> {
    let start = Instant::now();
    // What a verification that was killed has left.
    run.job.clear_scratch()?;
    let pair = MeasuredPair::open(config, output)?;
    let mut request = pair.request(config, run.job.folder());
    request.options.certify = Some(Certify { tolerance: TOLERANCE, bound: None });
    let comparison = compare::compare(&request, run.progress)?;
    let seconds = start.elapsed().as_secs_f64();
    let triangles = (report.input.triangles, report.output.triangles);
    let bytes = (pair.file_bytes() + comparison.temp_bytes, comparison.temp_bytes);
    report.stages.push(StageReport {
        peak_temp_bytes: comparison.temp_bytes,
        ..StageReport::since("verify", start, triangles, bytes)
    });
    report.seconds += seconds;
    report.peak_memory_bytes = crate::system::memory::peak_bytes();
    report.peak_temp_bytes = report.peak_temp_bytes.max(comparison.temp_bytes);
    report.hausdorff = comparison.measured.certificate.clone();
    report.measured = Some(Box::new(Report::new(&request, &comparison, seconds)));
    Ok(())
}
