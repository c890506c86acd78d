//! Shared parts of the passes over the input; the pass over the vertices, and windows of their cells.

use super::cell_table::{CellTable, Room};
use super::checkpoint::{Checkpoints, Pass, ResumePoint};
use super::memory::Shares;
use super::sorted::Sorted;
use std::ops::Range;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use stonecut_io::ply::{BLOCK_ROWS, MeshSource};
use stonecut_store::cells::{CellMap, CellTally, PackWriter, Scatter, VertexLayout};
use stonecut_store::pack_format::ChunkKind;
use stonecut_store::stage_context::StageContext;
use stonecut_system::error::{Error, Result};
use stonecut_system::parallel::in_order;

/// Blocks of the input.
#[derive(Clone, Debug)]
pub(super) struct Blocks {
    pub(super) vertices: Range<u64>,
    pub(super) faces: Range<u64>,
}

/// The passes over the input, and how far they are.
pub(super) struct Passes<'a> {
    pub(super) source: &'a MeshSource,
    pub(super) run: &'a StageContext<'a>,
    pub(super) layout: VertexLayout,
    pub(super) tree: &'a CellMap,
    /// The blocks of vertices and of faces that the passes go over.
    pub(super) blocks: Blocks,
    pub(super) tally: Vec<CellTally>,
    pub(super) shares: Shares,
    /// Folder for a table that exceeds its memory; without one it comes in windows.
    pub(super) table_folder: Option<&'a Path>,
    /// True if faces are known to use vertices near each other in the input.
    pub(super) is_near: bool,
    /// Position of the passes, or where they continue.
    pub(super) place: ResumePoint,
    pub(super) checkpoints: Checkpoints<'a>,
}

impl<'a> Passes<'a> {
    pub(super) fn buffers(&self, kind: ChunkKind) -> Scatter {
        Scatter::new(kind, self.tree.n_cells(), self.shares.buffer_bytes)
    }

    /// The table of cells up to the place of the passes.
    pub(super) fn begun_table(&self) -> Result<CellTable<'a>> {
        let mut table = self.table(0, self.source.n_vertices());
        self.extend(&mut table, self.place.block * BLOCK_ROWS)?;
        Ok(table)
    }

    /// Sends every vertex to the cell of its position, which is added to the table.
    pub(super) fn vertices(
        &mut self,
        mut table: Option<&mut CellTable<'a>>,
        pack: &mut PackWriter,
    ) -> Result<()> {
        let first_block = self.blocks.vertices.start + self.place.block;
        let is_packed = table.as_ref().is_some_and(|table| table.is_packed());
        let (source, run, tree, ids) = (self.source, self.run, self.tree, self.layout.ids);
        let n_cells = tree.n_cells();
        let record_bytes = self.layout.schema.record_bytes();
        let row_bytes = ids.bytes + record_bytes;
        let mut scatter = self.buffers(ChunkKind::Vertices);
        let (schema, tally, checkpoints) =
            (&self.layout.schema, &mut self.tally, &mut self.checkpoints);
        in_order(
            self.blocks.vertices.end - first_block,
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
                if let Some(table) = table.as_deref_mut() {
                    table.extend(first_block + index, &sorted.cells, &sorted.packed)?;
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
        run.progress.add(self.share(source.n_triangles() / 4));
        Ok(())
    }

    /// The part of a count of all that falls to the blocks of these passes.
    pub(super) fn share(&self, n: u64) -> u64 {
        let blocks = self.blocks.faces.end - self.blocks.faces.start;
        (u128::from(n) * u128::from(blocks) / u128::from(self.source.n_face_blocks().max(1))) as u64
    }

    /// The window of the place at which the passes are taken up.
    pub(super) fn same_window(&self) -> Result<CellTable<'a>> {
        let [first, rows] = self.place.window;
        let table = self.window(first, rows)?;
        match table.len() == rows {
            true => Ok(table),
            // `take_up` compares what the table took with what it may take.
            false => Err(Error::Internal(format!("{} of {rows} vertices known", table.len()))),
        }
    }

    /// The window that begins at vertex `first` and holds at most `rows` vertices.
    pub(super) fn window(&self, first: u64, rows: u64) -> Result<CellTable<'a>> {
        let mut table = self.table(first, rows);
        self.extend(&mut table, rows)?;
        table.finish()
    }

    /// An empty table for at most `rows` vertices from `first` on.
    fn table(&self, first: u64, rows: u64) -> CellTable<'a> {
        let folder = self.table_folder.map(Path::to_path_buf);
        let room = Room { bytes: self.shares.table_bytes, folder, is_near: self.is_near };
        CellTable::new(first, rows, self.tree.n_cells(), room)
    }

    /// Adds the cells of the first `rows` vertices to an empty table, or of as many as it takes.
    fn extend(&self, table: &mut CellTable, rows: u64) -> Result<()> {
        let (source, run, tree) = (self.source, self.run, self.tree);
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
            |index, block| {
                table.extend(first / BLOCK_ROWS + index, &block.cells, &block.packed)?;
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
