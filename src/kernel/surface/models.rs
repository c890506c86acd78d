//! Input vertices whose values the vertices have that are made on the way: a copy has the number of one that is gone, and
//! all that is in no channel of the one that it was copied from.

use std::collections::HashMap;

/// For made vertices, of which each has its number (`Surface::source`), the input vertex that it was copied from: some 10 bytes for each.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Models(HashMap<u32, u32>);

impl Models {
    /// The input vertex whose values the vertex of this number has; of most it is this one.
    #[inline]
    pub fn of(&self, source: u32) -> u32 {
        self.0.get(&source).copied().unwrap_or(source)
    }

    /// Notes that the vertex `source` was made like another one.
    pub fn note(&mut self, source: u32, like: u32) {
        self.set(source, self.of(like));
    }

    /// Notes that the vertex `source` has the values of the input vertex `like`.
    pub(crate) fn set(&mut self, source: u32, like: u32) {
        // The number may have been that of another copy.
        if like == source {
            self.0.remove(&source);
        } else {
            self.0.insert(source, like);
        }
    }
}
