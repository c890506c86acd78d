//! Cuts survivors into new cells whose seams run elsewhere.
//!
//! The same as partitioning, but every old cell already holds positions for all its corners, so one pass
//! over the survivors is enough. A vertex interior to an old cell is shared if its triangles, or those of another
//! wedge in its place, go to several new cells; for a vertex on an old seam that is settled once all old cells are through.

use stonecut_io::{ExternalSort, halves, whole};
use stonecut_mesh::bounds::Bounds;
use stonecut_mesh::global_vertex::GlobalVertex;
use stonecut_store::cell_id::CellId;
use stonecut_store::cells::{
    BEHIND_BYTES, CellTally, CellTree, PackWriter, Scatter, StoreInfo, SurvivorPack, Survivors,
    TurnedFrame, n_samples, plan_cells, split_overfull, survivor_bytes,
};
use stonecut_store::pack_format::ChunkKind;
use stonecut_store::stage_context::StageContext;
use stonecut_system::error::Result;
use stonecut_system::parallel::in_order;

/// Share of the memory budget for each of the three sets of scatter buffers.
const BUFFER_SHARE: u64 = 16;

/// Share of the memory budget for old cells that are read, and what reading one takes of what it takes on disk.
const READ_SHARE: u64 = 2;
const COPIES: u64 = 5;

/// Share of the memory budget to sort the vertices of old seams in, and again to take them out.
const SORT_SHARE: u64 = 16;

/// Name under which a job within a bound records the tree that a round is cut by.
fn tree_record(round: u32) -> String {
    format!("{TREE}{round}")
}

/// True if an outcome is such a record.
pub fn is_tree_record(name: &str) -> bool {
    name.starts_with(TREE)
}

const TREE: &str = "tree ";

/// Cuts `survivors` into cells of about `cell_triangles`, for round number `round`.
pub fn recut(
    survivors: &SurvivorPack,
    cell_triangles: u64,
    round: u32,
    run: &StageContext,
) -> Result<StoreInfo> {
    let info = survivors.info();
    let build = || {
        let n_cells = plan_cells(info.triangles, cell_triangles);
        let (bounds, samples) = sample(survivors, n_cells, run)?;
        Ok(CellTree::build(TurnedFrame::new(round, bounds), &samples, n_cells))
    };
    let tree = match survivors.layout().has_reach {
        // Another attempt at a bound has the same cells.
        true => run.job.sealed(&tree_record(round), build)?,
        false => build()?,
    };
    let by_place = |_: CellId, part: &Survivors| {
        let mut finder = tree.finder();
        let cells: Vec<CellId> = part.mesh.positions.iter().map(|&p| finder.cell_of(p)).collect();
        part.mesh.triangles.iter().map(|t| cells[t[0] as usize]).collect()
    };
    let map = NewCells { n_cells: tree.n_cells(), of_triangles: &by_place };
    let (mut pack, store) = recut_by(survivors, map, round, run)?;
    let layout = survivors.layout();
    let store = split_overfull(store, &mut pack, layout, cell_triangles, round, run)?;
    seal(pack, store, run)
}

/// New cells of triangles.
#[derive(Clone, Copy)]
pub struct NewCells<'a> {
    /// Number of new cells.
    pub n_cells: u32,
    /// The new cell of every triangle of an old cell, which is given with its number.
    pub of_triangles: &'a (dyn Fn(CellId, &Survivors) -> Vec<CellId> + Sync),
}

/// Cuts `survivors` into the cells that `map` says, for round number `round`. A new cell has the triangles of an old cell
/// together and in their order, old cells in the order of their numbers.
pub fn regroup(
    survivors: &SurvivorPack,
    map: NewCells,
    round: u32,
    run: &StageContext,
) -> Result<StoreInfo> {
    let (pack, store) = recut_by(survivors, map, round, run)?;
    seal(pack, store, run)
}

fn recut_by(
    survivors: &SurvivorPack,
    map: NewCells,
    round: u32,
    run: &StageContext,
) -> Result<(PackWriter, StoreInfo)> {
    let name = format!("round-{round}.cells");
    let pack = PackWriter::create(run.disk(), &run.job.path(&name))?;
    // Of the budget a sixteenth is spoken for by nothing else.
    let writes_behind = run.threads > 1 && BEHIND_BYTES <= run.memory_bytes / 64;
    let mut pack = if writes_behind { pack.behind() } else { pack };
    let mut tally = vec![CellTally::default(); map.n_cells as usize];
    let shared_vertices = scatter(survivors, map, &mut tally, &mut pack, run)?;
    let store = StoreInfo {
        triangles: tally.iter().map(|cell| cell.triangles).sum(),
        cells: tally,
        shared_vertices,
        has_channels: true,
        ..StoreInfo::default()
    };
    Ok((pack, store))
}

fn seal(pack: PackWriter, store: StoreInfo, run: &StageContext) -> Result<StoreInfo> {
    Ok(StoreInfo { packs: vec![pack.close(run.disk())?], ..store })
}

/// Threads that may read old cells at a time: each has one cell as it lies on disk and as it was read, and rows of two
/// cells under way.
fn readers(survivors: &SurvivorPack, run: &StageContext) -> usize {
    let cells = survivors.info().cells.iter();
    let largest = cells.map(|&cell| survivor_bytes(cell, survivors.layout())).max().unwrap_or(0);
    let share = run.memory_bytes / READ_SHARE;
    (share / (COPIES * largest).max(1)).clamp(1, run.threads.max(1) as u64) as usize
}

#[derive(Default)]
struct CellSample {
    bounds: Bounds,
    samples: Vec<[f64; 3]>,
}

/// Bounds and an even sample of the survivors' vertices.
fn sample(
    survivors: &SurvivorPack,
    n_cells: u32,
    run: &StageContext,
) -> Result<(Bounds, Vec<[f64; 3]>)> {
    let info = survivors.info();
    let n_vertices: u64 = info.cells.iter().map(|cell| cell.vertices).sum();
    let step = (n_vertices / n_samples(n_vertices, n_cells)).max(1) as usize;
    let mut bounds = Bounds::EMPTY;
    let mut all = Vec::new();
    in_order(
        info.cells.len() as u64,
        readers(survivors, run),
        run.progress,
        |cell, out: &mut CellSample| {
            let part = survivors.load(CellId::at(cell as usize))?;
            // The kernel leaves vertices in no order that a regular step could fall in with.
            out.samples = part.mesh.positions.iter().step_by(step).copied().collect();
            out.bounds = Bounds::around(&part.mesh.positions);
            Ok(())
        },
        |_, found| {
            bounds = bounds.joined(&found.bounds);
            all.append(&mut found.samples);
            Ok(())
        },
    )?;
    Ok((bounds.or_origin(), all))
}

/// An old cell, taken apart into rows for its new cells.
#[derive(Default)]
struct Apart {
    /// Rows by new cell, one set per chunk kind.
    vertices: Vec<(CellId, Vec<u8>)>,
    triangles: Vec<(CellId, Vec<u8>)>,
    marks: Vec<(CellId, Vec<u8>)>,
    /// Vertices of old seams, each behind the key of its place, and the new cells that use them.
    open: Vec<(u64, GlobalVertex, CellId)>,
    n_shared: u64,
}

fn scatter(
    survivors: &SurvivorPack,
    map: NewCells,
    tally: &mut [CellTally],
    pack: &mut PackWriter,
    run: &StageContext,
) -> Result<u64> {
    let layout = survivors.layout();
    let id_bytes = layout.ids.bytes;
    let row_bytes = id_bytes + layout.row_bytes(true);
    let triangle_bytes = layout.triangle_row_bytes(true);
    let buffers = |kind| Scatter::new(kind, map.n_cells, run.memory_bytes / BUFFER_SHARE);
    let mut vertices = buffers(ChunkKind::Vertices);
    let mut triangles = buffers(ChunkKind::Triangles);
    let mut marks = buffers(ChunkKind::SharedIds);
    let memory = (run.memory_bytes / SORT_SHARE).clamp(1 << 20, 256 << 20) as usize;
    let mut open = ExternalSort::<5>::new(run.job.folder(), memory);
    let mut n_shared = 0;
    in_order(
        survivors.info().cells.len() as u64,
        readers(survivors, run),
        run.progress,
        |index, out: &mut Apart| {
            let cell = CellId::at(index as usize);
            let part = survivors.load(cell)?;
            let cells = (map.of_triangles)(cell, &part);
            *out = take_apart(&part, &cells, survivors);
            Ok(())
        },
        |index, apart| {
            for (cell, rows) in &apart.vertices {
                tally[*cell].vertices += (rows.len() / row_bytes) as u64;
                vertices.push(pack, *cell, rows)?;
            }
            for (cell, rows) in &apart.triangles {
                tally[*cell].triangles += (rows.len() / triangle_bytes) as u64;
                triangles.push(pack, *cell, rows)?;
            }
            for (cell, rows) in &apart.marks {
                marks.push(pack, *cell, rows)?;
            }
            for &(place, id, cell) in &apart.open {
                let ([a, b], [high, low]) = (halves(place), halves(id.0));
                open.push([a, b, high, low, cell.0])?;
            }
            n_shared += apart.n_shared;
            run.progress.add(survivors.info().cells[index as usize].triangles);
            Ok(())
        },
    )?;
    // Vertices in one place, with the cells that use them.
    let mut users: Vec<(GlobalVertex, CellId)> = Vec::new();
    let mut last = None;
    let mut settle = |users: &mut Vec<(GlobalVertex, CellId)>| -> Result<()> {
        users.dedup();
        let is_shared = users.iter().any(|user| user.1 != users[0].1);
        let mut row = Vec::new();
        for of_vertex in users.chunk_by(|a, b| a.0 == b.0).filter(|_| is_shared) {
            n_shared += 1;
            row.clear();
            layout.ids.push(of_vertex[0].0, &mut row);
            of_vertex.iter().try_for_each(|&(_, cell)| marks.push(pack, cell, &row))?;
        }
        users.clear();
        Ok(())
    };
    open.drain(|[a, b, high, low, cell]| {
        if last.replace([a, b]).is_some_and(|last| last != [a, b]) {
            settle(&mut users)?;
        }
        users.push((GlobalVertex(whole(high, low)), CellId(cell)));
        Ok(())
    })?;
    settle(&mut users)?;
    vertices.finish(pack)?;
    triangles.finish(pack)?;
    marks.finish(pack)?;
    Ok(n_shared)
}

/// A number for a place. Two places have the same one by chance only, and their vertices are shared together then.
fn place_key(place: [f64; 3]) -> u64 {
    place.iter().fold(0, |key: u64, x| {
        // Adding 0 makes -0 and 0 the same place.
        let mixed = (key ^ (x + 0.0).to_bits()).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        mixed ^ mixed >> 29
    })
}

/// Takes an old cell apart; `cells` has the new cell of every triangle.
fn take_apart(part: &Survivors, cells: &[CellId], survivors: &SurvivorPack) -> Apart {
    let layout = survivors.layout();
    let record_bytes = layout.schema.record_bytes();
    let mut out = Apart::default();
    let mut order: Vec<(CellId, u32)> = cells.iter().copied().zip(0..).collect();
    order.sort_unstable();
    // Every vertex with every new cell that uses it, cell by cell.
    let mut users: Vec<(u32, CellId)> = Vec::with_capacity(part.ids.len() + part.ids.len() / 8);
    let mut used_by = vec![CellId(u32::MAX); part.ids.len()];
    for run in order.chunk_by(|a, b| a.0 == b.0) {
        let cell = run[0].0;
        let mut rows = Vec::with_capacity(run.len() * layout.triangle_row_bytes(true));
        for &(_, triangle) in run {
            for v in part.mesh.triangles[triangle as usize] {
                layout.ids.push(part.ids[v as usize], &mut rows);
                if std::mem::replace(&mut used_by[v as usize], cell) != cell {
                    users.push((v, cell));
                }
            }
            layout.push_original(&part.mesh, triangle as usize, &mut rows);
        }
        out.triangles.push((cell, rows));
    }
    let users = by_vertex(&users, part.ids.len());
    // The wedges of a seam lie in one place, and their triangles may go to different cells.
    let has_seams = layout.codec.has_seams(&layout.schema);
    let mut marked: Vec<(CellId, GlobalVertex)> = Vec::new();
    let mut by_place: Vec<(u64, u32, CellId)> = Vec::new();
    for of_vertex in users.chunk_by(|a, b| a.0 == b.0) {
        let v = of_vertex[0].0 as usize;
        if has_seams || part.shared[v] {
            let key = place_key(part.mesh.positions[v]);
            by_place.extend(of_vertex.iter().map(|&(v, cell)| (key, v, cell)));
        } else if of_vertex.len() > 1 {
            out.n_shared += 1;
            marked.extend(of_vertex.iter().map(|&(_, cell)| (cell, part.ids[v])));
        }
    }
    by_place.sort_unstable();
    for here in by_place.chunk_by(|a, b| a.0 == b.0) {
        if here.iter().any(|&(_, v, _)| part.shared[v as usize]) {
            out.open.extend(here.iter().map(|&(key, v, cell)| (key, part.ids[v as usize], cell)));
        } else if here.iter().any(|user| user.2 != here[0].2) {
            out.n_shared += here.chunk_by(|a, b| a.1 == b.1).count() as u64;
            marked.extend(here.iter().map(|&(_, v, cell)| (cell, part.ids[v as usize])));
        }
    }
    marked.sort_unstable();
    for run in marked.chunk_by(|a, b| a.0 == b.0) {
        let mut rows = Vec::with_capacity(run.len() * layout.ids.bytes);
        run.iter().for_each(|&(_, id)| layout.ids.push(id, &mut rows));
        out.marks.push((run[0].0, rows));
    }
    let mut users = users;
    // Stable, so that vertices stay in order.
    users.sort_by_key(|&(_, cell)| cell);
    for run in users.chunk_by(|a, b| a.1 == b.1) {
        let mut rows = Vec::with_capacity(run.len() * (layout.ids.bytes + layout.row_bytes(true)));
        for &(vertex, _) in run {
            let v = vertex as usize;
            layout.ids.push(part.ids[v], &mut rows);
            rows.extend_from_slice(&part.records[v * record_bytes..(v + 1) * record_bytes]);
            part.mesh
                .channels_of(vertex)
                .iter()
                .for_each(|c| rows.extend_from_slice(&c.to_le_bytes()));
        }
        out.vertices.push((run[0].1, rows));
    }
    out
}

/// Pairs of a vertex and a cell in the order of vertices, those of one vertex in the order that they have.
fn by_vertex(pairs: &[(u32, CellId)], n_vertices: usize) -> Vec<(u32, CellId)> {
    let mut next = vec![0_u32; n_vertices + 1];
    pairs.iter().for_each(|&(v, _)| next[v as usize + 1] += 1);
    for v in 1..=n_vertices {
        next[v] += next[v - 1];
    }
    let mut sorted = vec![(0, CellId(0)); pairs.len()];
    for &(v, cell) in pairs {
        sorted[next[v as usize] as usize] = (v, cell);
        next[v as usize] += 1;
    }
    sorted
}
