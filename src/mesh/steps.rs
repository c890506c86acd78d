//! Counts the steps of long loops, so that tests can bound work without a clock.
//!
//! Loops over the triangles of a vertex are short but at hubs, so one comparison a loop is all that the count costs elsewhere. The
//! count is the one thing that all threads of the process have in common; nothing that is computed depends on it.

use std::sync::atomic::{AtomicU64, Ordering};

/// Vertices of more triangles are hubs: what is found by a walk around other vertices is found in another way there, or not
/// looked for. Scans have none.
pub const HUB: usize = 256;

/// Loops of fewer steps are not counted.
const LEAST: usize = 64;

static TAKEN: AtomicU64 = AtomicU64::new(0);

/// Counts the steps of one loop.
#[inline(always)]
pub fn count(n: usize) {
    if n >= LEAST {
        add(n as u64);
    }
}

#[cold]
fn add(n: u64) {
    TAKEN.fetch_add(n, Ordering::Relaxed);
}

/// The steps that this process has counted so far.
pub fn taken() -> u64 {
    TAKEN.load(Ordering::Relaxed)
}
