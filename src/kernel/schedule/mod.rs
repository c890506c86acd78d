//! Order of the collapses: levels, the queue, the inner loop.

pub(crate) mod drain;
pub(crate) mod driver;
mod evaluate;
mod held;
pub(crate) mod levels;
pub(crate) mod queue;
mod repeat;
mod seeds;
mod topology_changes;
mod within_bound;
