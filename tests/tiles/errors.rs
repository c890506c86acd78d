//! Stated errors: of levels and of tiles, against distances that are looked for.

use crate::common::{check, count, json};
use crate::tiles::{files, statue};
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;
use stonecut::io::decode_tile;
use stonecut::measure::tree::{Nearest, Tree};
use stonecut::mesh::Mesh;

/// The mesh of a level, from all its tiles.
pub fn level(folder: &Path, level: u32) -> Mesh {
    let mut mesh = Mesh::default();
    for (name, bytes) in files(&folder.join(format!("tiles/{level}"))) {
        if name.extension().is_none_or(|extension| extension != "glb") {
            continue;
        }
        let tile = tile_mesh(&bytes);
        let first = mesh.positions.len() as u32;
        mesh.positions.extend(&tile.positions);
        mesh.triangles.extend(tile.triangles.iter().map(|t| t.map(|v| v + first)));
    }
    mesh
}

/// The mesh of a tile, from the origin of the lattice.
fn tile_mesh(bytes: &[u8]) -> Mesh {
    let tile = decode_tile(bytes).unwrap();
    let place = |p: &[i32; 3]| p.map(|x| f64::from(x) * tile.step);
    Mesh::new(tile.mesh.positions.iter().map(place).collect(), tile.mesh.triangles)
}

/// The largest distance of corners and middles of triangles.
pub fn sampled(from: &Mesh, to: &Mesh) -> f64 {
    let tree = Tree::build(to.triangles.len(), |t| to.corners(t));
    let mut most: f64 = 0.0;
    for t in 0..from.triangles.len() {
        let [a, b, c] = from.corners(t);
        let middle = [0, 1, 2].map(|k| (a[k] + b[k] + c[k]) / 3.0);
        for point in [a, middle] {
            most = most.max(tree.nearest(point, Nearest::NONE).distance_sq);
        }
    }
    most.sqrt()
}

#[test]
fn stated_errors_are_never_below_the_distance_and_not_far_above() {
    let folder = statue("--report r.json");
    let report = json(folder.path(), "r.json");
    let levels = report["levels"].as_array().unwrap();
    let finest = level(&folder.path().join("out"), 0);
    for (number, facts) in (0u32..).zip(levels).skip(1) {
        let stated = facts["error_max"].as_f64().unwrap();
        let mesh = level(&folder.path().join("out"), number);
        let far = sampled(&finest, &mesh).max(sampled(&mesh, &finest));
        assert!(stated >= far && stated <= 3.0 * far, "level {number}: {stated} for {far}");
    }
}

/// The deviation of every tile that has one, by its path.
fn stated(tile: &Value, out: &mut BTreeMap<String, f64>) {
    if let (Some(uri), Some(deviation)) =
        (tile["content"]["uri"].as_str(), tile["extras"]["deviation"].as_f64())
    {
        out.insert(uri.to_owned(), deviation);
    }
    tile["children"].as_array().into_iter().flatten().for_each(|child| stated(child, out));
}

#[test]
fn the_error_of_no_tile_is_below_the_distance_of_its_own_triangles() {
    let folder = statue("");
    let out = folder.path().join("out");
    let set = json(&out, "tileset.json");
    let mut all = BTreeMap::new();
    stated(&set["root"], &mut all);
    let finest = level(&out, 0);
    let whole = Tree::build(finest.triangles.len(), |t| finest.corners(t));
    let mut ratios = Vec::new();
    for number in 1..count(&check(folder.path(), "out"), "levels") as u32 {
        // The tile of each triangle of the level.
        let (mut mesh, mut owners, mut tiles) = (Mesh::default(), Vec::new(), Vec::new());
        for (name, deviation) in
            all.iter().filter(|(name, _)| name.starts_with(&format!("tiles/{number}/")))
        {
            let own = tile_mesh(&std::fs::read(out.join(name)).unwrap());
            let first = mesh.positions.len() as u32;
            mesh.positions.extend(&own.positions);
            mesh.triangles.extend(own.triangles.iter().map(|t| t.map(|v| v + first)));
            owners.resize(mesh.triangles.len(), tiles.len());
            tiles.push((name, *deviation, 0.0f64));
        }
        let tree = Tree::build(mesh.triangles.len(), |t| mesh.corners(t));
        // Every vertex of the input, at the tile that it is nearest to; and every tile's own vertices and middles.
        for point in &finest.positions {
            let found = tree.nearest(*point, Nearest::NONE);
            let far = &mut tiles[owners[tree.id(found.slot) as usize]].2;
            *far = far.max(found.distance_sq.sqrt());
        }
        for (t, &owner) in owners.iter().enumerate() {
            let [a, b, c] = mesh.corners(t);
            for point in [a, [0, 1, 2].map(|k| (a[k] + b[k] + c[k]) / 3.0)] {
                let far = &mut tiles[owner].2;
                *far = far.max(whole.nearest(point, Nearest::NONE).distance_sq.sqrt());
            }
        }
        for (name, deviation, far) in tiles {
            assert!(deviation >= far, "{name}: {deviation} for {far}");
            ratios.push(deviation / far);
        }
    }
    ratios.sort_by(f64::total_cmp);
    let within = ratios.partition_point(|ratio| *ratio <= 3.0);
    let (n, middle) = (ratios.len(), ratios[ratios.len() / 2]);
    eprintln!("{n} tiles: median {middle:.2}, largest {:.2}, {within} within 3", ratios[n - 1]);
    assert!(middle < 3.0, "{middle}");
}
