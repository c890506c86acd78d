//! One cell in memory, and the counts of what was left out of it.

use serde::{Deserialize, Serialize};
use std::ops::AddAssign;
use stonecut_mesh::Mesh;
use stonecut_mesh::global_vertex::GlobalVertex;
use stonecut_mesh::vec3::place_bits;

/// One loaded cell.
#[derive(Clone, Debug, Default)]
pub struct CellMesh {
    /// Input vertex index of each local vertex.
    pub ids: Vec<GlobalVertex>,
    /// The record of each local vertex as it was read from the input (position possibly moved since).
    pub records: Vec<u8>,
    /// True if another cell uses this vertex too; such vertices are locked.
    pub shared: Vec<bool>,
    /// Geometry and channels.
    pub mesh: Mesh,
    /// Counts of what tidying left out.
    pub dropped: Dropped,
}

impl CellMesh {
    /// Memory in bytes, without that of the mesh.
    pub fn bytes(&self) -> u64 {
        let ids = self.ids.capacity() * size_of::<GlobalVertex>();
        (ids + self.records.capacity() + self.shared.capacity()) as u64
    }

    /// Shares what lies in the place of a shared vertex: wedges of one vertex whose triangles are in different cells stay together.
    pub(super) fn share_places(&mut self) {
        let positions = &self.mesh.positions;
        let shared = positions.iter().zip(&self.shared).filter(|(_, shared)| **shared);
        let mut places: Vec<[u64; 3]> = shared.map(|(&place, _)| place_bits(place)).collect();
        places.sort_unstable();
        for (&place, shared) in positions.iter().zip(&mut self.shared) {
            *shared |= places.binary_search(&place_bits(place)).is_ok();
        }
    }
}

/// Counts of what was left out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Dropped {
    /// Triangles with the same three corners as an earlier one; if turned over, only those that belong to no
    /// separate body (`mesh::duplicate_triangles`).
    pub duplicate_faces: u64,
    /// Those of them that are backs of two-sided sheets.
    #[serde(default)]
    pub back_faces: u64,
    /// Vertices that no triangle of any cell uses.
    pub unreferenced_vertices: u64,
}

impl AddAssign for Dropped {
    fn add_assign(&mut self, other: Dropped) {
        self.duplicate_faces += other.duplicate_faces;
        self.back_faces += other.back_faces;
        self.unreferenced_vertices += other.unreferenced_vertices;
    }
}
