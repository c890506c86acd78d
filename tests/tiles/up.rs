//! The axis that points upwards: y in glTF and z in all others, unless `--up` says otherwise.

#![allow(clippy::unwrap_used)] // A test fails by panicking.

use crate::common::expect;
use serde_json::Value;
use std::path::Path;

fn tileset(folder: &Path, tree: &str) -> Value {
    let text = std::fs::read(folder.join(tree).join("tileset.json")).unwrap();
    serde_json::from_slice(&text).unwrap()
}

/// Half sides of the box of the root, in the axes of the tileset.
fn half_sides(set: &Value) -> [f64; 3] {
    let numbers = set["root"]["boundingVolume"]["box"].as_array().unwrap();
    let number = |at: usize| numbers[at].as_f64().unwrap().abs();
    [0, 1, 2].map(|k| number(3 + k) + number(6 + k) + number(9 + k))
}

#[test]
fn a_tower_stands_whatever_its_format() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let text = "ply\nformat ascii 1.0\nelement vertex 4\nproperty double x\nproperty double y\nproperty double z\n\
                element face 4\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n2 0 0\n0 0 4\n0 20 0\n\
                3 0 1 2\n3 0 3 1\n3 1 3 2\n3 2 3 0\n";
    std::fs::write(folder.join("y.ply"), text).unwrap();
    expect(folder, "convert y.ply y.glb", 0);
    expect(folder, "convert y.ply z.ply --up y", 0);
    for (input, options, wanted) in [
        ("y.glb", "", [1.0, 2.0, 10.0]),
        ("z.ply", "", [1.0, 2.0, 10.0]),
        ("y.ply", "--up y", [1.0, 2.0, 10.0]),
        ("y.ply", "", [1.0, 10.0, 2.0]),
        ("y.glb", "--up z", [1.0, 10.0, 2.0]),
        ("z.ply", "--scale 3 --translate 100,0,0 --recentre", [3.0, 6.0, 30.0]),
    ] {
        let said = expect(folder, &format!("tiles {input} t {options} --force"), 0);
        assert_eq!(said.contains("as glTF has it"), input == "y.glb" && options.is_empty());
        let set = tileset(folder, "t");
        let sides = half_sides(&set);
        let is_near = sides.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 0.02 * b);
        assert!(is_near, "{input} {options}: {sides:?}");
        let offset = set["extras"]["stonecut"].get("offset");
        assert_eq!(offset.is_some(), options.contains("--recentre"), "{set}");
        expect(folder, "info t --check", 0);
    }
}

#[test]
fn what_comes_through_a_pipe_or_packed_stands_too() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let text = "ply\nformat ascii 1.0\nelement vertex 4\nproperty double x\nproperty double y\nproperty double z\n\
                element face 4\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n2 0 0\n0 0 4\n0 20 0\n\
                3 0 1 2\n3 0 3 1\n3 1 3 2\n3 2 3 0\n";
    std::fs::write(folder.join("y.ply"), text).unwrap();
    expect(folder, "convert y.ply y.glb", 0);
    for (file, wanted) in [("y.glb", [1.0, 2.0, 10.0]), ("y.ply", [1.0, 10.0, 2.0])] {
        let input = std::fs::File::open(folder.join(file)).unwrap();
        let mut command = crate::common::stonecut();
        command.current_dir(folder).args(["tiles", "-", "t", "--force", "-q"]).stdin(input);
        assert!(command.status().unwrap().success());
        let sides = half_sides(&tileset(folder, "t"));
        assert!(
            sides.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 0.02 * b),
            "{file}: {sides:?}"
        );
    }
}
