//! Shared parts of the passes over the input; the pass over the vertices, and windows of their cells.

use super::cell_table::{CellTable, Room};
use super::checkpoint::{Checkpoints, Pass, ResumePoint};
use super::memory::Shares;
use super::sorted::Sorted;
use crate::error::{Error, Result};
use crate::io::ply::{BLOCK_ROWS, MeshSource};
use crate::store::cells::{CellMap, CellTally, PackWriter, Scatter, VertexLayout};
use crate::store::pack_format::ChunkKind;
use crate::store::stage_context::StageContext;
use crate::system::parallel::in_order;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

/// The passes over the input, and how far they are.
pub(super) struct Passes<'a> {
    pub(super) source: &'a MeshSource,
    pub(super) run: &'a StageContext<'a>,
    pub(super) layout: VertexLayout,
    pub(super) tree: CellMap,
    pub(super) tally: Vec<CellTally>,
    pub(super) shares: Shares,
    /// Folder for a table that exceeds its memory, if pages of it serve.
    pub(super) table_folder: Option<&'a Path>,
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
        let mut table = self.table(0, self.source.n_vertices());
        self.extend(&mut table, first_block * BLOCK_ROWS)?;
        let is_packed = table.is_packed();
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
                if is_packed {
                    out.pack_cells();
                }
                out.vertices = block;
                Ok(())
            },
            |index, sorted| {
                table.extend(&sorted.cells, &sorted.packed)?;
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
        let table = table.finish()?;
        self.place = at_window(&table);
        Ok(table)
    }

    /// The window of the place at which the passes are taken up.
    pub(super) fn same_window(&self) -> Result<CellTable> {
        let [first, rows] = self.place.window;
        let table = self.window(first, rows)?;
        match table.len() == rows {
            true => Ok(table),
            // `take_up` compares what the table took with what it may take.
            false => Err(Error::Internal(format!("{} of {rows} vertices known", table.len()))),
        }
    }

    /// The window that begins at vertex `first` and holds at most `rows` vertices.
    pub(super) fn window(&self, first: u64, rows: u64) -> Result<CellTable> {
        let mut table = self.table(first, rows);
        self.extend(&mut table, rows)?;
        table.finish()
    }

    /// An empty table for at most `rows` vertices from `first` on.
    fn table(&self, first: u64, rows: u64) -> CellTable {
        let folder = self.table_folder.map(Path::to_path_buf);
        let room = Room { bytes: self.shares.table_bytes, folder };
        CellTable::new(first, rows, self.tree.n_cells(), room)
    }

    /// Adds the cells of the first `rows` vertices to an empty table, or of as many as it takes.
    fn extend(&self, table: &mut CellTable, rows: u64) -> Result<()> {
        let (source, run, tree) = (self.source, self.run, &self.tree);
        let record_bytes = self.layout.schema.record_bytes();
        let (first, is_packed) = (table.first, table.is_packed());
        let is_full = AtomicBool::new(false);
        in_order(
            rows.div_ceil(BLOCK_ROWS),
            self.shares.threads,
            run.progress,
            |index, out: &mut Sorted| {
                if is_full.load(Relaxed) {
                    return Ok(());
                }
                source.read_vertices(first / BLOCK_ROWS + index, &mut out.vertices)?;
                out.cells.clear();
                let records = out.vertices.records.chunks_exact(record_bytes);
                let mut finder = tree.finder();
                let cells = records.map(|r| finder.cell_of(self.layout.schema.position(r)));
                out.cells.extend(cells);
                if is_packed {
                    out.pack_cells();
                }
                Ok(())
            },
            |_, block| {
                table.extend(&block.cells, &block.packed)?;
                is_full.store(table.is_full(), Relaxed);
                Ok(())
            },
        )
    }
}

/// The beginning of the pass over the triangles with `table`.
pub(super) fn at_window(table: &CellTable) -> ResumePoint {
    ResumePoint {
        pass: Pass::Triangles,
        window: [table.first, table.len()],
        table_bytes: table.bytes(),
        ..ResumePoint::default()
    }
}
