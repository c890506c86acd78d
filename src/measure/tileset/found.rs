//! Findings about a tree of tiles.

use serde::Serialize;

/// Faults that are told in words; further ones are only counted.
const TOLD: usize = 20;

/// Findings about a tree of tiles. Lengths are in units of the mesh.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct TilesetCheck {
    /// Tiles with content.
    pub tiles: u64,
    /// Files of JSON.
    pub tilesets: u64,
    /// Levels of detail.
    pub levels: u32,
    /// Triangles of the finest tiles.
    pub triangles: u64,
    /// Triangles of all tiles.
    pub triangles_of_all_levels: u64,
    /// Groups of tiles that are shown finer together.
    pub groups: u64,
    /// Edges that tiles of one level have in common.
    pub shared_edges: u64,
    /// Edges of tiles of the finest level that no other has: the boundary of the mesh.
    pub boundary_edges: u64,
    /// Largest gap between tiles of one level.
    pub gap_within: f64,
    /// Largest gap along an axis between tiles of neighbouring levels, in steps of the level above both: half a step
    /// comes from rounding.
    pub gap_across_steps: f64,
    /// The largest distance from the input that tiles of each level state, the finest level first.
    #[serde(skip)]
    pub deviations: Vec<f64>,
    /// Number of faults.
    pub n_faults: u64,
    /// The first faults, in words.
    pub faults: Vec<String>,
}

impl TilesetCheck {
    /// Counts a fault, and keeps its words if there are few so far.
    pub(super) fn fault(&mut self, words: impl FnOnce() -> String) {
        self.n_faults += 1;
        if self.faults.len() < TOLD {
            self.faults.push(words());
        }
    }
}
