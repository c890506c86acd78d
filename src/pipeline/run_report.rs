//! The report of a run, as `--report` writes it; the keys are a contract that scripts rely on.

use crate::io::OutputKind;
use crate::io::ply::type_name;
use crate::mesh::face_properties::{FaceCarry, How};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// One stage of a run.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct StageReport {
    /// `partition`, `simplify`, `stitch`, `write` or `verify`.
    pub name: String,
    /// Wall time.
    pub seconds: f64,
    /// Triangles that went in.
    pub triangles_in: u64,
    /// Triangles that came out.
    pub triangles_out: u64,
    /// Bytes read, the input included.
    pub bytes_read: u64,
    /// Bytes written, the output included.
    pub bytes_written: u64,
    /// Peak memory of the process up to the end of the stage.
    #[serde(default)]
    pub peak_memory_bytes: u64,
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
    /// Faults found, by name; what is concerned was dropped.
    pub faults: BTreeMap<String, u64>,
}

impl InputReport {
    /// Rows that were broken or missing, and dropped on request: the result is of a part of the input only.
    pub fn lost_rows(&self) -> u64 {
        let lost = ["bad_faces", "bad_vertices", "missing_faces", "missing_vertices"];
        lost.iter().filter_map(|name| self.faults.get(*name)).sum()
    }
}

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

/// What the cells had in common.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SeamReport {
    /// Vertices on seams of the first round.
    pub shared_vertices: u64,
    /// The same for every round.
    pub shared_vertices_by_round: Vec<u64>,
    /// Vertices of the result where charts of a texture, or regions of faces, meet; only of an input with
    /// either.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub texture_seam_vertices: Option<u64>,
    /// Charts of a texture and regions of faces that were smaller than the error and have gone: pieces that
    /// triangles connect, each counted once, whatever the cells.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub charts_vanished: Option<u64>,
    /// One of those of the first round, near the middle of the mesh, to look at.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub place: Option<[f64; 3]>,
}

/// What became of a property of faces.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FaceReport {
    /// Its name in the input.
    pub name: String,
    /// Its type, or `list`.
    #[serde(rename = "type")]
    pub scalar: String,
    /// What was done with it.
    pub carried: How,
    /// Why it was dropped.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
}

impl FaceReport {
    /// What became of everything that faces carried but texture, in an output of this kind.
    pub fn list(carry: &FaceCarry, kind: OutputKind) -> Vec<FaceReport> {
        let properties = carry.properties.iter().map(|p| {
            let name = p.property.name.clone();
            let reason = match kind {
                _ if p.how == How::Dropped => Some(p.reason),
                OutputKind::Ply => None,
                OutputKind::Obj if name == "texnumber" => None,
                _ => Some("the output's format has no place for it"),
            };
            let carried = if reason.is_some() { How::Dropped } else { p.how };
            let reason = reason.map(str::to_owned);
            FaceReport { name, scalar: type_name(p.property.scalar).to_owned(), carried, reason }
        });
        let lists = carry.lists.iter().map(|name| FaceReport {
            name: name.clone(),
            scalar: "list".to_owned(),
            carried: How::Dropped,
            reason: Some("neither corners nor texture coordinates with an image".to_owned()),
        });
        properties.chain(lists).collect()
    }
}

/// The report of `simplify`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs)] // The names are the contract.
pub struct RunReport {
    pub version: String,
    pub input: InputReport,
    pub settings: BTreeMap<String, String>,
    pub cells: u32,
    pub rounds: u32,
    pub stages: Vec<StageReport>,
    pub seconds: f64,
    pub triangles_per_second: f64,
    pub peak_memory_bytes: u64,
    pub peak_temp_bytes: u64,
    pub output: OutputReport,
    /// Refused collapses by reason, over all rounds and the finish.
    pub rejects: BTreeMap<String, u64>,
    /// What was cleaned and changed of the topology, by kind, over all rounds and the finish.
    #[serde(default)]
    pub changes: BTreeMap<String, u64>,
    /// What moving the vertices to fit the original did; absent where it was not done.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fit: Option<crate::kernel::FitStatistics>,
    pub seams: SeamReport,
    /// Whether the result can stand for the input, as far as probes on the way tell.
    #[serde(default)]
    pub quality: QualityReport,
    /// Components of the input and what `--min-component` dropped; absent without it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub components: Option<crate::stages::components::ComponentSizes>,
    /// What became of the scalar properties and lists of faces.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub face_properties: Vec<FaceReport>,
    pub target: u64,
    pub target_met: bool,
    pub stop_reason: String,
    /// What `measure` says of input and output; only with `--verify`.
    #[serde(skip_deserializing, skip_serializing_if = "Option::is_none")]
    pub measured: Option<Box<crate::measure::compare::Report>>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max_error: Option<BoundReport>,
}

/// How well the result stands for the input, estimated from probes in every round and in the finish.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct QualityReport {
    /// Root mean square distance from the input to the result, in input units.
    pub rms_estimate: f64,
    /// Mean edge of the result, in input units.
    pub mean_edge: f64,
    /// The one over the other.
    pub error_per_edge: f64,
    /// Share of the input's area that faces against the result where it is nearest, 0 to 1.
    pub share_against: f64,
    /// Whether the result can stand for the input: false where it has come apart into shards.
    pub bearable: bool,
    /// The least count of triangles that can be expected to stand for the input; the result's own if it does.
    pub sensible_triangles: u64,
}

impl Default for QualityReport {
    /// Nothing known, nothing wrong: reports of earlier versions have no estimate.
    fn default() -> Self {
        QualityReport {
            rms_estimate: 0.0,
            mean_edge: 0.0,
            error_per_edge: 0.0,
            share_against: 0.0,
            bearable: true,
            sensible_triangles: 0,
        }
    }
}

/// How a bound on the error was met.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct BoundReport {
    /// As given, in input units.
    pub bound: f64,
    /// Largest two-sided distance between input and output, as `stonecut measure` finds it.
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
    /// Its measured maximum.
    pub max: f64,
    /// Wall time, without the measurement.
    pub seconds: f64,
}
