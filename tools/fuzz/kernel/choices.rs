//! Decisions for the generator: from a seed, or from the bytes that a fuzzer gives.

/// A stream of numbers.
pub struct Choices<'a> {
    state: u64,
    bytes: Option<&'a [u8]>,
}

impl<'a> Choices<'a> {
    /// An endless stream (splitmix64).
    pub fn from_seed(seed: u64) -> Self {
        Choices { state: seed.wrapping_mul(0x2545_F491_4F6C_DD1D) ^ 0x9E37_79B9, bytes: None }
    }

    /// The bytes two by two, then zeros: the plainest choices.
    pub fn from_bytes(bytes: &'a [u8]) -> Self {
        Choices { state: 0, bytes: Some(bytes) }
    }

    fn next(&mut self) -> u64 {
        if let Some(bytes) = &mut self.bytes {
            let (first, rest) = bytes.split_at(bytes.len().min(2));
            *bytes = rest;
            return first.iter().rev().fold(0, |sum, &byte| sum << 8 | u64::from(byte));
        }
        self.state = self.state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.state;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        (z ^ (z >> 31)) & 0xFFFF_FFFF
    }

    /// A number less than `n`, which is not 0.
    pub fn below(&mut self, n: usize) -> usize {
        (self.next() % n.max(1) as u64) as usize
    }

    /// A number of a range, its end excluded.
    pub fn within(&mut self, range: std::ops::Range<usize>) -> usize {
        range.start + self.below(range.end - range.start)
    }

    /// True once in `n` times; never once a fuzzer's bytes are used up.
    pub fn one_in(&mut self, n: usize) -> bool {
        self.below(n) == n - 1
    }

    /// A number from 0 up to 1, in steps of 1/1024.
    pub fn unit(&mut self) -> f64 {
        self.below(1024) as f64 / 1024.0
    }

    /// One of several.
    pub fn of<T: Copy>(&mut self, list: &[T]) -> T {
        list[self.below(list.len())]
    }
}
