//! Results of the kernel: the simplified mesh, where its vertices come from, and what was counted.

use crate::history::History;
use crate::quality::{Quality, QualityAt};
use crate::surface::models::Models;
use stonecut_mesh::Mesh;

/// Statistics of a run of the kernel.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Statistics {
    /// Collapses carried out.
    pub collapses: u64,
    /// Refused collapses by reason, in a fixed order of reasons.
    pub rejects: Vec<(&'static str, u64)>,
    /// Counts of cleaning, and of changes of topology made under `Topology::Error`, by kind, in a fixed order.
    pub changes: Vec<(&'static str, u64)>,
    /// Charts of a texture whose last triangle has gone.
    pub charts_vanished: u64,
    /// Vertices on attribute seams at the end.
    pub seam_vertices: u64,
    /// Triangles left after each cost level of `Stop::Costs`.
    pub level_counts: Vec<u64>,
    /// True if the stop was reached (false: nothing legal is left to collapse).
    pub reached: bool,
    /// True if `Options::interrupt` was raised: the mesh is not what was asked for.
    pub interrupted: bool,
    /// Largest distance from the original, both ways, as the bound saw it; in input units, 0 without a bound.
    pub reach: f64,
    /// Statistics of the fit, if there was one.
    pub fit: Option<FitStatistics>,
    /// Estimated quality of the result, if `Options::estimate` is set.
    pub quality: Option<Quality>,
    /// The same on the way down to a count, largest first.
    pub curve: Vec<QualityAt>,
}

/// The outcome of `simplify_mesh`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Simplified {
    /// The simplified mesh; only referenced vertices, in ascending order of `source`.
    pub mesh: Mesh,
    /// For each vertex of `mesh`, the input vertex that survived as it (`v1` of its collapses).
    /// A locked vertex that the input's triangles use always survives, bit for bit.
    pub source: Vec<u32>,
    /// Vertices that were made, as copies of others: whose values they have that are in no channel.
    pub models: Models,
    /// With `Options::follow`, for each vertex of the input the vertex of `mesh` that it went into by collapses;
    /// `u32::MAX` where it leads nowhere. Empty otherwise.
    pub followed: Vec<u32>,
    /// With `Options::record`, the steps that led here.
    pub history: Option<Box<History>>,
    /// Counters.
    pub statistics: Statistics,
}

/// Statistics of a fit.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct FitStatistics {
    /// Points of the original that the mesh was fitted to.
    pub samples: u64,
    /// Times that the nearest triangles were found and the vertices moved.
    pub sweeps: u64,
    /// Vertices that lie elsewhere than before.
    pub moved: u64,
    /// Root mean square distance of the samples before, in input units.
    pub rms_before: f64,
    /// The same of a quarter of them afterwards.
    pub rms_after: f64,
}

impl FitStatistics {
    /// Those of two parts of a mesh together.
    pub fn with(&self, other: &FitStatistics) -> FitStatistics {
        let samples = self.samples + other.samples;
        let mean = |a: f64, b: f64| {
            let sum = a * a * self.samples as f64 + b * b * other.samples as f64;
            (sum / samples.max(1) as f64).sqrt()
        };
        FitStatistics {
            samples,
            sweeps: self.sweeps.max(other.sweeps),
            moved: self.moved + other.moved,
            rms_before: mean(self.rms_before, other.rms_before),
            rms_after: mean(self.rms_after, other.rms_after),
        }
    }
}
