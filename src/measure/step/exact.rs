//! The nearest triangle of a whole mesh, for the few points that need it.

use crate::measure::tree::{Nearest, Tree};
use crate::measure::triangle::{Vector, closest};
use crate::mesh::Mesh;

/// Points that look at all triangles one by one before a tree is built, which costs about as much.
const WITHOUT_TREE: u32 = 12;

/// The nearest triangle of a mesh.
pub(super) struct Exact<'a> {
    mesh: &'a Mesh,
    n: u32,
    tree: Option<Tree>,
}

impl Exact<'_> {
    pub(super) fn new(mesh: &Mesh) -> Exact<'_> {
        Exact { mesh, n: 0, tree: None }
    }

    /// Squared distance and number of the nearest triangle to `point`; those of `guess` if none is nearer.
    pub(super) fn nearest(&mut self, point: Vector, guess: (f64, u32)) -> (f64, u32) {
        self.n += 1;
        if self.n <= WITHOUT_TREE {
            return self.scan(point, guess);
        }
        let mesh = self.mesh;
        let tree =
            self.tree.get_or_insert_with(|| Tree::build(mesh.triangles.len(), |t| mesh.corners(t)));
        let found = tree.nearest(point, Nearest::NONE);
        match found.is_found() && found.distance_sq < guess.0 {
            true => (found.distance_sq, tree.id(found.slot)),
            false => guess,
        }
    }

    fn scan(&self, point: Vector, guess: (f64, u32)) -> (f64, u32) {
        let mut best = guess;
        for t in 0..self.mesh.triangles.len() {
            let corners = self.mesh.corners(t);
            let mut off_sq = 0.0;
            for k in 0..3 {
                let (a, b, c) = (corners[0][k], corners[1][k], corners[2][k]);
                let (low, high) = (a.min(b).min(c), a.max(b).max(c));
                let off = (low - point[k]).max(point[k] - high).max(0.0);
                off_sq += off * off;
            }
            if off_sq < best.0 {
                let (distance_sq, _) = closest(point, &corners);
                if distance_sq < best.0 {
                    best = (distance_sq, t as u32);
                }
            }
        }
        best
    }
}
