//! Colours of every type and range come out as the same colours in every format.

use crate::common::{expect, scratch};
use serde_json::Value;
use std::path::Path;

const GREYS: [u32; 6] = [0, 1, 64, 128, 254, 255];

/// A strip of triangles with a grey at each of its vertices, `type` being that of the colours.
fn strip(kind: &str, value: impl Fn(u32) -> String) -> String {
    let mut text = format!(
        "ply\nformat ascii 1.0\nelement vertex 6\nproperty float x\nproperty float y\nproperty float z\n\
         property {kind} red\nproperty {kind} green\nproperty {kind} blue\n\
         element face 4\nproperty list uchar int vertex_indices\nend_header\n"
    );
    for (i, grey) in GREYS.into_iter().enumerate() {
        let value = value(grey);
        text.push_str(&format!("{} {} 0 {value} {value} {value}\n", i / 2, i % 2));
    }
    text + "3 0 2 1\n3 1 2 3\n3 2 4 3\n3 3 4 5\n"
}

/// The numbers behind x, y and z of the vertices of an ASCII PLY, from left to right and from below.
fn colours_of(folder: &Path, file: &str) -> Vec<Vec<f64>> {
    expect(folder, &format!("convert {file} shown.ply --format ascii --force"), 0);
    let text = std::fs::read_to_string(folder.join("shown.ply")).unwrap();
    let body = text.split("end_header\n").nth(1).unwrap();
    let mut rows: Vec<Vec<f64>> = body
        .lines()
        .take(6)
        .map(|line| line.split(' ').map(|word| word.parse().unwrap()).collect())
        .collect();
    rows.sort_by(|a, b| a[..2].partial_cmp(&b[..2]).unwrap());
    rows.into_iter().map(|row| row[3..].to_vec()).collect()
}

fn greys() -> Vec<Vec<f64>> {
    GREYS.map(|grey| vec![f64::from(grey); 3]).to_vec()
}

/// The accessor of the colours of a GLB file and the words of its first vertex.
fn first_colour(path: &Path) -> (Value, Vec<u16>) {
    let bytes = std::fs::read(path).unwrap();
    let n = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    let json: Value = serde_json::from_slice(&bytes[20..20 + n]).unwrap();
    let number = json["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"].as_u64().unwrap();
    let accessor = json["accessors"][number as usize].clone();
    let view = &json["bufferViews"][accessor["bufferView"].as_u64().unwrap() as usize];
    let at = |value: &Value| value["byteOffset"].as_u64().unwrap_or(0) as usize;
    let start = 28 + n + at(view) + at(&accessor);
    let words = bytes[start..start + 8].as_chunks::<2>().0;
    (accessor, words.iter().map(|&word| u16::from_le_bytes(word)).collect())
}

#[test]
fn glb_has_linear_light_and_gives_every_byte_back() {
    let folder = &scratch();
    std::fs::write(folder.join("grey.ply"), strip("uchar", |_| "128".to_owned())).unwrap();
    expect(folder, "convert grey.ply grey.glb", 0);
    let (accessor, words) = first_colour(&folder.join("grey.glb"));
    assert_eq!((&accessor["componentType"], &accessor["normalized"]), (&5123.into(), &true.into()));
    assert!((f64::from(words[0]) / 65_535.0 - 0.2159).abs() < 1e-4, "{words:?}");
    assert_eq!(words[3], 65_535);
    std::fs::write(folder.join("in.ply"), strip("uchar", |grey| grey.to_string())).unwrap();
    expect(folder, "convert in.ply out.glb", 0);
    assert_eq!(colours_of(folder, "out.glb"), greys());
}

#[test]
fn opacity_goes_through_glb_as_it_is() {
    let folder = &scratch();
    let text = strip("uchar", |grey| grey.to_string());
    let text = text.replace("property uchar blue\n", "property uchar blue\nproperty uchar alpha\n");
    let (head, body) = text.split_once("end_header\n").unwrap();
    let body: Vec<String> = (0..)
        .zip(body.lines())
        .map(|(i, line)| if i < 6 { format!("{line} {}\n", 10 * i) } else { format!("{line}\n") })
        .collect();
    std::fs::write(folder.join("in.ply"), format!("{head}end_header\n{}", body.concat())).unwrap();
    let said = expect(folder, "convert in.ply out.glb", 0);
    assert!(!said.contains("alpha"), "{said}");
    let alphas: Vec<f64> = colours_of(folder, "out.glb").iter().map(|row| row[3]).collect();
    assert_eq!(alphas, [0.0, 10.0, 20.0, 30.0, 40.0, 50.0]);
    // A share beside bytes.
    let shares = head.replace("uchar alpha", "float alpha");
    let body = body.concat().replace(" 10\n", " 0.2\n");
    std::fs::write(folder.join("in.ply"), format!("{shares}end_header\n{body}")).unwrap();
    expect(folder, "convert in.ply out.glb --force", 0);
    let alphas: Vec<f64> = colours_of(folder, "out.glb").iter().map(|row| row[3]).collect();
    assert_eq!(alphas[..2], [0.0, 51.0]);
}

#[test]
fn a_range_is_that_of_the_values() {
    let folder = &scratch();
    let share = |grey: u32| (f64::from(grey) / 255.0).to_string();
    let values: [(&str, &dyn Fn(u32) -> String); 8] = [
        ("uchar", &|grey| grey.to_string()),
        ("float", &share),
        ("double", &share),
        ("float", &|grey| format!("{grey}.0")),
        ("int", &|grey| grey.to_string()),
        ("ushort", &|grey| grey.to_string()),
        ("ushort", &|grey| (257 * grey).to_string()),
        ("float", &|grey| (257 * grey).to_string()),
    ];
    for (kind, value) in values {
        let text = strip(kind, value);
        std::fs::write(folder.join("in.ply"), &text).unwrap();
        for name in ["out.glb", "out.obj"] {
            expect(folder, &format!("convert in.ply {name} --force"), 0);
            assert_eq!(colours_of(folder, name), greys(), "{kind} {} {name}", value(128));
        }
        // PLY keeps the numbers themselves.
        let kept = colours_of(folder, "in.ply");
        assert_eq!(kept[3][0] as f32, value(128).parse::<f32>().unwrap(), "{kind}");
        expect(folder, "render in.ply -o p.png --unlit --color vertex --size 40x40 --force", 0);
        let pixels = image::open(folder.join("p.png")).unwrap().to_rgb8();
        std::fs::write(folder.join("plain.ply"), strip("uchar", |grey| grey.to_string())).unwrap();
        expect(folder, "render plain.ply -o q.png --unlit --color vertex --size 40x40 --force", 0);
        assert_eq!(pixels, image::open(folder.join("q.png")).unwrap().to_rgb8(), "{kind}");
    }
}

#[test]
fn one_bright_value_makes_no_other_range_and_is_named() {
    let folder = &scratch();
    let value = |grey: u32| match grey {
        255 => "1.02".to_owned(),
        _ => (f64::from(grey) / 255.0).to_string(),
    };
    std::fs::write(folder.join("in.ply"), strip("float", value)).unwrap();
    let said = expect(folder, "convert in.ply out.glb", 0);
    assert!(said.contains("colours of vertices: outside of"), "{said}");
    assert_eq!(colours_of(folder, "out.glb"), greys());
    let mut text = String::new();
    for (i, grey) in GREYS.into_iter().enumerate() {
        let value = value(grey);
        text.push_str(&format!("v {} {} 0 {value} {value} {value}\n", i / 2, i % 2));
    }
    text += "f 1 3 2\nf 2 3 4\nf 3 5 4\nf 4 5 6\n";
    std::fs::write(folder.join("in.obj"), &text).unwrap();
    let said = expect(folder, "convert in.obj obj.ply", 0);
    assert!(said.contains("colours of vertices: outside of 0 to 1"), "{said}");
    assert_eq!(colours_of(folder, "in.obj"), greys());
    let bytes = text.replace("1.02", "1");
    let bytes = bytes.replace(" 0.00392156862745098", " 0.003921569");
    std::fs::write(folder.join("plain.obj"), bytes).unwrap();
    assert!(!expect(folder, "convert plain.obj p.ply", 0).contains("colours outside"));
}

#[test]
fn vertices_without_a_colour_are_white_and_counted() {
    let folder = &scratch();
    let text = "v 0 0 0\nv 0 1 0\nv 1 0 0 0.5 0.5 0.5\nv 1 1 0 nan nan nan\nv 2 0 0\nv 2 1 0 1 0 0\n\
                f 1 3 2\nf 2 3 4\nf 3 5 4\nf 4 5 6\n";
    std::fs::write(folder.join("in.obj"), text).unwrap();
    let said = expect(folder, "convert in.obj out.ply", 0);
    assert!(said.contains("vertices without colour, 3 of them: others have one: white"), "{said}");
    let white = vec![255.0; 3];
    let wanted = vec![
        white.clone(),
        white.clone(),
        vec![128.0; 3],
        white.clone(),
        white,
        vec![255.0, 0.0, 0.0],
    ];
    assert_eq!(colours_of(folder, "in.obj"), wanted);
}

#[test]
fn a_tile_converts_to_the_colours_that_extract_gives() {
    let folder = &scratch();
    std::fs::write(folder.join("in.ply"), strip("uchar", |grey| grey.to_string())).unwrap();
    expect(folder, "tiles in.ply t --compress none -q", 0);
    expect(folder, "extract t out.ply --max-error 0 -q", 0);
    let tiles: Vec<_> = walk(&folder.join("t/tiles/0"));
    assert!(!tiles.is_empty());
    let greys = |name: &str| {
        expect(folder, &format!("convert {name} shown.ply --format ascii --force"), 0);
        let text = std::fs::read_to_string(folder.join("shown.ply")).unwrap();
        let names: Vec<&str> =
            text.lines().filter_map(|line| line.strip_prefix("property uchar ")).collect();
        assert_eq!(names, ["red", "green", "blue"], "{name}");
        let (head, body) = text.split_once("end_header\n").unwrap();
        let n = head.lines().find_map(|line| line.strip_prefix("element vertex ")).unwrap();
        let grey = |line: &str| line.split(' ').next_back().unwrap().parse::<u32>().unwrap();
        body.lines().take(n.parse().unwrap()).map(grey).collect::<Vec<_>>()
    };
    let mut extracted = greys("out.ply");
    extracted.sort_unstable();
    assert_eq!(extracted, GREYS);
    let mut converted: Vec<u32> = tiles
        .iter()
        .flat_map(|tile| greys(&tile.strip_prefix(folder).unwrap().display().to_string()))
        .collect();
    converted.sort_unstable();
    converted.dedup();
    assert_eq!(converted, GREYS);
}

fn walk(folder: &Path) -> Vec<std::path::PathBuf> {
    let mut out = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            out.extend(walk(&path));
        } else if path.extension().is_some_and(|e| e == "glb") {
            out.push(path);
        }
    }
    out
}
