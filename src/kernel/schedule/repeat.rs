//! A run within a bound that is tighter in a few places than one before it: repeats the collapses of that one, and looks
//! again only where the bound is tighter or something has come out otherwise.

use crate::collapse::collapser::Plan;
use crate::collapse::roles::classes_allow;
use crate::earlier::DoneChange;
use crate::interrupt::BATCHES_BETWEEN_LOOKS;
use crate::schedule::driver::{DrainLimits, Driver};
use crate::schedule::evaluate::{evaluate_eight, fixation};
use crate::schedule::queue::BucketQueue;
use crate::simd::unchecked::KnownIds;
use crate::simd::{Job, Lanes};
use crate::vertex::GONE;

/// The vertex that comes from one of the mesh that was given; `GONE` of another mesh.
fn vertex_at(vertex_of: &[u32], source: u32) -> u32 {
    vertex_of.get(source as usize).copied().unwrap_or(GONE)
}

/// The changes that are repeated, compiled for the lanes they run on.
struct Repeat<'a> {
    driver: &'a mut Driver,
    done: &'a [DoneChange],
    target: u64,
}

impl Job for Repeat<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        self.driver.repeat_with::<L>(self.done, self.target);
    }
}

impl Driver {
    /// Simplifies within the bound to at most `target` triangles as an earlier run did; false if the bound ends it before.
    pub(crate) fn repeat_within_bound(&mut self, done: &[DoneChange], target: u64) -> bool {
        let n = self.state.surface.vertices.len();
        if let Some(tracker) = &mut self.bound {
            tracker.changed = vec![false; n];
        }
        let simd = self.simd;
        simd.run(Repeat { driver: self, done, target });
        let changed =
            self.bound.as_mut().map_or(Vec::new(), |tracker| std::mem::take(&mut tracker.changed));
        // All edges elsewhere have been refused before.
        let mut queue = BucketQueue::new(5);
        self.seed_around(&mut queue, changed);
        let limits = DrainLimits { cost: f32::MAX, triangles: target, may_stall: false };
        self.drain(&mut queue, limits);
        self.tidy();
        self.vanish_within_bound(target);
        self.state.surface.n_alive <= target
    }

    #[inline(always)]
    fn repeat_with<L: Lanes>(&mut self, done: &[DoneChange], target: u64) {
        // SAFETY: all ids are vertices of the surface.
        let known = unsafe { KnownIds::promise() };
        let source = &self.state.surface.source;
        let n_sources = source.iter().max().map_or(0, |&most| most as usize + 1);
        let mut vertex_of = vec![GONE; n_sources];
        source.iter().zip(0..).for_each(|(&source, v)| vertex_of[source as usize] = v);
        let mut noted = self.state.surface.n_alive;
        for (i, one) in done.iter().enumerate() {
            let n_alive = self.state.surface.n_alive;
            let is_due = i.is_multiple_of(8 * BATCHES_BETWEEN_LOOKS as usize);
            if n_alive <= target || is_due && self.interrupt.is_raised() {
                break;
            }
            if 2 * n_alive < noted {
                noted = n_alive;
                self.note_quality();
            }
            match *one {
                DoneChange::Collapse(ends, place, may_turn) => {
                    let [v0, v1] = ends.map(|source| vertex_at(&vertex_of, source));
                    let is_other = [v0, v1].iter().any(|&v| self.is_other(v));
                    let plan = Plan { v0, v1, place, may_turn };
                    let plan = self.plan_again::<L>(known, plan, is_other);
                    // No closure: it would not be compiled for wide lanes.
                    let is_done = match plan {
                        Some(plan) => self.try_out::<L>(known, plan).is_ok(),
                        None => false,
                    };
                    // A survivor of what was other before is another one, too.
                    if !is_done || is_other {
                        self.note_other(&[v0, v1]);
                    }
                }
                DoneChange::Cut(cycle, made) => {
                    let cycle = cycle.map(|source| vertex_at(&vertex_of, source));
                    let is_as_before = !cycle.iter().any(|&v| self.is_other(v));
                    let new = if is_as_before { self.cut_again(cycle) } else { None };
                    match new {
                        None => self.note_other(&cycle),
                        Some(new) => {
                            let n = self.state.surface.vertices.len();
                            for (source, v) in made.into_iter().zip(new) {
                                if let Some(place) = vertex_of.get_mut(source as usize) {
                                    *place = v;
                                }
                            }
                            if let Some(tracker) = &mut self.bound {
                                tracker.changed.resize(n, false);
                            }
                        }
                    }
                }
                DoneChange::Vanish => self.vanish_within_bound(target),
            }
        }
    }

    /// True if a vertex is not there, or is not as it was in the earlier run.
    #[inline(always)]
    fn is_other(&self, v: u32) -> bool {
        v == GONE
            || self.state.surface.rings[v as usize].len == 0
            || self.bound.as_ref().is_none_or(|tracker| tracker.changed[v as usize])
    }

    #[inline(always)]
    fn note_other(&mut self, vertices: &[u32]) {
        if let Some(tracker) = &mut self.bound {
            vertices
                .iter()
                .filter(|&&v| v != GONE)
                .for_each(|&v| tracker.changed[v as usize] = true);
        }
    }

    /// The plan of a collapse that an earlier run has carried out: with another place if an end `is_other`. `None` if its ends must
    /// not become one now.
    #[inline(always)]
    fn plan_again<L: Lanes>(&self, known: KnownIds, plan: Plan, is_other: bool) -> Option<Plan> {
        let (surface, Plan { v0, v1, .. }) = (&self.state.surface, plan);
        let is_there = |v: u32| v != GONE && surface.rings[v as usize].len > 0;
        if !is_there(v0) || !is_there(v1) {
            return None;
        }
        classes_allow(known, surface, v0, v1).ok()?;
        if !is_other {
            return Some(plan);
        }
        let fixed = [fixation(known, surface, v0, v1); 8];
        let found = evaluate_eight::<L>((known, &self.state), &[v0; 8], &[v1; 8], &fixed);
        let place = found.place.map(|along| along[0]);
        (found.cost[0] <= f32::MAX).then_some(Plan { place, may_turn: false, ..plan })
    }

    /// Puts the edges around vertices that have changed into the queue.
    fn seed_around(&self, queue: &mut BucketQueue, mut changed: Vec<bool>) {
        let triangles = &self.state.surface.triangles;
        let has_changed =
            |t: &[u32; 3], changed: &[bool]| t[0] != GONE && t.iter().any(|&v| changed[v as usize]);
        let around: Vec<u32> =
            triangles.iter().filter(|t| has_changed(t, &changed)).flatten().copied().collect();
        around.into_iter().for_each(|v| changed[v as usize] = true);
        for t in (0..triangles.len()).filter(|&t| has_changed(&triangles[t], &changed)) {
            self.seed(queue, t..t + 1, f32::INFINITY);
        }
    }
}
