//! Simplifications that their owner drives from level to level.
//!
//! The pilot of a round looks ahead with one that may be copied (`Stepwise`): it notes how a cell falls, keeps copies, and
//! goes on from one of them once the threshold is known, so that nothing is computed twice. An exact round takes
//! close levels one at a time (`CloseLevels`) until the total of all cells is met.

use crate::options::Options;
use crate::run::{finish, start};
use crate::schedule::driver::Driver;
use crate::schedule::queue::BucketQueue;
use crate::simd::Simd;
use crate::statistics::{Simplified, Statistics};
use stonecut_mesh::Mesh;

/// A mesh on its way from one cost threshold to the next; as `simplify_mesh` with `Stop::Costs`.
///
/// The same thresholds in the same order give the same bytes, whatever was copied in between.
#[derive(Clone)]
pub struct Stepwise {
    driver: Driver,
    level_counts: Vec<u64>,
    keeps_relief: bool,
}

/// Memory of a surface for each triangle that it has places for.
const BYTES_PER_TRIANGLE: u64 = 120;

impl Stepwise {
    /// Begins; `options.stop` is ignored. Panics as `simplify_mesh` does.
    pub fn new(mesh: Mesh, locked: &[bool], options: &Options) -> Self {
        let driver = start(mesh, locked, options, Options::round_goal, Simd::detect());
        Stepwise { driver, level_counts: Vec::new(), keeps_relief: options.keeps_relief }
    }

    /// Simplifies to a cost threshold in units^4; gives back how many triangles are left.
    pub fn level(&mut self, cost: f64) -> u64 {
        self.driver.level(cost);
        self.level_counts.push(self.n_triangles());
        self.n_triangles()
    }

    /// Triangles that are left.
    pub fn n_triangles(&self) -> u64 {
        self.driver.state.surface.n_alive
    }

    /// Memory of a copy in bytes, at most.
    pub fn copy_bytes(&self) -> u64 {
        bytes(&self.driver)
    }

    /// Ends, with the mesh as it is.
    pub fn finish(self) -> Simplified {
        let statistics =
            Statistics { level_counts: self.level_counts, reached: true, ..Statistics::default() };
        finish(self.driver, statistics, self.keeps_relief)
    }
}

/// A mesh on its way through close thresholds; as `simplify_mesh` with `Stop::CloseCosts` of those that it has taken.
pub struct CloseLevels {
    driver: Driver,
    /// `None` without thresholds.
    queue: Option<BucketQueue>,
    levels: Vec<f64>,
    level_counts: Vec<u64>,
    keeps_relief: bool,
}

impl CloseLevels {
    /// Begins a descent through ascending `levels`, in units^4; `options.stop` is ignored. Panics as `simplify_mesh` does.
    pub fn new(mesh: Mesh, locked: &[bool], options: &Options, levels: Vec<f64>) -> Self {
        let mut driver = start(mesh, locked, options, Options::round_goal, Simd::detect());
        let queue = levels.last().map(|&highest| driver.queue_for(highest));
        let keeps_relief = options.keeps_relief;
        CloseLevels { driver, queue, levels, level_counts: Vec::new(), keeps_relief }
    }

    /// Takes levels until it has taken `n_levels` of them, or all.
    pub fn take(&mut self, n_levels: usize) {
        let Some(queue) = &mut self.queue else { return };
        let n_levels = n_levels.min(self.levels.len());
        for &level in self.levels.get(self.level_counts.len()..n_levels).unwrap_or_default() {
            self.level_counts.push(self.driver.close_level(queue, level));
        }
    }

    /// Triangles after each of the levels that were taken.
    pub fn counts(&self) -> &[u64] {
        &self.level_counts
    }

    /// Memory in bytes, at most.
    pub fn bytes(&self) -> u64 {
        bytes(&self.driver) + self.queue.as_ref().map_or(0, BucketQueue::bytes)
    }

    /// Ends, with the mesh as it is.
    pub fn finish(mut self) -> Simplified {
        self.queue = None;
        let statistics =
            Statistics { level_counts: self.level_counts, reached: true, ..Statistics::default() };
        finish(self.driver, statistics, self.keeps_relief)
    }
}

/// Memory of a simplification on its way, in bytes, at most.
fn bytes(driver: &Driver) -> u64 {
    let surface = &driver.state.surface;
    let channels = 4 * surface.n_channels as u64 * surface.vertices.len() as u64;
    // Attributes and wedges hold at most as much again for each vertex and corner.
    let more =
        if driver.state.attributes.is_some() || driver.state.wedges.is_some() { 4 } else { 1 };
    let beside = [
        driver.probes.as_ref().map_or(0, |probes| probes.bytes()),
        driver.bound.as_ref().map_or(0, |tracker| tracker.bytes()),
        driver.crossings.as_ref().map_or(0, |crossings| crossings.bytes()),
        driver.followed.as_ref().map_or(0, |followed| followed.bytes()),
        driver.samples.as_ref().map_or(0, |samples| samples.bytes()),
    ];
    more * (BYTES_PER_TRIANGLE * surface.triangles.len() as u64 + channels)
        + beside.iter().sum::<u64>()
}
