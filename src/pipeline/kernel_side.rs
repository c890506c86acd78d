//! The kernel's side of a job: rows of vertices and options, from the schema of the input and the settings alone.

use super::fit;
use super::layout::layout;
use super::source_facts::{confined, label, region};
use crate::config::Config;
use crate::io::ply::MeshSource;
use crate::kernel;
use crate::mesh::record::VertexSchema;
use crate::pipeline::plan::Plan;
use crate::store::cells::VertexLayout;

/// Facts of the input that the cells are simplified by.
#[derive(Clone, Debug, serde::Serialize, serde::Deserialize)]
pub(super) struct Facts {
    /// Layout of a vertex record.
    pub(super) schema: VertexSchema,
    /// Vertices of the input.
    pub(super) n_vertices: u64,
    /// Triangles of the input.
    pub(super) n_triangles: u64,
    /// Triangles wanted.
    pub(super) target: u64,
}

impl Facts {
    pub(super) fn new(source: &MeshSource, plan: &Plan) -> Facts {
        Facts {
            schema: source.schema().clone(),
            n_vertices: source.n_vertices(),
            n_triangles: plan.triangles_in,
            target: plan.target,
        }
    }
}

/// Rows of vertices in cells, and the options of the kernel.
pub(super) fn kernel_side(facts: &Facts, config: &Config) -> (VertexLayout, kernel::Options) {
    let Facts { schema, n_vertices, n_triangles, target } = facts;
    let bound = config.kernel.bound;
    let attributes = &config.attributes;
    let layout = layout(schema, (*n_vertices, *n_triangles), config);
    let channel = layout.reach_channel();
    let mut options = kernel::Options {
        confined: confined(schema, config),
        region: region(schema, config),
        label: label(schema, config),
        seam_share: attributes.weights.seam_share(),
        bound: bound.map(|bound| kernel::Bound { channel, ..bound }),
        ..config.kernel.clone()
    };
    // Whether it is worth its time is a question of the whole job, not of what the finish sees.
    fit::decide(&mut options, config, *n_triangles, *target);
    (layout, options)
}
