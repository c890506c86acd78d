//! Points beyond open edges of the input: a triangle can span a hole while all its edges and witnesses are near.

use super::scratch::{Patch, Scratch};
use super::tracker::Tracker;
use crate::simd::{Job, Lanes};
use crate::surface::faces::Search;
use stonecut_mesh::vec3::dot;

/// Distances of the points from an open edge, in bounds: a hole that is not wider may be spanned.
const BEYOND: [f32; 8] = [0.75, 1.0, 1.25, 1.5, 1.75, 2.0, 2.5, 3.0];
/// The surface is held against the input where it is so near to such a point, in bounds.
const COVERED: f32 = 0.25;

impl Tracker {
    /// True if the new triangles are near the input where they lie beyond its open edges.
    #[inline(always)]
    pub(super) fn holds_outside<L: Lanes>(
        &self,
        patch: &Patch,
        place: [f32; 3],
        scratch: &mut Scratch,
    ) -> bool {
        if patch.n_kept == 0 {
            return true;
        }
        for i in 0..scratch.witnesses.len() {
            let id = scratch.witnesses[i];
            let Some(out) = self.input.outward(id) else { continue };
            let witness = self.input.witnesses[id as usize];
            let room = self.limit - witness.before;
            let mut points = [[0.0f32; 8]; 3];
            for (k, row) in points.iter_mut().enumerate() {
                for (x, share) in row.iter_mut().zip(BEYOND) {
                    *x = witness.at[k] - place[k] + share * room * out[k];
                }
            }
            let found = Search { faces: &scratch.faces, points: &points }.run::<L>();
            let covered_sq = (COVERED * room) * (COVERED * room);
            for lane in 0..8 {
                if found.distance_sq[lane] > covered_sq {
                    continue;
                }
                let face = scratch.faces[found.face[lane] as usize];
                let [b, c] = [found.weights[0][lane], found.weights[1][lane]];
                let at = |k: usize| place[k] + b * face.to_b[k] + c * face.to_c[k];
                let point = [at(0), at(1), at(2)];
                if !self.is_near_some::<L>(point, scratch) {
                    return false;
                }
            }
        }
        true
    }
}

impl super::input::BoundInput {
    /// Direction from a vertex on an open edge away from the surface; `None` for others.
    #[inline(always)]
    fn outward(&self, v: u32) -> Option<[f32; 3]> {
        if !self.is_open(v) {
            return None;
        }
        let at = self.witnesses[v as usize].at;
        let mut sum = [0.0f32; 3];
        for &w in self.around(v).iter().flatten() {
            let to = self.witnesses[w as usize].at;
            (0..3).for_each(|k| sum[k] += at[k] - to[k]);
        }
        let length = dot(sum, sum).sqrt();
        (length > 0.0).then(|| sum.map(|x| x / length))
    }
}
