//! Directions of normal maps: the original's shading normals in the tangent frames of the result.
//!
//! glTF counts them so: red along u, green along v (upwards), blue along the result's own normal, each from -1 to 1 in 8
//! bits. Knows no pages.

use super::original::Hit;
use stonecut_mesh::Mesh;
use stonecut_mesh::vec3::{add, dot};
use stonecut_render::texture::{Axes, Tangent};

/// A direction in a tangent frame, of length 1.
pub(super) type Direction = [f32; 3];

/// The result's own normal.
const STRAIGHT: Direction = [0.0, 0.0, 1.0];

/// Least part of a direction along the result's normal: glTF has no value for directions into the surface.
const LEAST_UP: f64 = 0.01;

/// Added before rounding, so that noise below a tenth of a step does not turn 128, the middle, into 127.
const UPWARDS: f32 = 0.1;

/// The colour of a straight direction.
pub(super) const STRAIGHT_PIXEL: [u8; 4] = [128, 128, 255, 255];

/// Tangent frames of a result.
pub(super) struct Frames<'a> {
    pub mesh: &'a Mesh,
    /// Normals of the vertices.
    pub normals: &'a [[f32; 3]],
    /// Tangents of the corners of each triangle.
    pub tangents: &'a [[Tangent; 3]],
}

impl Frames<'_> {
    /// The original's normal as the result sees it, at a point of a triangle (barycentric coordinates of its second and
    /// third corner) whose place on the original is `hit`.
    ///
    /// Where the original faces away (a back without a front nearby) and where there is no frame, the result's own normal
    /// stands for it.
    pub fn direction(&self, triangle: u32, weights: [f32; 2], hit: &Hit) -> Direction {
        self.seen(triangle as usize, weights.map(f64::from), hit).unwrap_or(STRAIGHT)
    }

    fn seen(&self, t: usize, [v, w]: [f64; 2], hit: &Hit) -> Option<Direction> {
        let normals = self.mesh.triangles[t].map(|v| self.normals[v as usize]);
        let axes = Axes::at(normals, self.tangents.get(t)?, [1.0 - v - w, v, w])?;
        let mut inward = axes.inward(hit.normal.map(f64::from))?;
        if inward[2] < 0.0 && !hit.faces {
            return None;
        }
        inward[2] = inward[2].max(LEAST_UP);
        let length = dot(inward, inward).sqrt();
        Some(inward.map(|x| (x / length) as f32))
    }
}

/// The pixel of the mean of some directions, and its angle to the result's normal in millionths of a degree.
pub(super) fn mean_directions(directions: impl Iterator<Item = Direction>) -> ([u8; 4], u32) {
    let [x, y, z] = directions.fold([0.0f32; 3], add);
    let across = x.hypot(y);
    let length = across.hypot(z);
    let tilt = (1e6 * f64::from(across).atan2(f64::from(z)).to_degrees()).round() as u32;
    let step =
        |x: f32| (127.5 * (1.0 + x / length) + 0.5 + UPWARDS).floor().clamp(0.0, 255.0) as u8;
    // All directions are upwards, so there is a length.
    ([step(x), step(y), step(z), 255], tilt)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_hold_directions() {
        let straight = [[1e-5, 0.0, 1.0], [-3e-5, 0.0, 1.0]];
        assert_eq!(mean_directions(straight.into_iter()), (STRAIGHT_PIXEL, 573));
        let (pixel, tilt) = mean_directions([[0.6, 0.0, 0.8], [-0.6, 0.6, 0.8]].into_iter());
        // The mean is (0, 0.3, 0.8), of length 0.8544.
        assert_eq!(pixel, [128, 172, 247, 255]);
        assert_eq!(tilt / 1_000_000, 20);
    }
}
