//! Walls between regions (`left` and `right`): regions that are closed stay closed, however walls are wound and sheets touch.

use crate::common::{check, expect, run};
use std::collections::BTreeMap;
use std::path::Path;
use stonecut::io::ply::{FaceBlock, MeshSource, VertexBlock};

/// Writes the walls of voxels, each square with its normal along its axis, or the outside in front and the lesser region behind.
///
/// ```text
///    +---+---+      a wall between two voxels of different labels;
///    | 1 > 2 |      voxels of one label may touch along an edge:
///    +-v-+-v-+      then four walls between the same two regions meet there
///    | 2 > 1 |
///    +---+---+
/// ```
fn write_voxels(path: &Path, n: usize, in_order: bool, label: impl Fn([usize; 3]) -> u32) {
    let label = |at: [usize; 3]| match at.iter().all(|&x| (1..=n).contains(&x)) {
        true => label(at),
        false => 0,
    };
    let m = n + 2;
    let vertex = |[x, y, z]: [usize; 3]| (x * m + y) * m + z;
    let (mut text, mut n_faces) = (String::new(), 0);
    for i in 0..m * m * m {
        let at = [i / m / m, i / m % m, i % m];
        for axis in (0..3).filter(|&axis| at[axis] + 1 < m) {
            let step = |mut at: [usize; 3], axis: usize| {
                at[axis] += 1;
                at
            };
            let first = step(at, axis);
            let (mut left, mut right) = (label(at), label(first));
            if left == right {
                continue;
            }
            let along = step(first, (axis + 1) % 3);
            let far = step(along, (axis + 2) % 3);
            let [a, b, c, d] = [first, along, far, step(first, (axis + 2) % 3)].map(vertex);
            let mut halves = [[a, b, c], [a, c, d]];
            if in_order && right != 0 && (left == 0 || right < left) {
                halves.iter_mut().for_each(|half| half.swap(1, 2));
                (left, right) = (right, left);
            }
            for [a, b, c] in halves {
                text += &format!("3 {a} {b} {c} {left} {right}\n");
            }
            n_faces += 2;
        }
    }
    let mut file = format!("ply\nformat ascii 1.0\nelement vertex {}\n", m * m * m);
    file += "property float x\nproperty float y\nproperty float z\n";
    file += &format!("element face {n_faces}\nproperty list uchar int vertex_indices\n");
    file += "property uint left\nproperty uint right\nend_header\n";
    (0..m * m * m).for_each(|i| file += &format!("{} {} {}\n", i / m / m, i / m % m, i % m));
    std::fs::write(path, file + &text).unwrap();
}

/// Edges at which regions are open, and the volume of the largest one.
fn open_edges(folder: &Path, file: &str) -> (u64, f64) {
    let found = &check(folder, file)["regions"];
    (found["open_edges"].as_u64().unwrap(), found["largest"][0]["volume"].as_f64().unwrap())
}

#[test]
fn walls_that_are_wound_both_ways_come_out_as_if_they_were_wound_alike() {
    let folder = tempfile::tempdir().unwrap();
    // A ball in a box, whose parts on either side of a plane are regions.
    let n = 12;
    let label = |at: [usize; 3]| {
        let far: i64 = at.iter().map(|&x| (2 * x as i64 - n as i64 - 1).pow(2)).sum();
        if far > 81 { 1 } else { 2 + u32::from(at[0] > n / 2) }
    };
    write_voxels(&folder.path().join("both.ply"), n, false, label);
    write_voxels(&folder.path().join("alike.ply"), n, true, label);
    let (none, before) = open_edges(folder.path(), "both.ply");
    assert_eq!(none, 0);
    for options in ["--ratio 30%", "--ratio 30% --cell-triangles 1k"] {
        for name in ["both", "alike"] {
            expect(
                folder.path(),
                &format!("simplify {name}.ply {name}_o.ply {options} --force"),
                0,
            );
        }
        let (open, volume) = open_edges(folder.path(), "both_o.ply");
        assert_eq!(open, 0, "{options}");
        assert!((volume / before - 1.0).abs() < 0.01, "{options}: {volume} of {before}");
        let bytes = |name| std::fs::read(folder.path().join(name)).unwrap();
        assert!(bytes("both_o.ply") == bytes("alike_o.ply"), "{options}");
    }
}

#[test]
fn regions_that_lose_their_volume_end_with_exit_code_3() {
    let folder = tempfile::tempdir().unwrap();
    // The eighths of a ball, for which a few triangles each cannot stand.
    let n = 16;
    let label = |at: [usize; 3]| {
        let far: i64 = at.iter().map(|&x| (2 * x as i64 - n as i64 - 1).pow(2)).sum();
        let half = |k: usize| u32::from(at[k] > n / 2);
        u32::from(far <= 256) * (1 + half(0) + 2 * half(1) + 4 * half(2))
    };
    write_voxels(&folder.path().join("in.ply"), n, true, label);
    assert_eq!(open_edges(folder.path(), "in.ply").0, 0);
    for (share, is_off) in [(50, false), (2, true)] {
        let words = format!("simplify in.ply o.ply --ratio {share}% --force --report r.json");
        let code = run(folder.path(), &words).status.code();
        let report = std::fs::read(folder.path().join("r.json")).unwrap();
        let report: serde_json::Value = serde_json::from_slice(&report).unwrap();
        assert_eq!(report["regions_off_volume"].as_u64().is_some(), is_off, "{share} %");
        assert!(code == Some(if is_off { 3 } else { 0 }), "{share} %: {code:?}");
    }
}

#[test]
fn regions_that_touch_themselves_along_edges_stay_closed() {
    let folder = tempfile::tempdir().unwrap();
    // Two voxels of region 2 within region 1 that touch along an edge; then three labels at random.
    let pair = |at: [usize; 3]| 1 + u32::from(at == [3, 3, 3] || at == [4, 4, 3]);
    let noise = |[x, y, z]: [usize; 3]| {
        let mixed = (x * 73 + y * 179 + z * 283).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        1 + (mixed >> 40) as u32 % 3
    };
    write_voxels(&folder.path().join("pair.ply"), 6, true, pair);
    write_voxels(&folder.path().join("noise.ply"), 6, true, noise);
    for name in ["pair", "noise"] {
        let (none, _) = open_edges(folder.path(), &format!("{name}.ply"));
        assert_eq!(none, 0);
        for share in [90, 30] {
            let words = format!("simplify {name}.ply o.ply --ratio {share}% --force");
            let code = run(folder.path(), &words).status.code();
            // Noise leaves little that may collapse.
            assert!(code == Some(0) || name == "noise" && code == Some(3), "{name}: {code:?}");
            assert_eq!(open_edges(folder.path(), "o.ply").0, 0, "{name} to {share} %");
        }
    }
}

/// Writes eight boxes of n by n by n squares each that fill a bent cube; each has all of its six sides.
///
/// ```text
///    +---+---+
///    | 3 | 4 |      between two of them there are two copies of a wall, on the same vertices;
///    +---+---+      six or eight triangles meet along the edges within
///    | 1 | 2 |
///    +---+---+
/// ```
fn write_boxes(path: &Path, n: usize) {
    let m = 2 * n + 1;
    let vertex = |[x, y, z]: [usize; 3]| (x * m + y) * m + z;
    let (mut text, mut n_faces) = (String::new(), 0);
    for part in 0..8 {
        let first = [part & 1, part >> 1 & 1, part >> 2].map(|k| k * n);
        for (axis, far) in [(0, 0), (0, n), (1, 0), (1, n), (2, 0), (2, n)] {
            for k in 0..n * n {
                let at = |i: usize, j: usize| {
                    let mut at = first;
                    at[axis] += far;
                    at[(axis + 1) % 3] += k / n + i;
                    at[(axis + 2) % 3] += k % n + j;
                    vertex(at)
                };
                let [a, b, c, d] = [at(0, 0), at(1, 0), at(1, 1), at(0, 1)];
                for [a, b, c] in [[a, b, c], [a, c, d]] {
                    let [b, c] = if far == 0 { [c, b] } else { [b, c] };
                    text += &format!("3 {a} {b} {c}\n");
                    n_faces += 1;
                }
            }
        }
    }
    let mut file = format!("ply\nformat ascii 1.0\nelement vertex {}\n", m * m * m);
    file += "property double x\nproperty double y\nproperty double z\n";
    file +=
        &format!("element face {n_faces}\nproperty list uchar int vertex_indices\nend_header\n");
    for i in 0..m * m * m {
        let [x, y, z] = [i / m / m, i / m % m, i % m].map(|x| x as f64 / n as f64);
        file += &format!("{} {y} {}\n", x + 0.1 * (2.0 * y).sin(), z + 0.1 * (2.0 * x).sin());
    }
    std::fs::write(path, file + &text).unwrap();
}

/// Edges along which more triangles run one way than the other, and the volume.
fn open_and_volume(path: &Path) -> (usize, f64) {
    let source = MeshSource::open(path).unwrap();
    let schema = source.schema();
    let (mut vertices, mut faces) = (VertexBlock::default(), FaceBlock::default());
    source.read_vertices(0, &mut vertices).unwrap();
    source.read_faces(0, &mut faces).unwrap();
    let records = vertices.records.chunks_exact(schema.record_bytes());
    let places: Vec<[f64; 3]> = records.map(|record| schema.position(record)).collect();
    let (mut edges, mut volume) = (BTreeMap::new(), 0.0);
    for t in &faces.triangles {
        let [a, b, c] = t.map(|v| places[v as usize]);
        for [p, q] in [[a, b], [b, c], [c, a]] {
            let [p, q] = [p, q].map(|p| p.map(f64::to_bits));
            *edges.entry([p.min(q), p.max(q)]).or_insert(0) += if p < q { 1 } else { -1 };
        }
        let [x, y, z] =
            [0, 1, 2].map(|k| b[(k + 1) % 3] * c[(k + 2) % 3] - b[(k + 2) % 3] * c[(k + 1) % 3]);
        volume += (a[0] * x + a[1] * y + a[2] * z) / 6.0;
    }
    (edges.values().filter(|n| **n != 0).count(), volume)
}

#[test]
fn bodies_with_a_copy_each_of_a_wall_stay_closed_through_cells() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    write_boxes(&path("in.ply"), 12);
    let (open, before) = open_and_volume(&path("in.ply"));
    assert_eq!(open, 0);
    for options in [
        "50%",
        "10%",
        "50% --cell-triangles 1k",
        "20% --cell-triangles 1k",
        "10% --cell-triangles 2k",
    ] {
        expect(folder.path(), &format!("simplify in.ply o.ply --ratio {options} --force"), 0);
        let (open, volume) = open_and_volume(&path("o.ply"));
        assert_eq!(open, 0, "{options}");
        assert!((volume / before - 1.0).abs() < 0.01, "{options}: {volume} of {before}");
    }
}
