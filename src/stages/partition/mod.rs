//! Stage 1: from a mesh file to a store of cells.
//!
//! Three passes after the scan, all I/O sequential: vertices go to the cell of their position, triangles to
//! the cell of their corner of lowest index, and the vertices that triangles of another cell use are copied there.
//! It does not look at connectivity and moves nothing. Many processes may do it in parts (`parts`).

mod cell_table;
mod checkpoint;
mod halo;
mod in_memory;
mod locality;
mod memory;
mod missing;
mod packed_cells;
mod pages;
mod parts;
mod passes;
mod scan;
mod shared;
mod sorted;
#[cfg(test)]
mod tests;
mod triangles;

pub use in_memory::CutMesh;
pub use memory::{Shares, Sizes};
pub use parts::{
    Part, Scanned, Scattered, SharedPart, join_parts, scan_part, scatter_part, share_part,
    tree_of_parts,
};
pub use scan::{Scan, scan};

use cell_table::CellTable;
use checkpoint::{Checkpoints, Pass, take_up, tally};
use halo::{Gathering, TOGETHER};
pub use locality::is_local;
use passes::{Blocks, Passes, at_window};
use serde::{Deserialize, Serialize};
use stonecut_io::ply::MeshSource;
use stonecut_mesh::bounds::Bounds;
use stonecut_store::cell_id::CellId;
use stonecut_store::cells::{
    CellMap, CellStore, CellTree, GroupGrid, Lattice, StoreInfo, TurnedFrame, VertexLayout,
    plan_cells, split_overfull,
};
use stonecut_store::stage_context::StageContext;
use stonecut_system::error::{Error, Result};

/// File name of the first round's pack.
const PACK_NAME: &str = "round-0.cells";

/// Outcome of partitioning.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Partition {
    /// The store of cells.
    pub store: StoreInfo,
    /// The bounding box.
    pub bounds: Bounds,
    /// Faces dropped because a corner repeats or is missing.
    pub degenerate_faces: u64,
    /// Broken faces dropped on request.
    pub bad_faces: u64,
    /// The vertex on a seam that is nearest to the middle of the box.
    #[serde(default)]
    pub seam_place: Option<[f64; 3]>,
}

impl Partition {
    /// Narrows the box to the vertices that triangles use: a size that is derived from it must not count what is left out.
    ///
    /// Reads cells until the box is met, as a rule most of them. Memory: a cell.
    pub fn narrow(&mut self, layout: VertexLayout, run: &StageContext) -> Result<()> {
        let store = CellStore::open(run.disk(), run.job.folder(), self.store.clone(), layout)?;
        let mut used = Bounds::EMPTY;
        for cell in CellId::first(store.n_cells()) {
            if used == self.bounds {
                break;
            }
            run.progress.check()?;
            used = used.joined(&Bounds::of(&store.load(cell)?.mesh));
        }
        self.bounds = used.or_origin();
        Ok(())
    }
}

/// Chunk headers, shared rows and file-system blocks on top of the bare rows of a store.
const PACK_OVERHEAD: f64 = 1.06;

/// Bytes on disk of the cells of a mesh.
pub fn store_bytes(n_vertices: u64, n_triangles: u64, layout: &VertexLayout) -> u64 {
    let (ids, records) = (layout.ids.bytes as f64, layout.schema.record_bytes() as f64);
    let bytes = n_vertices as f64 * (ids + records) + n_triangles as f64 * 3.0 * ids;
    (bytes * PACK_OVERHEAD) as u64
}

/// Cuts `source` into cells of about `cell_triangles` triangles.
pub fn partition(
    source: &MeshSource,
    cell_triangles: u64,
    run: &StageContext,
) -> Result<Partition> {
    let n_cells = plan_cells(source.n_triangles(), cell_triangles);
    let (partition, _) = cut(source, n_cells, Some(cell_triangles), run, |bounds, samples| {
        CellMap::Tree(CellTree::build(TurnedFrame::new(0, bounds), samples, n_cells))
    })?;
    Ok(partition)
}

/// Boxes of level 0 in a group of the first round that a sheet passes through.
const BOXES_OF_GROUP: u64 = 16;

/// Cuts `source` into the groups of the first round of a tree of tiles of about `tile_triangles` triangles.
pub fn partition_into_groups(
    source: &MeshSource,
    tile_triangles: u64,
    run: &StageContext,
) -> Result<(Partition, GroupGrid)> {
    let n_triangles = source.n_triangles();
    let n_cells = plan_cells(n_triangles, BOXES_OF_GROUP * tile_triangles);
    let (partition, map) = cut(source, n_cells, None, run, |bounds, samples| {
        let lattice = Lattice::choose(bounds, samples, n_triangles, tile_triangles);
        CellMap::Groups(GroupGrid::new(lattice, samples))
    })?;
    match map {
        CellMap::Groups(grid) => Ok((partition, grid)),
        CellMap::Tree(_) => Err(Error::Internal("a job of tiles has a tree of cells".to_owned())),
    }
}

/// Cuts `source` into the cells that `map` makes from its bounds and a sample for `n_cells` cells. Cells far above
/// `planned` triangles, if it is given, are split.
fn cut(
    source: &MeshSource,
    n_cells: u32,
    planned: Option<u64>,
    run: &StageContext,
    map: impl FnOnce(Bounds, &[[f64; 3]]) -> CellMap,
) -> Result<(Partition, CellMap)> {
    let layout = VertexLayout::new(source.schema(), source.n_vertices());
    let shares = |n_cells| shares(source, &layout, n_cells, run);
    // Sealed by itself: the passes below can only be taken up with the very same cells.
    let (bounds, tree) = run.job.sealed("partition tree", || {
        let shares = shares(n_cells);
        let blocks = 0..source.n_vertex_blocks();
        let Scan { bounds, samples } = scan(source, n_cells, blocks, shares.threads, run.progress)?;
        let bounds = bounds.or_origin();
        Ok((bounds, map(bounds, &samples)))
    })?;
    run.progress.add(source.n_triangles() / 8);
    let shares = shares(tree.n_cells());
    let (pack, place) = take_up(run, PACK_NAME, shares.table_bytes)?;
    let mut pack = if shares.writes_behind { pack.behind() } else { pack };
    let tally = tally(pack.chunks(), &layout, tree.n_cells())?;
    let checkpoints = Checkpoints::new(run);
    let plain_bytes = source.n_vertices() * CellTable::bytes_per_vertex(tree.n_cells());
    let table_folder = match plain_bytes > shares.table_bytes && is_local(source)? {
        true => Some(run.job.folder()),
        false => None,
    };
    let blocks = Blocks { vertices: 0..source.n_vertex_blocks(), faces: 0..source.n_face_blocks() };
    let mut passes = Passes {
        source,
        run,
        layout,
        tally,
        tree: &tree,
        blocks,
        shares,
        table_folder,
        is_near: table_folder.is_some(),
        place,
        checkpoints,
    };
    let table = match place.pass {
        Pass::Vertices => {
            let mut table = passes.begun_table()?;
            passes.vertices(Some(&mut table), &mut pack)?;
            let table = table.finish()?;
            passes.place = at_window(&table);
            Some(table)
        }
        Pass::Triangles => Some(passes.same_window()?),
        Pass::Shared => None,
    };
    let mut foreign = Gathering::new(shares.halo_bytes, TOGETHER);
    if let Some(table) = table {
        passes.triangles(table, &mut foreign, &mut pack)?;
    }
    let foreign = passes.halo(foreign, &mut pack)?;
    let middle = bounds.middle();
    let seams = passes.shared(foreign, middle, &mut pack)?;
    let dropped = passes.place.dropped;
    let store = StoreInfo {
        triangles: passes.tally.iter().map(|cell| cell.triangles).sum(),
        cells: passes.tally,
        shared_vertices: seams.n_shared,
        ..StoreInfo::default()
    };
    let store = match planned {
        Some(cell_triangles) => {
            split_overfull(store, &mut pack, &passes.layout, cell_triangles, 0, run)?
        }
        None => store,
    };
    let store = StoreInfo { packs: vec![pack.close(run.disk())?], ..store };
    let partition = Partition {
        store,
        bounds,
        degenerate_faces: dropped.degenerate,
        bad_faces: dropped.bad,
        seam_place: seams.place,
    };
    Ok((partition, tree))
}

fn shares(source: &MeshSource, layout: &VertexLayout, n_cells: u32, run: &StageContext) -> Shares {
    let store_bytes = store_bytes(source.n_vertices(), source.n_triangles(), layout);
    let sizes = Sizes { n_vertices: source.n_vertices(), n_cells, store_bytes, layout };
    Shares::new(sizes, run.threads, run.memory_bytes)
}
