//! A keyed permutation of 0..n that needs no memory: what `--shuffle` orders vertices and faces by.
//!
//! Four Feistel rounds over pairs (high, low) of a square just large enough to hold n, walked along its
//! cycle until it lands inside 0..n again. Both directions cost some ten nanoseconds.

use super::noise::hash2;

/// Rounds of the network; four make the order indistinguishable from random to a simplifier.
const ROUNDS: u64 = 4;

/// A bijection of 0..n.
#[derive(Clone, Debug)]
pub(super) struct Permutation {
    n: u64,
    /// Side of the square: side * side >= n.
    side: u64,
    key: u64,
}

impl Permutation {
    /// The permutation of 0..n that belongs to `key`.
    pub(super) fn new(n: u64, key: u64) -> Self {
        let mut side = (n as f64).sqrt() as u64;
        while side * side < n {
            side += 1;
        }
        Permutation { n, side, key }
    }

    /// Returns the position of element `element`.
    pub(super) fn apply(&self, element: u64) -> u64 {
        assert!(element < self.n, "an element of the permuted range");
        let mut at = element;
        loop {
            let (mut high, mut low) = (at / self.side, at % self.side);
            for round in 0..ROUNDS {
                (high, low) = (low, (high + self.round(round, low)) % self.side);
            }
            at = high * self.side + low;
            if at < self.n {
                return at;
            }
        }
    }

    /// Returns the element at `position`.
    pub(super) fn invert(&self, position: u64) -> u64 {
        assert!(position < self.n, "a position of the permuted range");
        let mut at = position;
        loop {
            let (mut high, mut low) = (at / self.side, at % self.side);
            for round in (0..ROUNDS).rev() {
                (high, low) = ((low + self.side - self.round(round, high)) % self.side, high);
            }
            at = high * self.side + low;
            if at < self.n {
                return at;
            }
        }
    }

    fn round(&self, round: u64, half: u64) -> u64 {
        hash2(half, self.key.wrapping_add(round)) % self.side
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_position_is_taken_once_and_can_be_traced_back() {
        for n in [1u64, 2, 3, 10, 99, 100, 101, 12_345] {
            for key in [0, 1, u64::MAX] {
                let permutation = Permutation::new(n, key);
                let mut seen = vec![false; n as usize];
                for element in 0..n {
                    let position = permutation.apply(element);
                    assert!(!std::mem::replace(&mut seen[position as usize], true));
                    assert_eq!(permutation.invert(position), element);
                }
            }
        }
    }

    #[test]
    fn the_order_has_no_runs() {
        let permutation = Permutation::new(100_000, 5);
        let neighbours = (1..100_000u64)
            .filter(|&i| permutation.apply(i).abs_diff(permutation.apply(i - 1)) < 100);
        assert!(neighbours.count() < 400, "about 200 are expected of a random order");
    }
}
