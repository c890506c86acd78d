//! Morton codes: places along a space-filling curve.

/// Puts two zero bits before each of the lowest ten bits of `x`.
pub fn spread(x: u32) -> u32 {
    let x = x & 0x3FF;
    let x = (x | x << 16) & 0x0300_00FF;
    let x = (x | x << 8) & 0x0300_F00F;
    let x = (x | x << 4) & 0x030C_30C3;
    (x | x << 2) & 0x0924_9249
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_bit_goes_to_three_times_its_place() {
        assert_eq!(spread(u32::MAX), spread(0x3FF));
        for bit in 0..10 {
            assert_eq!(spread(1 << bit), 1 << (3 * bit));
            assert_eq!(spread(0x3FF ^ 1 << bit), spread(0x3FF) ^ 1 << (3 * bit));
        }
    }
}
