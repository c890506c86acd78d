//! The classes of vertices, and the pairs of them that may collapse, as the reference sees it.

/// Reason why a collapse was not carried out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reject {
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
}

impl Reject {
    /// Every reason in the order in which they are reported, with the name users see.
    pub const NAMED: [(Reject, &'static str); 6] = [
        (Reject::Locked, "locked"),
        (Reject::LinkCondition, "link_condition"),
        (Reject::Flip, "flip"),
        (Reject::Boundary, "boundary"),
        (Reject::Sliver, "sliver"),
        (Reject::NonManifold, "non_manifold"),
    ];
}

/// Number of times that each reason was given.
#[derive(Clone, Debug, Default)]
pub struct RejectCounts([u64; 6]);

impl RejectCounts {
    pub fn add(&mut self, reason: Reject) {
        self.0[reason as usize] += 1;
    }

    /// Names and counts, always all of them, in the order of `Reject::NAMED`.
    pub fn named(&self) -> Vec<(&'static str, u64)> {
        Reject::NAMED.iter().map(|&(reason, name)| (name, self.0[reason as usize])).collect()
    }
}

/// Rows: class of the removed vertex. Columns: class of the kept vertex.
/// A kept vertex that could not itself be removed stays exactly where it is.
pub const MAY_COLLAPSE: [[Result<(), Reject>; 4]; 4] = {
    const OK: Result<(), Reject> = Ok(());
    const BOUNDARY: Result<(), Reject> = Err(Reject::Boundary);
    const COMPLEX: Result<(), Reject> = Err(Reject::NonManifold);
    const LOCKED: Result<(), Reject> = Err(Reject::Locked);
    [
        // Interior Boundary  Complex  Locked
        [OK, OK, OK, OK],                     // Interior
        [BOUNDARY, OK, OK, OK],               // Boundary: only along the boundary
        [COMPLEX, COMPLEX, COMPLEX, COMPLEX], // Complex
        [LOCKED, LOCKED, LOCKED, LOCKED],     // Locked
    ]
};

/// Class of a vertex: what its triangles form, or that the caller holds it fixed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Class {
    /// Its triangles form one closed fan.
    Interior,
    /// Its triangles form one open fan.
    Boundary,
    /// Neither: on a non-manifold edge, or several fans meet in it.
    Complex,
    /// The caller holds it fixed.
    Locked,
}

impl Class {
    /// True if a vertex of this class may be moved.
    pub fn is_fixed(self) -> bool {
        matches!(self, Class::Complex | Class::Locked)
    }
}
