//! The nearest triangle of a whole mesh, for the few points that need it.

use crate::tree::{Nearest, Tree};
use crate::triangle::{Vector, closest};
use stonecut_mesh::Mesh;
use stonecut_mesh::bounds::Bounds;

/// Bounds and triangles looked at without a tree, for each triangle of the mesh: about what building one costs.
const WITHOUT_TREE: u64 = 64;

/// Triangles in a run, and runs in a stretch. They come in an order in which neighbours are mostly near each other.
const RUN: usize = 16;

/// The nearest triangle of a mesh.
pub(super) struct Exact<'a> {
    mesh: &'a Mesh,
    /// Bounds and triangles that were looked at.
    looks: u64,
    /// Bounds of the runs, and of the stretches of runs; none before the first point.
    runs: Vec<Bounds>,
    stretches: Vec<Bounds>,
    tree: Option<Tree>,
}

impl Exact<'_> {
    pub(super) fn new(mesh: &Mesh) -> Exact<'_> {
        Exact { mesh, looks: 0, runs: Vec::new(), stretches: Vec::new(), tree: None }
    }

    /// Squared distance and number of the nearest triangle to `point`, or of any that is not farther than `enough_sq`; those of
    /// `guess` if none is nearer.
    pub(super) fn nearest(
        &mut self,
        point: Vector,
        guess: (f64, u32),
        enough_sq: f64,
    ) -> (f64, u32) {
        if self.looks <= WITHOUT_TREE * self.mesh.triangles.len() as u64 {
            return self.scan(point, guess, enough_sq);
        }
        let mesh = self.mesh;
        let tree =
            self.tree.get_or_insert_with(|| Tree::build(mesh.triangles.len(), |t| mesh.corners(t)));
        let from = Nearest { distance_sq: guess.0, ..Nearest::NONE };
        let found = tree.nearest_unless_within(point, from, enough_sq);
        match found.is_found() && found.distance_sq < guess.0 {
            true => (found.distance_sq, tree.id(found.slot)),
            false => guess,
        }
    }

    fn scan(&mut self, point: Vector, guess: (f64, u32), enough_sq: f64) -> (f64, u32) {
        let mesh = self.mesh;
        if self.runs.is_empty() {
            let around = |run: &[[u32; 3]]| {
                let mut bounds = Bounds::EMPTY;
                run.as_flattened().iter().for_each(|v| bounds.add(mesh.positions[*v as usize]));
                bounds
            };
            self.runs = mesh.triangles.chunks(RUN).map(around).collect();
            let join =
                |runs: &[Bounds]| runs.iter().fold(Bounds::EMPTY, |all, run| all.joined(run));
            self.stretches = self.runs.chunks(RUN).map(join).collect();
        }
        self.looks += self.stretches.len() as u64;
        let off_sq: Vec<f64> = self.stretches.iter().map(|own| own.distance_sq(point)).collect();
        let mut best = guess;
        // The nearest one first: what lies in it rules most others out, where the guess is far off or there is none.
        let first = (0..off_sq.len()).min_by(|&a, &b| off_sq[a].total_cmp(&off_sq[b]));
        for stretch in first.into_iter().chain(0..off_sq.len()) {
            if best.0 <= enough_sq {
                break;
            }
            if off_sq[stretch] < best.0 {
                self.look_into(stretch, point, &mut best);
            }
        }
        best
    }

    /// Looks for a nearer triangle than the best so far in a stretch.
    fn look_into(&mut self, stretch: usize, point: Vector, best: &mut (f64, u32)) {
        let first = stretch * RUN;
        let runs = first..(first + RUN).min(self.runs.len());
        self.looks += runs.len() as u64;
        for run in runs {
            if self.runs[run].distance_sq(point) >= best.0 {
                continue;
            }
            let first = run * RUN;
            let triangles = first..(first + RUN).min(self.mesh.triangles.len());
            self.looks += 4 * triangles.len() as u64;
            for t in triangles {
                let (distance_sq, _) = closest(point, &self.mesh.corners(t));
                if distance_sq < best.0 {
                    *best = (distance_sq, t as u32);
                }
            }
        }
    }
}
