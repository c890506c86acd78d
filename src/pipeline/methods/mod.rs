//! Runs of the methods of `methods/`: opened, planned, run, written, reported and measured as runs of the collapse are.
//!
//! One stage from the input to the result in memory, so there is nothing to continue: the job folder holds the lock, and a
//! run that was interrupted starts over. Texture coordinates and properties of faces are not carried.

mod plan;
pub(super) mod write;

use super::concluded::abandon;
use super::derived::{DerivedRun, derive};
use super::optimize::check::check as check_optimize;
use super::prepare::{before_opening, check_labels};
use super::run_report::{FaceReport, InputReport, OutputReport, RunReport};
use super::run_report::{QualityReport, StageReport, StopReason};
use crate::config::{Config, Method, Target};
use crate::error::{Error, Result};
use crate::io::materials::{MapKind, Materials};
use crate::io::ply::{MeshSource, type_name};
use crate::io::{check_range, find_texture, survey_labels};
use crate::mesh::face_properties::FacePolicy;
use crate::mesh::outward::volume;
use crate::mesh::vec3::{length_sq, sub};
use crate::methods::cluster::{self, Survey, Wanted};
use crate::methods::{GridReport, Made, MethodReport};
use crate::methods::{decimate, retile};
use crate::store::job::fingerprint::{marks_beside, unchanged};
use crate::system::json_keys::SCHEMA_VERSION;
use crate::system::losses::Ledger;
use crate::system::memory::BASE_BYTES;
use crate::system::parallel::guarded;
use crate::system::progress::Progress;
pub use plan::MethodPlan;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Instant;

/// A re-tiling that leaves less than one over this of the triangles wanted has collapsed where walls are thinner than them.
const LEAST_OF_TARGET: u64 = 2;

/// Steps that progress counts: the method and the writing.
const N_STEPS: u32 = 2;

/// An input that has been opened, surveyed and planned for; nothing has been written yet.
pub struct PreparedMethod {
    source: MeshSource,
    marks: BTreeMap<String, String>,
    survey: Option<Survey>,
    /// Plan of the run.
    pub plan: MethodPlan,
    faces: Vec<FaceReport>,
    stages: Vec<StageReport>,
    started: Instant,
}

impl PreparedMethod {
    /// Parts of the input that its reader has no place for.
    pub fn losses(&self) -> Ledger {
        self.source.losses()
    }

    /// The input alone.
    pub fn into_source(self) -> MeshSource {
        self.source
    }
}

/// Opens the input, surveys its vertices and plans the run.
///
/// Errors: those of opening; `Usage` for what the method cannot do; `NoMemory` where the result's tables exceed the budget.
pub fn prepare(config: &Config, progress: &Progress) -> Result<PreparedMethod> {
    guarded(|| prepare_unguarded(config, progress))
}

fn prepare_unguarded(config: &Config, progress: &Progress) -> Result<PreparedMethod> {
    let started = Instant::now();
    let (mut marks, stage) = before_opening(config)?;
    let source = MeshSource::open_staged(&config.input, &stage).and_then(|mut source| {
        source.refuse_output(&config.textures_beside)?;
        check_labels(&source, &config.attributes.labels)?;
        if !config.drop_texture {
            source.require_no_texture()?;
            let has_images = |all: &Arc<Materials>| all.has_image(|map| map == MapKind::Base);
            if source.materials().is_some_and(has_images) && find_texture(source.schema()).is_some() {
                return Err(Error::bad_input(
                    source.path(),
                    "its vertices have texture coordinates for images, which this method would leave out; simplify \
                     without --method, or give the texture up with --drop-texture",
                ));
            }
        }
        survey_labels(&mut source, &config.attributes.labels)?;
        Ok(source)
    });
    let source = unchanged(&config.input, &marks, source)?;
    marks.extend(marks_beside(&source));
    source.require_faces()?;
    check_range(&source, &config.output, config.format)?;
    config.target.check(source.n_triangles())?;
    let (wanted, target) = match config.target {
        Target::CellSize(size) => (Wanted::CellSize(size), None),
        other => {
            let n = other.triangles(source.n_triangles());
            (Wanted::Triangles(n), Some(n))
        }
    };
    let start = Instant::now();
    let mut stages = Vec::new();
    let survey = match config.method {
        Method::Cluster { .. } => {
            let n = source.n_triangles();
            progress.begin("survey", 1, N_STEPS, n);
            let survey = cluster::survey(&source, wanted, config.threads.get(), progress);
            let survey = unchanged(&config.input, &marks, survey)?;
            let vertex_bytes = source.n_vertices() * source.schema().record_bytes() as u64;
            stages.push(StageReport::since("survey", start, (n, n), (3 * vertex_bytes, 0)));
            Some(survey)
        }
        Method::Decimate { .. } | Method::Retile { .. } | Method::Collapse => None,
    };
    let plan = MethodPlan::new(&source, survey.as_ref(), target, config)?;
    check_optimize(&source, plan.expected_triangles, config)?;
    plan.check_disk(config)?;
    let faces = dropped_faces(&source, config);
    Ok(PreparedMethod { source, marks, survey, plan, faces, stages, started })
}

/// Lists what faces carry, which no vertex of a cell can.
fn dropped_faces(source: &MeshSource, config: &Config) -> Vec<FaceReport> {
    let reason = match config.drop_faces {
        true => "given up".to_owned(),
        false => format!("--method {} does not carry what faces have", config.method.name()),
    };
    let dropped = |p: &crate::mesh::property::Property| FaceReport {
        name: p.name.clone(),
        scalar: type_name(p.scalar).to_owned(),
        carried: FacePolicy::Dropped,
        reason: Some(reason.clone()),
    };
    source.face_properties().iter().map(dropped).collect()
}

/// Runs the method and writes its result.
pub fn simplify(
    prepared: PreparedMethod,
    config: &Config,
    progress: &Progress,
) -> Result<RunReport> {
    let PreparedMethod { source, marks, survey, plan, faces, stages, started } = prepared;
    crate::system::memory::keep_nothing_back();
    let before = started.elapsed().as_secs_f64();
    let report = derive(source, &marks, config, progress, |run, source| {
        let mut report = simplify_in_memory(run, &source, survey.as_ref(), &plan)?;
        report.face_properties = faces;
        report.stages.splice(0..0, stages);
        report.seconds = before;
        Ok(Some(report))
    })?;
    Ok(report.expect("another method does not end early"))
}

fn simplify_in_memory(
    run: &DerivedRun,
    source: &MeshSource,
    survey: Option<&Survey>,
    plan: &MethodPlan,
) -> Result<RunReport> {
    let DerivedRun { job, config, progress, marks, .. } = run;
    let codec = source.schema().kernel_codec(&config.attributes.labels);
    let n_in = source.n_triangles();
    let start = Instant::now();
    let codec = &codec;
    let made = match (config.method, survey) {
        (Method::Retile { gradation }, _) => {
            let memory_bytes = config.memory_bytes.saturating_sub(BASE_BYTES);
            let target = plan.target;
            let settings = retile::Settings { target, gradation, memory_bytes, codec };
            retile::retile(source, settings, progress)
        }
        (Method::Decimate { feature_angle }, _) => {
            let settings = decimate::Settings { target: plan.target, feature_angle, codec };
            decimate::decimate(source, settings, progress)
        }
        (Method::Cluster { .. }, Some(survey)) => {
            let wanted = match config.target {
                Target::CellSize(size) => Wanted::CellSize(size),
                _ => Wanted::Triangles(plan.target),
            };
            let settings = cluster::Settings {
                wanted,
                survey,
                codec,
                threads: config.threads.get(),
                position_bytes: plan.position_memory_bytes,
            };
            cluster::cluster(source, settings, progress)
        }
        (Method::Collapse | Method::Cluster { .. }, _) => {
            unreachable!("the collapse has another way, and a grid was surveyed")
        }
    };
    source.remarks()?.into_iter().for_each(|remark| progress.lose(remark));
    let made = match unchanged(&config.input, marks, made) {
        Ok(made) if made.mesh.triangles.is_empty() => Err(nothing_left(config, source, &made)),
        other => other,
    };
    let made = match made {
        Ok(mut made) => {
            if config.method == (Method::Cluster { manifold: true }) {
                made.take_apart();
            }
            made
        }
        Err(error) => return Err(abandon(job, error)),
    };
    let n_out = made.mesh.triangles.len() as u64;
    let read = (source.file_bytes(), 0);
    let stages = vec![
        StageReport::since(config.method.name(), start, (n_in, n_out), read),
        run.write(source, &made, codec, N_STEPS)?,
    ];
    Ok(RunReport { stages, ..report(source, &made, plan, config) })
}

fn nothing_left(config: &Config, source: &MeshSource, made: &Made) -> Error {
    let what = match &made.report {
        MethodReport::Grid(GridReport { cell_size: size, .. }) => format!(
            "no triangle has its corners in three cells of {size}; ask for more triangles, or give a smaller --grid; where \
             vertices without a face lie far away, leave them out first (stonecut convert); nothing was written"
        ),
        // What was seen of copies of vertices is the most likely reason.
        _ => source
            .weld()
            .into_iter()
            .flat_map(|weld| &weld.notes)
            .fold("no triangle is left; nothing was written".to_owned(), |what, note| {
                format!("{what}; {note}")
            }),
    };
    Error::Empty { path: config.output.clone(), what }
}

/// The report without times.
fn report(source: &MeshSource, made: &Made, plan: &MethodPlan, config: &Config) -> RunReport {
    let n_out = made.mesh.triangles.len() as u64;
    let is_grid = matches!(config.target, Target::CellSize(_));
    let collapsed =
        matches!(config.method, Method::Retile { .. }) && LEAST_OF_TARGET * n_out < plan.target;
    let target_met = is_grid || n_out <= plan.target && !collapsed;
    let found = source.faults();
    let mut faults = made.faults.clone();
    *faults.entry("bad_faces".to_owned()).or_default() += found.bad_faces;
    faults.insert("bad_vertices".to_owned(), found.bad_vertices);
    faults.insert("missing_faces".to_owned(), found.missing_faces);
    faults.insert("missing_vertices".to_owned(), found.missing_vertices);
    let mesh = &made.mesh;
    let after =
        made.input_volume.map(|_| volume((0..mesh.triangles.len()).map(|t| mesh.corners(t))));
    let asked = (plan.target.max(n_out), source.n_triangles());
    let quality = QualityReport::of_volumes(mean_edge(made), asked, [made.input_volume, after]);
    let bearable = quality.bearable;
    let mut report = RunReport {
        schema_version: SCHEMA_VERSION,
        version: env!("CARGO_PKG_VERSION").to_owned(),
        method: config.method.name().to_owned(),
        input: InputReport { faults, ..InputReport::new(&config.input, source, made.bounds) },
        inputs: source.parts().to_vec(),
        settings: config.settings(),
        output: OutputReport {
            path: config.output.display().to_string(),
            vertices: made.mesh.positions.len() as u64,
            triangles: n_out,
        },
        quality,
        target: if is_grid { n_out } else { plan.target },
        target_met,
        stop_reason: match (is_grid, target_met, config.method) {
            (true, ..) => StopReason::Grid,
            (_, true, _) => StopReason::of(true, bearable),
            (_, false, _) if collapsed => StopReason::Collapsed,
            (_, false, Method::Cluster { .. }) => StopReason::NoGrid,
            (_, false, _) => StopReason::NothingRemovable,
        }
        .to_string(),
        ..RunReport::default()
    };
    match made.report.clone() {
        MethodReport::Grid(grid) => {
            let expected_triangles = plan.expected_triangles;
            let copied_vertices = made.copied_vertices;
            report.grid = Some(GridReport { expected_triangles, copied_vertices, ..grid });
        }
        MethodReport::Decimation(decimation) => report.decimation = Some(decimation),
        MethodReport::Retiling(retiling) => report.retiling = Some(retiling),
        MethodReport::Pairs(_) | MethodReport::None => {}
    }
    report
}

/// Mean length of the edges of a result.
pub(super) fn mean_edge(made: &Made) -> f64 {
    let n_edges = 3 * made.mesh.triangles.len().max(1);
    let lengths = (0..made.mesh.triangles.len()).map(|t| {
        let [a, b, c] = made.mesh.corners(t);
        [sub(b, a), sub(c, b), sub(a, c)].map(|edge| length_sq(edge).sqrt()).iter().sum::<f64>()
    });
    lengths.sum::<f64>() / n_edges as f64
}
