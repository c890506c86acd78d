//! Points between two witnesses that come to belong to different triangles: over a fold the surface can be farther from
//! them than from both.

use super::scratch::{Patch, Scratch};
use super::tracker::Tracker;
use crate::simd::Lanes;
use crate::surface::Surface;
use crate::surface::faces::Face;
use crate::vertex::GONE;
use stonecut_mesh::corners::others;
use stonecut_mesh::steps::{HUB, count};
use stonecut_mesh::vec3::{cross, dot, sub};

/// The points from one witness to the other that are looked at.
const SHARES: [f32; 8] =
    [0.0, 1.0 / 7.0, 2.0 / 7.0, 3.0 / 7.0, 4.0 / 7.0, 5.0 / 7.0, 6.0 / 7.0, 1.0];
/// A bit for each of them, and for each part between two of them.
const ALL: u32 = 0xFF;
const ALL_BETWEEN: u32 = 0x7F;

/// An edge of the input whose ends belong to different triangles.
#[derive(Clone, Copy)]
struct Between {
    /// From the survivor to its first end; from there to the other.
    start: [f32; 3],
    edge: [f32; 3],
    /// A little more than the squared distance that a point of it may be away.
    limit_sq: f32,
    /// Faces that its ends belong to, as far as they are of the collapse.
    faces: [u32; 2],
    /// Triangle of the other end, if it is not of the collapse.
    outside: u32,
}

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
        // Of the largest turn between two faces, at most: twice that of their normals against the mean.
        let turn = (2.0 * sine_to_mean(&scratch.faces)).min(1.0);
        let is_closed = patch.open.is_empty();
        scratch.is_done.clear();
        for i in 0..scratch.witnesses.len() {
            let (id, (own, distance_sq)) = (scratch.witnesses[i], scratch.found[i]);
            let witness = self.input.witnesses[id as usize];
            let room = self.limit - witness.before;
            let least = room - 0.5 * turn * witness.longest;
            // An open edge can recede within a plane.
            let is_near = is_closed && least > 0.0 && distance_sq <= least * least;
            scratch.is_done.push(!is_near);
            count(self.input.around(id).len());
            for other in self.input.neighbours(id) {
                let to = &self.input.witnesses[other as usize];
                let slot = self.slot[other as usize] as usize;
                let is_inside = scratch.witnesses.get(slot) == Some(&other);
                // The turns are those of the new triangles: it may be sharper at the border.
                if is_inside && is_near {
                    continue;
                }
                let (end, off) = match is_inside {
                    true if scratch.found[slot].0 == own => continue,
                    true if slot < i && scratch.is_done[slot] => continue,
                    true => (Some(scratch.found[slot].0), scratch.found[slot].1.sqrt()),
                    false => (None, to.distance),
                };
                let limit = self.limit - witness.before.max(to.before);
                let edge = sub(to.at, witness.at);
                // Both ends are so near that all between them is.
                if 2.0 * limit - off - distance_sq.sqrt() >= dot(edge, edge).sqrt() {
                    continue;
                }
                let between = Between {
                    start: sub(witness.at, place),
                    edge,
                    limit_sq: (limit * limit).next_up(),
                    faces: [own, end.unwrap_or(own)],
                    outside: if is_inside { GONE } else { to.owner },
                };
                if !(limit >= 0.0
                    && self.is_between_near::<L>(surface, patch, place, between, scratch))
                {
                    return false;
                }
            }
        }
        true
    }

    /// True if all between two witnesses is near the new triangles, or near those around the one that the other end belongs
    /// to. The distance to one triangle is convex: one that is near two points is near all between them.
    #[inline(always)]
    fn is_between_near<L: Lanes>(
        &self,
        surface: &Surface,
        patch: &Patch,
        place: [f32; 3],
        between: Between,
        scratch: &mut Scratch,
    ) -> bool {
        // No closures here and below: they would not be compiled for wide lanes.
        let shares = L::load(&SHARES);
        let Between { start, edge, .. } = between;
        let points = [
            L::splat(start[0]).plus(L::splat(edge[0]).times(shares)),
            L::splat(start[1]).plus(L::splat(edge[1]).times(shares)),
            L::splat(start[2]).plus(L::splat(edge[2]).times(shares)),
        ];
        let limit_sq = L::splat(between.limit_sq);
        let [own, other] = between.faces;
        let near = scratch.faces[own as usize].off::<L>(points).0.below(limit_sq);
        let (mut reached, mut proven) = (near, near & (near >> 1));
        let near = match between.outside {
            GONE => scratch.faces[other as usize].off::<L>(points).0.below(limit_sq),
            triangle => self.near_triangle::<L>(surface, (triangle, place), points, limit_sq),
        };
        (reached, proven) = (reached | near, proven | near & (near >> 1));
        for face in 0..scratch.faces.len() {
            if proven == ALL_BETWEEN {
                return true;
            }
            let near = scratch.faces[face].off::<L>(points).0.below(limit_sq);
            (reached, proven) = (reached | near, proven | near & (near >> 1));
        }
        if reached == ALL || between.outside == GONE {
            return reached == ALL;
        }
        for v in surface.triangles[between.outside as usize] {
            reached |= self.near_ring::<L>(surface, patch, (v, place), points, limit_sq);
            if reached == ALL {
                return true;
            }
        }
        false
    }

    /// The points of eight relative to the survivor that are near a triangle outside of the collapse, one a bit.
    #[inline(always)]
    fn near_triangle<L: Lanes>(
        &self,
        surface: &Surface,
        (triangle, place): (u32, [f32; 3]),
        points: [L; 3],
        limit_sq: L,
    ) -> u32 {
        let [corner, b, c] = surface.triangles[triangle as usize]
            .map(|v| self.local(surface.vertices[v as usize].position));
        let Some(face) = Face::new(0, (0, 0), sub(b, corner), sub(c, corner)) else { return 0 };
        let points = moved(points, sub(place, corner));
        face.off::<L>(points).0.below(limit_sq)
    }

    /// The points of eight relative to the survivor that are near the triangles around a vertex which are not of the
    /// collapse, one a bit. None around a hub: those beside the triangle are around its other corners too.
    #[inline(always)]
    fn near_ring<L: Lanes>(
        &self,
        surface: &Surface,
        patch: &Patch,
        (v, place): (u32, [f32; 3]),
        points: [L; 3],
        limit_sq: L,
    ) -> u32 {
        let ring = surface.ring(v);
        if ring.len() > HUB {
            return 0;
        }
        count(ring.len());
        let centre = self.local(surface.vertices[v as usize].position);
        let points = moved(points, sub(place, centre));
        let mut near = 0;
        for &t in ring {
            let corners = surface.triangles[t as usize];
            if corners[0] == GONE || patch.ids.contains(&t) {
                continue;
            }
            let (b, c) = others(corners, v);
            let [to_b, to_c] =
                [b, c].map(|w| sub(self.local(surface.vertices[w as usize].position), centre));
            if let Some(face) = Face::new(t, (b, c), to_b, to_c) {
                near |= face.off::<L>(points).0.below(limit_sq);
            }
        }
        near
    }
}

/// Largest sine of the angle between the normal of a face and their mean; infinite if one of them is turned from it by a right
/// angle or more.
#[inline(always)]
pub(super) fn sine_to_mean(faces: &[Face]) -> f32 {
    let mut mean = [0.0f32; 3];
    for face in faces {
        (0..3).for_each(|k| mean[k] += face.normal[k]);
    }
    let length_sq = dot(mean, mean).max(1e-12);
    let mut most = 0.0f32;
    for face in faces {
        let n = cross(face.normal, mean);
        let is_upright = dot(face.normal, mean) > 0.0;
        most = most.max(if is_upright { dot(n, n) / length_sq } else { f32::INFINITY });
    }
    most.sqrt()
}

#[inline(always)]
fn moved<L: Lanes>(points: [L; 3], by: [f32; 3]) -> [L; 3] {
    let [x, y, z] = points;
    [x.plus(L::splat(by[0])), y.plus(L::splat(by[1])), z.plus(L::splat(by[2]))]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fold_turns_from_the_mean_by_half_its_angle_and_what_is_turned_over_has_no_sine() {
        let (sine, cosine) = 0.3f32.sin_cos();
        let along = [1.0, 0.0, 0.0];
        let face = |to_b, to_c| Face::new(0, (0, 0), to_b, to_c);
        // On either side of the x axis.
        let left = face(along, [0.0, cosine, sine]);
        let right = face([0.0, -cosine, sine], along);
        let faces: Vec<Face> = left.into_iter().chain(right).collect();
        assert!(sine_to_mean(&faces[..1]) < 1e-6);
        assert!((sine_to_mean(&faces) - sine).abs() < 1e-5);
        let over = face([0.0, cosine, sine], along);
        let faces: Vec<Face> = left.into_iter().chain(over).chain(over).collect();
        assert_eq!(sine_to_mean(&faces), f32::INFINITY);
    }
}
