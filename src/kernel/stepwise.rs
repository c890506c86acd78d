//! A simplification that its owner drives from level to level, and may copy on the way.
//!
//! The pilot of a round looks ahead with it: it notes how a cell falls, keeps copies, and goes on from one of
//! them once the threshold is known, so that nothing is computed twice.

use crate::kernel::options::Options;
use crate::kernel::run::{finish, start};
use crate::kernel::schedule::driver::Driver;
use crate::kernel::simd::Simd;
use crate::kernel::statistics::{Simplified, Statistics};
use crate::mesh::Mesh;

/// A mesh on its way from one cost threshold to the next; as `simplify_mesh` with `Stop::Costs`.
///
/// The same thresholds in the same order give the same bytes, whatever was copied in between.
#[derive(Clone)]
pub struct Stepwise {
    driver: Driver,
    level_counts: Vec<u64>,
    keeps_relief: bool,
}

/// Memory of a copy for each triangle that is left: the surface is compact after a level to three quarters.
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
        let state = &self.driver.state;
        let surface = &state.surface;
        let channels = 4 * surface.n_channels as u64 * surface.vertices.len() as u64;
        // Attributes and wedges hold at most as much again for each vertex and corner.
        let more = if state.attributes.is_some() || state.wedges.is_some() { 4 } else { 1 };
        let probes = self.driver.probes.as_ref().map_or(0, |probes| probes.bytes());
        let tracker = self.driver.bound.as_ref().map_or(0, |tracker| tracker.bytes());
        let crossings = self.driver.crossings.as_ref().map_or(0, |crossings| crossings.bytes());
        let followed = self.driver.followed.as_ref().map_or(0, |followed| followed.bytes());
        let samples = self.driver.samples.as_ref().map_or(0, |samples| samples.bytes());
        more * (BYTES_PER_TRIANGLE * surface.triangles.len() as u64 + channels)
            + probes
            + tracker
            + crossings
            + followed
            + samples
    }

    /// Ends, with the mesh as it is.
    pub fn finish(self) -> Simplified {
        let statistics =
            Statistics { level_counts: self.level_counts, reached: true, ..Statistics::default() };
        finish(self.driver, statistics, self.keeps_relief)
    }
}
