//! Edges of some triangles with their costs: what a queue begins with.

use std::ops::Range;

use crate::collapse::roles::{classes_allow, roles};
use crate::schedule::evaluate::{evaluate_eight, fixation};
use crate::simd::unchecked::{KnownIds, prefetch};
use crate::simd::{Job, Lanes};
use crate::state::MeshState;
use crate::surface::AHEAD;
use crate::surface::class::Class;
use crate::vertex::GONE;

/// Hands the edges of some triangles that the classes allow and that cost less than `below`, each once with
/// its cost, to `take`.
pub(crate) struct Seeds<'a, F> {
    pub(crate) state: &'a MeshState,
    pub(crate) triangles: Range<usize>,
    pub(crate) below: f32,
    pub(crate) take: F,
}

impl<F: FnMut(u32, u32, f32)> Job for Seeds<'_, F> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(mut self) {
        let surface = &self.state.surface;
        // SAFETY: all ids are corners of the surface's triangles.
        let known = unsafe { KnownIds::promise() };
        let (mut ends, mut n) = ([[0u32; 16]; 2], 0);
        let ahead = (self.triangles.start + AHEAD).min(surface.triangles.len());
        let mut ahead = surface.triangles[ahead..].iter();
        for t in &surface.triangles[self.triangles.clone()] {
            if let Some(&[_, next, last]) = ahead.next() {
                // The first corners of some are the others of most.
                for v in [next, last] {
                    prefetch(&surface.vertices, v);
                    prefetch(&surface.rings, v);
                }
            }
            if t[0] == GONE {
                continue;
            }
            let inner = t.map(|v| known.at(&surface.rings, v).class == Some(Class::Interior));
            for (i, j) in [(0, 1), (1, 2), (2, 0)] {
                // An inner edge comes up twice, in either direction; an open one may come up in one only.
                let once = (t[i] < t[j]) | !(inner[i] | inner[j]);
                (ends[0][n & 15], ends[1][n & 15]) = (t[i], t[j]);
                n += usize::from(once);
            }
            if n >= 8 {
                self.take_eight::<L>(known, &ends, 8);
                let [from, to] = &mut ends;
                from.copy_within(8.., 0);
                to.copy_within(8.., 0);
                n -= 8;
            }
        }
        if n > 0 {
            let first = [ends[0][0], ends[1][0]];
            ends[0][n..].fill(first[0]);
            ends[1][n..].fill(first[1]);
            self.take_eight::<L>(known, &ends, n);
        }
    }
}

impl<F: FnMut(u32, u32, f32)> Seeds<'_, F> {
    /// Evaluates the first eight edges and hands over the first `n` of them.
    #[inline(always)]
    fn take_eight<L: Lanes>(&mut self, known: KnownIds, ends: &[[u32; 16]; 2], n: usize) {
        let surface = &self.state.surface;
        let (mut v0, mut v1, mut fixed) = ([0; 8], [0; 8], [0.0; 8]);
        let mut allowed = 0xFF >> (8 - n);
        for i in 0..8 {
            (v0[i], v1[i]) = roles(known, self.state, ends[0][i], ends[1][i]);
            // The class of `v1` is the higher one.
            if known.at(&surface.rings, v1[i]).class != Some(Class::Interior) {
                if classes_allow(known, surface, v0[i], v1[i]).is_err() {
                    allowed &= !(1 << i);
                }
                fixed[i] = fixation(known, surface, v0[i], v1[i]);
            }
        }
        let cost = evaluate_eight::<L>((known, self.state), &v0, &v1, &fixed).cost;
        // Which edges are cheap enough cannot be predicted.
        allowed &= L::load(&cost).below(L::splat(self.below));
        while allowed != 0 {
            let i = allowed.trailing_zeros() as usize & 7;
            allowed &= allowed - 1;
            (self.take)(v0[i], v1[i], cost[i]);
        }
    }
}
