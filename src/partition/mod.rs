//! Stage 1: from a mesh file to a store of cells.
//!
//! Three passes after the scan, all I/O sequential: vertices go to the cell of their position, triangles to
//! the cell of their corner of lowest index, and the vertices that triangles of another cell use are copied there.
//! It does not look at connectivity and moves nothing.

mod checkpoint;
mod scan;
mod sorted;
mod table;

pub use scan::{Scan, scan};

use crate::cells::{
    CellTally, CellTree, Frame, IdMap, PackWriter, Scatter, StoreInfo, VertexLayout, n_samples,
    plan_cells, split_overfull,
};
use crate::error::{Error, Result};
use crate::format::ChunkKind;
use crate::parallel::in_order;
use crate::ply::{BLOCK_ROWS, MeshSource, VertexBlock};
use crate::run::Run;
use checkpoint::{Checkpoints, Pass, Place, Seams, take_up, tally};
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

/// Chunk headers, shared rows and file-system blocks on top of the bare rows of a store.
const PACK_OVERHEAD: f64 = 1.06;

/// Bytes on disk of the cells of a mesh.
pub fn store_bytes(n_vertices: u64, n_triangles: u64, layout: &VertexLayout) -> u64 {
    let (ids, records) = (layout.ids.bytes as f64, layout.schema.record_bytes() as f64);
    let bytes = n_vertices as f64 * (ids + records) + n_triangles as f64 * 3.0 * ids;
    (bytes * PACK_OVERHEAD) as u64
}

/// Peak memory of this stage in bytes: the cell-of-vertex table, buffers, blocks, samples, and the list of the
/// chunks into which `store_bytes` of cells are written.
pub fn memory_bytes(
    n_vertices: u64,
    n_cells: u32,
    store_bytes: u64,
    threads: usize,
    budget_bytes: u64,
) -> u64 {
    let window = window_rows(n_cells, budget_bytes).min(n_vertices);
    let table = window * CellTable::bytes_per_vertex(n_cells);
    let buffers = Scatter::bytes(n_cells, budget_bytes / BUFFER_SHARE);
    let blocks = threads as u64 * 2 * BLOCK_ROWS * 64;
    let list = Scatter::list_bytes(n_cells, budget_bytes / BUFFER_SHARE, store_bytes);
    table + buffers + blocks + list + 24 * n_samples(n_vertices, n_cells)
}

/// Cuts `source` into cells of about `cell_triangles` triangles.
pub fn partition(source: &MeshSource, cell_triangles: u64, run: &Run) -> Result<Partition> {
    let n_cells = plan_cells(source.n_faces(), cell_triangles);
    // Sealed by itself: the passes below can only be taken up with the very same cells.
    let (bounds, tree) = run.job.sealed("partition tree", || {
        let Scan { bounds, samples } = scan(source, n_cells, run.threads, run.progress)?;
        Ok((bounds, CellTree::build(Frame::new(0, bounds), &samples, n_cells)))
    })?;
    run.progress.add(source.n_faces() / 8);
    let window_rows = window_rows(tree.n_cells(), run.memory_bytes).min(source.n_vertices());
    let (mut pack, place) = take_up(run, PACK_NAME, window_rows)?;
    let layout = VertexLayout::new(source.schema(), source.n_vertices());
    let tally = tally(&pack, &layout, tree.n_cells())?;
    let checkpoints = Checkpoints::new(run);
    let mut passes = Passes { source, run, layout, tally, tree, window_rows, place, checkpoints };
    let table = match place.pass {
        Pass::Vertices => Some(passes.vertices(&mut pack)?),
        Pass::Triangles => Some(passes.window(place.window[0], place.window[1])?),
        Pass::Shared => None,
    };
    let foreign = match table {
        Some(table) => passes.triangles(table, &mut pack)?,
        None => passes.noted(Vec::new(), &mut pack)?,
    };
    let middle = [0, 1, 2].map(|k| (bounds[0][k] + bounds[1][k]) / 2.0);
    let seams = passes.shared(foreign, middle, &mut pack)?;
    let dropped = passes.place.dropped;
    let store = StoreInfo {
        pack: PACK_NAME.to_owned(),
        triangles: passes.tally.iter().map(|cell| cell.triangles).sum(),
        cells: passes.tally,
        shared_vertices: seams.n_shared,
        ..StoreInfo::default()
    };
    let store = split_overfull(store, &mut pack, &passes.layout, cell_triangles, 0, run)?;
    pack.seal()?;
    run.disk().sync_folder_of(&run.job.path(PACK_NAME))?;
    let store = StoreInfo { pack_bytes: pack.length(), ..store };
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

/// Bytes of such a pair in the pack, and how many make a chunk.
const FOREIGN_BYTES: usize = 12;
const FOREIGN_ROWS: usize = 65_536;

struct Passes<'a> {
    source: &'a MeshSource,
    run: &'a Run<'a>,
    layout: VertexLayout,
    tree: CellTree,
    tally: Vec<CellTally>,
    /// Vertices whose cells a table may hold.
    window_rows: u64,
    /// Where the passes are, or are to be taken up.
    place: Place,
    checkpoints: Checkpoints<'a>,
}

impl Passes<'_> {
    fn buffers(&self, kind: ChunkKind) -> Scatter {
        Scatter::new(kind, self.tree.n_cells(), self.run.memory_bytes / BUFFER_SHARE)
    }

    /// Sends every vertex to the cell of its position.
    fn vertices(&mut self, pack: &mut PackWriter) -> Result<CellTable> {
        let first_block = self.place.block;
        let window = self.window_rows;
        let known = (first_block * BLOCK_ROWS).min(window);
        let mut table = self.window(0, known)?;
        table.reserve(window - known);
        let (source, run, tree, ids) = (self.source, self.run, &self.tree, self.layout.ids);
        let n_cells = tree.n_cells();
        let record_bytes = self.layout.schema.record_bytes();
        let row_bytes = ids.bytes + record_bytes;
        let mut scatter = self.buffers(ChunkKind::Vertices);
        let (schema, tally, checkpoints) =
            (&self.layout.schema, &mut self.tally, &mut self.checkpoints);
        in_order(
            source.n_vertex_blocks() - first_block,
            run.threads,
            run.progress,
            |index, out: &mut Sorted| {
                let mut block = std::mem::take(&mut out.vertices);
                source.read_vertices(first_block + index, &mut block)?;
                out.cells.clear();
                let records = block.records.chunks_exact(record_bytes);
                let mut finder = tree.finder();
                out.cells.extend(records.map(|record| finder.cell_of(schema.position(record))));
                out.sort(n_cells, row_bytes, |i, row| {
                    let id = block.first + i as u64;
                    row[..ids.bytes].copy_from_slice(&id.to_le_bytes()[..ids.bytes]);
                    row[ids.bytes..]
                        .copy_from_slice(&block.records[i * record_bytes..(i + 1) * record_bytes]);
                });
                out.vertices = block;
                Ok(())
            },
            |index, sorted| {
                // Windows are whole blocks.
                if table.len() < window {
                    table.extend(&sorted.cells);
                }
                for &(cell, n_rows) in &sorted.runs {
                    tally[cell as usize].vertices += u64::from(n_rows);
                }
                sorted.push_runs(row_bytes, &mut scatter, pack)?;
                if checkpoints.is_due() {
                    scatter.flush(pack)?;
                    let block = first_block + index + 1;
                    checkpoints.seal(Place { block, ..Place::default() }, pack)?;
                }
                Ok(())
            },
        )?;
        scatter.finish(pack)?;
        run.progress.add(source.n_faces() / 4);
        self.place = Place { pass: Pass::Triangles, window: [0, window], ..Place::default() };
        Ok(table)
    }

    /// Cells of `rows` vertices from `first` on, the beginning of a block.
    fn window(&self, first: u64, rows: u64) -> Result<CellTable> {
        let (source, run, tree) = (self.source, self.run, &self.tree);
        let record_bytes = self.layout.schema.record_bytes();
        let mut table = CellTable::new(first, rows, tree.n_cells());
        in_order(
            rows.div_ceil(BLOCK_ROWS),
            run.threads,
            run.progress,
            |index, out: &mut Sorted| {
                source.read_vertices(first / BLOCK_ROWS + index, &mut out.vertices)?;
                out.cells.clear();
                let records = out.vertices.records.chunks_exact(record_bytes);
                let mut finder = tree.finder();
                let cells = records.map(|r| finder.cell_of(self.layout.schema.position(r)));
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

    /// Sends every triangle to the cell of its corner of lowest index; finds the corners that lie elsewhere.
    ///
    /// While the table holds all vertices that takes one pass over the faces. Otherwise each window takes a
    /// pass for the triangles whose lowest corner it knows, and the cells tell afterwards what they miss.
    fn triangles(&mut self, table: CellTable, pack: &mut PackWriter) -> Result<Vec<Foreign>> {
        let mut scatter = self.buffers(ChunkKind::Triangles);
        let n_vertices = self.source.n_vertices();
        let is_whole = table.first == 0 && table.len() >= n_vertices;
        let mut table = table;
        let foreign = loop {
            let foreign = self.triangles_of(&table, is_whole, &mut scatter, pack)?;
            let next = table.first + table.len();
            if next >= n_vertices {
                break foreign;
            }
            drop(table);
            let rows = self.window_rows.min(n_vertices - next);
            table = self.window(next, rows)?;
            self.place = Place { pass: Pass::Triangles, window: [next, rows], ..Place::default() };
        };
        drop(table);
        scatter.finish(pack)?;
        let foreign = match is_whole {
            true => self.noted(foreign, pack)?,
            false => self.missing(pack)?,
        };
        self.place = Place { pass: Pass::Shared, dropped: self.place.dropped, ..Place::default() };
        if self.checkpoints.is_due() {
            note(&foreign, pack)?;
            self.checkpoints.seal(self.place, pack)?;
        }
        Ok(foreign)
    }

    /// `foreign` and what checkpoints have noted in the pack, sorted.
    fn noted(&self, mut foreign: Vec<Foreign>, pack: &mut PackWriter) -> Result<Vec<Foreign>> {
        if pack.chunks().iter().any(|chunk| chunk.kind == ChunkKind::Foreign) {
            let reader = pack.reader(self.run.disk(), self.tree.n_cells())?;
            let mut payload = Vec::new();
            for chunk in reader.chunks_of(0).iter().filter(|c| c.kind == ChunkKind::Foreign) {
                reader.read(chunk, &mut payload)?;
                foreign.extend(payload.chunks_exact(FOREIGN_BYTES).map(|row| {
                    let (id, cell) = row.split_at(8);
                    let id = u64::from_le_bytes(id.try_into().expect("8 bytes"));
                    (id, u32::from_le_bytes(cell.try_into().expect("4 bytes")))
                }));
            }
        }
        foreign.sort_unstable();
        foreign.dedup();
        Ok(foreign)
    }

    /// Sends the triangles whose lowest corner lies in `table` to their cells. If the table is the whole one,
    /// gives back the foreign corners that no checkpoint has noted.
    ///
    /// The lowest, not the first: repeats of a triangle begin anywhere, and must meet in one cell.
    fn triangles_of(
        &mut self,
        table: &CellTable,
        is_whole: bool,
        scatter: &mut Scatter,
        pack: &mut PackWriter,
    ) -> Result<Vec<Foreign>> {
        let (source, run, ids) = (self.source, self.run, self.layout.ids);
        let n_cells = self.tree.n_cells();
        let row_bytes = 3 * ids.bytes;
        let mut foreign: Vec<Foreign> = Vec::new();
        let mut sorted_up_to = 0;
        let start = self.place;
        let mut dropped = start.dropped;
        let (tally, checkpoints) = (&mut self.tally, &mut self.checkpoints);
        in_order(
            source.n_face_blocks() - start.block,
            run.threads,
            run.progress,
            |index, out: &mut Sorted| {
                let mut faces = std::mem::take(&mut out.faces);
                source.read_faces(start.block + index, &mut faces)?;
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
            |index, sorted| {
                dropped.degenerate += sorted.faces.n_degenerate;
                dropped.bad += sorted.faces.n_bad;
                for &(cell, n_rows) in &sorted.runs {
                    tally[cell as usize].triangles += u64::from(n_rows);
                }
                if is_whole {
                    foreign.append(&mut sorted.foreign);
                }
                // In shuffled input the same pair comes again and again; keep the list near its final size.
                if foreign.len() > 2 * sorted_up_to + 1_000_000 {
                    foreign.sort_unstable();
                    foreign.dedup();
                    sorted_up_to = foreign.len();
                }
                run.progress.add(sorted.cells.len() as u64 / 2);
                sorted.push_runs(row_bytes, scatter, pack)?;
                if checkpoints.is_due() {
                    scatter.flush(pack)?;
                    foreign.sort_unstable();
                    foreign.dedup();
                    note(&foreign, pack)?;
                    (sorted_up_to, foreign) = (0, Vec::new());
                    let block = start.block + index + 1;
                    checkpoints.seal(Place { block, dropped, ..start }, pack)?;
                }
                Ok(())
            },
        )?;
        self.place.dropped = dropped;
        Ok(foreign)
    }

    /// The vertices that triangles of each cell use and the cell does not hold.
    fn missing(&self, pack: &mut PackWriter) -> Result<Vec<Foreign>> {
        let run = self.run;
        let n_cells = self.tally.len() as u32;
        let pack = pack.reader(run.disk(), n_cells)?;
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
                        ChunkKind::Triangles => {
                            payload.chunks_exact(self.layout.ids.bytes).for_each(|corner| {
                                let id = self.layout.ids.read(corner);
                                if map.get(id, &own).is_none() {
                                    out.push((id, cell as u32));
                                }
                            });
                        }
                        _ => {}
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
        let start = self.place;
        let first_block = (start.block as usize).min(blocks.len());
        let blocks = &blocks[first_block..];
        let first_id = blocks.first().map_or(u64::MAX, |block| block * BLOCK_ROWS);
        let mut at = foreign.partition_point(|&(id, _)| id < first_id);
        let mut seams = start.seams;
        let off_sq = |place: [f64; 3]| (0..3).map(|k| (place[k] - middle[k]).powi(2)).sum::<f64>();
        let mut nearest_sq = seams.place.map_or(f64::INFINITY, off_sq);
        // A place in this pass can only be taken up with the whole list.
        let mut is_noted = start.pack_bytes > 0;
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
                    if off_sq(place) < nearest_sq {
                        (nearest_sq, seams.place) = (off_sq(place), Some(place));
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
                if self.checkpoints.is_due() {
                    if !is_noted {
                        note(&foreign, pack)?;
                        is_noted = true;
                    }
                    rows.flush(pack)?;
                    marks.flush(pack)?;
                    let block = first_block as u64 + index + 1;
                    self.checkpoints.seal(Place { block, seams, ..start }, pack)?;
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

/// Appends foreign corners to the pack, as a note for the run that takes the partition up.
fn note(foreign: &[Foreign], pack: &mut PackWriter) -> Result<()> {
    let mut payload = Vec::new();
    for rows in foreign.chunks(FOREIGN_ROWS) {
        payload.clear();
        for &(id, cell) in rows {
            payload.extend_from_slice(&id.to_le_bytes());
            payload.extend_from_slice(&cell.to_le_bytes());
        }
        pack.append(0, ChunkKind::Foreign, &payload)?;
    }
    Ok(())
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
    use std::time::Duration;

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

    fn cut(
        folder: &std::path::Path,
        memory_bytes: u64,
        checkpoint_every: Duration,
    ) -> (Partition, Vec<CellMesh>) {
        let source = MeshSource::open(&folder.join("grid.ply")).unwrap();
        let identity = Identity {
            input: "grid".into(),
            input_marks: BTreeMap::new(),
            settings: BTreeMap::new(),
        };
        let disk = Disk::default();
        let job = Job::open(&folder.join("job"), &disk, &identity, true).unwrap();
        let run = Run {
            job: &job,
            progress: &Progress::default(),
            threads: 2,
            memory_bytes,
            checkpoint_every,
        };
        let partition = partition(&source, 20_000, &run).unwrap();
        let layout = VertexLayout::new(source.schema(), source.n_vertices());
        let store = CellStore::open(&disk, job.folder(), partition.store.clone(), layout).unwrap();
        let cells = (0..store.n_cells()).map(|cell| store.load_tidy(cell).unwrap()).collect();
        (partition, cells)
    }

    /// All that the kernel sees of cells, and what stays beside it, bit for bit.
    fn assert_same(cells: &[CellMesh], others: &[CellMesh], what: &str) {
        assert_eq!(cells.len(), others.len(), "{what}");
        for (cell, (a, b)) in cells.iter().zip(others).enumerate() {
            let bits = |mesh: &CellMesh| -> Vec<u64> {
                mesh.mesh.positions.iter().flatten().map(|x| x.to_bits()).collect()
            };
            assert!(a.ids == b.ids, "{what}: ids of cell {cell}");
            assert!(a.shared == b.shared, "{what}: marks of cell {cell}");
            assert!(a.records == b.records, "{what}: records of cell {cell}");
            assert!(bits(a) == bits(b), "{what}: positions of cell {cell}");
            assert!(a.mesh.triangles == b.mesh.triangles, "{what}: triangles of cell {cell}");
        }
    }

    /// A table in windows, small buffers and checkpoints after every block change no bit of what the kernel sees.
    #[test]
    fn a_table_in_windows_gives_the_same_cells_bit_for_bit() {
        let folder = tempfile::tempdir().unwrap();
        // 160,000 vertices: three blocks, so that the smallest window holds less than half of them.
        write_grid(&folder.path().join("grid.ply"), 400);
        let (whole, cells) = cut(folder.path(), 1 << 30, Duration::MAX);
        assert!(cells.len() >= 15, "{}", cells.len());
        assert_eq!(whole.store.triangles, 399 * 399 * 2);
        for (memory, every) in
            [(1 << 10, Duration::ZERO), (1 << 10, Duration::MAX), (600 << 10, Duration::MAX)]
        {
            let (windowed, other) = cut(folder.path(), memory, every);
            assert_eq!(whole.store.shared_vertices, windowed.store.shared_vertices);
            assert_eq!(whole.seam_place, windowed.seam_place);
            assert_same(&cells, &other, &format!("{memory} bytes"));
        }
    }

    /// Cells that are split by ids, and whose triangles came in several windows, are the same bit for bit.
    #[test]
    fn a_split_cell_in_windows_is_the_same_bit_for_bit() {
        let folder = tempfile::tempdir().unwrap();
        // All vertices but two in one place: positions cannot tell them apart, only ids.
        let n = 200_000u64;
        let schema = VertexSchema { coordinate: Scalar::F32, properties: Vec::new() };
        let mut records = Vec::new();
        for i in 0..n {
            schema.encode_position(if i > 1 { [0.5; 3] } else { [i as f64; 3] }, &mut records);
        }
        // Steps without a common divisor with `n`: the lowest corner is in any window.
        let faces: Vec<[u32; 3]> = (0..n)
            .map(|i| [7 * i, 7919 * i + 3, 104_729 * i + 11].map(|v| (v % n) as u32))
            .collect();
        let header = OutputHeader::new(schema, n, n);
        let mut writer = PlyWriter::create(&folder.path().join("grid.ply"), header).unwrap();
        writer.write_vertices(&records).unwrap();
        writer.write_faces_u32(&faces).unwrap();
        writer.finish().unwrap();
        let (whole, cells) = cut(folder.path(), 1 << 30, Duration::MAX);
        assert!(!whole.store.split.is_empty());
        let (windowed, other) = cut(folder.path(), 1 << 10, Duration::MAX);
        assert_eq!(whole.store.cells, windowed.store.cells);
        assert_same(&cells, &other, "split");
    }

    /// A fan around the vertex of lowest index, which would be one cell, comes out as cells of the planned size that
    /// hold all their vertices and share those at their edges.
    #[test]
    fn a_cell_denser_than_planned_is_split() {
        let folder = tempfile::tempdir().unwrap();
        let (n, limit) = (100_000u32, 20_000);
        let schema = VertexSchema { coordinate: Scalar::F32, properties: Vec::new() };
        let mut records = Vec::new();
        for i in 0..=n {
            let angle = f64::from(i) * 1e-4;
            schema.encode_position([angle.cos(), angle.sin(), 0.0], &mut records);
        }
        let faces: Vec<[u32; 3]> = (0..n).map(|i| [1 + i, 1 + (i + 1) % n, 0]).collect();
        let header = OutputHeader::new(schema, u64::from(n) + 1, u64::from(n));
        let mut writer = PlyWriter::create(&folder.path().join("grid.ply"), header).unwrap();
        writer.write_vertices(&records).unwrap();
        writer.write_faces_u32(&faces).unwrap();
        writer.finish().unwrap();
        let (partition, cells) = cut(folder.path(), 1 << 30, Duration::MAX);
        assert_eq!(partition.store.split.len(), 1);
        let mut triangles: Vec<[u64; 3]> = Vec::new();
        let mut users = BTreeMap::<u64, u32>::new();
        for (cell, tally) in cells.iter().zip(&partition.store.cells) {
            assert!(tally.triangles <= limit * 11 / 10, "{tally:?}");
            assert_eq!(tally.triangles as usize, cell.mesh.triangles.len());
            assert!(tally.vertices as usize >= cell.ids.len());
            triangles.extend(cell.mesh.triangles.iter().map(|t| t.map(|v| cell.ids[v as usize])));
            let mut used: Vec<u32> = cell.mesh.triangles.iter().flatten().copied().collect();
            used.sort_unstable();
            used.dedup();
            used.iter().for_each(|&v| *users.entry(cell.ids[v as usize]).or_default() += 1);
        }
        triangles.sort_unstable();
        let mut expected: Vec<[u64; 3]> = faces.iter().map(|t| t.map(u64::from)).collect();
        expected.sort_unstable();
        assert!(triangles == expected);
        for cell in &cells {
            for (id, shared) in cell.ids.iter().zip(&cell.shared) {
                assert!(*shared || users.get(id).is_none_or(|&n| n == 1), "vertex {id}");
            }
        }
    }
}
