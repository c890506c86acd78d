//! Operations on eight f32 lanes, and work that is generic over them.
//!
//! Every operation is one correctly rounded IEEE operation a lane, none is fused, so that all implementations
//! agree to the last bit.

use crate::vertex::Vertex;

/// Work that can be done with either kind of lanes.
pub(crate) trait Job {
    type Output;
    fn run<L: Lanes>(self) -> Self::Output;
}

/// Eight numbers. `lt_select(a, b, x, y)` is `x` where a < b, else `y` (also where a or b is NaN).
pub(crate) trait Lanes: Copy {
    fn splat(x: f32) -> Self;
    fn load(x: &[f32; 8]) -> Self;
    fn store(self) -> [f32; 8];
    fn plus(self, other: Self) -> Self;
    fn minus(self, other: Self) -> Self;
    fn times(self, other: Self) -> Self;
    fn over(self, other: Self) -> Self;
    fn root(self) -> Self;
    /// The greater of both; `other` if either is NaN.
    fn greater(self, other: Self) -> Self;
    /// The lesser of both; `other` if either is NaN.
    fn lesser(self, other: Self) -> Self;
    /// All eight added up, always in the same order.
    fn sum(self) -> f32;
    /// The least of all eight by `lesser`, always in the same order.
    fn least(self) -> f32;
    fn lt_select(a: Self, b: Self, x: Self, y: Self) -> Self;
    /// x, y, z of each vertex minus `base`, times `scale`, subtracted in f64.
    fn relative(vertices: [&Vertex; 8], base: [&[f64; 3]; 8], scale: f64) -> [Self; 3];
    /// The nine numbers of each vertex's quadric, one array a number.
    fn quadrics(vertices: [&Vertex; 8]) -> [Self; 9];
    /// Eight rows of eight numbers, one array a number.
    fn columns(rows: [&[f32; 8]; 8]) -> [Self; 8];
    /// Eight numbers of each lane, one array a lane.
    fn store_rows(columns: [Self; 8], rows: &mut [[f32; 8]; 8]);
    /// Bit `i` tells whether lane `i` is less than that of `other`; not so if either is NaN.
    fn below(self, other: Self) -> u32;
    /// Bit `i` tells whether `ids[i]` is `id`.
    fn matches(ids: &[u32; 8], id: u32) -> u32;
    /// Of eight triangles the two corners that are not `v`, in their sense of rotation: all next ones, all last
    /// ones. What is not a triangle of `v` comes out as its last two corners.
    fn others(triangles: [&[u32; 3]; 8], v: u32) -> [[u32; 8]; 2];
    /// The numbers whose bits are set, in their order, then anything.
    fn packed(list: &[u32; 8], bits: u32) -> [u32; 8];
}

/// For each set of bits, which lanes they stand for, in order.
pub(super) const PACKING: [[u8; 8]; 256] = {
    let mut table = [[0; 8]; 256];
    let mut bits = 0;
    while bits < 256 {
        let (mut lane, mut n) = (0, 0);
        while lane < 8 {
            if bits >> lane & 1 == 1 {
                table[bits][n] = lane as u8;
                n += 1;
            }
            lane += 1;
        }
        bits += 1;
    }
    table
};
