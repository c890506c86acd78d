//! Set of blocks of rows of one size all of whose list counts have been checked.
//!
//! A block that begins between two rows can still look right: a corner that reads 3 where a count belongs.
//! Rows are where they seem to be only if all rows before them are; this keeps account of that, for blocks
//! read in any order by any thread.

use std::collections::BTreeSet;
use std::sync::{Mutex, PoisonError};

/// Blocks whose rows were all found to be of the fixed layout.
#[derive(Debug, Default)]
pub struct Checked(Mutex<State>);

#[derive(Debug, Default)]
struct State {
    /// All blocks below this one are checked.
    below: u64,
    /// Checked blocks beyond it; as many as are read out of order.
    beyond: BTreeSet<u64>,
}

impl Checked {
    /// Notes a block all of whose rows are of the layout.
    pub fn add(&self, block: u64) {
        let mut state = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if block >= state.below {
            state.beyond.insert(block);
        }
        while state.beyond.first() == Some(&state.below) {
            state.beyond.pop_first();
            state.below += 1;
        }
    }

    /// The first block below `block` that is not checked yet.
    pub fn gap_before(&self, block: u64) -> Option<u64> {
        let below = self.0.lock().unwrap_or_else(PoisonError::into_inner).below;
        (below < block).then_some(below)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_gap_is_named_until_it_is_closed() {
        let checked = Checked::default();
        let gap_after = |added: u64, before: u64| {
            checked.add(added);
            checked.gap_before(before)
        };
        assert_eq!(checked.gap_before(0), None);
        assert_eq!(checked.gap_before(3), Some(0));
        assert_eq!(gap_after(0, 0), None);
        assert_eq!(gap_after(3, 3), Some(1));
        assert_eq!(gap_after(1, 3), Some(2));
        assert_eq!(gap_after(2, 4), None);
        assert_eq!(gap_after(5, 6), Some(4));
        assert_eq!(gap_after(1, 4), None);
        assert_eq!(gap_after(4, 6), None);
    }
}
