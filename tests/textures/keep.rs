//! Textured meshes in and out: materials, images and coordinates through every pair of formats.

use crate::common::{expect, json, printed, scratch};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use stonecut::io::StageOptions;
use stonecut::io::ply::MeshSource;

/// A PNG as far as its header and its end go, told apart by a word in between.
fn png(width: u32, height: u32, word: &str) -> Vec<u8> {
    let mut out = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR".to_vec();
    out.extend(width.to_be_bytes());
    out.extend(height.to_be_bytes());
    out.extend(b"\x08\x02\0\0\0");
    out.extend(word.as_bytes());
    out.extend(b"\0\0\0\0IEND\xaeB`\x82");
    out
}

const N: usize = 16;

/// A bumpy sheet of 2 N^2 triangles in `scan/`, whose material changes from quad to quad: three with an image and one
/// with a colour only.
fn scan(folder: &Path) {
    let scan = folder.join("scan");
    std::fs::create_dir_all(scan.join("my images")).unwrap();
    for (name, word) in [("a.png", "first"), ("b c.png", "second"), ("d.png", "third")] {
        std::fs::write(scan.join("my images").join(name), png(64, 64, word)).unwrap();
    }
    let library = "newmtl brick\nKa 0.1 0.2 0.3\nKd 0.5 0.25 1\nKs 0.5 0.5 0.5\nNs 10\nillum 2\n\
        map_Kd -s 1 1 1 my images\\a.png\nmap_bump my images/d.png\n\
        newmtl old wood\nKd 1 1 1\nd 0.5\nmap_Kd my images/b c.png\nmap_Ns my images/d.png\n\
        newmtl tile\nKd 1 1 1\nmap_Kd my images/d.png\nnewmtl red\nKd 1 0 0\nnewmtl unused\nKd 0 1 0\n";
    std::fs::write(scan.join("scan lib.mtl"), library).unwrap();
    let mut text = String::from("mtllib scan lib.mtl\n");
    for i in 0..=N {
        for j in 0..=N {
            let (x, y) = (i as f64 / N as f64, j as f64 / N as f64);
            text += &format!("v {x} {y} {}\nvt {x} {y}\n", 0.1 * (9.0 * x).sin() * (7.0 * y).cos());
        }
    }
    for i in 0..N {
        for j in 0..N {
            text +=
                &format!("usemtl {}\n", NAMES[material_of([i, j].map(|k| k as f64 / N as f64))]);
            let id = |i: usize, j: usize| format!("{0}/{0}", i * (N + 1) + j + 1);
            text += &format!("f {} {} {}\n", id(i, j), id(i + 1, j), id(i + 1, j + 1));
            text += &format!("f {} {} {}\n", id(i, j), id(i + 1, j + 1), id(i, j + 1));
        }
    }
    std::fs::write(scan.join("scan.obj"), text).unwrap();
}

const NAMES: [&str; 4] = ["brick", "old wood", "tile", "red"];

/// The material of the quad with these texture coordinates at its lower corner.
fn material_of([u, v]: [f64; 2]) -> usize {
    let [i, j] = [u, v].map(|x| (x * N as f64 + 0.5) as usize);
    (i / 4 + j / 4) % 4
}

/// Position and texture coordinates of a corner.
type Corner = ([f64; 3], [f64; 2]);

/// An OBJ file as it lies there.
#[derive(Default)]
struct Obj {
    /// Material, and position and coordinates of each corner.
    faces: Vec<(String, [Corner; 3])>,
    n_switches: usize,
    library: Option<String>,
}

fn read_obj(path: &Path) -> Obj {
    let (mut out, mut points, mut uvs) = (Obj::default(), Vec::new(), Vec::new());
    let mut material = String::new();
    for line in std::fs::read_to_string(path).unwrap().lines() {
        let (word, rest) = line.split_once(' ').unwrap_or((line, ""));
        let numbers = || rest.split(' ').map(|x| x.parse::<f64>().unwrap()).collect::<Vec<_>>();
        match word {
            "v" => points.push(<[f64; 3]>::try_from(&numbers()[..3]).unwrap()),
            "vt" => uvs.push(<[f64; 2]>::try_from(&numbers()[..2]).unwrap()),
            "mtllib" => out.library = Some(rest.to_owned()),
            "usemtl" => {
                out.n_switches += 1;
                material = rest.to_owned();
            }
            "f" => {
                let corner = |word: &str| {
                    let ids: Vec<usize> = word.split('/').map(|id| id.parse().unwrap()).collect();
                    (points[ids[0] - 1], uvs[ids[1] - 1])
                };
                let corners: Vec<_> = rest.split(' ').map(corner).collect();
                out.faces.push((material.clone(), corners.try_into().unwrap()));
            }
            _ => {}
        }
    }
    out
}

/// Colour image and lines of a material.
type Entry = (Option<PathBuf>, Vec<String>);

/// Colour image of each material of a library, and all lines of each.
fn read_library(path: &Path) -> BTreeMap<String, Entry> {
    let mut out: BTreeMap<String, Entry> = BTreeMap::new();
    let mut name = String::new();
    for line in std::fs::read_to_string(path).unwrap().lines() {
        if let Some(new) = line.strip_prefix("newmtl ") {
            name = new.to_owned();
            out.entry(name.clone()).or_default();
        } else if let Some(own) = out.get_mut(&name) {
            own.1.push(line.to_owned());
            if let Some(image) = line.strip_prefix("map_Kd ") {
                let image = image.strip_prefix("-s 1 1 1 ").unwrap_or(image);
                own.0 = Some(path.with_file_name(image));
            }
        }
    }
    out
}

/// Checks that every face has the material of its place, and that coordinates are those of positions.
fn assert_right(obj: &Obj, tolerance: f64) {
    for (name, corners) in &obj.faces {
        let mean = [0, 1].map(|k| corners.iter().map(|c| c.1[k]).sum::<f64>() / 3.0);
        for (p, uv) in corners {
            for k in 0..2 {
                assert!((p[k] - uv[k]).abs() <= tolerance, "{p:?} {uv:?}");
            }
        }
        // The middle of a triangle lies in its quad.
        let lower = mean.map(|x| (x * N as f64).floor() / N as f64);
        assert_eq!(name, NAMES[material_of(lower)], "{mean:?}");
    }
}

#[test]
fn an_obj_comes_out_in_groups_with_its_images_and_its_own_library() {
    let folder = &scratch();
    scan(folder);
    std::fs::create_dir(folder.join("out")).unwrap();
    for command in [
        "convert scan/scan.obj out/one.obj",
        "simplify scan/scan.obj out/one.obj --ratio 50% --force",
    ] {
        let said = expect(folder, command, 0);
        assert!(said.contains("'map_Ns' lines"), "{said}");
        let obj = read_obj(&folder.join("out/one.obj"));
        assert_eq!(obj.n_switches, 4, "{command}");
        assert_eq!(obj.library.as_deref(), Some("one.mtl"));
        if command.starts_with("convert") {
            assert_eq!(obj.faces.len(), 2 * N * N);
            assert_right(&obj, 1e-6);
        }
        let library = read_library(&folder.join("out/one.mtl"));
        let lines = &library["brick"].1;
        for line in ["Ka 0.1 0.2 0.3", "Kd 0.5 0.25 1", "Ks 0.5 0.5 0.5", "Ns 10", "illum 2"] {
            assert!(lines.iter().any(|own| own == line), "{line}: {lines:?}");
        }
        assert!(lines.contains(&"map_Bump one_textures/d.png".to_owned()), "{lines:?}");
        assert!(library["old wood"].1.contains(&"d 0.5".to_owned()));
        for (name, word) in [("brick", "first"), ("old wood", "second"), ("tile", "third")] {
            let image = library[name].0.clone().unwrap();
            assert_eq!(std::fs::read(&image).unwrap(), png(64, 64, word), "{image:?}");
            assert!(image.starts_with(folder.join("out/one_textures")), "{image:?}");
        }
        assert_eq!(library["red"].0, None);
    }
    // In the folder of the images nothing is copied.
    expect(folder, "convert scan/scan.obj scan/two.obj", 0);
    assert!(!folder.join("scan/two_textures").exists());
    assert_eq!(
        read_library(&folder.join("scan/two.mtl"))["tile"].0,
        Some(folder.join("scan/my images/d.png"))
    );
    // Linked and left out.
    expect(folder, "convert scan/scan.obj out/three.obj --textures link", 0);
    let image = read_library(&folder.join("out/three.mtl"))["tile"].0.clone().unwrap();
    assert!(image.ends_with("out/../scan/my images/d.png"), "{image:?}");
    expect(folder, "convert scan/scan.obj out/four.obj --textures none", 0);
    assert!(read_library(&folder.join("out/four.mtl")).values().all(|(image, _)| image.is_none()));
    for name in ["three", "four"] {
        assert!(!folder.join(format!("out/{name}_textures")).exists());
    }
    let said = expect(folder, "convert scan/scan.obj out/five.obj --textures embed", 2);
    assert!(said.contains("only GLB"), "{said}");
}

#[test]
fn nothing_changes_on_the_way_through_all_formats() {
    let folder = &scratch();
    scan(folder);
    let names = ["a.glb", "b.ply", "c.obj", "d.ply", "e.glb", "f.glb", "g.obj"];
    let mut before = "scan/scan.obj";
    for name in names {
        expect(folder, &format!("convert {before} {name}"), 0);
        before = name;
        expect(folder, &format!("convert {name} {name}.obj --textures link --force"), 0);
        let obj = read_obj(&folder.join(format!("{name}.obj")));
        assert_eq!(obj.faces.len(), 2 * N * N, "{name}");
        let mut obj = obj;
        // PLY counts images: a material without one has no number there, so later faces have none.
        let has_red = name == "a.glb";
        for face in obj.faces.iter_mut().filter(|_| !has_red) {
            assert_ne!(face.0, "red");
            if face.0.is_empty() || face.0 == "none" {
                face.0 = "red".to_owned();
            }
        }
        assert_right(&obj, 2e-5);
        let library = read_library(&folder.join(format!("{name}.mtl")));
        for (material, word) in [("brick", "first"), ("old wood", "second"), ("tile", "third")] {
            let image = library[material].0.clone().unwrap();
            assert_eq!(std::fs::read(&image).unwrap(), png(64, 64, word), "{name} {image:?}");
        }
    }
    // Images keep their names inside of GLB.
    assert!(
        folder.join("b_textures/b_c.png").exists() || folder.join("b_textures/b c.png").exists()
    );
    // Simplified from any to any.
    for (input, output) in
        [("a.glb", "s.obj"), ("b.ply", "s.glb"), ("c.obj", "s.ply"), ("e.glb", "t.glb")]
    {
        expect(folder, &format!("simplify {input} {output} --ratio 50% -q"), 0);
        expect(folder, &format!("convert {output} {output}.obj --textures link"), 0);
        let obj = read_obj(&folder.join(format!("{output}.obj")));
        assert!(obj.faces.len() <= N * N && obj.n_switches <= 5, "{output}");
        let used: BTreeSet<&str> = obj.faces.iter().map(|(name, _)| name.as_str()).collect();
        assert!(["brick", "old wood", "tile"].iter().all(|name| used.contains(name)), "{used:?}");
    }
}

#[test]
fn images_that_cannot_be_used_are_named_and_nothing_fails() {
    let folder = &scratch();
    let mut cut = png(64, 64, "cut");
    cut.truncate(34);
    std::fs::write(folder.join("huge.png"), png(100_000, 100_000, "")).unwrap();
    std::fs::write(folder.join("cut.png"), cut).unwrap();
    std::fs::write(folder.join("text.png"), "no image at all").unwrap();
    std::fs::create_dir(folder.join("folder.png")).unwrap();
    let (mut library, mut text) = (String::new(), String::from("mtllib in.mtl\nmtllib gone.mtl\n"));
    for (i, name) in ["huge", "cut", "text", "folder", "missing"].iter().enumerate() {
        library += &format!("newmtl {name}\nmap_Kd {name}.png\n");
        text += &format!(
            "v {i} 0 0\nv {i} 1 0\nv {i} 0 1\nvt nan 0\nvt 7 -3\nvt 1 1\nusemtl {name}\n\
             f -3/-3 -2/-2 -1/-1\n"
        );
    }
    text += "usemtl unknown\nf 1/1 2/2 6/3\n";
    std::fs::write(folder.join("in.mtl"), library).unwrap();
    std::fs::write(folder.join("in.obj"), text).unwrap();
    for output in ["out.obj", "out.ply", "out.glb"] {
        let said = expect(folder, &format!("convert in.obj {output}"), 0);
        for words in [
            "100000 x 100000 pixels",
            "cut.png' (material 'cut') is doubtful: its end is missing",
            "text.png' (material 'text') is not an image",
            "missing.png' (material 'missing') is not there",
            "folder.png' ",
            "gone.mtl is not there",
            "materials: in no library",
        ] {
            assert!(said.contains(words), "{output}: {words}\n{said}");
        }
    }
    // The name stays, so that the image can be put there later.
    let library = read_library(&folder.join("out.mtl"));
    assert_eq!(library["missing"].0, Some(folder.join("missing.png")));
    // Coordinates beyond 0 to 1 are tiling; those that are not numbers become 0.
    let obj = read_obj(&folder.join("out.obj"));
    assert!(obj.faces.iter().flat_map(|f| f.1).any(|c| c.1 == [7.0, -3.0]));
    expect(folder, "convert out.glb again.obj", 0);
    let obj = read_obj(&folder.join("again.obj"));
    assert_eq!(obj.faces.len(), 6);
    assert!(obj.faces.iter().flat_map(|f| f.1).any(|c| c.1 == [7.0, -3.0]));
}

#[test]
fn files_of_others_beside_the_output_stay() {
    let folder = &scratch();
    scan(folder);
    std::fs::write(folder.join("out.mtl"), "newmtl mine\n").unwrap();
    let said = expect(folder, "convert scan/scan.obj out.obj --textures link", 2);
    assert!(said.contains("out.mtl exists and was not written by stonecut"), "{said}");
    assert!(!folder.join("out.obj").exists());
    expect(folder, "convert scan/scan.obj out.obj --textures link --force", 0);
    // An earlier library of this program is replaced like the output.
    expect(folder, "convert scan/scan.obj out.obj --textures none --force", 0);
    std::fs::rename(folder.join("scan/scan lib.mtl"), folder.join("scan/two.mtl")).unwrap();
    let text = std::fs::read_to_string(folder.join("scan/scan.obj")).unwrap();
    std::fs::write(folder.join("scan/scan.obj"), text.replace("scan lib.mtl", "two.mtl")).unwrap();
    let said = expect(folder, "simplify scan/scan.obj scan/two.obj --ratio 50% --force", 2);
    assert!(said.contains("material library of the input"), "{said}");
    // Another image of the same name.
    std::fs::create_dir_all(folder.join("out/x_textures")).unwrap();
    std::fs::write(folder.join("out/x_textures/d.png"), png(1, 1, "mine")).unwrap();
    for command in
        ["convert scan/scan.obj out/x.obj", "simplify scan/scan.obj out/x.obj --ratio 50%"]
    {
        let said = expect(folder, command, 2);
        assert!(said.contains("is another image"), "{said}");
    }
    assert!(!folder.join("out/x.mtl").exists() && !folder.join("out/x.obj").exists());
}

#[test]
fn a_stopped_run_ends_with_the_same_files() {
    let folder = &scratch();
    scan(folder);
    for name in ["first", "twice"] {
        std::fs::create_dir(folder.join(name)).unwrap();
    }
    for kind in ["obj", "ply", "glb"] {
        let command = |to: &str| format!("simplify scan/scan.obj {to}.{kind} --ratio 40% -q");
        expect(folder, &command("first/once"), 0);
        for stop in ["partition", "stitch"] {
            let at = folder.join(format!("twice/once.{kind}"));
            expect(folder, &format!("{} --until {stop}", command("twice/once")), 0);
            assert!(!at.exists() && !folder.join("twice/once_textures").exists());
        }
        expect(folder, &command("twice/once"), 0);
        let same = |name: &str| {
            let bytes = |file: PathBuf| std::fs::read(file).unwrap_or_default();
            bytes(folder.join("first").join(name)) == bytes(folder.join("twice").join(name))
        };
        assert!(same(&format!("once.{kind}")) && same("once.mtl"), "{kind}");
        let has_copy = folder.join("twice/once_textures/d.png").exists();
        assert!(has_copy != (kind == "glb") && same("once_textures/d.png"), "{kind}");
        assert!(folder.join(format!("twice/once.{kind}")).exists());
        for name in ["first", "twice"] {
            let _ = std::fs::remove_dir_all(folder.join(name).join("once_textures"));
        }
    }
    // The report names what was done.
    expect(folder, "simplify scan/scan.obj r.glb --ratio 40% -q --report r.json", 0);
    let report = json(folder, "r.json");
    let textures = &report["textures"];
    assert_eq!((textures["materials"].as_u64(), textures["images"].as_u64()), (Some(4), Some(3)));
    let notes = textures["notes"].to_string();
    for words in
        ["highlights of material 'brick': GLB has no place", "image of heights", "ambient colour"]
    {
        assert!(notes.contains(words), "{words}: {notes}");
    }
}

/// A quad in two materials as glTF: bytes as indices, a strip, a mirrored node inside a turned one, images in and
/// beside the file.
fn gltf() -> String {
    let mut bytes = Vec::new();
    for p in [[0.0f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]] {
        bytes.extend(p.iter().flat_map(|x| x.to_le_bytes()));
    }
    for uv in [[0u16, 65_535], [65_535, 65_535], [0, 0], [65_535, 0]] {
        bytes.extend(uv.iter().flat_map(|x| x.to_le_bytes()));
    }
    bytes.extend([0u8, 1, 2, 1, 3, 2, 0, 1, 2, 3]);
    use base64::Engine;
    let engine = base64::engine::general_purpose::STANDARD;
    let (data, image) = (engine.encode(&bytes), engine.encode(png(8, 8, "inside")));
    format!(
        r#"{{"asset": {{"version": "2.0"}}, "scene": 0, "scenes": [{{"nodes": [0]}}],
        "extensionsRequired": ["KHR_mesh_quantization", "KHR_texture_transform"],
        "nodes": [{{"translation": [500000.125, 0, 0], "children": [1, 2]}},
            {{"mesh": 0}}, {{"mesh": 1, "scale": [-1, 1, 1]}}],
        "meshes": [{{"primitives": [{{"attributes": {{"POSITION": 0, "TEXCOORD_0": 1}}, "indices": 2, "material": 0}}]}},
            {{"primitives": [{{"attributes": {{"POSITION": 0, "TEXCOORD_0": 1}}, "indices": 3, "mode": 5, "material": 1}}]}}],
        "materials": [{{"name": "in", "pbrMetallicRoughness": {{"baseColorTexture": {{"index": 0}}, "baseColorFactor": [1, 0.5, 0.25, 1]}}, "doubleSided": true}},
            {{"name": "beside", "alphaMode": "MASK", "pbrMetallicRoughness": {{"baseColorTexture": {{"index": 1,
                "extensions": {{"KHR_texture_transform": {{"scale": [0.5, 0.25], "offset": [0.5, 0]}}}}}}}}}}],
        "textures": [{{"source": 0}}, {{"source": 1, "sampler": 0}}], "samplers": [{{"wrapS": 33071}}],
        "images": [{{"uri": "data:image/png;base64,{image}", "name": "inner"}}, {{"uri": "be%20side.png"}}],
        "accessors": [{{"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"}},
            {{"bufferView": 0, "byteOffset": 48, "componentType": 5123, "normalized": true, "count": 4, "type": "VEC2"}},
            {{"bufferView": 0, "byteOffset": 64, "componentType": 5121, "count": 6, "type": "SCALAR"}},
            {{"bufferView": 0, "byteOffset": 70, "componentType": 5121, "count": 4, "type": "SCALAR"}}],
        "bufferViews": [{{"buffer": 0, "byteLength": 74}}],
        "buffers": [{{"byteLength": 74, "uri": "data:application/octet-stream;base64,{data}"}}]}}"#
    )
}

#[test]
fn gltf_is_read_with_its_places_and_its_coordinates() {
    let folder = &scratch();
    std::fs::write(folder.join("in.gltf"), gltf()).unwrap();
    std::fs::write(folder.join("be side.png"), png(8, 8, "beside")).unwrap();
    let said = expect(folder, "convert in.gltf out.obj", 0);
    assert!(said.contains("drawing of both sides of material 'in'"), "{said}");
    let obj = read_obj(&folder.join("out.obj"));
    assert_eq!(obj.faces.len(), 4);
    for (name, corners) in &obj.faces {
        for (p, uv) in corners {
            let x = p[0] - 500_000.125;
            let wanted = match name.as_str() {
                "in" => [x, p[1]],
                _ => [0.5 - 0.5 * x, 1.0 - 0.25 * (1.0 - p[1])],
            };
            assert!((0..2).all(|k| (uv[k] - wanted[k]).abs() < 1e-6), "{name} {p:?} {uv:?}");
        }
        // The mirror keeps the upper side up.
        let [a, b, c] = corners.map(|corner| corner.0);
        let up = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        assert!(up > 0.0, "{corners:?}");
    }
    let library = read_library(&folder.join("out.mtl"));
    assert_eq!(library["beside"].0, Some(folder.join("be side.png")));
    assert_eq!(std::fs::read(library["in"].0.clone().unwrap()).unwrap(), png(8, 8, "inside"));
    // Linear light in glTF, as screens show it in a library.
    let kd = library["in"].1.iter().find_map(|line| line.strip_prefix("Kd ")).unwrap();
    let kd: Vec<f64> = kd.split(' ').map(|x| x.parse().unwrap()).collect();
    let close = [1.0, 0.735_357, 0.537_099].iter().zip(&kd).all(|(a, b)| (a - b).abs() < 1e-5);
    assert!(close && kd.len() == 3, "{library:?}");
    expect(folder, "convert in.gltf out.glb", 0);
    let bytes = std::fs::read(folder.join("out.glb")).unwrap();
    let text = String::from_utf8_lossy(&bytes).into_owned();
    for words in [r#""alphaMode":"MASK""#, r#""doubleSided":true"#, r#""wrapS":33071"#] {
        assert!(text.contains(words), "{words}");
    }
    let factor =
        text.split(r#""baseColorFactor":["#).nth(1).and_then(|rest| rest.split(']').next());
    let factor: Vec<f64> = factor.unwrap().split(',').map(|x| x.parse().unwrap()).collect();
    let same = [1.0, 0.5, 0.25, 1.0].iter().zip(&factor).all(|(a, b)| (a - b).abs() < 1e-6);
    assert!(same && factor.len() == 4, "{factor:?}");
    assert!(crate::common::rms(folder, "in.gltf", "out.glb") < 2e-5);
    // Floats, from a corner that is a double.
    expect(folder, "convert in.gltf float.glb --format float", 0);
    let bytes = std::fs::read(folder.join("float.glb")).unwrap();
    assert!(!String::from_utf8_lossy(&bytes).contains("KHR_mesh_quantization"));
    assert!(crate::common::rms(folder, "in.gltf", "float.glb") < 1e-9);
    let said = expect(folder, "convert in.gltf double.glb --format double", 2);
    assert!(said.contains("float"), "{said}");
}

#[test]
fn meshopt_compression_is_unpacked() {
    use meshopt_rs::index::{IndexEncodingVersion, buffer::encode_index_buffer};
    use meshopt_rs::vertex::{VertexEncodingVersion, buffer::encode_vertex_buffer};
    let folder = tempfile::tempdir().unwrap();
    let n = 40u32;
    let mut vertices: Vec<[u8; 8]> = Vec::new();
    let mut indices = Vec::new();
    for v in 0..n * n {
        let [x, y, z] = [v % n, v / n, v % 7].map(|x| (x as u16).to_le_bytes());
        vertices.push([x[0], x[1], y[0], y[1], z[0], z[1], 0, 0]);
        if v % n + 1 < n && v / n + 1 < n {
            indices.extend([v, v + 1, v + n, v + 1, v + n + 1, v + n]);
        }
    }
    let mut packed = vec![0; 1 << 20];
    let n_vertex_bytes =
        encode_vertex_buffer(&mut packed, &vertices, VertexEncodingVersion::default()).unwrap();
    let mut binary = packed[..n_vertex_bytes].to_vec();
    binary.resize(n_vertex_bytes.next_multiple_of(4), 0);
    let at = binary.len();
    let n_index_bytes =
        encode_index_buffer(&mut packed, &indices, IndexEncodingVersion::default()).unwrap();
    binary.extend(&packed[..n_index_bytes]);
    let (n_vertices, n_indices) = (vertices.len(), indices.len());
    let text = format!(
        r#"{{"asset": {{"version": "2.0"}}, "nodes": [{{"mesh": 0, "scale": [2, 2, 2]}}],
        "extensionsRequired": ["KHR_mesh_quantization", "EXT_meshopt_compression"],
        "meshes": [{{"primitives": [{{"attributes": {{"POSITION": 0}}, "indices": 1}}]}}],
        "accessors": [{{"bufferView": 0, "componentType": 5123, "count": {n_vertices}, "type": "VEC3"}},
            {{"bufferView": 1, "componentType": 5125, "count": {n_indices}, "type": "SCALAR"}}],
        "bufferViews": [{{"buffer": 1, "byteLength": {}, "byteStride": 8, "extensions": {{"EXT_meshopt_compression":
                {{"buffer": 0, "byteLength": {n_vertex_bytes}, "byteStride": 8, "count": {n_vertices}, "mode": "ATTRIBUTES"}}}}}},
            {{"buffer": 1, "byteLength": {}, "extensions": {{"EXT_meshopt_compression":
                {{"buffer": 0, "byteOffset": {at}, "byteLength": {n_index_bytes}, "byteStride": 4, "count": {n_indices}, "mode": "TRIANGLES"}}}}}}],
        "buffers": [{{"byteLength": {}}}, {{"byteLength": {}, "extensions": {{"EXT_meshopt_compression": {{"fallback": true}}}}}}]}}"#,
        8 * n_vertices,
        4 * n_indices,
        binary.len(),
        8 * n_vertices + 4 * n_indices
    );
    let file = glb(&text, &binary);
    std::fs::write(folder.path().join("in.glb"), &file).unwrap();
    expect(folder.path(), "convert in.glb out.ply", 0);
    let json = printed(folder.path(), "info --json out.ply");
    assert_eq!(json["vertices"], n_vertices);
    assert_eq!(json["triangles"], n_indices / 3);
    // Damage is found or harmless, never a panic.
    let options = StageOptions::new(folder.path());
    let first = file.len() - binary.len();
    for i in (first..file.len()).step_by(7) {
        let mut bytes = file.clone();
        bytes[i] ^= 0x55;
        let _ = MeshSource::staged_from_bytes("in.glb", bytes, &options);
    }
    // What does not fit into memory is refused.
    let tight = StageOptions { memory_bytes: 4096, parse_bytes: 4096, ..options };
    let error = MeshSource::staged_from_bytes("in.glb", file, &tight).err().unwrap().to_string();
    assert!(error.contains("--memory"), "{error}");
}

fn glb(text: &str, binary: &[u8]) -> Vec<u8> {
    let mut json = text.as_bytes().to_vec();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut binary = binary.to_vec();
    binary.resize(binary.len().next_multiple_of(4), 0);
    let mut out = b"glTF".to_vec();
    for word in [2, 28 + json.len() + binary.len(), json.len()] {
        out.extend((word as u32).to_le_bytes());
    }
    out.extend(b"JSON");
    out.extend(json);
    out.extend((binary.len() as u32).to_le_bytes());
    out.extend(b"BIN\0");
    out.extend(binary);
    out
}

#[test]
fn broken_gltf_is_refused_in_words() {
    let options = StageOptions::new(std::env::temp_dir());
    let open = |text: &str| {
        let opened = MeshSource::staged_from_bytes("a.gltf", text.as_bytes().to_vec(), &options);
        opened.err().map(|error| error.to_string()).unwrap_or_default()
    };
    assert_eq!(open(&gltf()), "");
    for (from, to, words) in [
        (r#""version": "2.0""#, r#""version": "1.0""#, "version '1.0'"),
        (r#""KHR_mesh_quantization""#, r#""EXT_mesh_features""#, "gltf-transform"),
        (r#""KHR_mesh_quantization""#, r#""FOO_bar""#, "FOO_bar"),
        (r#""count": 6"#, r#""count": 600"#, "lie beyond its bufferView"),
        (
            r#""count": 4, "type": "VEC3""#,
            r#""count": 18446744073709551615, "type": "VEC3""#,
            "of temporary data",
        ),
        (r#""count": 4, "type": "VEC3""#, r#""count": 3, "type": "VEC3""#, "has 4 elements"),
        (r#""byteLength": 74}]"#, r#""byteLength": 75}]"#, "lie beyond its buffer"),
        (r#""byteLength": 74, "uri""#, r#""byteLength": 99, "uri""#, "cut off"),
        (r#""children": [1, 2]"#, r#""children": [1, 0]"#, "circle"),
        (r#""children": [1, 2]"#, r#""children": [9]"#, "node 9"),
        (r#""children": [1, 2]"#, r#""children": []"#, "no triangles"),
        (r#"{"mesh": 0}"#, r#"{"mesh": 5}"#, "mesh 5"),
        (r#""indices": 2"#, r#""indices": 77"#, "accessor 77"),
        (r#""material": 0"#, r#""material": 8"#, "material 8"),
        (
            r#""bufferView": 0, "byteOffset": 64"#,
            r#""bufferView": 0, "byteOffset": 14"#,
            "names vertex",
        ),
        (r#""componentType": 5126"#, r#""componentType": 1"#, "componentType 1"),
        (
            "data:application/octet-stream;base64,",
            "data:application/octet-stream;base64,!",
            "base64",
        ),
        ("data:application/octet-stream;base64,", "https://example.org/", "fetch it first"),
        (r#""scene": 0"#, r#""scene": {"#, "JSON is not that of glTF"),
    ] {
        let text = gltf();
        assert!(text.contains(from), "{from}");
        let error = open(&text.replacen(from, to, 1));
        assert!(error.contains(words), "{to}: {error}");
    }
    // No prefix of a file makes a panic.
    let text = gltf();
    let file = glb(&text, b"1234");
    for n in 0..file.len() {
        let _ = MeshSource::staged_from_bytes("a.glb", file[..n].to_vec(), &options);
    }
    for n in (0..text.len()).step_by(11) {
        assert_ne!(open(&text[..n]), "", "{n}");
    }
}
