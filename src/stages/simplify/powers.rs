//! Logarithm and power of two from additions, multiplications and divisions alone.
//!
//! Those of a C library may differ in the last bit from machine to machine. Processes that find the thresholds of a round
//! each by itself, from the same counts, must find the same ones.

use std::f64::consts::{LN_2, SQRT_2};

/// The logarithm to the base of 2 of a finite number that is at least 1. The error is a few units in the last place.
pub(super) fn log2(x: f64) -> f64 {
    const FRACTION: u64 = (1 << 52) - 1;
    let exponent = (x.to_bits() >> 52) as i32 - 1023;
    let fraction = f64::from_bits(x.to_bits() & FRACTION | 1023 << 52);
    let (exponent, fraction) = match fraction > SQRT_2 {
        true => (exponent + 1, fraction / 2.0),
        false => (exponent, fraction),
    };
    // ln m = 2 artanh((m - 1) / (m + 1)), of which the argument is at most 0.172.
    let s = (fraction - 1.0) / (fraction + 1.0);
    let series = (0..13).rev().fold(0.0, |sum, k| sum * s * s + 1.0 / f64::from(2 * k + 1));
    f64::from(exponent) + 2.0 * s * series / LN_2
}

/// 2 to the power of a number between -1000 and 1000.
pub(super) fn exp2(x: f64) -> f64 {
    let whole = x.round();
    let rest = (x - whole) * LN_2;
    let series = (1..19).rev().fold(1.0, |sum, k| 1.0 + sum * rest / f64::from(k));
    series * f64::from_bits(((whole as i64 + 1023) as u64) << 52)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn they_agree_with_those_of_the_library() {
        for k in 0..20_000 {
            let x = 1.0 + f64::from(k) * f64::from(k) * 37.013;
            let near = 4e-16 * x.log2().max(1.0);
            assert!((log2(x) - x.log2()).abs() <= near, "{x}: {} {}", log2(x), x.log2());
            let y = f64::from(k) / 1000.0 - 10.0;
            assert!((exp2(y) / y.exp2() - 1.0).abs() <= 1e-15, "{y}");
        }
        assert_eq!([log2(1.0), log2(2.0), log2(1024.0)], [0.0, 1.0, 10.0]);
        assert_eq!([exp2(0.0), exp2(-1.0), exp2(7.0)], [1.0, 0.5, 128.0]);
    }
}
