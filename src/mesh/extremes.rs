//! Points of the original over a triangle of a simplified mesh, in a few bytes: those that say most of how far it is away.
//!
//! Rounds under a bound hand them on, so that the next one holds the bound against the original and not against what
//! the round has left. `kernel/bound` writes and reads them.

/// Up to four points, relative to the first corner of the triangle, rounded to a share of the farthest offset.
///
/// Memory: 32 bytes; disk: 29.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Extremes {
    n: u8,
    /// Largest coordinate of an offset, in input units.
    scale: f32,
    offsets: [[i16; 3]; Extremes::MOST],
}

/// Steps of an offset's coordinate to either side.
const STEPS: f32 = i16::MAX as f32;

impl Extremes {
    /// Points of one triangle.
    pub const MOST: usize = 4;
    /// Bytes on disk.
    pub const BYTES: usize = 5 + 6 * Extremes::MOST;

    /// Rounds the offsets of at most `MOST` points, in input units; of none, where one is not finite.
    pub fn new(offsets: &[[f32; 3]]) -> Extremes {
        let scale = offsets.iter().flatten().fold(0.0f32, |most, x| most.max(x.abs()));
        let is_finite = offsets.iter().flatten().all(|x| x.is_finite());
        let mut out = Extremes::default();
        if !is_finite {
            return out;
        }
        let share = if scale > 0.0 { STEPS / scale } else { 0.0 };
        out.scale = if share.is_finite() { scale } else { 0.0 };
        for (kept, offset) in out.offsets.iter_mut().zip(offsets) {
            *kept = offset.map(|x| (x * share).round() as i16);
            out.n += 1;
        }
        out
    }

    /// The offsets, in input units; each coordinate is within `rounding` of what was given.
    pub fn offsets(&self) -> impl Iterator<Item = [f32; 3]> + '_ {
        let step = self.scale / STEPS;
        let there = self.offsets.iter().take(usize::from(self.n));
        there.map(move |offset| offset.map(|x| f32::from(x) * step))
    }

    /// Largest rounding of a coordinate, in input units.
    pub fn rounding(&self) -> f32 {
        0.51 * self.scale / STEPS
    }

    /// Appends the bytes.
    pub fn push(&self, out: &mut Vec<u8>) {
        out.push(self.n);
        out.extend_from_slice(&self.scale.to_le_bytes());
        self.offsets.iter().flatten().for_each(|x| out.extend_from_slice(&x.to_le_bytes()));
    }

    /// Reads what `push` has written; missing bytes are 0.
    pub fn read(bytes: &[u8]) -> Extremes {
        let [n, rest @ ..] = bytes else { return Extremes::default() };
        let Some((scale, rest)) = rest.split_first_chunk::<4>() else {
            return Extremes::default();
        };
        let (pairs, _) = rest.as_chunks::<2>();
        let coordinate = |i: usize| pairs.get(i).map_or(0, |&pair| i16::from_le_bytes(pair));
        Extremes {
            n: (*n).min(Extremes::MOST as u8),
            scale: f32::from_le_bytes(*scale),
            offsets: std::array::from_fn(|i| std::array::from_fn(|k| coordinate(3 * i + k))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn offsets_come_back_within_the_rounding() {
        let mut state = 1u32;
        let mut next = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 23) as f32 - 1.0
        };
        for n in 0..=Extremes::MOST {
            for size in [1e-30, 1e-3, 1.0, 1e6, 1e30] {
                let given: Vec<[f32; 3]> =
                    (0..n).map(|_| std::array::from_fn(|_| size * next())).collect();
                let kept = Extremes::new(&given);
                let mut bytes = Vec::new();
                kept.push(&mut bytes);
                assert_eq!(bytes.len(), Extremes::BYTES);
                assert_eq!(Extremes::read(&bytes), kept);
                let found: Vec<[f32; 3]> = kept.offsets().collect();
                assert_eq!(found.len(), n);
                for (found, given) in found.iter().flatten().zip(given.iter().flatten()) {
                    assert!((found - given).abs() <= kept.rounding(), "{given} {found}");
                }
            }
        }
        assert_eq!(Extremes::new(&[[f32::NAN, 0.0, 0.0]]).offsets().count(), 0);
        assert_eq!(Extremes::new(&[[0.0; 3]]).offsets().next(), Some([0.0; 3]));
        assert_eq!(Extremes::read(&[]), Extremes::default());
    }
}
