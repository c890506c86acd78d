//! Records of single vertices, mostly asked for in order: the block of the last one is at hand.

use super::{BLOCK_ROWS, MeshSource, VertexBlock};
use stonecut_mesh::vec3::Vec3;
use stonecut_system::error::Result;

/// Records of the vertices of a source.
pub struct VertexRecords<'a> {
    source: &'a MeshSource,
    block: VertexBlock,
    loaded: Option<u64>,
}

impl<'a> VertexRecords<'a> {
    /// Reads nothing yet.
    pub fn new(source: &'a MeshSource) -> VertexRecords<'a> {
        VertexRecords { source, block: VertexBlock::default(), loaded: None }
    }

    /// The source.
    pub fn source(&self) -> &'a MeshSource {
        self.source
    }

    /// Returns whether the block of a vertex is at hand.
    pub fn has(&self, vertex: u64) -> bool {
        self.loaded == Some(vertex / BLOCK_ROWS)
    }

    /// The record of a vertex that is there.
    pub fn get(&mut self, vertex: u64) -> Result<&[u8]> {
        let n_bytes = self.source.schema().record_bytes();
        Ok(&self.from(vertex)?[..n_bytes])
    }

    /// The position of a vertex that is there.
    pub fn position(&mut self, vertex: u64) -> Result<Vec3> {
        let schema = self.source.schema();
        Ok(schema.position(self.get(vertex)?))
    }

    /// The records of a vertex and of those behind it in its block.
    pub fn from(&mut self, vertex: u64) -> Result<&[u8]> {
        if !self.has(vertex) {
            self.loaded = None;
            self.source.read_vertices(vertex / BLOCK_ROWS, &mut self.block)?;
            self.loaded = Some(vertex / BLOCK_ROWS);
        }
        let at = (vertex % BLOCK_ROWS) as usize * self.source.schema().record_bytes();
        Ok(&self.block.records[at..])
    }
}
