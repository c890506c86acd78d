//! The original over a triangle of a simplified mesh: its mean height above each corner, as numbers of two bytes.
//!
//! Rounds hand it on, so that the next fit aims at the original and not at what the round has left. It moves nothing;
//! `kernel/fit` writes and reads it.

/// Heights of the original above the three corners of a triangle, linear in between, in units of the root of twice the
/// triangle's area: signed, along the normal, 8 bits of precision.
///
/// Memory and disk: 6 bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Relief([u16; 3]);

impl Relief {
    /// Bytes on disk.
    pub const BYTES: usize = 6;

    /// Rounds heights; what is not finite becomes 0.
    pub fn new(heights: [f32; 3]) -> Relief {
        Relief(heights.map(|height| {
            let bits = height.to_bits();
            // To the nearest, ties to even.
            let rounded = ((u64::from(bits) + 0x7fff + u64::from(bits >> 16 & 1)) >> 16) as u16;
            let is_finite = rounded & 0x7f80 != 0x7f80;
            if is_finite { rounded } else { 0 }
        }))
    }

    /// The heights.
    pub fn heights(self) -> [f32; 3] {
        self.0.map(|bits| f32::from_bits(u32::from(bits) << 16))
    }

    /// Heights over the triangle turned over: its second and third corner change places.
    pub fn turned(self) -> Relief {
        let [a, b, c] = self.heights();
        Relief::new([-a, -c, -b])
    }

    /// Appends the bytes.
    pub fn push(self, out: &mut Vec<u8>) {
        self.0.iter().for_each(|bits| out.extend_from_slice(&bits.to_le_bytes()));
    }

    /// Reads what `push` has written; missing bytes are 0.
    pub fn read(bytes: &[u8]) -> Relief {
        let (pairs, _) = bytes.as_chunks::<2>();
        Relief(std::array::from_fn(|k| pairs.get(k).map_or(0, |&pair| u16::from_le_bytes(pair))))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn heights_are_kept_to_eight_bits() {
        for height in [0.0, 1.0, -1.0, 0.3, -1e-20, 7.7e30, 1.0 + 1.0 / 256.0] {
            let kept = Relief::new([height, -height, 2.0 * height]).heights();
            for (kept, given) in kept.into_iter().zip([height, -height, 2.0 * height]) {
                assert!((kept - given).abs() <= given.abs() / 256.0, "{given} {kept}");
            }
        }
        let lost = Relief::new([f32::NAN, f32::INFINITY, f32::MAX]).heights();
        assert_eq!(lost, [0.0; 3]);
    }

    #[test]
    fn bytes_come_back() {
        let relief = Relief::new([0.5, -3.0, 1e-9]);
        let mut bytes = Vec::new();
        relief.push(&mut bytes);
        assert_eq!(bytes.len(), Relief::BYTES);
        assert_eq!(Relief::read(&bytes), relief);
        assert_eq!(Relief::read(&[]), Relief::default());
    }
}
