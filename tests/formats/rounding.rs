//! Coordinates that a format rounds: said where it could be seen, refused where there is nothing left of them.

use crate::common::{expect, write_ply};
use stonecut::mesh::property::Scalar;

/// A plate of 8 x 8 squares of this side, shifted along x.
fn plate(path: &std::path::Path, side: f64, shift: f64) {
    let at = |i: u32| [shift + f64::from(i % 9) * side, f64::from(i / 9) * side, 0.0];
    let positions: Vec<[f64; 3]> = (0..81).map(at).collect();
    let squares = (0..72u32).filter(|i| i % 9 < 8);
    let triangles: Vec<[u32; 3]> =
        squares.flat_map(|i| [[i, i + 1, i + 9], [i + 1, i + 10, i + 9]]).collect();
    write_ply(path, Scalar::F64, &positions, &triangles);
}

#[test]
fn a_line_names_the_step_and_what_helps() {
    let dir = tempfile::tempdir().expect("a folder");
    let folder = dir.path();
    plate(&folder.join("far.ply"), 0.0075, 1e7);
    plate(&folder.join("near.ply"), 0.0075, 0.0);
    plate(&folder.join("large.ply"), 8.0, 1e7);
    for arguments in ["out.stl", "out.ply --format float"] {
        // Where neighbours fall together, hardly anything is left.
        for (file, code) in [("large.ply", 0), ("far.ply", 3)] {
            let said = expect(folder, &format!("convert {file} {arguments} --force"), code);
            let is_said = said.contains("coordinates are rounded") && said.contains("--recentre");
            assert!(is_said && said.contains("1.00e0"), "the step: {said}");
        }
        let said = expect(folder, &format!("convert near.ply {arguments} --force"), 0);
        assert!(!said.contains("rounded"), "{said}");
    }
    for arguments in ["out.ply", "out.obj", "out.glb --format float"] {
        let said = expect(folder, &format!("convert far.ply {arguments} --force"), 0);
        assert!(!said.contains("rounded"), "{arguments}: {said}");
    }
}

#[test]
fn coordinates_beyond_floats_are_refused_before_the_work() {
    let dir = tempfile::tempdir().expect("a folder");
    let folder = dir.path();
    plate(&folder.join("in.ply"), 1e39, 1e40);
    for arguments in [
        "convert in.ply out.stl",
        "convert in.ply out.ply --format float",
        "convert in.ply out.glb",
        "simplify in.ply out.stl --ratio 50%",
        "simplify in.ply out.stl --ratio 50% --method decimate",
    ] {
        let said = expect(folder, arguments, 4);
        assert!(said.contains("beyond what the output's floats hold"), "{arguments}: {said}");
        assert!(!folder.join("out.stl").exists(), "{arguments}");
    }
    expect(folder, "convert in.ply out.ply", 0);
}

/// Text of `float x` holds what its digits say: at map coordinates more than a float does.
#[test]
fn text_far_from_the_origin_is_not_rounded_to_floats() {
    let dir = tempfile::tempdir().expect("a folder");
    let folder = dir.path();
    let header = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
                  element face 1\nproperty list uchar int vertex_indices\nend_header\n";
    // Digits of doubles far away; those of floats, short and in full; digits of doubles near the origin.
    for (name, rows, is_double) in [
        (
            "map",
            "512345.678 5412345.123 10\n512346.178 5412345.123 10\n512345.678 5412345.623 10.25\n",
            true,
        ),
        ("short", "512345.7 5412345.5 10\n512346.2 5412345.5 10\n512345.7 5412346 10.25\n", false),
        (
            "full",
            "512345.6875 5412345.5 10\n512346.1875 5412345.5 10\n512345.6875 5412346 10.25\n",
            false,
        ),
        ("near", "0.123456789012 0.2 0.3\n1.1 0.2 0.3\n0.7 1.9 0.4\n", false),
    ] {
        std::fs::write(folder.join("in.ply"), format!("{header}{rows}3 0 1 2\n")).expect("written");
        expect(folder, "convert in.ply out.ply --format ascii --force", 0);
        let written = std::fs::read_to_string(folder.join("out.ply")).expect("read");
        assert_eq!(written.contains("property double x"), is_double, "{name}: {written}");
        if is_double {
            assert!(written.contains("512345.678 5412345.123 10"), "{written}");
        }
    }
}
