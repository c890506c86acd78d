//! Properties of vertices as attributes of tiles: there and back, averaged and chosen, in the form that glTF allows.

use crate::common::{check, count, expect, json, scratch};
use crate::tiles::{change, change_tile, expect_fault, files};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::Path;
use stonecut::io::{TileScalar, decode_tile};

/// Vertices along a side of the mesh.
const SIDE: i32 = 110;

/// Names, types and values of the properties of vertex `id`.
fn properties(id: i32) -> [(&'static str, &'static str, f64); 12] {
    let (x, y) = (f64::from(id % SIDE), f64::from(id / SIDE));
    let height = (0.11 * x).sin() * (0.07 * y).cos() + 0.3 * (0.9 * x + 0.4 * y).sin();
    [
        ("x", "float", 0.1 * x),
        ("y", "float", 0.1 * y),
        ("z", "float", height),
        ("quality", "float", f64::from((0.01 * x * y).cos() as f32)),
        ("red", "uchar", f64::from(id % 256)),
        ("green", "uchar", 7.0),
        ("blue", "uchar", f64::from(id / 256)),
        ("gps-time", "double", 1.3e9 + x / 7.0),
        ("Quality", "float", -2.0),
        ("class", "uchar", f64::from(id % 5) * 50.0),
        ("intensity", "ushort", f64::from(60_000 - id)),
        ("id", "int", f64::from(2_000_000_000 + id)),
    ]
}

fn put(kind: &str, value: f64, out: &mut Vec<u8>) {
    match kind {
        "uchar" => out.push(value as u8),
        "ushort" => out.extend((value as u16).to_le_bytes()),
        "int" => out.extend((value as i32).to_le_bytes()),
        "float" => out.extend((value as f32).to_le_bytes()),
        _ => out.extend(value.to_le_bytes()),
    }
}

/// Writes a wavy sheet; `changed` gives the values that are written.
fn sheet(path: &Path, changed: impl Fn(i32, &str, f64) -> f64) {
    let n = SIDE * SIDE;
    let mut out = format!("ply\nformat binary_little_endian 1.0\nelement vertex {n}\n");
    for (name, kind, _) in properties(0) {
        out += &format!("property {kind} {name}\n");
    }
    let faces = 2 * (SIDE - 1) * (SIDE - 1);
    out += &format!("element face {faces}\nproperty list uchar int vertex_indices\nend_header\n");
    let mut out = out.into_bytes();
    for id in 0..n {
        for (name, kind, value) in properties(id) {
            put(kind, changed(id, name, value), &mut out);
        }
    }
    for id in (0..n - SIDE).filter(|id| id % SIDE < SIDE - 1) {
        for face in [[id, id + 1, id + SIDE + 1], [id, id + SIDE + 1, id + SIDE]] {
            out.push(3);
            face.iter().for_each(|v| out.extend(v.to_le_bytes()));
        }
    }
    std::fs::write(path, out).unwrap();
}

/// The types and the values of the properties of a binary PLY file.
fn read(path: &Path) -> BTreeMap<String, (String, Vec<f64>)> {
    let bytes = std::fs::read(path).unwrap();
    let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    let header = std::str::from_utf8(&bytes[..end]).unwrap();
    assert!(header.contains("binary_little_endian"), "{header}");
    let mut lines = header.lines().skip_while(|line| !line.starts_with("element vertex"));
    let n: usize = lines.next().unwrap().rsplit(' ').next().unwrap().parse().unwrap();
    let list: Vec<(String, String)> = lines
        .map_while(|line| line.strip_prefix("property "))
        .map(|line| line.split_once(' ').unwrap())
        .map(|(kind, name)| (kind.to_owned(), name.to_owned()))
        .collect();
    let mut rest = &bytes[end..];
    let mut out: BTreeMap<String, (String, Vec<f64>)> = BTreeMap::new();
    for _ in 0..n {
        for (kind, name) in &list {
            let value = match kind.as_str() {
                "uchar" => f64::from(rest.split_off(..1).unwrap()[0]),
                "ushort" => {
                    f64::from(u16::from_le_bytes(rest.split_off(..2).unwrap().try_into().unwrap()))
                }
                "int" => {
                    f64::from(i32::from_le_bytes(rest.split_off(..4).unwrap().try_into().unwrap()))
                }
                "float" => {
                    f64::from(f32::from_le_bytes(rest.split_off(..4).unwrap().try_into().unwrap()))
                }
                "double" => f64::from_le_bytes(rest.split_off(..8).unwrap().try_into().unwrap()),
                other => panic!("{other}"),
            };
            let entry = out.entry(name.clone()).or_insert((kind.clone(), Vec::new()));
            entry.1.push(value);
        }
    }
    out
}

/// A folder with a sheet and its tiles.
fn tiles(options: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    sheet(&folder.path().join("in.ply"), |_, _, value| value);
    let command = format!("tiles in.ply out --tile-triangles 900 --report r.json {options}");
    expect(folder.path(), &command, 0);
    assert_eq!(count(&check(folder.path(), "out"), "n_faults"), 0);
    folder
}

#[test]
fn properties_come_back_exactly_from_the_finest_tiles() {
    for options in ["", "--compress none --up y"] {
        let folder = tiles(options);
        let path = folder.path();
        expect(path, "extract out all.ply --max-error 0", 0);
        let found = read(&path.join("all.ply"));
        let ids = &found["id"].1;
        assert_eq!(ids.len(), (SIDE * SIDE) as usize);
        let kinds: Vec<_> = found.iter().map(|(name, (kind, _))| (&name[..], &kind[..])).collect();
        let mut expected: Vec<_> = properties(0).map(|(name, kind, _)| (name, kind)).to_vec();
        expected.sort_unstable();
        assert_eq!(kinds, expected);
        for (v, id) in ids.iter().enumerate() {
            for (name, _, value) in properties((*id - 2e9) as i32) {
                let now = found[name].1[v];
                let off = if ["x", "y", "z"].contains(&name) { 1e-3 } else { 0.0 };
                assert!((now - value).abs() <= off, "{options} {name} of {id}: {now} for {value}");
            }
        }
        let report = json(path, "r.json");
        assert_eq!(report["notes"], json!([]));
    }
}

#[test]
fn coarse_levels_average_floats_within_their_range_and_choose_integers() {
    let folder = tiles("");
    let path = folder.path();
    let input = read(&path.join("in.ply"));
    let range = |values: &[f64]| {
        values.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], x| [a.min(*x), b.max(*x)])
    };
    // Whole tiles of a coarse level, and a number that the kernel meets.
    for cut in ["--max-error 1e9", "--triangles 3001", "--triangles 400"] {
        expect(path, &format!("extract out cut.ply {cut} --force"), 0);
        let found = read(&path.join("cut.ply"));
        assert!(found["id"].1.len() < 2000, "{cut}");
        for name in ["quality", "Quality", "gps-time"] {
            let ([low, high], [a, b]) = (range(&input[name].1), range(&found[name].1));
            let slack = 1e-6 * (high - low);
            assert!(low - slack <= a && b <= high + slack, "{cut} {name}: {a} to {b}");
        }
        let quality = range(&found["quality"].1);
        assert!(quality[0] < -0.7 && quality[1] > 0.7, "{cut}: {quality:?}");
        for (v, id) in found["id"].1.iter().enumerate() {
            // All labels are those of one vertex.
            for (name, _, value) in properties((*id - 2e9) as i32) {
                if ["class", "intensity"].contains(&name) {
                    assert_eq!(found[name].1[v], value, "{cut} {name} of {id}");
                }
            }
        }
    }
}

/// The JSON of a GLB file.
pub fn document(bytes: &[u8]) -> Value {
    let n = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    serde_json::from_slice(&bytes[20..20 + n]).unwrap()
}

#[test]
fn attributes_have_the_form_that_gltf_asks_for() {
    for (options, packs) in [("", true), ("--compress none", false)] {
        let folder = tiles(options);
        let path = folder.path();
        let set = json(path, "out/tileset.json");
        let listed = &set["extras"]["stonecut"]["scalars"];
        let names: Vec<_> = listed.as_array().unwrap().iter().map(|s| &s["attribute"]).collect();
        let expected = ["_QUALITY", "_GPS_TIME", "_QUALITY_2", "_CLASS", "_INTENSITY", "_ID"];
        assert_eq!(names, expected);
        let scalars = TileScalar::read_list(listed).unwrap();
        for (name, bytes) in files(&path.join("out/tiles")) {
            if name.extension().is_none_or(|extension| extension != "glb") {
                continue;
            }
            let document = document(&bytes);
            let attributes = &document["meshes"][0]["primitives"][0]["attributes"];
            let accessor =
                |name: &str| &document["accessors"][attributes[name].as_u64().unwrap() as usize];
            let n = accessor("POSITION")["count"].as_u64().unwrap();
            let mut tile = decode_tile(&bytes).unwrap();
            tile.take_scalars(&scalars).unwrap();
            for (attribute, component, of) in [
                ("_QUALITY", 5126, "quality"),
                ("_GPS_TIME", 5126, "gps-time"),
                ("_GPS_TIME_LOW", 5126, "gps-time"),
                ("_QUALITY_2", 5126, "Quality"),
                ("_CLASS", 5121, "class"),
                ("_INTENSITY", 5123, "intensity"),
                ("_ID", 5126, "id"),
                ("_ID_LOW", 5126, "id"),
            ] {
                let accessor = accessor(attribute);
                assert_eq!(accessor["componentType"], component, "{attribute}");
                assert_eq!((&accessor["type"], &accessor["name"]), (&json!("SCALAR"), &json!(of)));
                assert_eq!(accessor["count"], n);
                let view =
                    &document["bufferViews"][accessor["bufferView"].as_u64().unwrap() as usize];
                assert_eq!(view["byteStride"], 4);
                assert_eq!(view["target"], 34962);
                assert_eq!(view["byteOffset"].as_u64().unwrap() % 4, 0);
                assert_eq!(view["byteLength"], 4 * n);
                let packing = &view["extensions"]["EXT_meshopt_compression"];
                assert_eq!(packing.is_object(), packs);
                if packs {
                    assert_eq!(
                        (&packing["mode"], &packing["byteStride"]),
                        (&json!("ATTRIBUTES"), &json!(4))
                    );
                    assert_eq!(packing["count"], n);
                    assert_eq!(packing["byteOffset"].as_u64().unwrap() % 4, 0);
                }
                let [low, high] = ["min", "max"].map(|end| accessor[end][0].as_f64().unwrap());
                assert!(low <= high);
                if let Some(i) = scalars.iter().position(|s| s.attribute == attribute) {
                    let values = &tile.mesh.scalars[i];
                    // Of a number in several parts the first is near it.
                    let slack =
                        if scalars[i].name == "id" || of == "gps-time" { 128.0 } else { 0.0 };
                    let least = values.iter().copied().fold(f64::INFINITY, f64::min);
                    let most = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
                    assert!((low - least).abs() <= slack && (high - most).abs() <= slack);
                }
            }
            let others = attributes.as_object().unwrap().keys().filter(|key| !key.starts_with('_'));
            assert_eq!(others.collect::<Vec<_>>(), ["COLOR_0", "NORMAL", "POSITION"]);
        }
    }
}

#[test]
fn numbers_that_gltf_does_not_have_are_counted() {
    let path = &scratch();
    sheet(&path.join("in.ply"), |id, name, value| match (id, name) {
        (5, "quality") => f64::NAN,
        (7, "gps-time") => f64::NEG_INFINITY,
        _ => value,
    });
    expect(path, "tiles in.ply out --report r.json", 0);
    assert_eq!(count(&check(path, "out"), "n_faults"), 0);
    let report = json(path, "r.json");
    let notes = report["notes"].to_string();
    assert!(
        notes.contains("values of properties of vertices, 2 of them: not exact in tiles"),
        "{notes}"
    );
    expect(path, "extract out all.ply --max-error 0", 0);
    let found = read(&path.join("all.ply"));
    let place = |id: f64| found["id"].1.iter().position(|x| *x == 2e9 + id).unwrap();
    assert_eq!(found["quality"].1[place(5.0)], 0.0);
    assert_eq!(found["gps-time"].1[place(7.0)], -f64::from(f32::MAX));
}

#[test]
fn texture_coordinates_of_vertices_are_named_as_lost() {
    let folder = tempfile::tempdir().unwrap();
    let ply = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
        property float s\nproperty float t\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n\
        0 0 0 0 0\n1 0 0 1 0\n0 1 0 0 1\n3 0 1 2\n";
    std::fs::write(folder.path().join("in.ply"), ply).unwrap();
    let said = expect(folder.path(), "tiles in.ply out", 0);
    assert!(
        said.contains("properties of vertices (s, t), 2 of them: not carried by tiles"),
        "{said}"
    );
    // With an image all that the mesh has of colour is lost.
    std::fs::write(
        folder.path().join("image.ply"),
        ply.replace("1.0\n", "1.0\ncomment TextureFile t.png\n"),
    )
    .unwrap();
    image::RgbImage::new(4, 4).save(folder.path().join("t.png")).unwrap();
    let said = expect(folder.path(), "tiles image.ply out --force", 3);
    assert!(
        said.contains("lost: images: not carried: faces have no texture coordinates"),
        "{said}"
    );
}

#[test]
fn damage_of_attributes_is_found() {
    let folder = tiles("--compress none");
    let (path, out) = (folder.path(), folder.path().join("out"));
    let tile = out.join("tiles/0/0/1-0.glb");
    let sound = std::fs::read(&tile).unwrap();
    let attribute = |document: &Value| {
        document["meshes"][0]["primitives"][0]["attributes"]["_QUALITY"].as_u64().unwrap() as usize
    };
    change_tile(&tile, |document| {
        let list = document["meshes"][0]["primitives"][0]["attributes"].as_object_mut().unwrap();
        let quality = list.remove("_QUALITY").unwrap();
        list.insert("_QUALITX".to_owned(), quality);
    });
    expect_fault(path, "lacks the attribute _QUALITY");
    expect(path, "extract out no.ply --max-error 0", 4);
    std::fs::write(&tile, &sound).unwrap();
    change_tile(&tile, |document| {
        let n = attribute(document);
        let count = document["accessors"][n]["count"].as_u64().unwrap();
        document["accessors"][n]["count"] = (count - 1).into();
    });
    expect_fault(path, "its attribute _QUALITY has");
    std::fs::write(&tile, &sound).unwrap();
    change_tile(&tile, |document| {
        let n = attribute(document);
        document["accessors"][n]["componentType"] = 5121.into();
    });
    expect_fault(path, "components of type 5121");
    std::fs::write(&tile, &sound).unwrap();
    assert_eq!(count(&check(path, "out"), "n_faults"), 0);
    change(path, |set| {
        set["extras"]["stonecut"]["scalars"].as_array_mut().unwrap().pop();
    });
    expect_fault(path, "that its tree does not name");
    change(path, |set| set["extras"]["stonecut"]["scalars"] = json!([{ "name": "a b" }]));
    expect_fault(path, "list of properties");
    expect(path, "extract out no.ply --max-error 0", 4);
}
