//! The distance by which a rim would recede: that of both ends of a collapse from what would be around the survivor.
//!
//! Quadrics of planes see where a surface goes, not where it ends. At rims, of open sheets and of thin ones, terms of edges
//! and tips hold it in the mean; the farthest place is made at the corners of thin wedges, whose planes hardly differ. So a
//! collapse there waits until others are as dear as its distance.
//!
//! docs/algorithm.md, section 3, has the price.

use crate::kernel::surface::Surface;
use crate::kernel::surface::class::Class;
use crate::kernel::vertex::GONE;
use crate::mesh::vec3::triangle_distance_sq;

/// Vertices of more triangles than this are not looked at.
const MOST: u32 = 64;

/// Squared distance, in scaled units, of the ends of an edge from the triangles around its survivor, the larger one.
/// `place` is that of the survivor, relative to the midpoint.
pub(crate) fn recession_sq(surface: &Surface, (v0, v1): (u32, u32), place: [f32; 3]) -> f64 {
    let rings = [v0, v1].map(|v| &surface.rings[v as usize]);
    if rings.iter().any(|ring| ring.len > MOST) {
        return 0.0;
    }
    let half = surface.edge(v0, v1).map(|x| 0.5 * f64::from(x));
    let is_fixed = rings[1].class.is_some_and(Class::is_fixed);
    let survivor = if is_fixed { half } else { place.map(f64::from) };
    let at = |v: u32| {
        let edge = surface.edge(v0, v);
        let other: [f64; 3] = std::array::from_fn(|k| f64::from(edge[k]) - half[k]);
        if v == v0 || v == v1 { survivor } else { other }
    };
    let mut nearest_sq = [f64::INFINITY; 2];
    for v in [v0, v1] {
        for &t in surface.ring(v) {
            let corners = surface.triangles[t as usize];
            if corners[0] == GONE || (corners.contains(&v0) && corners.contains(&v1)) {
                continue;
            }
            let corners = corners.map(at);
            for (least, end) in nearest_sq.iter_mut().zip([half.map(|x| -x), half]) {
                *least = least.min(triangle_distance_sq(end, corners));
            }
        }
    }
    let farthest_sq = nearest_sq[0].max(nearest_sq[1]);
    if farthest_sq.is_finite() { farthest_sq } else { 0.0 }
}
