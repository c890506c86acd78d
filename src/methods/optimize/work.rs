//! Means of all moves of a sweep.

use stonecut_system::progress::Progress;

/// Means that moves have in common.
#[derive(Clone, Copy)]
pub(super) struct Work<'a> {
    /// Energy of an edge over its squared length.
    pub spring: f64,
    pub threads: usize,
    pub progress: &'a Progress,
}
