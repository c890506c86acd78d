//! The nearest triangle of a whole mesh, for the few points that need it.

use crate::measure::tree::{Nearest, Tree};
use crate::measure::triangle::{Vector, closest};
use crate::mesh::Mesh;
use crate::mesh::bounds::Bounds;

/// Points that look through runs of triangles before a tree is built, which costs about as much.
const WITHOUT_TREE: u32 = 100;

/// Triangles in a run. They come in an order in which neighbours are mostly near each other.
const RUN: usize = 32;

/// The nearest triangle of a mesh.
pub(super) struct Exact<'a> {
    mesh: &'a Mesh,
    n: u32,
    /// Bounds of the runs; none before the first point.
    runs: Vec<Bounds>,
    tree: Option<Tree>,
}

impl Exact<'_> {
    pub(super) fn new(mesh: &Mesh) -> Exact<'_> {
        Exact { mesh, n: 0, runs: Vec::new(), tree: None }
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

    fn scan(&mut self, point: Vector, guess: (f64, u32)) -> (f64, u32) {
        let mesh = self.mesh;
        if self.runs.is_empty() {
            let runs = mesh.triangles.chunks(RUN).map(|run| {
                let corners = run.as_flattened().iter().map(|v| mesh.positions[*v as usize]);
                corners.fold(Bounds::EMPTY, |bounds, p| bounds.joined(&Bounds { low: p, high: p }))
            });
            self.runs = runs.collect();
        }
        let mut best = guess;
        for (run, bounds) in self.runs.iter().enumerate() {
            let off = |k: usize| (bounds.low[k] - point[k]).max(point[k] - bounds.high[k]).max(0.0);
            let [x, y, z] = [off(0), off(1), off(2)];
            if x * x + y * y + z * z >= best.0 {
                continue;
            }
            let first = run * RUN;
            for t in first..(first + RUN).min(mesh.triangles.len()) {
                let (distance_sq, _) = closest(point, &mesh.corners(t));
                if distance_sq < best.0 {
                    best = (distance_sq, t as u32);
                }
            }
        }
        best
    }
}
