//! Stage 1: from a mesh file to a store of cells.
//!
//! Three passes after the scan, all I/O sequential: vertices go to the cell of their position, triangles to
//! the cell of their first corner, and the vertices that triangles of another cell use are copied there.
//! It does not look at connectivity and moves nothing.

mod scan;
mod tree;

pub use scan::{Scan, n_samples, scan};
pub use tree::{CellTree, Frame};

use crate::cells::{CellTally, PackWriter, Scatter, StoreInfo, VertexLayout};
use crate::error::{Error, Result};
use crate::format::ChunkKind;
use crate::parallel::in_order;
use crate::ply::{BLOCK_ROWS, FaceBlock, MeshSource, VertexBlock};
use crate::run::Run;
use serde::{Deserialize, Serialize};

/// Share of the memory budget that scatter buffers may take.
const BUFFER_SHARE: u64 = 6;

/// File name of the first round's pack.
const PACK_NAME: &str = "round-0.cells";

/// What partitioning leaves.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Partition {
    /// The store of cells.
    pub store: StoreInfo,
    /// Lower and upper corner of the bounding box.
    pub bounds: [[f64; 3]; 2],
    /// Faces dropped because a corner repeats or is missing.
    pub degenerate_faces: u64,
}

/// Cells for `n_triangles` triangles, none of them planned above `cell_triangles`.
pub fn plan_cells(n_triangles: u64, cell_triangles: u64) -> u32 {
    n_triangles.div_ceil(cell_triangles.max(1)).clamp(1, u64::from(u32::MAX / 2)) as u32
}

/// Peak memory of this stage in bytes: the cell-of-vertex table, buffers, blocks and samples.
pub fn memory_bytes(n_vertices: u64, n_cells: u32, threads: usize, budget_bytes: u64) -> u64 {
    let table = n_vertices * CellTable::bytes_per_vertex(n_cells);
    let buffers = Scatter::bytes(n_cells, budget_bytes / BUFFER_SHARE);
    let blocks = threads as u64 * 2 * BLOCK_ROWS * 64;
    table + buffers + blocks + 24 * n_samples(n_vertices, n_cells)
}

/// Cuts `source` into cells of about `cell_triangles` triangles.
pub fn partition(source: &MeshSource, cell_triangles: u64, run: &Run) -> Result<Partition> {
    let n_cells = plan_cells(source.n_faces(), cell_triangles);
    let Scan { bounds, samples } = scan(source, n_cells, run.threads, run.progress)?;
    run.progress.add(source.n_faces() / 8);
    let tree = CellTree::build(Frame::new(0, bounds), &samples, n_cells);
    drop(samples);
    let mut pack = PackWriter::create(run.disk(), &run.job.path(PACK_NAME))?;
    let layout = VertexLayout::new(source.schema(), source.n_vertices());
    let mut passes = Passes {
        source,
        run,
        layout,
        tally: vec![CellTally::default(); tree.n_cells() as usize],
        tree,
    };
    let table = passes.vertices(&mut pack)?;
    let (foreign, degenerate_faces) = passes.triangles(&table, &mut pack)?;
    drop(table);
    let shared_vertices = passes.shared(foreign, &mut pack)?;
    pack.sync()?;
    run.disk().sync_folder_of(&run.job.path(PACK_NAME))?;
    let store = StoreInfo {
        pack: PACK_NAME.to_owned(),
        pack_bytes: pack.length(),
        triangles: passes.tally.iter().map(|cell| cell.triangles).sum(),
        cells: passes.tally,
        shared_vertices,
        has_channels: false,
    };
    Ok(Partition { store, bounds, degenerate_faces })
}

/// The cell of every vertex: 2 bytes each while there are at most 65,536 cells, else 4.
enum CellTable {
    Narrow(Vec<u16>),
    Wide(Vec<u32>),
}

impl CellTable {
    fn bytes_per_vertex(n_cells: u32) -> u64 {
        if n_cells <= 1 << 16 { 2 } else { 4 }
    }

    fn new(n_vertices: u64, n_cells: u32) -> CellTable {
        let n = n_vertices as usize;
        match Self::bytes_per_vertex(n_cells) {
            2 => CellTable::Narrow(Vec::with_capacity(n)),
            _ => CellTable::Wide(Vec::with_capacity(n)),
        }
    }

    fn extend(&mut self, cells: &[u32]) {
        match self {
            CellTable::Narrow(table) => table.extend(cells.iter().map(|&cell| cell as u16)),
            CellTable::Wide(table) => table.extend_from_slice(cells),
        }
    }

    #[inline]
    fn get(&self, vertex: u64) -> u32 {
        match self {
            CellTable::Narrow(table) => u32::from(table[vertex as usize]),
            CellTable::Wide(table) => table[vertex as usize],
        }
    }
}

/// A vertex, and a cell that uses it without owning it.
type Foreign = (u64, u32);

struct Passes<'a> {
    source: &'a MeshSource,
    run: &'a Run<'a>,
    layout: VertexLayout,
    tree: CellTree,
    tally: Vec<CellTally>,
}

/// A block of rows, sorted by cell.
#[derive(Default)]
struct Sorted {
    vertices: VertexBlock,
    faces: FaceBlock,
    /// Cell of each row of the block.
    cells: Vec<u32>,
    rows: Vec<u8>,
    /// Cell and number of rows of each run in `rows`.
    runs: Vec<(u32, u32)>,
    foreign: Vec<Foreign>,
    /// Per cell: where its next row goes; all zero between blocks.
    cursor: Vec<u32>,
}

impl Sorted {
    /// Orders rows by cell (stable); `write` appends row `i` at the end of a slice of `row_bytes`.
    fn sort(&mut self, n_cells: u32, row_bytes: usize, mut write: impl FnMut(usize, &mut [u8])) {
        self.cursor.resize(n_cells as usize, 0);
        self.runs.clear();
        for &cell in &self.cells {
            if self.cursor[cell as usize] == 0 {
                self.runs.push((cell, 0));
            }
            self.cursor[cell as usize] += 1;
        }
        let mut start = 0;
        for run in &mut self.runs {
            run.1 = self.cursor[run.0 as usize];
            self.cursor[run.0 as usize] = start;
            start += run.1;
        }
        self.rows.resize(self.cells.len() * row_bytes, 0);
        for (i, &cell) in self.cells.iter().enumerate() {
            let at = self.cursor[cell as usize] as usize * row_bytes;
            self.cursor[cell as usize] += 1;
            write(i, &mut self.rows[at..at + row_bytes]);
        }
        for run in &self.runs {
            self.cursor[run.0 as usize] = 0;
        }
    }

    fn push_runs(
        &self,
        row_bytes: usize,
        scatter: &mut Scatter,
        pack: &mut PackWriter,
    ) -> Result<()> {
        let mut at = 0;
        for &(cell, n_rows) in &self.runs {
            let end = at + n_rows as usize * row_bytes;
            scatter.push(pack, cell, &self.rows[at..end])?;
            at = end;
        }
        Ok(())
    }
}

impl Passes<'_> {
    fn buffers(&self, kind: ChunkKind) -> Scatter {
        Scatter::new(kind, self.tree.n_cells(), self.run.memory_bytes / BUFFER_SHARE)
    }

    /// Sends every vertex to the cell of its position.
    fn vertices(&mut self, pack: &mut PackWriter) -> Result<CellTable> {
        let (source, run, tree, ids) = (self.source, self.run, &self.tree, self.layout.ids);
        let n_cells = tree.n_cells();
        let record_bytes = self.layout.schema.record_bytes();
        let row_bytes = ids.bytes + record_bytes;
        let mut scatter = self.buffers(ChunkKind::Vertices);
        let mut table = CellTable::new(source.n_vertices(), n_cells);
        let (schema, tally) = (&self.layout.schema, &mut self.tally);
        in_order(
            source.n_vertex_blocks(),
            run.threads,
            run.progress,
            |index, out: &mut Sorted| {
                let mut block = std::mem::take(&mut out.vertices);
                source.read_vertices(index, &mut block)?;
                out.cells.clear();
                let records = block.records.chunks_exact(record_bytes);
                out.cells.extend(records.map(|record| tree.cell_of(schema.position(record))));
                out.sort(n_cells, row_bytes, |i, row| {
                    let id = block.first + i as u64;
                    row[..ids.bytes].copy_from_slice(&id.to_le_bytes()[..ids.bytes]);
                    row[ids.bytes..]
                        .copy_from_slice(&block.records[i * record_bytes..(i + 1) * record_bytes]);
                });
                out.vertices = block;
                Ok(())
            },
            |_, sorted| {
                table.extend(&sorted.cells);
                for &(cell, n_rows) in &sorted.runs {
                    tally[cell as usize].vertices += u64::from(n_rows);
                }
                sorted.push_runs(row_bytes, &mut scatter, pack)
            },
        )?;
        scatter.finish(pack)?;
        run.progress.add(source.n_faces() / 4);
        Ok(table)
    }

    /// Sends every triangle to the cell of its first corner and notes the corners that lie elsewhere.
    fn triangles(
        &mut self,
        table: &CellTable,
        pack: &mut PackWriter,
    ) -> Result<(Vec<Foreign>, u64)> {
        let (source, run, ids) = (self.source, self.run, self.layout.ids);
        let n_cells = self.tree.n_cells();
        let row_bytes = 3 * ids.bytes;
        let mut scatter = self.buffers(ChunkKind::Triangles);
        let mut foreign: Vec<Foreign> = Vec::new();
        let mut sorted_up_to = 0;
        let mut degenerate = 0;
        let tally = &mut self.tally;
        in_order(
            source.n_face_blocks(),
            run.threads,
            run.progress,
            |index, out: &mut Sorted| {
                let mut faces = std::mem::take(&mut out.faces);
                source.read_faces(index, &mut faces)?;
                out.cells.clear();
                out.foreign.clear();
                for corners in &faces.triangles {
                    let cells = corners.map(|v| table.get(v));
                    out.cells.push(cells[0]);
                    if cells[1] != cells[0] {
                        out.foreign.push((corners[1], cells[0]));
                    }
                    if cells[2] != cells[0] {
                        out.foreign.push((corners[2], cells[0]));
                    }
                }
                out.foreign.sort_unstable();
                out.foreign.dedup();
                out.sort(n_cells, row_bytes, |i, row| {
                    for (k, id) in faces.triangles[i].iter().enumerate() {
                        let place = &mut row[k * ids.bytes..(k + 1) * ids.bytes];
                        place.copy_from_slice(&id.to_le_bytes()[..ids.bytes]);
                    }
                });
                out.faces = faces;
                Ok(())
            },
            |_, sorted| {
                degenerate += sorted.faces.n_degenerate;
                for &(cell, n_rows) in &sorted.runs {
                    tally[cell as usize].triangles += u64::from(n_rows);
                }
                foreign.append(&mut sorted.foreign);
                // In shuffled input the same pair comes again and again; keep the list near its final size.
                if foreign.len() > 2 * sorted_up_to + 1_000_000 {
                    foreign.sort_unstable();
                    foreign.dedup();
                    sorted_up_to = foreign.len();
                }
                run.progress.add(sorted.cells.len() as u64 / 2);
                sorted.push_runs(row_bytes, &mut scatter, pack)
            },
        )?;
        scatter.finish(pack)?;
        foreign.sort_unstable();
        foreign.dedup();
        Ok((foreign, degenerate))
    }

    /// Copies every vertex to the foreign cells that use it, and marks it in all cells that hold it.
    ///
    /// Returns how many vertices are shared.
    fn shared(&mut self, foreign: Vec<Foreign>, pack: &mut PackWriter) -> Result<u64> {
        let (source, run, ids) = (self.source, self.run, self.layout.ids);
        let record_bytes = self.layout.schema.record_bytes();
        let mut rows = self.buffers(ChunkKind::Vertices);
        let mut marks = self.buffers(ChunkKind::SharedIds);
        let mut blocks: Vec<u64> = foreign.iter().map(|&(id, _)| id / BLOCK_ROWS).collect();
        blocks.dedup();
        let mut at = 0;
        let mut n_shared = 0;
        let mut row = Vec::new();
        in_order(
            blocks.len() as u64,
            run.threads,
            run.progress,
            |index, block: &mut VertexBlock| source.read_vertices(blocks[index as usize], block),
            |index, block| {
                let end = block.first + (block.records.len() / record_bytes) as u64;
                while let Some(&(id, _)) = foreign.get(at).filter(|(id, _)| *id < end) {
                    let start = (id - block.first) as usize * record_bytes;
                    let record =
                        block.records.get(start..start + record_bytes).ok_or_else(|| {
                            Error::bad_input(
                                source.path(),
                                format!("block {index} changed while it was read"),
                            )
                        })?;
                    row.clear();
                    ids.push(id, &mut row);
                    marks.push(
                        pack,
                        self.tree.cell_of(self.layout.schema.position(record)),
                        &row,
                    )?;
                    row.extend_from_slice(record);
                    while let Some(&(_, cell)) = foreign.get(at).filter(|(other, _)| *other == id) {
                        rows.push(pack, cell, &row)?;
                        marks.push(pack, cell, &row[..ids.bytes])?;
                        self.tally[cell as usize].vertices += 1;
                        at += 1;
                    }
                    n_shared += 1;
                }
                Ok(())
            },
        )?;
        rows.finish(pack)?;
        marks.finish(pack)?;
        run.progress.add(source.n_faces() / 8);
        Ok(n_shared)
    }
}
