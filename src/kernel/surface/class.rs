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
    /// In the middle of a junction curve: three or more sheets end in the same two edges (`surface::junction`).
    Junction,
    /// None of these: an end or a crossing of junction curves, on another non-manifold edge, or several fans meet in it.
    Complex,
    /// The caller holds it fixed.
    Locked,
}

impl Class {
    /// Returns whether it is on edges of more than two triangles, or several fans meet in it.
    pub(crate) fn is_non_manifold(self) -> bool {
        matches!(self, Class::Junction | Class::Complex)
    }
}
