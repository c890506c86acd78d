//! As far down as a bound on the error allows: levels of rising cost until nearly all is refused, then queues over
//! everything.

use crate::kernel::options::Topology;
use crate::kernel::schedule::driver::{Driver, Limits};
use crate::kernel::schedule::levels::{MIN_LEVEL_TRIANGLES, PILOT_STRIDE};
use crate::kernel::schedule::queue::BucketQueue;
use crate::kernel::state::validate::validate;
use crate::kernel::topology;
use crate::kernel::topology::components::components;

/// The first level has the cost that this share of the edges does not reach.
const FIRST_SHARE: f64 = 0.25;
/// Each level has this many times the cost of the one before.
const STEP: f32 = 4.0;
/// Levels end where more than this share of the triangles is left after one.
const PROGRESS: f64 = 0.98;

impl Driver {
    /// Simplifies within the bound to at most `target` triangles; false if the bound ends it before.
    pub(crate) fn reach_within_bound(&mut self, target: u64) -> bool {
        let mut cost = self.low_cost((0..self.n_blocks()).step_by(PILOT_STRIDE), FIRST_SHARE);
        let mut queue = BucketQueue::new(3);
        while self.state.surface.n_alive > target.max(MIN_LEVEL_TRIANGLES) && cost < f32::MAX {
            let before = self.state.surface.n_alive;
            let limits = Limits { cost, triangles: target, may_stall: false };
            for block in 0..self.n_blocks() {
                self.drain_block(&mut queue, block, limits);
            }
            self.note_quality();
            self.tidy();
            let is_over = self.state.surface.n_alive as f64 > before as f64 * PROGRESS;
            if is_over || self.interrupt.is_raised() {
                break;
            }
            cost *= STEP;
        }
        self.vanish_within_bound(target);
        let mut queue = BucketQueue::new(5);
        while self.state.surface.n_alive > target {
            let before = self.state.surface.n_alive;
            queue.clear();
            self.seed(&mut queue, 0..self.state.surface.triangles.len(), f32::INFINITY);
            let limits = Limits { cost: f32::MAX, triangles: target, may_stall: false };
            self.drain(&mut queue, limits);
            let is_over = self.state.surface.n_alive as f64 > before as f64 * PROGRESS;
            if is_over || self.interrupt.is_raised() {
                break;
            }
            self.tidy();
        }
        self.vanish_within_bound(target);
        self.state.surface.n_alive <= target
    }

    /// Removes small components that others stand in for.
    fn vanish_within_bound(&mut self, target: u64) {
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
