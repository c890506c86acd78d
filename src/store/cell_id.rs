//! The number of a cell, as a type: lists by cell are indexed with it, so that nothing else is taken for one.
//!
//! Counts of cells stay plain numbers. Nothing here knows what a cell is.

use serde::{Deserialize, Serialize};
use std::fmt;
use std::ops::{Index, IndexMut};

/// The number of a cell in its store, from 0 on. Stored and printed as the bare number.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize,
)]
#[repr(transparent)]
#[serde(transparent)]
pub struct CellId(pub u32);

impl CellId {
    /// The cell at a place of a list by cell. Panics beyond 2^32, which no store reaches (`plan_cells`).
    pub fn at(place: usize) -> CellId {
        CellId(u32::try_from(place).expect("a store has fewer than 2^32 cells"))
    }

    /// The first `n` cells in their order.
    pub fn first(n: usize) -> impl DoubleEndedIterator<Item = CellId> + ExactSizeIterator {
        (0..n).map(CellId::at)
    }

    /// Its place in a list by cell.
    #[inline]
    pub fn index(self) -> usize {
        self.0 as usize
    }
}

impl fmt::Display for CellId {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(out)
    }
}

impl<T> Index<CellId> for [T] {
    type Output = T;

    #[inline]
    fn index(&self, cell: CellId) -> &T {
        &self[cell.index()]
    }
}

impl<T> IndexMut<CellId> for [T] {
    #[inline]
    fn index_mut(&mut self, cell: CellId) -> &mut T {
        &mut self[cell.index()]
    }
}

impl<T> Index<CellId> for Vec<T> {
    type Output = T;

    #[inline]
    fn index(&self, cell: CellId) -> &T {
        &self[cell.index()]
    }
}

impl<T> IndexMut<CellId> for Vec<T> {
    #[inline]
    fn index_mut(&mut self, cell: CellId) -> &mut T {
        &mut self[cell.index()]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    #[test]
    fn a_cell_is_stored_and_printed_as_its_number() {
        let cells: Vec<CellId> = CellId::first(3).collect();
        assert_eq!(serde_json::to_string(&cells).unwrap(), "[0,1,2]");
        assert_eq!(serde_json::from_str::<Vec<CellId>>("[0,1,2]").unwrap(), cells);
        // As a key too, as the thresholds of a round have it.
        let counts = BTreeMap::from([(CellId(7), 1), (CellId(12), 2)]);
        let value = serde_json::to_value(&counts).unwrap();
        assert_eq!(value.to_string(), r#"{"12":2,"7":1}"#);
        assert_eq!(serde_json::from_value::<BTreeMap<CellId, i32>>(value).unwrap(), counts);
        assert_eq!(format!("cell {}", CellId(4)), "cell 4");
        assert_eq!(size_of::<[CellId; 5]>(), 20);
    }

    #[test]
    #[should_panic(expected = "fewer than 2^32 cells")]
    fn a_place_beyond_32_bits_is_not_a_cell() {
        CellId::at(1 << 32);
    }
}
