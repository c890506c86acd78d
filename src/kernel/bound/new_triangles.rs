//! The new triangles as seen from the input: the survivor, points on open and on sharp edges, points within folded faces.

use super::fan::Fans;
use super::input::NONE;
use super::scratch::{Patch, Scratch};
use super::tracker::Tracker;
use crate::simd::Lanes;
use crate::surface::Surface;
use stonecut_mesh::vec3::{dot, sub};

/// Points within a face that are looked at, as weights of the second and third corner.
const WITHIN: [[f32; 2]; 4] = [[0.33, 0.33], [0.2, 0.2], [0.6, 0.2], [0.2, 0.6]];
/// Edges whose normals have a smaller cosine are looked at, and faces beside one below the second. On the dragon to 1 %
/// nine in ten of the places beyond the bound were such.
const BENT_COSINE: f32 = 0.95;
const FOLD_COSINE: f32 = 0.3;
/// Share of the bound by which the input may cut the corner of an edge that is not looked at, times four.
const CORNER: f32 = 1.0;
/// Points on one edge that are looked at, about.
const MOST_POINTS: f32 = 64.0;
/// Longest part of an edge, in bounds, that need not be seen to be near the input; it adds half as much at most.
const UNSEEN: f32 = 0.04;
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
        if !self.is_near::<L>(place, nearest, &mut scratch.fans) {
            return false;
        }
        for &(w, _) in patch.open {
            let end = self.local(surface.vertices[w as usize].position);
            if !self.is_edge_near::<L>(place, sub(end, place), nearest, scratch) {
                return false;
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
        nearest: u32,
        scratch: &mut Scratch,
    ) -> bool {
        let n = scratch.faces.len();
        let has_gaps = n < patch.n_kept;
        // An edge of the input that runs over a bent edge cuts the corner by a quarter of its length times the sine.
        let sine = (CORNER * self.limit / scratch.longest.max(f32::MIN_POSITIVE)).min(1.0);
        let bent = (1.0 - sine * sine).sqrt().max(BENT_COSINE);
        for i in 0..n {
            let face = scratch.faces[i];
            let mut least = if patch.turns { -1.0 } else { 1.0f32 };
            let mut has_beside = [false; 2];
            for j in 0..n {
                let other = &scratch.faces[j];
                let (after, before) = (other.b == face.c, other.c == face.b);
                if !(after | before) || i == j {
                    continue;
                }
                has_beside[usize::from(before)] = true;
                let cosine = dot(face.normal, other.normal);
                least = least.min(cosine);
                if after
                    && cosine < bent
                    && !self.is_edge_near::<L>(place, face.to_c, nearest, scratch)
                {
                    return false;
                }
            }
            // A triangle without area is between this one and the next, which may lie back to back.
            if has_gaps && !(has_beside[0] && has_beside[1]) {
                least = -1.0;
                let edges = [face.to_c, face.to_b];
                for (edge, _) in edges.into_iter().zip(has_beside).filter(|(_, beside)| !beside) {
                    if !self.is_edge_near::<L>(place, edge, nearest, scratch) {
                        return false;
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

    /// True if an edge is near the input. The distance to one triangle of the input is convex, so what lies between two
    /// points that are near it is near it too: each triangle proves the edge as far as it reaches.
    #[inline(always)]
    fn is_edge_near<L: Lanes>(
        &self,
        place: [f32; 3],
        edge: [f32; 3],
        nearest: u32,
        scratch: &mut Scratch,
    ) -> bool {
        let length = dot(edge, edge).sqrt();
        let least = (UNSEEN * self.limit).max(length / MOST_POINTS);
        let along = |seen: f32| {
            let share = seen / length;
            [place[0] + share * edge[0], place[1] + share * edge[1], place[2] + share * edge[2]]
        };
        let mut seen = 0.0;
        let mut from = nearest;
        while seen < length {
            let point = along(seen);
            if !self.is_reached::<L>(point, from, scratch) {
                return false;
            }
            let fan = scratch.fans.last();
            let centre = self.input.witnesses[fan.centre as usize];
            let around = 2.0 * (self.limit - self.input.behind(fan.centre) + centre.longest);
            let span = around.min(length - seen);
            let start = sub(point, centre.at);
            let step = edge.map(|x| span / (8.0 * length) * x);
            let mut near = fan.reaching::<L>(start);
            let mut proven = 0;
            for i in 1..=8 {
                let share = i as f32;
                let ahead = std::array::from_fn(|k| start[k] + share * step[k]);
                let reaching = fan.reaching::<L>(ahead);
                if near & reaching == 0 {
                    break;
                }
                (near, proven) = (reaching, i);
            }
            from = fan.centre;
            seen += (proven as f32 / 8.0 * span).max(least);
        }
        true
    }

    /// True if a triangle of the input within the bound of a point is found; the fan that it is in is the last one.
    #[inline(always)]
    fn is_reached<L: Lanes>(&self, point: [f32; 3], from: u32, scratch: &mut Scratch) -> bool {
        let found = self.input.nearest::<L>(point, from, self.limit, &mut scratch.fans);
        if found.distance_sq.sqrt() + found.before <= self.limit {
            return true;
        }
        // Walking can end in a place that is not the nearest.
        let other = self.nearest_witness(point, scratch);
        if other == NONE {
            return false;
        }
        let found = self.input.nearest::<L>(point, other, self.limit, &mut scratch.fans);
        found.distance_sq.sqrt() + found.before <= self.limit
    }

    /// Of the witnesses of the collapse about the nearest to a point.
    #[inline(always)]
    fn nearest_witness(&self, point: [f32; 3], scratch: &Scratch) -> u32 {
        let vertices = || scratch.witnesses.iter().filter(|&&id| self.input.is_vertex(id));
        let step = vertices().count().div_ceil(MOST_STARTS).max(1);
        let mut from = (f32::INFINITY, NONE);
        for &id in vertices().step_by(step) {
            let relative = sub(self.input.witnesses[id as usize].at, point);
            let off = dot(relative, relative);
            if off < from.0 {
                from = (off, id);
            }
        }
        from.1
    }

    /// True if a point is near the input, found from one of the witnesses of the collapse.
    #[inline(always)]
    pub(super) fn is_near_some<L: Lanes>(&self, point: [f32; 3], scratch: &mut Scratch) -> bool {
        let from = self.nearest_witness(point, scratch);
        from == NONE || self.is_near::<L>(point, from, &mut scratch.fans)
    }

    /// True if a point is near the input, found from a witness.
    #[inline(always)]
    fn is_near<L: Lanes>(&self, point: [f32; 3], from: u32, fans: &mut Fans) -> bool {
        let witness = &self.input.witnesses[from as usize];
        let relative = sub(point, witness.at);
        let room = self.limit - self.input.behind(from);
        if room >= 0.0 && dot(relative, relative) <= room * room {
            return true;
        }
        let found = self.input.nearest::<L>(point, from, self.limit, fans);
        found.distance_sq.sqrt() + found.before <= self.limit
    }
}
