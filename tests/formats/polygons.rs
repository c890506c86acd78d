//! Polygons of more than three corners: their area, their corners, their borders, in every format that has them.

use std::collections::BTreeMap;
use stonecut::io::StageOptions;
use stonecut::io::ply::{FaceBlock, MeshSource, VertexBlock};
use stonecut::mesh::vec3::{length_sq, normal};

type Point = [f64; 3];

/// Places of the corners of all triangles, and how many polygons cross themselves.
fn triangles(name: &str, bytes: &[u8]) -> (Vec<[Point; 3]>, u64) {
    let options = StageOptions::new(std::env::temp_dir());
    let source = MeshSource::staged_from_bytes(name, bytes.to_vec(), &options).unwrap();
    let (mut vertices, mut faces) = (VertexBlock::default(), FaceBlock::default());
    let schema = source.schema();
    source.read_vertices(0, &mut vertices).unwrap();
    let records = vertices.records.chunks_exact(schema.record_bytes());
    let places: Vec<Point> = records.map(|r| schema.position(r)).collect();
    source.read_faces(0, &mut faces).unwrap();
    let place = |t: &[u64; 3]| t.map(|v| places[v as usize]);
    let n_crossing = source.n_crossing_polygons().unwrap();
    (faces.triangles.iter().map(place).collect(), n_crossing)
}

fn area(triangles: &[[Point; 3]]) -> f64 {
    let one = |corners: &[Point; 3]| length_sq(normal(*corners)).sqrt() / 2.0;
    triangles.iter().map(one).sum()
}

/// Edges that only one triangle has.
fn border(triangles: &[[Point; 3]]) -> usize {
    let mut count = BTreeMap::new();
    for t in triangles {
        for k in 0..3 {
            let mut ends = [t[k], t[(k + 1) % 3]].map(|p| p.map(f64::to_bits));
            ends.sort_unstable();
            *count.entry(ends).or_insert(0) += 1;
        }
    }
    assert!(count.values().all(|&n| n <= 2), "no edge lies in three triangles");
    count.values().filter(|&&n| n == 1).count()
}

/// The same polygon as OBJ, as PLY of both kinds with the vertices in front and behind, and as ASCII STL.
fn files(polygon: &[Point]) -> Vec<(&'static str, Vec<u8>)> {
    let n = polygon.len();
    let obj = polygon.iter().map(|[x, y, z]| format!("v {x} {y} {z}\n")).collect::<String>()
        + "f"
        + &(1..=n).map(|i| format!(" {i}")).collect::<String>()
        + "\n";
    let rows: String = polygon.iter().map(|[x, y, z]| format!("{x} {y} {z}\n")).collect();
    let face = format!("{n}{}\n", (0..n).map(|i| format!(" {i}")).collect::<String>());
    let vertex =
        format!("element vertex {n}\nproperty double x\nproperty double y\nproperty double z\n");
    let list = "element face 1\nproperty list uchar int vertex_indices\n";
    let ascii = format!("ply\nformat ascii 1.0\n{vertex}{list}end_header\n{rows}{face}");
    let behind = format!("ply\nformat ascii 1.0\n{list}{vertex}end_header\n{face}{rows}");
    let mut binary =
        format!("ply\nformat binary_little_endian 1.0\n{vertex}{list}end_header\n").into_bytes();
    binary.extend(polygon.iter().flatten().flat_map(|x| x.to_le_bytes()));
    binary.push(n as u8);
    binary.extend((0..n as i32).flat_map(i32::to_le_bytes));
    let corners: String = polygon.iter().map(|[x, y, z]| format!("vertex {x} {y} {z}\n")).collect();
    let stl =
        format!("solid\nfacet normal 0 0 0\nouter loop\n{corners}endloop\nendfacet\nendsolid\n");
    vec![
        ("a.obj", obj.into_bytes()),
        ("a.ply", ascii.into_bytes()),
        ("b.ply", behind.into_bytes()),
        ("c.ply", binary),
        ("a.stl", stl.into_bytes()),
    ]
}

/// Twice the area by the shoelace formula, in the plane z = 0.
fn shoelace(polygon: &[[f64; 2]]) -> f64 {
    let n = polygon.len();
    let each = (0..n).map(|i| {
        let ([a, b], [c, d]) = (polygon[i], polygon[(i + 1) % n]);
        a * d - b * c
    });
    each.sum::<f64>().abs() / 2.0
}

fn star(n: usize, inner: f64) -> Vec<[f64; 2]> {
    let corner = |i: usize| {
        let angle = std::f64::consts::TAU * i as f64 / n as f64;
        let radius = if i.is_multiple_of(2) { 1.0 } else { inner };
        [radius * angle.cos(), radius * angle.sin()]
    };
    (0..n).map(corner).collect()
}

/// Sides in steps, so that many corners lie on straight lines.
fn comb() -> Vec<[f64; 2]> {
    let mut out = Vec::new();
    for i in 0..5 {
        let x = f64::from(2 * i);
        out.extend([[x, 0.0], [x, 3.0], [x + 1.0, 3.0], [x + 1.0, 0.0]]);
    }
    for i in (0..=9).rev() {
        out.push([f64::from(i), -1.0]);
    }
    out
}

/// A square with a square hole, cut open along a bridge that the ring passes twice.
fn keyhole() -> Vec<[f64; 2]> {
    let outer = [[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0], [0.0, 0.0]];
    let inner = [[1.0, 1.0], [1.0, 2.0], [2.0, 2.0], [2.0, 1.0], [1.0, 1.0]];
    [&outer[..], &inner].concat()
}

/// The polygon in another plane.
fn tilted(polygon: &[[f64; 2]]) -> Vec<Point> {
    let u = [0.36, 0.48, -0.8];
    let v = [-0.8, 0.6, 0.0];
    let place = |&[x, y]: &[f64; 2]| {
        [0, 1, 2].map(|k| f64::from(((5.0 + x * u[k] + y * v[k]) * 1e3) as f32) / 1e3)
    };
    polygon.iter().map(place).collect()
}

#[test]
fn simple_polygons_keep_area_and_corners() {
    let spiral: Vec<[f64; 2]> = (0..40)
        .map(|i| (f64::from(i) * 0.3, 1.0 + f64::from(i) * 0.1))
        .chain((0..40).rev().map(|i| (f64::from(i) * 0.3, 0.7 + f64::from(i) * 0.1)))
        .map(|(angle, radius)| [radius * angle.cos(), radius * angle.sin()])
        .collect();
    for (what, polygon) in [
        ("dart", vec![[0.0, 0.0], [1.0, 2.0], [0.0, 0.8], [-1.0, 2.0]]),
        ("dart from its tip", vec![[0.0, 0.8], [-1.0, 2.0], [0.0, 0.0], [1.0, 2.0]]),
        ("corner on a side", vec![[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [0.0, 1.0]]),
        ("star", star(16, 0.3)),
        ("star of many", star(200, 0.9)),
        ("comb", comb()),
        ("keyhole", keyhole()),
        ("spiral", spiral),
        ("L", vec![[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0, 1.0], [1.0, 2.0], [0.0, 2.0]]),
    ] {
        let expected = shoelace(&polygon);
        let flat: Vec<Point> = polygon.iter().map(|&[x, y]| [x, y, 0.0]).collect();
        let mirrored: Vec<Point> = flat.iter().rev().copied().collect();
        for (plane, polygon, precision) in
            [("flat", flat, 1e-6), ("mirrored", mirrored, 1e-6), ("tilted", tilted(&polygon), 1e-5)]
        {
            for (name, bytes) in files(&polygon) {
                let (found, n_crossing) = triangles(name, &bytes);
                let place = format!("{what}, {plane}, {name}");
                assert!(
                    (area(&found) - expected).abs() < precision * expected,
                    "{place}: {}",
                    area(&found)
                );
                assert_eq!(n_crossing, 0, "{place}");
                // A ring that passes a bridge twice has four more corners than its triangles have border.
                let n_bridge = if what == "keyhole" { 2 } else { 0 };
                assert_eq!(found.len(), polygon.len() - 2, "{place}");
                assert_eq!(border(&found), polygon.len() - n_bridge, "{place}");
            }
        }
    }
}

/// Both diagonals inside: the shorter one; equal ones: the first.
#[test]
fn convex_polygons_are_cut_as_before() {
    let (found, _) = triangles("a.obj", b"v 0 0 0\nv 3 0 0\nv 2 1 0\nv 0 1 0\nf 1 2 3 4\n");
    assert_eq!(found[0][2], [2.0, 1.0, 0.0]);
    let hexagon: Vec<Point> = star(6, 1.0).iter().map(|&[x, y]| [x, y, 0.0]).collect();
    let (found, _) = triangles("c.ply", &files(&hexagon)[3].1);
    assert_eq!(found, [1, 2, 3, 4].map(|i| [hexagon[0], hexagon[i], hexagon[i + 1]]));
}

#[test]
fn polygons_that_cross_themselves_are_counted() {
    let bowtie = vec![[0.0, 0.0, 0.0], [1.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    let pentagram: Vec<Point> = (0..5)
        .map(|i| f64::from(2 * i) * std::f64::consts::TAU / 5.0)
        .map(|angle| [angle.cos(), angle.sin(), 1.0])
        .collect();
    for polygon in [bowtie, pentagram] {
        for (name, bytes) in files(&polygon).into_iter().filter(|(name, _)| *name != "a.stl") {
            assert_eq!(triangles(name, &bytes).1, 1, "{name}");
        }
    }
    let folder = tempfile::tempdir().unwrap();
    let text = "v 0 0 0\nv 1 1 0\nv 1 0 0\nv 0 1 0\nf 1 2 3 4\n";
    std::fs::write(folder.path().join("in.obj"), text).unwrap();
    let said = crate::common::expect(folder.path(), "convert in.obj out.ply", 0);
    assert!(said.contains("1 polygons cross themselves"), "{said}");
}

/// A face with a material, of more corners than a byte counts.
#[test]
fn faces_of_many_corners_keep_their_material() {
    let folder = tempfile::tempdir().unwrap();
    let ring = star(400, 0.8);
    let mut text = String::from("mtllib in.mtl\n");
    text.extend(ring.iter().map(|[x, y]| format!("v {x} {y} 0\nvt {x} {y}\n")));
    text += "usemtl wood\nf";
    text.extend((1..=400).map(|i| format!(" {i}/{i}")));
    text += "\nv 9 0 0\nv 9 1 0\nv 8 0 1\nusemtl plain\nf 401 402 403\n";
    std::fs::write(folder.path().join("in.obj"), text).unwrap();
    std::fs::write(folder.path().join("in.mtl"), "newmtl wood\nnewmtl plain\n").unwrap();
    crate::common::expect(folder.path(), "simplify in.obj out.ply --ratio 100%", 0);
    let source = MeshSource::open(&folder.path().join("out.ply")).unwrap();
    assert_eq!(source.n_triangles(), 399);
}
