//! Regions of faces with labels: counted by `info --check`.

#![allow(clippy::unwrap_used)] // A test fails by panicking.

use crate::common::{count, expect, run};

/// `info --check --json` with further options.
fn info(at: &std::path::Path, arguments: &str) -> serde_json::Value {
    let output = run(at, &format!("info --check --json {arguments}"));
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

#[test]
fn regions_of_a_foam_are_counted_in_memory_and_out_of_core() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
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
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
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
