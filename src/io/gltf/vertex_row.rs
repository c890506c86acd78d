//! A vertex of a glTF mesh, and one that others in its place are joined with.

use crate::hard_edges::HARD;

/// Cosine of the angle up to which normals of one place are the same: a degree, four times what 8 bits round.
const SAME: f64 = 0.999_85;
/// Normals of one place that stay apart at most, so that a place with any number of them takes no time.
pub(super) const MOST_APART: usize = 1024;

/// A vertex of the input in its place.
#[derive(Clone, Copy)]
pub(super) struct VertexRow {
    pub(super) position: [f64; 3],
    pub(super) colour: [u8; 4],
    pub(super) normal: [f32; 3],
    pub(super) uv: [f32; 2],
}

/// A joined vertex that gathers the normals of those in its place.
pub(super) struct Open {
    pub(super) first: u64,
    pub(super) position: [f64; 3],
    pub(super) colour: [u8; 4],
    pub(super) normal: [f64; 3],
    /// True if one of its normals differs from the first by more than `HARD`.
    pub(super) is_hard: bool,
    first_normal: [u32; 3],
}

impl Open {
    /// The vertex of this number, the first in its place.
    pub(super) fn of(first: u64, row: &VertexRow) -> Open {
        let position = row.position.map(|x| x + 0.0);
        Open::at(first, position, (row.colour, row.normal.map(f32::to_bits)))
    }

    /// The vertex of this number, with its colour and the bits of its normal, which is not added yet.
    pub(super) fn at(first: u64, position: [f64; 3], has: ([u8; 4], [u32; 3])) -> Open {
        let (colour, first_normal) = has;
        Open { first, position, colour, normal: [0.0; 3], is_hard: false, first_normal }
    }

    pub(super) fn add(&mut self, normal: [u32; 3]) {
        for (sum, bits) in self.normal.iter_mut().zip(normal) {
            *sum += f64::from(f32::from_bits(bits));
        }
        self.is_hard |= !agree(self.first_normal, normal, HARD);
    }
}

/// Returns whether two normals, given by their bits, are the same within rounding.
pub(super) fn are_same(a: [u32; 3], b: [u32; 3]) -> bool {
    agree(a, b, SAME)
}

/// Returns whether the angle between unit vectors, given by their bits, has at least this cosine; a second one of length 0 says
/// nothing.
fn agree(a: [u32; 3], b: [u32; 3], cosine: f64) -> bool {
    let [a, b] = [a, b].map(|bits| bits.map(|x| f64::from(f32::from_bits(x))));
    b == [0.0; 3] || (0..3).map(|i| a[i] * b[i]).sum::<f64>() >= cosine
}
