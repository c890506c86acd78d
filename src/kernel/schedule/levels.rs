//! Order of collapses: levels of blocks first, then one exact queue.
//!
//! A level drains every block of a few thousand triangles to one common cost threshold before the next
//! block begins, so that a block's data stays in cache. Only the seeds are local: collapses reach
//! across, so there are no borders between blocks. The inner loop is in `drain`.
//!
//! docs/algorithm.md, section 5.

use std::ops::Range;

use crate::collapse::legality::Reject;
use crate::options::Topology;
use crate::schedule::drain::{Drain, STALL_COST, is_few};
use crate::schedule::driver::{DrainLimits, Driver};
use crate::schedule::held;
use crate::schedule::queue::{BucketQueue, Entry};
use crate::schedule::seeds::Seeds;
use crate::state::validate::validate_small;
use crate::topology::components::whole_area;
use crate::vertex::GONE;
use stonecut_mesh::steps::count;

/// Triangles whose edges seed one queue.
pub(super) const BLOCK: usize = 4 * 1024;
/// One in this many blocks is drained first to find a level's threshold.
pub(super) const PILOT_STRIDE: usize = 16;
/// Meshes of fewer triangles have no levels.
pub(super) const MIN_LEVEL_TRIANGLES: u64 = 8 * BLOCK as u64;
/// Of fewer, no further ones: what is left is few enough for the exact queue, which makes up to 1.4 % less
/// error.
const MIN_FURTHER_TRIANGLES: u64 = 24 * BLOCK as u64;
/// A level leaves about this share of the triangles.
const LEVEL_SHARE: f64 = 0.25;
/// Levels end at this multiple of the target; the exact queue does the rest.
const EXACT_MULTIPLE: f64 = 1.4;
/// Vertices that wait to be taken apart, one for this many triangles or more, are so before the first level.
const MANY_MISSING: u64 = 32;
/// Sampled blocks that do not give way at this multiple of the squared mean area of the triangles that a level leaves, an error of about
/// two thirds of their edges, are stuck. (Scans end at 0.5 of it, many small components at 1.5.)
const MOST_COST: f64 = 8.0;
/// Sampled blocks have given way if more than one in this many of their triangles went.
const GAVE_WAY: usize = 64;

impl Driver {
    /// Drains the whole mesh to one threshold, block by block.
    pub(crate) fn level(&mut self, level: f64) {
        let limits = DrainLimits { cost: self.scaled(level), triangles: 0, may_stall: false };
        let mut queue = BucketQueue::new(3);
        self.mend();
        for block in 0..self.n_blocks() {
            if self.interrupt.is_raised() {
                break;
            }
            self.drain_block(&mut queue, block, limits);
        }
        self.tidy();
    }

    /// Drains the whole mesh from one queue to ascending thresholds that lie close together; gives back how
    /// many triangles were left after each. Thresholds are rounded up to 1/32 of an octave.
    pub(crate) fn close_levels(&mut self, levels: &[f64]) -> Vec<u64> {
        let Some(&highest) = levels.last() else { return Vec::new() };
        let mut queue = self.queue_for(highest);
        levels.iter().map(|&level| self.close_level(&mut queue, level)).collect()
    }

    /// Seeds a queue with all edges up to the highest of some close thresholds.
    pub(crate) fn queue_for(&mut self, highest: f64) -> BucketQueue {
        let mut queue = BucketQueue::new(5);
        let highest = queue.bucket(self.scaled(highest));
        let below = queue.lowest_cost(highest + 1);
        self.seed(&mut queue, 0..self.state.surface.triangles.len(), below);
        queue
    }

    /// Drains such a queue to the next of its thresholds; gives back how many triangles are left.
    pub(crate) fn close_level(&mut self, queue: &mut BucketQueue, level: f64) -> u64 {
        queue.close_above(self.scaled(level));
        self.drain(queue, DrainLimits { cost: f32::MAX, triangles: 0, may_stall: false });
        self.state.surface.n_alive
    }

    /// Takes the cheapest collapses, until what is left costs more than a threshold or `triangles` are left.
    pub(crate) fn free_to(&mut self, cost: f64, triangles: u64) {
        self.mend();
        let cost = self.scaled(cost).min(f32::MAX);
        let mut queue = BucketQueue::new(5);
        self.seed(&mut queue, 0..self.state.surface.triangles.len(), cost);
        self.drain(&mut queue, DrainLimits { cost, triangles, may_stall: false });
        self.tidy();
    }

    /// Simplifies to at most `target` triangles; false if nothing legal is left before.
    pub(crate) fn reach(&mut self, target: u64) -> bool {
        self.ceiling = held::ceiling(&self.state.surface, target);
        if self.history.is_some() {
            return self.recorded(target);
        }
        self.mend_in_steps(target);
        let enough = (target as f64 * EXACT_MULTIPLE) as u64;
        let mut least = MIN_LEVEL_TRIANGLES;
        while self.state.surface.n_alive > enough.max(least) && !self.interrupt.is_raised() {
            least = MIN_FURTHER_TRIANGLES;
            let before = self.state.surface.n_alive;
            let is_stuck = self.free_level(enough, target);
            self.note_quality();
            self.tidy();
            self.mend();
            if is_stuck || self.state.surface.n_alive as f64 > before as f64 * 0.97 {
                break;
            }
        }
        self.exact(target)
    }

    /// The same, all steps recorded: out of one queue, since levels depend on the target. What is mended at last comes before
    /// the first step.
    fn recorded(&mut self, target: u64) -> bool {
        self.mend_at_last(0);
        self.drained = 0.0;
        if let Some(history) = &mut self.history {
            history.clear();
        }
        self.drain_to(target)
    }

    pub(super) fn n_blocks(&self) -> usize {
        self.state.surface.triangles.len().div_ceil(BLOCK)
    }

    /// The same, with sources from a few collapses if there are too few.
    fn mend_at_last(&mut self, target: u64) {
        let missing = self.changes.missing;
        if self.topology == Topology::Error && missing > 0 {
            if missing > self.spare_sources.len() as u64 {
                let few = self.state.surface.n_alive.saturating_sub(2 * missing + 2);
                self.drain_to(few.max(target));
            }
            self.mend();
        }
    }

    /// Takes apart what waits for sources where that is much: a few collapses at a time, so that they come from everywhere, not only from
    /// where nothing is held.
    fn mend_in_steps(&mut self, target: u64) {
        let mut before = u64::MAX;
        while self.changes.missing < before
            && self.changes.missing * MANY_MISSING > self.state.surface.n_alive
            && self.topology == Topology::Error
        {
            before = self.changes.missing;
            self.drain_to(self.state.surface.n_alive.saturating_sub(before / 2 + 2).max(target));
            self.mend();
        }
        self.drained = 0.0;
    }

    /// One level whose threshold comes from a sample of the blocks: the cost at which these gave way for the last time, if no cost takes them
    /// as far as they should. True if most of it is stuck.
    fn free_level(&mut self, enough: u64, target: u64) -> bool {
        let n_blocks = self.n_blocks();
        let held: Vec<usize> = (0..n_blocks)
            .map(|block| held::n_held(&self.state.surface, self.block(block)))
            .collect();
        let n_held = held.iter().sum::<usize>() as f64;
        let share = (enough as f64 - n_held) / (self.state.surface.n_alive as f64 - n_held);
        let share = share.max(LEVEL_SHARE);
        // Of blocks that are mostly held, or lie around hubs, little can be learnt.
        let is_free = |block: &usize| {
            let range = self.block(*block);
            let at_hubs = held::n_at_hubs(&self.state.surface, range.clone());
            2 * held[*block].max(at_hubs) <= range.len()
        };
        let free: Vec<usize> = (0..n_blocks).filter(is_free).collect();
        let pilot = || free.iter().copied().step_by(PILOT_STRIDE);
        let count = |driver: &Self| -> usize {
            let blocks =
                pilot().flat_map(|block| &driver.state.surface.triangles[driver.block(block)]);
            blocks.filter(|t| t[0] != GONE).count()
        };
        let stays: usize = pilot().map(|block| held[block]).sum();
        let wanted = stays + ((count(self) - stays) as f64 * share) as usize;
        let mut queue = BucketQueue::new(3);
        let mut costs = Vec::new();
        for block in pilot() {
            self.each_edge(self.block(block), f32::INFINITY, |v0, v1, cost| {
                queue.push(queue.bucket(cost), Entry { v0, v1, failures: 0 });
                costs.push(cost);
            });
        }
        let mut cost = quantile(costs, (1.0 - share) * 0.6);
        let mut limits = DrainLimits { cost: self.ceiling, triangles: target, may_stall: false };
        let (mut mark, mut is_stuck) = ((cost, count(self)), false);
        let mut gave_way = mark;
        let n_left = self.state.surface.n_alive as f64 * share;
        let mean = whole_area(&self.state.surface) / n_left;
        let most = (MOST_COST * mean * mean).min(f64::from(f32::MAX)) as f32;
        for _ in 0..200 {
            queue.close_above(cost);
            self.drain(&mut queue, limits);
            let n = count(self);
            if gave_way.1.saturating_sub(n) > gave_way.1 / GAVE_WAY {
                gave_way = (cost, n);
            }
            if n > wanted && cost >= most {
                (mark, is_stuck) = (gave_way, true);
                break;
            }
            if n <= wanted || cost >= self.ceiling || self.interrupt.is_raised() {
                break;
            }
            if cost > mark.0 * STALL_COST {
                is_stuck = is_few(mark.1 as u64, n as u64) && self.is_stuck(pilot(), cost);
                if is_stuck {
                    break;
                }
                mark = (cost, n);
            }
            cost *= std::f32::consts::SQRT_2;
        }
        limits.cost = if is_stuck { mark.0 } else { queue.highest_cost().min(self.ceiling) };
        let drained: Vec<usize> = pilot().collect();
        for block in (0..n_blocks).filter(|block| drained.binary_search(block).is_err()) {
            if self.interrupt.is_raised() {
                return false;
            }
            self.drain_block(&mut queue, block, limits);
        }
        self.drained = limits.cost;
        is_stuck
    }

    /// Returns whether most edges of some blocks, drained to this cost, are so cheap that they must have been refused, or may not collapse
    /// at all, and that because sheets meet there. To go on would take everything from the few that can still collapse.
    pub(super) fn is_stuck(&self, blocks: impl Iterator<Item = usize>, cost: f32) -> bool {
        let met = self.rejects.of(Reject::SelfIntersection) + self.rejects.of(Reject::NonManifold);
        if met <= self.rejects.topological() {
            return false;
        }
        let (mut n_alive, mut n_free) = (0, 0);
        for block in blocks {
            let block = self.block(block);
            n_alive +=
                self.state.surface.triangles[block.clone()].iter().filter(|t| t[0] != GONE).count();
            self.each_edge(block, f32::INFINITY, |_, _, own| {
                n_free += usize::from(own * STALL_COST > cost)
            });
        }
        // Three edges for two triangles.
        4 * n_free < 3 * n_alive
    }

    fn block(&self, block: usize) -> Range<usize> {
        block * BLOCK..((block + 1) * BLOCK).min(self.state.surface.triangles.len())
    }

    /// The cost that a share of the edges of some blocks does not reach.
    pub(super) fn low_cost(&self, blocks: impl Iterator<Item = usize>, share: f64) -> f32 {
        let mut costs = Vec::new();
        for block in blocks {
            self.each_edge(self.block(block), f32::INFINITY, |_, _, cost| costs.push(cost));
        }
        quantile(costs, share)
    }

    /// Evaluates the edges of some triangles, each once, and hands those that classes allow and that cost less
    /// than `below` to `take`.
    fn each_edge(&self, triangles: Range<usize>, below: f32, take: impl FnMut(u32, u32, f32)) {
        self.simd.run(Seeds { state: &self.state, triangles, below, take });
    }

    /// Puts the edges of some triangles that cost less than `below` into the queue.
    pub(super) fn seed(&self, queue: &mut BucketQueue, triangles: Range<usize>, below: f32) {
        self.each_edge(triangles, below, |v0, v1, cost| {
            queue.push(queue.bucket(cost), Entry { v0, v1, failures: 0 });
        });
    }

    pub(super) fn drain(&mut self, queue: &mut BucketQueue, limits: DrainLimits) -> bool {
        let simd = self.simd;
        let tried = |driver: &Driver| driver.collapses + driver.rejects.total();
        let before = tried(self);
        let stalled = simd.run(Drain { driver: self, queue, limits });
        count((tried(self) - before) as usize);
        validate_small(&self.state);
        stalled
    }

    fn drain_block(&mut self, queue: &mut BucketQueue, block: usize, limits: DrainLimits) {
        self.drain_range(queue, self.block(block), limits);
    }

    /// Empties a queue of the edges of some triangles.
    pub(super) fn drain_range(
        &mut self,
        queue: &mut BucketQueue,
        triangles: Range<usize>,
        limits: DrainLimits,
    ) {
        queue.clear();
        self.seed(queue, triangles, limits.cost.next_up());
        self.drain(queue, limits);
    }

    /// One fine queue over everything, to the exact count.
    fn exact(&mut self, target: u64) -> bool {
        self.mend_at_last(target);
        // What has been taken apart since may have left holes.
        self.close(false);
        let is_reached = self.drain_to(target);
        // Collapses take most of what meets with them; fillings of what is cut out may be too many triangles.
        self.excise();
        if self.state.surface.n_alive > target { self.drain_to(target) } else { is_reached }
    }

    fn drain_to(&mut self, target: u64) -> bool {
        self.is_held = false;
        if self.drained == 0.0 {
            // Costs that half of the edges do not reach rise fast in any mesh.
            self.drained = self.low_cost((0..self.n_blocks()).step_by(4), 0.5);
        }
        let mut queue = BucketQueue::new(5);
        while self.state.surface.n_alive > target && !self.interrupt.is_raised() {
            let before = self.state.surface.n_alive;
            queue.clear();
            self.seed(&mut queue, 0..self.state.surface.triangles.len(), f32::INFINITY);
            let limits = DrainLimits { cost: self.ceiling, triangles: target, may_stall: true };
            let freed_stuck = self.frees_stuck;
            let stalled = self.drain(&mut queue, limits);
            // What was refused may have become legal since; without any progress it has not.
            let is_stuck = stalled || self.state.surface.n_alive == before;
            if self.is_held || is_stuck && self.frees_stuck == freed_stuck && !self.free_stuck() {
                break;
            }
        }
        self.state.surface.n_alive <= target
    }
}

/// The cost that a share of them does not reach; no less than the least positive number.
fn quantile(mut costs: Vec<f32>, share: f64) -> f32 {
    if costs.is_empty() {
        return f32::MIN_POSITIVE;
    }
    let at = (costs.len() as f64 * share) as usize;
    costs.select_nth_unstable_by(at, f32::total_cmp).1.max(f32::MIN_POSITIVE)
}
