//! The kernel's side of a job: rows of vertices and options, from the schema of the input and the settings alone.

use super::fit;
use crate::config::Config;
use crate::io::ply::MeshSource;
use crate::io::{Lock, SIDES};
use crate::kernel;
use crate::mesh::codec::ChannelKind;
use crate::mesh::property::{Origin, Property};
use crate::mesh::record::VertexSchema;
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
    pub(super) fn new(source: &MeshSource, target: u64) -> Facts {
        Facts {
            schema: source.schema().clone(),
            n_vertices: source.n_vertices(),
            n_triangles: source.n_triangles(),
            target,
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
        region: channel_of(&ChannelKind::Region, schema, config),
        walls: has_walls(schema),
        label: channel_of(&ChannelKind::Label, schema, config),
        seam_share: attributes.weights.seam_share(),
        bound: bound.map(|bound| kernel::Bound { channel, ..bound }),
        follow: config.map.is_some(),
        ..config.kernel.clone()
    };
    // Whether it is worth its time is a question of the whole job, not of what the finish sees.
    fit::decide(&mut options, config, *n_triangles, *target);
    (layout, options)
}

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
        is_watched: config.kernel.no_self_intersections || config.close.is_some(),
        has_origins: config.map.is_some(),
        lock: match &config.lock {
            None => None,
            Some(Lock::Boundary) => schema.lock_place(None),
            Some(Lock::Property(name)) => schema.lock_place(Some(name)),
        },
        ..VertexLayout::for_kernel(schema, n_vertices, &attributes.labels, &attributes.weights)
    }
}

/// Texture coordinates, and the number of their image or region, mean nothing outside of their chart.
fn confined(schema: &VertexSchema, config: &Config) -> Vec<bool> {
    let codec = schema.kernel_codec(&config.attributes.labels);
    let image = ChannelKind::Scalar("texnumber".to_owned());
    let channel_kinds = codec.channel_kinds(schema);
    let confined =
        |m: &ChannelKind| [ChannelKind::Texture, ChannelKind::Region, image.clone()].contains(m);
    channel_kinds.iter().map(confined).collect()
}

/// The channel of this kind: the number of a face's region, or the labels of vertices.
fn channel_of(kind: &ChannelKind, schema: &VertexSchema, config: &Config) -> Option<usize> {
    let codec = schema.kernel_codec(&config.attributes.labels);
    codec.channel_kinds(schema).iter().position(|k| k == kind)
}

/// Returns whether faces are walls with the regions on both sides: one of the two may be the same everywhere.
fn has_walls(schema: &VertexSchema) -> bool {
    let is_side = |p: &Property, name: &str| p.origin == Origin::FaceLabel && p.name == name;
    let has = |name: &str| schema.properties.iter().any(|p| is_side(p, name));
    SIDES.into_iter().any(has)
}
