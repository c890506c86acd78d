//! A bound for a triangle whose corners have their feet on different triangles of the version.
//!
//! The triangle is cut where it crosses from one of those to the next, and each piece is laid linearly into one of them:
//! what they have in common, an edge or a corner, belongs to both. The distance between a point and its image is convex
//! over a piece, so nowhere larger than at the piece's corners.

use super::around::Around;
use super::foot::Foot;
use crate::triangle::{Vector, closest, closest_on_edge};
use stonecut_mesh::Mesh;
use stonecut_mesh::vec3::{dot, length_sq, sub};

/// Triangles around a corner that a way may lead through, at most.
const MOST_LOOKED_AT: usize = 64;

/// Common corners of two triangles.
enum Common {
    Nothing,
    Corner(u32),
    Edge(u32, u32),
}

fn common(a: [u32; 3], b: [u32; 3]) -> Common {
    let mut found = a.into_iter().filter(|v| b.contains(v));
    match (found.next(), found.next()) {
        (Some(v), Some(w)) => Common::Edge(v, w),
        (Some(v), None) => Common::Corner(v),
        _ => Common::Nothing,
    }
}

/// The squared distance of a triangle from the triangles of its feet, at most; infinite if these do not hang together.
pub(super) fn across_sq(feet: &[Foot; 3], coarse: &Mesh, around: &Around) -> f64 {
    let corners = feet.map(|foot| coarse.triangles[foot.triangle as usize]);
    let own = feet.iter().map(|foot| foot.distance_sq).fold(0.0, f64::max);
    let edge = |i: usize, j: usize| [feet[i].point, feet[j].point];
    let same = [(0, 1), (1, 2), (2, 0)].map(|(i, j)| feet[i].triangle == feet[j].triangle);
    let way = Way { coarse, around };
    // One corner is alone on its triangle: both its edges must take the same way to that of the others.
    let alone = |k: usize| {
        let (i, j) = ((k + 1) % 3, (k + 2) % 3);
        own.max(way.between_sq((corners[k], corners[i]), &[edge(k, i), edge(k, j)]))
    };
    match same {
        [true, true, _] => own,
        [true, false, _] => alone(2),
        [false, true, _] => alone(0),
        [false, false, true] => alone(1),
        [false, false, false] => {
            // In the middle the pieces meet at a corner of all three, and every way crosses edges at that corner.
            let middle = corners[0]
                .into_iter()
                .filter(|v| corners[1].contains(v) && corners[2].contains(v))
                .map(|v| closest(coarse.positions[v as usize], &feet.map(|foot| foot.point)).0)
                .fold(f64::INFINITY, f64::min);
            if !middle.is_finite() {
                return middle;
            }
            let off = |i: usize, j: usize| way.between_sq((corners[i], corners[j]), &[edge(i, j)]);
            own.max(middle).max(off(0, 1)).max(off(1, 2)).max(off(2, 0))
        }
    }
}

/// Ways from triangle to triangle.
struct Way<'a> {
    coarse: &'a Mesh,
    around: &'a Around,
}

impl Way<'_> {
    /// The largest squared distance between some edges and what they cross from triangle `a` to triangle `b`: their common
    /// edge, two edges by way of a triangle between them, or their common corner.
    fn between_sq(&self, (a, b): ([u32; 3], [u32; 3]), edges: &[[Vector; 2]]) -> f64 {
        let at = |v: u32| self.coarse.positions[v as usize];
        let most = |off: &dyn Fn(&[Vector; 2]) -> f64| edges.iter().map(off).fold(0.0, f64::max);
        match common(a, b) {
            Common::Nothing => f64::INFINITY,
            Common::Edge(v, w) => most(&|edge| segments_sq(*edge, [at(v), at(w)])),
            Common::Corner(v) => {
                let mut least = most(&|edge| closest_on_edge(at(v), edge[0], edge[1]).0);
                for &t in self.around.of(v).iter().take(MOST_LOOKED_AT) {
                    let m = self.coarse.triangles[t as usize];
                    let other = |x: [u32; 3]| m.into_iter().find(|w| *w != v && x.contains(w));
                    if let (Some(p), Some(q)) = (other(a), other(b)) {
                        let sides = [[at(v), at(p)], [at(v), at(q)]];
                        least = least.min(most(&|edge| {
                            segments_sq(*edge, sides[0]).max(segments_sq(*edge, sides[1]))
                        }));
                    }
                }
                least
            }
        }
    }
}

/// The squared distance between two points of two segments that are about as near to each other as any.
fn segments_sq([p, q]: [Vector; 2], [r, s]: [Vector; 2]) -> f64 {
    let (u, v, w) = (sub(q, p), sub(s, r), sub(p, r));
    let (uu, uv, vv) = (dot(u, u), dot(u, v), dot(v, v));
    let (uw, vw) = (dot(u, w), dot(v, w));
    let share = |n: f64, d: f64| if d > 0.0 { (n / d).clamp(0.0, 1.0) } else { 0.0 };
    // Nearest to the line of the other, then each once more for the place on the other.
    let along = share(uv * vw - vv * uw, uu * vv - uv * uv);
    let other = share(uv * along + vw, vv);
    let along = share(uv * other - uw, uu);
    length_sq([0, 1, 2].map(|k| w[k] + along * u[k] - other * v[k]))
}
