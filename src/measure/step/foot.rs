//! Points with triangles near them.

use super::around::NONE;
use crate::triangle::Vector;

/// A point with a triangle near it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Foot {
    pub(super) point: Vector,
    pub(super) distance_sq: f64,
    pub(super) triangle: u32,
    /// The corner of the triangle that is nearest to the foot, about.
    pub(super) hint: u32,
    /// True if another triangle may well be nearer.
    pub(super) is_rough: bool,
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

/// Feet of vertices, found once for all triangles around them.
pub(super) struct Feet {
    slots: Vec<u32>,
    feet: Vec<Foot>,
}

impl Feet {
    /// Of a mesh with `n` vertices; 4 bytes for each of them and 56 for each foot.
    pub(super) fn new(n: usize) -> Feet {
        Feet { slots: vec![NONE; n], feet: Vec::new() }
    }

    /// The foot of a vertex; found if it is not known.
    pub(super) fn of(&mut self, vertex: u32, find: impl FnOnce() -> Foot) -> Foot {
        let slot = &mut self.slots[vertex as usize];
        if *slot == NONE {
            *slot = self.feet.len() as u32;
            self.feet.push(find());
        }
        self.feet[*slot as usize]
    }
}
