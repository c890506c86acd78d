//! Borders of files that become one mesh: copies near by, T-junctions, overlaps.

use crate::common::{expect, scratch};
use crate::inputs::{assert_a_copy_is_taken_once, assert_closed, info};
use serde_json::Value;
use std::path::Path;

/// A vertex of one tile that lies on an edge of the next one splits that edge.
#[test]
fn t_junctions_between_files_are_closed() {
    let at = &scratch();
    for (kind, format) in [("statue", "obj"), ("statue", "glb"), ("terrain", "ply")] {
        let words = format!(
            "synth {kind} tiles --triangles 6000 --tiles 8 --format {format} --round 4 --t-junctions --force"
        );
        expect(at, &words, 0);
        expect(at, &format!("synth {kind} whole.ply --triangles 6000 --force"), 0);
        let (found, whole) = (info(at, "tiles --check"), info(at, "whole.ply --check"));
        let parts = found["inputs"].as_array().unwrap().iter();
        let in_parts: u64 = parts.map(|part| part["triangles"].as_u64().unwrap()).sum();
        let count = |mesh: &Value, key: &str| mesh[key].as_u64().unwrap();
        let n_split = in_parts - count(&whole, "triangles");
        let n_closed = count(&found, "triangles") - in_parts;
        assert!(n_closed > 20, "{words}: {found}");
        // Edges on the outer border are split, too, and stay open.
        let n_open = count(&whole, "boundary_edges") + n_split - n_closed;
        assert_eq!(count(&found, "boundary_edges"), n_open, "{words}: {found}");
        assert_eq!(found["components"], whole["components"], "{words}");
        assert_eq!(count(&found, "non_manifold_edges"), 0, "{words}");
        let said = expect(at, "convert tiles joined.ply --force", 0);
        assert!(said.contains("were split where vertices of another file lie"), "{said}");
        std::fs::remove_dir_all(at.join("tiles")).unwrap();
    }
    // Two squares; the right one has a vertex on the edge of the left one.
    let left = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3\nf 1 3 4\n";
    let right = "v 1 0 0\nv 1 0.25 0\nv 1 1 0\nv 2 0 0\nf 1 4 2\nf 2 4 3\n";
    std::fs::write(at.join("a.obj"), left).unwrap();
    std::fs::write(at.join("b.obj"), right).unwrap();
    expect(at, "convert a.obj b.obj out.obj", 0);
    let found = info(at, "out.obj --check");
    assert_eq!((found["triangles"].as_u64(), found["boundary_edges"].as_u64()), (Some(5), Some(5)));
}

/// Tiles that reach into each other hold the same triangles twice, each rounded by its own rule.
#[test]
fn files_that_overlap_hold_each_triangle_once() {
    let at = &scratch();
    expect(at, "synth statue whole.ply --triangles 6000", 0);
    let n_triangles = info(at, "whole.ply --check")["triangles"].as_u64().unwrap();
    for format in ["obj", "glb"] {
        let words = format!(
            "synth statue tiles --triangles 6000 --tiles 8 --format {format} --round 4 --overlap 4%"
        );
        expect(at, &words, 0);
        let said = expect(at, "convert tiles joined.ply --force", 0);
        assert!(said.contains("that several hold were taken once"), "{said}");
        assert_closed(&info(at, "joined.ply --check"), n_triangles, &words);
        assert_a_copy_is_taken_once(at, format, n_triangles, &words);
        std::fs::remove_dir_all(at.join("tiles")).unwrap();
    }
}

/// Writes four tiles of two sheets each, one below the other, whose squares of 0.156 have exact copies at common borders.
fn sheets(folder: &Path, below: f64) {
    const N: usize = 16;
    std::fs::create_dir_all(folder).unwrap();
    for tile in 0..4 {
        let (mut text, mut n) = (String::new(), 0);
        for sheet in [0.0, below] {
            for i in 0..(N + 1) * (N + 1) {
                let (x, y) = (i % (N + 1) + tile % 2 * N, i / (N + 1) + tile / 2 * N);
                let z = 0.3 * (x as f64 * 0.3).sin() * (y as f64 * 0.2).cos() - sheet;
                text +=
                    &format!("v {:.6} {:.6} {z:.6}\n", x as f64 * 0.156_25, y as f64 * 0.156_25);
            }
            for i in 0..N * N {
                let a = n + i / N * (N + 1) + i % N + 1;
                let (b, c, d) = (a + 1, a + N + 1, a + N + 2);
                text += &format!("f {a} {b} {d}\nf {a} {d} {c}\n");
            }
            n += (N + 1) * (N + 1);
        }
        std::fs::write(folder.join(format!("t_{tile}.obj")), text).unwrap();
    }
}

#[test]
fn what_is_near_within_a_file_is_another_place() {
    let at = &scratch();
    for below in ["0.004", "0.01"] {
        sheets(&at.join("tiles"), below.parse().unwrap());
        let found = info(at, "tiles --check");
        let count = |key: &str| found[key].as_u64().unwrap();
        let counts = ["components", "non_manifold_edges", "boundary_edges"].map(count);
        assert_eq!(counts, [2, 0, 2 * 128], "{below}: {found}");
    }
}

/// Equal vertices round equally, and say nothing of those that lie on edges.
#[test]
fn rounded_vertices_split_the_edges_that_they_were_on() {
    let at = &scratch();
    // Two strips along a line aslant; one has a vertex in the middle of each edge of the other.
    let place = |t: f64, off: f64| [0.7 * t - 0.3 * off, 0.4 * t + 0.9 * off, 0.13 * t];
    for (digits, name) in [(3, "a"), (4, "b"), (6, "c")] {
        for (side, n) in [(1.0, 8), (-1.0, 16)] {
            let mut text = String::new();
            for i in 0..=n {
                for off in [0.0, side] {
                    let [x, y, z] = place(f64::from(i) * 2.0 / f64::from(n), off);
                    text += &format!("v {x:.digits$} {y:.digits$} {z:.digits$}\n");
                }
            }
            for i in 0..n {
                let [a, b, c, d] = [1, 2, 3, 4].map(|k| 2 * i + k);
                text += &format!("f {a} {c} {b}\nf {c} {d} {b}\n");
            }
            std::fs::write(at.join(format!("{name}{n}.obj")), text).unwrap();
        }
        let found = info(at, &format!("{name}8.obj {name}16.obj --check"));
        assert_eq!(found["boundary_edges"].as_u64(), Some(8 + 16 + 4), "{name}: {found}");
    }
}

/// A file near the origin is read as floats, one far from it as doubles, which hold other places for the same digits.
#[test]
fn files_of_floats_and_of_doubles_meet() {
    let at = &scratch();
    std::fs::create_dir(at.join("tiles")).unwrap();
    const SIDE: usize = 6;
    for tile in 0..24 {
        let mut text = String::new();
        for i in 0..(SIDE + 1) * (SIDE + 1) {
            let (x, y) = (tile * SIDE + i % (SIDE + 1), i / (SIDE + 1));
            let [x, y] = [x, y].map(|n| n as f64 * 4.997);
            text += &format!("v {x:.3} {y:.3} {:.3}\n", 3.0 * (0.1 * x).sin());
        }
        for i in 0..SIDE * SIDE {
            let a = i / SIDE * (SIDE + 1) + i % SIDE + 1;
            text += &format!("f {a} {} {} {}\n", a + 1, a + SIDE + 2, a + SIDE + 1);
        }
        std::fs::write(at.join(format!("tiles/{tile}.obj")), text).unwrap();
    }
    let found = info(at, "tiles --check");
    let open = 2 * (24 + 1) * SIDE as u64;
    assert_eq!(found["boundary_edges"].as_u64(), Some(open), "{found}");
    assert_eq!(found["components"].as_u64(), Some(1), "{found}");
}

/// All of a file lies in another: the whole beside its tiles, a tile again with its vertices in another order.
#[test]
fn files_that_others_cover_hold_each_triangle_once() {
    let at = &scratch();
    sheets(&at.join("tiles"), 10.0);
    expect(at, "convert tiles whole.obj", 0);
    let n_triangles = info(at, "whole.obj")["triangles"].as_u64();
    let tile = std::fs::read_to_string(at.join("tiles/t_2.obj")).unwrap();
    let n = tile.lines().filter(|line| line.starts_with('v')).count();
    let (vertices, faces): (Vec<&str>, Vec<&str>) =
        tile.lines().partition(|line| line.starts_with('v'));
    let again =
        vertices.into_iter().rev().map(str::to_owned).chain(faces.into_iter().map(|face| {
            let corners =
                face.split(' ').skip(1).map(|v| (n + 1 - v.parse::<usize>().unwrap()).to_string());
            format!("f {}", corners.collect::<Vec<_>>().join(" "))
        }));
    let again = again.collect::<Vec<_>>().join("\n");
    for (name, text) in
        [("whole", std::fs::read_to_string(at.join("whole.obj")).unwrap()), ("again", again)]
    {
        std::fs::write(at.join("tiles/more.obj"), text).unwrap();
        let found = info(at, "tiles --check");
        assert_eq!(found["triangles"].as_u64(), n_triangles, "{name}: {found}");
        assert_eq!(found["boundary_edges"].as_u64(), Some(2 * 128), "{name}: {found}");
        let said = expect(at, "convert tiles out.obj --force", 0);
        assert!(said.contains("that several hold were taken once"), "{name}: {said}");
    }
}

/// Files that overlap by a strip, each with triangles where the other has none, have no vertex in common.
#[test]
fn files_that_overlap_with_other_triangles_are_named() {
    let at = &scratch();
    for (name, shift) in [("a", 0.0), ("b", 4.3)] {
        let mut text = String::new();
        for i in 0..36 {
            text +=
                &format!("v {} {} 0\n", f64::from(i % 6) + shift, f64::from(i / 6) + 0.07 * shift);
        }
        for i in (0..30).filter(|i| i % 6 < 5) {
            text += &format!("f {} {} {} {}\n", i + 1, i + 2, i + 8, i + 7);
        }
        std::fs::write(at.join(format!("{name}.obj")), text).unwrap();
    }
    let said = expect(at, "convert a.obj b.obj out.obj", 0);
    assert!(said.contains("may overlap with different triangles"), "{said}");
}
