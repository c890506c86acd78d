//! The changes that a run within a bound has made, for later runs over the same mesh that are tighter in a few places.

use std::sync::{Arc, OnceLock};

/// A change that was made. Vertices are named by those of the mesh that was given that they come from.
#[derive(Clone, Copy, Debug)]
pub(crate) enum DoneChange {
    /// A collapse of `v0` into `v1`, the survivor's place relative to the edge's midpoint (scaled), and true if a triangle was allowed
    /// to turn far.
    Collapse([u32; 2], [f32; 3], bool),
    /// A cut along a cycle of three edges, and the vertices that it has made.
    Cut([u32; 3], [u32; 3]),
    /// Small components vanished as far as they could.
    Vanish,
}

/// All changes of one run, in their order: the first run that is given this fills it, those after it repeat them. 28 bytes each.
///
/// All are equal to each other.
#[derive(Clone, Debug, Default)]
pub struct EarlierRun(Arc<OnceLock<Vec<DoneChange>>>);

impl EarlierRun {
    /// True once a run has filled it.
    pub fn is_known(&self) -> bool {
        self.0.get().is_some()
    }

    pub(crate) fn changes(&self) -> Option<&[DoneChange]> {
        self.0.get().map(Vec::as_slice)
    }

    pub(crate) fn fill(&self, done: Vec<DoneChange>) {
        let _ = self.0.set(done);
    }
}

impl PartialEq for EarlierRun {
    fn eq(&self, _: &EarlierRun) -> bool {
        true
    }
}
