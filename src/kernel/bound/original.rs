//! Points of the original that ride with the triangles of a surface, as a round before has left them.

use crate::surface::Surface;
use crate::vertex::GONE;
use stonecut_mesh::extremes::Extremes;
use stonecut_mesh::vec3::{Vec3, add};

/// A point of the original, as a round before has left it.
pub(super) struct OriginalPoint {
    /// In input units.
    pub(super) at: Vec3,
    /// Largest distance from where it was; in input units.
    pub(super) rounding: f32,
    pub(super) triangle: u32,
}

/// The points over all triangles that are there.
pub(super) fn original_points<'a>(
    surface: &'a Surface,
    extremes: &'a [Extremes],
) -> impl Iterator<Item = OriginalPoint> + 'a {
    let of_triangles = (0u32..).zip(surface.triangles.iter().zip(extremes));
    of_triangles.filter(|(_, (t, _))| t[0] != GONE).flat_map(|(triangle, (t, extremes))| {
        let corner = surface.vertices[t[0] as usize].position;
        // Of a cube's half diagonal.
        let rounding = 1.74 * extremes.rounding();
        let at = move |offset: [f32; 3]| add(corner, offset.map(f64::from));
        extremes.offsets().map(move |offset| OriginalPoint { at: at(offset), rounding, triangle })
    })
}
