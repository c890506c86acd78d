//! Legality by classes: the table of allowed pairs, and the named reasons of a rejection.
//!
//! The tables are read by every kernel here; the geometric tests live where the geometry is.
//!
//! docs/algorithm.md, section 4.

/// Reason why a collapse was rejected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Reject {
    /// Both ends are locked, or an edge between two locked vertices would arise.
    Locked,
    /// The surface would change its topology or become non-manifold.
    LinkCondition,
    /// A triangle would turn over.
    Flip,
    /// An open boundary or one of its corners would be lost.
    Boundary,
    /// A needle would arise.
    Sliver,
    /// The input is non-manifold there; it is left as found.
    NonManifold,
    /// The surface would be farther from the original than it may.
    Bound,
    /// The surface would pass through itself where it did not.
    SelfIntersection,
}

impl Reject {
    /// Every reason in the order in which they are reported, with the name users see.
    pub(crate) const NAMED: [(Reject, &'static str); 8] = [
        (Reject::Locked, "locked"),
        (Reject::LinkCondition, "link_condition"),
        (Reject::Flip, "flip"),
        (Reject::Boundary, "boundary"),
        (Reject::Sliver, "sliver"),
        (Reject::NonManifold, "non_manifold"),
        (Reject::Bound, "bound"),
        (Reject::SelfIntersection, "self_intersection"),
    ];
}

/// Number of rejections by reason.
#[derive(Clone, Debug, Default)]
pub(crate) struct RejectCounts([u64; 8]);

impl RejectCounts {
    pub(crate) fn add(&mut self, reason: Reject) {
        self.0[reason as usize] += 1;
    }

    /// All together.
    pub(crate) fn total(&self) -> u64 {
        self.0.iter().sum()
    }

    pub(crate) fn of(&self, reason: Reject) -> u64 {
        self.0[reason as usize]
    }

    /// Refusals that no waiting will mend.
    pub(crate) fn topological(&self) -> u64 {
        self.0[Reject::LinkCondition as usize] + self.0[Reject::Boundary as usize]
    }

    /// Names and counts, always all of them, in the order of `Reject::NAMED`.
    pub(crate) fn named(&self) -> Vec<(&'static str, u64)> {
        Reject::NAMED.iter().map(|&(reason, name)| (name, self.0[reason as usize])).collect()
    }
}

/// Rows: class of the removed vertex. Columns: class of the kept vertex.
/// A kept vertex that could not itself be removed stays exactly where it is.
pub(crate) const MAY_COLLAPSE: [[Result<(), Reject>; 5]; 5] = {
    const OK: Result<(), Reject> = Ok(());
    const BOUNDARY: Result<(), Reject> = Err(Reject::Boundary);
    const COMPLEX: Result<(), Reject> = Err(Reject::NonManifold);
    const LOCKED: Result<(), Reject> = Err(Reject::Locked);
    [
        // Interior Boundary Junction  Complex  Locked
        [OK, OK, OK, OK, OK],                          // Interior
        [BOUNDARY, OK, OK, OK, OK],                    // Boundary: only along the boundary
        [BOUNDARY, BOUNDARY, OK, OK, OK],              // Junction: only along the curve
        [COMPLEX, COMPLEX, COMPLEX, COMPLEX, COMPLEX], // Complex
        [LOCKED, LOCKED, LOCKED, LOCKED, LOCKED],      // Locked
    ]
};
