//! Attributes of the vertices of a cell: the mean of their channels, and the labels of the first.

use super::grid::CubeGrid;
use crate::key_table::KeyTable;
use std::collections::HashMap;
use stonecut_io::ply::{MeshSource, VertexBlock};
use stonecut_mesh::codec::VertexCodec;
use stonecut_system::error::Result;
use stonecut_system::parallel::in_order;
use stonecut_system::progress::Progress;

/// Attributes of cells.
#[derive(Default)]
pub(super) struct CellAttributes {
    /// Mean channels of each cell.
    pub(super) channels: Vec<f32>,
    /// The record of the first vertex of each cell.
    pub(super) records: Vec<u8>,
}

/// Memory for each cell, in bytes.
pub(super) fn attribute_bytes(source: &MeshSource, codec: &VertexCodec) -> u64 {
    match source.schema().properties.is_empty() {
        true => 0,
        // Sums, then means, both for a while; counts; records.
        false => (12 * codec.n_channels() + 4 + source.schema().record_bytes()) as u64,
    }
}

/// Sums of one block, for the cells that it touches.
#[derive(Default)]
struct Batch {
    block: VertexBlock,
    cells: KeyTable<u64>,
    sums: Vec<f64>,
    counts: Vec<u32>,
    first: Vec<u32>,
    channels: Vec<f32>,
    /// Places in `sums` of values that are missing: NaN or infinite.
    missing: Vec<u32>,
}

/// Averages over all vertices of each cell that `cells` has; vertices without a face count too, values that are missing do not.
pub(super) fn attributes(
    source: &MeshSource,
    codec: &VertexCodec,
    grid: &CubeGrid,
    cells: &KeyTable<u64>,
    threads: usize,
    progress: &Progress,
) -> Result<CellAttributes> {
    let (n, record_bytes) = (codec.n_channels(), source.schema().record_bytes());
    let n_cells = cells.keys().len();
    let mut sums = vec![0.0f64; n * n_cells];
    let mut counts = vec![0u32; n_cells];
    let mut records = vec![0u8; record_bytes * n_cells];
    let mut missing = HashMap::new();
    in_order(
        source.n_vertex_blocks(),
        threads,
        progress,
        |index, batch: &mut Batch| {
            source.read_vertices(index, &mut batch.block)?;
            batch.cells.clear();
            batch.sums.clear();
            batch.counts.clear();
            batch.first.clear();
            batch.missing.clear();
            batch.channels.resize(n, 0.0);
            for (row, record) in batch.block.records.chunks_exact(record_bytes).enumerate() {
                let key = CubeGrid::key(grid.place(source.schema().position(record)));
                let Some(cell) = cells.find(key) else { continue };
                let number = batch.cells.number(u64::from(cell)) as usize;
                if number == batch.counts.len() {
                    batch.counts.push(0);
                    batch.first.push(row as u32);
                    batch.sums.resize(batch.sums.len() + n, 0.0);
                }
                codec.decode_channels(record, &mut batch.channels);
                batch.counts[number] += 1;
                let place = &mut batch.sums[number * n..(number + 1) * n];
                for (k, (sum, &x)) in place.iter_mut().zip(&batch.channels).enumerate() {
                    if x.is_finite() {
                        *sum += f64::from(x);
                    } else {
                        batch.missing.push((number * n + k) as u32);
                    }
                }
            }
            Ok(())
        },
        |_, batch| {
            for (number, &cell) in batch.cells.keys().iter().enumerate() {
                let cell = cell as usize;
                if counts[cell] == 0 {
                    let at = batch.first[number] as usize * record_bytes;
                    records[cell * record_bytes..(cell + 1) * record_bytes]
                        .copy_from_slice(&batch.block.records[at..at + record_bytes]);
                }
                counts[cell] = counts[cell].saturating_add(batch.counts[number]);
                for k in 0..n {
                    sums[cell * n + k] += batch.sums[number * n + k];
                }
            }
            for &at in &batch.missing {
                let (number, k) = (at as usize / n, at as usize % n);
                *missing.entry(batch.cells.keys()[number] as usize * n + k).or_insert(0u32) += 1;
            }
            Ok(())
        },
    )?;
    let mean = |(i, sum): (usize, &f64)| match missing.get(&i) {
        // None at all: NaN.
        Some(missing) => (sum / f64::from(counts[i / n] - missing.min(&counts[i / n]))) as f32,
        None => (sum / f64::from(counts[i / n].max(1))) as f32,
    };
    let channels = sums.iter().enumerate().map(mean).collect();
    Ok(CellAttributes { channels, records })
}
