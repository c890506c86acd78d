//! Sums and order statistics that do not depend on the order of their terms.
//!
//! Threads, batches and cells bring samples in any order; the numbers must come out the same, bit for
//! bit. So sums are kept as integers (fixed point, 256 bits), whose addition is associative, and
//! quantiles are taken from all values.

/// Bits below the scale in fixed-point sums: the step is `scale * 2^-200`.
const FRACTION_BITS: i32 = 200;

/// A sum of non-negative terms, each at most `scale`; up to 2^47 of them.
///
/// Its step is 6e-61 of the scale: squares of distances count down to 1e-30 of the reach, so that a vertex far from all others
/// costs nothing of the rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sum {
    /// Steps, and how often they have gone through 2^128.
    low: u128,
    high: u128,
    to_steps: f64,
}

impl Sum {
    /// An empty sum; `scale` is the largest term that will come (0 if all terms are 0).
    pub fn new(scale: f64) -> Self {
        let usable = scale > 0.0 && scale.is_finite();
        let exponent = if usable { scale.log2().ceil() as i32 } else { 0 };
        Sum { low: 0, high: 0, to_steps: 2f64.powi((FRACTION_BITS - exponent).min(1000)) }
    }

    /// Adds a term. NaN counts as 0.
    #[inline]
    pub fn add(&mut self, term: f64) {
        let steps = term * self.to_steps;
        if steps >= 1.0 {
            let bits = steps.to_bits();
            let mantissa = u128::from(bits & ((1 << 52) - 1) | 1 << 52);
            let shift = ((bits >> 52) as i32 - 1075).min(FRACTION_BITS);
            match shift {
                ..0 => self.add_steps(mantissa >> -shift, 0),
                0 => self.add_steps(mantissa, 0),
                1..128 => self.add_steps(mantissa << shift, mantissa >> (128 - shift)),
                _ => self.add_steps(0, mantissa << (shift - 128)),
            }
        }
    }

    #[inline]
    fn add_steps(&mut self, low: u128, high: u128) {
        let (sum, carries) = self.low.overflowing_add(low);
        self.low = sum;
        self.high = self.high.saturating_add(high + u128::from(carries));
    }

    /// Adds another sum of the same scale.
    pub fn merge(&mut self, other: &Sum) {
        assert!(self.to_steps == other.to_steps, "sums of different scales cannot be merged");
        self.add_steps(other.low, other.high);
    }

    /// The sum.
    pub fn value(&self) -> f64 {
        (self.high as f64 * 2f64.powi(128) + self.low as f64) / self.to_steps
    }
}

/// Mean, root mean square, 99.9th percentile and maximum of a set of distances.
///
/// Memory: 8 bytes a value, for the percentile.
#[derive(Clone, Debug)]
pub struct Distances {
    values: Vec<f64>,
    sum: Sum,
    sum_sq: Sum,
}

impl Distances {
    /// An empty set; no distance will exceed `reach`.
    pub fn new(reach: f64) -> Self {
        Distances { values: Vec::new(), sum: Sum::new(reach), sum_sq: Sum::new(reach * reach) }
    }

    /// Adds one distance, given squared.
    #[inline]
    pub fn add_sq(&mut self, distance_sq: f64) {
        let distance = distance_sq.sqrt();
        self.values.push(distance);
        self.sum.add(distance);
        self.sum_sq.add(distance_sq);
    }

    /// Adds the distances of another set.
    pub fn merge(&mut self, other: &Distances) {
        self.values.extend_from_slice(&other.values);
        self.sum.merge(&other.sum);
        self.sum_sq.merge(&other.sum_sq);
    }

    /// Returns the number of distances.
    pub fn len(&self) -> u64 {
        self.values.len() as u64
    }

    /// True if there are none.
    pub fn is_empty(&self) -> bool {
        self.values.is_empty()
    }

    /// The mean; 0 without values.
    pub fn mean(&self) -> f64 {
        self.sum.value() / self.values.len().max(1) as f64
    }

    /// The root of the mean square; 0 without values.
    pub fn rms(&self) -> f64 {
        (self.sum_sq.value() / self.values.len().max(1) as f64).sqrt()
    }

    /// The largest; 0 without values.
    pub fn max(&self) -> f64 {
        self.values.iter().copied().fold(0.0, f64::max)
    }

    /// The smallest value that at least `share` of all values do not exceed (nearest rank).
    pub fn quantile(&mut self, share: f64) -> f64 {
        if self.values.is_empty() {
            return 0.0;
        }
        let rank = (share * self.values.len() as f64).ceil() as usize;
        let at = rank.clamp(1, self.values.len()) - 1;
        *self.values.select_nth_unstable_by(at, f64::total_cmp).1
    }

    /// Counts of the values in `n_bins` equal bins from 0 to `top`; larger values go into the last bin.
    pub fn histogram(&self, n_bins: usize, top: f64) -> Vec<u64> {
        let mut bins = vec![0; n_bins];
        for value in &self.values {
            let bin = if top > 0.0 { (value / top * n_bins as f64) as usize } else { 0 };
            bins[bin.min(n_bins - 1)] += 1;
        }
        bins
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_order_of_terms_does_not_show() {
        let terms: Vec<f64> = (0..10_000).map(|i| 3.7 / (1.0 + f64::from(i * i % 7919))).collect();
        let mut forward = Sum::new(4.0);
        terms.iter().for_each(|&t| forward.add(t));
        let mut backward = Sum::new(4.0);
        let (left, right) = terms.split_at(77);
        let mut rest = Sum::new(4.0);
        right.iter().rev().for_each(|&t| backward.add(t));
        left.iter().for_each(|&t| rest.add(t));
        backward.merge(&rest);
        assert_eq!(forward, backward);
        let plain: f64 = terms.iter().sum();
        assert!((forward.value() - plain).abs() < 1e-12 * plain);
    }

    #[test]
    fn small_terms_count_beside_the_largest() {
        let mut sum = Sum::new(1e55);
        (0..1000).for_each(|_| sum.add(0.25));
        assert_eq!(sum.value(), 250.0);
        sum.add(1e55);
        assert!((sum.value() / 1e55 - 1.0).abs() < 1e-15);
        // Beyond 2^128 steps, and carried from there.
        let mut many = Sum::new(1.0);
        (0..100_000).for_each(|i| many.add(if i % 2 == 0 { 1.0 } else { 1e-40 }));
        assert_eq!(many.value(), 50_000.0);
        assert!(Sum::new(1e-300).value() == 0.0);
    }

    #[test]
    fn statistics_of_known_values() {
        let mut d = Distances::new(1000.0);
        (1..=1000).for_each(|i| d.add_sq(f64::from(i * i)));
        assert_eq!(d.mean(), 500.5);
        assert_eq!(d.max(), 1000.0);
        assert_eq!(d.quantile(0.999), 999.0);
        assert_eq!(d.quantile(0.5), 500.0);
        assert!((d.rms() - (1001.0 * 2001.0 / 6.0f64).sqrt()).abs() < 1e-9);
        assert_eq!(d.histogram(2, 1000.0), [499, 501]);
        let mut empty = Distances::new(0.0);
        assert_eq!((empty.mean(), empty.rms(), empty.quantile(0.999)), (0.0, 0.0, 0.0));
        empty.add_sq(0.0);
        assert_eq!((empty.mean(), empty.max()), (0.0, 0.0));
    }
}
