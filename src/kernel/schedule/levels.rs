//! Which edges are collapsed in which order: levels of blocks first, then one exact queue.
//!
//! A level drains every block of a few thousand triangles to one common cost threshold before the next
//! block begins, so that a block's data stays in cache. Only the seeds are local: collapses reach
//! across, so there are no borders between blocks. The inner loop is in `drain`.
//!
//! docs/algorithm.md, section 5.

use std::ops::Range;

use crate::kernel::Topology;
use crate::kernel::collapse::Collapser;
use crate::kernel::collapse::legality::RejectCounts;
use crate::kernel::fit::samples::Samples;
use crate::kernel::quality::{Probes, QualityAt, STEP_ON_THE_WAY};
use crate::kernel::repair::clean::Cleaned;
use crate::kernel::repair::make_manifold::{self, Mended};
use crate::kernel::schedule::drain::{Drain, Limits, Seeds};
use crate::kernel::schedule::queue::{BucketQueue, Entry};
use crate::kernel::simd::Simd;
use crate::kernel::surface::validate::{validate, validate_small};
use crate::kernel::surface::{GONE, Surface};
use crate::kernel::topology::components::{Islands, Removal};

/// Triangles whose edges seed one queue.
const BLOCK: usize = 4 * 1024;
/// Every so many blocks is drained first to find a level's threshold.
const PILOT_STRIDE: usize = 16;
/// Meshes of fewer triangles have no levels.
const MIN_LEVEL_TRIANGLES: u64 = 8 * BLOCK as u64;
/// Of fewer, no further ones: what is left is few enough for the exact queue, which makes up to 1.4 % less
/// error.
const MIN_FURTHER_TRIANGLES: u64 = 24 * BLOCK as u64;
/// A level leaves about this share of the triangles.
const LEVEL_SHARE: f64 = 0.25;
/// Levels end at this multiple of the target; the exact queue does the rest.
const EXACT_MULTIPLE: f64 = 1.4;
/// The simplification under way.
#[derive(Clone)]
pub(crate) struct Driver {
    pub(crate) surface: Surface,
    pub(crate) simd: Simd,
    pub(crate) collapser: Collapser,
    pub(crate) rejects: RejectCounts,
    /// Refusals whose change of topology waits for its price.
    pub(crate) deferred: u64,
    /// Since the last time the stamps were set to zero; and before.
    pub(crate) collapses: u64,
    collapses_before: u64,
    /// Highest cost to which the whole mesh has been drained.
    pub(crate) drained: f32,
    pub(crate) topology: Topology,
    /// Input vertices that are gone, for the new vertices of a cut.
    pub(crate) spare_sources: Vec<u32>,
    pub(crate) changes: TopologyChanges,
    /// How far specks are from the rest; found when the first one is about to vanish.
    pub(crate) islands: Option<Islands>,
    /// What the result will be fitted to.
    pub(crate) samples: Option<Samples>,
    /// What the quality of the result is estimated from.
    pub(crate) probes: Option<Probes>,
    /// That estimate after each level on the way to a count.
    pub(crate) curve: Vec<QualityAt>,
}

/// Changes of topology that were made.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct TopologyChanges {
    pub(crate) specks: u64,
    pub(crate) cuts: u64,
    /// Ends of tubes that a cut stripped off.
    pub(crate) stripped: u64,
    /// Squared error of removed components, integrated over their area, in units^4.
    pub(crate) removed_error: f64,
    /// Vertices joined with others in the same place, and taken apart; duplicate triangles dropped.
    pub(crate) joined: u64,
    pub(crate) split: u64,
    pub(crate) duplicates: u64,
    /// Triangles without area that were dropped or flipped away.
    flat: u64,
    /// Pairs of boundary vertices that met.
    approached: u64,
    /// Vertices that wait for a source to be taken apart.
    missing: u64,
    may_mend: bool,
}

impl TopologyChanges {
    /// Names and counts, always all of them.
    pub(crate) fn named(&self) -> Vec<(&'static str, u64)> {
        vec![
            ("small_components_removed", self.specks),
            ("handles_cut", self.cuts),
            ("ends_stripped", self.stripped),
            ("vertices_welded", self.joined),
            ("vertices_split", self.split),
            ("duplicate_triangles_removed", self.duplicates),
            ("degenerate_triangles_removed", self.flat),
            ("boundary_pairs_merged", self.approached),
        ]
    }

    /// Counts a removed component; `unscale` brings lengths back to input units.
    pub(crate) fn removed(&mut self, removal: Removal, unscale: f64) {
        self.specks += 1;
        self.removed_error += removal.own_error * unscale.powi(4);
    }

    pub(crate) fn add_cleaned(&mut self, cleaned: Cleaned, approached: u64) {
        self.duplicates += cleaned.duplicates;
        self.flat += cleaned.flat;
        self.approached += approached;
    }

    fn add(&mut self, done: Mended) {
        self.joined += done.joined;
        self.split += done.split;
        self.duplicates += done.duplicates;
        self.missing = done.missing;
        self.may_mend = done.missing > 0;
    }
}

impl Driver {
    pub(crate) fn new(surface: Surface, simd: Simd, topology: Topology) -> Self {
        Driver {
            surface,
            simd,
            collapser: Collapser::new(topology == Topology::Error),
            rejects: RejectCounts::default(),
            deferred: 0,
            collapses: 0,
            collapses_before: 0,
            drained: 0.0,
            topology,
            spare_sources: Vec::new(),
            changes: TopologyChanges { may_mend: true, ..TopologyChanges::default() },
            islands: None,
            samples: None,
            probes: None,
            curve: Vec::new(),
        }
    }

    pub(crate) fn total_collapses(&self) -> u64 {
        self.collapses + self.collapses_before
    }

    /// Scaled cost of a threshold in units^4; what is beyond f32 is its largest number.
    fn scaled(&self, level: f64) -> f32 {
        (level * self.surface.scale.powi(4)).min(f64::from(f32::MAX)) as f32
    }

    /// Drains the whole mesh to one threshold, block by block.
    pub(crate) fn level(&mut self, level: f64) {
        let limits = Limits { cost: self.scaled(level), triangles: 0, may_stall: false };
        let mut queue = BucketQueue::new(3);
        self.mend();
        for block in 0..self.n_blocks() {
            self.drain_block(&mut queue, block, limits);
        }
        self.tidy();
    }

    /// Drains the whole mesh from one queue to ascending thresholds that lie close together; gives back how
    /// many triangles were left after each. Thresholds are rounded up to 1/32 of an octave.
    pub(crate) fn close_levels(&mut self, levels: &[f64]) -> Vec<u64> {
        let Some(&highest) = levels.last() else { return Vec::new() };
        let mut queue = BucketQueue::new(5);
        let limits = Limits { cost: f32::MAX, triangles: 0, may_stall: false };
        let highest = queue.bucket(self.scaled(highest));
        let below = queue.lowest_cost(highest + 1);
        self.seed(&mut queue, 0..self.surface.triangles.len(), below);
        let mut counts = Vec::new();
        for &level in levels {
            queue.close_above(self.scaled(level));
            self.drain(&mut queue, limits);
            counts.push(self.surface.n_alive);
        }
        counts
    }

    /// Simplifies to at most `target` triangles; false if nothing legal is left before.
    pub(crate) fn reach(&mut self, target: u64) -> bool {
        let enough = (target as f64 * EXACT_MULTIPLE) as u64;
        let mut least = MIN_LEVEL_TRIANGLES;
        while self.surface.n_alive > enough.max(least) {
            least = MIN_FURTHER_TRIANGLES;
            let before = self.surface.n_alive;
            self.free_level(enough, target);
            self.note_quality();
            self.tidy();
            self.mend();
            if self.surface.n_alive as f64 > before as f64 * 0.97 {
                break;
            }
        }
        self.exact(target)
    }

    fn note_quality(&mut self) {
        if let Some(probes) = &mut self.probes {
            let removed_error = self.changes.removed_error;
            let quality = probes.sum_up(&self.surface, removed_error, STEP_ON_THE_WAY);
            self.curve.push(QualityAt { triangles: self.surface.n_alive, quality });
        }
    }

    fn n_blocks(&self) -> usize {
        self.surface.triangles.len().div_ceil(BLOCK)
    }

    /// Makes the surface manifold as far as sources for new vertices are at hand; see `make_manifold`.
    pub(crate) fn mend(&mut self) {
        // The wedges of a seam belong to one vertex each, which must not be taken apart.
        let is_plain = self.surface.wedges.is_none();
        if self.topology == Topology::Error && self.changes.may_mend && is_plain {
            if let Some(samples) = &mut self.samples {
                samples.follow(&self.surface.rings);
            }
            if let Some(probes) = &mut self.probes {
                probes.follow(&self.surface.rings);
            }
            let done = make_manifold::mend(&mut self.surface, &mut self.spare_sources, self.simd);
            validate(&self.surface);
            if let Some(place) = &done.rebuilt {
                self.renumber(place);
                self.collapses_before += std::mem::take(&mut self.collapses);
            }
            self.islands = None;
            self.changes.add(done);
        }
    }

    /// The same, with sources from a few collapses if there are too few.
    fn mend_at_last(&mut self, target: u64) {
        let missing = self.changes.missing;
        if self.topology == Topology::Error && missing > 0 {
            if missing > self.spare_sources.len() as u64 {
                let few = self.surface.n_alive.saturating_sub(2 * missing + 2);
                self.drain_to(few.max(target));
            }
            self.mend();
        }
    }

    /// Takes over new numbers of the vertices.
    fn renumber(&mut self, place: &[u32]) {
        self.islands = None;
        if let Some(samples) = &mut self.samples {
            samples.renumber(place, self.surface.n_alive, self.surface.vertices.len());
        }
        if let Some(probes) = &mut self.probes {
            probes.renumber(place);
        }
    }

    fn tidy(&mut self) {
        validate(&self.surface);
        if (self.surface.n_alive as f64) < 0.75 * self.surface.triangles.len() as f64 {
            if let Some(samples) = &mut self.samples {
                samples.follow(&self.surface.rings);
            }
            if let Some(probes) = &mut self.probes {
                probes.follow(&self.surface.rings);
            }
            let place = self.surface.compact(self.simd);
            self.renumber(&place);
            self.collapses_before += std::mem::take(&mut self.collapses);
        }
    }

    /// One level whose threshold comes from a sample of the blocks.
    fn free_level(&mut self, enough: u64, target: u64) {
        let n_blocks = self.n_blocks();
        let share = (enough as f64 / self.surface.n_alive as f64).max(LEVEL_SHARE);
        let pilot = || (0..n_blocks).step_by(PILOT_STRIDE);
        let count = |driver: &Self| -> usize {
            let blocks = pilot().flat_map(|block| &driver.surface.triangles[driver.block(block)]);
            blocks.filter(|t| t[0] != GONE).count()
        };
        let wanted = (count(self) as f64 * share) as usize;
        let mut queue = BucketQueue::new(3);
        let mut costs = Vec::new();
        for block in pilot() {
            self.each_edge(self.block(block), f32::INFINITY, |v0, v1, cost| {
                queue.push(queue.bucket(cost), Entry { v0, v1, failures: 0 });
                costs.push(cost);
            });
        }
        let mut cost = quantile(costs, (1.0 - share) * 0.6);
        let mut limits = Limits { cost: f32::MAX, triangles: target, may_stall: false };
        for _ in 0..200 {
            queue.close_above(cost);
            self.drain(&mut queue, limits);
            if count(self) <= wanted {
                break;
            }
            cost *= std::f32::consts::SQRT_2;
        }
        limits.cost = queue.highest_cost();
        for block in (0..n_blocks).filter(|block| block % PILOT_STRIDE != 0) {
            self.drain_block(&mut queue, block, limits);
        }
        self.drained = limits.cost;
    }

    fn block(&self, block: usize) -> Range<usize> {
        block * BLOCK..((block + 1) * BLOCK).min(self.surface.triangles.len())
    }

    /// The cost that a share of the edges of some blocks does not reach.
    fn low_cost(&self, blocks: impl Iterator<Item = usize>, share: f64) -> f32 {
        let mut costs = Vec::new();
        for block in blocks {
            self.each_edge(self.block(block), f32::INFINITY, |_, _, cost| costs.push(cost));
        }
        quantile(costs, share)
    }

    /// Evaluates the edges of some triangles, each once, and hands those that classes allow and that cost less
    /// than `below` to `take`.
    fn each_edge(&self, triangles: Range<usize>, below: f32, take: impl FnMut(u32, u32, f32)) {
        self.simd.run(Seeds { surface: &self.surface, triangles, below, take });
    }

    /// Puts the edges of some triangles that cost less than `below` into the queue.
    fn seed(&self, queue: &mut BucketQueue, triangles: Range<usize>, below: f32) {
        self.each_edge(triangles, below, |v0, v1, cost| {
            queue.push(queue.bucket(cost), Entry { v0, v1, failures: 0 });
        });
    }

    fn drain(&mut self, queue: &mut BucketQueue, limits: Limits) -> bool {
        let simd = self.simd;
        let stalled = simd.run(Drain { driver: self, queue, limits });
        validate_small(&self.surface);
        stalled
    }

    fn drain_block(&mut self, queue: &mut BucketQueue, block: usize, limits: Limits) {
        queue.clear();
        self.seed(queue, self.block(block), limits.cost.next_up());
        self.drain(queue, limits);
    }

    /// One fine queue over everything, to the exact count.
    fn exact(&mut self, target: u64) -> bool {
        self.mend_at_last(target);
        self.drain_to(target)
    }

    fn drain_to(&mut self, target: u64) -> bool {
        if self.drained == 0.0 {
            // Costs that half of the edges do not reach rise fast in any mesh.
            self.drained = self.low_cost((0..self.n_blocks()).step_by(4), 0.5);
        }
        let mut queue = BucketQueue::new(5);
        while self.surface.n_alive > target {
            let before = self.surface.n_alive;
            queue.clear();
            self.seed(&mut queue, 0..self.surface.triangles.len(), f32::INFINITY);
            let limits = Limits { cost: f32::MAX, triangles: target, may_stall: true };
            let stalled = self.drain(&mut queue, limits);
            // What was refused may have become legal since; without any progress it has not.
            if stalled || self.surface.n_alive == before {
                return self.surface.n_alive <= target;
            }
        }
        true
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
