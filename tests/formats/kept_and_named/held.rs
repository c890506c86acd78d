//! Small readers that share nothing with the program: the kinds of content that a file has.

use serde_json::Value;
use std::collections::BTreeSet;
use std::path::Path;

/// The kinds of content that a file has, by a look at its text.
pub(super) fn held(path: &Path) -> BTreeSet<&'static str> {
    match path.extension().and_then(|e| e.to_str()).unwrap() {
        "ply" => held_by_ply(path),
        "obj" => held_by_obj(path),
        "glb" => held_by_glb(path),
        "tiles" => held_by_tiles(path),
        _ => held_by_stl(path),
    }
}

/// Normals are those of facets.
fn held_by_stl(path: &Path) -> BTreeSet<&'static str> {
    let bytes = std::fs::read(path).unwrap();
    let is_coloured = bytes[84..].chunks_exact(50).all(|facet| facet[49] & 0x80 != 0);
    those([(true, "normals"), (is_coloured, "colours of faces")])
}

fn those(kinds: impl IntoIterator<Item = (bool, &'static str)>) -> BTreeSet<&'static str> {
    kinds.into_iter().filter(|(is_there, _)| *is_there).map(|(_, kind)| kind).collect()
}

fn held_by_ply(path: &Path) -> BTreeSet<&'static str> {
    let bytes = std::fs::read(path).unwrap();
    let end = bytes.windows(10).position(|w| w == b"end_header").unwrap();
    let head = String::from_utf8_lossy(&bytes[..end]).into_owned();
    let (before, faces) = head.split_once("element face").unwrap();
    let (comments, vertices) = before.split_once("element vertex").unwrap();
    let has = |part: &str, line: &str| part.lines().any(|l| l == format!("property {line}"));
    those([
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
    ])
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
    those([
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
    ])
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
    those([
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
    ])
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
