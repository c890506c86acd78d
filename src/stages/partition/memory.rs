//! The memory of partitioning: its terms, and how a budget is shared among them.
//!
//! The passes allocate what this says, and the plan refuses what does not fit, from the same terms.

use super::cell_table::CellTable;
use stonecut_io::ply::BLOCK_ROWS;
use stonecut_store::cells::{BEHIND_BYTES, Scatter, VertexLayout, n_samples};

/// Share of the budget that one set of scatter buffers may take.
const BUFFER_SHARE: u64 = 6;

/// Share of the budget for pairs of a vertex and a foreign cell, with a least and a largest number of bytes.
const HALO_SHARE: u64 = 16;
const HALO_BYTES: std::ops::RangeInclusive<u64> = 1 << 20..=256 << 20;

/// Share of the budget that blocks under way may take before fewer threads read.
const BLOCK_SHARE: u64 = 3;

/// Blocks under way per thread (`parallel::in_order`).
const BLOCKS_PER_THREAD: u64 = 2;

/// Another thread writes the pack where its buffers are at most this part of the budget.
const BEHIND_SHARE: u64 = 64;

/// Bytes a sample takes: its position, and the same as integers.
const SAMPLE_BYTES: u64 = 36;

/// Headers of a table in a file are at most this part of it.
const FILE_OVERHEAD: u64 = 256;

/// Sizes that the terms depend on.
#[derive(Clone, Copy, Debug)]
pub struct Sizes<'a> {
    /// Vertices of the input.
    pub n_vertices: u64,
    /// Cells of the first round.
    pub n_cells: u32,
    /// Bytes on disk of all cells (`store_bytes`).
    pub store_bytes: u64,
    /// Rows of vertices.
    pub layout: &'a VertexLayout,
}

/// Shares of the budget.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shares {
    /// Threads that read blocks; no more than were given.
    pub threads: usize,
    /// True if another thread writes the pack.
    pub writes_behind: bool,
    /// Bytes of memory for the table of cells.
    pub table_bytes: u64,
    /// The most that a file takes for what exceeds them.
    pub table_file_bytes: u64,
    /// Bytes for each set of scatter buffers, of which two exist at a time.
    pub buffer_bytes: u64,
    /// Bytes for pairs of a vertex and a foreign cell.
    pub halo_bytes: u64,
    /// The peak if the table holds a single block and pairs have the least they can do with.
    pub least_bytes: u64,
}

impl Shares {
    /// Shares `budget_bytes` among the terms.
    pub fn new(sizes: Sizes, threads: usize, budget_bytes: u64) -> Shares {
        let Sizes { n_vertices, n_cells, store_bytes, layout } = sizes;
        let buffer_bytes = budget_bytes / BUFFER_SHARE;
        let writes_behind = writes_behind(threads, budget_bytes);
        let block = block_bytes(layout, n_cells) * BLOCKS_PER_THREAD;
        let threads = (budget_bytes / BLOCK_SHARE / block).clamp(1, threads.max(1) as u64);
        let buffers = Scatter::bytes(n_cells, buffer_bytes);
        let list = Scatter::list_bytes(n_cells, buffer_bytes, store_bytes);
        let per_vertex = CellTable::bytes_per_vertex(n_cells);
        // The second set of buffers comes when the table is gone.
        let least_table = buffers.max(BLOCK_ROWS.min(n_vertices) * per_vertex);
        let behind = if writes_behind { BEHIND_BYTES } else { 0 };
        let others = threads * block + buffers + list + behind;
        let left = budget_bytes.saturating_sub(others + least_table);
        let halo_bytes =
            (budget_bytes / HALO_SHARE).min(left).clamp(*HALO_BYTES.start(), *HALO_BYTES.end());
        let table_bytes =
            budget_bytes.saturating_sub(others + halo_bytes).max(BLOCK_ROWS * per_vertex);
        let table_file_bytes = match n_vertices * per_vertex {
            plain if plain > table_bytes => plain + plain / FILE_OVERHEAD,
            _ => 0,
        };
        let samples = SAMPLE_BYTES * n_samples(n_vertices, n_cells) + threads * block;
        let passes = others + least_table + HALO_BYTES.start();
        Shares {
            threads: threads as usize,
            writes_behind,
            table_bytes,
            table_file_bytes,
            buffer_bytes,
            halo_bytes,
            least_bytes: passes.max(samples),
        }
    }
}

/// True if another thread writes a pack that rows are scattered to: with one thread alone, or in little memory, the one that
/// scatters them does.
fn writes_behind(threads: usize, budget_bytes: u64) -> bool {
    threads > 1 && BEHIND_BYTES <= budget_bytes / BEHIND_SHARE
}

/// Bytes of a block under way: as read, decoded, in the order of its cells, and its cells packed.
fn block_bytes(layout: &VertexLayout, n_cells: u32) -> u64 {
    let (ids, record) = (layout.ids.bytes as u64, layout.schema.record_bytes() as u64);
    let vertex = 3 * record + ids + 8;
    // Three indices and a count as read, ids of 8 bytes, the cell, the row, and one foreign corner.
    let face = 16 + 24 + 4 + 3 * ids + 16;
    BLOCK_ROWS * vertex.max(face) + 12 * u64::from(n_cells)
}
