//! Caps of cuts: triangles that no witness belongs to at first, so that all of each has to be near the input.
//!
//! Before a cut, and again whenever a collapse moves a corner of a cap.

use super::input::NONE;
use super::scratch::Scratch;
use super::tracker::Tracker;
use crate::simd::{Job, Lanes};
use crate::surface::Surface;
use crate::vertex::GONE;
use stonecut_mesh::steps::count;

/// Points of a cap that are looked at are this share of the bound apart, at most.
const STEP: f32 = 0.125;
/// A cap whose longest side has more of such steps is refused.
const MOST_STEPS: f32 = 8.0;
/// Witnesses of one triangle among which the search for the nearest point of the input begins.
const MOST_STARTS: usize = 8;

/// The caps of one cut, compiled for the lanes they run on.
struct Cap<'a> {
    tracker: &'a Tracker,
    scratch: &'a mut Scratch,
    corners: [[f32; 3]; 3],
}

impl Job for Cap<'_> {
    type Output = bool;

    #[inline(always)]
    fn run<L: Lanes>(self) -> bool {
        self.tracker.is_triangle_near::<L>(self.corners, self.scratch)
    }
}

impl Tracker {
    /// True if the caps of a cut along three edges are near the input.
    #[inline(never)]
    pub(crate) fn admits_cap(&mut self, surface: &Surface, cycle: [u32; 3]) -> bool {
        let mut scratch = std::mem::take(&mut self.scratch);
        scratch.witnesses.clear();
        let mut is_tight = false;
        count(cycle.iter().map(|&v| surface.ring(v).len()).sum());
        for &t in cycle.iter().flat_map(|&v| surface.ring(v)) {
            let mut witness = match surface.triangles[t as usize][0] {
                GONE => NONE,
                _ => self.head[t as usize],
            };
            let mut n = 0;
            while witness != NONE && n < MOST_STARTS {
                // Where the bound was exceeded before, nothing is cut.
                is_tight |= self.margins.get(witness as usize).is_some_and(|&margin| margin > 0.0);
                if self.input.is_vertex(witness) {
                    scratch.witnesses.push(witness);
                    n += 1;
                }
                witness = self.input.witnesses[witness as usize].next;
            }
        }
        let corners = cycle.map(|v| self.local(surface.vertices[v as usize].position));
        let may_cut = !is_tight && !scratch.witnesses.is_empty();
        let verdict =
            may_cut && self.simd.run(Cap { tracker: self, scratch: &mut scratch, corners });
        self.scratch = scratch;
        verdict
    }

    /// Takes in the caps, which are new at the end of the surface's list.
    pub(crate) fn add_caps(&mut self, surface: &Surface) {
        self.caps.extend(self.head.len() as u32..surface.triangles.len() as u32);
        self.head.resize(surface.triangles.len(), NONE);
    }

    /// True if the caps among the new triangles are near the input.
    #[inline(always)]
    pub(super) fn holds_caps<L: Lanes>(&self, place: [f32; 3], scratch: &mut Scratch) -> bool {
        if self.caps.is_empty() {
            return true;
        }
        for i in 0..scratch.faces.len() {
            let face = scratch.faces[i];
            if self.caps.contains(&face.triangle) {
                let [b, c] = [face.to_b, face.to_c].map(|to| [0, 1, 2].map(|k| place[k] + to[k]));
                if !self.is_triangle_near::<L>([place, b, c], scratch) {
                    return false;
                }
            }
        }
        true
    }

    /// True if points all over a triangle are near the input, found from one of the witnesses of the collapse.
    #[inline(always)]
    fn is_triangle_near<L: Lanes>(&self, corners: [[f32; 3]; 3], scratch: &mut Scratch) -> bool {
        let [a, b, c] = corners;
        let length = |p: [f32; 3], q: [f32; 3]| {
            let square = |k: usize| (p[k] - q[k]) * (p[k] - q[k]);
            (square(0) + square(1) + square(2)).sqrt()
        };
        let longest = length(a, b).max(length(b, c)).max(length(c, a));
        let steps = (longest / (STEP * self.limit)).ceil().max(1.0);
        // Written so that NaN is refused.
        let is_small = steps <= MOST_STEPS;
        if !is_small {
            return false;
        }
        let n = steps as u32;
        for i in 0..=n {
            for j in 0..=n - i {
                let (u, v) = (i as f32 / steps, j as f32 / steps);
                let at = |k: usize| a[k] + u * (b[k] - a[k]) + v * (c[k] - a[k]);
                if !self.is_near_some::<L>([at(0), at(1), at(2)], scratch) {
                    return false;
                }
            }
        }
        true
    }
}
