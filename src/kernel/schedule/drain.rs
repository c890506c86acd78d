//! The inner loop: takes the cheapest edges out of the queue, eight at a time, and collapses them.
//!
//! Entries are evaluated again when they come up; what has become dearer than its bucket goes back.
//! The whole loop is one `Job`, so that all of it is compiled for the lanes it runs on. Which edges are
//! in the queue, and how far it is emptied, is up to `schedule::levels`.

use std::hint::select_unpredictable;

use crate::kernel::collapse::legality::{Class, Reject};
use crate::kernel::collapse::{Plan, classes_allow, eight, roles};
use crate::kernel::cost::placement;
use crate::kernel::cost::quadric::{self, Evaluated};
use crate::kernel::schedule::levels::Driver;
use crate::kernel::schedule::queue::{BucketQueue, Entry};
use crate::kernel::simd::unchecked::{at, at_mut, prefetch};
use crate::kernel::simd::{Job, Lanes};
use crate::kernel::surface::validate::validate_small;
use crate::kernel::surface::{AHEAD, GONE, Surface};
use crate::kernel::topology::components::Islands;
use crate::kernel::topology::{self, CutPlan, Remedy};
use crate::kernel::{Placement, Topology};

/// A collapse that turns a normal too far is dearer by a factor of two a failure, and goes through
/// after this many.
const MAX_FAILURES: u8 = 3;

/// Costs rise by this factor from one look at the progress to the next. Measured: of scans that still give
/// way, dirty ones too, 25 to 56 % of the triangles are left then.
const STALL_COST: f32 = 16.0;
/// A drain has stalled if fewer than one in so many triangles went meanwhile. A building scan that was
/// pressed on from there tripled its error with a seventh of its triangles gone (docs/results/kernel.md).
const STALL_SHARE: u64 = 3;
/// A mesh of fewer triangles is pressed on in any case: what is left of a thin tube goes piece by piece.
const NEVER_STALLS: u64 = 256;
/// Sources kept for cuts.
const MAX_SPARE: usize = 1 << 16;

/// Where a drain ends.
#[derive(Clone, Copy)]
pub(crate) struct Limits {
    /// Highest cost, in scaled units.
    pub(crate) cost: f32,
    /// Number of triangles at which to stop at once.
    pub(crate) triangles: u64,
    /// Whether to give up when hardly anything is legal; only where the whole mesh is in the queue.
    pub(crate) may_stall: bool,
}

/// Where a drain was when it last asked itself whether it still gets on.
struct Mark {
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
    /// By what the failures multiply the cost.
    weight: [f32; 8],
    /// What costs this much or more belongs into a dearer bucket.
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
    pub(crate) limits: Limits,
}

impl Job for Drain<'_> {
    type Output = bool;

    #[inline(always)]
    fn run<L: Lanes>(self) -> bool {
        self.driver.drain_with::<L>(self.queue, self.limits)
    }
}

/// Hands the edges of some triangles that the classes allow and that cost less than `below`, each once with
/// its cost, to `take`.
pub(crate) struct Seeds<'a, F> {
    pub(crate) surface: &'a Surface,
    pub(crate) triangles: std::ops::Range<usize>,
    pub(crate) below: f32,
    pub(crate) take: F,
}

impl<F: FnMut(u32, u32, f32)> Job for Seeds<'_, F> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(mut self) {
        let surface = self.surface;
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
            let inner = t.map(|v| at(&surface.rings, v).class == Some(Class::Interior));
            for (i, j) in [(0, 1), (1, 2), (2, 0)] {
                // An inner edge comes up twice, in either direction; an open one may come up in one only.
                let once = (t[i] < t[j]) | !(inner[i] | inner[j]);
                (ends[0][n & 15], ends[1][n & 15]) = (t[i], t[j]);
                n += usize::from(once);
            }
            if n >= 8 {
                self.take_eight::<L>(&ends, 8);
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
            self.take_eight::<L>(&ends, n);
        }
    }
}

impl<F: FnMut(u32, u32, f32)> Seeds<'_, F> {
    /// Evaluates the first eight edges and hands over the first `n` of them.
    #[inline(always)]
    fn take_eight<L: Lanes>(&mut self, ends: &[[u32; 16]; 2], n: usize) {
        let surface = self.surface;
        let (mut v0, mut v1, mut fixed) = ([0; 8], [0; 8], [0.0; 8]);
        let mut allowed = 0xFF >> (8 - n);
        for i in 0..8 {
            (v0[i], v1[i]) = roles(surface, ends[0][i], ends[1][i]);
            // The class of `v1` is the higher one.
            if at(&surface.rings, v1[i]).class != Some(Class::Interior) {
                if classes_allow(surface, v0[i], v1[i]).is_err() {
                    allowed &= !(1 << i);
                }
                fixed[i] = fixation(surface, v1[i]);
            }
        }
        let cost = evaluate_eight::<L>(surface, &v0, &v1, &fixed).cost;
        // Which edges are cheap enough cannot be predicted.
        allowed &= L::load(&cost).below(L::splat(self.below));
        while allowed != 0 {
            let i = allowed.trailing_zeros() as usize & 7;
            allowed &= allowed - 1;
            (self.take)(v0[i], v1[i], cost[i]);
        }
    }
}

/// 1 if the vertex may not move, else 0.
#[inline(always)]
fn fixation(surface: &Surface, v: u32) -> f32 {
    f32::from(u8::from(at(&surface.rings, v).class >= Some(Class::Complex)))
}

#[inline(always)]
fn evaluate_eight<L: Lanes>(
    surface: &Surface,
    v0: &[u32; 8],
    v1: &[u32; 8],
    fixed: &[f32; 8],
) -> Evaluated {
    let (from, to) = (eight(&surface.vertices, v0), eight(&surface.vertices, v1));
    let mut found = match surface.attributes.is_some() | surface.wedges.is_some() {
        true => evaluate_attributes::<L>(surface, v0, v1, fixed),
        false => quadric::edges::<L>(from, to, fixed, surface.scale),
    };
    if surface.placement != Placement::Optimal {
        placement::choose(surface.placement, (from, to), fixed, surface.scale, &mut found);
    }
    found
}

/// The same where channels count or seams are.
#[inline(always)]
fn evaluate_attributes<L: Lanes>(
    surface: &Surface,
    v0: &[u32; 8],
    v1: &[u32; 8],
    fixed: &[f32; 8],
) -> Evaluated {
    let mut found = match &surface.attributes {
        Some(attributes) => attributes.evaluate(surface, v0, v1, fixed),
        None => {
            let (from, to) = (eight(&surface.vertices, v0), eight(&surface.vertices, v1));
            quadric::edges::<L>(from, to, fixed, surface.scale)
        }
    };
    if let Some(wedges) = &surface.wedges {
        wedges.correct(surface, v0, v1, fixed, &mut found);
    }
    found
}

impl Driver {
    /// The vertex that a vertex has been merged into, or itself.
    #[inline(always)]
    fn survivor(&mut self, v: u32) -> u32 {
        let ring = at(&self.surface.rings, v);
        let next = select_unpredictable(ring.class.is_none(), ring.start, v);
        if at(&self.surface.rings, next).class.is_some() {
            return next;
        }
        self.far_survivor(v)
    }

    /// The same after several mergers; the path becomes shorter.
    #[inline(never)]
    fn far_survivor(&mut self, v: u32) -> u32 {
        let mut last = v;
        while at(&self.surface.rings, last).class.is_none() {
            last = at(&self.surface.rings, last).start;
        }
        let mut walk = v;
        while walk != last {
            let ring = at_mut(&mut self.surface.rings, walk);
            walk = std::mem::replace(&mut ring.start, last);
        }
        last
    }

    /// Takes entries out, follows them to their survivors and drops those that came to nothing.
    #[inline(always)]
    fn fill(&mut self, queue: &mut BucketQueue, batch: &mut Batch) {
        let mut n = 0;
        while n < 8 {
            let Some((bucket, entry)) = queue.pop() else { break };
            let (a, b) = (self.survivor(entry.v0), self.survivor(entry.v1));
            let (v0, v1) = roles(&self.surface, a, b);
            let (ring0, ring1) = (at(&self.surface.rings, v0), at(&self.surface.rings, v1));
            let lone = (ring0.len == 0) | (ring1.len == 0);
            if (a == b) | lone | queue.is_double(bucket, v0, v1) {
                continue;
            }
            // The class of `v1` is the higher one.
            batch.fixed[n] = 0.0;
            if ring1.class != Some(Class::Interior) {
                if let Err(reason) = classes_allow(&self.surface, v0, v1) {
                    self.rejects.add(reason);
                    continue;
                }
                batch.fixed[n] = fixation(&self.surface, v1);
            }
            // The rings of those that collapse are wanted next.
            prefetch(&self.surface.arena, ring0.start);
            prefetch(&self.surface.arena, ring1.start);
            (batch.v0[n], batch.v1[n]) = (v0, v1);
            (batch.bucket[n], batch.failures[n]) = (bucket, entry.failures);
            batch.weight[n] = f32::from(1u8 << entry.failures);
            batch.ceiling[n] = queue.lowest_cost(bucket + 1);
            n += 1;
        }
        batch.n = n;
        for i in n..8 {
            (batch.v0[i], batch.v1[i]) = (batch.v0[0], batch.v1[0]);
        }
    }

    #[inline(always)]
    fn drain_with<L: Lanes>(&mut self, queue: &mut BucketQueue, limits: Limits) -> bool {
        let mut mark = Mark { cost: f32::MAX, alive: self.surface.n_alive, refused: 0 };
        let mut batch = Batch::default();
        while self.surface.n_alive > limits.triangles {
            self.fill(queue, &mut batch);
            if batch.n == 0 {
                return false;
            }
            if limits.may_stall && self.stalls(queue.lowest_cost(batch.bucket[0]), &mut mark) {
                return true;
            }
            let found = evaluate_eight::<L>(&self.surface, &batch.v0, &batch.v1, &batch.fixed);
            let begun = self.collapses;
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
                if self.surface.n_alive <= limits.triangles {
                    return false;
                }
                let entry = batch.entry(i);
                let changed = |v: u32| {
                    let stamp = u64::from(at(&self.surface.vertices, v).stamp);
                    (stamp > begun) | at(&self.surface.rings, v).class.is_none()
                };
                if changed(entry.v0) | changed(entry.v1) {
                    queue.push(batch.bucket[i], entry);
                    continue;
                }
                let place = [found.place[0][i], found.place[1][i], found.place[2][i]];
                self.attempt::<L>(queue, (batch.bucket[i], entry), cost[i], limits, place);
            }
        }
        false
    }

    /// Whether costs run away from the progress.
    fn stalls(&self, cost: f32, mark: &mut Mark) -> bool {
        // What waits for its price is no sign of a dead end.
        let refused = self.rejects.topological() - self.deferred;
        let now = Mark { cost, alive: self.surface.n_alive, refused };
        if cost < self.drained || self.surface.n_alive < NEVER_STALLS {
            // What is cheaper than the last level was refused then, and says nothing of progress.
            return false;
        } else if mark.cost == f32::MAX {
            *mark = now;
        } else if cost > mark.cost * STALL_COST {
            let removed = mark.alive.saturating_sub(now.alive);
            let few = removed < mark.alive / STALL_SHARE;
            if few && refused - mark.refused > mark.alive / 4 {
                return true;
            }
            *mark = now;
        }
        false
    }

    #[inline(always)]
    fn attempt<L: Lanes>(
        &mut self,
        queue: &mut BucketQueue,
        (bucket, entry): (u32, Entry),
        cost: f32,
        limits: Limits,
        place: [f32; 3],
    ) {
        let may_turn = entry.failures >= MAX_FAILURES;
        let plan = Plan { v0: entry.v0, v1: entry.v1, place, may_turn };
        let number = (self.collapses + 1) as u32;
        // What a seam shows of a vertex has sources of its own.
        let wedge = match &self.surface.wedges {
            Some(wedges) => wedges.source_off_seams(&self.surface, entry.v0),
            None => None,
        };
        match self.collapser.attempt::<L>(&mut self.surface, plan, number) {
            Ok(()) => {
                self.collapses += 1;
                if self.spare_sources.len() < MAX_SPARE {
                    if self.surface.wedges.is_none() {
                        self.spare_sources.push(self.surface.source[entry.v0 as usize]);
                    }
                    self.spare_sources.extend(wedge);
                }
            }
            Err(reason) => self.refused(queue, (bucket, entry), reason, cost, limits),
        }
    }

    /// Puts a refused collapse off, or does something about the topology.
    #[inline(never)]
    fn refused(
        &mut self,
        queue: &mut BucketQueue,
        (bucket, entry): (u32, Entry),
        reason: Reject,
        cost: f32,
        limits: Limits,
    ) {
        self.rejects.add(reason);
        match reason {
            Reject::Flip | Reject::Sliver if entry.failures < MAX_FAILURES => {
                let dearer = cost * 2.0;
                if dearer <= limits.cost {
                    let entry = Entry { failures: entry.failures + 1, ..entry };
                    queue.push(queue.bucket(dearer), entry);
                }
            }
            Reject::LinkCondition | Reject::Boundary if self.topology == Topology::Error => {
                self.relax(queue, (bucket, entry), limits);
            }
            _ => {}
        }
    }

    /// Changes the topology where a collapse was refused for its sake, once that costs no more than
    /// collapses do.
    fn relax(&mut self, queue: &mut BucketQueue, (bucket, entry): (u32, Entry), limits: Limits) {
        let may_vanish = self.islands.as_ref().is_none_or(|islands| islands.is_small(entry.v0));
        let ends = (entry.v0, entry.v1);
        let remedy = topology::remedy(&self.surface, ends, &self.collapser, may_vanish);
        match remedy {
            Some(Remedy::Vanish(triangles)) => {
                self.remove_component(queue, (bucket, entry), limits, &triangles);
            }
            Some(Remedy::Cut(cycle)) => self.cut(queue, (bucket, entry), limits, cycle),
            _ => {}
        }
    }

    fn remove_component(
        &mut self,
        queue: &mut BucketQueue,
        (bucket, entry): (u32, Entry),
        limits: Limits,
        triangles: &[u32],
    ) {
        let islands = self.islands.get_or_insert_with(|| Islands::new(&self.surface));
        let limit = topology::error_worth(limits.cost, triangles.len());
        let Some(removal) = islands.removal(&self.surface, triangles, limit) else { return };
        let cost = topology::price(removal.error, triangles.len());
        let hold = islands.hold_cost(&self.surface, removal, triangles.len());
        let is_due = is_due(queue, (bucket, entry), cost.max(hold), limits, &mut self.deferred);
        if is_due && leaves_enough(&self.surface, triangles.len(), limits) {
            topology::vanish(&mut self.surface, triangles);
            islands.removed(removal, triangles.len());
            self.changes.removed(removal, self.surface.unscale);
            self.collapses += 1;
            validate_small(&self.surface);
        }
    }

    fn cut(
        &mut self,
        queue: &mut BucketQueue,
        (bucket, entry): (u32, Entry),
        limits: Limits,
        cycle: [u32; 3],
    ) {
        // What a cut separates takes a search: not before it can be due.
        let least = topology::least_cut_cost(&self.surface, cycle);
        if !is_due(queue, (bucket, entry), least, limits, &mut self.deferred) {
            return;
        }
        let Some(plan) = topology::plan_cut(&self.surface, cycle) else { return };
        let (cost, n_freed) = match &plan {
            CutPlan::Handle(cost, _) => (*cost, 0),
            CutPlan::Strip(triangles, cost) => (*cost, triangles.len() - 1),
        };
        let is_due = is_due(queue, (bucket, entry), cost, limits, &mut self.deferred);
        if !is_due || !leaves_enough(&self.surface, n_freed, limits) {
            return;
        }
        let strip = match plan {
            CutPlan::Handle(_, sides) => {
                if !topology::opens_handle(&self.surface, cycle, &sides) {
                    return;
                }
                None
            }
            CutPlan::Strip(triangles, _) => Some(triangles),
        };
        let number = (self.collapses + 1) as u32;
        let n = self.spare_sources.len();
        let Some(&sources) = self.spare_sources.last_chunk::<3>() else { return };
        let new = topology::cut(&mut self.surface, cycle, sources, number, self.simd);
        let Some(new) = new else { return };
        self.spare_sources.truncate(n - 3);
        self.collapses += 1;
        validate_small(&self.surface);
        if let Some(triangles) = strip {
            self.strip(&triangles, cycle, new);
            self.changes.stripped += 1;
            return;
        }
        self.changes.cuts += 1;
        queue.push(bucket, entry);
        let [a, b, c] = new;
        for (v0, v1) in [(a, b), (b, c), (c, a)] {
            queue.push(bucket, Entry { v0, v1, failures: 0 });
        }
    }

    /// Removes what a cut has separated: those triangles and the cap on their side.
    fn strip(&mut self, triangles: &[u32], cycle: [u32; 3], new: [u32; 3]) {
        // The new corners took over one side of the cut.
        let has_new = |&t: &u32| self.surface.triangles[t as usize].iter().any(|v| new.contains(v));
        let cap_of = if triangles.iter().any(has_new) { new } else { cycle };
        let n = self.surface.triangles.len() as u32;
        let cap = [n - 2, n - 1]
            .into_iter()
            .find(|&t| self.surface.triangles[t as usize].iter().all(|v| cap_of.contains(v)));
        let mut gone = triangles.to_vec();
        gone.extend(cap);
        topology::vanish(&mut self.surface, &gone);
        validate_small(&self.surface);
    }
}

/// Whether so many triangles can go without passing the target.
fn leaves_enough(surface: &Surface, n_freed: usize, limits: Limits) -> bool {
    surface.n_alive + 2 >= limits.triangles + n_freed as u64
}

/// Whether a change of this cost may be made now; if not, but within the limit, its entry waits for that cost and
/// is counted in `deferred`.
fn is_due(
    queue: &mut BucketQueue,
    (bucket, entry): (u32, Entry),
    cost: f32,
    limits: Limits,
    deferred: &mut u64,
) -> bool {
    if cost.is_nan() || cost > limits.cost {
        return false;
    }
    let due = queue.bucket(cost);
    if due > bucket {
        queue.put_back(due, entry);
        *deferred += 1;
    }
    due <= bucket
}

impl Batch {
    #[inline(always)]
    fn entry(&self, i: usize) -> Entry {
        Entry { v0: self.v0[i], v1: self.v1[i], failures: self.failures[i] }
    }
}
