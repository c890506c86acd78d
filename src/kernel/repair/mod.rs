//! Repairs a surface before and between collapses: cleans, joins, takes apart.

pub(crate) mod clean;
pub(crate) mod close;
mod curves;
pub(crate) mod make_manifold;
pub(crate) mod pair_boundaries;
pub(crate) mod weld;
