//! Quadric vertex clustering on a uniform grid: all vertices of a cell become one (Rossignac & Borrel 1993), at the
//! point of the cell that fits the triangles there best (Lindstrom 2000; boundaries after Lindstrom & Silva 2001).
//!
//! One pass over the faces, memory by the size of the result. `survey` chooses the grid, `pass` sums, `sums` has the
//! quadrics. The topology is that of the grid: sheets closer than a cell join, and edges of more than two triangles
//! appear.

mod attributes;
mod distinct;
mod grid;
mod pass;
mod survey;

use super::sums::LEAST_SINGULAR;
use super::{FileOrder, GridReport, Made, MethodReport, Positions, page_bytes};
use attributes::{CellAttributes, attribute_bytes, attributes};
use grid::CubeGrid;
use pass::{Clustered, batch_bytes, pass};
use std::collections::BTreeMap;
use stonecut_io::ply::{BLOCK_ROWS, MeshSource};
use stonecut_mesh::codec::VertexCodec;
use stonecut_mesh::vec3::add;
use stonecut_system::error::{Error, Result};
use stonecut_system::parallel::BLOCKS_PER_THREAD;
use stonecut_system::progress::Progress;
use survey::AIM;
pub use survey::{Survey, Wanted, survey};

/// Safety factor on expected counts of cells; sketches err by 1 %, and a second pass takes another grid.
const UNEVEN: f64 = 1.2;

/// A pass whose count is at least this share of the target is the last one.
const ENOUGH: f64 = 0.9;
/// Passes after which any count up to the target is enough, and passes at most.
const FINE_PASSES: usize = 3;
const MOST_PASSES: usize = 10;

/// Blocks of vertices that the work takes at least, for each block of faces under way.
const LEAST_PAGES: u64 = 4;

/// Readings of a block of vertices at most, on average, where not all fit into memory.
const MOST_REREADS: f64 = 6.0;

/// Memory that a run needs, in bytes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Need {
    /// Tables of cells and triangles, and blocks under way.
    pub tables: u64,
    /// Positions at least: all where faces do not lie in the order of vertices.
    pub positions: u64,
    /// All positions.
    pub all_positions: u64,
}

/// Finds the memory that a run needs.
pub fn need(
    source: &MeshSource,
    survey: &Survey,
    codec: &VertexCodec,
    threads: usize,
) -> Result<Need> {
    let cells = (UNEVEN * survey.cells) as u64;
    let n_batches = (threads * BLOCKS_PER_THREAD) as u64;
    let face_bytes = source.file_bytes() / source.n_face_rows().max(1);
    // Cells of a block: as many as its share of the mesh has, and those at its edge.
    let share = survey.cells / source.n_vertices().max(1) as f64;
    let of_batch = ((BLOCK_ROWS as f64 * share.min(1.0)) as u64).min(cells) + 1024;
    let batches = n_batches * batch_bytes(BLOCK_ROWS, face_bytes.min(64), of_batch);
    // The mesh is made beside the tables.
    let mesh = cells * (24 + 4 + 24 + attribute_bytes(source, codec));
    let n_pages = source.n_vertex_blocks();
    let all_positions = n_pages * page_bytes(source);
    let FileOrder { pages, rereads } = Positions::order(source)?;
    let held = n_batches * LEAST_PAGES.max(pages + 1) * 2;
    let positions = match rereads <= MOST_REREADS {
        true => held.min(n_pages) * page_bytes(source),
        false => all_positions,
    };
    Ok(Need { tables: Clustered::bytes(cells) + batches + mesh, positions, all_positions })
}

/// Settings of a run.
#[derive(Clone, Copy, Debug)]
pub struct Settings<'a> {
    /// Wanted size of the result.
    pub wanted: Wanted,
    /// The grid to begin with.
    pub survey: &'a Survey,
    /// The source's `kernel_codec`.
    pub codec: &'a VertexCodec,
    /// Worker threads.
    pub threads: usize,
    /// Memory for positions, in bytes.
    pub position_bytes: u64,
}

/// Clusters a mesh, in as many passes as it takes to come near the wanted count, as a rule in one.
///
/// The result has at most the wanted count of triangles, unless none of ten grids gives that.
pub fn cluster(source: &MeshSource, settings: Settings, progress: &Progress) -> Result<Made> {
    let Settings { survey, threads, .. } = settings;
    let n_readers = threads * BLOCKS_PER_THREAD;
    let positions = Positions::new(source, settings.position_bytes, n_readers);
    let mut grid = survey.grid;
    let room = (1.05 * survey.cells) as usize + 64;
    for passes in 1.. {
        progress.begin("cluster", 1, 2, source.n_triangles());
        let done = pass(source, &positions, &grid, room, threads, progress)?;
        let n = done.triangles.len() as f64;
        let is_last = match settings.wanted {
            Wanted::CellSize(_) => true,
            Wanted::Triangles(most) => {
                let is_enough =
                    passes >= FINE_PASSES || n >= ENOUGH * most as f64 || done.n_collapsed == 0;
                passes >= MOST_PASSES || (n <= most as f64 && is_enough)
            }
        };
        let next = match settings.wanted {
            Wanted::Triangles(most) if !is_last => {
                // After some passes a little coarser each time, so that counts which jump come to an end.
                let aim = AIM.powi(passes as i32) * most as f64;
                let factor = (n.max(1.0) / aim).powf(1.0 / survey.dimension);
                CubeGrid::around(&survey.bounds, grid.cell_size * factor.clamp(0.5, 2.0))
            }
            _ => None,
        };
        let Some(next) = next else {
            drop(positions);
            return made(source, settings, (&grid, passes as u64), done, progress);
        };
        grid = next;
    }
    Err(Error::Internal("passes without an end".to_owned()))
}

/// The mark of a cell that no triangle uses.
const UNUSED: u32 = u32::MAX;

/// Turns cells that triangles use into vertices, in the order in which cells came.
fn made(
    source: &MeshSource,
    settings: Settings,
    (grid, passes): (&CubeGrid, u64),
    done: Clustered,
    progress: &Progress,
) -> Result<Made> {
    let codec = settings.codec;
    let carried = match source.schema().properties.is_empty() {
        true => CellAttributes::default(),
        false => attributes(source, codec, grid, &done.cells, settings.threads, progress)?,
    };
    let keys = done.cells.keys();
    let mut numbers = vec![UNUSED; keys.len()];
    let (kept, two_sided, n_fins) = done.triangles.without_fins();
    kept.iter().flatten().for_each(|&cell| numbers[cell as usize] = 0);
    let (n_channels, record_bytes) = (codec.n_channels(), source.schema().record_bytes());
    let mut made = Made::default();
    made.mesh.n_channels = n_channels;
    for (cell, (&key, sums)) in keys.iter().zip(&done.sums).enumerate() {
        if numbers[cell] == UNUSED {
            continue;
        }
        numbers[cell] = made.mesh.positions.len() as u32;
        made.mesh
            .positions
            .push(grid.position(add(CubeGrid::centre(key), sums.point(LEAST_SINGULAR))));
        if !carried.records.is_empty() {
            let channels = cell * n_channels..(cell + 1) * n_channels;
            made.mesh.channels.extend_from_slice(&carried.channels[channels]);
            let record = cell * record_bytes..(cell + 1) * record_bytes;
            made.records.extend_from_slice(&carried.records[record]);
        }
    }
    let corners = |t: &[u32; 3]| t.map(|cell| numbers[cell as usize]);
    made.mesh.triangles = kept.iter().map(corners).collect();
    made.two_sided = two_sided;
    made.faults = BTreeMap::from([
        ("degenerate_faces".to_owned(), done.n_degenerate),
        ("bad_faces".to_owned(), done.n_bad),
    ]);
    made.bounds = settings.survey.bounds;
    made.report = MethodReport::Grid(GridReport {
        cell_size: grid.cell_size,
        passes,
        cells: keys.len() as u64,
        collapsed_triangles: done.n_collapsed,
        repeated_triangles: done.n_between - done.triangles.len() as u64,
        folded_triangles: done.triangles.n_folded(),
        fins_dropped: n_fins,
        ..GridReport::default()
    });
    Ok(made)
}
