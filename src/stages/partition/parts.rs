//! The partition in parts, one for each of many processes: the same passes over ranges of blocks.
//!
//! `scan_part` for each part, `tree_of_parts` once, `scatter_part` for each, `share_part` for each, `join_parts` once. Each
//! step depends on all parts of those before it. Rows of a cell lie in the packs of the parts in the order of the
//! input, so that the cells are those of one process.

use super::cell_table::CellTable;
use super::checkpoint::{Checkpoints, Dropped, Pass, ResumePoint, Seams, tally};
use super::halo::{Gathering, TOGETHER};
use super::locality::is_local;
use super::pages::Pages;
use super::passes::{Blocks, Passes};
use super::scan::{Scan, scan};
use super::{PACK_NAME, Partition, shares};
use serde::{Deserialize, Serialize};
use std::ops::Range;
use stonecut_io::ply::{BLOCK_ROWS, MeshSource};
use stonecut_mesh::bounds::Bounds;
use stonecut_mesh::global_vertex::GlobalVertex;
use stonecut_store::cell_id::CellId;
use stonecut_store::cells::{
    CellMap, CellTally, CellTree, Pack, PackFile, PackWriter, StoreInfo, TurnedFrame, VertexLayout,
    plan_cells, split_overfull,
};
use stonecut_store::pack_format::ChunkKind;
use stonecut_store::stage_context::StageContext;
use stonecut_system::error::{Error, Result};

/// File names of a part.
const SAMPLES_NAME: &str = "samples.cells";
const SHARED_NAME: &str = "shared.cells";

/// Samples in a chunk, and bytes of a sample.
const SAMPLE_ROWS: usize = 43_690;
const SAMPLE_BYTES: usize = 24;

/// One of the parts of an input: consecutive blocks of vertices and of faces.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Part {
    /// From 0.
    pub index: u32,
    /// Number of parts.
    pub of: u32,
}

impl Part {
    fn range(self, n_blocks: u64) -> Range<u64> {
        let at = |index: u32| n_blocks * u64::from(index) / u64::from(self.of);
        at(self.index)..at(self.index + 1)
    }

    fn blocks(self, source: &MeshSource) -> Blocks {
        let (vertices, faces) = (source.n_vertex_blocks(), source.n_face_blocks());
        Blocks { vertices: self.range(vertices), faces: self.range(faces) }
    }
}

/// The number of the part that holds a block.
fn part_of(block: u64, n_blocks: u64, n_parts: u32) -> u32 {
    let guess = (block * u64::from(n_parts) / n_blocks.max(1)) as u32;
    let holds = |index: &u32| Part { index: *index, of: n_parts }.range(n_blocks).end > block;
    (guess..n_parts).find(holds).unwrap_or(n_parts - 1)
}

/// Findings of `scan_part`.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Scanned {
    /// Bounds of the vertices, if there are any.
    pub bounds: Option<Bounds>,
    /// The sample.
    pub samples: PackFile,
}

/// Checks the vertices of a part, and takes its part of the sample.
pub fn scan_part(
    source: &MeshSource,
    cell_triangles: u64,
    part: Part,
    run: &StageContext,
) -> Result<Scanned> {
    let n_cells = plan_cells(source.n_triangles(), cell_triangles);
    let layout = VertexLayout::new(source.schema(), source.n_vertices());
    let threads = shares(source, &layout, n_cells, run).threads;
    let blocks = part.blocks(source).vertices;
    let is_empty = blocks.is_empty();
    let Scan { bounds, samples } = scan(source, n_cells, blocks, threads, run.progress)?;
    let mut pack = PackWriter::create(run.disk(), &run.job.path(SAMPLES_NAME))?;
    for rows in samples.chunks(SAMPLE_ROWS) {
        let bytes: Vec<u8> = rows.iter().flatten().flat_map(|x| x.to_le_bytes()).collect();
        pack.append(CellId(0), ChunkKind::Samples, &bytes)?;
    }
    let bounds = (!is_empty).then_some(bounds);
    Ok(Scanned { bounds, samples: pack.close(run.disk())? })
}

/// Cuts space into cells by the samples of all parts, and records that.
pub fn tree_of_parts(
    source: &MeshSource,
    cell_triangles: u64,
    parts: &[Scanned],
    run: &StageContext,
) -> Result<()> {
    let bounds =
        parts.iter().filter_map(|part| part.bounds).fold(Bounds::EMPTY, |a, b| a.joined(&b));
    let bounds = bounds.or_origin();
    let files: Vec<PackFile> = parts.iter().map(|part| part.samples.clone()).collect();
    let pack = Pack::open_all(run.disk(), run.job.folder(), &files, 1)?;
    let (mut samples, mut payload) = (Vec::new(), Vec::new());
    for chunk in pack.chunks_of(CellId(0)).iter().filter(|chunk| chunk.kind == ChunkKind::Samples) {
        pack.read(chunk, &mut payload)?;
        let numbers: Vec<f64> =
            payload.as_chunks().0.iter().map(|bytes| f64::from_le_bytes(*bytes)).collect();
        samples.extend_from_slice(numbers.as_chunks::<{ SAMPLE_BYTES / 8 }>().0);
    }
    let n_cells = plan_cells(source.n_triangles(), cell_triangles);
    let tree = CellMap::Tree(CellTree::build(TurnedFrame::new(0, bounds), &samples, n_cells));
    run.job.record(TREE, &(bounds, tree))?;
    run.job.record(LOCAL, &is_local(source)?)
}

/// Outcomes of `tree_of_parts`.
const TREE: &str = "partition tree";
const LOCAL: &str = "faces are local";

fn found<T: serde::de::DeserializeOwned>(run: &StageContext, name: &str) -> Result<T> {
    let missing = || {
        let what = format!("has no '{name}' of an earlier part; plan again in another folder");
        Error::corrupt(run.job.folder(), what)
    };
    run.job.outcome(name)?.ok_or_else(missing)
}

/// Outcome of `scatter_part`.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Scattered {
    /// Vertices and triangles of the part, and its pairs of a vertex and a foreign cell by the part of the vertex.
    pub cells: PackFile,
    /// Faces left out.
    pub dropped: Dropped,
}

/// Sends the vertices and the triangles of a part to their cells.
pub fn scatter_part(source: &MeshSource, part: Part, run: &StageContext) -> Result<Scattered> {
    let (_, tree): (Bounds, CellMap) = found(run, TREE)?;
    let is_local: bool = found(run, LOCAL)?;
    let mut passes = passes(source, &tree, part, run);
    let pack = PackWriter::create(run.disk(), &run.job.path(PACK_NAME))?;
    let mut pack = if passes.shares.writes_behind { pack.behind() } else { pack };
    let n_vertices = source.n_vertices();
    let table_bytes = passes.shares.table_bytes;
    let pages = || CellTable::paged(n_vertices, Pages::new(source, &tree, table_bytes));
    let mut table = is_local.then(pages);
    passes.vertices(table.as_mut(), &mut pack)?;
    let table = match table {
        Some(table) => table,
        // In no order, any face may use any vertex: all of them, in a file if need be.
        None => passes.window(0, n_vertices)?,
    };
    passes.place = ResumePoint { pass: Pass::Triangles, ..ResumePoint::default() };
    let n_blocks = source.n_vertex_blocks();
    let note_of = |id: GlobalVertex| CellId(part_of(id.0 / BLOCK_ROWS, n_blocks, part.of));
    let mut foreign = Gathering::new(passes.shares.halo_bytes, &note_of);
    passes.triangles(table, &mut foreign, &mut pack)?;
    foreign.note(&mut pack)?;
    Ok(Scattered { cells: pack.close(run.disk())?, dropped: passes.place.dropped })
}

/// Outcome of `share_part`.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct SharedPart {
    /// Copies of the shared vertices of the part, and marks.
    pub cells: PackFile,
    /// Its shared vertices.
    pub seams: Seams,
}

/// Copies the vertices of a part to the foreign cells that use them, and marks them in all cells that hold them.
pub fn share_part(
    source: &MeshSource,
    part: Part,
    scattered: &[Scattered],
    run: &StageContext,
) -> Result<SharedPart> {
    let (bounds, tree): (Bounds, CellMap) = found(run, TREE)?;
    let files: Vec<PackFile> = scattered.iter().map(|part| part.cells.clone()).collect();
    let noted = Pack::open_notes(run.disk(), run.job.folder(), &files, part.of)?;
    let mut passes = passes(source, &tree, part, run);
    let foreign = Gathering::new(passes.shares.halo_bytes, TOGETHER);
    let foreign = foreign.finish(Some((&noted, CellId(part.index))), run.job.folder())?;
    drop(noted);
    let mut pack = PackWriter::create(run.disk(), &run.job.path(SHARED_NAME))?;
    passes.place = ResumePoint { pass: Pass::Shared, ..ResumePoint::default() };
    let seams = passes.shared(foreign, bounds.middle(), &mut pack)?;
    Ok(SharedPart { cells: pack.close(run.disk())?, seams })
}

/// Joins the parts, and splits cells far above the plan.
pub fn join_parts(
    source: &MeshSource,
    cell_triangles: u64,
    (scattered, shared): (&[Scattered], &[SharedPart]),
    run: &StageContext,
) -> Result<Partition> {
    let (bounds, tree): (Bounds, CellMap) = found(run, TREE)?;
    let layout = VertexLayout::new(source.schema(), source.n_vertices());
    let cells = scattered.iter().map(|part| &part.cells);
    let packs: Vec<PackFile> =
        cells.chain(shared.iter().map(|part| &part.cells)).cloned().collect();
    let pack = Pack::open_all(run.disk(), run.job.folder(), &packs, tree.n_cells() as usize)?;
    let cells: Vec<CellTally> = tally(pack.chunks(), &layout, tree.n_cells())?;
    drop(pack);
    let mut seams = Seams::default();
    let off_sq = |place: [f64; 3]| {
        let middle = bounds.middle();
        (0..3).map(|k| (place[k] - middle[k]).powi(2)).sum::<f64>()
    };
    for part in shared.iter().map(|part| part.seams) {
        seams.n_shared += part.n_shared;
        let is_nearer = |place| seams.place.is_none_or(|nearest| off_sq(place) < off_sq(nearest));
        if let Some(place) = part.place.filter(|&place| is_nearer(place)) {
            seams.place = Some(place);
        }
    }
    let store = StoreInfo {
        packs,
        triangles: cells.iter().map(|cell| cell.triangles).sum(),
        cells,
        shared_vertices: seams.n_shared,
        ..StoreInfo::default()
    };
    let mut own = PackWriter::create(run.disk(), &run.job.path(PACK_NAME))?;
    let mut store = split_overfull(store, &mut own, &layout, cell_triangles, 0, run)?;
    store.packs.push(own.close(run.disk())?);
    let dropped = || scattered.iter().map(|part| part.dropped);
    Ok(Partition {
        store,
        bounds,
        degenerate_faces: dropped().map(|part| part.degenerate).sum(),
        bad_faces: dropped().map(|part| part.bad).sum(),
        seam_place: seams.place,
    })
}

/// The passes over a part, without checkpoints.
fn passes<'a>(
    source: &'a MeshSource,
    tree: &'a CellMap,
    part: Part,
    run: &'a StageContext<'a>,
) -> Passes<'a> {
    let layout = VertexLayout::new(source.schema(), source.n_vertices());
    let shares = shares(source, &layout, tree.n_cells(), run);
    Passes {
        source,
        run,
        layout,
        tally: vec![CellTally::default(); tree.n_cells() as usize],
        tree,
        blocks: part.blocks(source),
        shares,
        table_folder: Some(run.job.folder()),
        is_near: false,
        place: ResumePoint::default(),
        checkpoints: Checkpoints::new(run),
    }
}
