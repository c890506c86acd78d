//! Places an open mesh: looks at all positions once, and notes what becomes of them as they leave the reader.

use super::VertexBlock;
use super::placed::Placed;
use super::source::MeshSource;
use std::path::PathBuf;
use stonecut_mesh::bounds::Bounds;
use stonecut_mesh::placing::{Placing, offset_in};
use stonecut_system::error::Result;

impl MeshSource {
    /// A position of the file where it comes to lie.
    pub fn placed_point(&self, position: [f64; 3]) -> [f64; 3] {
        self.placed.as_ref().map_or(position, |placed| placed.point(position))
    }

    /// Places the mesh. Where the placing changes something, all vertices are read once for their bounds.
    ///
    /// Errors: those of reading; places that are not finite.
    pub fn place(&mut self, placing: &Placing) -> Result<()> {
        if placing.is_none() {
            return Ok(());
        }
        let schema = self.schema().clone();
        let (mut bounds, mut block) = (Bounds::EMPTY, VertexBlock::default());
        for index in 0..self.n_vertex_blocks() {
            self.read_vertices(index, &mut block)?;
            let records = block.records.chunks_exact(schema.record_bytes());
            records.for_each(|row| bounds.add(placing.point(schema.position(row))));
        }
        let Some(placed) = Placed::new(placing, schema, &bounds, self.comments()) else {
            return Err(self.file.bad(
                "its coordinates are not finite once it is placed; give a smaller --scale, --translate or --transform",
            ));
        };
        self.placed = Some(placed);
        Ok(())
    }

    /// Adds comments on the place of the mesh, out of files beside it.
    pub(crate) fn take_place(&mut self, comments: Vec<String>, files: &[PathBuf]) {
        self.header.comments.extend(comments);
        self.staged.beside.extend_from_slice(files);
    }

    /// The offset that was subtracted from the coordinates of the input, now or before, or that files beside it name.
    pub fn offset(&self) -> Option<[f64; 3]> {
        offset_in(self.comments())
    }
}
