//! Points between two witnesses that come to belong to different triangles: over a fold the surface can be farther from
//! them than from both.

use super::scratch::{Eight, Patch, Scratch};
use super::tracker::Tracker;
use crate::kernel::simd::{Job, Lanes};
use crate::kernel::surface::Surface;
use crate::kernel::surface::faces::{Face, Search};
use crate::kernel::vertex::GONE;
use crate::mesh::corners::others;
use crate::mesh::vec3::{cross, dot, sub};

/// Distance between points that are looked at, in bounds.
const APART: f32 = 0.5;
/// Most points between two witnesses.
const MOST_BETWEEN: usize = 8;

impl Tracker {
    /// True if points between two witnesses of different triangles are near: over a fold the surface can be
    /// farther from them than from both.
    #[inline(always)]
    pub(super) fn holds_between<L: Lanes>(
        &self,
        surface: &Surface,
        patch: &Patch,
        place: [f32; 3],
        scratch: &mut Scratch,
    ) -> bool {
        // Sine of the largest turn between two faces, at most: twice that of their normals against the mean.
        let mut mean = [0.0f32; 3];
        for face in &scratch.faces {
            (0..3).for_each(|k| mean[k] += face.normal[k]);
        }
        let length_sq = dot(mean, mean).max(1e-12);
        let turn = scratch.faces.iter().map(|face| {
            let n = cross(face.normal, mean);
            if dot(face.normal, mean) > 0.0 { dot(n, n) / length_sq } else { 1.0 }
        });
        let turn = (2.0 * turn.fold(0.0, f32::max).sqrt()).min(1.0);
        let mut eight = Eight::default();
        for i in 0..scratch.witnesses.len() {
            let (id, (own, distance_sq)) = (scratch.witnesses[i], scratch.found[i]);
            let witness = self.input.witnesses[id as usize];
            let room = self.limit - witness.before;
            let least = room - 0.5 * turn * witness.longest;
            if least > 0.0 && distance_sq <= least * least {
                continue;
            }
            for (other, _) in self.input.around(id) {
                let slot = self.slot[other as usize] as usize;
                let is_inside = scratch.witnesses.get(slot) == Some(&other);
                if is_inside && scratch.found[slot].0 == own {
                    continue;
                }
                let outside = if is_inside { GONE } else { self.owner[other as usize] };
                let end = &self.input.witnesses[other as usize];
                let limit = self.limit - witness.before.max(end.before);
                let edge = sub(end.at, witness.at);
                let length = dot(edge, edge).sqrt();
                let off = match is_inside {
                    true => scratch.found[slot].1.sqrt(),
                    false => self.distance[other as usize],
                };
                // Both ends are so near that all between them is.
                if 2.0 * limit - off - distance_sq.sqrt() >= length {
                    continue;
                }
                let n = ((length / (APART * limit)) as usize).clamp(3, MOST_BETWEEN);
                for i in 1..=n {
                    let share = i as f32 / (n + 1) as f32;
                    let ends = witness.at.into_iter().zip(end.at).zip(place);
                    for (points, ((from, to), place)) in eight.points.iter_mut().zip(ends) {
                        points[eight.n] = from + share * (to - from) - place;
                    }
                    eight.limit_sq[eight.n] = limit * limit;
                    eight.outside[eight.n] = outside;
                    eight.n += 1;
                    if eight.n == 8
                        && !self.are_near::<L>(surface, patch, place, &mut eight, scratch)
                    {
                        return false;
                    }
                }
            }
        }
        eight.n == 0 || self.are_near::<L>(surface, patch, place, &mut eight, scratch)
    }

    /// True if points are near the new triangles, or near those around the triangle that one of their ends belongs to.
    #[inline(always)]
    fn are_near<L: Lanes>(
        &self,
        surface: &Surface,
        patch: &Patch,
        place: [f32; 3],
        eight: &mut Eight,
        scratch: &mut Scratch,
    ) -> bool {
        let found = Search { faces: &scratch.faces, points: &eight.points }.run::<L>();
        // Loops, since a closure would not be compiled for wide lanes.
        for i in 0..std::mem::take(&mut eight.n) {
            if found.distance_sq[i] <= eight.limit_sq[i] {
                continue;
            }
            let (outside, limit_sq) = (eight.outside[i], eight.limit_sq[i]);
            let point = std::array::from_fn(|k| eight.points[k][i] + place[k]);
            if outside == GONE
                || !self.is_near_outside::<L>(surface, patch, (point, limit_sq), outside, scratch)
            {
                return false;
            }
        }
        true
    }

    /// True if a point is near a triangle outside of the patch or one of those around it.
    #[inline(always)]
    fn is_near_outside<L: Lanes>(
        &self,
        surface: &Surface,
        patch: &Patch,
        (point, limit_sq): ([f32; 3], f32),
        triangle: u32,
        scratch: &mut Scratch,
    ) -> bool {
        for v in surface.triangles[triangle as usize] {
            let centre = self.local(surface.vertices[v as usize].position);
            let faces = &mut scratch.input_faces;
            faces.clear();
            for &t in surface.ring(v) {
                let corners = surface.triangles[t as usize];
                if corners[0] == GONE || patch.ids.contains(&t) {
                    continue;
                }
                let (b, c) = others(corners, v);
                let [to_b, to_c] =
                    [b, c].map(|w| sub(self.local(surface.vertices[w as usize].position), centre));
                faces.extend(Face::new(t, (b, c), to_b, to_c));
            }
            let points = sub(point, centre).map(|x| [x; 8]);
            let found = Search { faces, points: &points }.run::<L>();
            if found.distance_sq[0] <= limit_sq {
                return true;
            }
        }
        false
    }
}
