//! Places an open mesh: looks at all positions once, and notes what becomes of them as they leave the reader. Takes it out of a
//! folder that vanishes.

use super::VertexBlock;
use super::placed::Placed;
use super::raw::Spool;
use super::source::MeshSource;
use std::path::{Path, PathBuf};
use std::sync::Arc;
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

    /// Takes what the mesh names out of a folder that is going to vanish; `name` is what the folder is known by.
    ///
    /// Errors: an image that cannot be read, temporary data that cannot be written.
    pub(crate) fn leave_folder(&mut self, folder: &Path, name: &Path, spool: Spool) -> Result<()> {
        self.file.leave_folder(folder, name);
        self.staged.beside.clear();
        let (from, to) = (folder.to_string_lossy(), name.to_string_lossy());
        self.staged.losses.rename(&from, &to);
        self.staged.notes.iter_mut().for_each(|note| note.rename(&from, &to));
        if let Some(materials) = &mut self.staged.materials {
            Arc::make_mut(materials).leave_folder(folder, name, spool)?;
        }
        Ok(())
    }
}
