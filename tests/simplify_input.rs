//! What `simplify` drops from its input and says so, and what it must not touch.

#![allow(clippy::unwrap_used)] // A test fails by panicking.

mod common;

use common::{check, count, expect};
use std::collections::HashMap;
use std::path::Path;
use stonecut::ply::{FaceBlock, MeshSource, OutputHeader, PlyWriter, VertexBlock};
use stonecut::schema::{Property, Scalar, VertexSchema};

/// Doubles and a number a vertex that comes through as a label.
fn schema() -> VertexSchema {
    let label = Property { name: "label".to_owned(), scalar: Scalar::I32 };
    VertexSchema { coordinate: Scalar::F64, properties: vec![label] }
}

/// Corners of `n` x `n` squares on `n + 1` x `n + 1` vertices.
fn squares(n: u32) -> Vec<[u32; 3]> {
    let at = |x: u32, y: u32| y * (n + 1) + x;
    let places = (0..n).flat_map(|y| (0..n).map(move |x| (x, y)));
    places
        .flat_map(|(x, y)| {
            let (a, b, c, d) = (at(x, y), at(x + 1, y), at(x, y + 1), at(x + 1, y + 1));
            [[a, b, d], [a, d, c]]
        })
        .collect()
}

/// A bumpy sheet far from the origin; coordinates have bits in every place of a double.
fn georeferenced(n: u32) -> Vec<[f64; 3]> {
    let place = |i: u32| (f64::from(i % (n + 1)), f64::from(i / (n + 1)));
    let point = |i: u32| {
        let (x, y) = place(i);
        let z = 3.0 * (x * 0.21).sin() * (y * 0.17).cos() + 0.05 * (x * 3.7 + y * 5.1).sin();
        [512_345.678_901 + x / 3.0, 5_412_345.123_456 + y / 3.0, 431.987 + z / 3.0]
    };
    (0..(n + 1) * (n + 1)).map(point).collect()
}

fn write(path: &Path, points: &[[f64; 3]], faces: &[[u32; 3]]) {
    let mut records = Vec::new();
    for (i, point) in points.iter().enumerate() {
        schema().encode_position(*point, &mut records);
        records.extend((i as i32).to_le_bytes());
    }
    let header = OutputHeader::new(schema(), points.len() as u64, faces.len() as u64);
    let mut writer = PlyWriter::create(path, header).unwrap();
    writer.write_vertices(&records).unwrap();
    writer.write_faces_u32(faces).unwrap();
    writer.finish().unwrap();
}

/// Position bits by label, of all vertices that faces use.
fn positions(path: &Path) -> HashMap<i32, [u64; 3]> {
    let source = MeshSource::open(path).unwrap();
    assert_eq!(source.schema(), &schema());
    let (mut block, mut out) = (VertexBlock::default(), HashMap::new());
    for i in 0..source.n_vertex_blocks() {
        source.read_vertices(i, &mut block).unwrap();
        for record in block.records.chunks_exact(28) {
            let bits =
                [0, 8, 16].map(|at| u64::from_le_bytes(record[at..at + 8].try_into().unwrap()));
            out.insert(i32::from_le_bytes(record[24..28].try_into().unwrap()), bits);
        }
    }
    let mut faces = FaceBlock::default();
    source.read_faces(0, &mut faces).unwrap();
    out
}

#[test]
fn a_georeferenced_vertex_that_is_not_moved_comes_out_bit_for_bit() {
    let folder = tempfile::tempdir().unwrap();
    let (n, out) = (120, folder.path());
    write(&out.join("in.ply"), &georeferenced(n), &squares(n));
    let before = positions(&out.join("in.ply"));
    let cells = "--cell-triangles 3k --topology keep --force";

    expect(out, &format!("simplify in.ply all.ply --ratio 100% {cells}"), 0);
    assert_eq!(positions(&out.join("all.ply")), before);

    for ratio in ["90%", "50%", "10%"] {
        expect(out, &format!("simplify in.ply some.ply --ratio {ratio} {cells}"), 0);
        let after = positions(&out.join("some.ply"));
        let (mut n_same, mut least_move) = (0, f64::INFINITY);
        for (label, bits) in &after {
            let moved =
                (0..3).map(|k| (f64::from_bits(bits[k]) - f64::from_bits(before[label][k])).abs());
            if bits == &before[label] {
                n_same += 1;
            } else {
                least_move = least_move.min(moved.fold(0.0, f64::max));
            }
        }
        println!(
            "{ratio}: {n_same} of {} unmoved, the others by {least_move:.1e} or more",
            after.len()
        );
        // A coordinate that was shifted and shifted back would be off by up to 1e-9.
        assert!(least_move > 1e-8, "{ratio}: {least_move:e}");
        assert!(n_same > 0 || ratio == "10%", "{ratio}");
    }
}

#[test]
fn repeated_faces_and_idle_vertices_are_dropped_and_counted() {
    let folder = tempfile::tempdir().unwrap();
    let (n, out) = (100u32, folder.path());
    let (mut points, clean) = (georeferenced(n), squares(n));
    let mut faces = Vec::new();
    let mut n_repeats = 0;
    for (i, &[a, b, c]) in clean.iter().enumerate() {
        faces.push([a, b, c]);
        // Repeats begin at any corner and run either way round.
        let repeats = [[a, b, c], [b, c, a], [c, b, a], [c, a, b], [b, a, c]];
        if i % 7 == 0 {
            faces.push(repeats[i % 5]);
            n_repeats += 1;
        }
        if i % 91 == 0 {
            faces.push(repeats[(i + 2) % 5]);
            n_repeats += 1;
        }
        if i % 50 == 0 {
            faces.push([a, a, c]);
        }
    }
    // Far behind the faces they repeat, too.
    faces.extend(clean.iter().step_by(13).map(|&[a, b, c]| [c, a, b]));
    n_repeats += clean.len().div_ceil(13) as u64;
    let n_idle = 57;
    points.extend((0..n_idle).map(|i| [512_346.0 + f64::from(i) / 2.0, 5_412_350.0, 432.0]));
    write(&out.join("dirty.ply"), &points, &faces);

    // In one cell without a round, in several with one finish, and with rounds alone.
    let budget = "--memory 4GiB";
    for command in
        ["--ratio 20%", "--ratio 20% --cell-triangles 2k", "--ratio 90% --cell-triangles 1k"]
    {
        let report = |more: &str| -> serde_json::Value {
            expect(
                out,
                &format!("simplify dirty.ply o.ply {command} {more} --force --report r.json"),
                0,
            );
            serde_json::from_slice(&std::fs::read(out.join("r.json")).unwrap()).unwrap()
        };
        let found = report(budget);
        let faults = &found["input"]["faults"];
        assert_eq!(count(faults, "duplicate_faces"), n_repeats as i64, "{command}");
        assert_eq!(count(faults, "degenerate_faces"), clean.len().div_ceil(50) as i64);
        assert_eq!(count(faults, "unreferenced_vertices"), i64::from(n_idle), "{command}");
        let topology = check(out, "o.ply");
        for key in ["duplicate_triangles", "unreferenced_vertices", "non_manifold_edges"] {
            assert_eq!(count(&topology, key), 0, "{command}: {key}");
        }
        assert_eq!(count(&topology, "euler_characteristic"), 1, "{command}");
        let whole = std::fs::read(out.join("o.ply")).unwrap();
        report("--threads 1 --memory 60MiB");
        assert!(whole == std::fs::read(out.join("o.ply")).unwrap(), "{command}");
    }

    // The same as conversion finds.
    let said = expect(out, "convert dirty.ply clean.ply", 0);
    assert!(said.contains(&format!("{n_repeats} repeated faces dropped")), "{said}");
    assert!(said.contains(&format!("{n_idle} vertices without a face")), "{said}");
}
