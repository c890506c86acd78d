//! From the mesh to its simplified version: a proven bound for every triangle.

use super::across::across_sq;
use super::around::{Forward, NONE};
use super::covered::{Covered, QUARTERS, with_middles};
use super::exact::Exact;
use super::foot::{Doubtful, Foot};
use super::largest::Largest;
use crate::measure::triangle::{Vector, closest};
use crate::mesh::vec3::{length_sq, sub};
use std::collections::BinaryHeap;

/// A triangle is quartered so often, at most.
const DEEPEST: u32 = 6;

impl Forward<'_> {
    /// Bounds the distances of all triangles: looks closer at the farthest ones, and at those over no star.
    pub(super) fn triangles(
        &self,
        hints: &[u32],
        covered: &Covered,
        largest: &mut Largest,
        exact: &mut Exact,
    ) {
        let most = &covered.most;
        let doubtful = |t: usize| Doubtful { distance_sq: most[t] * most[t], item: t as u32 };
        let is_seen = |t: &usize| most[*t].is_finite();
        // The farthest one shows how far at least the two are apart.
        let farthest = (0..most.len()).filter(is_seen).max_by(|&a, &b| most[a].total_cmp(&most[b]));
        if let Some(t) = farthest {
            self.look(self.with_hints(t, hints), largest, exact);
        }
        let (mut far, mut near_sq) = (BinaryHeap::new(), 0.0f64);
        for doubtful in (0..most.len()).filter(is_seen).map(doubtful) {
            match doubtful.distance_sq > largest.enough_sq() {
                true => far.push(doubtful),
                false => near_sq = near_sq.max(doubtful.distance_sq),
            }
        }
        while let Some(Doubtful { distance_sq, item }) = far.pop() {
            if largest.accepts(distance_sq) {
                break;
            }
            self.look(self.with_hints(item as usize, hints), largest, exact);
        }
        largest.bound_sq = largest.bound_sq.max(near_sq);
        for quartered in &covered.rest {
            let sq = quartered.most * quartered.most;
            let is_near = quartered.done != 0 && largest.accepts(sq);
            let [a, b, c] = self.with_hints(quartered.triangle as usize, hints);
            let middles = with_middles([a.0, b.0, c.0]);
            let hints = [a.1, b.1, c.1, a.1, b.1, c.1];
            for (quarter, parts) in QUARTERS.iter().enumerate() {
                if !(is_near && quartered.done & 1 << quarter != 0) {
                    self.look(parts.map(|k| (middles[k], hints[k])), largest, exact);
                }
            }
        }
    }

    /// The corners of a triangle with the vertices of the version near them.
    pub(super) fn with_hints(&self, t: usize, hints: &[u32]) -> [(Vector, u32); 3] {
        self.fine.triangles[t].map(|v| (self.fine.positions[v as usize], hints[v as usize]))
    }

    /// Bounds the distance of a triangle by itself; each corner has a vertex of the version near it.
    pub(super) fn look(
        &self,
        corners: [(Vector, u32); 3],
        largest: &mut Largest,
        exact: &mut Exact,
    ) {
        if self.is_beside(&corners, largest.bound_sq) {
            return;
        }
        let feet =
            corners.map(|(place, hint)| self.certain(self.descend(place, hint), largest, exact));
        self.cover(feet, 0, largest, exact);
    }

    /// True if a triangle is not farther than a squared distance from one of the vertices near its corners: it is farthest from
    /// that at a corner.
    pub(super) fn is_beside(&self, corners: &[(Vector, u32); 3], distance_sq: f64) -> bool {
        corners.iter().any(|&(_, hint)| {
            hint != NONE && {
                let at = self.coarse.positions[hint as usize];
                corners.iter().all(|&(corner, _)| length_sq(sub(corner, at)) <= distance_sq)
            }
        })
    }

    /// Looks for the foot of a point everywhere if it is so far that it would count.
    fn certain(&self, mut foot: Foot, largest: &mut Largest, exact: &mut Exact) -> Foot {
        if foot.triangle == NONE || foot.distance_sq > largest.enough_sq() {
            let guess = (foot.distance_sq, foot.triangle);
            (foot.distance_sq, foot.triangle) = exact.nearest(foot.point, guess);
            foot.hint = self.coarse.triangles[foot.triangle as usize][0];
            largest.add(foot.distance_sq);
        }
        foot
    }

    /// The nearest triangle around a vertex, then around the corner nearest to the foot, as long as that gains.
    fn descend(&self, point: Vector, hint: u32) -> Foot {
        let mut best = Foot { point, distance_sq: f64::INFINITY, triangle: NONE, hint };
        let mut at = hint;
        while at != NONE {
            let mut weights = None;
            for &t in self.around.of(at) {
                let (distance_sq, w) = closest(point, &self.coarse.corners(t as usize));
                if distance_sq < best.distance_sq {
                    (best.distance_sq, best.triangle, weights) = (distance_sq, t, Some(w));
                }
            }
            let Some(w) = weights else { break };
            let corner =
                if w[0] >= w[1] && w[0] >= w[2] { 0 } else { 1 + usize::from(w[2] > w[1]) };
            let next = self.coarse.triangles[best.triangle as usize][corner];
            best.hint = next;
            at = if next == at { NONE } else { next };
        }
        best
    }

    /// The squared distance of a triangle from the nearest of the triangles of its feet, at most.
    ///
    /// The distance to each of these is convex, and so is any mean of them, which is nowhere below the least: at a
    /// corner a mean is largest.
    fn mixed_sq(&self, feet: &[Foot; 3], enough_sq: f64) -> f64 {
        let [a, b, c] = feet.map(|foot| foot.triangle);
        let most = |d: [f64; 3]| d[0].max(d[1]).max(d[2]);
        if a == b && b == c {
            return most(feet.map(|foot| foot.distance_sq));
        }
        let to = |triangle: u32| {
            let t = self.coarse.corners(triangle as usize);
            feet.map(|foot| match foot.triangle == triangle {
                true => foot.distance_sq,
                false => closest(foot.point, &t).0,
            })
        };
        // Two corners with one foot: that triangle first.
        let (a, b, c) = if b == c { (b, a, c) } else { (a, b, c) };
        let to_a = to(a);
        let mut least = most(to_a);
        if least <= enough_sq {
            return least;
        }
        let mean = |a: [f64; 3], b: [f64; 3]| most([0, 1, 2].map(|k| 0.5 * (a[k] + b[k]))).powi(2);
        let to_a = to_a.map(f64::sqrt);
        let to_b = if b == a { to(c) } else { to(b) };
        least = least.min(most(to_b));
        let to_b = to_b.map(f64::sqrt);
        least = least.min(mean(to_a, to_b));
        if least <= enough_sq || a == b || a == c || b == c {
            return least;
        }
        let to_c = to(c);
        least = least.min(most(to_c));
        let to_c = to_c.map(f64::sqrt);
        let all = most([0, 1, 2].map(|k| (to_a[k] + to_b[k] + to_c[k]) / 3.0)).powi(2);
        least.min(mean(to_a, to_c)).min(mean(to_b, to_c)).min(all)
    }

    /// Bounds the distance of a triangle.
    fn cover(&self, feet: [Foot; 3], depth: u32, largest: &mut Largest, exact: &mut Exact) {
        let enough_sq = largest.enough_sq();
        if depth == 0 {
            // No point of a triangle is farther from all corners than the longest side over the root of three.
            let side_sq = |i: usize, j: usize| length_sq(sub(feet[i].point, feet[j].point));
            let longest = side_sq(0, 1).max(side_sq(1, 2)).max(side_sq(2, 0)).sqrt();
            let own = feet.iter().map(|foot| foot.distance_sq).fold(0.0, f64::max).sqrt();
            let most = own + longest / 3f64.sqrt();
            if largest.accepts(most * most) {
                return;
            }
        }
        let mut least_sq = across_sq(&feet, self.coarse, self.around);
        if least_sq > enough_sq {
            least_sq = least_sq.min(self.mixed_sq(&feet, enough_sq));
        }
        if largest.accepts(least_sq) {
            return;
        }
        if depth == DEEPEST {
            largest.bound_sq = largest.bound_sq.max(least_sq);
            return;
        }
        let [a, b, c] = feet;
        let halves = [(a, b), (b, c), (c, a)].map(|(from, to)| {
            let point = [0, 1, 2].map(|k| 0.5 * (from.point[k] + to.point[k]));
            let foot = self.descend(point, from.hint);
            let other = self.descend(point, to.hint);
            let foot = if other.distance_sq < foot.distance_sq { other } else { foot };
            self.certain(foot, largest, exact)
        });
        let [ab, bc, ca] = halves;
        for part in [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]] {
            self.cover(part, depth + 1, largest, exact);
        }
    }
}
