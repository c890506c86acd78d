//! The new triangles as seen from the input: the survivor, points on open and on sharp edges, points within folded faces.

use super::input::NONE;
use super::scratch::{BETWEEN, Patch, Scratch};
use super::tracker::Tracker;
use crate::kernel::simd::Lanes;
use crate::kernel::surface::Surface;
use crate::kernel::surface::faces::Face;
use crate::mesh::vec3::{dot, sub};

/// Points within a face that are looked at, as weights of the second and third corner.
const WITHIN: [[f32; 2]; 4] = [[0.33, 0.33], [0.2, 0.2], [0.6, 0.2], [0.2, 0.6]];
/// Edges whose normals have a smaller cosine are looked at, closely below the second, and faces beside one below the
/// third. On the dragon to 1 % nine in ten of the places beyond the bound were such.
const BENT_COSINE: f32 = 0.95;
const SHARP_COSINE: f32 = 0.8;
const FOLD_COSINE: f32 = 0.3;
/// Points on one edge that are looked at.
const MOST_POINTS: usize = 16;
/// Witnesses among which a search for the nearest point of the input begins.
const MOST_STARTS: usize = 64;

impl Tracker {
    /// True if the survivor, and points on new open edges, are near the input.
    #[inline(always)]
    pub(super) fn holds_survivor<L: Lanes>(
        &self,
        surface: &Surface,
        patch: &Patch,
        place: [f32; 3],
        nearest: u32,
        scratch: &mut Scratch,
    ) -> bool {
        if !self.is_near::<L>(place, nearest, &mut scratch.input_faces) {
            return false;
        }
        for &(w, _) in patch.open {
            let end = self.local(surface.vertices[w as usize].position);
            for share in BETWEEN {
                let point = std::array::from_fn(|k| place[k] + share * (end[k] - place[k]));
                if !self.is_near_some::<L>(point, scratch) {
                    return false;
                }
            }
        }
        true
    }

    /// True if points on sharp edges and folded faces are near the input: all witnesses can be near others while
    /// a fin stands off.
    #[inline(always)]
    pub(super) fn holds_folds<L: Lanes>(
        &self,
        patch: &Patch,
        place: [f32; 3],
        scratch: &mut Scratch,
    ) -> bool {
        let n = scratch.faces.len();
        for i in 0..n {
            let face = scratch.faces[i];
            let mut least = if patch.turns { -1.0 } else { 1.0f32 };
            for j in 0..n {
                let other = &scratch.faces[j];
                let (after, before) = (other.b == face.c, other.c == face.b);
                if !(after | before) || i == j {
                    continue;
                }
                let cosine = dot(face.normal, other.normal);
                least = least.min(cosine);
                if after && cosine < BENT_COSINE {
                    let n = if cosine < SHARP_COSINE { self.points_on(face.to_c) } else { 3 };
                    for i in 1..=n {
                        let share = i as f32 / (n + 1) as f32;
                        let point = std::array::from_fn(|k| place[k] + share * face.to_c[k]);
                        if !self.is_near_some::<L>(point, scratch) {
                            return false;
                        }
                    }
                }
            }
            if least < FOLD_COSINE {
                for [b, c] in WITHIN {
                    let point =
                        std::array::from_fn(|k| place[k] + b * face.to_b[k] + c * face.to_c[k]);
                    if !self.is_near_some::<L>(point, scratch) {
                        return false;
                    }
                }
            }
        }
        true
    }

    /// Points on a sharp edge that are looked at: about two bounds apart.
    fn points_on(&self, edge: [f32; 3]) -> usize {
        ((0.5 * dot(edge, edge).sqrt() / self.limit.max(f32::MIN_POSITIVE)) as usize)
            .clamp(3, MOST_POINTS)
    }

    /// True if a point is near the input, found from one of the witnesses of the collapse.
    #[inline(always)]
    fn is_near_some<L: Lanes>(&self, point: [f32; 3], scratch: &mut Scratch) -> bool {
        let step = scratch.witnesses.len().div_ceil(MOST_STARTS).max(1);
        let mut from = (f32::INFINITY, NONE);
        for &id in scratch.witnesses.iter().step_by(step) {
            let relative = sub(self.input.witnesses[id as usize].at, point);
            let off = dot(relative, relative);
            if off < from.0 {
                from = (off, id);
            }
        }
        from.1 == NONE || self.is_near::<L>(point, from.1, &mut scratch.input_faces)
    }

    /// True if a point is near the input, found from a witness.
    #[inline(always)]
    fn is_near<L: Lanes>(&self, point: [f32; 3], from: u32, faces: &mut Vec<Face>) -> bool {
        let witness = &self.input.witnesses[from as usize];
        let relative = sub(point, witness.at);
        let room = self.limit - witness.before;
        if room >= 0.0 && dot(relative, relative) <= room * room {
            return true;
        }
        let (sq, before) = self.input.distance_sq::<L>(point, from, faces);
        sq.sqrt() + before <= self.limit
    }
}
