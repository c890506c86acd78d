//! One collapse, looked at before it is carried out.
//!
//! Four looks, the cheap ones first: each witness against the new triangles; the survivor, and points on new open
//! edges, against the input; points on folds; points between two witnesses that come to belong to different triangles.

use super::between::sine_to_mean;
use super::input::NONE;
use super::scratch::{Eight, Patch, Scratch};
use super::tracker::Tracker;
use crate::simd::unchecked::prefetch;
use crate::simd::{Job, Lanes};
use crate::surface::Surface;
use crate::surface::faces::{Face, Search};
use stonecut_mesh::steps::count;
use stonecut_mesh::vec3::{dot, sub};

/// Share of the bound that witnesses may have used where nothing between them is looked at, and the height over it in lengths of
/// an edge of the input and sines of the largest turn: half of what a fold in the middle of the edge has at worst. Measured
/// (docs/design/bound.md).
const EVEN: f32 = 0.95;
const EVEN_TURN: f32 = 0.24;

/// All looks of one collapse, compiled for the lanes they run on.
struct Look<'a> {
    tracker: &'a mut Tracker,
    surface: &'a Surface,
    patch: &'a Patch<'a>,
    scratch: &'a mut Scratch,
}

impl Job for Look<'_> {
    type Output = bool;

    #[inline(always)]
    fn run<L: Lanes>(self) -> bool {
        self.tracker.looks::<L>(self.surface, self.patch, self.scratch)
    }
}

impl Tracker {
    /// True if a collapse was refused, and is again.
    #[inline(always)]
    pub(crate) fn has_refused(&self, surface: &Surface, ends: [u32; 2], may_turn: bool) -> bool {
        self.refused.holds(surface, ends, false)
            || may_turn && self.refused.holds(surface, ends, true)
    }

    /// True if the surface stays within the bound with this collapse.
    #[inline(never)]
    pub(crate) fn admits(&mut self, surface: &Surface, patch: &Patch) -> bool {
        let mut scratch = std::mem::take(&mut self.scratch);
        let simd = self.simd;
        let verdict = simd.run(Look { tracker: self, surface, patch, scratch: &mut scratch });
        self.scratch = scratch;
        if !verdict {
            self.refused.add(surface, patch.ends, patch.turns);
        }
        verdict
    }

    /// Gives the witnesses to the triangles that `admits` has found for them; after the collapse.
    #[inline(never)]
    pub(crate) fn carry_out(&mut self, ids: &[u32]) {
        for &t in ids {
            self.head[t as usize] = NONE;
        }
        for i in 0..self.scratch.witnesses.len() {
            let witness = self.scratch.witnesses[i];
            let (face, distance_sq) = self.scratch.found[i];
            let triangle = self.scratch.faces[face as usize].triangle;
            self.input.witnesses[witness as usize].distance = distance_sq.sqrt();
            self.own(witness, triangle);
        }
    }

    #[inline(always)]
    fn looks<L: Lanes>(&mut self, surface: &Surface, patch: &Patch, scratch: &mut Scratch) -> bool {
        let place = self.local(patch.place);
        scratch.witnesses.clear();
        scratch.found.clear();
        scratch.longest = 0.0;
        scratch.faces.clear();
        for i in 0..patch.n_kept {
            let [to_b, to_c] = [patch.b[i], patch.c[i]]
                .map(|v| sub(self.local(surface.vertices[v as usize].position), place));
            scratch.faces.extend(Face::new(patch.ids[i], (patch.b[i], patch.c[i]), to_b, to_c));
        }
        // A face that is turned over can hang over a hole, or over another sheet, unseen by any witness: only a small one may.
        let most = self.limit * self.limit;
        let is_long = |face: &Face| dot(face.to_b, face.to_b).max(dot(face.to_c, face.to_c)) > most;
        if patch.turns && scratch.faces.iter().any(is_long) {
            return false;
        }
        if scratch.faces.is_empty() {
            return patch.ids.iter().all(|&t| self.head[t as usize] == NONE);
        }
        let Some(nearest) = self.hold_witnesses::<L>(patch, place, scratch) else { return false };
        // Nothing tells where the input is: a fin could stand off unseen.
        if nearest == NONE {
            return false;
        }
        if self.is_as_before(patch, scratch) {
            return true;
        }
        let is_even = self.is_even(patch, scratch);
        self.holds_survivor::<L>(surface, patch, place, nearest, scratch)
            && (is_even || self.holds_folds::<L>(patch, place, nearest, scratch))
            && self.holds_caps::<L>(place, scratch)
            && self.holds_outside::<L>(patch, place, scratch)
            && (is_even || self.holds_between::<L>(surface, patch, place, scratch))
    }

    /// True if all around a collapse is as it was when an earlier run looked at it and carried it out.
    #[inline(always)]
    fn is_as_before(&self, patch: &Patch, scratch: &Scratch) -> bool {
        let vertices = || patch.ends.iter().chain(patch.b).chain(patch.c);
        !self.changed.is_empty()
            && vertices().all(|&v| !self.changed[v as usize])
            && !scratch.witnesses.iter().any(|&id| self.is_in_ball(id))
    }

    /// True if what lies between the witnesses is as near as they are but for little: the new faces turn so little that an edge of
    /// the input hardly leaves what the witnesses have left of the bound. Nowhere in a ball: there this was wrong once; nor after
    /// rounds, where few points stand for the original.
    #[inline(always)]
    fn is_even(&self, patch: &Patch, scratch: &Scratch) -> bool {
        let has_gaps = scratch.faces.len() < patch.n_kept;
        if patch.turns || has_gaps || !patch.open.is_empty() || self.has_points() {
            return false;
        }
        let mut used = 0.0f32;
        for (&id, found) in scratch.witnesses.iter().zip(&scratch.found) {
            if self.is_in_ball(id) {
                return false;
            }
            used =
                used.max(found.1 / (self.limit - self.input.witnesses[id as usize].before).powi(2));
        }
        let over_folds = EVEN_TURN * sine_to_mean(&scratch.faces) * scratch.longest / self.limit;
        used.sqrt() + over_folds <= EVEN
    }

    /// Finds the face of each witness, and the witness nearest to the survivor; `None` if one is too far away. The
    /// farthest of each triangle come first.
    #[inline(always)]
    fn hold_witnesses<L: Lanes>(
        &mut self,
        patch: &Patch,
        place: [f32; 3],
        scratch: &mut Scratch,
    ) -> Option<u32> {
        let mut nearest = (f32::INFINITY, NONE);
        let mut eight = Eight::default();
        for &t in patch.ids {
            prefetch(&self.input.witnesses, self.head[t as usize]);
        }
        for &t in patch.ids {
            let first = self.head[t as usize];
            if first != NONE && !self.hold_one::<L>(first, place, &mut eight, &mut nearest, scratch)
            {
                return None;
            }
        }
        for i in 0..scratch.witnesses.len() {
            let mut witness = self.input.witnesses[scratch.witnesses[i] as usize].next;
            while witness != NONE {
                if !self.hold_one::<L>(witness, place, &mut eight, &mut nearest, scratch) {
                    return None;
                }
                witness = self.input.witnesses[witness as usize].next;
            }
        }
        count(scratch.witnesses.len());
        (eight.n == 0 || self.hold_eight::<L>(&mut eight, scratch)).then_some(nearest.1)
    }

    /// Adds a witness to those that are held against the faces together; false if one of them is too far away.
    #[inline(always)]
    fn hold_one<L: Lanes>(
        &mut self,
        id: u32,
        place: [f32; 3],
        eight: &mut Eight,
        nearest: &mut (f32, u32),
        scratch: &mut Scratch,
    ) -> bool {
        let witness = &self.input.witnesses[id as usize];
        // The next one of its triangle is wanted soon.
        prefetch(&self.input.witnesses, witness.next);
        let relative = sub(witness.at, place);
        for (points, relative) in eight.points.iter_mut().zip(relative) {
            points[eight.n] = relative;
        }
        let limit = self.limit - witness.before;
        // Written so that NaN is refused.
        let has_room = limit >= 0.0;
        if !has_room {
            return false;
        }
        scratch.longest = scratch.longest.max(witness.longest);
        eight.limit_sq[eight.n] = limit * limit;
        eight.n += 1;
        let off = dot(relative, relative);
        if off < nearest.0 && self.input.is_vertex(id) {
            *nearest = (off, id);
        }
        self.slot[id as usize] = scratch.witnesses.len() as u32;
        scratch.witnesses.push(id);
        eight.n < 8 || self.hold_eight::<L>(eight, scratch)
    }

    #[inline(always)]
    fn hold_eight<L: Lanes>(&self, eight: &mut Eight, scratch: &mut Scratch) -> bool {
        let found = Search { faces: &scratch.faces, points: &eight.points }.run::<L>();
        for i in 0..eight.n {
            let is_near = found.distance_sq[i] <= eight.limit_sq[i];
            if !is_near {
                return false;
            }
            scratch.found.push((found.face[i] as u32, found.distance_sq[i]));
        }
        eight.n = 0;
        true
    }
}
