//! Stage 1: from a mesh file to a store of cells.
//!
//! Three passes after the scan, all I/O sequential: vertices go to the cell of their position, triangles to
//! the cell of their corner of lowest index, and the vertices that triangles of another cell use are copied there.
//! It does not look at connectivity and moves nothing.

mod cell_table;
mod checkpoint;
mod halo;
mod memory;
mod scan;
mod sorted;

pub use memory::{Shares, Sizes};
pub use scan::{Scan, scan};

use crate::error::{Error, Result};
use crate::io::ply::{BLOCK_ROWS, MeshSource, VertexBlock};
use crate::mesh::bounds::Bounds;
use crate::store::cells::{
    CellTally, CellTree, Frame, IdMap, Pack, PackWriter, Scatter, StoreInfo, VertexLayout,
    plan_cells, split_overfull,
};
use crate::store::pack_format::ChunkKind;
use crate::store::stage_context::Run;
use crate::system::parallel::in_order;
use cell_table::CellTable;
use checkpoint::{Checkpoints, Pass, Place, Seams, take_up, tally};
use halo::{Foreign, Gathering, Halo};
use serde::{Deserialize, Serialize};
use sorted::Sorted;

/// Vertices of a cell that are looked up at a time to find what it misses, 24 bytes each; cells denser than
/// planned may hold any number.
const OWN_ROWS: usize = 1 << 20;

/// Rows of missing vertices after which repeats among them are dropped.
const MISSING_ROWS: usize = 250_000;

/// File name of the first round's pack.
const PACK_NAME: &str = "round-0.cells";

/// What partitioning leaves.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Partition {
    /// The store of cells.
    pub store: StoreInfo,
    /// Lower and upper corner of the bounding box.
    pub bounds: Bounds,
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

/// Cuts `source` into cells of about `cell_triangles` triangles.
pub fn partition(source: &MeshSource, cell_triangles: u64, run: &Run) -> Result<Partition> {
    let n_cells = plan_cells(source.n_triangles(), cell_triangles);
    let layout = VertexLayout::new(source.schema(), source.n_vertices());
    let shares = |n_cells| {
        let store_bytes = store_bytes(source.n_vertices(), source.n_triangles(), &layout);
        let n_vertices = source.n_vertices();
        let sizes = Sizes { n_vertices, n_cells, store_bytes, layout: &layout };
        Shares::new(sizes, run.threads, run.memory_bytes)
    };
    // Sealed by itself: the passes below can only be taken up with the very same cells.
    let (bounds, tree) = run.job.sealed("partition tree", || {
        let shares = shares(n_cells);
        let Scan { bounds, samples } = scan(source, n_cells, shares.threads, run.progress)?;
        Ok((bounds, CellTree::build(Frame::new(0, bounds), &samples, n_cells)))
    })?;
    run.progress.add(source.n_triangles() / 8);
    let shares = shares(tree.n_cells());
    let window_rows = shares.window_rows.min(source.n_vertices());
    let (mut pack, place) = take_up(run, PACK_NAME, window_rows)?;
    let tally = tally(&pack, &layout, tree.n_cells())?;
    let checkpoints = Checkpoints::new(run);
    let mut passes =
        Passes { source, run, layout, tally, tree, shares, window_rows, place, checkpoints };
    let table = match place.pass {
        Pass::Vertices => Some(passes.vertices(&mut pack)?),
        Pass::Triangles => Some(passes.window(place.window[0], place.window[1])?),
        Pass::Shared => None,
    };
    let foreign = match table {
        Some(table) => passes.triangles(table, &mut pack)?,
        None => passes.halo(Gathering::new(shares.halo_bytes), &mut pack)?,
    };
    let middle = bounds.middle();
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

struct Passes<'a> {
    source: &'a MeshSource,
    run: &'a Run<'a>,
    layout: VertexLayout,
    tree: CellTree,
    tally: Vec<CellTally>,
    shares: Shares,
    /// Vertices whose cells a table may hold.
    window_rows: u64,
    /// Where the passes are, or are to be taken up.
    place: Place,
    checkpoints: Checkpoints<'a>,
}

impl Passes<'_> {
    fn buffers(&self, kind: ChunkKind) -> Scatter {
        Scatter::new(kind, self.tree.n_cells(), self.shares.buffer_bytes)
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
            self.shares.threads,
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
        run.progress.add(source.n_triangles() / 4);
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
            self.shares.threads,
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
    fn triangles(&mut self, table: CellTable, pack: &mut PackWriter) -> Result<Halo> {
        let mut scatter = self.buffers(ChunkKind::Triangles);
        let mut foreign = Gathering::new(self.shares.halo_bytes);
        let n_vertices = self.source.n_vertices();
        let is_whole = table.first == 0 && table.len() >= n_vertices;
        let mut table = table;
        loop {
            let found = is_whole.then_some(&mut foreign);
            self.triangles_of(&table, found, &mut scatter, pack)?;
            let next = table.first + table.len();
            if next >= n_vertices {
                break;
            }
            drop(table);
            let rows = self.window_rows.min(n_vertices - next);
            table = self.window(next, rows)?;
            self.place = Place { pass: Pass::Triangles, window: [next, rows], ..Place::default() };
        }
        drop(table);
        scatter.finish(pack)?;
        if !is_whole {
            self.missing(&mut foreign, pack)?;
        }
        self.place = Place { pass: Pass::Shared, dropped: self.place.dropped, ..Place::default() };
        if self.checkpoints.is_due() {
            foreign.note(pack)?;
            self.checkpoints.seal(self.place, pack)?;
        }
        self.halo(foreign, pack)
    }

    /// `foreign` and what has been noted in the pack.
    fn halo(&self, foreign: Gathering, pack: &mut PackWriter) -> Result<Halo> {
        let is_noted = pack.chunks().iter().any(|chunk| chunk.kind == ChunkKind::Foreign);
        let reader = match is_noted {
            true => Some(pack.reader(self.run.disk(), self.tree.n_cells())?),
            false => None,
        };
        foreign.finish(reader.as_ref(), self.run.job.folder())
    }

    /// Sends the triangles whose lowest corner lies in `table` to their cells. `foreign`, which is given if the
    /// table is the whole one, takes the corners that lie in another cell.
    ///
    /// The lowest, not the first: repeats of a triangle begin anywhere, and must meet in one cell.
    fn triangles_of(
        &mut self,
        table: &CellTable,
        mut foreign: Option<&mut Gathering>,
        scatter: &mut Scatter,
        pack: &mut PackWriter,
    ) -> Result<()> {
        let (source, run, ids) = (self.source, self.run, self.layout.ids);
        let n_cells = self.tree.n_cells();
        let row_bytes = 3 * ids.bytes;
        let start = self.place;
        let mut dropped = start.dropped;
        let (tally, checkpoints) = (&mut self.tally, &mut self.checkpoints);
        in_order(
            source.n_face_blocks() - start.block,
            self.shares.threads,
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
                if let Some(foreign) = foreign.as_deref_mut() {
                    foreign.add(&mut sorted.foreign, pack)?;
                }
                run.progress.add(sorted.cells.len() as u64 / 2);
                sorted.push_runs(row_bytes, scatter, pack)?;
                if checkpoints.is_due() {
                    scatter.flush(pack)?;
                    if let Some(foreign) = foreign.as_deref_mut() {
                        foreign.note(pack)?;
                    }
                    let block = start.block + index + 1;
                    checkpoints.seal(Place { block, dropped, ..start }, pack)?;
                }
                Ok(())
            },
        )?;
        self.place.dropped = dropped;
        Ok(())
    }

    /// Adds the vertices that triangles of each cell use and the cell does not hold.
    ///
    /// Memory: 24 bytes for each of `OWN_ROWS` vertices, and some MiB of missing ones, a thread.
    fn missing(&self, foreign: &mut Gathering, pack: &mut PackWriter) -> Result<()> {
        let run = self.run;
        let n_cells = self.tally.len() as u32;
        let reader = pack.reader(run.disk(), n_cells)?;
        in_order(
            u64::from(n_cells),
            self.shares.threads,
            run.progress,
            |cell, out: &mut Vec<Foreign>| {
                out.clear();
                self.missing_of(&reader, cell as u32, out)
            },
            |_, found| foreign.add(found, pack),
        )
    }

    /// Adds what one cell misses, sorted: a stretch of its own vertices at a time, which come in ascending order.
    fn missing_of(&self, reader: &Pack, cell: u32, out: &mut Vec<Foreign>) -> Result<()> {
        let ids = self.layout.ids;
        let row_bytes = ids.bytes + self.layout.schema.record_bytes();
        let chunks = |kind| reader.chunks_of(cell).iter().filter(move |chunk| chunk.kind == kind);
        let n_own = self.tally[cell as usize].vertices as usize;
        let mut payload = Vec::new();
        let mut sorted_up_to = 0;
        // Ids below it were looked up in an earlier stretch.
        let mut from = 0u64;
        for stretch in 0..n_own.div_ceil(OWN_ROWS).max(1) {
            let rows = stretch * OWN_ROWS..(stretch + 1) * OWN_ROWS;
            let mut map = IdMap::with_capacity(n_own.min(OWN_ROWS));
            let mut own: Vec<u64> = Vec::with_capacity(n_own.min(OWN_ROWS));
            let mut at = 0;
            for chunk in chunks(ChunkKind::Vertices) {
                let n = chunk.bytes as usize / row_bytes;
                if at < rows.end && rows.start < at + n {
                    reader.read(chunk, &mut payload)?;
                    let found = (at..).zip(payload.chunks_exact(row_bytes));
                    for (_, row) in found.filter(|(i, _)| rows.contains(i)) {
                        map.insert(ids.read(row), &mut own);
                    }
                }
                at += n;
            }
            let is_last = rows.end >= n_own;
            let end = own.last().filter(|_| !is_last).map_or(u64::MAX, |&last| last + 1);
            for chunk in chunks(ChunkKind::Triangles) {
                self.run.progress.check()?;
                reader.read(chunk, &mut payload)?;
                for corner in payload.chunks_exact(ids.bytes) {
                    let id = ids.read(corner);
                    if (from..end).contains(&id) && map.get(id, &own).is_none() {
                        out.push((id, cell));
                    }
                }
                if out.len() > 2 * sorted_up_to + MISSING_ROWS {
                    out.sort_unstable();
                    out.dedup();
                    sorted_up_to = out.len();
                }
            }
            from = end;
        }
        out.sort_unstable();
        out.dedup();
        Ok(())
    }

    /// Copies every vertex to the foreign cells that use it, and marks it in all cells that hold it.
    ///
    /// Returns how many vertices are shared, and the one nearest to `middle`.
    fn shared(&mut self, foreign: Halo, middle: [f64; 3], pack: &mut PackWriter) -> Result<Seams> {
        let (source, run, ids) = (self.source, self.run, self.layout.ids);
        let record_bytes = self.layout.schema.record_bytes();
        let mut rows = self.buffers(ChunkKind::Vertices);
        let mut marks = self.buffers(ChunkKind::SharedIds);
        let start = self.place;
        let first_block = (start.block as usize).min(foreign.blocks.len());
        let blocks = &foreign.blocks[first_block..];
        let first_id = blocks.first().map_or(u64::MAX, |block| block * BLOCK_ROWS);
        let mut next = foreign.from(first_id)?;
        let mut seams = start.seams;
        let off_sq = |place: [f64; 3]| (0..3).map(|k| (place[k] - middle[k]).powi(2)).sum::<f64>();
        let mut nearest_sq = seams.place.map_or(f64::INFINITY, off_sq);
        // A place in this pass can only be taken up with the whole list.
        let mut is_noted = start.pack_bytes > 0;
        let mut row = Vec::new();
        in_order(
            blocks.len() as u64,
            self.shares.threads,
            run.progress,
            |index, block: &mut VertexBlock| source.read_vertices(blocks[index as usize], block),
            |index, block| {
                let end = block.first + (block.records.len() / record_bytes) as u64;
                while let Some((id, _)) = next.peek()?.filter(|(id, _)| *id < end) {
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
                    while let Some((_, cell)) = next.peek()?.filter(|(other, _)| *other == id) {
                        next.take()?;
                        rows.push(pack, cell, &row)?;
                        marks.push(pack, cell, &row[..ids.bytes])?;
                        self.tally[cell as usize].vertices += 1;
                    }
                    seams.n_shared += 1;
                }
                if self.checkpoints.is_due() {
                    if !is_noted {
                        foreign.note(pack)?;
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
        run.progress.add(source.n_triangles() / 8);
        Ok(seams)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::ply::{OutputHeader, PlyWriter};
    use crate::mesh::property::Scalar;
    use crate::mesh::record::VertexSchema;
    use crate::store::cells::{CellMesh, CellStore};
    use crate::store::job::{Identity, Job};
    use crate::system::disk::Disk;
    use crate::system::progress::Progress;
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

    /// Pairs of a vertex and a foreign cell that exceed their memory go to disk and come back the same.
    #[test]
    fn pairs_on_disk_give_the_same_cells_bit_for_bit() {
        let folder = tempfile::tempdir().unwrap();
        // 160,000 vertices in a square, two far corners to each triangle: nearly 320,000 pairs.
        let n = 160_000u64;
        let schema = VertexSchema { coordinate: Scalar::F32, properties: Vec::new() };
        let mut records = Vec::new();
        for i in 0..n {
            schema.encode_position([(i % 400) as f64, (i / 400) as f64, 0.0], &mut records);
        }
        let faces: Vec<[u32; 3]> =
            (0..n).map(|i| [i, 7919 * i + 3, 104_729 * i + 11].map(|v| (v % n) as u32)).collect();
        let header = OutputHeader::new(schema, n, n);
        let mut writer = PlyWriter::create(&folder.path().join("grid.ply"), header).unwrap();
        writer.write_vertices(&records).unwrap();
        writer.write_faces_u32(&faces).unwrap();
        writer.finish().unwrap();
        let (whole, cells) = cut(folder.path(), 1 << 30, Duration::MAX);
        let n_foreign: usize = cells.iter().map(|cell| cell.ids.len()).sum::<usize>() - n as usize;
        assert!(n_foreign > 150_000, "{n_foreign}");
        // Room for 65,536 pairs with the table in windows, and for 131,072 with the whole table.
        for (memory, every) in
            [(1 << 10, Duration::MAX), (32 << 20, Duration::MAX), (32 << 20, Duration::ZERO)]
        {
            let (other, others) = cut(folder.path(), memory, every);
            assert_eq!(whole.seam_place, other.seam_place);
            assert_same(&cells, &others, &format!("{memory} bytes"));
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
