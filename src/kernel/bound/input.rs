//! The mesh as it was given: its vertices, its triangles, and which triangles are around a vertex.
//!
//! Only read. Answers how far a point is from it, searching from a vertex nearby.

use crate::kernel::simd::{Job, Lanes};
use crate::kernel::surface::faces::{Face, Search};
use crate::kernel::vertex::GONE;
use crate::mesh::corners::others;
use crate::mesh::vec3::{dot, sub};

/// No witness follows.
pub(super) const NONE: u32 = u32::MAX;

/// A vertex of the input.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Witness {
    /// Relative to `Tracker::centre`, scaled.
    pub(super) at: [f32; 3],
    /// Distance of the input from the original here, scaled.
    pub(super) before: f32,
    /// Its longest edge, scaled.
    pub(super) longest: f32,
}

/// Steps that a search takes from vertex to vertex.
const MAX_STEPS: usize = 16;
/// Triangles around one vertex that are looked at.
const MOST_FACES: usize = 64;

/// Witnesses and triangles, and for each witness the triangles around it.
#[derive(Clone)]
pub(super) struct Input {
    pub(super) witnesses: Vec<Witness>,
    triangles: Vec<[u32; 3]>,
    /// First place of the triangles of a witness in `around`; one more than there are witnesses.
    first: Vec<u32>,
    around: Vec<u32>,
}

impl Input {
    /// Takes the triangles that are there.
    pub(super) fn new(mut witnesses: Vec<Witness>, triangles: &[[u32; 3]]) -> Input {
        let triangles: Vec<_> = triangles.iter().filter(|t| t[0] != GONE).copied().collect();
        let mut first = vec![0u32; witnesses.len() + 1];
        for &v in triangles.iter().flatten() {
            first[v as usize + 1] += 1;
        }
        for v in 1..first.len() {
            first[v] += first[v - 1];
        }
        for t in &triangles {
            for k in 0..3 {
                let (v, w) = (t[k] as usize, t[(k + 1) % 3] as usize);
                let edge = sub(witnesses[w].at, witnesses[v].at);
                let length = dot(edge, edge).sqrt();
                for v in [v, w] {
                    witnesses[v].longest = witnesses[v].longest.max(length);
                }
            }
        }
        let mut place = first.clone();
        let mut around = vec![0; 3 * triangles.len()];
        for (id, t) in triangles.iter().enumerate() {
            for &v in t {
                around[place[v as usize] as usize] = id as u32;
                place[v as usize] += 1;
            }
        }
        Input { witnesses, triangles, first, around }
    }

    /// Memory that it holds, in bytes.
    pub(super) fn bytes(&self) -> u64 {
        let witnesses = self.witnesses.len() * size_of::<Witness>();
        let lists = 4 * (self.first.len() + self.around.len());
        (witnesses + self.triangles.len() * size_of::<[u32; 3]>() + lists) as u64
    }

    /// The other two corners of each triangle around a witness.
    pub(super) fn around(&self, witness: u32) -> impl Iterator<Item = (u32, u32)> {
        let [first, end] = [0, 1].map(|i| self.first[witness as usize + i] as usize);
        let triangles = self.around[first..end].iter().take(MOST_FACES);
        triangles.map(move |&t| others(self.triangles[t as usize], witness))
    }

    /// Place of the input near a point, found by walking downhill from a witness.
    #[inline(always)]
    pub(super) fn nearest<L: Lanes>(
        &self,
        point: [f32; 3],
        from: u32,
        faces: &mut Vec<Face>,
    ) -> Nearest {
        let mut at = from;
        let mut best = Nearest { distance_sq: f32::INFINITY, before: 0.0, corners: [from; 3] };
        for _ in 0..MAX_STEPS {
            let centre = self.witnesses[at as usize];
            faces.clear();
            for (b, c) in self.around(at) {
                let to_b = sub(self.witnesses[b as usize].at, centre.at);
                let to_c = sub(self.witnesses[c as usize].at, centre.at);
                faces.extend(Face::new(0, (b, c), to_b, to_c));
            }
            let relative = sub(point, centre.at);
            let points = relative.map(|x| [x; 8]);
            let found = Search { faces, points: &points }.run::<L>();
            let is_nearer = found.distance_sq[0] < best.distance_sq;
            if !is_nearer {
                break;
            }
            let face = &faces[found.face[0] as usize];
            let [b, c] = [found.weights[0][0], found.weights[1][0]];
            let a = 1.0 - b - c;
            let before = centre.before.max(self.witnesses[face.b as usize].before);
            let before = before.max(self.witnesses[face.c as usize].before);
            let corners = [at, face.b, face.c];
            best = Nearest { distance_sq: found.distance_sq[0], before, corners };
            if a > 0.5 {
                break;
            }
            at = if b >= c { face.b } else { face.c };
        }
        if best.distance_sq.is_infinite() {
            let witness = &self.witnesses[from as usize];
            let relative = sub(point, witness.at);
            best.distance_sq = dot(relative, relative);
            best.before = witness.before;
        }
        best
    }
}

/// A place of the input that is near a point: hardly ever not the nearest.
#[derive(Clone, Copy)]
pub(super) struct Nearest {
    /// Squared, scaled.
    pub(super) distance_sq: f32,
    /// Distance of the input from the original there, scaled.
    pub(super) before: f32,
    /// Corners of the triangle that it lies in; three times the same where none was found.
    pub(super) corners: [u32; 3],
}
