//! Polygons in space cut into triangles: by least area where they have few corners, by ears in their plane where they have many.
//!
//! Source: Barequet & Sharir 1995 (docs/references.md).

use crate::repair::close::rims::{Rim, place};
use crate::surface::Surface;
use std::collections::BTreeSet;
use stonecut_mesh::vec3::{Vec3, cross, length_sq, sub};

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
    let (a, b) = (ring[i], ring[k]);
    // A bridge is there twice already.
    let mut sides = ring.iter().zip(ring.iter().cycle().skip(1));
    !are_joined(surface, a, b) && !sides.any(|(&v, &w)| [v, w] == [a, b] || [v, w] == [b, a])
}

/// The least weights of the parts of a polygon, from one corner to another.
#[derive(Clone)]
pub(super) struct LeastWeights {
    places: Vec<Vec3>,
    /// Of the part between two corners, a row for either of them.
    weights: Vec<f64>,
    /// The corner between the two that it comes from, in the row of the first.
    middles: Vec<u32>,
}

impl LeastWeights {
    /// While every triangle may be made. Moving the polygon as a whole does not change them.
    pub(super) fn new(surface: &Surface, ring: &[u32]) -> Self {
        let n = ring.len();
        let mut weights = vec![f64::INFINITY; n * n];
        for i in 1..n {
            (weights[(i - 1) * n + i], weights[i * n + i - 1]) = (0.0, 0.0);
        }
        let places = ring.iter().map(|&v| place(surface, v)).collect();
        let mut parts = LeastWeights { places, weights, middles: vec![0; n * n] };
        for length in 2..n {
            for i in 0..n - length {
                if length == n - 1 || may_join(surface, ring, i, i + length) {
                    parts.look(ring, (i, i + length), &Forbidden::new());
                }
            }
        }
        parts
    }

    /// Finds the least weight of the part from one corner to another and the corner between that it comes from.
    fn look(&mut self, ring: &[u32], (i, k): (usize, usize), forbidden: &Forbidden) {
        let n = ring.len();
        let (weight, middle) = self.least(ring, (i, k), forbidden);
        (self.weights[i * n + k], self.weights[k * n + i]) = (weight, weight);
        self.middles[i * n + k] = middle;
    }

    /// The least weight of the part from one corner to another and the corner between that it comes from.
    fn least(&self, ring: &[u32], (i, k): (usize, usize), forbidden: &Forbidden) -> (f64, u32) {
        let n = ring.len();
        let [row, other] = [i, k].map(|at| &self.weights[at * n + i + 1..at * n + k]);
        let mut least = (f64::INFINITY, 0);
        for ((&before, &after), m) in row.iter().zip(other).zip(i + 1..) {
            let parts = before + after;
            if parts >= least.0 {
                continue;
            }
            let [a, b, c] = [i, m, k].map(|at| self.places[at]);
            let sides = [sub(b, a), sub(c, b), sub(a, c)];
            let area = length_sq(cross(sides[0], sides[1])).sqrt();
            let weight = parts + area + SHAPE * sides.into_iter().map(length_sq).sum::<f64>();
            let corners = [ring[i], ring[m], ring[k]];
            if weight < least.0 && area > 0.0 && !forbidden.contains(&sorted(corners)) {
                least = (weight, m as u32);
            }
        }
        least
    }
}

/// Cuts a polygon into the triangles of least area that run as it does; `None` if that cannot be. The parts are kept from one attempt
/// to the next, which forbids more triangles: only parts that had one of them weigh more then.
pub(super) fn by_area(
    ring: &[u32],
    forbidden: &Forbidden,
    parts: &mut LeastWeights,
) -> Option<Vec<[u32; 3]>> {
    let n = ring.len();
    let mut is_heavier = vec![false; n * n];
    for length in 2..n {
        for i in 0..n - length {
            let k = i + length;
            let m = parts.middles[i * n + k] as usize;
            let has_heavier = is_heavier[i * n + m] || is_heavier[m * n + k];
            if parts.weights[i * n + k].is_finite()
                && (has_heavier || forbidden.contains(&sorted([ring[i], ring[m], ring[k]])))
            {
                parts.look(ring, (i, k), forbidden);
                is_heavier[i * n + k] = true;
            }
        }
    }
    let mut triangles = Vec::with_capacity(n - 2);
    let mut open = vec![(0, n - 1)];
    while let Some((i, k)) = open.pop().filter(|_| parts.weights[n - 1].is_finite()) {
        if k > i + 1 {
            let m = parts.middles[i * n + k] as usize;
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
