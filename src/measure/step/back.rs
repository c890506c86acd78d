//! From the simplified version back to the mesh: samples, each held against what went into the vertices around it.

use super::around::{Around, Forward, NONE};
use super::covered::Covered;
use super::exact::Exact;
use super::foot::Doubtful;
use super::largest::Largest;
use crate::measure::triangle::{Vector, closest};
use crate::mesh::Mesh;
use std::collections::BinaryHeap;

struct Back<'a> {
    fine: &'a Mesh,
    /// For each vertex of the version the triangles of the mesh with a corner that went into it.
    near: &'a Around,
    /// Samples that are farther than what is accepted.
    doubtful: BinaryHeap<Doubtful>,
    points: Vec<Vector>,
}

/// Looks at the vertices and the middles of triangles of the version that nothing was found to lie over, and at the middles of
/// the edges of its boundary. Elsewhere the pieces of the way there cover it.
pub(super) fn samples(forward: &Forward, near: &Around, covered: &Covered, largest: &mut Largest) {
    let Forward { fine, coarse, around } = *forward;
    let mut back = Back { fine, near, doubtful: BinaryHeap::new(), points: Vec::new() };
    // Around a vertex inside of a surface every edge comes in as often as it goes out.
    let mut balance = vec![0u32; coarse.positions.len()];
    for &[a, b, c] in &coarse.triangles {
        for (v, next, last) in [(a, b, c), (b, c, a), (c, a, b)] {
            balance[v as usize] = balance[v as usize].wrapping_add(next).wrapping_sub(last);
        }
    }
    for (v, &point) in (0u32..).zip(&coarse.positions) {
        if !covered.vertices[v as usize] && !around.of(v).is_empty() {
            back.look(point, &[v], largest);
        }
    }
    for (t, &corners) in coarse.triangles.iter().enumerate() {
        let at = coarse.corners(t);
        if !covered.triangles[t] {
            let middle = [0, 1, 2].map(|k| (at[0][k] + at[1][k] + at[2][k]) / 3.0);
            back.look(middle, &corners, largest);
        }
        for k in 0..3 {
            let (v, w) = (corners[k], corners[(k + 1) % 3]);
            let is_border = balance[v as usize] != 0 && balance[w as usize] != 0;
            if is_border {
                let (p, q) = (at[k], at[(k + 1) % 3]);
                back.look([0, 1, 2].map(|k| 0.5 * (p[k] + q[k])), &[v, w], largest);
            }
        }
    }
    let mut exact = Exact::new(fine);
    while let Some(Doubtful { distance_sq, item }) = back.doubtful.pop() {
        if largest.accepts(distance_sq) {
            break;
        }
        let point = back.points[item as usize];
        largest.add(exact.nearest(point, (distance_sq, NONE)).0);
    }
}

impl Back<'_> {
    /// The distance of a sample from the triangles that went into some vertices, at most.
    fn look(&mut self, point: Vector, hints: &[u32], largest: &mut Largest) {
        let mut best_sq = f64::INFINITY;
        let enough_sq = largest.certain_sq;
        'found: for &hint in hints {
            for &t in self.near.of(hint) {
                let (distance_sq, _) = closest(point, &self.fine.corners(t as usize));
                if distance_sq < best_sq {
                    best_sq = distance_sq;
                    if best_sq <= enough_sq {
                        break 'found;
                    }
                }
            }
        }
        if !largest.accepts(best_sq) {
            let item = self.points.len() as u32;
            self.points.push(point);
            self.doubtful.push(Doubtful { distance_sq: best_sq, item });
        }
    }
}
