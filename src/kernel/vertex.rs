//! A vertex as the SIMD code reads it (one cache line).
//!
//! Stands below all other files of the kernel and knows none of them.

use stonecut_mesh::vec3::Vec3;

/// First corner of a triangle that is gone.
pub(crate) const GONE: u32 = u32::MAX;

/// All that an edge's evaluation needs to know of its ends: one cache line.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(crate) struct Vertex {
    /// In input units, exactly.
    pub(crate) position: Vec3,
    /// A (xx, xy, xz, yy, yz, zz) and G (x, y, z), in scaled units.
    pub(crate) quadric: [f32; 9],
    /// Number of the collapse that changed it last.
    pub(crate) stamp: u32,
}

impl Vertex {
    /// A vertex without triangles.
    pub(crate) fn at(position: Vec3) -> Self {
        Vertex { position, quadric: [0.0; 9], stamp: 0 }
    }
}
