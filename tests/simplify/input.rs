//! What `simplify` drops from its input and says so, and what it must not touch.

use crate::common::{check, count, expect, json, rms, scratch};
use std::collections::HashMap;
use std::path::Path;
use stonecut::io::ply::{FaceBlock, MeshSource, OutputHeader, PlyWriter, VertexBlock};
use stonecut::mesh::property::{Property, Scalar};
use stonecut::mesh::record::VertexSchema;

/// Doubles and a number a vertex that comes through as a label.
fn schema() -> VertexSchema {
    let label = Property::new("label", Scalar::I32);
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

/// Quads of a bumpy sheet, as OBJ and as PLY in text and binary; `n * n` of them.
fn write_quads(folder: &Path, n: u32) -> [&'static str; 3] {
    use std::fmt::Write as _;
    let at = |x: u32, y: u32| y * (n + 1) + x;
    let points: Vec<[f32; 3]> = (0..(n + 1) * (n + 1))
        .map(|i| [(i % (n + 1)) as f32, (i / (n + 1)) as f32])
        .map(|[x, y]| [x, y, 2.0 * (0.3 * x).sin() * (0.2 * y).cos()])
        .collect();
    let quads: Vec<[u32; 4]> = (0..n * n)
        .map(|i| (i % n, i / n))
        .map(|(x, y)| [at(x, y), at(x + 1, y), at(x + 1, y + 1), at(x, y + 1)])
        .collect();
    let (mut obj, mut text, mut binary) = (String::new(), String::new(), Vec::new());
    for [x, y, z] in &points {
        writeln!(obj, "v {x} {y} {z}").unwrap();
        writeln!(text, "{x} {y} {z}").unwrap();
        [x, y, z].iter().for_each(|v| binary.extend(v.to_le_bytes()));
    }
    for q in &quads {
        writeln!(obj, "f {} {} {} {}", q[0] + 1, q[1] + 1, q[2] + 1, q[3] + 1).unwrap();
        writeln!(text, "4 {} {} {} {}", q[0], q[1], q[2], q[3]).unwrap();
        binary.push(4);
        q.iter().for_each(|v| binary.extend(v.to_le_bytes()));
    }
    let header = |format: &str| {
        format!(
            "ply\nformat {format} 1.0\nelement vertex {}\nproperty float x\nproperty float y\n\
             property float z\nelement face {}\nproperty list uchar uint vertex_indices\nend_header\n",
            points.len(),
            quads.len()
        )
    };
    std::fs::write(folder.join("q.obj"), obj).unwrap();
    std::fs::write(folder.join("q-text.ply"), header("ascii") + &text).unwrap();
    let head = header("binary_little_endian");
    std::fs::write(folder.join("q.ply"), [head.as_bytes(), &binary].concat()).unwrap();
    ["q.obj", "q-text.ply", "q.ply"]
}

#[test]
fn a_quad_is_two_triangles_everywhere() {
    let out = &scratch();
    for file in write_quads(out, 50) {
        let said =
            expect(out, &format!("simplify {file} o.ply --ratio 1 --force --report r.json"), 0);
        assert!(said.contains("input    5000 triangles"), "{file}: {said}");
        let report = json(out, "r.json");
        assert_eq!(count(&report["input"], "triangles"), 5000, "{file}");
        assert_eq!(count(&report, "target"), 5000, "{file}");
        assert_eq!(count(&report["output"], "triangles"), 5000, "{file}");
        expect(out, &format!("simplify {file} o.ply --ratio 20% --force"), 0);
        // The last collapse may take two.
        assert!((999..=1000).contains(&count(&check(out, "o.ply"), "triangles")), "{file}");
        expect(out, &format!("simplify {file} o.ply --max-error 1e-9 --force"), 0);
        assert_eq!(count(&check(out, file), "faces"), 2500, "{file}");
    }
}

#[test]
fn one_polygon_is_as_many_triangles_as_it_has_corners_but_two() {
    let out = &scratch();
    for n in [5u32, 1000] {
        let turn = |i: u32| std::f64::consts::TAU * f64::from(i) / f64::from(n);
        let corners = |i: u32| format!("v {} {} 0\n", turn(i).cos(), turn(i).sin());
        let face: String = (1..=n).map(|i| format!(" {i}")).collect();
        let text = (0..n).map(corners).collect::<String>() + "f" + &face + "\n";
        std::fs::write(out.join("p.obj"), text).unwrap();
        let said = expect(out, "simplify p.obj o.ply --max-error 0.01 --force --report r.json", 0);
        assert!(said.contains(&format!("input    {} triangles", n - 2)), "{said}");
        expect(out, "measure p.obj o.ply --report m.json", 0);
        let json = json(out, "m.json");
        assert!(json["forward"]["max"].as_f64().unwrap() <= 0.01, "{json}");
    }
}

/// A file whose first, last and probed rows are all triangles, and which has a quad in between; with
/// something behind the faces, so that its length proves nothing.
#[test]
fn a_quad_that_hides_among_triangles_counts() {
    let n = 100_000usize;
    let mut text = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex 4\nproperty float x\nproperty float y\n\
         property float z\nelement face {n}\nproperty list uchar uint vertex_indices\nend_header\n"
    )
    .into_bytes();
    for v in [[0.0f32, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]] {
        v.iter().for_each(|x| text.extend(x.to_le_bytes()));
    }
    let mut pure = text.clone();
    for i in 0..n {
        let corners: &[u32] = if i == 77_777 { &[0, 1, 2, 3] } else { &[0, 1, 2] };
        text.push(corners.len() as u8);
        corners.iter().for_each(|v| text.extend(v.to_le_bytes()));
        pure.push(3);
        [0u32, 1, 2].iter().for_each(|v| pure.extend(v.to_le_bytes()));
    }
    let read = |bytes: Vec<u8>| {
        MeshSource::from_bytes("hidden.ply", bytes, stonecut::io::ply::ReadOptions::default())
            .unwrap()
    };
    for tail in ["", "\n", "something else"] {
        let mut bytes = text.clone();
        bytes.extend(tail.as_bytes());
        let source = read(bytes);
        assert_eq!(
            (source.n_face_rows(), source.n_triangles()),
            (n as u64, n as u64 + 1),
            "{tail:?}"
        );
        let mut bytes = pure.clone();
        bytes.extend(tail.as_bytes());
        assert_eq!(read(bytes).n_triangles(), n as u64, "{tail:?}");
    }
}

/// A sheet with faces for both sides, leaves of two triangles with backs, and a plain sheet, all apart.
#[test]
fn two_sided_sheets_lose_their_backs_through_any_cells() {
    let at = &scratch();
    let n = 40;
    let back = |t: [u32; 3]| [t[0], t[2], t[1]];
    let (mut points, mut faces) = (georeferenced(n), squares(n));
    faces.extend(squares(n).into_iter().map(back));
    for leaf in 0..20 {
        let first = points.len() as u32;
        let corner = |i: u32| {
            [points[0][0] + f64::from(leaf + i % 2), points[0][1] - 3.0 - f64::from(i / 2), 432.0]
        };
        points.extend((0..4).map(corner).collect::<Vec<_>>());
        let front = squares(1).into_iter().map(|t| t.map(|v| v + first));
        faces.extend(front.flat_map(|t| [t, back(t)]));
    }
    let n_backs = i64::from(2 * n * n) + 40;
    let first = points.len() as u32;
    points.extend(georeferenced(2 * n).into_iter().map(|[x, y, z]| [x + 30.0, y, z]));
    faces.extend(squares(2 * n).into_iter().map(|t| t.map(|v| v + first)));
    write(&at.join("in.ply"), &points, &faces);
    for cells in ["", "--cell-triangles 1000", "--topology keep"] {
        let options = format!("--ratio 10% --force --report r.json {cells}");
        let told = expect(at, &format!("simplify in.ply out.ply {options}"), 0);
        assert!(told.contains("faces were backs of two-sided sheets"), "{cells}: {told}");
        let faults = &json(at, "r.json")["input"]["faults"];
        let found = ["duplicate_faces", "back_faces"].map(|key| count(faults, key));
        assert_eq!(found, [n_backs; 2], "{cells}");
        assert!(rms(at, "in.ply", "out.ply") < 0.1, "{cells}");
    }
}
