//! What faces carry: labels as regions, colours and measures averaged, flags of every type, in cells or not.

#![allow(clippy::unwrap_used)] // A test fails by panicking.

mod common;

use common::{check, count, expect, run};
use std::collections::BTreeMap;
use std::path::Path;

/// The types of PLY with their sizes.
const TYPES: [(&str, usize); 10] = [
    ("char", 1),
    ("uchar", 1),
    ("short", 2),
    ("ushort", 2),
    ("int", 4),
    ("uint", 4),
    ("int64", 8),
    ("uint64", 8),
    ("float", 4),
    ("double", 8),
];

fn bytes_of(kind: &str) -> usize {
    TYPES.iter().find(|(name, _)| *name == kind).unwrap().1
}

/// Appends a number; integers wrap around, so that negative ones can be given for unsigned types.
fn put(kind: &str, value: f64, out: &mut Vec<u8>) {
    match kind {
        "float" => out.extend((value as f32).to_le_bytes()),
        "double" => out.extend(value.to_le_bytes()),
        _ => out.extend_from_slice(&(value as i64).to_le_bytes()[..bytes_of(kind)]),
    }
}

fn number(kind: &str, bytes: &[u8]) -> f64 {
    let mut wide = [0; 8];
    wide[..bytes.len()].copy_from_slice(bytes);
    let raw = u64::from_le_bytes(wide);
    match kind {
        "float" => f64::from(f32::from_bits(raw as u32)),
        "double" => f64::from_bits(raw),
        "char" => f64::from(raw as i8),
        "short" => f64::from(raw as i16),
        "int" => f64::from(raw as i32),
        "int64" => raw as i64 as f64,
        _ => raw as f64,
    }
}

type Triangles = (Vec<[f64; 3]>, Vec<[usize; 3]>);

/// A sphere of radius 10 of about 4 n^2 triangles.
fn sphere(n: usize) -> Triangles {
    let (rows, columns) = (n, 2 * n);
    let mut points = vec![[0.0, 0.0, 10.0]];
    for i in 1..rows {
        for j in 0..columns {
            let a = std::f64::consts::PI * i as f64 / rows as f64;
            let b = std::f64::consts::TAU * j as f64 / columns as f64;
            points.push([a.sin() * b.cos(), a.sin() * b.sin(), a.cos()].map(|x| 10.0 * x));
        }
    }
    points.push([0.0, 0.0, -10.0]);
    let id = |i: usize, j: usize| match i {
        0 => 0,
        i if i == rows => points.len() - 1,
        i => 1 + (i - 1) * columns + j % columns,
    };
    let mut faces = Vec::new();
    for i in 0..rows {
        for j in 0..columns {
            let [a, b, c, d] = [id(i, j), id(i + 1, j), id(i + 1, j + 1), id(i, j + 1)];
            let proper = |t: &[usize; 3]| t[0] != t[1] && t[1] != t[2] && t[2] != t[0];
            faces.extend([[a, b, c], [a, c, d]].into_iter().filter(proper));
        }
    }
    (points, faces)
}

fn centre(points: &[[f64; 3]], t: [usize; 3]) -> [f64; 3] {
    [0, 1, 2].map(|k| t.iter().map(|&v| points[v][k]).sum::<f64>() / 3.0)
}

/// Writes a mesh whose faces have `properties` (type and name), `value` of number and centre of the face.
fn write(
    path: &Path,
    (points, faces): &Triangles,
    properties: &[&str],
    value: impl Fn(usize, [f64; 3], usize) -> f64,
) {
    let mut text = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\n\
         property float y\nproperty float z\nelement face {}\n\
         property list uchar int vertex_indices\n",
        points.len(),
        faces.len()
    );
    properties.iter().for_each(|p| text.push_str(&format!("property {p}\n")));
    text.push_str("end_header\n");
    let mut bytes = text.into_bytes();
    points.iter().flatten().for_each(|&x| put("float", x, &mut bytes));
    for (f, &t) in faces.iter().enumerate() {
        bytes.push(3);
        t.iter().for_each(|&v| put("int", v as f64, &mut bytes));
        for (i, property) in properties.iter().enumerate() {
            let kind = property.split_once(' ').unwrap().0;
            put(kind, value(f, centre(points, t), i), &mut bytes);
        }
    }
    std::fs::write(path, bytes).unwrap();
}

struct Read {
    points: Vec<[f64; 3]>,
    faces: Vec<[usize; 3]>,
    /// Type and name of the scalar properties of faces.
    properties: Vec<String>,
    /// Their values, a row a face.
    values: Vec<Vec<f64>>,
}

/// Reads a binary mesh with float vertices and nothing but triangles without texture.
fn read(path: &Path) -> Read {
    let bytes = std::fs::read(path).unwrap();
    let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    let header = String::from_utf8_lossy(&bytes[..end]).into_owned();
    let count = |what: &str| -> usize {
        let line = header.lines().find(|l| l.starts_with(&format!("element {what} "))).unwrap();
        line.rsplit(' ').next().unwrap().parse().unwrap()
    };
    let (_, of_faces) = header.split_once("element face").unwrap();
    let properties: Vec<String> = of_faces
        .lines()
        .filter_map(|line| line.strip_prefix("property "))
        .filter(|line| !line.starts_with("list"))
        .map(str::to_owned)
        .collect();
    let mut at = end;
    let mut take = |kind: &str| {
        at += bytes_of(kind);
        number(kind, &bytes[at - bytes_of(kind)..at])
    };
    let points = (0..count("vertex")).map(|_| [0; 3].map(|_| take("float"))).collect();
    let (mut faces, mut values) = (Vec::new(), Vec::new());
    for _ in 0..count("face") {
        assert_eq!(take("uchar"), 3.0);
        faces.push([0; 3].map(|_| take("int") as usize));
        let kinds = properties.iter().map(|p| p.split_once(' ').unwrap().0);
        values.push(kinds.map(&mut take).collect());
    }
    assert_eq!(at, bytes.len());
    Read { points, faces, properties, values }
}

fn area(points: &[[f64; 3]], t: [usize; 3]) -> f64 {
    let [a, b, c] = t.map(|v| points[v]);
    let (u, v) = ([0, 1, 2].map(|k| b[k] - a[k]), [0, 1, 2].map(|k| c[k] - a[k]));
    let n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
    0.5 * n.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// Ends of the edges between faces of different values in column `i`.
fn border(mesh: &Read, i: usize) -> Vec<[usize; 2]> {
    let mut sides: BTreeMap<[usize; 2], Vec<f64>> = BTreeMap::new();
    for (t, values) in mesh.faces.iter().zip(&mesh.values) {
        for [a, b] in [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]] {
            sides.entry([a.min(b), a.max(b)]).or_default().push(values[i]);
        }
    }
    assert!(sides.values().all(|s| s.len() == 2), "closed and manifold");
    sides.into_iter().filter(|(_, s)| s[0] != s[1]).map(|(edge, _)| edge).collect()
}

/// Three regions of a sphere: a cap, and the halves of the rest.
fn region([x, _, z]: [f64; 3]) -> f64 {
    match (z > 3.0, x > 0.0) {
        (true, _) => -5.0,
        (_, true) => 70_000.0,
        _ => 9.0,
    }
}

#[test]
fn regions_keep_their_areas_and_borders() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let mesh = sphere(150);
    let properties = ["int label", "uchar red", "uchar green", "uchar blue"];
    let colour = |c: [f64; 3], k: usize| ((region(c).abs() as usize * (k + 3)) % 256) as f64;
    write(&folder.join("in.ply"), &mesh, &properties, |_, c, i| match i {
        0 => region(c),
        _ => colour(c, i),
    });
    let input = read(&folder.join("in.ply"));
    let areas = |mesh: &Read| {
        let mut areas: BTreeMap<i64, f64> = BTreeMap::new();
        for (&t, values) in mesh.faces.iter().zip(&mesh.values) {
            *areas.entry(values[0] as i64).or_default() += area(&mesh.points, t);
        }
        areas
    };
    for (ratio, cells) in [("10%", "1M"), ("1%", "1M"), ("10%", "2000"), ("1%", "5000")] {
        let options = format!("--ratio {ratio} --cell-triangles {cells} --force -q --report r.json");
        let mut same = Vec::new();
        for threads in [1, 2] {
            let command = format!("simplify in.ply out.ply {options} --threads {threads}");
            expect(folder, &command, 0);
            same.push(std::fs::read(folder.join("out.ply")).unwrap());
        }
        assert!(same[0] == same[1], "threads change nothing");
        let json = check(folder, "out.ply");
        assert_eq!((count(&json, "boundary_edges"), count(&json, "components")), (0, 1));
        let output = read(&folder.join("out.ply"));
        assert_eq!(output.properties, properties);
        for values in &output.values {
            assert!([-5.0, 70_000.0, 9.0].contains(&values[0]), "{values:?}");
            let known = (values[0].abs() as usize * 4) % 256;
            assert_eq!(values[1], known as f64, "colours go with their labels: {values:?}");
        }
        for ((label, before), (_, after)) in areas(&input).iter().zip(&areas(&output)) {
            let off = (after / before - 1.0).abs();
            assert!(off < 0.03, "{ratio} {cells}: region {label} {before} {after}");
        }
        // Borders stay where they were: the input's are jagged by half an edge of 0.2.
        let n_faces = output.faces.len() as f64;
        let edge = (4.0 / 3f64.sqrt() * 400.0 * std::f64::consts::PI / n_faces).sqrt();
        let off = |p: [f64; 3]| (p[2] - 3.0).abs().min(if p[2] < 3.1 { p[0].abs() } else { 9.0 });
        let list = border(&output, 0);
        let offs: Vec<f64> = list.iter().flatten().map(|&v| off(output.points[v])).collect();
        let mean = offs.iter().sum::<f64>() / offs.len() as f64;
        let most = offs.iter().fold(0.0, |a: f64, &b| a.max(b));
        println!("{ratio} {cells}: {} border edges, {mean:.4} mean, {most:.4} at most, edge {edge:.3}", list.len());
        assert!(mean < 0.1 && most < 0.3, "{ratio} {cells}: {mean} {most}");
        let report = std::fs::read_to_string(folder.join("r.json")).unwrap();
        let report: serde_json::Value = serde_json::from_str(&report).unwrap();
        for i in 0..4 {
            assert_eq!(report["face_properties"][i]["carried"], "region");
        }
    }
}
