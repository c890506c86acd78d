//! Vertices that stay bit for bit: boundaries, and those with a property.

use crate::common::{expect, scratch};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use stonecut::io::ply::{FaceBlock, MeshSource, VertexBlock};

/// Squares on a side of the sheet.
const N: u32 = 60;

/// A bumpy sheet with a property `keep` of the given type, 3 on every eleventh vertex.
fn write_sheet(path: &Path, kind: &str) {
    let m = N + 1;
    let mut text = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty double x\nproperty double y\nproperty double z\n\
         property {kind} keep\nelement face {}\nproperty list uchar int vertex_indices\nend_header\n",
        m * m,
        2 * N * N
    );
    for i in 0..m * m {
        let (x, y) = (f64::from(i % m) / 3.0, f64::from(i / m) / 7.0);
        let z = (x * 1.3).sin() * (y * 2.1).cos() + 0.01 * (x * 17.0).sin();
        text += &format!("{x} {y} {z} {}\n", if i % 11 == 0 { 3 } else { 0 });
    }
    for i in 0..N * N {
        let a = i / N * m + i % N;
        let (b, c, d) = (a + 1, a + m, a + m + 1);
        text += &format!("3 {a} {b} {d}\n3 {a} {d} {c}\n");
    }
    std::fs::write(path, text).unwrap();
}

/// Position bits of a vertex.
type Place = [u64; 3];

/// All places, and the edges of one triangle.
fn places(path: &Path) -> (BTreeSet<Place>, BTreeSet<[Place; 2]>) {
    let source = MeshSource::open(path).unwrap();
    let schema = source.schema();
    let (mut vertices, mut faces) = (VertexBlock::default(), FaceBlock::default());
    source.read_vertices(0, &mut vertices).unwrap();
    let records = vertices.records.chunks_exact(schema.record_bytes());
    let places: Vec<Place> =
        records.map(|record| schema.position(record).map(f64::to_bits)).collect();
    source.read_faces(0, &mut faces).unwrap();
    let mut edges: BTreeMap<[Place; 2], u32> = BTreeMap::new();
    for &[a, b, c] in &faces.triangles {
        for (p, q) in [(a, b), (b, c), (c, a)] {
            let mut edge = [places[p as usize], places[q as usize]];
            edge.sort_unstable();
            *edges.entry(edge).or_default() += 1;
        }
    }
    let open = edges.into_iter().filter(|(_, n)| *n == 1).map(|(edge, _)| edge).collect();
    (places.into_iter().collect(), open)
}

#[test]
fn a_locked_boundary_stays_bit_for_bit_through_cells_and_rounds() {
    let at = &scratch();
    write_sheet(&at.join("in.ply"), "float");
    for options in ["", " --cell-triangles 1k", " --max-error 0.1"] {
        let target = if options.contains("error") { "" } else { "--ratio 15%" };
        let command = format!("simplify in.ply out.ply {target} --lock boundary --force{options}");
        expect(at, &command, 0);
        let (before, after) = (places(&at.join("in.ply")), places(&at.join("out.ply")));
        assert_eq!(before.1, after.1, "{command}");
        assert!(after.0.len() < before.0.len() / 2, "{command}");
        let header = std::fs::read(at.join("out.ply")).unwrap();
        let header = String::from_utf8_lossy(&header[..600]).into_owned();
        assert!(!header.contains("stonecut_lock"), "{header}");
    }
}

#[test]
fn vertices_with_a_property_stay_whatever_its_type() {
    for kind in ["float", "int", "uchar"] {
        let at = &scratch();
        write_sheet(&at.join("in.ply"), kind);
        let m = N + 1;
        let input = MeshSource::open(&at.join("in.ply")).unwrap();
        let mut vertices = VertexBlock::default();
        input.read_vertices(0, &mut vertices).unwrap();
        let bytes = input.schema().record_bytes();
        let kept: Vec<Place> = (0..m * m)
            .filter(|i| i % 11 == 0)
            .map(|i| {
                let record = &vertices.records[i as usize * bytes..][..bytes];
                input.schema().position(record).map(f64::to_bits)
            })
            .collect();
        expect(at, "simplify in.ply out.ply --ratio 30% --lock keep --cell-triangles 1k", 0);
        let (after, _) = places(&at.join("out.ply"));
        assert!(kept.iter().all(|place| after.contains(place)), "{kind}");
        assert!(after.len() < (m * m) as usize / 2, "{kind}: {}", after.len());
    }
}

#[test]
fn a_count_that_locked_vertices_do_not_allow_is_said_with_one_that_they_do() {
    let at = &scratch();
    write_sheet(&at.join("in.ply"), "uchar");
    let said = expect(at, "simplify in.ply out.ply --ratio 3% --lock keep", 3);
    let line = said.lines().find(|line| line.contains("short of the target of 216")).unwrap();
    let words = line.split_once("--lock keep leaves room for no fewer than ").unwrap().1;
    let sensible: usize = words.split(' ').next().unwrap().parse().unwrap();
    assert!((600..2_000).contains(&sensible), "{line}");
}

#[test]
fn locks_that_cannot_be_kept_are_refused() {
    let at = &scratch();
    write_sheet(&at.join("in.ply"), "int");
    for method in
        ["--method cluster", "--method decimate", "--method retile", "--pairs", "--optimize 1"]
    {
        let said =
            expect(at, &format!("simplify in.ply o.ply --ratio 20% --lock boundary {method}"), 2);
        assert!(said.contains("--lock"), "{method}: {said}");
    }
    let said = expect(at, "simplify in.ply o.ply --ratio 20% --lock border", 2);
    assert!(said.contains("--lock border") && said.contains("keep"), "{said}");
}
