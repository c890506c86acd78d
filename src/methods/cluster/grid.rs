//! A uniform grid over a box: cells by integers, packed into 64 bits.

use stonecut_mesh::bounds::Bounds;
use stonecut_mesh::vec3::{Vec3, scale, sub};

/// Bits for the number of a cell on each axis.
const AXIS_BITS: u32 = 21;
const AXIS_MASK: u64 = (1 << AXIS_BITS) - 1;

/// Most cells on an axis.
pub const MOST_CELLS: f64 = AXIS_MASK as f64;

/// A uniform grid.
///
/// It lies around the middle of the box, so that a flat mesh lies in the middle of its layer of cells, not on a wall.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CubeGrid {
    /// Length of a cell in input units.
    pub cell_size: f64,
    low: Vec3,
    inverse: f64,
}

impl CubeGrid {
    /// A grid around `bounds`; `None` where cells of this size are more than `MOST_CELLS` on an axis.
    pub fn around(bounds: &Bounds, cell_size: f64) -> Option<CubeGrid> {
        let mut low = [0.0; 3];
        for (axis, low) in low.iter_mut().enumerate() {
            let extent = bounds.high[axis] - bounds.low[axis];
            let n_cells = (extent / cell_size).floor() + 1.0;
            // Also where it is not a number.
            if n_cells.is_nan() || n_cells > MOST_CELLS {
                return None;
            }
            let middle = bounds.low[axis] + 0.5 * extent;
            *low = middle - 0.5 * n_cells * cell_size;
        }
        Some(CubeGrid { cell_size, low, inverse: 1.0 / cell_size })
    }

    /// A point in units of cells, from the lowest corner of the grid.
    #[inline(always)]
    pub(super) fn place(&self, position: Vec3) -> Vec3 {
        scale(sub(position, self.low), self.inverse)
    }

    /// The cell that holds a place. What rounding has put outside of the grid is in its outermost cell.
    #[inline(always)]
    pub(super) fn key(place: Vec3) -> u64 {
        // A cast of a negative number is 0.
        let [i, j, k] = place.map(|x| (x as u64).min(AXIS_MASK));
        i | j << AXIS_BITS | k << (2 * AXIS_BITS)
    }

    /// The centre of a cell, in units of cells.
    #[inline(always)]
    pub(super) fn centre(key: u64) -> Vec3 {
        [0, AXIS_BITS, 2 * AXIS_BITS].map(|shift| (key >> shift & AXIS_MASK) as f64 + 0.5)
    }

    /// The point in input units of a place.
    pub(super) fn position(&self, place: Vec3) -> Vec3 {
        [0, 1, 2].map(|axis| self.low[axis] + place[axis] * self.cell_size)
    }

    /// The cell with sides twice as long that holds a cell.
    #[inline(always)]
    pub(super) fn parent(key: u64) -> u64 {
        const LOW_BITS: u64 = 1 | 1 << AXIS_BITS | 1 << (2 * AXIS_BITS);
        (key & !LOW_BITS) >> 1
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_keys_and_positions_belong_together() {
        let bounds = Bounds { low: [-1.0, 5e6, 2.0], high: [9.0, 5e6 + 7.0, 2.0] };
        let grid = CubeGrid::around(&bounds, 0.25).unwrap();
        for point in [bounds.low, bounds.high, [3.25, 5e6 + 2.75, 2.0]] {
            let place = grid.place(point);
            let centre = CubeGrid::centre(CubeGrid::key(place));
            for axis in 0..3 {
                assert!((place[axis] - centre[axis]).abs() <= 0.5 + 1e-9, "{place:?} {centre:?}");
                assert!((grid.position(place)[axis] - point[axis]).abs() < 1e-8);
            }
            let parent = CubeGrid::centre(CubeGrid::parent(CubeGrid::key(place)));
            assert!((0..3).all(|axis| (parent[axis] - place[axis] / 2.0).abs() <= 0.5 + 1e-9));
        }
        // A flat mesh lies in the middle of its only layer.
        assert_eq!(grid.place([0.0, 5e6, 2.0])[2], 0.5);
        assert!(
            CubeGrid::around(&bounds, 1e-9).is_none() && CubeGrid::around(&bounds, 0.0).is_none()
        );
    }
}
