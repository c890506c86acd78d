//! Changes of topology during a drain: made once they cost no more than the collapses of that moment.
//!
//! `topology` decides which changes are allowed, and their price.

use crate::earlier::DoneChange;
use crate::options::Topology;
use crate::schedule::driver::{DrainLimits, Driver};
use crate::schedule::queue::{BucketQueue, Entry};
use crate::state::validate::validate_small;
use crate::surface::Surface;
use crate::topology::components::{SmallComponents, cost_of_distance, whole_area};
use crate::topology::cut::cut;
use crate::topology::{self, CutPlan, TopologyChange};

/// A component of more than this share of the area does not go before those on which collapses are stuck.
/// Scans that come down to a count that they can bear lose nothing so large: of the legion of honor (1,298 components) the
/// first one goes at 1,711 of 687,711 triangles.
const LARGE_SHARE: f64 = 1.0 / 256.0;

impl Driver {
    /// Returns whether components on which collapses are stuck may be freed from now on.
    ///
    /// Steps that are recorded are of few triangles each, and within a bound components vanish after the collapses.
    fn may_free_stuck(&self) -> bool {
        let is_free = self.topology == Topology::Error && self.bound.is_none();
        is_free && self.history.is_none() && !self.frees_stuck
    }

    /// Lets components vanish whole on which collapses are stuck; false if that is so already or must not be.
    pub(super) fn free_stuck(&mut self) -> bool {
        let begins = self.may_free_stuck();
        if begins {
            self.frees_stuck = true;
            self.small_components = Some(SmallComponents::by_area(&self.state.surface));
        }
        begins
    }

    /// Changes the topology where a collapse was refused for its sake, once that costs no more than
    /// collapses do.
    pub(super) fn apply_change(
        &mut self,
        queue: &mut BucketQueue,
        (bucket, entry): (u32, Entry),
        limits: DrainLimits,
    ) {
        let may_vanish = self
            .small_components
            .as_ref()
            .is_none_or(|small_components| small_components.is_small(entry.v0));
        let ends = (entry.v0, entry.v1);
        let most = if self.frees_stuck { topology::MAX_STUCK } else { topology::MAX_SPECK };
        // Within a bound components vanish after all collapses, and only where others stand in for them.
        let most = if may_vanish && self.bound.is_none() { most } else { 0 };
        let find_change = topology::find_change(&self.state.surface, ends, &self.collapser, most);
        match find_change {
            Some(TopologyChange::Vanish(triangles)) => {
                self.remove_component(queue, (bucket, entry), limits, &triangles);
            }
            Some(TopologyChange::Cut(cycle)) => self.cut(queue, (bucket, entry), limits, cycle),
            _ => {}
        }
    }

    fn remove_component(
        &mut self,
        queue: &mut BucketQueue,
        (bucket, entry): (u32, Entry),
        limits: DrainLimits,
        triangles: &[u32],
    ) {
        let may_free_stuck = limits.may_stall && self.may_free_stuck();
        let surface = &self.state.surface;
        let small_components =
            self.small_components.get_or_insert_with(|| match self.frees_stuck {
                true => SmallComponents::by_area(surface),
                false => SmallComponents::new(surface),
            });
        // Stuck components are large, so one may pass the target. Its price is for what it takes to get there.
        let n_wanted = surface.n_alive.saturating_sub(limits.triangles).max(1) as usize;
        let is_large = triangles.len() > topology::MAX_SPECK;
        let may_pass = self.history.is_some() || (self.frees_stuck && is_large);
        let n_paid = if self.frees_stuck { triangles.len().min(n_wanted) } else { triangles.len() };
        let limit = topology::error_worth(limits.cost, n_paid);
        let Some(removal) = small_components.removal(&self.state.surface, triangles, limit) else {
            return;
        };
        let cost = topology::price(removal.error, n_paid);
        let hold = small_components.hold_cost(&self.state.surface, removal, triangles.len());
        let is_due = is_due(queue, (bucket, entry), cost.max(hold), limits, &mut self.deferred);
        if is_due && may_free_stuck && small_components.share(removal) > LARGE_SHARE {
            self.free_stuck();
            return;
        }
        if is_due && leaves_enough(&self.state.surface, triangles.len(), limits, may_pass) {
            if let Some(history) = &mut self.history {
                history.vanishes(&self.state.surface, triangles);
            }
            topology::vanish(&mut self.state.surface, triangles);
            small_components.removed(removal, triangles.len());
            self.changes.removed(removal, self.state.surface.unscale);
            self.collapses += 1;
            validate_small(&self.state);
        }
    }

    fn cut(
        &mut self,
        queue: &mut BucketQueue,
        (bucket, entry): (u32, Entry),
        limits: DrainLimits,
        cycle: [u32; 3],
    ) {
        // What a cut separates takes a search: not before it can be due.
        let least = topology::least_cut_cost(&self.state.surface, cycle);
        if !is_due(queue, (bucket, entry), least, limits, &mut self.deferred) {
            return;
        }
        let Some(plan) = topology::plan_cut(&self.state.surface, cycle) else { return };
        let (cost, n_freed) = match &plan {
            CutPlan::Handle(cost, _) => (*cost, 0),
            CutPlan::Strip(triangles, cost, farthest_sq) => {
                (cost.max(self.hold_of_strip(*farthest_sq)), triangles.len() - 1)
            }
        };
        let is_due = is_due(queue, (bucket, entry), cost, limits, &mut self.deferred);
        let may_pass = self.history.is_some();
        if !is_due || !leaves_enough(&self.state.surface, n_freed, limits, may_pass) {
            return;
        }
        let strip = match plan {
            CutPlan::Handle(_, sides) => {
                if !topology::opens_handle(&self.state.surface, cycle, &sides) {
                    return;
                }
                None
            }
            CutPlan::Strip(triangles, ..) => Some(triangles),
        };
        let Some([a, b, c]) = self.carry_out_cut(cycle, strip) else { return };
        queue.push(bucket, entry);
        for (v0, v1) in [(a, b), (b, c), (c, a)] {
            queue.push(bucket, Entry { v0, v1, failures: 0 });
        }
    }

    /// Cuts a handle as an earlier run did, whatever that costs; gives back the new vertices.
    pub(super) fn cut_again(&mut self, cycle: [u32; 3]) -> Option<[u32; 3]> {
        let surface = &self.state.surface;
        match topology::plan_cut(surface, cycle)? {
            CutPlan::Handle(_, sides) if topology::opens_handle(surface, cycle, &sides) => {
                self.carry_out_cut(cycle, None)
            }
            _ => None,
        }
    }

    /// Cuts, and removes the `strip` that is separated by that. Gives back the new vertices, if they stay.
    fn carry_out_cut(&mut self, cycle: [u32; 3], strip: Option<Vec<u32>>) -> Option<[u32; 3]> {
        if let Some(tracker) = &mut self.bound
            && (strip.is_some() || !tracker.admits_cap(&self.state.surface, cycle))
        {
            return None;
        }
        if let Some(crossings) = &mut self.crossings {
            let gone = strip.as_deref().unwrap_or(&[]);
            if !crossings.admits_triangle(&self.state.surface, cycle, gone) {
                return None;
            }
        }
        let number = (self.collapses + 1) as u32;
        let spare = &mut self.spare_sources;
        let new = cut(&mut self.state, cycle, spare, number, self.simd)?;
        self.collapses += 1;
        validate_small(&self.state);
        if let Some(crossings) = &mut self.crossings {
            crossings.extend(&self.state.surface);
        }
        if let Some(tracker) = &mut self.bound {
            tracker.add_caps(&self.state.surface);
        }
        if let Some(triangles) = strip {
            self.strip(&triangles, cycle, new);
            self.changes.stripped += 1;
            return None;
        }
        if let Some(history) = &mut self.history {
            history.cut(&self.state.surface, cycle, new, &[]);
        }
        self.changes.cuts += 1;
        if let Some(done) = &mut self.done {
            let source = &self.state.surface.source;
            let sources = |of: [u32; 3]| of.map(|v| source[v as usize]);
            done.push(DoneChange::Cut(sources(cycle), sources(new)));
        }
        Some(new)
    }

    /// The least cost at which the end of a strip may go that is as far from the cut, in scaled units.
    ///
    /// A spike has hardly an area, so for its error it could go at once. Collapses see to it that it becomes short first,
    /// unless they are refused because its sides meet: only then it is held.
    fn hold_of_strip(&mut self, farthest_sq: f64) -> f32 {
        if self.crossings.is_none() {
            return 0.0;
        }
        let surface = &self.state.surface;
        let area = *self.area.get_or_insert_with(|| whole_area(surface));
        cost_of_distance(area, surface, farthest_sq)
    }

    /// Removes what a cut has separated: those triangles and the cap on their side.
    fn strip(&mut self, triangles: &[u32], cycle: [u32; 3], new: [u32; 3]) {
        // The new corners took over one side of the cut.
        let has_new =
            |&t: &u32| self.state.surface.triangles[t as usize].iter().any(|v| new.contains(v));
        let cap_of = if triangles.iter().any(has_new) { new } else { cycle };
        let n = self.state.surface.triangles.len() as u32;
        let cap = [n - 2, n - 1]
            .into_iter()
            .find(|&t| self.state.surface.triangles[t as usize].iter().all(|v| cap_of.contains(v)));
        let mut gone = triangles.to_vec();
        gone.extend(cap);
        if let Some(history) = &mut self.history {
            history.cut(&self.state.surface, cycle, new, &gone);
        }
        topology::vanish(&mut self.state.surface, &gone);
        validate_small(&self.state);
    }
}

/// Returns whether `n_freed` triangles can go without passing the target. Where steps are recorded they `may_pass` it: what is
/// done must not depend on the target then.
fn leaves_enough(surface: &Surface, n_freed: usize, limits: DrainLimits, may_pass: bool) -> bool {
    may_pass || surface.n_alive + 2 >= limits.triangles + n_freed as u64
}

/// Returns whether a change of this cost may be made now; if not, but within the limit, its entry waits for that cost
/// and is counted in `deferred`.
fn is_due(
    queue: &mut BucketQueue,
    (bucket, entry): (u32, Entry),
    cost: f32,
    limits: DrainLimits,
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
