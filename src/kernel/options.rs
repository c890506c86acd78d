//! Options of the kernel: when to stop, where survivors go, what may happen to the topology; and its limits.

use crate::earlier::EarlierRun;
use crate::interrupt::Interrupt;
use std::sync::Arc;
use stonecut_mesh::vec3::Vec3;

/// More triangles than this cannot be simplified at once: the numbers of triangles, corners and places in rings
/// are 32 bits wide, with one bit of a corner taken, and room for what is added.
pub const MAX_TRIANGLES: u64 = 1 << 29;
/// More vertices cannot be either: two bits of an id in the queue are taken. Cuts and mending add vertices.
pub const MAX_VERTICES: u64 = (1 << 30) - (1 << 24);
// A module of WebAssembly, of 4 GiB at most, runs out of memory before a size overflows.
const _: () = assert!(
    usize::BITS == 64 || cfg!(target_arch = "wasm32"),
    "sizes of meshes are counted in usize"
);

/// Condition at which the kernel stops collapsing.
#[derive(Clone, Debug, PartialEq)]
pub enum Stop {
    /// At most this many triangles, at least two fewer if the topology allows it: cheapest first.
    Triangles(u64),
    /// Ascending cost thresholds, drained one after the other; `Statistics::level_counts` tells how many
    /// triangles were left after each. A run over a prefix of the levels gives the same mesh as a longer
    /// run had at that point. `Stepwise` goes the same way level by level.
    ///
    /// Costs are in units^4 (squared distance times area) and mean the same in every cell.
    Costs(Vec<f64>),
    /// As `Costs`, for thresholds so close together that seeding a queue for each would cost more than the
    /// collapses: one queue over the whole mesh serves them all.
    CloseCosts(Vec<f64>),
    /// Cheapest first, until all that is left costs more than a threshold, or about this many triangles are left.
    Free {
        /// The threshold, in units^4.
        cost: f64,
        /// Triangles that stay.
        triangles: u64,
    },
}

/// Options of `simplify_mesh`; every value is final.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// Condition at which to stop.
    pub stop: Stop,
    /// Allowed changes of the topology.
    pub topology: Topology,
    /// Moves the vertices at the end so that the error falls; only with `Placement::Optimal`.
    pub fit: Fit,
    /// Share of the triangles that cost thresholds are expected to leave. Above 0, and under `Fit::On`, the vertices
    /// are fitted there too, in one sweep: for the rounds of a job that ends with a fit.
    pub expected_share: f64,
    /// Fits the first round of a job as well, which sees all of the original: for `Fit::On` where it was asked for.
    pub fits_first_round: bool,
    /// Takes one sample for each triangle in rounds whose triangles have relief, not three: 3 to 5 % more error, for two thirds
    /// of the time of the fit.
    pub sparse_rounds: bool,
    /// Gives the result the relief of the original, as far as it was fitted.
    pub keeps_relief: bool,
    /// Position of the vertex that survives a collapse.
    pub placement: Placement,
    /// Boundary vertices of different components that are at most this far apart, in input units, may
    /// become one; 0: none. Under `Topology::Error` only, and only where neither is locked.
    pub merge_distance: f64,
    /// For each channel, how many input units of distance a difference of 1 weighs as much as; 0, or none
    /// given: it rides along. At most `MAX_WEIGHTED` count.
    pub weights: Vec<f32>,
    /// For each channel, whether its values are only ever interpolated along edges: texture coordinates, which
    /// mean nothing outside of their chart. Others may be extrapolated to where the survivor is.
    pub confined: Vec<bool>,
    /// The channel that is the same all over a region of the surface and changes at its border, if there is
    /// one: moving a border costs what moving a boundary of the surface does.
    pub region: Option<usize>,
    /// Triangles are walls between two regions of space, of which `region` is the pair: no edge of them is noise, and none is dropped
    /// or turned over alone, so that what encloses a region stays closed.
    pub walls: bool,
    /// The channel with the labels of vertices, if there are any: it is never interpolated, and a border between two labels
    /// lies between two rows of vertices that are kept as boundaries are.
    pub label: Option<usize>,
    /// Cost of moving any other attribute seam, as a share of that.
    pub seam_share: f32,
    /// Keeps the result near the original, if given.
    pub bound: Option<Bound>,
    /// Places where the bound is tighter than elsewhere: there an earlier run of the same kind went beyond it.
    pub tight: Arc<[Tight]>,
    /// A run over the same mesh whose collapses are repeated where nothing has changed, or that is noted for later ones; only within a
    /// bound, where the stop is a count.
    pub earlier: Option<EarlierRun>,
    /// Refuses what makes the surface pass through itself, for `crossing_bytes`.
    pub no_self_intersections: bool,
    /// Fills holes whose box has at most this diagonal, in input units; 0: none. For `crossing_bytes`.
    pub close: f64,
    /// Drops closed components of a few triangles from a result whose holes are filled and which may not pass through itself, if
    /// their box has at most this diagonal, in input units, or they enclose next to nothing; 0: none.
    pub crumbs: f64,
    /// Turns triangles over so that neighbours agree wherever they can, in later rounds too, and counts where they cannot.
    pub orient: bool,
    /// Estimates the quality of the result; its time was not measured.
    pub estimate: bool,
    /// Notes where every vertex of the input went (`Simplified::followed`), for 4 bytes a vertex.
    pub follow: bool,
    /// Keeps every step (`Simplified::history`), for `history_bytes`; only where the stop is a count, under
    /// `Topology::Error`, without a bound, a fit or attribute seams. All steps come out of one queue then, so that a run to fewer
    /// triangles passes through the meshes of runs to more.
    pub record: bool,
    /// Asks the call to return early, with `Statistics::interrupted`; by default nothing does.
    pub interrupt: Interrupt,
}

/// Times that the nearest triangles are found and the vertices moved where the stop is a count. One leaves 5 % more
/// error on the samples, a third gains 1 to 3 % for half as much time again (docs/design/kernel.md, "The fit").
/// Rounds do one: each begins from what the one before has fitted.
const SWEEPS: u64 = 2;

/// Samples of a round are merged as long as they are enough for this share of the triangles that it should leave: rounds take
/// fewer than a result, since the next one fits again. At 2 the fit took 27 and 38 % of the time of a run to 1 % (terrain,
/// statue 4M), for 0.1 % less error than at a half.
const MERGED_FOR: f64 = 0.5;

impl Options {
    /// The result that samples of a mesh are taken for; `None` if it is not to be fitted.
    pub(crate) fn fit_goal(&self, n_triangles: u64) -> Option<FitGoal> {
        if self.placement != Placement::Optimal || self.bound.is_some() {
            return None;
        }
        match self.stop {
            Stop::Triangles(target) => self.fit.applies(n_triangles, target).then_some(FitGoal {
                left: target,
                merged: target,
                sweeps: SWEEPS,
                is_sparse: false,
            }),
            Stop::Costs(_) | Stop::CloseCosts(_) | Stop::Free { .. } => {
                self.round_goal(n_triangles)
            }
        }
    }

    /// The same for thresholds.
    pub(crate) fn round_goal(&self, n_triangles: u64) -> Option<FitGoal> {
        let is_wanted = self.fit == Fit::On && self.expected_share > 0.0 && self.bound.is_none();
        if !is_wanted || self.placement != Placement::Optimal {
            return None;
        }
        let left = n_triangles as f64 * self.expected_share;
        Some(FitGoal {
            left: left as u64,
            merged: (MERGED_FOR * left) as u64,
            sweeps: 1,
            is_sparse: self.sparse_rounds,
        })
    }

    /// Leaves a part of the bound to later rounds; a share below 1 ends early, by `patience`, and is tighter nowhere, so that
    /// all attempts have that round in common.
    pub fn use_share_of_bound(&mut self, share: f64, patience: f64) {
        self.earlier = None;
        let Some(bound) = &mut self.bound else { return };
        bound.distance *= share;
        bound.patience = 1.0;
        if share < 1.0 {
            bound.patience = patience;
            // These places went beyond the whole bound, later.
            self.tight = Arc::from([]);
        }
    }
}

/// The result that samples are taken for.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FitGoal {
    /// Triangles that are expected to be left.
    pub(crate) left: u64,
    /// Triangles for which merged samples must be enough.
    pub(crate) merged: u64,
    /// Times that the nearest triangles are found and the vertices moved.
    pub(crate) sweeps: u64,
    /// Takes one sample for each triangle that has relief.
    pub(crate) is_sparse: bool,
}

/// A bound on the distance between the result and the original, both ways.
///
/// Topology changes within it only: small components vanish where others stand in for them, handles are cut where the caps
/// are near the original, holes of three edges close. Nothing is fitted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bound {
    /// In input units.
    pub distance: f64,
    /// The channel that says how far the mesh that is given is from the original around each vertex, at most, in
    /// input units; the result has its own distance there. None: it is the original.
    pub channel: Option<usize>,
    /// If below 1, `Stop::Costs` ends after the first level at which the bound refused more collapses than this share
    /// of the triangles: an even mesh is the better beginning for the next round.
    pub patience: f64,
}

/// A ball in which less of the bound may be used, and in which all counts that earlier rounds have used of it, whatever points of
/// the original say. Lengths are in input units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tight {
    /// Middle of the ball.
    pub place: Vec3,
    /// Its radius.
    pub radius: f64,
    /// The part of the bound that is not used within it, 0 or more; the whole bound and more keep the surface as it is.
    pub margin: f64,
}

/// Position of the vertex that survives a collapse.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Placement {
    /// The point of least error, the enclosed volume preserved.
    #[default]
    Optimal,
    /// To the better one of both ends: every vertex of the result is one of the input, bit for bit.
    Subset,
    /// To the middle of the edge.
    Midpoint,
}

/// Allowed changes of components, holes and handles.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Topology {
    /// Nothing: a target that cannot be met without is not met.
    Keep,
    /// Details smaller than the current error may go: components vanish (never with a locked vertex, nor where
    /// they are far from larger ones in proportion to the error), holes of three edges close, thin tubes
    /// and handles are cut and capped. First, boundaries whose edges coincide are joined, sheets that only
    /// touch are taken apart, and doubled triangles dropped.
    #[default]
    Error,
}

impl Default for Options {
    /// Collapses nothing; the stages set the stop.
    fn default() -> Self {
        Options {
            stop: Stop::Triangles(u64::MAX),
            topology: Topology::default(),
            fit: Fit::default(),
            expected_share: 0.0,
            fits_first_round: false,
            sparse_rounds: false,
            keeps_relief: false,
            placement: Placement::default(),
            merge_distance: 0.0,
            weights: Vec::new(),
            confined: Vec::new(),
            region: None,
            walls: false,
            label: None,
            seam_share: 0.0,
            bound: None,
            tight: Arc::from([]),
            earlier: None,
            no_self_intersections: false,
            close: 0.0,
            crumbs: 0.0,
            orient: false,
            estimate: false,
            follow: false,
            record: false,
            interrupt: Interrupt::default(),
        }
    }
}

/// Choice of fitting the vertices of the result to the original; only where the stop is a count.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Fit {
    /// Always.
    On,
    /// Never.
    Off,
    /// Only if it is cheap against the collapses: at most `AUTO_FIT_RATIO` of the triangles are left. (Results too large for one
    /// finish are fitted in later rounds: `pipeline::fit`.)
    #[default]
    Auto,
}

/// `Fit::Auto` fits where at most this share of the triangles is left: 1 %, with room for targets that were
/// rounded up. There it costs 13 % of a run in memory and 5 % of one through cells
/// (docs/results/kernel.md).
pub const AUTO_FIT_RATIO: f64 = 0.011;

impl Fit {
    /// Returns whether to fit a mesh that goes from `n_triangles` to `target`.
    pub fn applies(self, n_triangles: u64, target: u64) -> bool {
        match self {
            Fit::On => target < n_triangles,
            Fit::Off => false,
            Fit::Auto => target as f64 <= n_triangles as f64 * AUTO_FIT_RATIO,
        }
    }

    /// The same, decided: for a part of a job whose counts are not those of the whole.
    pub fn decided(self, n_triangles: u64, target: u64) -> Fit {
        if self.applies(n_triangles, target) { Fit::On } else { Fit::Off }
    }
}
