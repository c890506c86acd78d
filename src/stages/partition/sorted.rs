//! A block of rows in the order of their cells, ready to be appended cell by cell.

use super::halo::Foreign;
use super::packed_cells::Packer;
use stonecut_io::ply::{FaceBlock, VertexBlock};
use stonecut_store::cell_id::CellId;
use stonecut_store::cells::{PackWriter, Scatter};
use stonecut_system::error::Result;

/// A block of rows, sorted by cell.
#[derive(Default)]
pub struct Sorted {
    /// The vertices that were read.
    pub vertices: VertexBlock,
    /// The faces that were read.
    pub faces: FaceBlock,
    /// Cell of each row of the block.
    pub cells: Vec<CellId>,
    /// The same, packed, for a table that is.
    pub packed: Vec<u8>,
    packer: Packer,
    rows: Vec<u8>,
    /// Cell and number of rows of each run in `rows`.
    pub runs: Vec<(CellId, u32)>,
    /// Corners that lie in another cell than their triangle.
    pub foreign: Vec<Foreign>,
    /// Per cell: where its next row goes; all zero between blocks.
    cursor: Vec<u32>,
}

impl Sorted {
    /// Orders rows by cell (stable); `write` appends row `i` at the end of a slice of `row_bytes`.
    pub fn sort(
        &mut self,
        n_cells: u32,
        row_bytes: usize,
        mut write: impl FnMut(usize, &mut [u8]),
    ) {
        self.cursor.resize(n_cells as usize, 0);
        self.runs.clear();
        for &cell in &self.cells {
            if self.cursor[cell] == 0 {
                self.runs.push((cell, 0));
            }
            self.cursor[cell] += 1;
        }
        let mut start = 0;
        for run in &mut self.runs {
            run.1 = self.cursor[run.0];
            self.cursor[run.0] = start;
            start += run.1;
        }
        self.rows.resize(self.cells.len() * row_bytes, 0);
        for (i, &cell) in self.cells.iter().enumerate() {
            let at = self.cursor[cell] as usize * row_bytes;
            self.cursor[cell] += 1;
            write(i, &mut self.rows[at..at + row_bytes]);
        }
        for run in &self.runs {
            self.cursor[run.0] = 0;
        }
    }

    /// Packs the cells of the rows.
    pub fn pack_cells(&mut self) {
        self.packer.pack(&self.cells, &mut self.packed);
    }

    /// Appends every run to the buffer of its cell.
    pub fn push_runs(
        &self,
        row_bytes: usize,
        scatter: &mut Scatter,
        pack: &mut PackWriter,
    ) -> Result<()> {
        let mut at = 0;
        for &(cell, n_rows) in &self.runs {
            let end = at + n_rows as usize * row_bytes;
            scatter.push(pack, cell, &self.rows[at..end])?;
            at = end;
        }
        Ok(())
    }
}
