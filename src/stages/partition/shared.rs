//! The last pass: vertices go to all cells that use them, and are marked there.

use super::checkpoint::{ResumePoint, Seams};
use super::halo::Halo;
use super::passes::Passes;
use stonecut_io::ply::{BLOCK_ROWS, VertexBlock};
use stonecut_mesh::global_vertex::GlobalVertex;
use stonecut_store::cells::PackWriter;
use stonecut_store::pack_format::ChunkKind;
use stonecut_system::error::{Error, Result};
use stonecut_system::parallel::in_order;

impl Passes<'_> {
    /// Copies every vertex to the foreign cells that use it, and marks it in all cells that hold it.
    ///
    /// Returns how many vertices are shared, and the one nearest to `middle`.
    pub(super) fn shared(
        &mut self,
        foreign: Halo,
        middle: [f64; 3],
        pack: &mut PackWriter,
    ) -> Result<Seams> {
        let (source, run, ids) = (self.source, self.run, self.layout.ids);
        let record_bytes = self.layout.schema.record_bytes();
        let mut rows = self.buffers(ChunkKind::Vertices);
        let mut marks = self.buffers(ChunkKind::SharedIds);
        let start = self.place;
        let first_block = (start.block as usize).min(foreign.blocks.len());
        let blocks = &foreign.blocks[first_block..];
        let first = blocks.first().map_or(u64::MAX, |block| block * BLOCK_ROWS);
        let beyond = |what: String| {
            let what = format!("a note of shared vertices names {what}; run again with --restart");
            Error::corrupt(run.job.folder(), what)
        };
        if let Some(block) = blocks.last().filter(|&&block| block >= source.n_vertex_blocks()) {
            return Err(beyond(format!("vertex {}, which is not there", block * BLOCK_ROWS)));
        }
        let mut next = foreign.from(GlobalVertex(first))?;
        let mut seams = start.seams;
        let off_sq = |place: [f64; 3]| (0..3).map(|k| (place[k] - middle[k]).powi(2)).sum::<f64>();
        let mut nearest_sq = seams.place.map_or(f64::INFINITY, off_sq);
        // A place in this pass can only be taken up with the whole list.
        let mut is_noted = start.pack_bytes > 0;
        let mut row = Vec::new();
        in_order(
            blocks.len() as u64,
            self.shares.threads,
            run.progress,
            |index, block: &mut VertexBlock| source.read_vertices(blocks[index as usize], block),
            |index, block| {
                let end = block.first + (block.records.len() / record_bytes) as u64;
                while let Some((id, _)) = next.peek()?.filter(|(id, _)| id.0 < end) {
                    let start = (id.0 - block.first) as usize * record_bytes;
                    let record =
                        block.records.get(start..start + record_bytes).ok_or_else(|| {
                            Error::bad_input(
                                source.path(),
                                format!("block {index} changed while it was read"),
                            )
                        })?;
                    let place = self.layout.schema.position(record);
                    if off_sq(place) < nearest_sq {
                        (nearest_sq, seams.place) = (off_sq(place), Some(place));
                    }
                    row.clear();
                    ids.push(id, &mut row);
                    marks.push(pack, self.tree.cell_of(place), &row)?;
                    row.extend_from_slice(record);
                    while let Some((_, cell)) = next.peek()?.filter(|(other, _)| *other == id) {
                        next.take()?;
                        if cell.0 as usize >= self.tally.len() {
                            return Err(beyond(format!("cell {cell} of {}", self.tally.len())));
                        }
                        rows.push(pack, cell, &row)?;
                        marks.push(pack, cell, &row[..ids.bytes])?;
                        self.tally[cell].vertices += 1;
                    }
                    seams.n_shared += 1;
                }
                if self.checkpoints.is_due() {
                    if !is_noted {
                        foreign.note(pack)?;
                        is_noted = true;
                    }
                    rows.flush(pack)?;
                    marks.flush(pack)?;
                    let block = first_block as u64 + index + 1;
                    self.checkpoints.seal(ResumePoint { block, seams, ..start }, pack)?;
                }
                Ok(())
            },
        )?;
        rows.finish(pack)?;
        marks.finish(pack)?;
        run.progress.add(self.share(source.n_triangles() / 8));
        Ok(seams)
    }
}
