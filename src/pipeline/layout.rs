//! Rows of vertices and triangles in the cells of a run, from the schema of the input and the settings.

use super::fit;
use crate::config::Config;
use crate::io::Lock;
use crate::mesh::record::VertexSchema;
use crate::store::cells::VertexLayout;

/// The layout for simplifying an input of this many vertices and triangles.
pub(super) fn layout(
    schema: &VertexSchema,
    (n_vertices, n_triangles): (u64, u64),
    config: &Config,
) -> VertexLayout {
    let attributes = &config.attributes;
    VertexLayout {
        has_reach: config.kernel.bound.is_some(),
        has_relief: fit::carries_relief(config, n_triangles),
        is_watched: config.kernel.no_self_intersections,
        lock: match &config.lock {
            None => None,
            Some(Lock::Boundary) => schema.lock_place(None),
            Some(Lock::Property(name)) => schema.lock_place(Some(name)),
        },
        ..VertexLayout::for_kernel(schema, n_vertices, &attributes.labels, &attributes.weights)
    }
}
