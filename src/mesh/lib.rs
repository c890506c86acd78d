//! An indexed triangle mesh in memory, with per-vertex channels.
//!
//! This is what the kernel takes and gives, what a cell becomes when it is loaded, and what `measure`
//! and `render` work on. It holds no connectivity; its users build what they need.

pub mod attribute_weights;
pub mod blend;
pub mod bounds;
pub mod codec;
mod color_channels;
pub mod colours;
pub mod corners;
pub mod curves;
pub mod duplicate_triangles;
pub mod eigen;
pub mod extremes;
pub mod face_properties;
pub mod global_vertex;
pub mod meeting;
pub mod morton;
pub mod oklab;
pub mod orient;
pub mod outward;
pub mod patches;
pub mod placing;
pub mod property;
pub mod record;
pub mod relief;
pub mod scatter;
pub mod sight;
pub mod steps;
pub mod topology_counts;
pub mod union_find;
pub mod vec3;
pub mod viridis;

use extremes::Extremes;
use relief::Relief;

/// An indexed triangle mesh: positions, further per-vertex channels, triangles.
///
/// Memory: 24 bytes a vertex + 4 per channel and vertex, 12 bytes a triangle, 6 more with relief, 32 with extremes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// One position a vertex, in input units, relative to whatever origin its owner chose.
    pub positions: Vec<[f64; 3]>,
    /// `n_channels` values a vertex, vertex by vertex: what is interpolated besides the position.
    pub channels: Vec<f32>,
    /// Channels of each vertex; 0 for bare geometry.
    pub n_channels: usize,
    /// Corner indices into `positions`, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
    /// The original over each triangle, where the mesh was fitted to one; else empty.
    pub relief: Vec<Relief>,
    /// Points of the original over each triangle, where the mesh was simplified within a bound; else empty.
    pub extremes: Vec<Extremes>,
}

impl Mesh {
    /// A mesh of bare geometry.
    pub fn new(positions: Vec<[f64; 3]>, triangles: Vec<[u32; 3]>) -> Self {
        Mesh { positions, triangles, ..Mesh::default() }
    }

    /// The channels of one vertex.
    #[inline]
    pub fn channels_of(&self, vertex: u32) -> &[f32] {
        let start = vertex as usize * self.n_channels;
        &self.channels[start..start + self.n_channels]
    }

    /// True if any triangle has an area, beyond the rounding of coordinates to a share `rounding` of themselves.
    pub fn has_area(&self, rounding: f64) -> bool {
        (0..self.triangles.len()).any(|t| has_area(self.corners(t), rounding))
    }

    /// The three corner positions of one triangle.
    #[inline]
    pub fn corners(&self, triangle: usize) -> [[f64; 3]; 3] {
        self.triangles[triangle].map(|v| self.positions[v as usize])
    }
}

/// Height of a triangle without area in roundings of its coordinates: each of three corners may be off by one in
/// three directions.
const ROUNDINGS: f64 = 4.0;

/// A triangle that is higher than this share of its longest edge has an area, however coarse its coordinates are.
const NEEDLE: f64 = 0.01;

/// True if a triangle has an area, beyond the rounding of its coordinates. Corners on a line in space are hardly ever
/// exactly on a line once they are rounded.
fn has_area(corners: [[f64; 3]; 3], rounding: f64) -> bool {
    let size = corners.iter().flatten().fold(0f64, |size, x| size.max(x.abs()));
    // In units of the largest coordinate, so that no product overflows or vanishes.
    let [a, b, c] = corners.map(|corner| corner.map(|x| x / size));
    let between = |p: [f64; 3], q: [f64; 3]| [q[0] - p[0], q[1] - p[1], q[2] - p[2]];
    let length = |[x, y, z]: [f64; 3]| (x * x + y * y + z * z).sqrt();
    let (ab, ac, bc) = (between(a, b), between(a, c), between(b, c));
    let cross = [
        ab[1] * ac[2] - ab[2] * ac[1],
        ab[2] * ac[0] - ab[0] * ac[2],
        ab[0] * ac[1] - ab[1] * ac[0],
    ];
    let longest = length(ab).max(length(ac)).max(length(bc));
    // Not a number, and so false, where all corners are in one place.
    let height = length(cross) / longest;
    height > ROUNDINGS * rounding || height > NEEDLE * longest
}

#[cfg(test)]
mod tests {
    use super::has_area;

    #[test]
    fn corners_on_a_line_have_no_area_wherever_the_line_lies() {
        let f32s = f64::from(f32::EPSILON) / 2.0;
        let rounded = |x: f64| f64::from(x as f32);
        for i in 0..200 {
            let along = |t: f64| [0.1, -0.7, 0.3].map(|d| rounded(1000.0 + d * t));
            let at = f64::from(i);
            assert!(!has_area([along(at), along(at + 1.0), along(at + 2.5)], f32s), "{i}");
            let aside = along(at + 2.5);
            let aside = [aside[0], aside[1], aside[2] + 0.01];
            assert!(has_area([along(at), along(at + 1.0), aside], f32s), "{i}");
        }
        let exact = |scale: f64| [[0.0; 3], [scale, 0.0, 0.0], [0.0, scale, 0.0]];
        for scale in [1e-300, 1e-30, 1.0, 1e30, 1e300] {
            assert!(has_area(exact(scale), f32s), "{scale}");
        }
        assert!(!has_area([[0.0; 3]; 3], f32s) && !has_area([[7.0; 3]; 3], f32s));
        // Coordinates so coarse that all triangles are as low as their rounding, but no needles.
        let (x, step) = (8_388_608.0, 1.0);
        assert!(has_area([[x, x, 0.0], [x + step, x, 0.0], [x, x + step, 0.0]], f32s));
    }
}
