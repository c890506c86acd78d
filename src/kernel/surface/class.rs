//! Classes of vertices by the fans that their triangles form.
//!
//! docs/algorithm.md, section 4.

/// Class of a vertex: what its triangles form, or that the caller holds it fixed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Class {
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
    /// Returns whether a vertex of this class may be moved.
    pub(crate) fn is_fixed(self) -> bool {
        matches!(self, Class::Complex | Class::Locked)
    }
}
