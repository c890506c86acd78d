//! Meshes on disk: opened and checked once, read block by block, written whole or not at all.
//!
//! A `MeshSource` gives random access to blocks of vertices and faces, from any thread, however the file
//! is laid out; whatever has no fixed record size gets an index of block offsets first. Nothing behind
//! this module ever sees a dialect.

use crate::error::Result;
use crate::schema::VertexSchema;
use std::path::Path;

/// Vertices or faces in one block.
pub const BLOCK_ROWS: u64 = 65_536;

/// A block of vertices: packed records after `VertexSchema`, every coordinate finite.
#[derive(Default)]
pub struct VertexBlock {
    /// Id of the first vertex.
    pub first: u64,
    /// `record_bytes` bytes a vertex.
    pub records: Vec<u8>,
}

/// A block of faces as triangles; every index is below the number of vertices.
#[derive(Default)]
pub struct FaceBlock {
    /// Row of the first face record in the file.
    pub first_row: u64,
    /// Corner ids. Faces with repeated corners are left out.
    pub triangles: Vec<[u64; 3]>,
    /// Faces left out because a corner repeats or there are fewer than three.
    pub n_degenerate: u64,
}

/// A mesh file whose header has been read and held against the file's length.
pub struct MeshSource {}

impl MeshSource {
    /// Opens a file and checks its header.
    pub fn open(_path: &Path) -> Result<Self> {
        Ok(MeshSource {})
    }
    /// What a vertex record holds.
    pub fn schema(&self) -> &VertexSchema {
        unimplemented!()
    }
    /// Number of vertices.
    pub fn n_vertices(&self) -> u64 {
        0
    }
    /// Number of face records (a polygon counts once).
    pub fn n_faces(&self) -> u64 {
        0
    }
    /// Number of vertex blocks.
    pub fn n_vertex_blocks(&self) -> u64 {
        self.n_vertices().div_ceil(BLOCK_ROWS)
    }
    /// Number of face blocks.
    pub fn n_face_blocks(&self) -> u64 {
        self.n_faces().div_ceil(BLOCK_ROWS)
    }
    /// Reads and checks one block of vertices; callable from any thread. Reuses `block`'s memory.
    pub fn read_vertices(&self, _index: u64, _block: &mut VertexBlock) -> Result<()> {
        Ok(())
    }
    /// Reads and checks one block of faces; callable from any thread. Reuses `block`'s memory.
    pub fn read_faces(&self, _index: u64, _block: &mut FaceBlock) -> Result<()> {
        Ok(())
    }
}
