//! Shapes of the triangles of a result.

use crate::{EdgesReport, SpreadReport};
use stonecut_mesh::Mesh;
use stonecut_mesh::vec3::{dot, length_sq, sub};

/// Of the smallest angle of each triangle, and of all edges.
pub(super) fn shapes(mesh: &Mesh) -> (SpreadReport, EdgesReport) {
    let n = mesh.triangles.len();
    if n == 0 {
        return Default::default();
    }
    let mut angles = Vec::with_capacity(n);
    let mut edges = Vec::with_capacity(3 * n);
    for t in 0..n {
        let at = mesh.corners(t);
        let angle = |k: usize| {
            let (a, b) = (sub(at[(k + 1) % 3], at[k]), sub(at[(k + 2) % 3], at[k]));
            let size = (length_sq(a) * length_sq(b)).sqrt();
            if size > 0.0 { (dot(a, b) / size).clamp(-1.0, 1.0).acos().to_degrees() } else { 0.0 }
        };
        angles.push((0..3).map(angle).fold(180.0, f64::min));
        edges.extend((0..3).map(|k| length_sq(sub(at[(k + 1) % 3], at[k])).sqrt()));
    }
    angles.sort_unstable_by(f64::total_cmp);
    edges.sort_unstable_by(f64::total_cmp);
    let (smallest, p01, median) = (angles[0], angles[n / 100], angles[n / 2]);
    let angles = SpreadReport { smallest, p01, median };
    let (shortest, median, longest) = (edges[0], edges[edges.len() / 2], edges[edges.len() - 1]);
    (angles, EdgesReport { shortest, median, longest })
}
