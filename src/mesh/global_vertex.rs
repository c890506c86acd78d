//! The number of a vertex in a whole mesh, as a type: it survives all cutting and joining.
//!
//! Numbers of vertices within a cell are `u32`, as the kernel has them (docs/design/house.md).

use std::fmt;

/// The number of a vertex in the input, from 0 on, in all rounds and in the tiles of a tree.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(transparent)]
pub struct GlobalVertex(pub u64);

impl GlobalVertex {
    /// The vertex of a mesh in memory, whose numbers have 32 bits.
    #[inline]
    pub fn in_memory(number: u32) -> GlobalVertex {
        GlobalVertex(number.into())
    }

    /// Its number in a mesh in memory. Panics beyond 2^32.
    #[inline]
    pub fn narrow(self) -> u32 {
        u32::try_from(self.0).expect("a mesh in memory has fewer than 2^32 vertices")
    }
}

impl fmt::Display for GlobalVertex {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(out)
    }
}
