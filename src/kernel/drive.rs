//! Which edges are collapsed in which order: levels of blocks first, then one exact queue.
//!
//! A level drains every block of a few thousand triangles to one common cost threshold before the next
//! block begins, so that a block's data stays in cache. Only the seeds are local: collapses reach
//! across, so there are no borders between blocks. Entries are evaluated again when they come up; what
//! has become dearer than its bucket goes back.

use super::Topology;
use super::collapse::{Collapser, Plan, classes_allow, roles};
use super::evaluate::{Edges, Evaluated};
use super::lanes::Simd;
use super::legal::{Class, Reject, RejectCounts};
use super::queue::{BucketQueue, Entry};
use super::samples::Samples;
use super::surface::{GONE, Surface};
use super::topology::{self, Remedy};

/// Triangles whose edges seed one queue.
const BLOCK: usize = 4 * 1024;
/// Every so many blocks is drained first to find a level's threshold.
const PILOT_STRIDE: usize = 16;
/// Meshes of fewer triangles have no levels.
const MIN_LEVEL_TRIANGLES: u64 = 24 * BLOCK as u64;
/// A level leaves about this share of the triangles.
const LEVEL_SHARE: f64 = 0.25;
/// Levels end at this multiple of the target; the exact queue does the rest.
const EXACT_MULTIPLE: f64 = 1.4;
/// A collapse that turns a normal too far is dearer by a factor of two a failure, and goes through
/// after this many.
const MAX_FAILURES: u8 = 3;

/// Costs rise by this factor from one look at the progress to the next; by N ~ cost^-0.48 the count
/// should have fallen to an eighth.
const STALL_COST: f32 = 64.0;
/// A drain has stalled if fewer than one in so many triangles went meanwhile.
const STALL_SHARE: u64 = 10;
/// Sources kept for cuts.
const MAX_SPARE: usize = 1 << 16;

/// The simplification under way.
pub(crate) struct Driver {
    pub(crate) surface: Surface,
    simd: Simd,
    collapser: Collapser,
    pub(crate) rejects: RejectCounts,
    /// Since the last time the stamps were set to zero; and before.
    collapses: u64,
    collapses_before: u64,
    topology: Topology,
    /// Input vertices that are gone, for the new vertices of a cut.
    spare_sources: Vec<u32>,
    pub(crate) changes: TopologyChanges,
    /// What the result will be fitted to.
    pub(crate) samples: Option<Samples>,
}

/// Changes of topology that were made.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct TopologyChanges {
    pub(crate) specks: u64,
    pub(crate) cuts: u64,
}

/// Where a drain ends.
#[derive(Clone, Copy)]
struct Limits {
    /// Highest cost, in scaled units.
    cost: f32,
    /// Number of triangles at which to stop at once.
    triangles: u64,
    /// Whether to give up when hardly anything is legal; only where the whole mesh is in the queue.
    may_stall: bool,
}

/// Where a drain was when it last asked itself whether it still gets on.
struct Mark {
    cost: f32,
    alive: u64,
    refused: u64,
}

/// Up to eight edges that are evaluated together.
struct Batch {
    entries: [(u32, Entry); 8],
    n: usize,
}

impl Driver {
    pub(crate) fn new(surface: Surface, simd: Simd, topology: Topology) -> Self {
        Driver {
            surface,
            simd,
            collapser: Collapser::new(topology == Topology::Error),
            rejects: RejectCounts::default(),
            collapses: 0,
            collapses_before: 0,
            topology,
            spare_sources: Vec::new(),
            changes: TopologyChanges::default(),
            samples: None,
        }
    }

    pub(crate) fn total_collapses(&self) -> u64 {
        self.collapses + self.collapses_before
    }

    /// Scaled cost of a threshold in units^4.
    fn scaled(&self, level: f64) -> f32 {
        (level * self.surface.scale.powi(4)) as f32
    }

    /// Drains the whole mesh to one threshold, block by block.
    pub(crate) fn level(&mut self, level: f64) {
        let limits = Limits { cost: self.scaled(level), triangles: 0, may_stall: false };
        let mut queue = BucketQueue::new(3);
        for block in 0..self.n_blocks() {
            self.drain_block(&mut queue, block, limits);
        }
        self.tidy();
    }

    /// Simplifies to at most `target` triangles; false if nothing legal is left before.
    pub(crate) fn reach(&mut self, target: u64) -> bool {
        let enough = (target as f64 * EXACT_MULTIPLE) as u64;
        while self.surface.n_alive > enough.max(MIN_LEVEL_TRIANGLES) {
            let before = self.surface.n_alive;
            self.free_level(enough, target);
            self.tidy();
            if self.surface.n_alive as f64 > before as f64 * 0.97 {
                break;
            }
        }
        self.exact(target)
    }

    fn n_blocks(&self) -> usize {
        self.surface.triangles.len().div_ceil(BLOCK)
    }

    fn tidy(&mut self) {
        if (self.surface.n_alive as f64) < 0.75 * self.surface.triangles.len() as f64 {
            if let Some(samples) = &mut self.samples {
                samples.follow(&self.surface.rings);
            }
            let place = self.surface.compact(self.simd);
            if let Some(samples) = &mut self.samples {
                samples.renumber(&place, self.surface.n_alive, self.surface.vertices.len());
            }
            self.collapses_before += std::mem::take(&mut self.collapses);
        }
    }

    /// One level whose threshold comes from a sample of the blocks.
    fn free_level(&mut self, enough: u64, target: u64) {
        let n_blocks = self.n_blocks();
        let share = (enough as f64 / self.surface.n_alive as f64).max(LEVEL_SHARE);
        let pilot: Vec<usize> = (0..n_blocks).step_by(PILOT_STRIDE).collect();
        let count = |driver: &Self| -> usize {
            let alive = |&block: &usize| driver.block(block).filter(|t| t[0] != GONE).count();
            pilot.iter().map(alive).sum()
        };
        let wanted = (count(self) as f64 * share) as usize;
        let mut cost = self.low_cost(&pilot, (1.0 - share) * 0.6);
        let mut queue = BucketQueue::new(3);
        for _ in 0..200 {
            let limits = Limits { cost, triangles: target, may_stall: false };
            for &block in &pilot {
                self.drain_block(&mut queue, block, limits);
            }
            if count(self) <= wanted {
                break;
            }
            cost *= std::f32::consts::SQRT_2;
        }
        for block in (0..n_blocks).filter(|block| block % PILOT_STRIDE != 0) {
            self.drain_block(
                &mut queue,
                block,
                Limits { cost, triangles: target, may_stall: false },
            );
        }
    }

    fn block(&self, block: usize) -> impl Iterator<Item = &[u32; 3]> {
        let end = ((block + 1) * BLOCK).min(self.surface.triangles.len());
        self.surface.triangles[block * BLOCK..end].iter()
    }

    /// The cost that a share of the edges does not reach.
    fn low_cost(&mut self, blocks: &[usize], share: f64) -> f32 {
        let mut costs = Vec::new();
        for &block in blocks {
            let end = ((block + 1) * BLOCK).min(self.surface.triangles.len());
            self.each_edge(block * BLOCK..end, |_, _, cost| costs.push(cost));
        }
        if costs.is_empty() {
            return f32::MIN_POSITIVE;
        }
        let at = (costs.len() as f64 * share) as usize;
        costs.select_nth_unstable_by(at, f32::total_cmp).1.max(f32::MIN_POSITIVE)
    }

    /// Evaluates the edges of some triangles, each once, and hands those that classes allow to `take`.
    fn each_edge(&self, range: std::ops::Range<usize>, mut take: impl FnMut(u32, u32, f32)) {
        let surface = &self.surface;
        let mut pairs = [(0u32, 0u32); 16];
        let mut n = 0;
        let inner = |v: u32| surface.rings[v as usize].class == Some(Class::Interior);
        let mut take_eight = |pairs: &[(u32, u32); 8], n: usize| {
            let found = self.evaluate(pairs);
            for (&(v0, v1), cost) in pairs.iter().zip(found.cost).take(n) {
                take(v0, v1, cost);
            }
        };
        for t in &surface.triangles[range] {
            if t[0] == GONE {
                continue;
            }
            for (a, b) in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
                // An inner edge comes up twice, in either direction; an open one may come up in one only.
                let once = a < b || !(inner(a) || inner(b));
                let (v0, v1) = roles(surface, a, b);
                pairs[n & 15] = (v0, v1);
                n += usize::from(once && classes_allow(surface, v0, v1).is_ok());
            }
            if n >= 8 {
                if let Some(eight) = pairs.first_chunk::<8>() {
                    take_eight(eight, 8);
                }
                pairs.copy_within(8.., 0);
                n -= 8;
            }
        }
        if n > 0 {
            let first = pairs[0];
            pairs[n..].fill(first);
            if let Some(eight) = pairs.first_chunk::<8>() {
                take_eight(eight, n);
            }
        }
    }

    fn evaluate(&self, pairs: &[(u32, u32); 8]) -> Evaluated {
        let surface = &self.surface;
        let fixed = |v: u32| surface.rings[v as usize].class.is_some_and(Class::is_fixed);
        self.simd.run(Edges {
            v0: std::array::from_fn(|i| &surface.vertices[pairs[i].0 as usize]),
            v1: std::array::from_fn(|i| &surface.vertices[pairs[i].1 as usize]),
            fixed: std::array::from_fn(|i| if fixed(pairs[i].1) { 1.0 } else { 0.0 }),
            scale: surface.scale,
        })
    }

    fn drain_block(&mut self, queue: &mut BucketQueue, block: usize, limits: Limits) {
        queue.clear();
        let end = ((block + 1) * BLOCK).min(self.surface.triangles.len());
        self.each_edge(block * BLOCK..end, |v0, v1, cost| {
            if cost <= limits.cost {
                queue.push(queue.bucket(cost), Entry { v0, v1, failures: 0 });
            }
        });
        self.drain(queue, limits);
    }

    /// One fine queue over everything, to the exact count.
    fn exact(&mut self, target: u64) -> bool {
        let mut queue = BucketQueue::new(5);
        while self.surface.n_alive > target {
            let before = self.surface.n_alive;
            queue.clear();
            self.each_edge(0..self.surface.triangles.len(), |v0, v1, cost| {
                if cost < f32::INFINITY {
                    queue.push(queue.bucket(cost), Entry { v0, v1, failures: 0 });
                }
            });
            let limits = Limits { cost: f32::MAX, triangles: target, may_stall: true };
            let stalled = self.drain(&mut queue, limits);
            // What was refused may have become legal since; without any progress it has not.
            if stalled || self.surface.n_alive == before {
                return self.surface.n_alive <= target;
            }
        }
        true
    }

    /// The vertex that a vertex has been merged into, or itself.
    fn survivor(&mut self, v: u32) -> u32 {
        let mut at = v;
        while self.surface.rings[at as usize].class.is_none() {
            at = self.surface.rings[at as usize].start;
        }
        let mut walk = v;
        while walk != at {
            let ring = &mut self.surface.rings[walk as usize];
            walk = std::mem::replace(&mut ring.start, at);
        }
        at
    }

    /// Takes entries out, follows them to their survivors and drops those that came to nothing.
    fn fill(&mut self, queue: &mut BucketQueue, batch: &mut Batch) {
        batch.n = 0;
        while batch.n < 8 {
            let Some((bucket, entry)) = queue.pop() else { break };
            let (a, b) = (self.survivor(entry.v0), self.survivor(entry.v1));
            let lone = |v: u32| self.surface.rings[v as usize].len == 0;
            if a == b || lone(a) || lone(b) {
                continue;
            }
            let (v0, v1) = roles(&self.surface, a, b);
            if queue.is_double(bucket, v0, v1) {
                continue;
            }
            match classes_allow(&self.surface, v0, v1) {
                Ok(()) => {
                    batch.entries[batch.n] = (bucket, Entry { v0, v1, ..entry });
                    batch.n += 1;
                }
                Err(reason) => self.rejects.add(reason),
            }
        }
    }

    /// Collapses until the queue is empty or a limit is met. True if it gave up because hardly anything
    /// legal was left: going on would flatten the little that can still collapse.
    fn drain(&mut self, queue: &mut BucketQueue, limits: Limits) -> bool {
        let mut mark = Mark { cost: f32::MAX, alive: self.surface.n_alive, refused: 0 };
        let mut batch = Batch { entries: [(0, Entry { v0: 0, v1: 0, failures: 0 }); 8], n: 0 };
        while self.surface.n_alive > limits.triangles {
            self.fill(queue, &mut batch);
            if batch.n == 0 {
                return false;
            }
            let refused = self.rejects.topological();
            let cost = queue.lowest_cost(batch.entries[0].0);
            if cost > mark.cost * STALL_COST {
                let removed = mark.alive - self.surface.n_alive.min(mark.alive);
                let few = removed < mark.alive / STALL_SHARE;
                if limits.may_stall && few && refused - mark.refused > mark.alive / 4 {
                    return true;
                }
                mark = Mark { cost, alive: self.surface.n_alive, refused };
            } else if mark.cost == f32::MAX {
                mark = Mark { cost, alive: self.surface.n_alive, refused };
            }
            let pair = |i: usize| {
                let entry = batch.entries[if i < batch.n { i } else { 0 }].1;
                (entry.v0, entry.v1)
            };
            let found = self.evaluate(&std::array::from_fn(pair));
            let begun = self.collapses;
            for i in 0..batch.n {
                let (bucket, entry) = batch.entries[i];
                if self.surface.n_alive <= limits.triangles {
                    return false;
                }
                let changed = |v: u32| {
                    let ring = &self.surface.rings[v as usize];
                    let stamp = u64::from(self.surface.vertices[v as usize].stamp);
                    ring.class.is_none() || stamp > begun
                };
                if changed(entry.v0) || changed(entry.v1) {
                    queue.push(bucket, entry);
                    continue;
                }
                let cost = found.cost[i] * f32::from(1u8 << entry.failures);
                let allowed = cost <= limits.cost;
                if !allowed {
                    continue;
                }
                let now = queue.bucket(cost);
                if now > bucket {
                    queue.put_back(now, entry);
                    continue;
                }
                let place = [0, 1, 2].map(|k| found.place[k][i]);
                self.attempt(queue, (bucket, entry), cost, limits, place);
            }
        }
        false
    }

    fn attempt(
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
        let source = self.surface.source[entry.v0 as usize];
        match self.collapser.attempt(&mut self.surface, plan, number, self.simd) {
            Ok(()) => {
                self.collapses += 1;
                if self.spare_sources.len() < MAX_SPARE {
                    self.spare_sources.push(source);
                }
            }
            Err(reason @ (Reject::Flip | Reject::Sliver)) if !may_turn => {
                self.rejects.add(reason);
                let dearer = cost * 2.0;
                if dearer <= limits.cost {
                    let entry = Entry { failures: entry.failures + 1, ..entry };
                    queue.push(queue.bucket(dearer), entry);
                }
            }
            Err(reason @ (Reject::LinkCondition | Reject::Boundary))
                if self.topology == Topology::Error =>
            {
                self.rejects.add(reason);
                self.relax(queue, (bucket, entry), limits);
            }
            Err(reason) => self.rejects.add(reason),
        }
    }

    /// Changes the topology where a collapse was refused for its sake, once that costs no more than
    /// collapses do.
    fn relax(&mut self, queue: &mut BucketQueue, (bucket, entry): (u32, Entry), limits: Limits) {
        let (v0, v1) = (entry.v0, entry.v1);
        let Some((remedy, cost)) = topology::remedy(&self.surface, v0, v1, &self.collapser) else {
            return;
        };
        let allowed = cost <= limits.cost;
        if !allowed {
            return;
        }
        let due = queue.bucket(cost);
        if due > bucket {
            queue.put_back(due, entry);
            return;
        }
        let number = (self.collapses + 1) as u32;
        match remedy {
            Remedy::Vanish(triangles) => {
                // Not past the target.
                if self.surface.n_alive + 2 < limits.triangles + triangles.len() as u64 {
                    return;
                }
                topology::vanish(&mut self.surface, &triangles);
                self.changes.specks += 1;
            }
            Remedy::Cut(cycle) => {
                let n = self.spare_sources.len();
                let Some(&sources) = self.spare_sources.last_chunk::<3>() else { return };
                let new = topology::cut(&mut self.surface, cycle, sources, number, self.simd);
                let Some([a, b, c]) = new else { return };
                self.spare_sources.truncate(n - 3);
                self.changes.cuts += 1;
                queue.push(bucket, entry);
                for (v0, v1) in [(a, b), (b, c), (c, a)] {
                    queue.push(bucket, Entry { v0, v1, failures: 0 });
                }
            }
        }
        self.collapses += 1;
    }
}
