//! Methods besides the edge collapse of the kernel, each in a room below: a mesh in, a mesh and statistics out.
//!
//! A method gets a `MeshSource` and gives a `Made`; opening, planning, writing, reporting and measuring are those of all
//! methods (`pipeline/methods/`). A method reads its source through `Positions`, so that none decides how vertices are
//! kept. The collapse goes through cells on disk instead and is not one of them.

pub mod optimize;

mod book;
pub mod cluster;
pub mod decimate;
mod key_table;
mod load;
mod manifold;
pub mod pairs;
mod positions;
mod reports;
pub mod retile;
mod sums;
mod surface;

pub use manifold::TRIANGLE_BYTES as MANIFOLD_TRIANGLE_BYTES;
pub use positions::{FileOrder, Positions, page_bytes};
pub use reports::{
    DecimationReport, EdgesReport, GridReport, MethodReport, PairsReport, RetilingReport,
    SpreadReport,
};
use std::collections::BTreeMap;
use stonecut_mesh::Mesh;
use stonecut_mesh::bounds::Bounds;
use stonecut_mesh::orient::orient;

/// A mesh that a method made.
#[derive(Clone, Debug, Default)]
pub struct Made {
    /// Positions in input units, channels after the source's `kernel_codec`, triangles.
    pub mesh: Mesh,
    /// A record of the input for each vertex, from which labels are taken; empty where vertices carry nothing.
    pub records: Vec<u8>,
    /// Triangles that may be turned over: the surface was folded there.
    pub two_sided: Vec<u32>,
    /// Faults of the input that were left out, by name.
    pub faults: BTreeMap<String, u64>,
    /// The box of all vertices of the input.
    pub bounds: Bounds,
    /// Volume of the input, if it is closed and was in memory.
    pub input_volume: Option<f64>,
    /// Vertices added where sheets shared one, if the mesh was taken apart.
    pub copied_vertices: Option<u64>,
    /// Its part of the report.
    pub report: MethodReport,
}

impl Made {
    /// Takes the mesh apart where it is not manifold: turns triangles over that may be, copies vertices, loses no
    /// triangle. Counts the copies.
    ///
    /// Memory: `MANIFOLD_TRIANGLE_BYTES` for each triangle.
    pub fn take_apart(&mut self) {
        let mesh = &mut self.mesh;
        let n_before = mesh.positions.len().max(1);
        manifold::orient(&mut mesh.triangles, &self.two_sided);
        orient(&mut mesh.triangles, mesh.positions.len(), |_| false);
        let copies = manifold::take_apart(&mesh.positions, &mut mesh.triangles);
        let record_bytes = self.records.len() / n_before;
        for &copied in &copies {
            let v = copied as usize;
            mesh.positions.push(mesh.positions[v]);
            mesh.channels.extend_from_within(v * mesh.n_channels..(v + 1) * mesh.n_channels);
            self.records.extend_from_within(v * record_bytes..(v + 1) * record_bytes);
        }
        self.copied_vertices = Some(copies.len() as u64);
    }
}
