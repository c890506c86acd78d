//! Counts the connectivity of a mesh of any size, cell by cell, and the sizes of its components.

use crate::config::DEFAULT_CELL_TRIANGLES;
use crate::error::Result;
use crate::io::ply::MeshSource;
use crate::measure::temp_store::{Cutting, Scratch};
use crate::mesh::topology_counts::{CellPart, Topology, TopologyCounter, count_cell};
use crate::stages::components::{self, ComponentSizes, Least};
use crate::store::cells::load_bytes;
use crate::system::parallel::{Weighted, largest_first};
use crate::system::progress::Progress;
use std::path::Path;
use std::sync::{Mutex, PoisonError};

/// Bytes a triangle that counting takes besides the mesh or cell itself: its edges, sorted.
pub const COUNT_BYTES: u64 = 64;

/// Bytes a vertex that cells share: links of each cell that holds it, and edges to other shared vertices, of which a
/// seam has about three a vertex, once for each cell until equal ones are united; lists grow by doubling.
const SEAM_BYTES: u64 = 240;

/// Counts by way of a scratch store in `temp_dir`. Memory: tables and cells within `memory_bytes`, and what
/// lies on seams.
pub fn check(
    source: &MeshSource,
    temp_dir: &Path,
    threads: usize,
    memory_bytes: u64,
    progress: &Progress,
) -> Result<(Topology, ComponentSizes)> {
    let n = source.n_triangles();
    progress.begin("partition", 1, 3, n);
    let cell_triangles = DEFAULT_CELL_TRIANGLES;
    let cutting = Cutting { cell_triangles, temp_dir, threads, memory_bytes };
    let (scratch, sizes) = Scratch::cut_and_look(source, cutting, progress, |store, run| {
        progress.begin("components", 2, 3, n);
        components::find(store, Least::default(), run).map(|found| found.sizes)
    })?;
    progress.begin("count", 3, 3, n);
    let store = scratch.store();
    let counter = Mutex::new(TopologyCounter::default());
    let weigh = |item: usize| {
        let tally = store.info().cells[item];
        Weighted { item, bytes: load_bytes(tally, store.layout()) + COUNT_BYTES * tally.triangles }
    };
    let jobs = (0..store.n_cells()).map(weigh).collect();
    let seam_bytes = SEAM_BYTES * store.info().shared_vertices;
    largest_first(
        jobs,
        threads,
        memory_bytes.saturating_sub(seam_bytes),
        progress,
        |_| (),
        |item| {
            let cell = store.load(item)?;
            let part = CellPart {
                triangles: &cell.mesh.triangles,
                global: &cell.ids,
                shared: &cell.shared,
            };
            let counts = count_cell(&part);
            counter.lock().unwrap_or_else(PoisonError::into_inner).add(counts);
            progress.add(cell.mesh.triangles.len() as u64);
            Ok(())
        },
    )?;
    let counter = counter.into_inner().unwrap_or_else(PoisonError::into_inner);
    let mut topology = counter.finish(source.n_vertices());
    // The reader has left degenerate faces out of the cells.
    topology.degenerate_triangles += scratch.partition().degenerate_faces;
    topology.triangles += scratch.partition().degenerate_faces;
    Ok((topology, sizes))
}
