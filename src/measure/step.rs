//! The distance between a mesh and its simplified version, at most: for the steps between levels of detail.
//!
//! From the mesh to its version it is proven: the distance of a point to one fixed triangle is convex, so nowhere in a
//! triangle is it larger than at a corner. Back it is the largest of samples.

use super::tree::{Nearest, Tree};
use super::triangle::{Vector, closest};
use crate::mesh::Mesh;

/// Parts of a triangle are quartered until the bound exceeds the largest distance found by at most this factor.
const SLACK: f64 = 1.25;

/// The nearest triangle is not looked for within this share of the largest squared distance found.
const NEAR: f64 = 1.0;

/// A triangle is quartered so often, at most.
const DEEPEST: u32 = 6;

/// The distance from `fine` to `coarse`, at most, or back as far as samples show it, whichever is larger.
///
/// Both have triangles. Memory: 150 bytes for each triangle of one of them at a time.
pub fn deviation(fine: &Mesh, coarse: &Mesh) -> f64 {
    let back = sampled(coarse, fine);
    forward(fine, coarse, back)
}

fn tree_of(mesh: &Mesh) -> Tree {
    Tree::build(mesh.triangles.len(), |t| mesh.corners(t))
}

/// The largest distance of corners, middles of edges and middles of triangles of `from` to `to`.
fn sampled(from: &Mesh, to: &Mesh) -> f64 {
    let tree = tree_of(to);
    let (mut most_sq, mut slot) = (0.0f64, u32::MAX);
    let mut seen = vec![false; from.positions.len()];
    for (t, corners) in from.triangles.iter().enumerate() {
        let [a, b, c] = from.corners(t);
        let mut look = |point: Vector| {
            let near = tree.nearest_unless_within(point, tree.guess(point, slot), most_sq);
            (slot, most_sq) = (near.slot, most_sq.max(near.distance_sq));
        };
        look([0, 1, 2].map(|k| (a[k] + b[k] + c[k]) / 3.0));
        for (k, &v) in corners.iter().enumerate() {
            let w = corners[(k + 1) % 3];
            if v < w {
                look(middle(from.positions[v as usize], from.positions[w as usize]));
            }
            if !std::mem::replace(&mut seen[v as usize], true) {
                look(from.positions[v as usize]);
            }
        }
    }
    most_sq.sqrt()
}

fn middle(a: Vector, b: Vector) -> Vector {
    [0, 1, 2].map(|k| 0.5 * (a[k] + b[k]))
}

/// A corner with its nearest triangle.
#[derive(Clone, Copy)]
struct Foot {
    point: Vector,
    near: Nearest,
}

/// An upper bound of the distance from every point of `fine` to `coarse`; at least `known`.
fn forward(fine: &Mesh, coarse: &Mesh, known: f64) -> f64 {
    let tree = tree_of(coarse);
    let mut feet = vec![Nearest::NONE; fine.positions.len()];
    let mut most_sq = known * known;
    let mut slot = u32::MAX;
    for &v in fine.triangles.as_flattened() {
        let foot = &mut feet[v as usize];
        if !foot.is_found() {
            let point = fine.positions[v as usize];
            // Nearer than this any triangle will do: what is beyond is the nearest one.
            let enough_sq = NEAR * most_sq;
            *foot = tree.nearest_unless_within(point, tree.guess(point, slot), enough_sq);
            most_sq = most_sq.max(foot.distance_sq);
        }
        slot = foot.slot;
    }
    let mut bound = Bound { tree: &tree, most_sq, left_sq: most_sq };
    for corners in &fine.triangles {
        let feet =
            corners.map(|v| Foot { point: fine.positions[v as usize], near: feet[v as usize] });
        bound.cover(feet, 0);
    }
    bound.left_sq.max(bound.most_sq).sqrt()
}

struct Bound<'a> {
    tree: &'a Tree,
    /// The largest squared distance of a point so far.
    most_sq: f64,
    /// The largest bound that was accepted.
    left_sq: f64,
}

impl Bound<'_> {
    /// The distance of a triangle from the nearest of the triangles of its feet, at most.
    ///
    /// The distance to each of these is convex, and so is any mean of them, which is nowhere below the least: at a
    /// corner a mean is largest.
    fn mixed(&self, feet: &[Foot; 3]) -> f64 {
        let slots = feet.map(|foot| foot.near.slot);
        let to = |slot: u32| {
            let t = self.tree.corners(slot);
            feet.map(|at| match at.near.slot == slot {
                true => at.near.distance_sq.sqrt(),
                false => closest(at.point, t).0.sqrt(),
            })
        };
        let most = |d: [f64; 3]| d[0].max(d[1]).max(d[2]);
        let mean = |a: [f64; 3], b: [f64; 3]| most([0, 1, 2].map(|k| 0.5 * (a[k] + b[k])));
        let a = to(slots[0]);
        let enough = self.most_sq.sqrt() * SLACK;
        let mut least = most(a);
        if least <= enough || (slots[1] == slots[0] && slots[2] == slots[0]) {
            return least;
        }
        let b = to(slots[1]);
        least = least.min(most(b)).min(mean(a, b));
        if least <= enough {
            return least;
        }
        let c = to(slots[2]);
        let all = most([0, 1, 2].map(|k| (a[k] + b[k] + c[k]) / 3.0));
        least.min(most(c)).min(mean(a, c)).min(mean(b, c)).min(all)
    }

    /// Bounds the distance of a triangle.
    fn cover(&mut self, feet: [Foot; 3], depth: u32) {
        let least = self.mixed(&feet);
        let least = least * least;
        if least <= self.most_sq * (SLACK * SLACK) || depth == DEEPEST {
            self.left_sq = self.left_sq.max(least);
            return;
        }
        let [a, b, c] = feet;
        let halves = [(a, b), (b, c), (c, a)].map(|(from, to)| {
            let point = middle(from.point, to.point);
            let guess = self.tree.guess(point, from.near.slot);
            let near = self.tree.nearest_unless_within(point, guess, NEAR * self.most_sq);
            self.most_sq = self.most_sq.max(near.distance_sq);
            Foot { point, near }
        });
        let [ab, bc, ca] = halves;
        for part in [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]] {
            self.cover(part, depth + 1);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sheet(n: usize, height: impl Fn(f64, f64) -> f64) -> Mesh {
        let at = |i: usize| {
            let (x, y) = ((i % (n + 1)) as f64 / n as f64, (i / (n + 1)) as f64 / n as f64);
            [x, y, height(x, y)]
        };
        let positions = (0..(n + 1) * (n + 1)).map(at).collect();
        let mut triangles = Vec::new();
        for i in 0..n * n {
            let a = (i / n * (n + 1) + i % n) as u32;
            let n = n as u32;
            triangles.extend([[a, a + 1, a + n + 2], [a, a + n + 2, a + n + 1]]);
        }
        Mesh::new(positions, triangles)
    }

    #[test]
    fn a_bound_is_never_below_the_distance_and_not_far_above() {
        let flat = sheet(4, |_, _| 0.0);
        let spike = |x: f64, y: f64| if (x, y) == (0.5, 0.5) { 0.3 } else { 0.0 };
        for (fine, far) in [
            (sheet(16, |_, _| 0.0), 0.0),
            (sheet(16, spike), 0.3),
            (sheet(16, |_, _| 0.02), 0.02),
            (sheet(50, |x, y| 0.1 * x * y), 0.1),
        ] {
            let bound = deviation(&fine, &flat);
            // Corners on edges of the other mesh may name triangles that do not hold the piece: the last halving counts.
            assert!(bound >= far && bound <= 1.27 * far + 0.5 / 1024.0, "{bound} {far}");
            // The other way round: large triangles over small ones.
            let back = deviation(&flat, &fine);
            assert!(back >= 0.9 * far, "{back} {far}");
        }
    }
}
