//! The inner loop: takes the cheapest edges out of the queue, eight at a time, and collapses them.
//!
//! Entries are evaluated again when they come up; what has become dearer than its bucket goes back.
//! The whole loop is one `Job`, so that all of it is compiled for the lanes it runs on. Which edges are
//! in the queue, and how far it is emptied, is up to `schedule::levels`.

use std::hint::select_unpredictable;

use crate::collapse::collapser::Plan;
use crate::collapse::legality::Reject;
use crate::collapse::roles::{classes_allow, roles};
use crate::cost::fold_quadric;
use crate::cost::quadric::Evaluated;
use crate::cost::recession::Recession;
use crate::earlier::DoneChange;
use crate::interrupt::BATCHES_BETWEEN_LOOKS;
use crate::options::Topology;
use crate::schedule::driver::{DrainLimits, Driver};
use crate::schedule::evaluate::{evaluate_eight, fixation};
use crate::schedule::queue::{BucketQueue, Entry};
use crate::simd::unchecked::{KnownIds, prefetch};
use crate::simd::{Job, Lanes};
use crate::surface::class::Class;
use crate::topology::components::{cost_of_recession, whole_area};

/// A collapse that turns a normal too far is dearer by a factor of two a failure, and goes through
/// after this many.
const MAX_FAILURES: u8 = 3;

/// Costs rise by this factor from one look at the progress to the next. Measured: of scans that still give
/// way, dirty ones too, 25 to 56 % of the triangles are left then.
pub(super) const STALL_COST: f32 = 16.0;
/// A drain has stalled if fewer than one in this many triangles went meanwhile. A building scan that was
/// pressed on from there tripled its error with a seventh of its triangles gone (docs/design/kernel.md).
const STALL_SHARE: u64 = 3;
/// A mesh of fewer triangles is pressed on in any case: what is left of a thin tube goes piece by piece.
const NEVER_STALLS: u64 = 256;
/// Sources kept for cuts.
const MAX_SPARE: usize = 1 << 16;

/// Counters at the last stall check.
struct StallMark {
    cost: f32,
    alive: u64,
    refused: u64,
}

/// Up to eight edges that are evaluated together.
#[derive(Default)]
struct Batch {
    v0: [u32; 8],
    v1: [u32; 8],
    bucket: [u32; 8],
    failures: [u8; 8],
    /// Factor of the cost by failures.
    weight: [f32; 8],
    /// Cost from which on an edge belongs into a dearer bucket.
    ceiling: [f32; 8],
    /// 1 where `v1` may not move, else 0.
    fixed: [f32; 8],
    n: usize,
}

/// Collapses until the queue is empty or a limit is met. True if it gave up because hardly anything legal
/// was left: going on would flatten the little that can still collapse.
pub(crate) struct Drain<'a> {
    pub(crate) driver: &'a mut Driver,
    pub(crate) queue: &'a mut BucketQueue,
    pub(crate) limits: DrainLimits,
}

impl Job for Drain<'_> {
    type Output = bool;

    #[inline(always)]
    fn run<L: Lanes>(self) -> bool {
        self.driver.drain_with::<L>(self.queue, self.limits)
    }
}

impl Driver {
    /// The vertex that a vertex has been merged into, or itself.
    #[inline(always)]
    fn survivor(&mut self, known: KnownIds, v: u32) -> u32 {
        let ring = known.at(&self.state.surface.rings, v);
        let next = select_unpredictable(ring.class.is_none(), ring.start, v);
        if known.at(&self.state.surface.rings, next).class.is_some() {
            return next;
        }
        self.far_survivor(known, v)
    }

    /// The same after several mergers; the path becomes shorter.
    #[inline(never)]
    fn far_survivor(&mut self, known: KnownIds, v: u32) -> u32 {
        let mut last = v;
        while known.at(&self.state.surface.rings, last).class.is_none() {
            last = known.at(&self.state.surface.rings, last).start;
        }
        let mut walk = v;
        while walk != last {
            let ring = known.at_mut(&mut self.state.surface.rings, walk);
            walk = std::mem::replace(&mut ring.start, last);
        }
        last
    }

    /// Takes entries out, follows them to their survivors and drops those that came to nothing. Within a bound all are of
    /// one bucket.
    #[inline(always)]
    fn fill(&mut self, known: KnownIds, queue: &mut BucketQueue, batch: &mut Batch) {
        let mut next = queue.pop();
        batch.n = 0;
        while let Some(taken) = next {
            self.take_up(known, queue, taken, batch);
            next = match batch.n {
                8 => break,
                1.. if self.bound.is_some() => queue.pop_current(),
                _ => queue.pop(),
            };
        }
        batch.fill_up();
    }

    /// Puts an entry into a batch, unless it came to nothing.
    #[inline(always)]
    fn take_up(
        &mut self,
        known: KnownIds,
        queue: &BucketQueue,
        (bucket, entry): (u32, Entry),
        batch: &mut Batch,
    ) {
        let n = batch.n & 7;
        let (a, b) = (self.survivor(known, entry.v0), self.survivor(known, entry.v1));
        let (v0, v1) = roles(known, &self.state, a, b);
        let (ring0, ring1) =
            (known.at(&self.state.surface.rings, v0), known.at(&self.state.surface.rings, v1));
        let lone = (ring0.len == 0) | (ring1.len == 0);
        if (a == b) | lone | queue.is_double(bucket, v0, v1) {
            return;
        }
        // The class of `v1` is the higher one.
        batch.fixed[n] = 0.0;
        if ring1.class != Some(Class::Interior) {
            if let Err(reason) = classes_allow(known, &self.state.surface, v0, v1) {
                self.rejects.add(reason);
                return;
            }
            batch.fixed[n] = fixation(known, &self.state.surface, v0, v1);
        }
        // The rings of those that collapse are wanted next.
        prefetch(&self.state.surface.arena, ring0.start);
        prefetch(&self.state.surface.arena, ring1.start);
        (batch.v0[n], batch.v1[n]) = (v0, v1);
        (batch.bucket[n], batch.failures[n]) = (bucket, entry.failures);
        batch.weight[n] = f32::from(1u8 << entry.failures);
        batch.ceiling[n] = queue.lowest_cost(bucket + 1);
        batch.n = n + 1;
    }

    #[inline(always)]
    fn drain_with<L: Lanes>(&mut self, queue: &mut BucketQueue, limits: DrainLimits) -> bool {
        // SAFETY: the queue was filled with corners of the surface's triangles and with what a cut adds to them, and is
        // emptied before the surface is built again; all other ids are read from the surface.
        let known = unsafe { KnownIds::promise() };
        let mut mark = StallMark { cost: f32::MAX, alive: self.state.surface.n_alive, refused: 0 };
        let mut batch = Batch::default();
        let mut n_batches = 0u32;
        let frees_stuck = self.frees_stuck;
        while self.state.surface.n_alive > limits.triangles {
            n_batches = n_batches.wrapping_add(1);
            if n_batches.is_multiple_of(BATCHES_BETWEEN_LOOKS) && self.interrupt.is_raised() {
                return false;
            }
            self.fill(known, queue, &mut batch);
            // What was refused so far is looked at once more when it may vanish.
            if batch.n == 0 || self.frees_stuck != frees_stuck {
                return false;
            }
            if limits.may_stall && self.stalls(queue.lowest_cost(batch.bucket[0]), &mut mark) {
                return true;
            }
            let found =
                evaluate_eight::<L>((known, &self.state), &batch.v0, &batch.v1, &batch.fixed);
            let begun = self.collapses;
            if self.bound.is_some() {
                self.one_by_one::<L>(known, queue, &batch, &found, limits);
                continue;
            }
            // First what goes back, then what collapses: which is which cannot be predicted.
            let cost = L::load(&found.cost).times(L::load(&batch.weight));
            let allowed = cost.below(L::splat(limits.cost.next_up())) & (0xFF >> (8 - batch.n));
            let mut due = allowed & cost.below(L::load(&batch.ceiling));
            let mut dearer = allowed & !due;
            let cost = cost.store();
            while dearer != 0 {
                let i = dearer.trailing_zeros() as usize & 7;
                dearer &= dearer - 1;
                queue.put_back(queue.bucket(cost[i]), batch.entry(i));
            }
            while due != 0 {
                let i = due.trailing_zeros() as usize & 7;
                due &= due - 1;
                if self.state.surface.n_alive <= limits.triangles {
                    return false;
                }
                let entry = batch.entry(i);
                if self.has_changed(known, entry, begun) {
                    queue.push(batch.bucket[i], entry);
                    continue;
                }
                let place = [found.place[0][i], found.place[1][i], found.place[2][i]];
                self.attempt::<L>(known, queue, (batch.bucket[i], entry), cost[i], limits, place);
            }
        }
        false
    }

    /// Returns whether an end of an edge is another than it was after this many collapses.
    #[inline(always)]
    fn has_changed(&self, known: KnownIds, entry: Entry, begun: u64) -> bool {
        let changed = |v: u32| {
            let stamp = u64::from(known.at(&self.state.surface.vertices, v).stamp);
            (stamp > begun) | known.at(&self.state.surface.rings, v).class.is_none()
        };
        changed(entry.v0) | changed(entry.v1)
    }

    /// Goes through a batch as if it had been taken out edge by edge: what is done at one place hardly depends on how many
    /// edges of others came before, so that another run, tighter elsewhere, does the same here.
    #[inline(always)]
    fn one_by_one<L: Lanes>(
        &mut self,
        known: KnownIds,
        queue: &mut BucketQueue,
        batch: &Batch,
        found: &Evaluated,
        limits: DrainLimits,
    ) {
        let begun = self.collapses;
        let mut one = Batch::default();
        for i in 0..batch.n {
            if self.state.surface.n_alive <= limits.triangles {
                return;
            }
            let entry = batch.entry(i);
            let again;
            let (mut at, mut evaluated) = ((batch, i), found);
            if self.has_changed(known, entry, begun) {
                one.n = 0;
                self.take_up(known, queue, (batch.bucket[i], entry), &mut one);
                if one.n == 0 {
                    continue;
                }
                one.fill_up();
                again = evaluate_eight::<L>((known, &self.state), &one.v0, &one.v1, &one.fixed);
                (at, evaluated) = ((&one, 0), &again);
            }
            self.settle::<L>(known, queue, at, evaluated, limits);
        }
    }

    /// Collapses an edge of a batch, or puts it back where it belongs.
    #[inline(always)]
    fn settle<L: Lanes>(
        &mut self,
        known: KnownIds,
        queue: &mut BucketQueue,
        (batch, i): (&Batch, usize),
        found: &Evaluated,
        limits: DrainLimits,
    ) {
        let (entry, cost) = (batch.entry(i), found.cost[i] * batch.weight[i]);
        // Written so that NaN is dropped.
        let is_allowed = cost <= limits.cost;
        if !is_allowed {
            return;
        }
        if cost < batch.ceiling[i] {
            let place = [found.place[0][i], found.place[1][i], found.place[2][i]];
            self.attempt::<L>(known, queue, (batch.bucket[i], entry), cost, limits, place);
        } else {
            queue.put_back(queue.bucket(cost), entry);
        }
    }

    /// Returns whether costs run away from the progress.
    fn stalls(&mut self, cost: f32, mark: &mut StallMark) -> bool {
        // What waits for its price is not a sign of a dead end.
        let refused = self.rejects.topological() - self.deferred;
        let now = StallMark { cost, alive: self.state.surface.n_alive, refused };
        if cost < self.drained || self.state.surface.n_alive < NEVER_STALLS {
            // What is cheaper than the last level was refused then, and says nothing of progress.
            return false;
        } else if mark.cost == f32::MAX {
            *mark = now;
        } else if cost > mark.cost * STALL_COST {
            let few = is_few(mark.alive, now.alive);
            if few && refused - mark.refused > mark.alive / 4 {
                return true;
            }
            self.is_held = few && self.is_stuck(0..self.n_blocks(), cost);
            if self.is_held {
                return true;
            }
            *mark = now;
        }
        false
    }

    #[inline(always)]
    fn attempt<L: Lanes>(
        &mut self,
        known: KnownIds,
        queue: &mut BucketQueue,
        (bucket, entry): (u32, Entry),
        cost: f32,
        limits: DrainLimits,
        place: [f32; 3],
    ) {
        if self.waits(queue, (bucket, entry), limits, place) {
            return;
        }
        let may_turn = entry.failures >= MAX_FAILURES;
        if let Some(tracker) = &self.bound
            && tracker.has_refused(&self.state.surface, [entry.v0, entry.v1], may_turn)
        {
            return self.refused(queue, (bucket, entry), Reject::Bound, cost, limits);
        }
        let plan = Plan { v0: entry.v0, v1: entry.v1, place, may_turn };
        if let Err(reason) = self.try_out::<L>(known, plan) {
            self.refused(queue, (bucket, entry), reason, cost, limits);
        }
    }

    /// Carries a collapse out if it is legal, with all that is noted of it.
    #[inline(always)]
    pub(super) fn try_out<L: Lanes>(&mut self, known: KnownIds, plan: Plan) -> Result<(), Reject> {
        let (v0, v1) = (plan.v0, plan.v1);
        let number = (self.collapses + 1) as u32;
        // Each wedge of a vertex at a seam has its own source.
        let wedge = match &self.state.wedges {
            Some(wedges) => wedges.source_off_seams(&self.state.surface, v0),
            None => None,
        };
        let watchers = (self.bound.as_deref_mut(), self.crossings.as_deref_mut());
        if let Some(history) = &mut self.history {
            history.before(&self.state.surface, v0, v1);
        }
        self.collapser.attempt::<L>(known, &mut self.state, plan, number, watchers)?;
        self.collapses += 1;
        if let Some(history) = &mut self.history {
            let (fan, gone) = self.collapser.carried_out();
            history.collapsed(&self.state.surface, (v0, v1), fan, gone);
        }
        if let Some(done) = &mut self.done {
            let sources = [v0, v1].map(|v| self.state.surface.source[v as usize]);
            done.push(DoneChange::Collapse(sources, plan.place, plan.may_turn));
        }
        if self.spare_sources.len() < MAX_SPARE {
            if self.state.wedges.is_none() {
                self.spare_sources.push(self.state.surface.source[v0 as usize]);
            }
            self.spare_sources.extend(wedge);
        }
        Ok(())
    }

    /// Puts a collapse off until others are as dear, by which the rim of a thin sheet would recede too far; true if it
    /// waits.
    #[inline(always)]
    fn waits(
        &mut self,
        queue: &mut BucketQueue,
        (bucket, entry): (u32, Entry),
        limits: DrainLimits,
        place: [f32; 3],
    ) -> bool {
        let surface = &self.state.surface;
        let may_fold = |v: u32| fold_quadric::may_fold(&surface.vertices[v as usize].quadric);
        if self.bound.is_some() || !(may_fold(entry.v0) || may_fold(entry.v1)) {
            return false;
        }
        self.waits_for_price(queue, (bucket, entry), limits, place)
    }

    #[inline(never)]
    fn waits_for_price(
        &mut self,
        queue: &mut BucketQueue,
        (bucket, entry): (u32, Entry),
        limits: DrainLimits,
        place: [f32; 3],
    ) -> bool {
        let surface = &self.state.surface;
        let area = *self.area.get_or_insert_with(|| whole_area(surface));
        let recession = Recession::of(surface, (entry.v0, entry.v1), place);
        let cost_of = |distance_sq: f64| cost_of_recession(area, surface, distance_sq);
        if queue.bucket(cost_of(recession.most_sq())) <= bucket {
            return false;
        }
        let cost = cost_of(recession.distance_sq(surface));
        let due = queue.bucket(cost);
        let waits = cost.is_finite() && due > bucket;
        if waits && cost <= limits.cost {
            queue.put_back(due, entry);
        }
        waits
    }

    /// Puts a refused collapse off, or does something about the topology.
    #[inline(never)]
    fn refused(
        &mut self,
        queue: &mut BucketQueue,
        (bucket, entry): (u32, Entry),
        reason: Reject,
        cost: f32,
        limits: DrainLimits,
    ) {
        self.rejects.add(reason);
        match reason {
            Reject::Flip | Reject::Sliver | Reject::Bound | Reject::SelfIntersection
                if entry.failures < MAX_FAILURES =>
            {
                let dearer = cost * 2.0;
                if dearer <= limits.cost {
                    let entry = Entry { failures: entry.failures + 1, ..entry };
                    queue.push(queue.bucket(dearer), entry);
                }
            }
            Reject::LinkCondition | Reject::Boundary if self.topology == Topology::Error => {
                self.apply_change(queue, (bucket, entry), limits);
            }
            _ => {}
        }
    }
}

/// Returns whether few triangles went while the costs rose by `STALL_COST`.
pub(super) fn is_few(before: u64, now: u64) -> bool {
    before.saturating_sub(now) < before / STALL_SHARE
}

impl Batch {
    /// Gives lanes without an edge the first one.
    #[inline(always)]
    fn fill_up(&mut self) {
        for i in self.n..8 {
            (self.v0[i], self.v1[i]) = (self.v0[0], self.v1[0]);
        }
    }

    #[inline(always)]
    fn entry(&self, i: usize) -> Entry {
        Entry { v0: self.v0[i], v1: self.v1[i], failures: self.failures[i] }
    }
}
