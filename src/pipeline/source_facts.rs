//! Facts about the input: its faults for the report, the meaning of its channels for the kernel.

use crate::config::Config;
use crate::io::ply::MeshSource;
use crate::mesh::codec::ChannelKind;
use crate::mesh::record::VertexSchema;
use crate::stages::partition::Partition;
use crate::store::cells::Dropped;
use std::collections::BTreeMap;

/// Faults of the input that were dropped, by name.
pub(super) fn faults(
    source: &MeshSource,
    partition: &Partition,
    dropped: Dropped,
) -> BTreeMap<String, u64> {
    let found = source.faults();
    BTreeMap::from([
        ("degenerate_faces".to_owned(), partition.degenerate_faces),
        ("duplicate_faces".to_owned(), dropped.duplicate_faces),
        (
            "unreferenced_vertices".to_owned(),
            source.unreferenced_vertices() + dropped.unreferenced_vertices,
        ),
        ("bad_faces".to_owned(), partition.bad_faces + found.bad_faces),
        ("bad_vertices".to_owned(), found.bad_vertices),
        ("missing_faces".to_owned(), found.missing_faces),
        ("missing_vertices".to_owned(), found.missing_vertices),
    ])
}

/// Texture coordinates, and the number of their image or region, mean nothing outside of their chart.
pub(super) fn confined(schema: &VertexSchema, config: &Config) -> Vec<bool> {
    let codec = schema.kernel_codec(&config.attributes.labels);
    let image = ChannelKind::Scalar("texnumber".to_owned());
    let channel_kinds = codec.channel_kinds(schema);
    let confined =
        |m: &ChannelKind| [ChannelKind::Texture, ChannelKind::Region, image.clone()].contains(m);
    channel_kinds.iter().map(confined).collect()
}

/// The channel with the number of the region that a face belongs to.
pub(super) fn region(schema: &VertexSchema, config: &Config) -> Option<usize> {
    channel_of(&ChannelKind::Region, schema, config)
}

/// The channel with the labels of vertices.
pub(super) fn label(schema: &VertexSchema, config: &Config) -> Option<usize> {
    channel_of(&ChannelKind::Label, schema, config)
}

fn channel_of(kind: &ChannelKind, schema: &VertexSchema, config: &Config) -> Option<usize> {
    let codec = schema.kernel_codec(&config.attributes.labels);
    codec.channel_kinds(schema).iter().position(|k| k == kind)
}
