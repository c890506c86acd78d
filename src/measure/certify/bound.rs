//! Proven bounds of the distance between a point and a triangle, rounding included.
//!
//! `upper` names a point of the triangle and `lower` a plane that separates it from the point, so neither relies
//! on the search that proposed them. docs/design/certificate.md proves the constants.

// Three axes run through several arrays side by side; an index shows that best.
#![allow(clippy::needless_range_loop)]

use crate::triangle::{self, Vector};
use stonecut_mesh::bounds::Bounds;
use stonecut_mesh::vec3::{cross, dot, length_sq, sub};

/// Rounding of a bound in the sum of the coordinates it is computed from: 16 units of rounding, 8 are needed.
pub(super) const ROUNDING: f64 = 16.0 * UNIT_ROUNDING;

/// A triangle is a sliver if the squared sine at its first corner is below this.
const SLIVER_SQ: f64 = 1e-5;

/// The unit of rounding of `f64`.
const UNIT_ROUNDING: f64 = f64::EPSILON / 2.0;

/// Bound on what underflow adds to a distance: the root of a few of the least numbers, with room to spare.
pub(super) const UNDERFLOW: f64 = 1e-159;

/// Squared lengths below this have lost digits to underflow.
const LEAST_SQ: f64 = 1e-280;

/// An upper bound of the distance from a point to a triangle, and the way to the point from the point of the
/// triangle that it was taken at.
///
/// Exactly 0 at the corners. The way is rounded.
#[inline]
pub(super) fn upper_and_way(point: Vector, t: &[Vector; 3]) -> (f64, Vector) {
    if point == t[0] || point == t[1] || point == t[2] {
        return (0.0, [0.0; 3]);
    }
    let (_, weights) = triangle::closest(point, t);
    let (ab, ac) = (sub(t[1], t[0]), sub(t[2], t[0]));
    let (ab_sq, ac_sq, along) = (length_sq(ab), length_sq(ac), dot(ab, ac));
    // The weights of a sliver lose digits; its distance need not.
    if ab_sq * ac_sq - along * along <= SLIVER_SQ * (ab_sq * ac_sq) {
        return upper_of_sliver(point, t);
    }
    upper_at(point, t, [weights[1], weights[2]])
}

/// The upper bound taken at given weights of the second and the third corner, and the way from there.
///
/// Whatever they are, they become those of a point of the triangle, to one rounding.
#[inline]
fn upper_at(point: Vector, t: &[Vector; 3], weights: [f64; 2]) -> (f64, Vector) {
    let v = if weights[0] > 0.0 { weights[0].min(1.0) } else { 0.0 };
    let w = if weights[1] > 0.0 { weights[1].min(1.0 - v) } else { 0.0 };
    let (mut way, mut sum_sq, mut size) = ([0.0; 3], 0.0, 0.0);
    for k in 0..3 {
        let (ab, ac, ap) = (t[1][k] - t[0][k], t[2][k] - t[0][k], point[k] - t[0][k]);
        way[k] = ap - v * ab - w * ac;
        sum_sq += way[k] * way[k];
        size += ap.abs() + ab.abs() + ac.abs();
    }
    (sum_sq.sqrt() + (ROUNDING * size + UNDERFLOW), way)
}

/// The best of the three edges and of the foot in the plane, which is refined.
#[cold]
fn upper_of_sliver(point: Vector, t: &[Vector; 3]) -> (f64, Vector) {
    let on = |from: usize, to: usize| triangle::closest_on_edge(point, t[from], t[to]).1;
    let (first, second, third) = (on(0, 1), on(0, 2), on(1, 2));
    let mut best = upper_at(point, t, [first, 0.0]);
    let mut offer = |weights: [f64; 2]| {
        let found = upper_at(point, t, weights);
        if found.0 < best.0 {
            best = found;
        }
    };
    offer([0.0, second]);
    offer([1.0 - third, third]);
    let (ab, ac, mut rest) = (sub(t[1], t[0]), sub(t[2], t[0]), sub(point, t[0]));
    let normal = cross(ab, ac);
    let normal_sq = length_sq(normal);
    let (mut v, mut w) = (0.0, 0.0);
    for _ in 0..3 {
        // Of what is left, the part in the plane.
        v += dot(cross(rest, ac), normal) / normal_sq;
        w += dot(cross(ab, rest), normal) / normal_sq;
        rest = [0, 1, 2].map(|k| (point[k] - t[0][k]) - v * ab[k] - w * ac[k]);
    }
    if v >= 0.0 && w >= 0.0 && v + w <= 1.0 {
        offer([v, w]);
    }
    best
}

/// An upper bound of the distance from a point to a triangle.
#[inline]
pub(super) fn upper(point: Vector, t: &[Vector; 3]) -> f64 {
    upper_and_way(point, t).0
}

/// A lower bound of the distance from a point to a triangle.
///
/// For any direction, no point of the triangle is nearer than the nearest of its corners along it. The best of
/// the directions that matter gives the distance itself, to rounding: the normal, those square to an edge, those
/// to a corner.
pub(super) fn lower(point: Vector, t: &[Vector; 3]) -> f64 {
    let from = t.map(|corner| sub(point, corner));
    let size = from.iter().flatten().fold(0f64, |most, x| most.max(x.abs()));
    let least_along = |direction: Vector| -> f64 {
        let length_sq = length_sq(direction);
        if !(length_sq > LEAST_SQ && length_sq.is_finite()) {
            return 0.0;
        }
        let least = from.iter().map(|&f| dot(direction, f)).fold(f64::INFINITY, f64::min);
        least / length_sq.sqrt()
    };
    let normal = triangle::area_normal(t);
    let mut best = least_along(normal).max(least_along(normal.map(|x| -x)));
    for i in 0..3 {
        best = best.max(least_along(from[i]));
        let edge = sub(t[(i + 1) % 3], t[i]);
        // Twice, since the first time leaves a share of the edge that is large beside a short rest.
        let across = square_to(square_to(from[i], edge), edge);
        best = best.max(least_along(across));
    }
    (best - (3.0 * ROUNDING * size + UNDERFLOW)).max(0.0)
}

fn square_to(v: Vector, edge: Vector) -> Vector {
    let along = dot(v, edge) / length_sq(edge);
    if along.is_finite() { [0, 1, 2].map(|k| v[k] - along * edge[k]) } else { v }
}

/// A lower bound of the distance from a point to everything within a box.
#[inline]
pub(super) fn lower_to_box(point: Vector, around: &Bounds) -> f64 {
    around.distance_sq(point).sqrt() * (1.0 - ROUNDING)
}

/// Bounds how far a point that is computed on an edge may be off it, in a space of coordinates up to `largest`.
pub(super) fn off_edge(largest: f64) -> f64 {
    ROUNDING * largest + UNDERFLOW
}

/// The point at `share` of the way from `a` to `b`.
#[inline]
pub(super) fn on_edge(a: Vector, b: Vector, share: f64) -> Vector {
    [0, 1, 2].map(|k| a[k] + share * (b[k] - a[k]))
}
