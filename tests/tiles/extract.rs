//! Meshes out of trees of tiles: closed where the input was, as fine as was asked for, the same whatever the machine.

use crate::common::{check, count, expect, json, scratch};
use serde_json::Value;
use std::path::Path;

/// A folder with a statue and its tiles.
fn statue() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    expect(folder.path(), "synth statue in.ply --triangles 60k --seed 3", 0);
    expect(folder.path(), "tiles in.ply out --tile-triangles 1000 --report r.json", 0);
    folder
}

fn levels(folder: &Path) -> Vec<Value> {
    let report = json(folder, "r.json");
    report["levels"].as_array().unwrap().clone()
}

/// Largest distance between two meshes, as `measure` finds it.
fn distance(folder: &Path, mesh: &str) -> f64 {
    expect(folder, &format!("measure in.ply {mesh} --report m.json --samples 50k"), 0);
    let report = json(folder, "m.json");
    let sides = report.as_object().unwrap().values();
    let found = sides.filter_map(|side| side["max"].as_f64()).reduce(f64::max);
    found.unwrap_or_else(|| panic!("{report}"))
}

#[test]
fn every_cut_of_a_closed_mesh_is_closed() {
    let folder = statue();
    let path = folder.path();
    let n = count(&check(path, "in.ply"), "triangles");
    let levels = levels(path);
    let errors: Vec<f64> =
        levels.iter().map(|level| level["error_max"].as_f64().unwrap()).collect();
    let mut counts = Vec::new();
    // Between the levels some groups of each are shown.
    for i in 0..3 * (errors.len() - 1) {
        let (low, high) = (errors[i / 3], errors[i / 3 + 1]);
        let error = low + (high - low) * (i % 3) as f64 / 3.0;
        expect(path, &format!("extract out cut.ply --max-error {error} --force"), 0);
        let found = check(path, "cut.ply");
        assert_eq!(count(&found, "boundary_edges"), 0, "{error}: {found}");
        assert_eq!(count(&found, "components"), 1, "{error}: {found}");
        counts.push(count(&found, "triangles"));
    }
    assert_eq!(counts[0], n, "at a distance of 0 it is the input");
    assert!(counts.is_sorted_by(|a, b| a >= b) && counts[counts.len() - 1] < n / 10, "{counts:?}");
    let between = counts.iter().filter(|n| levels.iter().all(|l| l["triangles"] != **n)).count();
    assert!(between > 0, "{counts:?}: cuts of several levels");
}

#[test]
fn a_box_beside_the_tree_is_refused_with_the_place_of_both() {
    let folder = scratch();
    let path = &folder;
    expect(path, "synth terrain in.ply --triangles 2k", 0);
    expect(path, "tiles in.ply out --scale 100 --translate 500000,5200000,0 --recentre", 0);
    let inside = "--inside 500000,5200000,-100,500001,5200001,900 --max-error-inside 1e6";
    let said = expect(path, &format!("extract out x.ply --max-error 1e6 {inside}"), 2);
    assert!(said.contains("meets no tile of the tree, which lies in "), "{said}");
    let own = said.split("the box is ").nth(1).unwrap().trim();
    expect(path, &format!("extract out x.ply --max-error 1e6 {own} --max-error-inside 1e6"), 0);
}

#[test]
fn a_box_is_fine_and_the_rest_coarse() {
    let folder = statue();
    let path = folder.path();
    let errors = levels(path);
    let coarse = errors[2]["error_max"].as_f64().unwrap();
    let whole = "-1e9,-1e9,-1e9,1e9,1e9,1e9";
    expect(path, &format!("extract out coarse.ply --max-error {coarse}"), 0);
    expect(
        path,
        &format!("extract out fine.ply --max-error {coarse} --inside {whole} --max-error-inside 0"),
        0,
    );
    let n = |name: &str| count(&check(path, name), "triangles");
    assert_eq!(n("fine.ply"), n("in.ply"));
    // The upper half.
    let set = json(path, "out/tileset.json");
    let middle = set["extras"]["stonecut"]["origin"][2].as_f64().unwrap();
    let upper = format!("-1e9,-1e9,{middle},1e9,1e9,1e9");
    expect(
        path,
        &format!("extract out half.ply --max-error {coarse} --inside {upper} --max-error-inside 0"),
        0,
    );
    let found = check(path, "half.ply");
    assert_eq!(count(&found, "boundary_edges"), 0, "{found}");
    assert!(n("coarse.ply") < n("half.ply") && n("half.ply") < n("in.ply"), "{found}");
    // A number of triangles, with the box left alone.
    let wanted = n("half.ply") - 500;
    expect(
        path,
        &format!("extract out some.ply --triangles {wanted} --inside {upper} --max-error-inside 0"),
        0,
    );
    let found = check(path, "some.ply");
    let got = count(&found, "triangles");
    assert!(got <= wanted && got + 2 >= wanted && count(&found, "boundary_edges") == 0, "{found}");
    // More in the box than asked for: said, and exit code 3.
    let said = expect(
        path,
        &format!("extract out less.ply --triangles 1k --inside {whole} --max-error-inside 0"),
        3,
    );
    assert!(said.contains("not met"), "{said}");
}

#[test]
fn any_number_of_triangles_is_met() {
    let folder = statue();
    let path = folder.path();
    for wanted in [300, 5_000, 20_001, 47_000, 1_000_000] {
        expect(path, &format!("extract out n.ply --triangles {wanted} --force --threads 1"), 0);
        let found = check(path, "n.ply");
        let got = count(&found, "triangles");
        let most = count(&check(path, "in.ply"), "triangles").min(wanted);
        assert!(got <= most && got + 2 >= most, "{wanted}: {found}");
        assert_eq!(count(&found, "boundary_edges"), 0, "{wanted}: {found}");
        expect(path, &format!("extract out m.ply --triangles {wanted} --force --threads 3"), 0);
        let read = |name: &str| std::fs::read(path.join(name)).unwrap();
        assert!(read("n.ply") == read("m.ply"), "{wanted}: other bytes with other threads");
    }
}

#[test]
fn distances_are_kept() {
    let folder = statue();
    let path = folder.path();
    for level in [1, 2] {
        let stated = levels(path)[level]["error_max"].as_f64().unwrap();
        let error = 0.7 * stated;
        expect(path, &format!("extract out cut.ply --max-error {error} --force"), 0);
        let found = distance(path, "cut.ply");
        assert!(found <= error && found > 0.0, "{found} for {error}");
    }
}

#[test]
fn colours_come_along() {
    let path = &scratch();
    expect(path, "synth scans in.ply --triangles 30k", 0);
    expect(path, "tiles in.ply out --tile-triangles 900", 0);
    expect(path, "extract out all.ply --max-error 0", 0);
    let read = |name: &str| stonecut::io::ply::MeshSource::open(&path.join(name)).unwrap();
    let names = |name: &str| {
        let schema = read(name).schema().clone();
        schema.properties.into_iter().map(|p| p.name).collect::<Vec<_>>()
    };
    assert_eq!(names("all.ply"), ["red", "green", "blue"]);
    let (before, after) = (check(path, "in.ply"), check(path, "all.ply"));
    assert_eq!(before["boundary_edges"], after["boundary_edges"]);
    expect(path, "extract out few.glb --triangles 2k", 0);
}

#[test]
fn what_cannot_be_is_refused_in_words() {
    let folder = statue();
    let path = folder.path();
    let said = expect(path, "extract out big.ply --max-error 0 --memory 42MiB", 6);
    assert!(said.contains("--max-error") && said.contains("--memory"), "{said}");
    assert!(!path.join("big.ply").exists());
    expect(path, "extract out x.ply", 2);
    expect(path, "extract out x.ply --max-error 1 --triangles 5", 2);
    expect(path, "extract out x.ply --max-error 1 --inside 0,0,0,1,1,1", 2);
    expect(path, "extract out x.ply --max-error 1 --inside 1,0,0,0,1,1 --max-error-inside 0", 2);
    expect(path, "extract in.ply x.ply --max-error 1", 4);
    std::fs::create_dir(path.join("empty")).unwrap();
    let said = expect(path, "extract empty x.ply --max-error 1", 4);
    assert!(said.contains("tileset.json"), "{said}");
    let ids = path.join("out/tiles/0/0/0.ids");
    std::fs::remove_file(&ids).unwrap();
    let said = expect(path, "extract out x.ply --max-error 0", 4);
    assert!(said.contains("numbers of its vertices"), "{said}");
    assert!(!path.join("x.ply").exists());
}
