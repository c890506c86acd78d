//! Terms for places that planes do not hold: folds, tips of spikes, ends of open strips.
//!
//! At a fold the surface turns back onto itself, as at the rim of a sheet that has no thickness to speak of. Both sides have
//! the same plane, so a quadric of planes lets the rim recede for nothing, and collapse by collapse the sheet is eaten
//! away. An open boundary would be in the same plight and is held by a quadric of its edges; a fold is held by the same.
//! Where all edges of a vertex run one way, at a tip or an end, neither holds it along them: its area does. All of this is
//! computed again whenever the quadric of a vertex is, and not tracked in between.
//!
//! docs/algorithm.md, section 1, has the terms.

use crate::surface::{Surface, boundary_quadric};
use stonecut_mesh::corners::others;
use stonecut_mesh::vec3::{add, cross, dot, scale};

/// Two triangles whose normals have a cosine below this make a fold.
const FOLD_COSINE: f32 = -0.5;
/// Cost of moving a fold, as a share of a boundary: two sheets end there, but each of them is thin.
const FOLD_WEIGHT: f32 = 0.5;
/// A vertex is a tip if the unit vectors along its edges add up to more than this share of their number: within
/// about 37 degrees of each other's mean.
const TIP_SHARE: f32 = 0.8;
/// Weight of the term that holds a tip, times the area around it: removing it would cost that area times two thirds
/// of the squared height, at the rate of `topology::price`.
const TIP_WEIGHT: f32 = 4.7;
/// A vertex of at most this many triangles may be the end of a strip.
pub(crate) const MOST_OF_STRIP: usize = 2;
/// The normals of a vertex on a fold add up to less than this share of their lengths; those of a crease of a
/// right angle to 0.71.
const OPEN_SHARE: f32 = 0.7;

/// Returns whether a vertex may be on a fold, by its quadric (A and G) of triangles alone.
#[inline(always)]
pub(crate) fn may_fold(quadric: &[f32; 9]) -> bool {
    let [xx, _, _, yy, _, zz, x, y, z] = *quadric;
    // The trace is half the sum of the lengths of the normals.
    let sum = 2.0 * OPEN_SHARE * (xx + yy + zz);
    x * x + y * y + z * z < sum * sum
}

/// More triangles around one vertex than this are not looked at.
const MOST: usize = 64;

/// The quadric of the folds at a vertex, over all of its triangles: their corners `b` and `c`, in their
/// sense of rotation.
#[inline(never)]
pub(crate) fn quadric(surface: &Surface, v: u32, b: &[u32], c: &[u32]) -> [f32; 6] {
    let mut sum = [0.0; 6];
    let mut normals = [[0.0f32; 3]; MOST];
    if b.len() > MOST {
        return sum;
    }
    for (normal, (&b, &c)) in normals.iter_mut().zip(b.iter().zip(c)) {
        *normal = cross(surface.edge(v, b), surface.edge(v, c));
    }
    tip(surface, v, &normals[..b.len()], (b, c), &mut sum);
    for (&n0, &w) in normals.iter().zip(c) {
        let Some(next) = b.iter().position(|&other| other == w) else { continue };
        let n1 = normals[next];
        let along = dot(n0, n1);
        if along < 0.0 && along * along > FOLD_COSINE * FOLD_COSINE * dot(n0, n0) * dot(n1, n1) {
            for (sum, x) in sum.iter_mut().zip(boundary_quadric(surface.edge(v, w))) {
                *sum += FOLD_WEIGHT * x;
            }
        }
    }
    sum
}

/// Adds what holds the tip of a spike or the end of a strip: all its edges run one way, and its area moves along that
/// way.
fn tip(
    surface: &Surface,
    v: u32,
    normals: &[[f32; 3]],
    (b, c): (&[u32], &[u32]),
    sum: &mut [f32; 6],
) {
    let mut way = [0.0f32; 3];
    let mut n = 0.0f32;
    let is_strip = b.len() <= MOST_OF_STRIP;
    // Around a closed fan the other corners come up again.
    let last = c.iter().filter(|w| is_strip && !b.contains(w));
    for &w in b.iter().chain(last) {
        let edge = surface.edge(v, w);
        let length = dot(edge, edge).sqrt();
        if length > 0.0 {
            way = add(way, scale(edge, 1.0 / length));
        }
        n += 1.0;
    }
    let way_sq = dot(way, way);
    if way_sq <= TIP_SHARE * TIP_SHARE * n * n {
        return;
    }
    let area = normals.iter().map(|&n| 0.5 * dot(n, n).sqrt()).sum::<f32>();
    let weight = TIP_WEIGHT * area / way_sq;
    let [x, y, z] = way;
    for (sum, q) in sum.iter_mut().zip([x * x, x * y, x * z, y * y, y * z, z * z]) {
        *sum += weight * q;
    }
}

/// The same of a vertex by its ring.
#[inline(never)]
fn quadric_of(surface: &Surface, v: u32) -> [f32; 6] {
    let (mut b, mut c) = ([0; MOST], [0; MOST]);
    let ring = surface.ring(v);
    for ((b, c), &t) in b.iter_mut().zip(&mut c).zip(ring) {
        (*b, *c) = others(surface.triangles[t as usize], v);
    }
    let n = ring.len().min(MOST);
    quadric(surface, v, &b[..n], &c[..n])
}

/// Adds what holds folds, tips and ends of strips to the quadric of a vertex.
#[inline(always)]
pub(crate) fn hold(surface: &mut Surface, v: u32) {
    let (vertex, ring) = (&surface.vertices[v as usize], &surface.rings[v as usize]);
    if ring.len <= MOST_OF_STRIP as u32 || may_fold(&vertex.quadric) {
        let held = quadric_of(surface, v);
        for (sum, x) in surface.vertices[v as usize].quadric.iter_mut().zip(held) {
            *sum += x;
        }
    }
}
