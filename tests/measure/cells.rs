//! Measuring out of core gives the numbers of measuring in memory.

use crate::common::meshes::sheet_triangles;
use crate::common::write_ply;
use std::path::Path;
use stonecut::Error;
use stonecut::io::ply::{MeshSource, OutputHeader, PlyWriter};
use stonecut::measure::compare::{Request, compare, compare_in_cells};
use stonecut::measure::{Options, Region, Side};
use stonecut::mesh::property::{Property, Scalar};
use stonecut::mesh::record::VertexSchema;
use stonecut::system::progress::Progress;

/// A bumpy coloured height field with a closed tube through it, `2 n^2` triangles and more, some of its
/// faces degenerate, some vertices unused.
fn write_scene(path: &Path, n: u32, noise: f64) {
    let mut records = Vec::new();
    let mut triangles: Vec<[u64; 3]> = Vec::new();
    let property = |name: &str| Property::new(name, Scalar::U8);
    let schema = VertexSchema {
        coordinate: Scalar::F32,
        properties: vec![property("red"), property("green"), property("blue")],
    };
    let mut vertex = |p: [f64; 3]| {
        schema.encode_position(p, &mut records);
        records.extend(p.map(|x| (x * 40.0).rem_euclid(255.0) as u8));
        (records.len() / schema.record_bytes()) as u64 - 1
    };
    let mut hash = 1u64;
    let mut random = || {
        hash = hash.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        noise * ((hash >> 40) as f64 / (1u64 << 24) as f64 - 0.5)
    };
    let mut grid =
        |wrap: bool, place: &dyn Fn(f64, f64) -> [f64; 3], random: &mut dyn FnMut() -> f64| {
            let columns = if wrap { n } else { n + 1 };
            let mut first = None;
            for j in 0..=n {
                for i in 0..columns {
                    let mut p = place(f64::from(i) / f64::from(n), f64::from(j) / f64::from(n));
                    p.iter_mut().for_each(|x| *x += random());
                    first.get_or_insert(vertex(p));
                }
            }
            let at = |i: u32, j: u32| first.unwrap_or(0) + u64::from(j * columns + i % columns);
            for j in 0..n {
                for i in 0..n {
                    triangles.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
                    triangles.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
                }
            }
        };
    grid(false, &|x, y| [8.0 * x, 6.0 * y, 0.3 * (9.0 * x).sin() * (7.0 * y).cos()], &mut random);
    grid(
        true,
        &|u, v| {
            let angle = u * std::f64::consts::TAU;
            [8.0 * v, 3.0 + angle.cos(), 0.5 + angle.sin()]
        },
        &mut random,
    );
    vertex([1.0, 1.0, 1.0]);
    triangles.push([3, 3, 4]);
    let n_vertices = (records.len() / schema.record_bytes()) as u64;
    let header = OutputHeader::new(schema, n_vertices, triangles.len() as u64);
    let mut writer = PlyWriter::create(path, header).unwrap();
    writer.write_vertices(&records).unwrap();
    writer.write_faces(&triangles).unwrap();
    writer.finish().unwrap();
}

fn request<'a>(sources: &'a [MeshSource; 2], folder: &Path) -> Request<'a> {
    Request {
        original: &sources[0],
        simplified: &sources[1],
        options: Options { samples: 60_000, threads: 2, ..Options::default() },
        memory_bytes: 4 << 30,
        cell_triangles: 2000,
        temp_dir: folder.to_path_buf(),
        heat: false,
    }
}

fn sources(folder: &Path) -> [MeshSource; 2] {
    ["original.ply", "simplified.ply"].map(|name| MeshSource::open(&folder.join(name)).unwrap())
}

fn numbers(side: &Side) -> Vec<f64> {
    let d = &side.distance;
    let mut all = vec![d.mean, d.rms, d.p999, d.max, d.samples as f64, side.vertices as f64];
    all.extend([side.normal_degrees.unwrap(), side.color_delta_e.unwrap()]);
    all.extend(side.worst.unwrap());
    all.extend(side.histogram.iter().map(|&n| n as f64));
    all
}

#[test]
fn cells_give_the_numbers_of_one_mesh() {
    let folder = tempfile::tempdir().unwrap();
    write_scene(&folder.path().join("original.ply"), 150, 0.01);
    write_scene(&folder.path().join("simplified.ply"), 130, 0.02);
    let sources = sources(folder.path());
    let progress = Progress::default();
    let whole = compare(&request(&sources, folder.path()), &progress).unwrap();
    assert_eq!(whole.cells, 0);
    // First the simplified mesh is in memory, then in cells too; few cells and many; any threads.
    let mib = 1u64 << 20;
    for (memory, cells, threads) in
        [(500 * mib, 20_000, 2), (60 * mib, 9000, 2), (56 * mib, 1500, 1)]
    {
        let mut request = request(&sources, folder.path());
        (request.memory_bytes, request.cell_triangles) = (memory, cells);
        request.options.threads = threads;
        let cut = compare_in_cells(&request, &progress).unwrap();
        assert!(cut.cells > 3, "{} cells", cut.cells);
        assert_eq!(cut.measured.original, whole.measured.original);
        assert_eq!(cut.measured.simplified, whole.measured.simplified);
        let (a, b) = (&whole.measured.deviation, &cut.measured.deviation);
        for (x, y) in [(&a.forward, &b.forward), (&a.backward, &b.backward)] {
            for (x, y) in numbers(x).into_iter().zip(numbers(y)) {
                assert!(
                    (x - y).abs() <= 1e-9 * x.abs(),
                    "{x} {y} with {memory} bytes: {a:?} {b:?}"
                );
            }
        }
        let left: Vec<_> = std::fs::read_dir(folder.path()).unwrap().collect();
        assert_eq!(left.len(), 2, "temporary files stay behind: {left:?}");
    }
}

#[test]
fn a_budget_for_nothing_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    write_scene(&folder.path().join("original.ply"), 60, 0.01);
    write_scene(&folder.path().join("simplified.ply"), 20, 0.0);
    let sources = sources(folder.path());
    let request = Request { memory_bytes: 41 << 20, ..request(&sources, folder.path()) };
    let error = compare(&request, &Progress::default()).unwrap_err();
    assert_eq!(error.exit_code(), 6, "{error}");
}

/// Two parallel squares of `n^2` quads each, `scale` apart and wide.
fn write_squares(folder: &Path, n: u32, scale: f64) {
    for (name, z) in [("original.ply", 0.0), ("simplified.ply", 0.25 * scale)] {
        let at = |i: u32| [i % (n + 1), i / (n + 1)].map(|x| f64::from(x) / f64::from(n) * scale);
        let points: Vec<_> = (0..(n + 1) * (n + 1)).map(at).map(|[x, y]| [x, y, z]).collect();
        write_ply(&folder.join(name), Scalar::F64, &points, &sheet_triangles(n as usize));
    }
}

#[test]
fn coordinates_of_any_size_are_measured_in_cells_too() {
    let folder = tempfile::tempdir().unwrap();
    for scale in [1e-300, 1e-150, 1.0, 1e150, 1e300] {
        write_squares(folder.path(), 80, scale);
        let sources = sources(folder.path());
        let mut request = request(&sources, folder.path());
        request.heat = true;
        let whole = compare(&request, &Progress::default()).unwrap();
        let cut = compare_in_cells(&request, &Progress::default()).unwrap();
        assert!(whole.cells == 0 && cut.cells > 1, "{scale:e}");
        for found in [&whole, &cut] {
            let deviation = &found.measured.deviation;
            for side in [&deviation.forward.distance, &deviation.backward.distance] {
                for value in [side.mean, side.rms, side.p999, side.max] {
                    assert!((value / scale - 0.25).abs() < 1e-12, "{scale:e}: {side:?}");
                }
                assert!(side.samples.abs_diff(60_000) < 1000, "{scale:e}: {side:?}");
            }
            assert!((deviation.diagonal / scale - 2f64.sqrt()).abs() < 1e-12, "{scale:e}");
            assert!(found.heat.iter().all(|d| (d / scale - 0.25).abs() < 1e-12), "{scale:e}");
        }
    }
}

#[test]
fn a_surface_without_area_is_refused_not_called_perfect() {
    let folder = tempfile::tempdir().unwrap();
    let line: Vec<[f64; 3]> = (0..300).map(|i| [f64::from(i), 0.0, 0.0]).collect();
    let needles: Vec<[u32; 3]> = (0..298).map(|i| [i, i + 1, i + 2]).collect();
    for flat in ["original.ply", "simplified.ply"] {
        write_squares(folder.path(), 20, 1.0);
        write_ply(&folder.path().join(flat), Scalar::F64, &line, &needles);
        let sources = sources(folder.path());
        let request = request(&sources, folder.path());
        for error in [
            compare(&request, &Progress::default()).unwrap_err(),
            compare_in_cells(&request, &Progress::default()).unwrap_err(),
        ] {
            assert_eq!(error.exit_code(), 4, "{error}");
            let said = error.to_string();
            assert!(said.contains(flat) && said.contains("no area"), "{said}");
        }
    }
}

/// The points of a region lie in the same budget as the meshes.
#[test]
fn a_region_leaves_less_memory_for_the_meshes() {
    let folder = tempfile::tempdir().unwrap();
    write_scene(&folder.path().join("original.ply"), 150, 0.01);
    write_scene(&folder.path().join("simplified.ply"), 130, 0.02);
    let sources = sources(folder.path());
    let progress = Progress::default();
    let mut request = request(&sources, folder.path());
    request.memory_bytes = 72 << 20;
    assert_eq!(compare(&request, &progress).unwrap().cells, 0);
    let points: Vec<[f64; 3]> = (0..200_000).map(|i| [f64::from(i) * 4e-5, 3.0, 0.0]).collect();
    let region = Region::around_points(&points, 0.1);
    assert!(region.bytes() > 15 << 20);
    request.options.region = Some(region);
    match compare(&request, &progress) {
        Ok(cut) => assert!(cut.cells > 0),
        Err(error) => assert!(matches!(error, Error::NoMemory(_)), "{error}"),
    }
    // Where the budget holds all, the region is what it was.
    request.memory_bytes = 4 << 30;
    let side = compare(&request, &progress).unwrap().measured.deviation.forward;
    let (near, far) = (side.near.unwrap(), side.far.unwrap());
    assert!(near.samples > 0 && far.samples > 0);
    assert_eq!(near.samples + far.samples, side.distance.samples);
}
