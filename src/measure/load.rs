//! Reads a whole mesh file into memory, for meshes that fit.
//!
//! Memory: that of `Mesh`; nothing else that grows with the file.

use super::Carried;
use stonecut_io::ply::{FaceBlock, MeshSource, VertexBlock};
use stonecut_mesh::Mesh;
use stonecut_mesh::codec::VertexCodec;
use stonecut_mesh::topology_counts::{self, Topology};
use stonecut_system::error::{Error, Result};
use stonecut_system::parallel;
use stonecut_system::progress::Progress;

/// A mesh in memory and what its file says about it.
#[derive(Clone, Debug, Default)]
pub struct Loaded {
    /// The mesh, in input units, with its carried properties as channels.
    pub mesh: Mesh,
    /// Channels with its colours.
    pub colours: Option<Carried>,
    /// Faces left out because a corner repeats or there are fewer than three.
    pub n_degenerate: u64,
    /// Faces left out because of a fault in the file.
    pub n_bad: u64,
}

/// Bytes that `load` takes for a file.
pub fn bytes_in_memory(source: &MeshSource) -> u64 {
    let a_vertex = 24 + 4 * source.schema().n_channels() as u64;
    source.n_vertices().saturating_mul(a_vertex) + source.n_triangles().saturating_mul(12)
}

/// Reads a whole file; its blocks are decoded by `threads` threads.
pub fn load(source: &MeshSource, threads: usize, progress: &Progress) -> Result<Loaded> {
    load_with(source, Some(&source.schema().codec()), threads, progress)
}

/// Reads a whole file with the channels of `codec`; without it, positions and triangles alone.
pub fn load_with(
    source: &MeshSource,
    codec: Option<&VertexCodec>,
    threads: usize,
    progress: &Progress,
) -> Result<Loaded> {
    if u32::try_from(source.n_vertices()).is_err() {
        return Err(Error::bad_input(
            source.path(),
            format!("{} vertices are too many for one mesh in memory", source.n_vertices()),
        ));
    }
    let schema = source.schema();
    let n_channels = codec.map_or(0, VertexCodec::n_channels);
    let record_bytes = schema.record_bytes();
    let mut mesh = Mesh { n_channels, ..Mesh::default() };
    mesh.positions.reserve_exact(source.n_vertices() as usize);
    mesh.channels.reserve_exact(source.n_vertices() as usize * n_channels);
    parallel::in_order(
        source.n_vertex_blocks(),
        threads,
        progress,
        |index, block: &mut VertexBlock| source.read_vertices(index, block),
        |_, block| {
            for record in block.records.chunks_exact(record_bytes) {
                mesh.positions.push(schema.position(record));
                if let Some(codec) = codec {
                    let start = mesh.channels.len();
                    mesh.channels.resize(start + n_channels, 0.0);
                    codec.decode_channels(record, &mut mesh.channels[start..]);
                }
            }
            Ok(())
        },
    )?;
    let (mut n_degenerate, mut n_bad) = (0, 0);
    mesh.triangles.reserve_exact(source.n_triangles() as usize);
    parallel::in_order(
        source.n_face_blocks(),
        threads,
        progress,
        |index, block: &mut FaceBlock| source.read_faces(index, block),
        |_, block| {
            // Indices are below the number of vertices, which fits: see above.
            mesh.triangles.extend(block.triangles.iter().map(|t| t.map(|v| v as u32)));
            n_degenerate += block.n_degenerate;
            n_bad += block.n_bad;
            Ok(())
        },
    )?;
    Ok(Loaded { mesh, colours: Carried::of(schema), n_degenerate, n_bad })
}

/// The topology of a loaded mesh, with the faces that were left out.
pub fn topology_of(loaded: &Loaded) -> Topology {
    let mut topology =
        topology_counts::of_triangles(loaded.mesh.positions.len(), &loaded.mesh.triangles);
    topology.triangles += loaded.n_degenerate;
    topology.degenerate_triangles += loaded.n_degenerate;
    topology
}
