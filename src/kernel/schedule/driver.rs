//! The simplification under way: the surface, and all that is kept from one collapse to the next.
//!
//! `levels`, `drain` and `topology_changes` work on it.

use crate::bound::tracker::Tracker;
use crate::collapse::collapser::Collapser;
use crate::collapse::legality::RejectCounts;
use crate::crossing::Crossings;
use crate::earlier::DoneChange;
use crate::fit::samples::Samples;
use crate::followed::Followed;
use crate::history::History;
use crate::interrupt::Interrupt;
use crate::options::Topology;
use crate::quality::{Probes, QualityAt};
use crate::repair::clean::Cleaned;
use crate::repair::close::crumbs::drop_crumbs;
use crate::repair::close::excise::{CutVolume, Excised, cut_corners, excise};
use crate::repair::close::{self, FilledHoles, OpenHoles};
use crate::repair::make_manifold::{self, Mended};
use crate::simd::Simd;
use crate::state::MeshState;
use crate::state::validate::validate;
use crate::surface::Ring;
use crate::surface::class::Class;
use crate::topology::components::{Removal, SmallComponents};

/// Attempts at leaving no hole, no vertex of several fans and no two vertices in one place.
const MOST_ROUNDS: usize = 3;

/// The simplification under way.
#[derive(Clone)]
pub(crate) struct Driver {
    pub(crate) state: MeshState,
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
    /// Highest cost of a collapse on the way to a count, in scaled units.
    pub(super) ceiling: f32,
    pub(crate) topology: Topology,
    /// Input vertices that are gone, for the new vertices of a cut.
    pub(crate) spare_sources: Vec<u32>,
    pub(crate) changes: TopologyChanges,
    /// Distances of small components from the rest; computed when the first one is about to vanish.
    pub(crate) small_components: Option<SmallComponents>,
    /// Area of the surface, in scaled units; computed when the first end of a strip is about to vanish.
    pub(super) area: Option<f64>,
    /// True once a large component would vanish, or nothing goes on: from then on components on which collapses are stuck
    /// may vanish whole, however many triangles they have.
    pub(super) frees_stuck: bool,
    /// True once most edges that are left are held where sheets meet: nothing more collapses then.
    pub(super) is_held: bool,
    /// Keeps the surface near the original, where that was asked for.
    pub(crate) bound: Option<Box<Tracker>>,
    /// Keeps the surface from passing through itself, where that was asked for.
    pub(crate) crossings: Option<Box<Crossings>>,
    /// True if places are rounded to floats at the end: these are coarse here.
    pub(crate) settles: bool,
    /// Volume that cuts have changed.
    cut_volume: Option<CutVolume>,
    /// Size of the holes that are filled; 0: none.
    pub(crate) close_size: f64,
    /// Size of the closed components of a few triangles that are dropped; 0: none.
    pub(crate) crumb_size: f64,
    /// The channel that takes how far the result is from the original.
    pub(crate) reach_channel: Option<usize>,
    /// Samples that the result will be fitted to.
    pub(crate) samples: Option<Samples>,
    /// Probes that the quality of the result is estimated from.
    pub(crate) probes: Option<Probes>,
    /// Volume of the input, if it is closed and the quality is estimated.
    pub(crate) volume: Option<f64>,
    /// Present places of the vertices of the input, if they are asked for.
    pub(crate) followed: Option<Followed>,
    /// Every step, if they are recorded.
    pub(crate) history: Option<Box<History>>,
    /// All changes, if later runs are to repeat them.
    pub(crate) done: Option<Vec<DoneChange>>,
    /// Estimates of the quality after each level on the way to a count.
    pub(crate) curve: Vec<QualityAt>,
    /// Ends the work early, as if nothing legal were left.
    pub(crate) interrupt: Interrupt,
}

/// Limits at which a drain ends.
#[derive(Clone, Copy)]
pub(crate) struct DrainLimits {
    /// Highest cost, in scaled units.
    pub(crate) cost: f32,
    /// Number of triangles at which to stop at once.
    pub(crate) triangles: u64,
    /// True if to give up when hardly anything is legal; only where the whole mesh is in the queue.
    pub(crate) may_stall: bool,
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
    /// Triangles that were turned over to agree with their neighbours.
    pub(crate) turned: u64,
    /// Triangles whose sides disagree with neighbours whatever is turned, where that was asked for.
    pub(crate) one_sided: Option<u64>,
    /// Holes that were filled, and those that are open, where that was asked for.
    filled: Option<(FilledHoles, OpenHoles)>,
    /// Places that were cut out and closed, where holes are filled and nothing may pass through itself.
    excised: Option<Excised>,
    /// Closed components of a few triangles that were dropped, and their triangles.
    crumbs: Option<(u64, u64)>,
    /// Vertices that wait for a source to be taken apart.
    pub(super) missing: u64,
    may_mend: bool,
}

impl TopologyChanges {
    /// Names and counts: always all of them, and those of what was asked for. What is left is that of the end.
    pub(crate) fn named(&self) -> Vec<(&'static str, u64)> {
        let mut named = vec![
            ("small_components_removed", self.specks),
            ("handles_cut", self.cuts),
            ("ends_stripped", self.stripped),
            ("vertices_welded", self.joined),
            ("vertices_split", self.split),
            ("duplicate_triangles_removed", self.duplicates),
            ("degenerate_triangles_removed", self.flat),
            ("boundary_pairs_merged", self.approached),
            ("triangles_turned", self.turned),
        ];
        if let Some((filled, open)) = self.filled {
            named.extend([
                ("holes_filled", filled.holes),
                ("hole_triangles_added", filled.triangles),
                ("holes_left", open.holes),
                ("holes_left_large", open.large),
                ("holes_left_parts", open.parts),
            ]);
        }
        if let Some(excised) = self.excised {
            named.extend([
                ("crossing_pairs_cut_out", excised.pairs),
                ("holes_cut_out", excised.holes),
                ("triangles_cut_out", excised.triangles),
            ]);
        }
        if let Some((crumbs, triangles)) = self.crumbs {
            named.extend([("crumbs_removed", crumbs), ("crumb_triangles_removed", triangles)]);
        }
        named.extend(self.one_sided.map(|n| ("components_left_one_sided", n)));
        named
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
    pub(crate) fn new(state: MeshState, simd: Simd, topology: Topology) -> Self {
        Driver {
            state,
            simd,
            collapser: Collapser::new(topology == Topology::Error),
            rejects: RejectCounts::default(),
            deferred: 0,
            collapses: 0,
            collapses_before: 0,
            drained: 0.0,
            ceiling: f32::MAX,
            topology,
            spare_sources: Vec::new(),
            changes: TopologyChanges { may_mend: true, ..TopologyChanges::default() },
            small_components: None,
            area: None,
            frees_stuck: false,
            is_held: false,
            bound: None,
            crossings: None,
            settles: false,
            cut_volume: None,
            close_size: 0.0,
            crumb_size: 0.0,
            reach_channel: None,
            samples: None,
            probes: None,
            volume: None,
            followed: None,
            history: None,
            done: None,
            curve: Vec::new(),
            interrupt: Interrupt::default(),
        }
    }

    pub(crate) fn total_collapses(&self) -> u64 {
        self.collapses + self.collapses_before
    }

    /// Scaled cost of a threshold in units^4; what is beyond f32 is its largest number.
    pub(super) fn scaled(&self, level: f64) -> f32 {
        (level * self.state.surface.scale.powi(4)).min(f64::from(f32::MAX)) as f32
    }

    pub(super) fn note_quality(&mut self) {
        if let Some(probes) = &mut self.probes {
            let removed_error = self.changes.removed_error;
            let step = probes.step_on_the_way();
            let quality = probes.sum_up(&self.state.surface, removed_error, step);
            self.curve.push(QualityAt { triangles: self.state.surface.n_alive, quality });
        }
    }

    /// Makes the surface manifold as far as sources for new vertices are at hand; see `make_manifold`.
    pub(crate) fn mend(&mut self) {
        // A wall that is parted has vertices with the labels of others.
        let has_walls = self.state.surface.has_walls;
        let is_free = self.topology == Topology::Error && self.bound.is_none() && !has_walls;
        if is_free && self.changes.may_mend {
            self.follow();
            let done = make_manifold::mend(&mut self.state, &mut self.spare_sources, self.simd);
            validate(&self.state);
            if let Some(place) = &done.rebuilt {
                self.renumber(place);
                self.collapses_before += std::mem::take(&mut self.collapses);
            }
            self.small_components = None;
            self.changes.add(done);
        }
    }

    /// Fills the holes up to the size that was asked for; their loops may move if they `yield`.
    pub(crate) fn close(&mut self, yields: bool) {
        if self.close_size > 0.0 {
            let before = self.changes.filled.unwrap_or_default().0;
            let filled = close::close(&mut self.state, self.close_size, yields, self.simd);
            let filled = FilledHoles {
                holes: before.holes + filled.holes,
                triangles: before.triangles + filled.triangles,
                attempts: before.attempts + filled.attempts,
            };
            self.changes.filled = Some((filled, OpenHoles::default()));
            if let Some(crossings) = &mut self.crossings {
                crossings.extend(&self.state.surface);
            }
            validate(&self.state);
        }
    }

    /// Cuts out what still meets, and holes that are still open, as far as that can be closed.
    pub(crate) fn excise(&mut self) {
        if self.crossings.take_if(|_| self.close_size > 0.0).is_some() {
            let mut all = Excised::default();
            let mut volume = self.cut_volume.unwrap_or_else(|| CutVolume::of(&self.state.surface));
            for round in 0..MOST_ROUNDS {
                if round > 0 && close::open(&self.state, self.close_size) == OpenHoles::default() {
                    break;
                }
                // Where collapses and cuts have left several fans at a vertex, loops would end.
                self.changes.may_mend = true;
                self.mend();
                self.close(true);
                let mut crossings = Box::new(Crossings::new(&self.state.surface, self.simd));
                let now = excise(
                    &mut self.state,
                    &mut crossings,
                    (self.close_size, &mut volume),
                    self.simd,
                );
                all.add(now);
                self.crossings = Some(crossings);
                if now.triangles == 0 {
                    break;
                }
            }
            self.changes.excised = Some(all);
            self.cut_volume = Some(volume);
            self.small_components = None;
            validate(&self.state);
        }
    }

    /// Moves sheets apart that touch, or cuts them out there, and drops crumbs: where holes are filled, nothing may pass through
    /// itself, and all of the surface is here.
    pub(crate) fn part_sheets(&mut self) {
        let is_free = |ring: &Ring| ring.class != Some(Class::Locked) || ring.len == 0;
        let (Some(excised), Some(crossings), Some(volume)) =
            (&mut self.changes.excised, &mut self.crossings, &mut self.cut_volume)
        else {
            return;
        };
        if !self.state.surface.rings.iter().all(is_free) {
            return;
        }
        for _ in 0..MOST_ROUNDS {
            let mut left = crossings.part_places(&mut self.state.surface);
            let rings = self.state.surface.rings.iter().zip(0..);
            let is_bad = |ring: &Ring| ring.class == Some(Class::Complex) && ring.len > 0;
            left.extend(rings.filter(|(ring, _)| is_bad(ring)).map(|(_, v): (_, u32)| v));
            if left.is_empty() || self.interrupt.is_raised() {
                break;
            }
            excised.triangles +=
                cut_corners(&mut self.state, crossings, (&left, volume), self.simd);
        }
        let crumbs = drop_crumbs(&mut self.state.surface, self.crumb_size);
        crossings.moved(&self.state.surface, &crumbs.triangles);
        self.changes.crumbs = Some((crumbs.n, crumbs.triangles.len() as u64));
        validate(&self.state);
    }

    /// Counts the holes that are open at the end.
    pub(crate) fn count_open(&mut self) {
        if let Some((_, open)) = &mut self.changes.filled {
            *open = close::open(&self.state, self.close_size);
        }
    }

    /// Leads all that names vertices to those that are still there.
    fn follow(&mut self) {
        let rings = &self.state.surface.rings;
        if let Some(samples) = &mut self.samples {
            samples.follow(rings);
        }
        if let Some(probes) = &mut self.probes {
            probes.follow(rings);
        }
        if let Some(followed) = &mut self.followed {
            followed.follow(rings);
        }
    }

    /// Takes over new numbers of the vertices.
    pub(super) fn renumber(&mut self, place: &[u32]) {
        self.small_components = None;
        // The old tree goes before the new one is built.
        if self.crossings.take().is_some() {
            self.crossings = Some(Box::new(Crossings::new(&self.state.surface, self.simd)));
        }
        if let Some(samples) = &mut self.samples {
            samples.renumber(place, self.state.surface.n_alive, self.state.surface.vertices.len());
        }
        if let Some(probes) = &mut self.probes {
            probes.renumber(place);
        }
        if let Some(followed) = &mut self.followed {
            followed.renumber(place);
        }
    }

    pub(super) fn tidy(&mut self) {
        validate(&self.state);
        if (self.state.surface.n_alive as f64) < 0.75 * self.state.surface.triangles.len() as f64 {
            self.follow();
            if let Some(tracker) = &mut self.bound {
                tracker.before_compaction(&self.state.surface);
            }
            let place = self.state.compact(self.simd);
            self.renumber(&place);
            if let Some(tracker) = &mut self.bound {
                tracker.after_compaction(&place);
            }
            self.collapses_before += std::mem::take(&mut self.collapses);
        }
    }
}
