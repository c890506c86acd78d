//! A source as a whole in memory, and the records of the vertices that a result keeps something of.

use std::collections::BTreeMap;
use stonecut_io::ply::{MeshSource, VertexRecords};
use stonecut_measure::load::{Loaded, load_with};
use stonecut_mesh::codec::VertexCodec;
use stonecut_mesh::duplicate_triangles::drop_repeats;
use stonecut_mesh::orient::{TRIANGLE_BYTES, orient};
use stonecut_mesh::vec3::Vec3;
use stonecut_system::error::Result;
use stonecut_system::progress::Progress;

/// Positions in input units, triangles, and faults that were left out.
pub(super) struct LoadedMesh {
    pub(super) positions: Vec<Vec3>,
    pub(super) triangles: Vec<[u32; 3]>,
    pub(super) faults: BTreeMap<String, u64>,
}

/// Bytes that `load` takes for a source: the mesh, and what turning triangles over needs beside it. That is more than finding
/// repeated ones needs, which comes before.
pub(super) fn load_bytes(source: &MeshSource) -> u64 {
    24 * source.n_vertices() + (12 + TRIANGLE_BYTES) * source.n_triangles()
}

/// Reads all vertices and triangles; these must be few enough for 32-bit numbers. Repeated triangles are dropped, and those that
/// disagree with most of their component turned over.
pub(super) fn load(source: &MeshSource, progress: &Progress) -> Result<LoadedMesh> {
    let Loaded { mesh, n_degenerate, n_bad, .. } = load_with(source, None, 1, progress)?;
    let (positions, mut triangles) = (mesh.positions, mesh.triangles);
    let repeats = drop_repeats(&mut triangles);
    orient(&mut triangles, positions.len(), |_| false);
    let faults = BTreeMap::from([
        ("degenerate_faces".to_owned(), n_degenerate),
        ("duplicate_faces".to_owned(), repeats.triangles.len() as u64),
        ("back_faces".to_owned(), repeats.backs),
        ("bad_faces".to_owned(), n_bad),
    ]);
    Ok(LoadedMesh { positions, triangles, faults })
}

/// Channels of all vertices, one after another.
pub(super) fn load_channels(
    source: &MeshSource,
    codec: &VertexCodec,
    progress: &Progress,
) -> Result<Vec<f32>> {
    let n_channels = codec.n_channels();
    let mut channels = vec![0.0; n_channels * source.n_vertices() as usize];
    for_records(source, progress, |vertex, record| {
        let at = vertex as usize * n_channels;
        codec.decode_channels(record, &mut channels[at..at + n_channels]);
    })?;
    Ok(channels)
}

/// The records of these vertices, in their order; one may be named often.
pub(super) fn records_of(
    source: &MeshSource,
    vertices: &[u32],
    progress: &Progress,
) -> Result<Vec<u8>> {
    let record_bytes = source.schema().record_bytes();
    let mut wanted: Vec<(u32, u32)> = vertices.iter().copied().zip(0..).collect();
    wanted.sort_unstable();
    let mut records = vec![0; record_bytes * vertices.len()];
    let mut of_source = VertexRecords::new(source);
    for (vertex, number) in wanted {
        if !of_source.has(u64::from(vertex)) {
            progress.check()?;
        }
        let at = number as usize * record_bytes;
        records[at..at + record_bytes].copy_from_slice(of_source.get(u64::from(vertex))?);
    }
    Ok(records)
}

/// Gives the record of every vertex, in order.
pub(super) fn for_records(
    source: &MeshSource,
    progress: &Progress,
    mut take: impl FnMut(u64, &[u8]),
) -> Result<()> {
    let record_bytes = source.schema().record_bytes();
    source.each_vertex_block(|block| {
        let records = (block.first..).zip(block.records.chunks_exact(record_bytes));
        records.for_each(|(vertex, record)| take(vertex, record));
        progress.check()
    })
}
