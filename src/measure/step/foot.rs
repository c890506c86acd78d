//! Points with triangles near them.

use crate::measure::triangle::Vector;

/// A point with a triangle near it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Foot {
    pub(super) point: Vector,
    pub(super) distance_sq: f64,
    pub(super) triangle: u32,
    /// The corner of the triangle that is nearest to the foot, about.
    pub(super) hint: u32,
}

/// A distance that may be too large, in a heap.
#[derive(Clone, Copy, PartialEq)]
pub(super) struct Doubtful {
    pub(super) distance_sq: f64,
    pub(super) item: u32,
}

impl Eq for Doubtful {}

impl Ord for Doubtful {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.distance_sq.total_cmp(&other.distance_sq).then(other.item.cmp(&self.item))
    }
}

impl PartialOrd for Doubtful {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}
