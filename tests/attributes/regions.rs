//! Regions of faces with labels: counted by `info --check`, split by `convert`.

use crate::common::{count, expect, json, printed, run, scratch};
use std::path::Path;

/// `info --check --json` with further options.
fn info(at: &Path, arguments: &str) -> serde_json::Value {
    printed(at, &format!("info --check --json {arguments}"))
}

#[test]
fn regions_of_a_foam_are_counted_in_memory_and_out_of_core() {
    let at = &scratch();
    expect(at, "synth foam f.ply --triangles 100k --shuffle", 0);
    let found = info(at, "f.ply");
    let regions = &found["regions"];
    let n = count(regions, "found");
    assert_eq!((count(regions, "open_edges"), n % 2), (0, 0), "{regions}");
    assert!((regions["volume"].as_f64().unwrap() / (4 * n) as f64 - 1.0).abs() < 1e-3);
    let list = regions["largest"].as_array().unwrap();
    assert_eq!(list.len() as i64, n);
    assert!(list.iter().all(|region| (region["volume"].as_f64().unwrap() - 4.0).abs() < 0.01));
    // Three walls at each edge of a cell: all edges of more than two triangles, and none of them is doubled.
    assert_eq!(count(&found, "junction_edges"), count(&found, "non_manifold_edges"));
    assert!(count(&found, "junction_edges") > 1000 && count(&found, "junction_points") > 50);
    let mut small = info(at, "f.ply --memory 16MiB --threads 2");
    assert_eq!(small, found);
    small = info(at, "f.ply --memory 16MiB --threads 1");
    assert_eq!(small, found);
}

/// A tetrahedron of volume 1/6 with label 5 and one without its last face with label -3, whose faces stand apart.
const TWO: &str = "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\nproperty float z\n\
    element face 7\nproperty list uchar int vertex_indices\nproperty int label\nend_header\n\
    0 0 0\n1 0 0\n0 1 0\n0 0 1\n0 0 -1\n\
    3 0 2 1 5\n3 0 1 3 5\n3 1 2 3 5\n3 2 0 3 5\n3 0 1 2 -3\n3 0 4 1 -3\n3 1 4 2 -3\n";

#[test]
fn a_region_that_is_open_has_its_open_edges_counted() {
    let at = &scratch();
    std::fs::write(at.join("two.ply"), TWO).unwrap();
    let found = info(at, "two.ply");
    // The common face stands twice: an edge of it has three different triangles where the second tetrahedron has its side.
    let keys = ["boundary_edges", "duplicate_triangles", "junction_edges", "junction_points"];
    assert_eq!(keys.map(|key| count(&found, key)), [2, 1, 2, 2], "{found}");
    let regions = &found["regions"];
    assert_eq!((count(regions, "found"), count(regions, "open_edges")), (2, 3), "{regions}");
    // Both have the volume of a tetrahedron: the face that is missing holds the origin.
    let [second, first] = [0, 1].map(|i| &regions["largest"][i]);
    assert_eq!((count(first, "label"), count(first, "open_edges")), (5, 0));
    assert!((first["volume"].as_f64().unwrap() - 1.0 / 6.0).abs() < 1e-9);
    assert_eq!((count(second, "label"), count(second, "open_edges")), (-3, 3));
    let said = String::from_utf8(run(at, "info --check two.ply").stdout).unwrap();
    assert!(said.contains("5: volume 0.16666666666666666, 4 triangles, closed"), "{said}");
    assert!(said.contains("2 by label") && said.contains("3 triangles, 3 open edges"), "{said}");
}

/// Volume within a binary STL.
fn volume(path: &Path) -> f64 {
    let bytes = std::fs::read(path).unwrap();
    let float = |at: usize| f64::from(f32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()));
    let volume = |at: usize| {
        let [a, b, c] = [12, 24, 36].map(|k| [0, 4, 8].map(|i| float(at + k + i)));
        a[0] * (b[1] * c[2] - b[2] * c[1])
            + a[1] * (b[2] * c[0] - b[0] * c[2])
            + a[2] * (b[0] * c[1] - b[1] * c[0])
    };
    (84..bytes.len()).step_by(50).map(volume).sum::<f64>() / 6.0
}

#[test]
fn a_foam_splits_into_closed_meshes_that_face_outward() {
    let at = &scratch();
    expect(at, "synth foam f.ply --triangles 20k --shuffle", 0);
    std::fs::create_dir(at.join("out")).unwrap();
    expect(at, "convert f.ply out/cell-{label}.stl --split label --report r.json", 0);
    let output = &json(at, "r.json")["output"];
    let files = output["files"].as_array().unwrap();
    let triangles = files.iter().map(|file| count(file, "triangles")).sum::<i64>();
    assert_eq!(triangles, count(output, "triangles"));
    assert_eq!(std::fs::read_dir(at.join("out")).unwrap().count(), files.len());
    for (i, file) in files.iter().enumerate() {
        assert_eq!(count(file, "label"), i as i64 + 1);
        let name = format!("out/cell-{}.stl", i + 1);
        assert_eq!(file["path"], name);
        let found = info(at, &name);
        let keys = ["boundary_edges", "non_manifold_edges", "inconsistent_edges", "components"];
        assert_eq!(keys.map(|key| count(&found, key)), [0, 0, 0, 1], "{name}");
        assert_eq!(count(&found, "triangles"), count(file, "triangles"));
        assert!((volume(&at.join(&name)) / 4.0 - 1.0).abs() < 0.02, "{name}");
    }
    // The same through a small memory.
    std::fs::create_dir(at.join("small")).unwrap();
    expect(at, "convert f.ply small/cell-{label}.stl --split left --memory 32MiB", 0);
    for file in files {
        let name = file["path"].as_str().unwrap();
        let [whole, small] = [name.to_owned(), name.replace("out/", "small/")]
            .map(|name| std::fs::read(at.join(name)).unwrap());
        assert!(whole == small, "{name}");
    }
}

#[test]
fn a_split_writes_nothing_unless_all_of_its_files_can_be_written() {
    let at = &scratch();
    std::fs::write(at.join("two.ply"), TWO).unwrap();
    let said = expect(at, "convert two.ply out.ply --split label", 2);
    assert!(said.contains("{label} once"), "{said}");
    expect(at, "convert two.ply {label}/out.ply --split label", 2);
    let said = expect(at, "convert two.ply {label}.ply --split colour", 2);
    assert!(said.contains("properties of faces: label"), "{said}");
    // One of the files is there, one is a folder, one is the input.
    std::fs::write(at.join("5.ply"), TWO).unwrap();
    expect(at, "convert two.ply {label}.ply --split label", 2);
    let said = expect(at, "convert 5.ply {label}.ply --split label --force", 2);
    assert!(said.contains("are the same file"), "{said}");
    std::fs::create_dir(at.join("-3.obj")).unwrap();
    expect(at, "convert two.ply {label}.obj --split label --force", 2);
    let mut names: Vec<_> =
        std::fs::read_dir(at).unwrap().map(|file| file.unwrap().file_name()).collect();
    names.sort();
    assert_eq!(names, ["-3.obj", "5.ply", "two.ply"]);
    // A label may be negative; common walls stand in both files.
    expect(at, "convert two.ply part{label}.ply --split label", 0);
    let triangles = ["part5.ply", "part-3.ply"].map(|name| count(&info(at, name), "triangles"));
    assert_eq!(triangles, [4, 3]);
}
