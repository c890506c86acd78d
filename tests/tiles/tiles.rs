//! Trees of tiles: whole, sound, the same whatever the machine; and a checker that finds what is wrong with one.

use crate::common::{check, count, expect, json, run, scratch, write_ply};
use crate::errors::{level, sampled};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use stonecut::io::decode_tile;
use stonecut::mesh::property::Scalar;
use stonecut::pipeline::tiles::report::{LevelReport, TilesReport};
use stonecut::pipeline::tiles::{Finest, TileTexture, TilesConfig, make_tiles_on, prepare_tiles};
use stonecut::synth::{self, Kind, Settings};
use stonecut::system::disk::Disk;
use stonecut::system::progress::Progress;

/// A tree of a small statue, and the folder it lies in.
pub fn statue(options: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    expect(folder.path(), "synth statue in.ply --triangles 60k --seed 3", 0);
    expect(folder.path(), &format!("tiles in.ply out --tile-triangles 1000 {options}"), 0);
    folder
}

/// Every file below a folder by its name.
pub fn files(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut out = BTreeMap::new();
    let mut open = vec![folder.to_path_buf()];
    while let Some(at) = open.pop() {
        for entry in std::fs::read_dir(&at).unwrap().flatten() {
            let path = entry.path();
            if path.is_dir() {
                open.push(path);
            } else {
                let name = path.strip_prefix(folder).unwrap().to_path_buf();
                out.insert(name, std::fs::read(&path).unwrap());
            }
        }
    }
    out
}

#[test]
fn a_closed_mesh_becomes_a_tree_without_gaps() {
    let folder = statue("--report r.json");
    let found = check(folder.path(), "out");
    assert_eq!((count(&found, "n_faults"), count(&found, "boundary_edges")), (0, 0), "{found}");
    assert!(count(&found, "levels") >= 4 && count(&found, "tiles") > 60, "{found}");
    assert_eq!(found["gap_within"], json!(0.0));
    assert!(found["gap_across_steps"].as_f64().unwrap() <= 0.5);
    let n = count(&check(folder.path(), "in.ply"), "triangles");
    assert_eq!(count(&found, "triangles"), n);
    let report = json(folder.path(), "r.json");
    assert_eq!(report["tiles"], found["tiles"]);
    assert_eq!(report["stuck"], 0);
    assert!(!folder.path().join("out.stonecut-job").exists());
    let left: Vec<_> = std::fs::read_dir(folder.path()).unwrap().flatten().collect();
    assert_eq!(left.len(), 3, "{left:?}");
}

#[test]
fn open_scans_with_colours_and_other_frames_become_trees_too() {
    for (synth, options) in [
        ("terrain", "--compress none --up y"),
        ("scans", "--geo 47.3769,8.5417,408 --pixels 4"),
        ("gyroid", "--tile-triangles 700"),
    ] {
        let folder = tempfile::tempdir().unwrap();
        expect(folder.path(), &format!("synth {synth} in.ply --triangles 30k"), 0);
        let options = match options.contains("--tile") {
            true => options.to_owned(),
            false => format!("{options} --tile-triangles 900"),
        };
        let output = run(folder.path(), &format!("tiles in.ply out {options}"));
        // Ragged meshes may have groups that hardly fall.
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(matches!(output.status.code(), Some(0 | 3)), "{synth}: {said}");
        let found = check(folder.path(), "out");
        assert_eq!(count(&found, "n_faults"), 0, "{synth}: {found}");
        let tile = std::fs::read(folder.path().join("out/tiles/0/0/0-0.glb")).unwrap();
        let tile = decode_tile(&tile).unwrap();
        assert_eq!(tile.mesh.colours.is_empty(), synth != "scans");
        assert_eq!(tile.is_z_up, synth != "terrain");
    }
}

#[test]
fn a_mesh_of_one_tile_is_a_tree_of_one_tile() {
    let folder = tempfile::tempdir().unwrap();
    expect(folder.path(), "synth statue in.ply --triangles 2k", 0);
    expect(folder.path(), "tiles in.ply out", 0);
    let found = check(folder.path(), "out");
    assert_eq!(count(&found, "n_faults"), 0, "{found}");
}

/// Repeated faces are dropped when cells are loaded: the leaves sum to what is left, and the report has the number.
#[test]
fn repeated_faces_are_dropped_and_counted() {
    let at = &scratch();
    let side = 60;
    let place = |i: u32| [f64::from(i % side), f64::from(i / side), f64::from(i * i % 7) / 20.0];
    let positions: Vec<[f64; 3]> = (0..side * side).map(place).collect();
    let squares = (0..side * side).filter(|v| v % side + 1 < side && v / side + 1 < side);
    let two = |v: u32| [[v, v + 1, v + side + 1], [v, v + side + 1, v + side]];
    let mut triangles: Vec<[u32; 3]> = squares.flat_map(two).collect();
    let n = triangles.len() as i64;
    // One a little later, one far away, one that begins at another corner.
    triangles.insert(10, triangles[3]);
    triangles.push(triangles[500]);
    let [a, b, c] = triangles[2000];
    triangles.push([b, c, a]);
    write_ply(&at.join("in.ply"), Scalar::F32, &positions, &triangles);
    for finest in ["", "--finest 50%"] {
        expect(
            at,
            &format!("tiles in.ply out --tile-triangles 500 --force --report r.json {finest}"),
            0,
        );
        let found = check(at, "out");
        assert_eq!(count(&found, "n_faults"), 0, "{found}");
        assert!(!finest.is_empty() || count(&found, "triangles") == n, "{found}");
        let report = json(at, "r.json");
        assert_eq!(report["input"]["faults"]["duplicate_faces"], 3, "{report}");
    }
}

/// One triangle a million times farther away than the mesh is wide: places in tiles would be coarser than its triangles.
#[test]
fn a_mesh_that_tiles_cannot_hold_is_refused_before_the_work() {
    let at = &scratch();
    let side = 30;
    let place = |i: u32| [f64::from(i % side), f64::from(i / side), f64::from(i * i % 7) / 20.0];
    let mut positions: Vec<[f64; 3]> = (0..side * side).map(place).collect();
    let squares = (0..side * side).filter(|v| v % side + 1 < side && v / side + 1 < side);
    let two = |v: u32| [[v, v + 1, v + side + 1], [v, v + side + 1, v + side]];
    let mut triangles: Vec<[u32; 3]> = squares.flat_map(two).collect();
    let n = positions.len() as u32;
    triangles.push([n, n + 1, n + 2]);
    positions.extend([[3e7, 0.0, 0.0], [3e7 + 8.0, 0.0, 0.0], [3e7, 8.0, 0.0]]);
    write_ply(&at.join("in.ply"), Scalar::F64, &positions, &triangles);
    let said = expect(at, "tiles in.ply out", 4);
    assert!(said.contains("--min-component") && said.contains("rounded"), "{said}");
    assert_eq!(std::fs::read_dir(at).unwrap().count(), 1, "nothing is left");
    expect(at, "simplify in.ply near.ply --min-component 100 --ratio 100%", 0);
    expect(at, "tiles near.ply out", 0);
    assert_eq!(count(&check(at, "out"), "n_faults"), 0);
}

#[test]
fn the_same_bytes_for_any_threads_and_memory() {
    let folder = statue("--threads 1 --memory 200MiB");
    let one = files(&folder.path().join("out"));
    expect(folder.path(), "tiles in.ply other --tile-triangles 1000 --threads 3 --memory 2GiB", 0);
    assert!(one == files(&folder.path().join("other")));
}

#[test]
fn a_tree_is_replaced_only_when_asked_and_only_if_it_is_one() {
    let folder = statue("");
    let said = expect(folder.path(), "tiles in.ply out", 2);
    assert!(said.contains("--force"), "{said}");
    expect(folder.path(), "tiles in.ply out --force --tile-triangles 2k", 0);
    assert_eq!(count(&check(folder.path(), "out"), "n_faults"), 0);
    let other = folder.path().join("mine");
    std::fs::create_dir(&other).unwrap();
    std::fs::write(other.join("thesis.txt"), "years of work").unwrap();
    let said = expect(folder.path(), "tiles in.ply mine --force", 2);
    assert!(said.contains("not a tree of tiles"), "{said}");
    assert!(other.join("thesis.txt").exists());
    expect(folder.path(), "tiles in.ply in.ply --force", 2);
    expect(folder.path(), "tiles in.ply no/such/folder", 2);
}

pub fn config(folder: &Path, output: &str) -> TilesConfig {
    let mut transform = [0.0; 16];
    (0..4).for_each(|k| transform[5 * k] = 1.0);
    TilesConfig {
        input: folder.join("in.ply").into(),
        output: folder.join(output),
        tile_triangles: 1000,
        finest: Finest::Input,
        texture: TileTexture::Auto,
        coding: None,
        pixels: 1.0,
        packs: true,
        is_z_up: true,
        transform,
        crs: None,
        viewer: false,
        memory_bytes: 512 << 20,
        threads: std::num::NonZeroUsize::MIN,
        job_folder: folder.join(format!("{output}.stonecut-job")),
        keep_temp: false,
        force: false,
        restart: false,
        skip_bad: false,
        placing: Default::default(),
        weld: Default::default(),
        checkpoint_every: std::time::Duration::ZERO,
    }
}

pub fn make(disk: &Disk, config: &TilesConfig) -> stonecut::Result<TilesReport> {
    make_tiles_on(disk, prepare_tiles(config)?, config, &Progress::default())
}

/// A wavy sheet of `n` by `n` squares with two images: red to blue, and green.
pub fn painted(folder: &Path, n: u32) {
    let ramp = |x: u32, _| image::Rgb([255 - x as u8, 0, x as u8]);
    image::RgbImage::from_fn(256, 64, ramp).save(folder.join("ramp.png")).unwrap();
    image::RgbImage::from_pixel(8, 8, image::Rgb([0, 200, 0]))
        .save(folder.join("green.png"))
        .unwrap();
    std::fs::write(
        folder.join("in.mtl"),
        "newmtl ramp\nmap_Kd ramp.png\nnewmtl green\nmap_Kd green.png\n",
    )
    .unwrap();
    let mut text = "mtllib in.mtl\n".to_owned();
    let at = |i: u32| f64::from(i) / f64::from(n);
    for (i, j) in (0..=n).flat_map(|i| (0..=n).map(move |j| (i, j))) {
        let (x, y) = (at(i), at(j));
        let z = 0.05 * (9.0 * x).sin() * (7.0 * y).cos();
        text += &format!("v {x} {y} {z}\nvt {x} {y}\n");
    }
    for half in 0..2 {
        text += ["usemtl ramp\n", "usemtl green\n"][half as usize];
        for (i, j) in (0..n).flat_map(|i| (half * n / 2..(half + 1) * n / 2).map(move |j| (i, j))) {
            let id = |i: u32, j: u32| i * (n + 1) + j + 1;
            let [a, b, c, d] = [id(i, j), id(i + 1, j), id(i + 1, j + 1), id(i, j + 1)];
            text += &format!("f {a}/{a} {b}/{b} {c}/{c}\nf {a}/{a} {c}/{c} {d}/{d}\n");
        }
    }
    std::fs::write(folder.join("in.obj"), text).unwrap();
}

#[test]
fn vertices_get_their_colours_from_images() {
    let path = &scratch();
    painted(path, 120);
    expect(path, "tiles in.obj out --texture colors --tile-triangles 900 --report r.json", 0);
    let report = json(path, "r.json");
    assert!(report["notes"].to_string().contains("vertices have colours out of them"), "{report}");
    expect(path, "extract out all.ply --max-error 0", 0);
    expect(path, "info --check out", 0);
    assert_eq!(check_colours(&path.join("all.ply"), (0.01, 3.0)), 121 * 121);
}

/// Holds the colours of the vertices of a mesh against those that `painted` has given it, except for `rim` around borders;
/// returns how many vertices there are.
pub fn check_colours(mesh: &Path, (rim, most_off): (f64, f64)) -> usize {
    let source = stonecut::io::ply::MeshSource::open(mesh).unwrap();
    let mut block = stonecut::io::ply::VertexBlock::default();
    source.read_vertices(0, &mut block).unwrap();
    let bytes = source.schema().record_bytes();
    let names: Vec<_> = source.schema().properties.iter().map(|p| p.name.as_str()).collect();
    assert_eq!(names, ["red", "green", "blue"]);
    let mut n = 0;
    for record in block.records.chunks_exact(bytes) {
        let coordinate = |k: usize| match bytes {
            15 => f64::from(f32::from_le_bytes(record[4 * k..][..4].try_into().unwrap())),
            _ => f64::from_le_bytes(record[8 * k..][..8].try_into().unwrap()),
        };
        let [red, green, blue] = *record.last_chunk::<3>().unwrap();
        let (x, y) = (coordinate(0), coordinate(1));
        if y > 0.5 + rim {
            assert_eq!([red, green, blue], [0, 200, 0], "at {x} {y}");
        } else if y < 0.5 - rim && (rim..1.0 - rim).contains(&x) {
            // The image repeats beyond its ends.
            let found = (f64::from(blue), f64::from(red));
            let off = (found.0 - 256.0 * x + 0.5).abs().max((found.1 - 255.5 + 256.0 * x).abs());
            assert!(
                f64::from(green) <= most_off / 4.0 && off < most_off,
                "{red} {green} {blue} at {x} {y}"
            );
        }
        n += 1;
    }
    n
}

/// Two sheets, one of each material. A material alone counts unless it is grey.
#[test]
fn vertices_get_the_colours_of_materials_without_images() {
    let path = &scratch();
    let library = "newmtl red\nKd 1 0 0\nnewmtl blue\nKd 0 0 1\nnewmtl grey\nKd .8 .8 .8\n";
    std::fs::write(path.join("m.mtl"), library).unwrap();
    for (materials, n_coloured) in [(&["red", "blue"][..], 1681), (&["red"], 1681), (&["grey"], 0)]
    {
        let mut text = "mtllib m.mtl\n".to_owned();
        for (sheet, material) in materials.iter().enumerate() {
            for i in 0..41 * 41 {
                let z = f64::from(i * i % 7) * 0.1;
                text += &format!("v {} {} {z}\n", 100 * sheet as u32 + i % 41, i / 41);
            }
            text += &format!("usemtl {material}\n");
            for i in (0..40 * 41).filter(|i| i % 41 < 40) {
                let a = 1681 * sheet as u32 + i + 1;
                text += &format!("f {a} {} {} {}\n", a + 1, a + 42, a + 41);
            }
        }
        std::fs::write(path.join("in.obj"), text).unwrap();
        let said = expect(path, "tiles in.obj out --tile-triangles 1000 --force", 0);
        assert_eq!(
            said.contains("materials: not carried: vertices have"),
            n_coloured > 0,
            "{said}"
        );
        expect(path, "extract out all.ply --max-error 0 --force", 0);
        let source = stonecut::io::ply::MeshSource::open(&path.join("all.ply")).unwrap();
        let mut block = stonecut::io::ply::VertexBlock::default();
        source.read_vertices(0, &mut block).unwrap();
        let rows = block.records.chunks_exact(source.schema().record_bytes());
        let of = |name: &str| if materials.contains(&name) { n_coloured } else { 0 };
        for (colour, n) in [([255, 0, 0], of("red")), ([0, 0, 255], of("blue"))] {
            let has_it = |row: &&[u8]| row.last_chunk() == Some(&colour);
            assert_eq!(rows.clone().filter(has_it).count(), n, "{materials:?} {colour:?}");
        }
    }
}

#[test]
fn colours_out_of_images_are_the_same_for_any_threads_and_memory() {
    let path = &scratch();
    painted(path, 120);
    let cut = |name: &str, options: &str| {
        expect(
            path,
            &format!("tiles in.obj {name} --texture colors --tile-triangles 900 {options}"),
            0,
        );
        files(&path.join(name))
    };
    assert!(cut("one", "--threads 1 --memory 200MiB") == cut("two", "--threads 3 --memory 2GiB"));
}

#[test]
fn levels_finer_than_the_finest_are_not_written_but_counted_in() {
    let path = &scratch();
    expect(path, "synth statue in.ply --triangles 60k --seed 3", 0);
    let input = count(&check(path, "in.ply"), "triangles");
    expect(path, "tiles in.ply all --tile-triangles 1000", 0);
    let whole = level(&path.join("all"), 0);
    for (finest, share) in [("50%", 0.5), ("0.1", 0.1), ("15k", 0.25), ("1%", 0.01), ("80k", 1.0)] {
        let make = "tiles in.ply out --tile-triangles 1000 --force --report r.json --finest";
        expect(path, &format!("{make} {finest}"), 0);
        let found = check(path, "out");
        assert_eq!((count(&found, "n_faults"), count(&found, "boundary_edges")), (0, 0), "{found}");
        let ratio = count(&found, "triangles") as f64 / input as f64;
        assert!((ratio / share - 1.0).abs() < 0.35, "{finest}: {ratio}");
        let n_tiles = count(&found, "tiles");
        let code = if share < 1.0 { 3 } else { 0 };
        expect(path, "extract out fine.ply --max-error 0 --force", code);
        expect(path, "extract out coarse.ply --triangles 300 --force", 0);
        let report = json(path, "r.json");
        assert_eq!(count(&report, "tiles"), n_tiles);
        for (number, facts) in (0u32..).zip(report["levels"].as_array().unwrap()) {
            let stated = facts["error_max"].as_f64().unwrap();
            if stated == 0.0 {
                assert!(number == 0 && share == 1.0);
                continue;
            }
            let mesh = level(&path.join("out"), number);
            let far = sampled(&whole, &mesh).max(sampled(&mesh, &whole));
            assert!(
                stated >= far && stated <= 3.0 * far,
                "{finest}, level {number}: {stated} {far}"
            );
        }
    }
}

#[test]
fn a_piece_too_far_away_for_one_tile_is_refused() {
    let at = &scratch();
    let mesh = synth::mesh(&Settings::new(Kind::Statue, 30_000)).unwrap();
    let mut positions: Vec<[f64; 3]> =
        mesh.positions.iter().map(|p| [p[0] + 5e5, p[1] + 5e6, p[2]]).collect();
    let mut triangles = mesh.triangles.clone();
    let n = positions.len() as u32;
    positions.extend([[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
    triangles.push([n, n + 1, n + 2]);
    write_ply(&at.join("in.ply"), Scalar::F64, &positions, &triangles);
    let said = expect(at, "tiles in.ply out --tile-triangles 1000", 4);
    assert!(said.contains("--min-component"), "{said}");
    for left in ["out", ".out.stonecut-tiles", "out.stonecut-job"] {
        assert!(!at.join(left).exists(), "{left}");
    }
}

/// Changes the JSON of a tree.
pub fn change(folder: &Path, change: impl FnOnce(&mut Value)) {
    let path = folder.join("out/tileset.json");
    let mut set: Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
    change(&mut set);
    std::fs::write(path, set.to_string()).unwrap();
}

/// Changes the JSON of a tile that is not packed; the text keeps its length.
pub fn change_tile(path: &Path, change: impl FnOnce(&mut Value)) {
    let bytes = std::fs::read(path).unwrap();
    let n = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    let mut document: Value = serde_json::from_slice(&bytes[20..20 + n]).unwrap();
    change(&mut document);
    let mut text = document.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut out = bytes[..20].to_vec();
    out.extend_from_slice(&text);
    out.extend_from_slice(&bytes[20 + n..]);
    let total = out.len() as u32;
    out[8..12].copy_from_slice(&total.to_le_bytes());
    out[12..16].copy_from_slice(&(text.len() as u32).to_le_bytes());
    std::fs::write(path, out).unwrap();
}

/// Exit code 4 and a fault that has these words.
pub fn expect_fault(folder: &Path, words: &str) {
    let output = run(folder, "info --check --json out");
    assert_eq!(output.status.code(), Some(4), "{words}");
    let found: Value = serde_json::from_slice(&output.stdout).unwrap();
    let faults = found["faults"].to_string();
    assert!(count(&found, "n_faults") > 0 && faults.contains(words), "{words}: {faults}");
}

#[test]
fn every_kind_of_damage_is_found() {
    let folder = statue("--compress none");
    let (path, out) = (folder.path(), folder.path().join("out"));
    let sound = files(&out);
    let tile = out.join("tiles/0/0/3-1.glb");
    let restore =
        || sound.iter().for_each(|(name, bytes)| std::fs::write(out.join(name), bytes).unwrap());
    assert_eq!(count(&check(path, "out"), "n_faults"), 0);

    change(path, |set| set["root"]["children"][0]["geometricError"] = 1e9.into());
    expect_fault(path, "does not fall");
    restore();
    change(path, |set| {
        let own = set["root"]["children"][0]["geometricError"].as_f64().unwrap();
        set["root"]["children"][0]["geometricError"] = (own * 1.001).into();
    });
    expect_fault(path, "another volume or error");
    restore();
    change(path, |set| set["root"]["children"][0]["boundingVolume"]["box"][3] = 0.5.into());
    expect_fault(path, "does not hold its content");
    restore();
    change(path, |set| set["root"]["content"]["uri"] = "../../etc/passwd.glb".into());
    expect_fault(path, "leads out of the folder");
    restore();
    change(path, |set| set["geometricError"] = 0.0.into());
    expect_fault(path, "never show");
    restore();
    change(path, |set| set["root"]["refine"] = "ADD".into());
    expect_fault(path, "replaced");
    restore();
    change(path, |set| set["asset"]["version"] = "1.0".into());
    expect_fault(path, "version 1.0");
    restore();
    change(path, |set| set["extras"]["stonecut"]["input_triangles"] = 7.into());
    expect_fault(path, "the mesh had 7");
    restore();

    std::fs::remove_file(&tile).unwrap();
    expect_fault(path, "cannot be read");
    restore();
    let bytes = std::fs::read(&tile).unwrap();
    std::fs::write(&tile, &bytes[..bytes.len() - 5]).unwrap();
    expect_fault(path, "not a whole GLB");
    restore();
    let numbers = out.join("tiles/0/0/3.ids");
    let bytes = std::fs::read(&numbers).unwrap();
    std::fs::write(&numbers, &bytes[1..]).unwrap();
    expect_fault(path, "numbers of vertices are damaged");
    restore();
    std::fs::copy(out.join("tiles/0/0/2.ids"), &numbers).unwrap();
    expect_fault(path, "");
    restore();
    // A tile one step off its neighbours, then 40.
    for (steps, words) in [(1.0, "apart"), (40.0, "steps away")] {
        change_tile(&tile, |document| {
            let node = &mut document["nodes"][0];
            let step = node["scale"][0].as_f64().unwrap();
            let x = node["translation"][0].as_f64().unwrap();
            node["translation"][0] = (x + steps * step).into();
            // Within its volume all the same.
        });
        change(path, |set| widen(&mut set["root"]));
        expect_fault(path, words);
        restore();
    }
    assert_eq!(count(&check(path, "out"), "n_faults"), 0);
}

/// Makes all volumes a little larger, by the same length.
fn widen(tile: &mut Value) {
    fn wider(volume: &mut Value) {
        for k in [3, 7, 11] {
            let half = volume["box"][k].as_f64().unwrap();
            volume["box"][k] = (half + 3.0).into();
        }
    }
    wider(&mut tile["boundingVolume"]);
    if tile.get("content").is_some() {
        wider(&mut tile["content"]["boundingVolume"]);
    }
    if let Some(children) = tile.get_mut("children").and_then(Value::as_array_mut) {
        children.iter_mut().for_each(widen);
    }
}

#[test]
fn one_group_that_keeps_its_triangles_is_not_a_failure() {
    let is_short = |levels: &[(u64, u64)]| {
        let level =
            |&(triangles, stuck)| LevelReport { triangles, stuck, ..LevelReport::default() };
        TilesReport { levels: levels.iter().map(level).collect(), ..TilesReport::default() }
            .is_short()
    };
    assert!(!is_short(&[(4_000_000, 0), (2_010_000, 1), (1_000_000, 0)]));
    // A level of one small tile may have as many as the one below.
    assert!(!is_short(&[(5000, 0), (4900, 0)]));
    assert!(is_short(&[(4_000_000, 0), (3_900_000, 40)]));
}
