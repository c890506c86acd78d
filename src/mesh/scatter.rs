//! Numbers scattered over all 64 bits: hashes of numbers, the same on every machine.

/// The finaliser of SplitMix64 (Steele, Lea & Flood 2014).
#[inline(always)]
pub fn mix(mut x: u64) -> u64 {
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

/// A well-mixed hash of one number: a round of SplitMix64.
#[inline]
pub fn hash(value: u64) -> u64 {
    mix(value.wrapping_add(0x9e37_79b9_7f4a_7c15))
}

/// The hash as a value in [0, 1), from its upper bits.
#[inline]
pub fn unit(hash: u64) -> f64 {
    (hash >> 11) as f64 / (1u64 << 53) as f64
}
