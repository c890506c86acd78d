//! Polygons in space cut into triangles: by least area where they have few corners, by ears in their plane where they have many.
//!
//! Source: Barequet & Sharir 1995 (docs/references.md).

use crate::repair::close::rims::{Rim, place};
use crate::surface::Surface;
use std::collections::BTreeSet;
use stonecut_mesh::vec3::{cross, length_sq, sub};

/// Weight of the squared lengths of a triangle's sides against its area: in a plane all areas are the same, and short sides decide.
const SHAPE: f64 = 1e-3;

/// Triangles that are not to be made, their corners sorted.
pub(super) type Forbidden = BTreeSet<[u32; 3]>;

pub(super) fn sorted(mut triangle: [u32; 3]) -> [u32; 3] {
    triangle.sort_unstable();
    triangle
}

/// Returns whether the surface has an edge between two vertices, or they are one.
fn are_joined(surface: &Surface, a: u32, b: u32) -> bool {
    a == b || surface.ring(a).iter().any(|&t| surface.triangles[t as usize].contains(&b))
}

/// One polygon of a loop and those within it: from the one to the other along the shortest way, and back.
pub(super) fn bridged(surface: &Surface, rim: &Rim, inner: &[&Rim]) -> Option<Vec<u32>> {
    let mut ring = rim.ring.clone();
    let mut left: Vec<&[u32]> = inner.iter().map(|rim| &rim.ring[..]).collect();
    let mut ends = BTreeSet::new();
    while !left.is_empty() {
        let mut best = (f64::INFINITY, 0, 0, 0);
        for (i, &v) in ring.iter().enumerate().filter(|(_, v)| !ends.contains(*v)) {
            for (hole, corners) in left.iter().enumerate() {
                for (k, &w) in corners.iter().enumerate() {
                    let apart = length_sq(sub(place(surface, v), place(surface, w)));
                    if apart < best.0 && !are_joined(surface, v, w) {
                        best = (apart, i, hole, k);
                    }
                }
            }
        }
        let (apart, at, hole, k) = best;
        if !apart.is_finite() {
            return None;
        }
        let hole = left.swap_remove(hole);
        ends.extend([ring[at], hole[k]]);
        let way = hole[k..].iter().chain(&hole[..=k]).copied().chain([ring[at]]);
        ring.splice(at + 1..at + 1, way.collect::<Vec<u32>>());
    }
    Some(ring)
}

/// Returns whether a polygon may have a side between two of its corners that are not neighbours.
fn may_join(surface: &Surface, ring: &[u32], i: usize, k: usize) -> bool {
    // A bridge is there twice already.
    let n = ring.len();
    let (a, b) = (ring[i], ring[k]);
    let is_side = |at: usize| [[a, b], [b, a]].contains(&[ring[at], ring[(at + 1) % n]]);
    !are_joined(surface, a, b) && !(0..n).any(is_side)
}

/// Cuts a polygon into the triangles of least area that run as it does; `None` if that cannot be.
pub(super) fn by_area(
    surface: &Surface,
    ring: &[u32],
    forbidden: &Forbidden,
) -> Option<Vec<[u32; 3]>> {
    let n = ring.len();
    let at = |i: usize| place(surface, ring[i]);
    // The least weight from one corner to another, and the corner between that it comes from.
    let mut best = vec![(f64::INFINITY, 0usize); n * n];
    (0..n - 1).for_each(|i| best[i * n + i + 1].0 = 0.0);
    for length in 2..n {
        for i in 0..n - length {
            let k = i + length;
            if length < n - 1 && !may_join(surface, ring, i, k) {
                continue;
            }
            let mut least = (f64::INFINITY, 0);
            for m in i + 1..k {
                let parts = best[i * n + m].0 + best[m * n + k].0;
                if parts >= least.0 {
                    continue;
                }
                let sides = [sub(at(m), at(i)), sub(at(k), at(m)), sub(at(i), at(k))];
                let area = length_sq(cross(sides[0], sides[1])).sqrt();
                let weight = parts + area + SHAPE * sides.into_iter().map(length_sq).sum::<f64>();
                let corners = [ring[i], ring[m], ring[k]];
                if weight < least.0 && area > 0.0 && !forbidden.contains(&sorted(corners)) {
                    least = (weight, m);
                }
            }
            best[i * n + k] = least;
        }
    }
    let mut triangles = Vec::with_capacity(n - 2);
    let mut open = vec![(0, n - 1)];
    while let Some((i, k)) = open.pop().filter(|_| best[n - 1].0.is_finite()) {
        if k > i + 1 {
            let m = best[i * n + k].1;
            triangles.push([ring[i], ring[m], ring[k]]);
            open.extend([(i, m), (m, k)]);
        }
    }
    (triangles.len() == n - 2).then_some(triangles)
}

/// The same by ears in its plane.
pub(super) fn by_ears(
    surface: &Surface,
    ring: &[u32],
    rim: &Rim,
    forbidden: &Forbidden,
) -> Option<Vec<[u32; 3]>> {
    let n = ring.len();
    let axes = rim.axes()?;
    let points: Vec<[f64; 2]> = ring.iter().map(|&v| rim.flat(surface, axes, v)).collect();
    let mut next: Vec<usize> = (0..n).map(|i| (i + 1) % n).collect();
    let mut last: Vec<usize> = (0..n).map(|i| (i + n - 1) % n).collect();
    let turn = |a: [f64; 2], b: [f64; 2], c: [f64; 2]| {
        (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    };
    // The shape of the ear at a corner, 0 if it is none.
    let ear = |i: usize, (last, next): (&[usize], &[usize]), n_left: usize| -> f64 {
        let [a, b, c] = [last[i], i, next[i]];
        let [p, q, r] = [points[a], points[b], points[c]];
        let area = turn(p, q, r);
        let is_last = n_left == 3;
        let corners = sorted([ring[a], ring[b], ring[c]]);
        if area.is_nan() || area <= 0.0 || forbidden.contains(&corners) {
            return 0.0;
        }
        let mut at = next[c];
        while at != a {
            let x = points[at];
            let is_corner = x == p || x == q || x == r;
            if !is_corner && turn(p, q, x) >= 0.0 && turn(q, r, x) >= 0.0 && turn(r, p, x) >= 0.0 {
                return 0.0;
            }
            at = next[at];
        }
        if !is_last && !may_join(surface, ring, a, c) {
            return 0.0;
        }
        let side = |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2);
        area / (side(p, q) + side(q, r) + side(r, p))
    };
    let mut shape: Vec<f64> = (0..n).map(|i| ear(i, (&last, &next), n)).collect();
    let mut triangles = Vec::with_capacity(n - 2);
    let mut left: Vec<usize> = (0..n).collect();
    let mut is_fresh = true;
    while left.len() > 2 {
        let best = (0..left.len()).max_by(|&x, &y| shape[left[x]].total_cmp(&shape[left[y]]))?;
        let i = left[best];
        if shape[i] <= 0.0 {
            if is_fresh {
                return None;
            }
            // Ears that others were in the way of.
            left.iter().for_each(|&i| shape[i] = ear(i, (&last, &next), left.len()));
            is_fresh = true;
            continue;
        }
        triangles.push([ring[last[i]], ring[i], ring[next[i]]]);
        left.swap_remove(best);
        let (a, c) = (last[i], next[i]);
        (next[a], last[c]) = (c, a);
        for i in [a, c] {
            shape[i] = ear(i, (&last, &next), left.len());
        }
        is_fresh = false;
    }
    Some(triangles)
}
