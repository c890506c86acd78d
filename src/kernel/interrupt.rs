//! A request to stop, looked at between levels and every few thousand collapses.
//!
//! A flag and no more: who raises it, and when, is outside. An interrupted mesh is whole but not simplified
//! as asked; whoever raised the flag drops it.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Batches of eight edges between two looks of the inner loop at the flag: at most 4,096 collapses, about a
/// millisecond.
pub(crate) const BATCHES_BETWEEN_LOOKS: u32 = 512;

/// A flag that asks a running call of the kernel to return early; by default there is none.
///
/// All are equal to each other: whether a call can be stopped does not belong to what it computes.
#[derive(Clone, Debug, Default)]
pub struct Interrupt(Option<Arc<AtomicBool>>);

impl Interrupt {
    /// Stops once `flag` is true.
    pub fn when(flag: Arc<AtomicBool>) -> Interrupt {
        Interrupt(Some(flag))
    }

    /// True if the flag was raised.
    #[inline]
    pub fn is_raised(&self) -> bool {
        self.0.as_ref().is_some_and(|flag| flag.load(Ordering::Relaxed))
    }
}

impl PartialEq for Interrupt {
    fn eq(&self, _: &Interrupt) -> bool {
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Fit, Options, Stop, simplify_mesh};
    use stonecut_mesh::Mesh;

    /// A wavy sheet of `n` by `n` quads, large enough for levels.
    fn sheet(n: u32) -> Mesh {
        let wave = |i: u32| f64::from(i % (n + 1)) * 0.7;
        let place = |i: u32| [wave(i), f64::from(i / (n + 1)), wave(i).sin()];
        let positions = (0..(n + 1) * (n + 1)).map(place).collect();
        let quad = |q: u32| {
            let a = q / n * (n + 1) + q % n;
            [[a, a + 1, a + n + 2], [a, a + n + 2, a + n + 1]]
        };
        Mesh::new(positions, (0..n * n).flat_map(quad).collect())
    }

    #[test]
    fn a_raised_flag_ends_every_kind_of_call_and_a_lowered_one_changes_nothing() {
        let mesh = sheet(160);
        let locked = vec![false; mesh.positions.len()];
        let n = mesh.triangles.len();
        for stop in [
            Stop::Triangles(500),
            Stop::Costs(vec![1e-3, 1e-1, 10.0]),
            Stop::CloseCosts(vec![1e-3, 2e-3]),
        ] {
            let plain = Options { stop, fit: Fit::On, ..Options::default() };
            let flag = Arc::new(AtomicBool::new(false));
            let options = Options { interrupt: Interrupt::when(flag.clone()), ..plain.clone() };
            assert_eq!(options, plain);
            let whole = simplify_mesh(mesh.clone(), &locked, &plain);
            assert!(!whole.statistics.interrupted && whole.mesh.triangles.len() < n / 2);
            assert_eq!(simplify_mesh(mesh.clone(), &locked, &options), whole);
            flag.store(true, Ordering::Relaxed);
            let left = simplify_mesh(mesh.clone(), &locked, &options);
            assert!(left.statistics.interrupted && !left.statistics.reached);
            // At most what the inner loop does between two looks.
            assert!(left.mesh.triangles.len() > n - 2 * 8 * BATCHES_BETWEEN_LOOKS as usize);
        }
    }
}
