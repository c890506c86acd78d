//! Finds triangles that a file holds more than once, out of core.

use super::external_sort::{ExternalSort, halves, whole};
use std::path::Path;
use stonecut_system::error::Result;

/// Takes all triangles in order, then tells which ones repeat an earlier one: the same three corners,
/// whatever their order.
///
/// Disk: 20 bytes a triangle beyond the memory given.
pub struct DuplicateFinder {
    sort: ExternalSort<5>,
    n_triangles: u64,
}

/// The triangles that repeat an earlier one, by their place in the order: a bit a triangle up to the last.
#[derive(Debug, Default)]
pub struct Duplicates {
    bits: Vec<u64>,
    count: u64,
}

impl DuplicateFinder {
    /// `folder` takes what exceeds the memory.
    pub fn new(folder: &Path, memory_bytes: usize) -> Self {
        DuplicateFinder { sort: ExternalSort::new(folder, memory_bytes), n_triangles: 0 }
    }

    /// Appends a triangle; ids must be below 2^32, as in every output.
    pub fn push(&mut self, triangle: [u64; 3]) -> Result<()> {
        self.n_triangles += 1;
        self.push_at(self.n_triangles - 1, triangle)
    }

    /// Takes a triangle at a place behind those of all before it, where only some triangles are of interest.
    pub(crate) fn push_at(&mut self, place: u64, triangle: [u64; 3]) -> Result<()> {
        let mut corners = triangle.map(|v| v as u32);
        corners.sort_unstable();
        let [high, low] = halves(place);
        self.sort.push([corners[0], corners[1], corners[2], high, low])
    }

    /// Finds them.
    pub fn finish(self) -> Result<Duplicates> {
        let mut found = Duplicates::default();
        let mut last = None;
        self.sort.drain(|[a, b, c, high, low]| {
            if last == Some([a, b, c]) {
                let place = whole(high, low);
                let word = (place / 64) as usize;
                if found.bits.len() <= word {
                    found.bits.resize(word + 1, 0);
                }
                found.bits[word] |= 1 << (place % 64);
                found.count += 1;
            }
            last = Some([a, b, c]);
            Ok(())
        })?;
        Ok(found)
    }
}

impl Duplicates {
    /// Returns their number.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Returns whether the triangle at this place is one.
    pub fn contains(&self, place: u64) -> bool {
        let word = self.bits.get((place / 64) as usize).copied().unwrap_or(0);
        word >> (place % 64) & 1 == 1
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_of_equal_triangles_stays() {
        let mut finder = DuplicateFinder::new(&std::env::temp_dir(), 0);
        for t in [[0, 1, 2], [3, 4, 5], [2, 0, 1], [0, 1, 3], [1, 0, 2]] {
            finder.push(t).unwrap();
        }
        let found = finder.finish().unwrap();
        let places: Vec<_> = (0..6).filter(|&i| found.contains(i)).collect();
        assert_eq!((places, found.count()), (vec![2, 4], 2));
    }
}
