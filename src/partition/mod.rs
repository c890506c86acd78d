//! Stage 1: from a mesh file to a store of cells.
//!
//! Three passes after the scan, all I/O sequential: vertices go to the cell of their position, triangles to
//! the cell of their corner of lowest index, and the vertices that triangles of another cell use are copied there.
//! It does not look at connectivity and moves nothing.

mod scan;
mod sorted;
mod table;

pub use scan::{Scan, scan};

use crate::cells::{
    CellTally, CellTree, Frame, IdMap, Pack, PackWriter, Scatter, StoreInfo, VertexLayout,
    n_samples, plan_cells,
};
use crate::error::{Error, Result};
use crate::format::ChunkKind;
use crate::parallel::in_order;
use crate::ply::{BLOCK_ROWS, MeshSource, VertexBlock};
use crate::run::Run;
use serde::{Deserialize, Serialize};
use sorted::Sorted;
use table::{CellTable, window_rows};

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
    /// Broken faces dropped on request.
    pub bad_faces: u64,
    /// The vertex on a seam that is nearest to the middle of the box.
    #[serde(default)]
    pub seam_place: Option<[f64; 3]>,
}

/// Peak memory of this stage in bytes: the cell-of-vertex table, buffers, blocks and samples.
pub fn memory_bytes(n_vertices: u64, n_cells: u32, threads: usize, budget_bytes: u64) -> u64 {
    let window = window_rows(n_cells, budget_bytes).min(n_vertices);
    let table = window * CellTable::bytes_per_vertex(n_cells);
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
    let first_window = passes.vertices(&mut pack)?;
    let (foreign, dropped) = passes.triangles(first_window, &mut pack)?;
    let middle = [0, 1, 2].map(|k| (bounds[0][k] + bounds[1][k]) / 2.0);
    let seams = passes.shared(foreign, middle, &mut pack)?;
    pack.sync()?;
    run.disk().sync_folder_of(&run.job.path(PACK_NAME))?;
    let store = StoreInfo {
        pack: PACK_NAME.to_owned(),
        pack_bytes: pack.length(),
        triangles: passes.tally.iter().map(|cell| cell.triangles).sum(),
        cells: passes.tally,
        shared_vertices: seams.n_shared,
        has_channels: false,
    };
    Ok(Partition {
        store,
        bounds,
        degenerate_faces: dropped.degenerate,
        bad_faces: dropped.bad,
        seam_place: seams.place,
    })
}

/// A vertex, and a cell that uses it without owning it.
type Foreign = (u64, u32);

/// The vertices that several cells use.
#[derive(Default)]
struct Seams {
    n_shared: u64,
    place: Option<[f64; 3]>,
}

/// Faces that a pass has left out.
#[derive(Clone, Copy, Default)]
struct Dropped {
    degenerate: u64,
    bad: u64,
}

struct Passes<'a> {
    source: &'a MeshSource,
    run: &'a Run<'a>,
    layout: VertexLayout,
    tree: CellTree,
    tally: Vec<CellTally>,
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
        let window = window_rows(n_cells, run.memory_bytes).min(source.n_vertices());
        let mut table = CellTable::new(0, window, n_cells);
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
                // Windows are whole blocks.
                if table.len() < window {
                    table.extend(&sorted.cells);
                }
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

    /// Cells of the vertices from `first` on, as many as the window holds.
    fn window(&self, first: u64) -> Result<CellTable> {
        let (source, run, tree) = (self.source, self.run, &self.tree);
        let record_bytes = self.layout.schema.record_bytes();
        let rows = window_rows(tree.n_cells(), run.memory_bytes).min(source.n_vertices() - first);
        let mut table = CellTable::new(first, rows, tree.n_cells());
        in_order(
            rows.div_ceil(BLOCK_ROWS),
            run.threads,
            run.progress,
            |index, out: &mut Sorted| {
                source.read_vertices(first / BLOCK_ROWS + index, &mut out.vertices)?;
                out.cells.clear();
                let records = out.vertices.records.chunks_exact(record_bytes);
                let cells = records.map(|r| tree.cell_of(self.layout.schema.position(r)));
                out.cells.extend(cells);
                Ok(())
            },
            |_, block| {
                table.extend(&block.cells);
                Ok(())
            },
        )?;
        Ok(table)
    }

    /// Sends every triangle to the cell of its corner of lowest index; finds the corners that lie elsewhere, and how
    /// many faces were degenerate.
    ///
    /// While the table holds all vertices that takes one pass over the faces. Otherwise each window takes a
    /// pass for the triangles whose lowest corner it knows, and the cells tell afterwards what they miss.
    fn triangles(
        &mut self,
        first_window: CellTable,
        pack: &mut PackWriter,
    ) -> Result<(Vec<Foreign>, Dropped)> {
        let mut scatter = self.buffers(ChunkKind::Triangles);
        let n_vertices = self.source.n_vertices();
        if first_window.len() >= n_vertices {
            let (foreign, dropped) = self.triangles_of(&first_window, &mut scatter, pack)?;
            scatter.finish(pack)?;
            return Ok((foreign, dropped));
        }
        let mut table = first_window;
        let dropped = loop {
            let (_, dropped) = self.triangles_of(&table, &mut scatter, pack)?;
            let next = table.first + table.len();
            if next >= n_vertices {
                break dropped;
            }
            drop(table);
            table = self.window(next)?;
        };
        drop(table);
        scatter.finish(pack)?;
        pack.sync()?;
        Ok((self.missing(pack.length())?, dropped))
    }

    /// Sends the triangles whose lowest corner lies in `table` to their cells.
    ///
    /// The lowest, not the first: repeats of a triangle begin anywhere, and must meet in one cell.
    fn triangles_of(
        &mut self,
        table: &CellTable,
        scatter: &mut Scatter,
        pack: &mut PackWriter,
    ) -> Result<(Vec<Foreign>, Dropped)> {
        let (source, run, ids) = (self.source, self.run, self.layout.ids);
        let n_cells = self.tree.n_cells();
        let row_bytes = 3 * ids.bytes;
        let mut foreign: Vec<Foreign> = Vec::new();
        let mut sorted_up_to = 0;
        let mut dropped = Dropped::default();
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
                faces.triangles.retain(|corners| {
                    let lowest = corners[0].min(corners[1]).min(corners[2]);
                    let Some(owner) = table.get(lowest) else { return false };
                    out.cells.push(owner);
                    for &corner in corners.iter() {
                        if table.get(corner).is_some_and(|cell| cell != owner) {
                            out.foreign.push((corner, owner));
                        }
                    }
                    true
                });
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
                dropped.degenerate += sorted.faces.n_degenerate;
                dropped.bad += sorted.faces.n_bad;
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
                sorted.push_runs(row_bytes, scatter, pack)
            },
        )?;
        foreign.sort_unstable();
        foreign.dedup();
        Ok((foreign, dropped))
    }

    /// The vertices that triangles of each cell use and the cell does not hold.
    fn missing(&self, pack_bytes: u64) -> Result<Vec<Foreign>> {
        let run = self.run;
        let n_cells = self.tally.len() as u32;
        let pack = Pack::open(run.disk(), &run.job.path(PACK_NAME), n_cells, pack_bytes)?;
        let row_bytes = self.layout.ids.bytes + self.layout.schema.record_bytes();
        let mut all = Vec::new();
        in_order(
            u64::from(n_cells),
            run.threads,
            run.progress,
            |cell, out: &mut Vec<Foreign>| {
                out.clear();
                let tally = self.tally[cell as usize];
                let mut map = IdMap::with_capacity(tally.vertices as usize);
                let mut own = Vec::with_capacity(tally.vertices as usize);
                let mut payload = Vec::new();
                // Vertices were scattered before triangles, so they come first.
                for chunk in pack.chunks_of(cell as u32) {
                    pack.read(chunk, &mut payload)?;
                    match chunk.kind {
                        ChunkKind::Vertices => payload.chunks_exact(row_bytes).for_each(|row| {
                            map.insert(self.layout.ids.read(row), &mut own);
                        }),
                        _ => payload.chunks_exact(self.layout.ids.bytes).for_each(|corner| {
                            let id = self.layout.ids.read(corner);
                            if map.get(id, &own).is_none() {
                                out.push((id, cell as u32));
                            }
                        }),
                    }
                }
                out.sort_unstable();
                out.dedup();
                Ok(())
            },
            |_, found| {
                all.append(found);
                Ok(())
            },
        )?;
        all.sort_unstable();
        Ok(all)
    }

    /// Copies every vertex to the foreign cells that use it, and marks it in all cells that hold it.
    ///
    /// Returns how many vertices are shared, and the one nearest to `middle`.
    fn shared(
        &mut self,
        foreign: Vec<Foreign>,
        middle: [f64; 3],
        pack: &mut PackWriter,
    ) -> Result<Seams> {
        let (source, run, ids) = (self.source, self.run, self.layout.ids);
        let record_bytes = self.layout.schema.record_bytes();
        let mut rows = self.buffers(ChunkKind::Vertices);
        let mut marks = self.buffers(ChunkKind::SharedIds);
        let mut blocks: Vec<u64> = foreign.iter().map(|&(id, _)| id / BLOCK_ROWS).collect();
        blocks.dedup();
        let mut at = 0;
        let mut seams = Seams::default();
        let mut nearest_sq = f64::INFINITY;
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
                    let place = self.layout.schema.position(record);
                    let off_sq: f64 = (0..3).map(|k| (place[k] - middle[k]).powi(2)).sum();
                    if off_sq < nearest_sq {
                        (nearest_sq, seams.place) = (off_sq, Some(place));
                    }
                    row.clear();
                    ids.push(id, &mut row);
                    marks.push(pack, self.tree.cell_of(place), &row)?;
                    row.extend_from_slice(record);
                    while let Some(&(_, cell)) = foreign.get(at).filter(|(other, _)| *other == id) {
                        rows.push(pack, cell, &row)?;
                        marks.push(pack, cell, &row[..ids.bytes])?;
                        self.tally[cell as usize].vertices += 1;
                        at += 1;
                    }
                    seams.n_shared += 1;
                }
                Ok(())
            },
        )?;
        rows.finish(pack)?;
        marks.finish(pack)?;
        run.progress.add(source.n_faces() / 8);
        Ok(seams)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cells::{CellMesh, CellStore};
    use crate::disk::Disk;
    use crate::job::{Identity, Job};
    use crate::ply::{OutputHeader, PlyWriter};
    use crate::progress::Progress;
    use crate::schema::{Scalar, VertexSchema};
    use std::collections::BTreeMap;

    /// A grid of `n` x `n` vertices as a PLY file.
    fn write_grid(path: &std::path::Path, n: u32) {
        let schema = VertexSchema { coordinate: Scalar::F32, properties: Vec::new() };
        let mut records = Vec::new();
        for y in 0..n {
            for x in 0..n {
                schema.encode_position([f64::from(x), f64::from(y), 0.0], &mut records);
            }
        }
        let at = |x: u32, y: u32| y * n + x;
        let faces: Vec<[u32; 3]> = (0..n - 1)
            .flat_map(|y| (0..n - 1).map(move |x| (x, y)))
            .flat_map(|(x, y)| {
                let (a, b, c, d) = (at(x, y), at(x + 1, y), at(x, y + 1), at(x + 1, y + 1));
                [[a, b, c], [b, d, c]]
            })
            .collect();
        let header = OutputHeader::new(schema, u64::from(n * n), faces.len() as u64);
        let mut writer = PlyWriter::create(path, header).unwrap();
        writer.write_vertices(&records).unwrap();
        writer.write_faces_u32(&faces).unwrap();
        writer.finish().unwrap();
    }

    fn cut(folder: &std::path::Path, memory_bytes: u64) -> (Partition, Vec<CellMesh>) {
        let source = MeshSource::open(&folder.join("grid.ply")).unwrap();
        let identity = Identity {
            input: "grid".into(),
            input_marks: BTreeMap::new(),
            settings: BTreeMap::new(),
        };
        let disk = Disk::default();
        let job = Job::open(&folder.join("job"), &disk, &identity, true).unwrap();
        let run = Run { job: &job, progress: &Progress::default(), threads: 2, memory_bytes };
        let partition = partition(&source, 20_000, &run).unwrap();
        let layout = VertexLayout::new(source.schema(), source.n_vertices());
        let store = CellStore::open(&disk, job.folder(), partition.store.clone(), layout).unwrap();
        let cells = (0..store.n_cells()).map(|cell| store.load(cell).unwrap()).collect();
        (partition, cells)
    }

    #[test]
    fn a_table_in_windows_gives_the_same_cells() {
        let folder = tempfile::tempdir().unwrap();
        // 160,000 vertices: three blocks, so that the smallest window holds less than half of them.
        write_grid(&folder.path().join("grid.ply"), 400);
        let (whole, cells) = cut(folder.path(), 1 << 30);
        let (windowed, cells_windowed) = cut(folder.path(), 1 << 10);
        assert!(cells.len() >= 15, "{}", cells.len());
        assert_eq!(whole.store.shared_vertices, windowed.store.shared_vertices);
        assert_eq!(whole.store.triangles, 399 * 399 * 2);
        for (a, b) in cells.iter().zip(&cells_windowed) {
            let geometry = |cell: &CellMesh| {
                let mut triangles: Vec<_> =
                    cell.mesh.triangles.iter().map(|t| t.map(|v| cell.ids[v as usize])).collect();
                triangles.sort_unstable();
                let mut shared: Vec<u64> =
                    (0..cell.ids.len()).filter(|&v| cell.shared[v]).map(|v| cell.ids[v]).collect();
                shared.sort_unstable();
                (triangles, shared)
            };
            assert_eq!(geometry(a), geometry(b));
        }
    }
}
