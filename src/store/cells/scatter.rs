//! Scatters rows to their cells: a buffer per cell, full buffers become chunks of the pack.

use super::pack::PackWriter;
use crate::cell_id::CellId;
use crate::pack_format::ChunkKind;
use stonecut_system::error::Result;

/// Bounds of a cell's buffer: below the lower one chunk headers and reads would cost too much, above the
/// upper one nothing is gained.
const CHUNK_BYTES: std::ops::RangeInclusive<u64> = 4 << 10..=256 << 10;

/// A chunk in a list that grows by doubling, or twice when it is sorted.
const LIST_BYTES: u64 = 80;

/// Per-cell buffers of one chunk kind.
pub struct Scatter {
    kind: ChunkKind,
    chunk_bytes: usize,
    buffers: Vec<Vec<u8>>,
}

impl Scatter {
    /// Buffers for `n_cells` cells that together take at most `budget_bytes`, or 4 KiB each if that is more.
    pub fn new(kind: ChunkKind, n_cells: u32, budget_bytes: u64) -> Scatter {
        Scatter {
            kind,
            chunk_bytes: chunk_bytes(n_cells, budget_bytes) as usize,
            buffers: vec![Vec::new(); n_cells as usize],
        }
    }

    /// Bytes that the buffers take when full.
    pub fn bytes(n_cells: u32, budget_bytes: u64) -> u64 {
        u64::from(n_cells) * chunk_bytes(n_cells, budget_bytes)
    }

    /// Bytes that the list of chunks takes when `data_bytes` went through such buffers: the writer's, or the
    /// reader's with the index that it came from.
    pub fn list_bytes(n_cells: u32, budget_bytes: u64, data_bytes: u64) -> u64 {
        let n_kinds = 3;
        (data_bytes / chunk_bytes(n_cells, budget_bytes) + n_kinds * u64::from(n_cells))
            * LIST_BYTES
    }

    /// Appends rows to a cell.
    #[inline]
    pub fn push(&mut self, pack: &mut PackWriter, cell: CellId, rows: &[u8]) -> Result<()> {
        let buffer = &mut self.buffers[cell];
        if buffer.len() + rows.len() > self.chunk_bytes {
            if !buffer.is_empty() {
                pack.append(cell, self.kind, buffer)?;
                buffer.clear();
            }
            if rows.len() >= self.chunk_bytes {
                return pack.append(cell, self.kind, rows);
            }
            // Exact, so that doubling cannot take more than the plan has counted.
            buffer.reserve_exact(self.chunk_bytes);
        }
        buffer.extend_from_slice(rows);
        Ok(())
    }

    /// Writes out what is left, cell by cell; the buffers can be filled again.
    pub fn flush(&mut self, pack: &mut PackWriter) -> Result<()> {
        let cells = CellId::first(self.buffers.len());
        for (cell, buffer) in cells.zip(&mut self.buffers) {
            if !buffer.is_empty() {
                pack.append(cell, self.kind, buffer)?;
                buffer.clear();
            }
        }
        Ok(())
    }

    /// Writes out what is left, cell by cell.
    pub fn finish(mut self, pack: &mut PackWriter) -> Result<()> {
        self.flush(pack)
    }
}

fn chunk_bytes(n_cells: u32, budget_bytes: u64) -> u64 {
    (budget_bytes / u64::from(n_cells.max(1))).clamp(*CHUNK_BYTES.start(), *CHUNK_BYTES.end())
}
