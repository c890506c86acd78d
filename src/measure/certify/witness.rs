//! Bounds on the distance of one point from a surface, from below and above, by a look at every triangle near it.
//!
//! A lower bound must hold for all triangles, so it must not rest on the answer of a search: every triangle whose
//! box is nearer than the best bound so far is looked at.

use super::bound::lower_to_box;
use crate::parts::{Means, Parts, Place};
use crate::triangle::Vector;
use stonecut_mesh::Mesh;
use stonecut_mesh::bounds::Bounds;
use stonecut_system::error::Result;

/// Triangles between two looks at the wish to stop.
const STOP_ROWS: usize = 1 << 16;

/// The least value that `bound` has for a triangle, or `best` if that is less; triangles whose boxes are farther do
/// not count. With `lower` that is a lower bound of the distance, worth `best` at the most; with `upper` an upper one.
pub(super) fn least(
    point: Vector,
    (surface, boxes): (&Parts, &[Bounds]),
    bound: fn(Vector, &[Vector; 3]) -> f64,
    mut best: f64,
    means: Means,
) -> Result<f64> {
    if let Place::Memory(mesh) = surface.place {
        return least_of(point, mesh, best, bound, means);
    }
    let mut order: Vec<(f64, usize)> = boxes
        .iter()
        .enumerate()
        .map(|(part, around)| (lower_to_box(point, around), part))
        .collect();
    order.sort_by(|a, b| a.0.total_cmp(&b.0));
    for (nearest, part) in order {
        if nearest >= best {
            break;
        }
        means.progress.check()?;
        let mesh = surface.load(part)?;
        best = least_of(point, &mesh, best, bound, means)?;
    }
    Ok(best)
}

fn least_of(
    point: Vector,
    mesh: &Mesh,
    mut best: f64,
    bound: fn(Vector, &[Vector; 3]) -> f64,
    means: Means,
) -> Result<f64> {
    for i in 0..mesh.triangles.len() {
        if i % STOP_ROWS == 0 {
            means.progress.check()?;
        }
        let corners = mesh.corners(i);
        if lower_to_box(point, &Bounds::around(&corners)) < best {
            best = best.min(bound(point, &corners));
        }
    }
    Ok(best)
}
