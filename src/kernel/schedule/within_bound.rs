//! As far down as a bound on the error allows: levels of rising cost until nearly all is refused, then queues over
//! everything.

use crate::earlier::DoneChange;
use crate::options::Topology;
use crate::schedule::driver::{DrainLimits, Driver};
use crate::schedule::levels::{BLOCK, MIN_LEVEL_TRIANGLES, PILOT_STRIDE};
use crate::schedule::queue::BucketQueue;
use crate::state::validate::validate;
use crate::topology;
use crate::topology::components::components;
use crate::vertex::GONE;
use std::ops::Range;

/// The first level has the cost that this share of the edges does not reach.
const FIRST_SHARE: f64 = 0.25;
/// Each level has this many times the cost of the one before.
const STEP: f32 = 4.0;
/// Levels end where more than this share of the triangles is left after one.
const PROGRESS: f64 = 0.98;
/// The same for queues over everything: on scans a second one takes 0 to 0.4 % of the triangles (docs/results/bound.md).
const QUEUE_PROGRESS: f64 = 0.9;

/// Blocks of triangles whose edges seed one queue. They begin with the same triangles after a compaction, however many
/// triangles are gone in other blocks: what is done at one place does not depend on what is done elsewhere, and another
/// run, tighter there, does the same here.
struct Blocks {
    /// The first triangle of each.
    starts: Vec<usize>,
}

impl Blocks {
    fn of(n_triangles: usize) -> Blocks {
        Blocks { starts: (0..n_triangles.max(1)).step_by(BLOCK).collect() }
    }

    /// The triangles of each; what was added is in the last.
    fn ranges(&self, n_triangles: usize) -> Vec<Range<usize>> {
        let ends = self.starts.iter().skip(1).copied().chain(std::iter::once(n_triangles));
        self.starts.iter().zip(ends).map(|(&start, end)| start..end).collect()
    }

    /// The same once the triangles that are gone are dropped; blocks that have become small are joined.
    fn compacted(&self, triangles: &[[u32; 3]]) -> Blocks {
        let mut n = 0;
        let mut starts = Vec::with_capacity(self.starts.len());
        for range in self.ranges(triangles.len()) {
            starts.push(n);
            n += triangles[range].iter().filter(|t| t[0] != GONE).count();
        }
        while starts.len() > 1 && n / starts.len() < BLOCK / 2 {
            starts = starts.into_iter().step_by(2).collect();
        }
        Blocks { starts }
    }
}

impl Driver {
    /// Simplifies within the bound to at most `target` triangles; false if the bound ends it before.
    pub(crate) fn reach_within_bound(&mut self, target: u64) -> bool {
        let mut cost = self.low_cost((0..self.n_blocks()).step_by(PILOT_STRIDE), FIRST_SHARE);
        let mut queue = BucketQueue::new(3);
        let mut blocks = Blocks::of(self.state.surface.triangles.len());
        while self.state.surface.n_alive > target.max(MIN_LEVEL_TRIANGLES) && cost < f32::MAX {
            let before = self.state.surface.n_alive;
            let limits = DrainLimits { cost, triangles: target, may_stall: false };
            for block in blocks.ranges(self.state.surface.triangles.len()) {
                self.drain_range(&mut queue, block, limits);
            }
            self.note_quality();
            let n_triangles = self.state.surface.triangles.len();
            let compacted = blocks.compacted(&self.state.surface.triangles);
            self.tidy();
            if self.state.surface.triangles.len() < n_triangles {
                blocks = compacted;
            }
            let is_over = self.state.surface.n_alive as f64 > before as f64 * PROGRESS;
            if is_over || self.interrupt.is_raised() {
                break;
            }
            cost *= STEP;
        }
        self.vanish_within_bound(target);
        self.done.iter_mut().for_each(|done| done.push(DoneChange::Vanish));
        let mut queue = BucketQueue::new(5);
        while self.state.surface.n_alive > target {
            let before = self.state.surface.n_alive;
            queue.clear();
            self.seed(&mut queue, 0..self.state.surface.triangles.len(), f32::INFINITY);
            let limits = DrainLimits { cost: f32::MAX, triangles: target, may_stall: false };
            self.drain(&mut queue, limits);
            let is_over = self.state.surface.n_alive as f64 > before as f64 * QUEUE_PROGRESS;
            if is_over || self.interrupt.is_raised() {
                break;
            }
            self.tidy();
        }
        self.vanish_within_bound(target);
        self.state.surface.n_alive <= target
    }

    /// Removes small components that others stand in for.
    pub(super) fn vanish_within_bound(&mut self, target: u64) {
        let may_vanish = self.topology == Topology::Error && self.history.is_none();
        if let Some(tracker) = self.bound.as_mut().filter(|_| may_vanish) {
            let surface = &mut self.state.surface;
            let root = components(surface);
            let until = (target, &self.interrupt);
            let vanished = tracker.vanish(surface, root, until, topology::vanish);
            self.changes.specks += vanished.components;
            self.changes.removed_error += vanished.error;
            validate(&self.state);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_begin_with_the_same_triangles_whatever_is_gone_elsewhere() {
        let n = 10 * BLOCK + 7;
        // Numbers of the triangles tell them apart; in the first block, more or fewer are gone.
        let left = |step: usize| -> Vec<[u32; 3]> {
            let is_gone = |t: usize| if t < BLOCK { !t.is_multiple_of(step) } else { t % 2 == 1 };
            let corner = |t: usize| if is_gone(t) { GONE } else { t as u32 };
            (0..n).map(|t| [corner(t); 3]).collect()
        };
        let first_of_blocks = |mut triangles: Vec<[u32; 3]>| -> Vec<u32> {
            let blocks = Blocks::of(n);
            assert_eq!(blocks.ranges(n).len(), 11);
            let blocks = blocks.compacted(&triangles);
            triangles.retain(|t| t[0] != GONE);
            let ranges = blocks.ranges(triangles.len());
            assert_eq!(ranges.last().map(|range| range.end), Some(triangles.len()));
            ranges.iter().map(|range| triangles[range.start][0]).collect()
        };
        let even = first_of_blocks(left(2));
        assert_eq!(even, first_of_blocks(left(3)));
        assert_eq!(even.len(), 6);
    }
}
