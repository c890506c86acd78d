//! Shared parts of the passes over the input; the pass over the vertices, and windows of their cells.

use super::cell_table::CellTable;
use super::checkpoint::{Checkpoints, Pass, ResumePoint};
use super::memory::Shares;
use super::sorted::Sorted;
use crate::error::Result;
use crate::io::ply::{BLOCK_ROWS, MeshSource};
use crate::store::cells::{CellMap, CellTally, PackWriter, Scatter, VertexLayout};
use crate::store::pack_format::ChunkKind;
use crate::store::stage_context::StageContext;
use crate::system::parallel::in_order;

/// The passes over the input, and how far they are.
pub(super) struct Passes<'a> {
    pub(super) source: &'a MeshSource,
    pub(super) run: &'a StageContext<'a>,
    pub(super) layout: VertexLayout,
    pub(super) tree: CellMap,
    pub(super) tally: Vec<CellTally>,
    pub(super) shares: Shares,
    /// Vertices whose cells a table may hold.
    pub(super) window_rows: u64,
    /// Position of the passes, or where they continue.
    pub(super) place: ResumePoint,
    pub(super) checkpoints: Checkpoints<'a>,
}

impl Passes<'_> {
    pub(super) fn buffers(&self, kind: ChunkKind) -> Scatter {
        Scatter::new(kind, self.tree.n_cells(), self.shares.buffer_bytes)
    }

    /// Sends every vertex to the cell of its position.
    pub(super) fn vertices(&mut self, pack: &mut PackWriter) -> Result<CellTable> {
        let first_block = self.place.block;
        let window = self.window_rows;
        let known = (first_block * BLOCK_ROWS).min(window);
        let mut table = self.window(0, known)?;
        table.reserve(window - known);
        let (source, run, tree, ids) = (self.source, self.run, &self.tree, self.layout.ids);
        let n_cells = tree.n_cells();
        let record_bytes = self.layout.schema.record_bytes();
        let row_bytes = ids.bytes + record_bytes;
        let mut scatter = self.buffers(ChunkKind::Vertices);
        let (schema, tally, checkpoints) =
            (&self.layout.schema, &mut self.tally, &mut self.checkpoints);
        in_order(
            source.n_vertex_blocks() - first_block,
            self.shares.threads,
            run.progress,
            |index, out: &mut Sorted| {
                let mut block = std::mem::take(&mut out.vertices);
                source.read_vertices(first_block + index, &mut block)?;
                out.cells.clear();
                let records = block.records.chunks_exact(record_bytes);
                let mut finder = tree.finder();
                out.cells.extend(records.map(|record| finder.cell_of(schema.position(record))));
                out.sort(n_cells, row_bytes, |i, row| {
                    let id = block.first + i as u64;
                    row[..ids.bytes].copy_from_slice(&id.to_le_bytes()[..ids.bytes]);
                    row[ids.bytes..]
                        .copy_from_slice(&block.records[i * record_bytes..(i + 1) * record_bytes]);
                });
                out.vertices = block;
                Ok(())
            },
            |index, sorted| {
                // Windows are whole blocks.
                if table.len() < window {
                    table.extend(&sorted.cells);
                }
                for &(cell, n_rows) in &sorted.runs {
                    tally[cell].vertices += u64::from(n_rows);
                }
                sorted.push_runs(row_bytes, &mut scatter, pack)?;
                if checkpoints.is_due() {
                    scatter.flush(pack)?;
                    let block = first_block + index + 1;
                    checkpoints.seal(ResumePoint { block, ..ResumePoint::default() }, pack)?;
                }
                Ok(())
            },
        )?;
        scatter.finish(pack)?;
        run.progress.add(source.n_triangles() / 4);
        self.place =
            ResumePoint { pass: Pass::Triangles, window: [0, window], ..ResumePoint::default() };
        Ok(table)
    }

    /// Cells of `rows` vertices from `first` on, the beginning of a block.
    pub(super) fn window(&self, first: u64, rows: u64) -> Result<CellTable> {
        let (source, run, tree) = (self.source, self.run, &self.tree);
        let record_bytes = self.layout.schema.record_bytes();
        let mut table = CellTable::new(first, rows, tree.n_cells());
        in_order(
            rows.div_ceil(BLOCK_ROWS),
            self.shares.threads,
            run.progress,
            |index, out: &mut Sorted| {
                source.read_vertices(first / BLOCK_ROWS + index, &mut out.vertices)?;
                out.cells.clear();
                let records = out.vertices.records.chunks_exact(record_bytes);
                let mut finder = tree.finder();
                let cells = records.map(|r| finder.cell_of(self.layout.schema.position(r)));
                out.cells.extend(cells);
                Ok(())
            },
            |_, block| {
                table.extend(&block.cells);
                Ok(())
            },
        )?;
        Ok(table)
    }
}
