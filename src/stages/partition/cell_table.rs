//! The cell of every vertex, in memory: the one table of partitioning that grows with the input.

use crate::store::cell_id::CellId;

/// The cell of every vertex of a window of ids: 2 bytes each while there are at most 65,536 cells, else 4.
pub struct CellTable {
    /// Id of the first vertex of the window.
    pub first: u64,
    cells: Cells,
}

enum Cells {
    Narrow(Vec<u16>),
    Wide(Vec<CellId>),
}

impl CellTable {
    /// 2 or 4.
    pub fn bytes_per_vertex(n_cells: u32) -> u64 {
        if n_cells <= 1 << 16 { 2 } else { 4 }
    }

    /// An empty table with room for a window of `n_rows` vertices.
    pub fn new(first: u64, n_rows: u64, n_cells: u32) -> CellTable {
        let n = n_rows as usize;
        let cells = match Self::bytes_per_vertex(n_cells) {
            2 => Cells::Narrow(Vec::with_capacity(n)),
            _ => Cells::Wide(Vec::with_capacity(n)),
        };
        CellTable { first, cells }
    }

    /// Makes room for `n_rows` further vertices, and no more.
    pub fn reserve(&mut self, n_rows: u64) {
        match &mut self.cells {
            Cells::Narrow(table) => table.reserve_exact(n_rows as usize),
            Cells::Wide(table) => table.reserve_exact(n_rows as usize),
        }
    }

    /// Vertices in the window so far.
    pub fn len(&self) -> u64 {
        match &self.cells {
            Cells::Narrow(table) => table.len() as u64,
            Cells::Wide(table) => table.len() as u64,
        }
    }

    /// Appends the cells of further vertices.
    pub fn extend(&mut self, cells: &[CellId]) {
        match &mut self.cells {
            Cells::Narrow(table) => table.extend(cells.iter().map(|cell| cell.0 as u16)),
            Cells::Wide(table) => table.extend_from_slice(cells),
        }
    }

    /// The cell of a vertex; `None` outside the window.
    #[inline]
    pub fn get(&self, vertex: u64) -> Option<CellId> {
        let row = vertex.wrapping_sub(self.first) as usize;
        match &self.cells {
            Cells::Narrow(table) => table.get(row).map(|&cell| CellId(cell.into())),
            Cells::Wide(table) => table.get(row).copied(),
        }
    }
}
