//! A triangle seen from one of its corners.

use std::hint::select_unpredictable;

/// The two other corners of a triangle, in its sense of rotation.
#[inline(always)]
pub fn others(triangle: [u32; 3], v: u32) -> (u32, u32) {
    // Which corner it is cannot be predicted.
    let [x, y, z] = triangle;
    let (first, second) = (x == v, y == v);
    let next = select_unpredictable(first, y, select_unpredictable(second, z, x));
    let last = select_unpredictable(first, z, select_unpredictable(second, x, y));
    (next, last)
}
