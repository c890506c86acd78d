//! Cells are the same bit for bit, however much memory and however many interruptions.

#![allow(clippy::unwrap_used)] // A test fails by panicking.

use super::*;

use std::collections::BTreeMap;
use std::time::Duration;
use stonecut_io::ply::{OutputHeader, PlyWriter};
use stonecut_mesh::global_vertex::GlobalVertex;
use stonecut_mesh::property::Scalar;
use stonecut_mesh::record::VertexSchema;
use stonecut_store::cell_id::CellId;
use stonecut_store::cells::{CellMesh, CellStore};
use stonecut_store::job::{Identity, Job};
use stonecut_store::pack_format::ALWAYS_WIDE;
use stonecut_system::disk::Disk;
use stonecut_system::progress::Progress;

/// Writes a mesh as `grid.ply`.
fn write_mesh(
    folder: &std::path::Path,
    positions: impl ExactSizeIterator<Item = [f64; 3]>,
    faces: &[[u32; 3]],
) {
    let schema = VertexSchema { coordinate: Scalar::F32, properties: Vec::new() };
    let header = OutputHeader::new(schema.clone(), positions.len() as u64, faces.len() as u64);
    let mut records = Vec::new();
    positions.for_each(|position| schema.encode_position(position, &mut records));
    let mut writer = PlyWriter::create(&folder.join("grid.ply"), header).unwrap();
    writer.write_vertices(&records).unwrap();
    writer.write_faces_u32(faces).unwrap();
    writer.finish().unwrap();
}

/// Writes a grid of `n` x `n` vertices.
fn write_grid(folder: &std::path::Path, n: u32) {
    let at = |x: u32, y: u32| y * n + x;
    let faces: Vec<[u32; 3]> = (0..n - 1)
        .flat_map(|y| (0..n - 1).map(move |x| (x, y)))
        .flat_map(|(x, y)| {
            let (a, b, c, d) = (at(x, y), at(x + 1, y), at(x, y + 1), at(x + 1, y + 1));
            [[a, b, c], [b, d, c]]
        })
        .collect();
    write_mesh(folder, (0..n * n).map(|i| [f64::from(i % n), f64::from(i / n), 0.0]), &faces);
}

/// Ids far apart by which vertices and faces of a shuffled mesh follow each other: a prime.
const STRIDE: u64 = 48_271;

/// Writes a grid of `n` x `n` vertices with vertices and faces in no order: a table of cells of 400 triangles neither
/// packs well nor can be read in pages.
fn write_shuffled_grid(folder: &std::path::Path, n: u32) {
    let n_vertices = u64::from(n) * u64::from(n);
    let mut places = vec![0; n_vertices as usize];
    let id = |place: u32| (u64::from(place) * STRIDE % n_vertices) as u32;
    (0..n * n).for_each(|place| places[id(place) as usize] = place);
    let n_faces = u64::from(n - 1) * u64::from(n - 1) * 2;
    let faces: Vec<[u32; 3]> = (0..n_faces)
        .map(|i| (i * STRIDE % n_faces) as u32)
        .map(|face| {
            let corner = face / 2 / (n - 1) * n + face / 2 % (n - 1);
            let (a, b, c, d) = (corner, corner + 1, corner + n, corner + n + 1);
            if face % 2 == 0 { [a, b, c].map(id) } else { [b, d, c].map(id) }
        })
        .collect();
    let positions = places.iter().map(|&place| [f64::from(place % n), f64::from(place / n), 0.0]);
    write_mesh(folder, positions, &faces);
}

fn cut(
    folder: &std::path::Path,
    memory_bytes: u64,
    checkpoint_every: Duration,
) -> (Partition, Vec<CellMesh>) {
    cut_in(20_000, folder, memory_bytes, checkpoint_every)
}

fn cut_in(
    cell_triangles: u64,
    folder: &std::path::Path,
    memory_bytes: u64,
    checkpoint_every: Duration,
) -> (Partition, Vec<CellMesh>) {
    let source = MeshSource::open(&folder.join("grid.ply")).unwrap();
    let identity =
        Identity { input: "grid".into(), input_marks: BTreeMap::new(), settings: BTreeMap::new() };
    let disk = Disk::default();
    let job = Job::open(&folder.join("job"), &disk, &identity, true).unwrap();
    let run = StageContext {
        job: &job,
        progress: &Progress::default(),
        threads: 2,
        memory_bytes,
        checkpoint_every,
    };
    let partition = partition(&source, cell_triangles, &run).unwrap();
    let layout = VertexLayout::new(source.schema(), source.n_vertices());
    let store = CellStore::open(&disk, job.folder(), partition.store.clone(), layout).unwrap();
    let cells = CellId::first(store.n_cells()).map(|cell| store.load_tidy(cell).unwrap()).collect();
    (partition, cells)
}

/// The same in parts, each as another process would do it, last parts first.
fn cut_in_parts(
    cell_triangles: u64,
    folder: &std::path::Path,
    memory_bytes: u64,
    of: u32,
) -> (Partition, Vec<CellMesh>) {
    let source = MeshSource::open(&folder.join("grid.ply")).unwrap();
    assert!(source.is_read_in_place());
    let folder = &folder.join(format!("parts of {of} and {memory_bytes}"));
    std::fs::create_dir(folder).unwrap();
    let (disk, progress, none) = (Disk::default(), Progress::default(), BTreeMap::new());
    let guest = |prefix: &str, outcomes: &BTreeMap<String, serde_json::Value>| {
        Job::guest(folder, &disk, prefix, outcomes.clone())
    };
    fn context<'a>(job: &'a Job, progress: &'a Progress, memory_bytes: u64) -> StageContext<'a> {
        StageContext { job, progress, threads: 2, memory_bytes, checkpoint_every: Duration::MAX }
    }
    let parts = |phase: &str, outcomes: &BTreeMap<String, serde_json::Value>| {
        let job_of = |index| (Part { index, of }, guest(&format!("{phase}-{index}."), outcomes));
        (0..of).rev().map(job_of).collect::<Vec<_>>()
    };
    let mut scanned: Vec<Scanned> = Vec::new();
    for (part, job) in parts("scan", &none) {
        let run = context(&job, &progress, memory_bytes);
        scanned.insert(0, scan_part(&source, cell_triangles, part, &run).unwrap());
    }
    let job = guest("tree.", &none);
    let run = context(&job, &progress, memory_bytes);
    tree_of_parts(&source, cell_triangles, &scanned, &run).unwrap();
    let tree = job.recorded();
    let mut scattered: Vec<Scattered> = Vec::new();
    for (part, job) in parts("scatter", &tree) {
        let run = context(&job, &progress, memory_bytes);
        scattered.insert(0, scatter_part(&source, part, &run).unwrap());
    }
    let mut shared: Vec<SharedPart> = Vec::new();
    for (part, job) in parts("share", &tree) {
        let run = context(&job, &progress, memory_bytes);
        shared.insert(0, share_part(&source, part, &scattered, &run).unwrap());
    }
    let job = guest("partition.", &tree);
    let run = context(&job, &progress, memory_bytes);
    let partition = join_parts(&source, cell_triangles, (&scattered, &shared), &run).unwrap();
    let layout = VertexLayout::new(source.schema(), source.n_vertices());
    let store = CellStore::open(&disk, folder, partition.store.clone(), layout).unwrap();
    let cells = CellId::first(store.n_cells()).map(|cell| store.load_tidy(cell).unwrap()).collect();
    (partition, cells)
}

/// Parts of the partition give the cells of one process bit for bit, also where pages of the table come and go,
/// where faces are in no order, with more parts than blocks, and with notes that exceed their memory.
fn assert_parts_are_the_whole(cell_triangles: u64, folder: &std::path::Path) {
    let (whole, cells) = cut_in(cell_triangles, folder, 1 << 30, Duration::MAX);
    for (memory, of) in [(1 << 30, 1), (1 << 30, 3), (1 << 10, 2), (1 << 10, 5), (32 << 20, 16)] {
        let (parts, others) = cut_in_parts(cell_triangles, folder, memory, of);
        let what = format!("{of} parts, {memory} bytes");
        assert_eq!(whole.store.cells, parts.store.cells, "{what}");
        assert_eq!(whole.store.shared_vertices, parts.store.shared_vertices, "{what}");
        assert_eq!(whole.store.split, parts.store.split, "{what}");
        assert_eq!(whole.seam_place, parts.seam_place, "{what}");
        assert_eq!(whole.bounds, parts.bounds, "{what}");
        assert_eq!(whole.degenerate_faces, parts.degenerate_faces, "{what}");
        assert_same(&cells, &others, &what);
    }
}

#[test]
fn parts_of_a_mesh_in_order_give_the_same_cells_bit_for_bit() {
    let folder = tempfile::tempdir().unwrap();
    write_grid(folder.path(), 880);
    assert_parts_are_the_whole(20_000, folder.path());
}

#[test]
fn parts_of_a_mesh_in_no_order_give_the_same_cells_bit_for_bit() {
    let folder = tempfile::tempdir().unwrap();
    write_shuffled_grid(folder.path(), 400);
    assert_parts_are_the_whole(400, folder.path());
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
    write_shuffled_grid(folder.path(), 400);
    let (whole, cells) = cut_in(400, folder.path(), 1 << 30, Duration::MAX);
    assert!(cells.len() >= 500, "{}", cells.len());
    assert_eq!(whole.store.triangles, 399 * 399 * 2);
    for (memory, every) in
        [(1 << 10, Duration::ZERO), (1 << 10, Duration::MAX), (600 << 10, Duration::MAX)]
    {
        let (windowed, other) = cut_in(400, folder.path(), memory, every);
        assert_eq!(whole.store.shared_vertices, windowed.store.shared_vertices);
        assert_eq!(whole.seam_place, windowed.seam_place);
        assert_same(&cells, &other, &format!("{memory} bytes"));
    }
}

/// A table that is packed, and one that lies in a file, change no bit, with and without checkpoints.
#[test]
fn a_table_in_a_file_gives_the_same_cells_bit_for_bit() {
    let folder = tempfile::tempdir().unwrap();
    // Cells of some 60 vertices, so that packing saves little: 12 blocks, of which memory for one is given.
    let n = 880;
    write_grid(folder.path(), n);
    let (whole, cells) = cut_in(120, folder.path(), 1 << 30, Duration::MAX);
    let n_cells = cells.len() as u32;
    let sizes =
        |layout| Sizes { n_vertices: u64::from(n * n), n_cells, store_bytes: 1 << 24, layout };
    let source = MeshSource::open(&folder.path().join("grid.ply")).unwrap();
    assert!(is_local(&source).unwrap());
    let shares = Shares::new(sizes(&VertexLayout::new(source.schema(), 1)), 2, 1 << 10);
    assert!(shares.table_bytes <= 1 << 17, "{shares:?}");
    for every in [Duration::ZERO, Duration::MAX] {
        let (filed, other) = cut_in(120, folder.path(), 1 << 10, every);
        assert_eq!(whole.store.shared_vertices, filed.store.shared_vertices);
        assert_same(&cells, &other, "in a file");
    }
}

/// Ids of 8 bytes, as for inputs of more than 2^32 vertices, give the same cells.
#[test]
fn wide_ids_give_the_same_cells_bit_for_bit() {
    let folder = tempfile::tempdir().unwrap();
    write_shuffled_grid(folder.path(), 300);
    let (narrow, cells) = cut_in(400, folder.path(), 1 << 30, Duration::MAX);
    ALWAYS_WIDE.set(true);
    for memory in [1 << 10, 1 << 30] {
        let (wide, others) = cut_in(400, folder.path(), memory, Duration::ZERO);
        assert!(wide.store.pack_bytes() > narrow.store.pack_bytes());
        assert_eq!(wide.store.cells, narrow.store.cells);
        assert_same(&cells, &others, &format!("{memory} bytes"));
    }
    ALWAYS_WIDE.set(false);
}

/// More cells than 16 bits can number: every triangle is in one of them, with its own vertices.
#[test]
fn more_than_65536_cells_hold_every_triangle() {
    let folder = tempfile::tempdir().unwrap();
    let n = 301u64;
    write_grid(folder.path(), n as u32);
    for memory in [1 << 30, 1 << 20] {
        let (partition, cells) = cut_in(2, folder.path(), memory, Duration::MAX);
        assert!(cells.len() > 1 << 16, "{}", cells.len());
        assert_eq!(partition.store.triangles, 2 * (n - 1) * (n - 1));
        let mut triangles: Vec<[GlobalVertex; 3]> = Vec::new();
        for cell in &cells {
            for t in &cell.mesh.triangles {
                for &v in t {
                    let (id, at) = (cell.ids[v as usize], cell.mesh.positions[v as usize]);
                    assert_eq!(at, [(id.0 % n) as f64, (id.0 / n) as f64, 0.0]);
                }
                triangles.push(t.map(|v| cell.ids[v as usize]));
            }
        }
        triangles.sort_unstable();
        triangles.dedup();
        assert_eq!(triangles.len() as u64, partition.store.triangles);
        assert!(cells.iter().filter(|cell| !cell.mesh.triangles.is_empty()).count() > 1 << 15);
    }
}

/// Pairs of a vertex and a foreign cell that exceed their memory go to disk and come back the same.
#[test]
fn pairs_on_disk_give_the_same_cells_bit_for_bit() {
    let folder = tempfile::tempdir().unwrap();
    // 160,000 vertices in a square, two far corners to each triangle: nearly 320,000 pairs.
    let n = 160_000u64;
    let places = (0..n).map(|i| i * STRIDE % n).collect::<Vec<_>>();
    let positions = places.iter().map(|place| [(place % 400) as f64, (place / 400) as f64, 0.0]);
    let faces: Vec<[u32; 3]> =
        (0..n).map(|i| [i, 7919 * i + 3, 104_729 * i + 11].map(|v| (v % n) as u32)).collect();
    write_mesh(folder.path(), positions, &faces);
    let (whole, cells) = cut_in(500, folder.path(), 1 << 30, Duration::MAX);
    let n_foreign: usize = cells.iter().map(|cell| cell.ids.len()).sum::<usize>() - n as usize;
    assert!(n_foreign > 150_000, "{n_foreign}");
    // Room for 65,536 pairs with the table in windows, and for 131,072 with the whole table.
    for (memory, every) in
        [(1 << 10, Duration::MAX), (32 << 20, Duration::MAX), (32 << 20, Duration::ZERO)]
    {
        let (other, others) = cut_in(500, folder.path(), memory, every);
        assert_eq!(whole.seam_place, other.seam_place);
        assert_same(&cells, &others, &format!("{memory} bytes"));
    }
    assert_parts_are_the_whole(500, folder.path());
}

/// Cells that are split by ids, and whose triangles came in several windows, are the same bit for bit.
#[test]
fn a_split_cell_in_windows_is_the_same_bit_for_bit() {
    let folder = tempfile::tempdir().unwrap();
    // Every fourth vertex in one place: positions cannot tell these apart, only ids.
    let n = 200_000u64;
    let place = |i: u64| [1, 7, 49].map(|k| (i * STRIDE * k % n) as f64 / n as f64);
    let positions: Vec<_> = (0..n).map(|i| if i % 4 > 0 { place(i) } else { [0.5; 3] }).collect();
    // Steps without a common divisor with `n`: the lowest corner is in any window.
    let faces: Vec<[u32; 3]> =
        (0..n).map(|i| [7 * i, 7919 * i + 3, 104_729 * i + 11].map(|v| (v % n) as u32)).collect();
    write_mesh(folder.path(), positions.into_iter(), &faces);
    let (whole, cells) = cut_in(500, folder.path(), 1 << 30, Duration::MAX);
    assert!(!whole.store.split.is_empty());
    let (windowed, other) = cut_in(500, folder.path(), 1 << 10, Duration::MAX);
    assert_eq!(whole.store.cells, windowed.store.cells);
    assert_same(&cells, &other, "split");
    assert_parts_are_the_whole(500, folder.path());
}

/// A fan around the vertex of lowest index, which would be one cell, comes out as cells of the planned size that
/// hold all their vertices and share those at their edges.
#[test]
fn a_cell_denser_than_planned_is_split() {
    let folder = tempfile::tempdir().unwrap();
    let (n, limit) = (100_000u32, 20_000);
    let positions = (0..n + 1).map(|i| {
        let angle = f64::from(i) * 1e-4;
        [angle.cos(), angle.sin(), 0.0]
    });
    let faces: Vec<[u32; 3]> = (0..n).map(|i| [1 + i, 1 + (i + 1) % n, 0]).collect();
    write_mesh(folder.path(), positions, &faces);
    let (partition, cells) = cut(folder.path(), 1 << 30, Duration::MAX);
    assert_eq!(partition.store.split.len(), 1);
    let mut triangles: Vec<[GlobalVertex; 3]> = Vec::new();
    let mut users = BTreeMap::<GlobalVertex, u32>::new();
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
    let mut expected: Vec<[GlobalVertex; 3]> =
        faces.iter().map(|t| t.map(GlobalVertex::in_memory)).collect();
    expected.sort_unstable();
    assert!(triangles == expected);
    for cell in &cells {
        for (id, shared) in cell.ids.iter().zip(&cell.shared) {
            assert!(*shared || users.get(id).is_none_or(|&n| n == 1), "vertex {id}");
        }
    }
}
