//! Walls between regions (`left` and `right`): regions that are closed stay closed, however walls are wound and sheets touch.

use crate::common::{check, expect, run};
use std::path::Path;

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
