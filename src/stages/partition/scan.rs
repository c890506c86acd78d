//! The first pass over the vertices: bounds, and a sample to cut the cells by.
//!
//! Reading a block checks every coordinate, so after this pass all of them are known to be finite.

use std::ops::Range;
use stonecut_io::ply::{MeshSource, VertexBlock};
use stonecut_mesh::bounds::Bounds;
use stonecut_store::cells::n_samples;
use stonecut_system::error::Result;
use stonecut_system::parallel::in_order;
use stonecut_system::progress::Progress;

/// Findings of a pass over the vertices.
#[derive(Clone, Debug)]
pub struct Scan {
    /// The bounding box; an empty one when there are no vertices.
    pub bounds: Bounds,
    /// One vertex out of each stretch of equal length, chosen by a hash within it.
    pub samples: Vec<[f64; 3]>,
}

#[derive(Default)]
struct BlockScan {
    block: VertexBlock,
    bounds: Bounds,
    samples: Vec<[f64; 3]>,
}

/// Reads all vertices of some blocks once. Memory: their share of `n_samples` positions and a few blocks.
pub fn scan(
    source: &MeshSource,
    n_cells: u32,
    blocks: Range<u64>,
    threads: usize,
    progress: &Progress,
) -> Result<Scan> {
    let schema = source.schema();
    let stretch = (source.n_vertices() / n_samples(source.n_vertices(), n_cells)).max(1);
    let mut out = Scan { bounds: Bounds::EMPTY, samples: Vec::new() };
    in_order(
        blocks.end - blocks.start,
        threads,
        progress,
        |index, out: &mut BlockScan| {
            source.read_vertices(blocks.start + index, &mut out.block)?;
            out.samples.clear();
            out.bounds = Bounds::EMPTY;
            let mut wanted = chosen(out.block.first / stretch, stretch);
            for (row, record) in out.block.records.chunks_exact(schema.record_bytes()).enumerate() {
                let id = out.block.first + row as u64;
                let point = schema.position(record);
                out.bounds.add(point);
                if id.is_multiple_of(stretch) {
                    wanted = chosen(id / stretch, stretch);
                }
                if id == wanted {
                    out.samples.push(point);
                }
            }
            Ok(())
        },
        |_, found| {
            out.samples.append(&mut found.samples);
            out.bounds = out.bounds.joined(&found.bounds);
            Ok(())
        },
    )?;
    Ok(out)
}

/// The vertex that stands for stretch number `stretch_index`.
///
/// Hashed, not the first: a regular step could fall in with the rows of a grid.
pub fn chosen(stretch_index: u64, stretch: u64) -> u64 {
    let mut h =
        stretch_index.wrapping_add(0x9E37_79B9_7F4A_7C15).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    h ^= h >> 31;
    stretch_index * stretch + h % stretch
}
