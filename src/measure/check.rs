//! Counts the connectivity of a mesh of any size, cell by cell, the sizes of its components, its self-intersections.

use crate::intersections::{self, SelfIntersections};
use crate::temp_store::{Cutting, Scratch};
use std::path::Path;
use std::sync::{Mutex, PoisonError};
use stonecut_io::ply::MeshSource;
use stonecut_mesh::Mesh;
use stonecut_mesh::meeting::is_flat;
use stonecut_mesh::topology_counts::{CellPart, Topology, TopologyCounter, count_cell};
use stonecut_stages::components::{self, ComponentSizes, Least};
use stonecut_store::cell_id::CellId;
use stonecut_store::cells::load_bytes;
use stonecut_store::config::DEFAULT_CELL_TRIANGLES;
use stonecut_system::error::Result;
use stonecut_system::parallel::{Weighted, largest_first};
use stonecut_system::progress::Progress;

/// Bytes a triangle that counting takes besides the mesh or cell itself: its edges, sorted.
pub const COUNT_BYTES: u64 = 64;

/// Bytes a vertex that cells share: links of each cell that holds it, and edges to other shared vertices, of which a
/// seam has about three a vertex, once for each cell until equal ones are united; lists grow by doubling.
const SEAM_BYTES: u64 = 240;

/// Fewest triangles of a cell where two of them must fit the memory.
const LEAST_CELL_TRIANGLES: u64 = 16_000;

/// Findings of `check`.
#[derive(Clone, Debug, Default)]
pub struct Checked {
    /// Connectivity.
    pub topology: Topology,
    /// Triangles without area: all corners on one line or in one place.
    pub collinear_triangles: u64,
    /// Components by size.
    pub sizes: ComponentSizes,
    /// Self-intersections, if asked for.
    pub intersections: Option<SelfIntersections>,
}

/// The cutting for `check`: cells are smaller where pairs of them must fit the memory.
pub fn cutting(
    temp_dir: &Path,
    threads: usize,
    memory_bytes: u64,
    has_intersections: bool,
) -> Cutting<'_> {
    let fitting = memory_bytes / threads.max(1) as u64 / intersections::job_bytes();
    let cell_triangles = match has_intersections {
        true => fitting.clamp(LEAST_CELL_TRIANGLES, DEFAULT_CELL_TRIANGLES),
        false => DEFAULT_CELL_TRIANGLES,
    };
    Cutting { cell_triangles, temp_dir, threads, memory_bytes, disk: None }
}

/// Counts by way of a scratch store, self-intersections too if asked for. Memory: tables and cells within that of
/// `cutting`, and what lies on seams.
pub fn check(
    source: &MeshSource,
    cutting: Cutting,
    has_intersections: bool,
    progress: &Progress,
) -> Result<Checked> {
    let n = source.n_triangles();
    let Cutting { threads, memory_bytes, .. } = cutting;
    let n_stages = if has_intersections { 4 } else { 3 };
    progress.begin("partition", 1, n_stages, n);
    let (scratch, sizes) = Scratch::cut_and_look(source, cutting, progress, |store, run| {
        progress.begin("components", 2, n_stages, n);
        components::find(store, Least::default(), run).map(|found| found.sizes)
    })?;
    progress.begin("count", 3, n_stages, n);
    let store = scratch.store();
    let counter = Mutex::new((TopologyCounter::default(), 0));
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
            let cell = store.load(CellId::at(item))?;
            let part = CellPart {
                triangles: &cell.mesh.triangles,
                global: &cell.ids,
                shared: &cell.shared,
            };
            let counts = count_cell(&part);
            let n_flat = count_flat(&cell.mesh);
            let mut sums = counter.lock().unwrap_or_else(PoisonError::into_inner);
            sums.0.add(counts);
            sums.1 += n_flat;
            progress.add(cell.mesh.triangles.len() as u64);
            Ok(())
        },
    )?;
    let (counter, n_flat) = counter.into_inner().unwrap_or_else(PoisonError::into_inner);
    let mut topology = counter.finish(source.n_vertices());
    // The reader has left degenerate faces out of the cells.
    topology.degenerate_triangles += scratch.partition().degenerate_faces;
    topology.triangles += scratch.partition().degenerate_faces;
    let mut intersections = None;
    if has_intersections {
        progress.begin("self-intersections", 4, n_stages, 2 * n);
        let bounds = &scratch.partition().bounds;
        let found = intersections::in_store(store, bounds, threads, memory_bytes, progress)?;
        intersections = Some(found);
    }
    let collinear_triangles = n_flat + scratch.partition().degenerate_faces;
    Ok(Checked { topology, collinear_triangles, sizes, intersections })
}

/// Counts the triangles of a mesh whose corners are on one line or in one place.
pub fn count_flat(mesh: &Mesh) -> u64 {
    (0..mesh.triangles.len()).filter(|&t| is_flat(&mesh.corners(t))).count() as u64
}
