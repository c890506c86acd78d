//! Folds: edges at which the surface turns back onto itself, as at the rim of a sheet that has no thickness to
//! speak of.
//!
//! Both sides of such a sheet have the same plane, so a quadric of planes lets its rim recede for nothing, and
//! collapse by collapse the sheet is eaten away. An open boundary would be in the same plight and is held by a
//! quadric of its edges; a fold is held by the same. It is computed again whenever the quadric of a vertex is, and
//! not tracked in between.
//!
//! docs/algorithm.md, section 1, has the terms.

use crate::kernel::simd::unchecked::KnownIds;
use crate::kernel::surface::{Surface, boundary_quadric};
use crate::mesh::corners::others;
use crate::mesh::vec3::{add, cross, dot, scale};

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
pub(crate) fn quadric(
    (known, surface): (KnownIds, &Surface),
    v: u32,
    b: &[u32],
    c: &[u32],
) -> [f32; 6] {
    let mut sum = [0.0; 6];
    let mut normals = [[0.0f32; 3]; MOST];
    if b.len() > MOST {
        return sum;
    }
    for (normal, (&b, &c)) in normals.iter_mut().zip(b.iter().zip(c)) {
        *normal = cross(surface.known_edge(known, v, b), surface.known_edge(known, v, c));
    }
    tip((known, surface), v, &normals[..b.len()], b, &mut sum);
    for (&n0, &w) in normals.iter().zip(c) {
        let Some(next) = b.iter().position(|&other| other == w) else { continue };
        let n1 = normals[next];
        let along = dot(n0, n1);
        if along < 0.0 && along * along > FOLD_COSINE * FOLD_COSINE * dot(n0, n0) * dot(n1, n1) {
            for (sum, x) in sum.iter_mut().zip(boundary_quadric(surface.known_edge(known, v, w))) {
                *sum += FOLD_WEIGHT * x;
            }
        }
    }
    sum
}

/// Adds what holds the tip of a spike: all its edges run one way, and its area moves along that way.
fn tip(
    (known, surface): (KnownIds, &Surface),
    v: u32,
    normals: &[[f32; 3]],
    b: &[u32],
    sum: &mut [f32; 6],
) {
    let mut way = [0.0f32; 3];
    for &w in b {
        let edge = surface.known_edge(known, v, w);
        let length = dot(edge, edge).sqrt();
        if length > 0.0 {
            way = add(way, scale(edge, 1.0 / length));
        }
    }
    let way_sq = dot(way, way);
    let n = b.len() as f32;
    if b.len() < 3 || way_sq <= TIP_SHARE * TIP_SHARE * n * n {
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
pub(crate) fn quadric_of(known: KnownIds, surface: &Surface, v: u32) -> [f32; 6] {
    let (mut b, mut c) = ([0; MOST], [0; MOST]);
    let ring = surface.ring(v);
    for ((b, c), &t) in b.iter_mut().zip(&mut c).zip(ring) {
        (*b, *c) = others(surface.triangles[t as usize], v);
    }
    let n = ring.len().min(MOST);
    quadric((known, surface), v, &b[..n], &c[..n])
}
