//! Order of the collapses: levels, the queue, the inner loop.

pub(crate) mod drain;
pub(crate) mod levels;
pub(crate) mod queue;
pub(crate) mod stepwise;
