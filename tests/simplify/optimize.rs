//! `simplify --optimize` end to end: the count, the error, boundaries, topology, attributes, bytes, refusals.

use crate::common::meshes::{ply_text, sheet_triangles};
use crate::common::{check, count, expect, report, rms, scratch};
use std::collections::BTreeSet;
use std::path::Path;

const FAULTS: [&str; 4] =
    ["degenerate_triangles", "duplicate_triangles", "non_manifold_edges", "inconsistent_edges"];

#[test]
fn the_error_falls_at_the_same_count_and_topology() {
    let at = &scratch();
    for kind in ["statue", "terrain"] {
        expect(at, &format!("synth {kind} in.ply --triangles 30k --force"), 0);
        for target in [3_000, 300] {
            let options = format!("in.ply before.ply --triangles {target} --fit on --force");
            expect(at, &format!("simplify {options}"), 0);
            let options = format!("--triangles {target} --optimize 2 --force --report r.json");
            expect(at, &format!("simplify in.ply out.ply {options}"), 0);
            let (before, after) = (check(at, "before.ply"), check(at, "out.ply"));
            for same in ["triangles", "vertices", "boundary_edges", "euler_characteristic"] {
                assert_eq!(before[same], after[same], "{kind} at {target}: {same}");
            }
            for fault in FAULTS {
                assert_eq!(count(&after, fault), 0, "{kind} at {target}: {fault}");
            }
            let [was, is] = ["before.ply", "out.ply"].map(|file| rms(at, "in.ply", file));
            assert!(is < 0.98 * was, "{kind} at {target}: {was} to {is}");
            let done = report(at)["optimization"].clone();
            assert_eq!(done["collapses"], done["splits"], "{done}");
            assert_eq!(done["sweeps"], 2, "{done}");
            assert!(done["relocations"].as_u64().unwrap() > target / 4, "{done}");
            let [before, after] =
                ["rms_before", "rms_after"].map(|key| done[key].as_f64().unwrap());
            assert!(after < before, "{done}");
        }
    }
}

/// Positions of vertices on open edges, as bits.
fn rim(path: &Path) -> BTreeSet<[u32; 3]> {
    let (positions, triangles) = mesh(path);
    let edges = |t: &[usize; 3]| [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]];
    let all: BTreeSet<[usize; 2]> = triangles.iter().flat_map(edges).collect();
    let open = all.iter().filter(|[a, b]| !all.contains(&[*b, *a]));
    open.flatten().map(|&v| positions[v].map(f32::to_bits)).collect()
}

/// Positions and triangles of an ASCII PLY.
fn mesh(path: &Path) -> (Vec<[f32; 3]>, Vec<[usize; 3]>) {
    let text = std::fs::read_to_string(path).unwrap();
    let (head, body) = text.split_once("end_header\n").unwrap();
    let n = |element: &str| -> usize {
        let line = head.lines().find_map(|line| line.strip_prefix(&format!("element {element} ")));
        line.unwrap().parse().unwrap()
    };
    let mut lines = body.lines().map(|line| line.split_whitespace());
    let positions = lines
        .by_ref()
        .take(n("vertex"))
        .map(|mut words| std::array::from_fn(|_| words.next().unwrap().parse().unwrap()));
    let positions = positions.collect();
    let triangles = lines.take(n("face")).map(|words| {
        let mut words = words.skip(1);
        std::array::from_fn(|_| words.next().unwrap().parse().unwrap())
    });
    (positions, triangles.collect())
}

#[test]
fn boundaries_keep_their_places() {
    let at = &scratch();
    expect(at, "synth terrain in.ply --triangles 30k", 0);
    let simplify = "simplify in.ply out.ply --triangles 2k --force --format ascii --fit on";
    expect(at, simplify, 0);
    let before = rim(&at.join("out.ply"));
    expect(at, &format!("{simplify} --optimize 3"), 0);
    assert!(before.len() > 50 && rim(&at.join("out.ply")) == before);
}

#[test]
fn threads_memory_and_an_earlier_run_do_not_show() {
    let at = &scratch();
    expect(at, "synth statue in.ply --triangles 40k", 0);
    let options = "--triangles 3k --optimize 1 --cell-triangles 8k --force";
    expect(at, &format!("simplify in.ply out.ply {options} --threads 1"), 0);
    let wanted = std::fs::read(at.join("out.ply")).unwrap();
    for more in ["--threads 3", "--threads 2 --memory 256MiB", "--keep-temp"] {
        std::fs::remove_file(at.join("out.ply")).unwrap();
        expect(at, &format!("simplify in.ply out.ply {options} {more}"), 0);
        assert!(std::fs::read(at.join("out.ply")).unwrap() == wanted, "{more}");
    }
    // The job folder has the result of before the optimisation, and the same command goes on with it.
    std::fs::remove_file(at.join("out.ply")).unwrap();
    expect(at, &format!("simplify in.ply out.ply {options}"), 0);
    assert!(std::fs::read(at.join("out.ply")).unwrap() == wanted);
    assert!(!at.join("out.ply.stonecut-job").exists());
}

#[test]
fn results_of_every_method_are_optimised() {
    let at = &scratch();
    expect(at, "synth statue in.ply --triangles 20k", 0);
    for method in ["cluster", "decimate", "retile"] {
        let simplify =
            format!("simplify in.ply out.ply --method {method} --triangles 1500 --force");
        expect(at, &simplify, 0);
        let (was, before) = (rms(at, "in.ply", "out.ply"), check(at, "out.ply"));
        expect(at, &format!("{simplify} --optimize 2 --report r.json --verify"), 0);
        let (is, after) = (rms(at, "in.ply", "out.ply"), check(at, "out.ply"));
        assert!(is < 0.85 * was, "{method}: {was} to {is}");
        for same in ["triangles", "boundary_edges", "non_manifold_edges"] {
            assert_eq!(before[same], after[same], "{method}: {same}");
        }
        assert_eq!(report(at)["method"], method);
        assert!(report(at)["measured"]["rms"].as_f64().unwrap() > 0.0);
    }
}

/// A plane with a colour that follows its place, labels in halves, and normals.
#[test]
fn what_vertices_carry_follows_them() {
    let at = &scratch();
    let n = 60u32;
    let rows = (0..(n + 1) * (n + 1)).map(|v| {
        let (x, y) = (v % (n + 1), v / (n + 1));
        let z = (f64::from(x) * 0.3).sin() * (f64::from(y) * 0.2).cos() * 3.0;
        format!("{x} {y} {z} {} {} 7 {}", 4 * x, 4 * y, i32::from(x > n / 2))
    });
    let rows = rows.collect::<Vec<_>>().into_iter();
    let properties = "uchar red, uchar green, uchar blue, int part";
    let text = ply_text(properties, rows, &sheet_triangles(n as usize));
    std::fs::write(at.join("in.ply"), text).unwrap();
    expect(at, "simplify in.ply out.ply --ratio 8% --optimize 2 --format ascii", 0);
    let text = std::fs::read_to_string(at.join("out.ply")).unwrap();
    let (head, body) = text.split_once("end_header\n").unwrap();
    let n_vertices = head.lines().find_map(|line| line.strip_prefix("element vertex ")).unwrap();
    for line in body.lines().take(n_vertices.parse().unwrap()) {
        let row: Vec<f64> = line.split_whitespace().map(|word| word.parse().unwrap()).collect();
        let [x, y, _, red, green, blue, part] = row[..] else { panic!("{line}") };
        assert!((red - 4.0 * x).abs() < 16.0 && (green - 4.0 * y).abs() < 16.0, "{line}");
        assert!(blue == 7.0 && (part == f64::from(x > 30.0) || (x - 30.0).abs() < 6.0), "{line}");
    }
}

#[test]
fn what_does_not_go_with_it_is_refused_before_any_work() {
    let at = &scratch();
    expect(at, "synth statue in.ply --triangles 40k", 0);
    for (options, word) in [
        ("--triangles 9k --max-error 0.1", "--max-error"),
        ("--max-error 0.1", "--max-error"),
        ("--ratio 10%,1%", "a list of targets"),
        ("--ratio 10% --until stitch", "--until"),
        ("--ratio 10% --progressive out.pm", "--progressive"),
        ("--ratio 10% --placement subset", "--placement subset"),
        ("--ratio 10% --texture bake", "--texture bake"),
    ] {
        let said = expect(at, &format!("simplify in.ply out.ply --optimize 1 {options}"), 2);
        assert!(said.contains(word), "{options}: {said}");
    }
    expect(at, "synth statue large.ply --triangles 400k", 0);
    let options = "--ratio 50% --optimize 1 --memory 300MiB";
    let said = expect(at, &format!("simplify large.ply out.ply {options}"), 6);
    assert!(said.contains("too small for --optimize") && said.contains("--memory"), "{said}");
    // Texture coordinates at corners cannot follow.
    let obj = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/1 2/2 3/3\nf 1/1 3/3 4/4\n";
    std::fs::write(at.join("in.obj"), obj).unwrap();
    let said = expect(at, "simplify in.obj out.ply --triangles 2 --optimize 1", 2);
    assert!(said.contains("--texture none"), "{said}");
    assert!(!at.join("out.ply").exists());
}
