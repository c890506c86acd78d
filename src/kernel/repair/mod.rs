//! Repairs a surface before and between collapses: cleans, joins, takes apart.

pub(crate) mod clean;
pub(crate) mod duplicate_triangles;
pub(crate) mod make_manifold;
pub(crate) mod orient;
pub(crate) mod pair_boundaries;
pub(crate) mod weld;
