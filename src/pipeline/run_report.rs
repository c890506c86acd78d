//! The report of a run, as `--report` writes it; the keys are a contract that scripts rely on.
//!
//! docs/report.md describes every key, docs/report.schema.json says the same for machines, and tests/command/report_schema.rs holds
//! real reports against both.

use crate::io::ply::{MeshSource, PartReport, WeldReport, type_name};
use crate::io::{NUMBER, OBJECT, OutputKind, TexturePlan};
pub use crate::kernel::QualityReport;
use crate::measure::solid::Solid;
use crate::mesh::bounds::Bounds;
use crate::mesh::face_properties::{FacePolicy, FacePropertyPlan};
pub use crate::methods::{
    DecimationReport, EdgesReport, GridReport, PairsReport, RetilingReport, SpreadReport,
};
use crate::system::json_keys::{SCHEMA_VERSION, add_old_names};
use crate::system::losses::Ledger;
use crate::system::memory::peak_bytes;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;
use std::time::Instant;

/// One stage of a run.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct StageReport {
    /// `partition`, `components`, `simplify`, `repartition`, `round`, `finish`, `write`, `verify`; `survey` or the method's name.
    pub name: String,
    /// The part of the run that it belongs to, as `--until` names it: as `name`, but `stitch` for `repartition`, `round` and
    /// `finish`.
    #[serde(default)]
    pub part: String,
    /// Wall time; of a resumed run, that of the run that did the stage.
    pub seconds: f64,
    /// Triangles that went in.
    pub triangles_in: u64,
    /// Triangles that came out.
    pub triangles_out: u64,
    /// Bytes read through the job's files, and all of the input in `partition`.
    pub bytes_read: u64,
    /// Bytes written, the output included.
    pub bytes_written: u64,
    /// Peak resident memory of the process up to the end of the stage, in bytes.
    #[serde(default)]
    pub peak_memory_bytes: u64,
    /// The most bytes that temporary files of the job had at one time up to the end of the stage.
    #[serde(default)]
    pub peak_temp_bytes: u64,
}

impl StageReport {
    /// A stage that began at `start` and ends now: triangles in and out, bytes read and written.
    pub fn since(
        name: &str,
        start: Instant,
        (triangles_in, triangles_out): (u64, u64),
        (bytes_read, bytes_written): (u64, u64),
    ) -> StageReport {
        StageReport {
            name: name.to_owned(),
            part: StageReport::part_of(name).to_owned(),
            seconds: start.elapsed().as_secs_f64(),
            triangles_in,
            triangles_out,
            bytes_read,
            bytes_written,
            peak_memory_bytes: peak_bytes(),
            peak_temp_bytes: 0,
        }
    }

    /// `part`, also of reports of before schema version 1, which have it as the name.
    pub fn part(&self) -> &str {
        if self.part.is_empty() { &self.name } else { &self.part }
    }

    /// The part of the run that a stage of this name belongs to.
    pub fn part_of(name: &str) -> &str {
        match name {
            "repartition" | "round" | "finish" => "stitch",
            other => other,
        }
    }
}

/// The input of a run.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct InputReport {
    /// As given.
    pub path: String,
    /// Length of the file.
    pub bytes: u64,
    /// Vertices in the file.
    pub vertices: u64,
    /// Faces in the file.
    pub triangles: u64,
    /// Lower and upper corner of the bounding box of all vertices.
    #[serde(default)]
    pub bounds: [[f64; 3]; 2],
    /// Subtracted from its coordinates (`--recentre`, or an earlier one).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub offset: Option<[f64; 3]>,
    /// Faults found, by name; the faulty rows were dropped.
    pub faults: BTreeMap<String, u64>,
    /// Copies of vertices; absent where none were looked for or there was nothing to say.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub weld: Option<WeldReport>,
}

impl InputReport {
    /// The report on an input without faults.
    pub(super) fn new(path: &Path, source: &MeshSource, bounds: Bounds) -> Self {
        InputReport {
            path: path.display().to_string(),
            bytes: source.given_bytes(),
            vertices: source.weld().map_or(source.n_vertices(), |weld| weld.vertices),
            triangles: source.n_triangles(),
            bounds: bounds.into(),
            offset: source.offset(),
            faults: BTreeMap::new(),
            weld: source.weld().cloned(),
        }
    }

    /// Rows that were broken or missing, and dropped on request: the result is of a part of the input only.
    pub fn lost_rows(&self) -> u64 {
        LOST_ROWS.iter().filter_map(|name| self.faults.get(*name)).sum()
    }
}

/// Faults for which rows are dropped that should have been read.
pub(crate) const LOST_ROWS: [&str; 4] =
    ["bad_faces", "bad_vertices", "missing_faces", "missing_vertices"];

/// The output of a run.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct OutputReport {
    /// As given.
    pub path: String,
    /// Vertices written.
    pub vertices: u64,
    /// Triangles written.
    pub triangles: u64,
}

/// A level of a chain.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LevelReport {
    /// Its file, as given.
    pub path: String,
    /// Vertices written.
    pub vertices: u64,
    /// Triangles written.
    pub triangles: u64,
    /// Bytes of the file.
    pub bytes: u64,
    /// Triangles wanted.
    pub target: u64,
    /// True if the file has at most `target` triangles.
    pub target_met: bool,
    /// Reason why collapsing ended, in words.
    pub stop_reason: String,
    /// Estimate of how well it stands for the input.
    pub quality: QualityReport,
    /// Distance between input and file at samples, root mean square, both ways; only with `--verify`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rms: Option<f64>,
    /// The Hausdorff distance between input and file, enclosed; only with `--verify`.
    #[serde(skip_deserializing, skip_serializing_if = "Option::is_none")]
    pub hausdorff: Option<crate::measure::Certificate>,
    /// Faults, as in `RunReport`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub solid: Option<Solid>,
}

/// Vertices and charts on seams.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SeamReport {
    /// Vertices on seams of the first round.
    pub shared_vertices: u64,
    /// The same for every round.
    pub shared_vertices_by_round: Vec<u64>,
    /// Vertices of the result where charts of a texture, or regions of faces, meet; only of an input with either.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub texture_seam_vertices: Option<u64>,
    /// Charts and regions that were smaller than the error and have gone: connected pieces, each counted once, whatever the cells.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub charts_vanished: Option<u64>,
    /// One of those of the first round, near the middle of the mesh, in input units.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sample_position: Option<[f64; 3]>,
    /// The same, by the name it had before schema version 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub place: Option<[f64; 3]>,
}

/// Reason of a property of faces that the writer cannot hold.
pub const NO_PLACE: &str = "the output's format has no place for it";

/// Fate of a property of faces.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FaceReport {
    /// Its name in the input.
    pub name: String,
    /// Its type, or `list`.
    #[serde(rename = "type")]
    pub scalar: String,
    /// Its treatment.
    pub carried: FacePolicy,
    /// Reason why it was dropped.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
}

/// Returns whether there are none of something.
fn is_none(n: &u64) -> bool {
    *n == 0
}

impl FaceReport {
    /// Lists everything that faces carried but texture, for an output of this kind with this number of materials.
    pub fn list(carry: &FacePropertyPlan, kind: OutputKind, n_materials: usize) -> Vec<FaceReport> {
        let properties = carry.properties.iter().map(|p| {
            let name = p.property.name.clone();
            let reason = match kind {
                _ if p.how == FacePolicy::Dropped => Some(p.reason),
                OutputKind::Ply => None,
                OutputKind::Obj | OutputKind::Glb if name == NUMBER && n_materials > 0 => None,
                OutputKind::Obj | OutputKind::Glb if name == OBJECT => None,
                _ => Some(NO_PLACE),
            };
            let carried = if reason.is_some() { FacePolicy::Dropped } else { p.how };
            let reason = reason.map(str::to_owned);
            FaceReport { name, scalar: type_name(p.property.scalar).to_owned(), carried, reason }
        });
        let lists = carry.lists.iter().map(|name| FaceReport {
            name: name.clone(),
            scalar: "list".to_owned(),
            carried: FacePolicy::Dropped,
            reason: Some("neither corners nor texture coordinates with an image".to_owned()),
        });
        properties.chain(lists).collect()
    }
}

/// Materials and images of the output.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TextureReport {
    /// Materials.
    pub materials: u64,
    /// Images that they name.
    pub images: u64,
    /// Images that are not there or cannot be read.
    pub missing: u64,
    /// True if the input names images and none of them is there.
    #[serde(default)]
    pub lacks_images: bool,
    /// Bytes of images that were copied beside the output or embedded.
    pub bytes: u64,
    /// Missing, damaged and lost parts, a line each; deprecated, `RunReport::losses` says more.
    pub notes: Vec<String>,
}

impl TextureReport {
    /// The report of a plan.
    pub fn of(plan: &TexturePlan) -> TextureReport {
        TextureReport {
            materials: plan.materials.list.len() as u64,
            images: plan.materials.images.len() as u64,
            missing: plan.n_missing as u64,
            lacks_images: plan.lacks_images(),
            bytes: plan.bytes,
            notes: plan.materials.losses.lines().into_iter().chain(plan.losses.lines()).collect(),
        }
    }
}

/// Settings and files of a run that is over.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct DoneRecord {
    /// Settings by name, with those that only this record needs.
    pub settings: BTreeMap<String, String>,
    /// Marks of the input and the files beside it.
    pub input: BTreeMap<String, String>,
    /// Marks of each output, by its path as given.
    pub outputs: BTreeMap<String, BTreeMap<String, String>>,
    /// Exit code of the run.
    pub exit_code: u8,
}

/// The report of `simplify`; `written` gives the form in which it is written.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RunReport {
    /// `SCHEMA_VERSION`; 0 for reports of before it.
    #[serde(default)]
    pub schema_version: u32,
    /// Version of the program.
    pub version: String,
    /// The input.
    pub input: InputReport,
    /// Files that became the input, if they were several.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub inputs: Vec<PartReport>,
    /// Every setting that changes the result (`Config::settings`).
    pub settings: BTreeMap<String, String>,
    /// Cells of the first round.
    pub cells: u32,
    /// Rounds over all cells; the finish is not one.
    pub rounds: u32,
    /// In the order in which they ran.
    pub stages: Vec<StageReport>,
    /// Wall time from the opened input to the written output, `--verify` included. A run that continues an earlier one counts
    /// the stages that were done before, but not the part of a stage that is done again.
    pub seconds: f64,
    /// Triangles of the input over `seconds`, without the time of `--verify`.
    pub triangles_per_second: f64,
    /// Peak resident memory of the process, in bytes.
    pub peak_memory_bytes: u64,
    /// Most bytes that temporary files had at one time, in all processes that took part.
    pub peak_temp_bytes: u64,
    /// The output; of a chain, that of its coarsest level.
    pub output: OutputReport,
    /// Levels of a chain, finest first; absent without one.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub levels: Vec<LevelReport>,
    /// Refused collapses by reason, over all rounds and the finish. An edge that is tried again counts again.
    pub rejects: BTreeMap<String, u64>,
    /// Repairs and changes of the topology, by kind, over all rounds and the finish.
    #[serde(default)]
    pub changes: BTreeMap<String, u64>,
    /// Outcome of moving the vertices to fit the original; absent where that was not done.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fit: Option<crate::kernel::FitStatistics>,
    /// Vertices and charts on seams.
    pub seams: SeamReport,
    /// Estimate of how well the result stands for the input.
    #[serde(default)]
    pub quality: QualityReport,
    /// Components of the input and what `--min-component` dropped; absent without it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub components: Option<crate::stages::components::ComponentSizes>,
    /// Fate of the scalar properties and lists of faces.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub face_properties: Vec<FaceReport>,
    /// Parts of the input that the output does not have.
    #[serde(default)]
    pub losses: Ledger,
    /// Proof for another run of the same command that this one has done it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub done: Option<DoneRecord>,
    /// Materials and images; absent where the input has none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub textures: Option<TextureReport>,
    /// Findings of a new texture; absent where none was made. Of a chain, those of its coarsest level.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bake: Option<crate::bake::BakeReport>,
    /// Triangles wanted; with `--max-error` those of the output.
    pub target: u64,
    /// True if the output (of a chain, every one) has at most `target` triangles; with `--max-error`, if the bound is kept.
    pub target_met: bool,
    /// Reason why collapsing ended, in words.
    pub stop_reason: String,
    /// The report of `measure` on input and output; only with `--verify`.
    #[serde(skip_deserializing, skip_serializing_if = "Option::is_none")]
    pub measured: Option<Box<crate::measure::compare::Report>>,
    /// The Hausdorff distance between input and output, enclosed; only with `--verify` and `--max-error`.
    #[serde(skip_deserializing, skip_serializing_if = "Option::is_none")]
    pub hausdorff: Option<crate::measure::Certificate>,
    /// Faults that the output was not to have; only where it was to be closed, turned one way or free of self-intersections.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub solid: Option<Solid>,
    /// Edges at which regions of the output are open whose surfaces were closed in the input; absent where there are none.
    #[serde(default, skip_serializing_if = "is_none")]
    pub opened_region_edges: u64,
    /// Regions of the output whose volume is off by more than a tenth; absent where there are none.
    #[serde(default, skip_serializing_if = "is_none")]
    pub regions_off_volume: u64,
    /// Trials of `--max-error`; only with that option.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max_error: Option<BoundReport>,
    /// Method of simplification; reports of before it have none, and were of the collapse.
    #[serde(default)]
    pub method: String,
    /// The grid of `--method cluster`; only with it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub grid: Option<GridReport>,
    /// Removals of `--method decimate`; only with it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub decimation: Option<DecimationReport>,
    /// Triangles of `--method retile`; only with it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub retiling: Option<RetilingReport>,
    /// Contractions of `--pairs`; only with it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pairs: Option<PairsReport>,
    /// Moves of `--optimize`; only with it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub optimization: Option<crate::optimize::OptimizeOutcome>,
}

/// Reason why collapsing ended; its words are those of `RunReport::stop_reason`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StopReason {
    /// The target was met.
    Target,
    /// The target was met, but is smaller than what still stands for the input.
    TargetBelowBearable,
    /// Every edge that is left was rejected.
    NothingLegal,
    /// Locked vertices need all that is left.
    Locked,
    /// Every edge that is left would lead beyond the bound on the error.
    WithinBound,
    /// The cell size was given.
    Grid,
    /// No grid was found that meets the target.
    NoGrid,
    /// Every vertex that is left has to stay.
    NothingRemovable,
    /// Most of the surface is gone, since its walls are thinner than the triangles.
    Collapsed,
}

impl StopReason {
    /// The reason of a run to a count.
    pub fn of(is_met: bool, is_bearable: bool) -> Self {
        match (is_met, is_bearable) {
            (true, true) => StopReason::Target,
            (true, false) => StopReason::TargetBelowBearable,
            (false, _) => StopReason::NothingLegal,
        }
    }
}

impl std::fmt::Display for StopReason {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        f.write_str(match self {
            StopReason::Target => "target",
            StopReason::TargetBelowBearable => "target, below what the input can bear",
            StopReason::NothingLegal => "no edge is left that may be collapsed",
            StopReason::Locked => "locked vertices need more",
            StopReason::WithinBound => "within the bound",
            StopReason::Grid => "the grid",
            StopReason::NoGrid => "no grid of ten was coarse enough",
            StopReason::NothingRemovable => "no vertex is left that can be removed",
            StopReason::Collapsed => {
                "parts thinner than the triangles have collapsed; ask for more triangles, or take --method collapse"
            }
        })
    }
}

impl RunReport {
    /// The report as it is written: with its versions, and with old names beside the new ones.
    pub fn written(&self) -> RunReport {
        let mut report = self.clone();
        report.schema_version = SCHEMA_VERSION;
        env!("CARGO_PKG_VERSION").clone_into(&mut report.version);
        add_old_names(&mut report.rejects);
        add_old_names(&mut report.changes);
        add_old_names(&mut report.settings);
        report.seams.place = report.seams.sample_position;
        report
    }
}

/// Outcome of a bound on the error.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct BoundReport {
    /// As given, in input units.
    pub bound: f64,
    /// Largest distance that the run itself saw, from either mesh to the other.
    #[serde(default)]
    pub tracked_max: Option<f64>,
    /// Largest two-sided distance at samples, as `stonecut measure` finds it; the proven one is `hausdorff`.
    pub measured_max: Option<f64>,
    /// The same for the root mean square.
    pub measured_rms: Option<f64>,
    /// Every run that was tried.
    pub trials: Vec<TrialReport>,
}

/// One run on the way to a bound.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TrialReport {
    /// Triangles it left.
    pub triangles: u64,
    /// Upper end of its certificate.
    pub max: f64,
    /// Wall time, without the certificate.
    pub seconds: f64,
}
