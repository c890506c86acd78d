//! An indexed triangle mesh in memory, with per-vertex channels.
//!
//! This is what the kernel takes and gives, what a cell becomes when it is loaded, and what `measure`
//! and `render` work on. It has no connectivity of its own; whoever needs one builds it.

pub mod attribute_weights;
mod color_channels;
pub mod face_properties;
pub mod oklab;
pub mod record;
pub mod topology_counts;
pub(crate) mod union_find;
pub(crate) mod vec3;

/// An indexed triangle mesh: positions, further per-vertex channels, triangles.
///
/// Memory: 24 bytes a vertex + 4 per channel and vertex, 12 bytes a triangle.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// One position a vertex, in input units, relative to whatever origin its owner chose.
    pub positions: Vec<[f64; 3]>,
    /// `n_channels` values a vertex, vertex by vertex: what is interpolated besides the position.
    pub channels: Vec<f32>,
    /// How many channels each vertex has; 0 for bare geometry.
    pub n_channels: usize,
    /// Corner indices into `positions`, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

impl Mesh {
    /// A mesh of bare geometry.
    pub fn new(positions: Vec<[f64; 3]>, triangles: Vec<[u32; 3]>) -> Self {
        Mesh { positions, channels: Vec::new(), n_channels: 0, triangles }
    }

    /// The channels of one vertex.
    pub fn channels_of(&self, vertex: u32) -> &[f32] {
        let start = vertex as usize * self.n_channels;
        &self.channels[start..start + self.n_channels]
    }

    /// The three corner positions of one triangle.
    pub fn corners(&self, triangle: usize) -> [[f64; 3]; 3] {
        self.triangles[triangle].map(|v| self.positions[v as usize])
    }
}
