//! Meshes in memory: cells in memory show as little as cells on disk, and one cell gives the bytes of a file.

use crate::common::expect;
use std::ffi::OsString;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use stonecut::cli::call;
use stonecut::config::Config;
use stonecut::io::ply::MeshSource;
use stonecut::kernel::Interrupt;
use stonecut::measure::{Options, load, two_sided};
use stonecut::mesh::property::{Property, Scalar};
use stonecut::mesh::topology_counts;
use stonecut::pipeline::in_memory::attributes::{Attributes, Column};
use stonecut::pipeline::in_memory::{Input, Output, simplify};
use stonecut::system::progress::Progress;
use stonecut::{Error, Mesh};

fn config(options: &str) -> Config {
    let words = ["simplify", "arrays", "arrays.ply"].into_iter().chain(options.split_whitespace());
    call::config(&words.map(OsString::from).collect::<Vec<_>>()).unwrap()
}

fn read(path: &Path) -> Mesh {
    let source = MeshSource::open(path).unwrap();
    load::load(&source, 2, &Progress::default()).unwrap().mesh
}

fn statue(folder: &Path, triangles: &str) -> Mesh {
    expect(folder, &format!("synth statue in.ply --triangles {triangles}"), 0);
    read(&folder.join("in.ply"))
}

fn run(mesh: &Mesh, options: &str) -> Output {
    let input = Input {
        positions: mesh.positions.clone(),
        triangles: mesh.triangles.clone(),
        ..Input::default()
    };
    simplify(input, &config(options), &Progress::default()).unwrap()
}

fn rms(mesh: &Mesh, output: &Output) -> f64 {
    let small = Mesh::new(output.positions.clone(), output.triangles.clone());
    let options = Options { samples: 100_000, ..Options::default() };
    two_sided(mesh, &small, &options, &Progress::default()).unwrap().rms
}

#[test]
fn cells_in_memory_do_not_show() {
    let folder = tempfile::tempdir().unwrap();
    let mesh = statue(folder.path(), "120k");
    for share in ["10%", "1%"] {
        let whole = run(&mesh, &format!("--ratio {share}"));
        assert_eq!((whole.report.cells, whole.report.rounds), (1, 0));
        let options = format!("--ratio {share} --cell-triangles 4k --threads");
        let cut = run(&mesh, &format!("{options} 1"));
        assert!(cut.report.cells > 20 && cut.report.rounds >= 1, "{:?}", cut.report);
        for output in [&whole, &cut] {
            let found = topology_counts::of_triangles(output.positions.len(), &output.triangles);
            assert!(output.triangles.len() as u64 <= output.report.target);
            assert!(output.triangles.len() as u64 + 2 >= output.report.target);
            assert!(output.report.target_met && output.report.quality.bearable);
            assert_eq!(
                (found.components, found.boundary_edges, found.non_manifold_edges),
                (1, 0, 0)
            );
            assert_eq!(found.euler_characteristic, 2);
        }
        let (one, many) = (rms(&mesh, &whole), rms(&mesh, &cut));
        assert!(many < 1.1 * one, "{share}: {many} through cells, {one} in one");
        let again = run(&mesh, &format!("{options} 3"));
        assert_eq!(again.positions, cut.positions);
        assert_eq!(again.triangles, cut.triangles);
        assert_eq!(again.source, cut.source);
        assert!(cut.source.is_sorted());
    }
}

#[test]
fn one_cell_gives_what_a_file_gives() {
    let folder = tempfile::tempdir().unwrap();
    let mesh = statue(folder.path(), "30k");
    for options in ["--triangles 3000", "--ratio 1%", "--triangles 500 --topology keep"] {
        let format = "--format double --force --quiet";
        expect(folder.path(), &format!("simplify in.ply out.ply {options} {format}"), 0);
        let file = read(&folder.path().join("out.ply"));
        let memory = run(&mesh, options);
        assert_eq!(memory.triangles, file.triangles, "{options}");
        // The file's positions are those of its type, which is the input's.
        let single = |p: &[f64; 3]| p.map(|x| x as f32);
        let positions: Vec<[f32; 3]> = memory.positions.iter().map(single).collect();
        assert_eq!(positions, file.positions.iter().map(single).collect::<Vec<_>>(), "{options}");
    }
}

/// Colours by height, a scalar that is linear in x, and labels by side: whatever the cells.
#[test]
fn attributes_follow_the_surface() {
    let folder = tempfile::tempdir().unwrap();
    let mesh = statue(folder.path(), "60k");
    let low = mesh.positions.iter().map(|p| p[2]).fold(f64::INFINITY, f64::min);
    let high = mesh.positions.iter().map(|p| p[2]).fold(f64::NEG_INFINITY, f64::max);
    let shade = |p: &[f64; 3]| (255.0 * (p[2] - low) / (high - low)).round() as u8;
    let colours: Vec<u8> = mesh.positions.iter().flat_map(|p| [shade(p), 0, 255]).collect();
    let scalars: Vec<u8> =
        mesh.positions.iter().flat_map(|p| (p[0] as f32).to_le_bytes()).collect();
    let labels: Vec<u8> =
        mesh.positions.iter().flat_map(|p| (7 + i32::from(p[1] > 0.0)).to_le_bytes()).collect();
    let columns = || -> Vec<Column> {
        let colour = ["red", "green", "blue"].iter().enumerate().map(|(offset, name)| Column {
            property: Property::new(name, Scalar::U8),
            bytes: &colours,
            offset,
            stride: 3,
        });
        let four = |name: &str, scalar, bytes| Column {
            property: Property::new(name, scalar),
            bytes,
            offset: 0,
            stride: 4,
        };
        let others = [four("height", Scalar::F32, &scalars), four("side", Scalar::I32, &labels)];
        colour.chain(others).collect()
    };
    for cells in ["", "--cell-triangles 4k"] {
        let attributes = Attributes::new(columns(), mesh.positions.len(), &[]).unwrap();
        let input = Input {
            positions: mesh.positions.clone(),
            triangles: mesh.triangles.clone(),
            attributes,
            ..Input::default()
        };
        let config = config(&format!("--ratio 5% --weight height=1 {cells}"));
        let output = simplify(input, &config, &Progress::default()).unwrap();
        assert_eq!(output.records.len(), 11 * output.positions.len());
        let diagonal = high - low;
        for (v, record) in output.records.chunks_exact(11).enumerate() {
            let position = output.positions[v];
            assert!(record[0].abs_diff(shade(&position)) < 30, "{record:?} at {position:?}");
            assert!(record[1] < 12 && record[2] > 240, "{record:?}");
            let scalar = f32::from_le_bytes(record[3..7].try_into().unwrap());
            assert!((f64::from(scalar) - position[0]).abs() < 0.05 * diagonal);
            let source = output.source[v] as usize;
            assert_eq!(record[7..11], labels[4 * source..4 * source + 4]);
        }
    }
}

#[test]
fn a_request_to_stop_ends_the_call_and_faults_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let mesh = statue(folder.path(), "60k");
    let input = |triangles: Vec<[u32; 3]>| Input {
        positions: mesh.positions.clone(),
        triangles,
        ..Input::default()
    };
    for cells in ["", "--cell-triangles 4k"] {
        let stopped = Progress::default();
        stopped.request_stop(2);
        let mut config = config(&format!("--ratio 5% {cells}"));
        config.kernel.interrupt = Interrupt::when(Arc::new(AtomicBool::new(true)));
        for progress in [stopped, Progress::default()] {
            let error = simplify(input(mesh.triangles.clone()), &config, &progress).unwrap_err();
            assert!(matches!(error, Error::Interrupted { .. }), "{error}");
        }
    }
    let refused = |triangles, options: &str| {
        simplify(input(triangles), &config(options), &Progress::default()).unwrap_err().exit_code()
    };
    assert_eq!(refused(Vec::new(), "--ratio 5%"), 4);
    assert_eq!(refused(vec![[1, 1, 2]], "--triangles 1"), 4);
    assert_eq!(refused(mesh.triangles.clone(), "--max-error 1"), 2);
    assert_eq!(refused(mesh.triangles.clone(), "--ratio 5% --weight quality=1"), 2);
    assert_eq!(refused(mesh.triangles.clone(), "--ratio 5% --memory 1MiB"), 6);
    let mut faulty = mesh.triangles.clone();
    faulty.extend([[0, 0, 1], faulty[0], faulty[1]]);
    let done = simplify(input(faulty), &config("--ratio 5%"), &Progress::default()).unwrap();
    let faults = &done.report.input.faults;
    assert_eq!((faults["degenerate_faces"], faults["duplicate_faces"]), (1, 2));
    let short: &[u8] = &[0; 7];
    let column =
        Column { property: Property::new("x", Scalar::U8), bytes: short, offset: 0, stride: 1 };
    let columns = |n| Attributes::new(vec![column.clone(); n], 7, &[]);
    assert!(columns(1).is_ok());
    assert_eq!(columns(2).unwrap_err().exit_code(), 2);
    assert_eq!(Attributes::new(vec![column.clone()], 8, &[]).unwrap_err().exit_code(), 2);
    assert_eq!(Attributes::new(vec![column], 7, &["y".to_owned()]).unwrap_err().exit_code(), 2);
}
