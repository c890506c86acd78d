//! From the mesh to its simplified version: a foot for every vertex, and a proven bound for every triangle.

use super::across::across_sq;
use super::around::{Around, Groups, NONE};
use super::exact::Exact;
use super::fans::Fans;
use super::foot::{Doubtful, Foot};
use super::largest::Largest;
use crate::measure::triangle::{Vector, closest};
use crate::mesh::Mesh;
use crate::mesh::corners::others;
use crate::mesh::vec3::{cross, dot, length_sq, sub};

use std::collections::BinaryHeap;

/// A triangle is quartered so often, at most.
const DEEPEST: u32 = 6;

/// Feet of vertices, and the bounds of triangles.
pub(super) struct Forward<'a> {
    fine: &'a Mesh,
    coarse: &'a Mesh,
    around: &'a Around,
    /// Squared distance and triangle for each vertex of the mesh.
    feet: Vec<(f64, u32)>,
}

impl<'a> Forward<'a> {
    /// Finds a foot for every vertex that has a triangle, around the vertex that its hint names.
    pub(super) fn new(
        fine: &'a Mesh,
        coarse: &'a Mesh,
        around: &'a Around,
        hints: &[u32],
    ) -> Forward<'a> {
        let mut forward = Forward { fine, coarse, around, feet: Vec::new() };
        forward.feet = forward.all_feet(hints);
        forward
    }

    /// A foot for every vertex: on the triangle around the vertex of its hint that it lies over, if there is one.
    fn all_feet(&self, hints: &[u32]) -> Vec<(f64, u32)> {
        let mut feet = vec![(f64::INFINITY, NONE); hints.len()];
        let groups = Groups::new(hints, self.coarse.positions.len());
        let mut sectors: Vec<(u32, [Vector; 2])> = Vec::new();
        for (u, own) in groups.each() {
            let ring = self.around.of(u);
            let centre = self.coarse.positions[u as usize];
            sectors.clear();
            sectors.extend(ring.iter().map(|&t| {
                let (b, c) = others(self.coarse.triangles[t as usize], u);
                let [b, c] = [b, c].map(|v| sub(self.coarse.positions[v as usize], centre));
                let n = cross(b, c);
                (t, [cross(n, b), cross(c, n)])
            }));
            for &v in own {
                let point = self.fine.positions[v as usize];
                let off = sub(point, centre);
                let is_over = |sides: &[Vector; 2]| sides.iter().all(|side| dot(*side, off) >= 0.0);
                let mut foot = None;
                if let Some(&(t, _)) = sectors.iter().find(|(_, sides)| is_over(sides)) {
                    let (distance_sq, w) = closest(point, &self.coarse.corners(t as usize));
                    let corners = self.coarse.triangles[t as usize];
                    let own = (0..3).find(|&k| corners[k] == u).unwrap_or(0);
                    // Beyond the rim the nearest triangle is another.
                    foot = (w[own] > 1e-9).then_some((distance_sq, t));
                }
                feet[v as usize] = foot.unwrap_or_else(|| {
                    let foot = self.descend(point, u);
                    (foot.distance_sq, foot.triangle)
                });
            }
        }
        feet
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

    /// Makes the largest distance of a vertex certain.
    pub(super) fn vertices(&mut self, largest: &mut Largest, exact: &mut Exact) {
        let mut is_used = vec![false; self.feet.len()];
        self.fine.triangles.as_flattened().iter().for_each(|&v| is_used[v as usize] = true);
        let all = (0u32..).zip(&self.feet).filter(|(v, _)| is_used[*v as usize]);
        let all = all.map(|(item, &(distance_sq, _))| Doubtful { distance_sq, item });
        let mut heap: BinaryHeap<Doubtful> = all.collect();
        while let Some(Doubtful { distance_sq, item }) = heap.pop() {
            if largest.accepts(distance_sq) {
                break;
            }
            let point = self.fine.positions[item as usize];
            let old = self.feet[item as usize];
            let near = match old.1 {
                NONE => None,
                t => Some(self.descend(point, self.coarse.triangles[t as usize][0])),
            };
            if let Some(near) = near.filter(|near| near.distance_sq < old.0) {
                self.feet[item as usize] = (near.distance_sq, near.triangle);
                heap.push(Doubtful { distance_sq: near.distance_sq, item });
                continue;
            }
            let foot = &mut self.feet[item as usize];
            *foot = exact.nearest(self.fine.positions[item as usize], *foot);
            largest.add(foot.0);
        }
    }

    /// The triangles on which vertices have their feet.
    pub(super) fn feet_triangles(&self) -> impl Iterator<Item = u32> {
        self.feet.iter().map(|(_, t)| *t).filter(|t| *t != NONE)
    }

    /// Bounds the distance of every triangle.
    pub(super) fn triangles(&self, hints: &[u32], largest: &mut Largest, exact: &mut Exact) {
        let fans = Fans::new(self.coarse, self.around);
        for corners in &self.fine.triangles {
            let at = corners.map(|v| self.fine.positions[v as usize]);
            let near = corners.map(|v| hints[v as usize]);
            let enough = largest.enough_sq().sqrt();
            let feet = corners.map(|v| {
                let (distance_sq, triangle) = self.feet[v as usize];
                (distance_sq.sqrt(), triangle)
            });
            let is_over = |k: usize| {
                near[k] != NONE && (k == 0 || near[k] != near[k - 1]) && {
                    let most = fans.over(at, feet, near[k]);
                    most <= enough && largest.accepts(most * most)
                }
            };
            if (0..3).any(is_over) {
                continue;
            }
            let feet = corners.map(|v| {
                let (distance_sq, triangle) = self.feet[v as usize];
                let point = self.fine.positions[v as usize];
                let hint = self.coarse.triangles[triangle as usize][0];
                Foot { point, distance_sq, triangle, hint }
            });
            self.cover(feet, 0, largest, exact);
        }
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
            let mut foot = if other.distance_sq < foot.distance_sq { other } else { foot };
            if foot.distance_sq > largest.enough_sq() {
                let guess = (foot.distance_sq, foot.triangle);
                (foot.distance_sq, foot.triangle) = exact.nearest(point, guess);
                foot.hint = self.coarse.triangles[foot.triangle as usize][0];
                largest.add(foot.distance_sq);
            }
            foot
        });
        let [ab, bc, ca] = halves;
        for part in [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]] {
            self.cover(part, depth + 1, largest, exact);
        }
    }
}
