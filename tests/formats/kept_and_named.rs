//! Files that have everything their format can hold, through every format and command: each kind of content is in the output,
//! by small readers that share nothing with the program, or its loss is in the ledger.
//!
//! `cargo test --test formats kept_and_named -- --nocapture` prints the table of docs/results/formats.md. With a folder in
//! `STONECUT_KEPT` the files are written there; `tools/kept_by_others.py` reads what becomes of them with other programs.

#![allow(clippy::print_stdout)] // The table.

use crate::common::{json, run, scratch};
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::path::Path;

/// A kind of content: its name, and the kind of loss and the words by which the ledger may name it instead.
type Kind = (&'static str, &'static [(&'static str, &'static str)]);

const DOUBLES: Kind = ("places far away", &[("precision", "")]);
const NORMALS: Kind = ("normals", &[("normals", "")]);
const COLOURS: Kind = ("colours of vertices", &[("colors", "colours of vertices")]);
const OPACITY: Kind = ("opacity", &[("colors", "opacity"), ("colors", "colours of vertices")]);
const COORDINATES: Kind =
    ("texture coordinates", &[("texture_coordinates", ""), ("images", "texture coordinates")]);
const SECOND: Kind =
    ("second coordinates", &[("texture_coordinates", ""), ("attributes", "(s, t)")]);
const MATERIALS: Kind = ("materials", &[("materials", ""), ("images", "images")]);
const IMAGES: Kind = ("images", &[("images", "")]);
const NORMAL_MAP: Kind =
    ("normal map", &[("images", "normal map"), ("images", "images"), ("materials", "normal map")]);
const FACTORS: Kind = ("colours of materials", &[("colors", "material"), ("materials", "")]);
const NAMES: Kind = ("names", &[("names", "names of objects")]);
const LABEL: Kind = ("labels of vertices", &[("attributes", "class")]);
const NUMBER: Kind = ("numbers of vertices", &[("attributes", "quality")]);
const LIST: Kind = ("lists of vertices", &[("attributes", "rings")]);
const FACE_COLOURS: Kind =
    ("colours of faces", &[("colors", "colours of faces"), ("attributes", "red")]);
const FACE_LABEL: Kind = ("labels of faces", &[("attributes", "part")]);
const FACE_NUMBER: Kind = ("numbers of faces", &[("attributes", "score")]);
const FACE_LIST: Kind = ("lists of faces", &[("attributes", "flags")]);
const LINES: Kind = ("lines and points", &[("elements", "")]);
const SMOOTH: Kind = ("smoothing groups", &[("normals", "smoothing")]);
const COMMENTS: Kind = ("comments", &[("names", "comments")]);
const ATTRIBUTE_BYTES: Kind = ("bytes of facets", &[("attributes", "attribute bytes")]);
const TANGENTS: Kind = ("tangents", &[("normals", "tangent")]);
const SKINS: Kind = ("skins", &[("elements", "skins")]);
const MORPHS: Kind = ("morph targets", &[("elements", "morph")]);
const CAMERAS: Kind = ("cameras", &[("elements", "cameras")]);
const LIGHTS: Kind = ("lights", &[("elements", "extension")]);
const HIDDEN: Kind = ("other scenes", &[("elements", "meshes")]);
const PARENTS: Kind = ("names of other nodes", &[("names", "nodes without a mesh")]);
const CLEARCOAT: Kind = ("material extensions", &[("materials", "clearcoat")]);

/// Contents of each input.
const INPUTS: [(&str, &[Kind]); 5] = [
    (
        "full.ply",
        &[
            DOUBLES,
            NORMALS,
            COLOURS,
            OPACITY,
            COORDINATES,
            SECOND,
            IMAGES,
            LABEL,
            NUMBER,
            LIST,
            FACE_COLOURS,
            FACE_LABEL,
            FACE_NUMBER,
            FACE_LIST,
            LINES,
            COMMENTS,
        ],
    ),
    (
        "full.obj",
        &[
            DOUBLES,
            NORMALS,
            COLOURS,
            OPACITY,
            COORDINATES,
            MATERIALS,
            FACTORS,
            IMAGES,
            NORMAL_MAP,
            NAMES,
            LINES,
            SMOOTH,
            COMMENTS,
        ],
    ),
    ("colours.stl", &[FACE_COLOURS, COMMENTS]),
    ("bytes.stl", &[ATTRIBUTE_BYTES, COMMENTS]),
    (
        "full.gltf",
        &[
            NORMALS,
            TANGENTS,
            COLOURS,
            OPACITY,
            COORDINATES,
            SECOND,
            MATERIALS,
            FACTORS,
            IMAGES,
            NORMAL_MAP,
            NAMES,
            NUMBER,
            LINES,
            SKINS,
            MORPHS,
            CAMERAS,
            LIGHTS,
            HIDDEN,
            PARENTS,
            CLEARCOAT,
            COMMENTS,
        ],
    ),
];

/// Commands by the columns of the table; IN and the output's ending follow.
const COMMANDS: [(&str, &str, &str); 11] = [
    ("convert, PLY", "convert IN OUT", "ply"),
    ("OBJ", "convert IN OUT", "obj"),
    ("STL", "convert IN OUT", "stl"),
    ("GLB", "convert IN OUT", "glb"),
    ("simplify, PLY", "simplify IN OUT --ratio 50% --texture keep", "ply"),
    ("OBJ", "simplify IN OUT --ratio 50% --texture keep", "obj"),
    ("STL", "simplify IN OUT --ratio 50% --texture keep", "stl"),
    ("GLB", "simplify IN OUT --ratio 50% --texture keep", "glb"),
    (
        "bake, GLB",
        "simplify IN OUT --ratio 50% --texture bake --bake-size 64 --normals recompute",
        "glb",
    ),
    (
        "bake, OBJ",
        "simplify IN OUT --ratio 50% --texture bake --bake-size 64 --normals recompute",
        "obj",
    ),
    ("tiles", "tiles IN OUT", "tiles"),
];

const SIDE: usize = 9;

/// Vertices of a wavy sheet far from the origin; the second half of it is another part.
fn place(i: usize) -> [f64; 3] {
    let (x, y) = ((i % SIDE) as f64, (i / SIDE) as f64);
    [500_000.125 + x, 5_400_000.25 + y, 0.3 * (x * 0.9).sin() + 0.2 * (y * 0.7).cos()]
}

fn squares() -> impl Iterator<Item = (usize, [usize; 4])> {
    let n = SIDE - 1;
    (0..n * n).map(move |k| {
        let a = k / n * SIDE + k % n;
        (usize::from(k % n >= n / 2), [a, a + 1, a + SIDE + 1, a + SIDE])
    })
}

fn uv(i: usize) -> [f64; 2] {
    [(i % SIDE) as f64 / (SIDE - 1) as f64, (i / SIDE) as f64 / (SIDE - 1) as f64]
}

fn image(path: &Path, colour: [u8; 3]) {
    image::RgbImage::from_pixel(8, 8, image::Rgb(colour)).save(path).unwrap();
}

fn write_ply(folder: &Path) {
    let mut text = "ply\nformat ascii 1.0\ncomment made by hand\ncomment TextureFile a.png\ncomment TextureFile b.png\n\
        obj_info scanner 7\n"
        .to_owned();
    text += &format!("element vertex {}\n", SIDE * SIDE);
    for property in [
        "double x",
        "double y",
        "double z",
        "float nx",
        "float ny",
        "float nz",
        "uchar red",
        "uchar green",
        "uchar blue",
        "uchar alpha",
        "float s",
        "float t",
        "int class",
        "double quality",
        "list uchar int rings",
    ] {
        text += &format!("property {property}\n");
    }
    let n = squares().count();
    text += &format!("element face {n}\n");
    for property in [
        "list uchar int vertex_indices",
        "list uchar float texcoord",
        "int texnumber",
        "uchar red",
        "uchar green",
        "uchar blue",
        "int part",
        "float score",
        "list uchar int flags",
    ] {
        text += &format!("property {property}\n");
    }
    text += "element edge 1\nproperty int vertex1\nproperty int vertex2\nend_header\n";
    for i in 0..SIDE * SIDE {
        let ([x, y, z], [u, v]) = (place(i), uv(i));
        let class = usize::from(i % SIDE > SIDE / 2);
        text +=
            &format!("{x} {y} {z} 0 0 1 {} 100 50 200 {u} {v} {class} {} 1 5\n", 3 * i, u / 3.0);
    }
    for (part, c) in squares() {
        let uv: Vec<String> = c.iter().flat_map(|&i| uv(i)).map(|x| x.to_string()).collect();
        let [a, b, d, e] = c;
        text += &format!(
            "4 {a} {b} {d} {e} 8 {} {part} {} 7 9 {} 0.5 1 3\n",
            uv.join(" "),
            100 * part,
            part + 4
        );
    }
    std::fs::write(folder.join("full.ply"), text + "0 1\n").unwrap();
}

fn write_obj(folder: &Path) {
    let library = "newmtl first\nKd 0.8 0.1 0.1\nKs 0.2 0.2 0.2\nNs 20\nmap_Kd a.png\nnorm n.png\n\
        newmtl second\nKd 0.1 0.2 0.9\nmap_Kd b.png\n";
    std::fs::write(folder.join("full.mtl"), library).unwrap();
    let mut text = "# made by hand\nmtllib full.mtl\n".to_owned();
    for i in 0..SIDE * SIDE {
        let ([x, y, z], [u, v]) = (place(i), uv(i));
        text += &format!("v {x} {y} {z} 0.25 {u} 0.5 0.5\nvt {u} {v}\n");
    }
    text += "vn 0 0 1\n";
    for wanted in [0, 1] {
        text += ["o left side\ng wall\ns 1\nusemtl first\n", "o right side\ns 2\nusemtl second\n"]
            [wanted];
        for (_, c) in squares().filter(|(part, _)| *part == wanted) {
            let corners = c.map(|i| format!("{0}/{0}/1", i + 1));
            text += &format!("f {}\n", corners.join(" "));
        }
    }
    std::fs::write(folder.join("full.obj"), text + "l 1 2 3\np 4\n").unwrap();
}

fn write_stl(folder: &Path, name: &str, bytes: impl Fn(usize) -> u16) {
    let mut out = b"made by hand".to_vec();
    out.resize(80, 0);
    let triangles =
        squares().flat_map(|(part, [a, b, c, d])| [(part, [a, b, c]), (part, [a, c, d])]);
    let triangles: Vec<_> = triangles.collect();
    out.extend((triangles.len() as u32).to_le_bytes());
    for (part, corners) in triangles {
        out.extend([0.0f32, 0.0, 1.0].map(f32::to_le_bytes).as_flattened());
        for i in corners {
            let [x, y, z] = place(i);
            let near = [x - 500_000.0, y - 5_400_000.0, z].map(|x| (x as f32).to_le_bytes());
            out.extend(near.as_flattened());
        }
        out.extend(bytes(part).to_le_bytes());
    }
    std::fs::write(folder.join(name), out).unwrap();
}

/// Two meshes with all attributes and materials, lines, a skin, targets, a camera, a light and a scene that is not shown.
fn write_gltf(folder: &Path) {
    let (mut bytes, mut views, mut accessors) = (Vec::<u8>::new(), Vec::new(), Vec::new());
    let n = SIDE * SIDE;
    let mut put = |values: Vec<f32>, kind: &str| -> usize {
        let width = [("SCALAR", 1), ("VEC2", 2), ("VEC3", 3), ("VEC4", 4)];
        let width = width.iter().find(|(name, _)| *name == kind).unwrap().1;
        views.push(
            json!({ "buffer": 0, "byteOffset": bytes.len(), "byteLength": 4 * values.len() }),
        );
        bytes.extend(values.iter().flat_map(|x| x.to_le_bytes()));
        accessors.push(json!({
            "bufferView": views.len() - 1, "componentType": 5126, "count": values.len() / width, "type": kind,
        }));
        accessors.len() - 1
    };
    let each = |f: &dyn Fn(usize) -> Vec<f32>| (0..n).flat_map(f).collect::<Vec<f32>>();
    let position = put(
        each(&|i| {
            place(i)
                .iter()
                .zip([500_000.0, 5_400_000.0, 0.0])
                .map(|(a, b)| (a - b) as f32)
                .collect()
        }),
        "VEC3",
    );
    let normal = put(each(&|_| vec![0.0, 0.0, 1.0]), "VEC3");
    let tangent = put(each(&|_| vec![1.0, 0.0, 0.0, 1.0]), "VEC4");
    let colour = put(each(&|i| vec![0.2, (i % 5) as f32 / 5.0, 0.4, 0.5]), "VEC4");
    let first = put(each(&|i| uv(i).map(|x| x as f32).to_vec()), "VEC2");
    let second = put(each(&|i| uv(i).map(|x| 1.0 - x as f32).to_vec()), "VEC2");
    let quality = put(each(&|i| vec![i as f32]), "SCALAR");
    let joints = put(each(&|_| vec![0.0; 4]), "VEC4");
    let mut lists = [Vec::new(), Vec::new()];
    for (part, [a, b, c, d]) in squares() {
        lists[part].extend([a, b, c, a, c, d].map(|i| i as u32));
    }
    let indices = lists.map(|list| {
        views.push(json!({ "buffer": 0, "byteOffset": bytes.len(), "byteLength": 4 * list.len() }));
        bytes.extend(list.iter().flat_map(|x| x.to_le_bytes()));
        accessors.push(json!({
            "bufferView": views.len() - 1, "componentType": 5125, "count": list.len(), "type": "SCALAR",
        }));
        accessors.len() - 1
    });
    std::fs::write(folder.join("full.bin"), &bytes).unwrap();
    let part = |part: usize| {
        json!({
            "attributes": {
                "POSITION": position, "NORMAL": normal, "TANGENT": tangent, "COLOR_0": colour, "TEXCOORD_0": first,
                "TEXCOORD_1": second, "_QUALITY": quality, "JOINTS_0": joints, "WEIGHTS_0": joints,
            },
            "indices": indices[part], "material": part,
            "targets": [{ "POSITION": position }],
        })
    };
    let line = json!({ "attributes": { "POSITION": position }, "mode": 1 });
    let material = |name: &str, factor: [f64; 4], image: usize| {
        json!({
            "name": name, "alphaMode": "BLEND",
            "pbrMetallicRoughness": { "baseColorFactor": factor, "baseColorTexture": { "index": image } },
            "normalTexture": { "index": 2 },
            "extensions": { "KHR_materials_clearcoat": { "clearcoatFactor": 1.0 } },
        })
    };
    let document = json!({
        "asset": { "version": "2.0", "generator": "hand", "copyright": "made by hand" },
        "extensionsUsed": ["KHR_lights_punctual", "KHR_materials_clearcoat"],
        "extensions": { "KHR_lights_punctual": { "lights": [{ "type": "point" }] } },
        "buffers": [{ "uri": "full.bin", "byteLength": bytes.len() }],
        "bufferViews": views, "accessors": accessors,
        "meshes": [
            { "name": "wall", "primitives": [part(0), line] },
            { "name": "right side", "primitives": [part(1)] },
            { "name": "unseen", "primitives": [part(1)] },
        ],
        "materials": [material("first", [0.8, 0.1, 0.1, 0.5], 0), material("second", [0.1, 0.2, 0.9, 1.0], 1)],
        "textures": [{ "source": 0 }, { "source": 1 }, { "source": 2 }],
        "images": [{ "uri": "a.png" }, { "uri": "b.png" }, { "uri": "n.png" }],
        "cameras": [{ "type": "perspective", "perspective": { "yfov": 1.0, "znear": 0.1 } }],
        "skins": [{ "joints": [2] }],
        "animations": [{ "channels": [], "samplers": [] }],
        "nodes": [
            { "name": "left side", "mesh": 0, "skin": 0 }, { "name": "right side", "mesh": 1 },
            { "name": "root", "children": [0, 1], "camera": 0 }, { "mesh": 2 },
        ],
        "scenes": [{ "nodes": [2] }, { "nodes": [3] }], "scene": 0,
    });
    std::fs::write(folder.join("full.gltf"), document.to_string()).unwrap();
}

/// The kinds of content that a file has, by a look at its text.
fn held(path: &Path) -> BTreeSet<&'static str> {
    match path.extension().and_then(|e| e.to_str()).unwrap() {
        "ply" => held_by_ply(path),
        "obj" => held_by_obj(path),
        "glb" => held_by_glb(path),
        "tiles" => held_by_tiles(path),
        // Those of its facets.
        _ => BTreeSet::from(["normals"]),
    }
}

fn held_by_ply(path: &Path) -> BTreeSet<&'static str> {
    let bytes = std::fs::read(path).unwrap();
    let end = bytes.windows(10).position(|w| w == b"end_header").unwrap();
    let head = String::from_utf8_lossy(&bytes[..end]).into_owned();
    let (before, faces) = head.split_once("element face").unwrap();
    let (comments, vertices) = before.split_once("element vertex").unwrap();
    let has = |part: &str, line: &str| part.lines().any(|l| l == format!("property {line}"));
    let mut out = BTreeSet::new();
    for (is_there, kind) in [
        (has(vertices, "double x"), "places far away"),
        (has(vertices, "float nx"), "normals"),
        (has(vertices, "uchar red"), "colours of vertices"),
        (has(vertices, "uchar alpha"), "opacity"),
        (has(faces, "list uchar float texcoord"), "texture coordinates"),
        (has(vertices, "float s"), "second coordinates"),
        (comments.contains("TextureFile"), "images"),
        (comments.contains("usemtl"), "materials"),
        (has(faces, "int objectnumber") && comments.contains("g wall\n"), "names"),
        (has(vertices, "int class"), "labels of vertices"),
        (has(vertices, "double quality"), "numbers of vertices"),
        (has(faces, "uchar red"), "colours of faces"),
        (has(faces, "int part"), "labels of faces"),
        (has(faces, "float score"), "numbers of faces"),
        (comments.contains("made by hand"), "comments"),
    ] {
        if is_there {
            out.insert(kind);
        }
    }
    out
}

fn held_by_obj(path: &Path) -> BTreeSet<&'static str> {
    let text = std::fs::read_to_string(path).unwrap();
    let library = std::fs::read_to_string(path.with_extension("mtl")).unwrap_or_default();
    let words = |first: &str| -> Vec<Vec<&str>> {
        let lines = text.lines().map(|line| line.split(' ').collect::<Vec<_>>());
        lines.filter(|words| words[0] == first).collect()
    };
    let vertices = words("v");
    let is_there = |map: &str| {
        let names = library.lines().filter_map(|line| line.strip_prefix(map));
        let mut names = names.map(|rest| rest.split(' ').next_back().unwrap());
        names.any(|name| path.with_file_name(name).is_file())
    };
    let mut out = BTreeSet::new();
    for (is_there, kind) in [
        (vertices[0][1].len() > 8, "places far away"),
        (!words("vn").is_empty(), "normals"),
        (vertices[0].len() >= 7, "colours of vertices"),
        (!words("vt").is_empty(), "texture coordinates"),
        (words("usemtl").len() > 1, "materials"),
        (library.contains("Kd 0.8 0.1 0.1") || library.contains("Kd 0.9"), "colours of materials"),
        (is_there("map_Kd "), "images"),
        (is_there("norm ") || is_there("map_Bump "), "normal map"),
        (text.contains("\no left side\ng wall\n"), "names"),
        (!words("l").is_empty(), "lines and points"),
        (text.contains("# made by hand") || text.contains("copyright made by hand"), "comments"),
    ] {
        if is_there {
            out.insert(kind);
        }
    }
    out
}

/// The JSON of a GLB file and its binary chunk.
fn glb(path: &Path) -> (Value, Vec<u8>) {
    let bytes = std::fs::read(path).unwrap();
    let n = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    (serde_json::from_slice(&bytes[20..20 + n]).unwrap(), bytes[28 + n..].to_vec())
}

fn held_by_glb(path: &Path) -> BTreeSet<&'static str> {
    let (document, bytes) = glb(path);
    let empty = Vec::new();
    let list = |key: &str| document[key].as_array().unwrap_or(&empty).clone();
    let meshes = list("meshes");
    let primitives: Vec<&Value> =
        meshes.iter().flat_map(|mesh| mesh["primitives"].as_array().unwrap()).collect();
    let attribute = |name: &str| primitives.iter().all(|p| p["attributes"][name].is_u64());
    let materials = list("materials");
    // Alpha of the first vertex, if it has a colour of four words.
    let alpha = primitives[0]["attributes"]["COLOR_0"].as_u64().map(|number| {
        let accessor = &document["accessors"][number as usize];
        let view = &document["bufferViews"][accessor["bufferView"].as_u64().unwrap() as usize];
        let at = view["byteOffset"].as_u64().unwrap() + accessor["byteOffset"].as_u64().unwrap();
        u16::from_le_bytes(bytes[at as usize + 6..at as usize + 8].try_into().unwrap())
    });
    let named = |list: &[Value], name: &str| list.iter().any(|item| item["name"] == name);
    let mut out = BTreeSet::new();
    for (is_there, kind) in [
        // Steps from there are finer than floats.
        (document["nodes"][0]["translation"][0].as_f64() > Some(400_000.0), "places far away"),
        (attribute("NORMAL"), "normals"),
        (attribute("TANGENT"), "tangents"),
        (attribute("COLOR_0"), "colours of vertices"),
        (alpha.is_some_and(|alpha| alpha < 65_000), "opacity"),
        (attribute("TEXCOORD_0"), "texture coordinates"),
        (materials.len() > 1, "materials"),
        (
            materials.iter().any(|m| m["pbrMetallicRoughness"]["baseColorFactor"].is_array()),
            "colours of materials",
        ),
        (!list("images").is_empty(), "images"),
        (materials.iter().any(|m| m["normalTexture"].is_object()), "normal map"),
        (named(&list("nodes"), "left side") && named(&meshes, "wall"), "names"),
        (document["asset"]["extras"]["comments"].to_string().contains("made by hand"), "comments"),
    ] {
        if is_there {
            out.insert(kind);
        }
    }
    out
}

/// A tile of the finest level, which has more than the coarser ones only in its triangles.
fn held_by_tiles(path: &Path) -> BTreeSet<&'static str> {
    let mut folders = vec![path.to_path_buf()];
    // The transform of the tree is in doubles.
    let text = std::fs::read_to_string(path.join("tileset.json")).unwrap();
    let transform = &serde_json::from_str::<Value>(&text).unwrap()["root"]["transform"];
    let is_far = transform[12].as_f64() > Some(400_000.0);
    let mut out = BTreeSet::from_iter(is_far.then_some("places far away"));
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|e| e == "glb") {
                let text = glb(&path).0.to_string().to_lowercase();
                let kinds = [
                    ("normal\"", "normals"),
                    ("color_0", "colours of vertices"),
                    ("texcoord_0", "texture coordinates"),
                    ("\"images\"", "images"),
                    ("quality", "numbers of vertices"),
                    ("class", "labels of vertices"),
                    ("alpha", "opacity"),
                    ("\"s\"", "second coordinates"),
                ];
                out.extend(
                    kinds.iter().filter(|(word, _)| text.contains(word)).map(|(_, kind)| *kind),
                );
            }
        }
    }
    out
}

#[test]
fn every_kind_of_content_is_kept_or_named() {
    let folder = tempfile::tempdir().unwrap();
    let named = std::env::var_os("STONECUT_KEPT").map(std::path::PathBuf::from);
    let at = named.as_deref().unwrap_or(folder.path());
    for (name, colour) in
        [("a.png", [200, 30, 30]), ("b.png", [30, 30, 200]), ("n.png", [128, 128, 255])]
    {
        image(&at.join(name), colour);
    }
    write_ply(at);
    write_obj(at);
    write_stl(at, "colours.stl", |part| if part == 0 { 0x801f } else { 0xfc00 });
    write_stl(at, "bytes.stl", |part| part as u16 + 1);
    write_gltf(at);
    let heads: Vec<&str> = COMMANDS.iter().map(|(head, _, _)| *head).collect();
    println!(
        "| input | content | {} |\n|---|---|{}",
        heads.join(" | "),
        "---|".repeat(heads.len())
    );
    let mut silent = Vec::new();
    for (input, kinds) in INPUTS {
        let mut columns = Vec::new();
        for (i, (_, command, ending)) in COMMANDS.iter().enumerate() {
            let stem = input.replace('.', "_");
            let output = format!("{stem}_{i}.{ending}");
            let mut command = command.replace("IN", input).replace("OUT", &output);
            let has_looks = kinds.iter().any(|kind| kind.0 == "images");
            if !has_looks {
                command = command.split(" --texture").next().unwrap().to_owned();
            }
            let done = run(at, &format!("{command} --force --report r.json"));
            let said = String::from_utf8_lossy(&done.stderr).into_owned();
            // A refusal says what to do; nothing is written then.
            if done.status.code() == Some(2) && command.contains("--texture bake") {
                columns.push(vec!["refused"; kinds.len()]);
                continue;
            }
            assert!([Some(0), Some(3)].contains(&done.status.code()), "{command}\n{said}");
            let report = json(at, "r.json");
            let losses = report["losses"].as_array().unwrap().clone();
            let held = held(&at.join(&output));
            columns.push(
                kinds
                    .iter()
                    .map(|(kind, losses_of)| {
                        let is_named = losses.iter().any(|loss| {
                            let what =
                                format!("{} {} {}", loss["what"], loss["example"], loss["reason"])
                                    .to_lowercase();
                            losses_of
                                .iter()
                                .any(|(of, words)| loss["kind"] == *of && what.contains(words))
                        });
                        match () {
                            () if held.contains(kind) => "kept",
                            () if is_named => "named",
                            () => {
                                silent.push(format!("{kind}: {command}\n{said}"));
                                "SILENT"
                            }
                        }
                    })
                    .collect::<Vec<_>>(),
            );
        }
        for (k, (kind, _)) in kinds.iter().enumerate() {
            let cells: Vec<&str> = columns.iter().map(|column| column[k]).collect();
            println!("| {input} | {kind} | {} |", cells.join(" | "));
        }
    }
    // A mesh out of tiles has colours in place of their images.
    let done = run(at, "extract full_obj_10.tiles out.ply --max-error 0");
    let said = String::from_utf8_lossy(&done.stderr).into_owned();
    assert!(said.contains("texture coordinates and images: not carried"), "{said}");
    assert!(silent.is_empty(), "lost in silence:\n{}", silent.join("\n"));
}

/// Colours beyond white, through those who show them.
#[test]
fn clamped_colours_are_named_by_every_command_that_clamps() {
    let at = &scratch();
    write_ply(at);
    let text = std::fs::read_to_string(at.join("full.ply")).unwrap();
    let (head, body) = text.split_once("end_header\n").unwrap();
    // Shares of white, one of them too bright; images are not wanted here.
    let head = ["red", "green", "blue"].iter().fold(head.to_owned(), |head, name| {
        head.replace(&format!("property uchar {name}"), &format!("property float {name}"))
    });
    let head: String = head
        .lines()
        .filter(|line| !line.contains("TextureFile"))
        .map(|line| line.to_owned() + "\n")
        .collect();
    let head = head.replace("list uchar float texcoord", "list uchar float rest");
    let rows = body.lines().enumerate().map(|(i, line)| {
        let mut words: Vec<String> = line.split(' ').map(str::to_owned).collect();
        if i < SIDE * SIDE {
            words[6] = if i == 7 { "1.5".to_owned() } else { "0.25".to_owned() };
            (words[7], words[8]) = ("0.5".to_owned(), "0.75".to_owned());
        }
        words.join(" ") + "\n"
    });
    std::fs::write(at.join("in.ply"), head + "end_header\n" + &rows.collect::<String>()).unwrap();
    for command in [
        "convert in.ply a.obj",
        "convert in.ply a.glb",
        "simplify in.ply b.glb --ratio 100%",
        "render in.ply -o a.png --size 64x64",
        "tiles in.ply tiles",
    ] {
        let done = run(at, &format!("{command} --force"));
        let said = String::from_utf8_lossy(&done.stderr).into_owned();
        assert!(said.contains("outside of black to white: clamped"), "{command}\n{said}");
    }
    let done = run(at, "convert in.ply same.ply");
    assert!(!String::from_utf8_lossy(&done.stderr).contains("clamped"), "{done:?}");
}
