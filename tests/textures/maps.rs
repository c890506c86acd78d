//! Maps of the input besides its colours are baked like these: directions, emitted light, roughness, metal, shade.

use crate::bake::{look_up, points_of, sheet};
use crate::common::{expect, glb_json, scratch};
use crate::normals::{degrees_between, directions, dot, read, unit};
use base64::Engine;
use image::{Luma, Rgb, RgbImage};
use serde_json::json;
use std::path::Path;

/// Images of several sizes whose values rise along a coordinate, and a normal map that leans towards u on the left, towards v on the right.
fn images(folder: &Path) {
    let share = |x: u32, n: u32| (255.0 * (f64::from(x) + 0.5) / f64::from(n)) as u8;
    let colour = RgbImage::from_fn(32, 32, |x, y| Rgb([90, share(x, 32), share(y, 32)]));
    let light = RgbImage::from_fn(64, 32, |x, y| Rgb([share(x, 64), 0, 255 - share(y, 32)]));
    let rough = image::GrayImage::from_fn(16, 16, |x, _| Luma([share(x, 16)]));
    let metal = image::GrayImage::from_fn(48, 48, |_, y| Luma([255 - share(y, 48)]));
    let normal = RgbImage::from_fn(64, 64, |x, _| {
        Rgb(if x < 32 { [204, 128, 230] } else { [128, 204, 230] })
    });
    colour.save(folder.join("colour.png")).unwrap();
    light.save(folder.join("light.png")).unwrap();
    rough.save(folder.join("rough.png")).unwrap();
    metal.save(folder.join("metal.png")).unwrap();
    normal.save(folder.join("normal.png")).unwrap();
}

const LIBRARY: &str = "newmtl only\nKd 1 1 1\nKe 1 1 1\nmap_Kd colour.png\nmap_Ke light.png\nmap_Pr rough.png\n\
    map_Pm metal.png\nnorm normal.png\n";

/// The image that a library names in a line.
fn page(folder: &Path, name: &str, word: &str) -> RgbImage {
    let library = std::fs::read_to_string(folder.join(format!("{name}.mtl"))).unwrap();
    let path = library.lines().find_map(|line| line.strip_prefix(word));
    let path = path.unwrap_or_else(|| panic!("{word}\n{library}"));
    image::open(folder.join(path.trim())).unwrap().into_rgb8()
}

/// The image of a GLB whose name has this end.
pub fn embedded(path: &Path, end: &str) -> RgbImage {
    let (bytes, document) = (std::fs::read(path).unwrap(), glb_json(path));
    let binary = 28 + u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    let images = document["images"].as_array().unwrap();
    let image = images.iter().find(|image| image["name"].as_str().unwrap().ends_with(end));
    let view = &document["bufferViews"][image.unwrap()["bufferView"].as_u64().unwrap() as usize];
    let [at, n] = ["byteOffset", "byteLength"].map(|key| view[key].as_u64().unwrap() as usize);
    image::load_from_memory(&bytes[binary + at..][..n]).unwrap().into_rgb8()
}

/// The numbers of an accessor of a GLB, as they are stored.
fn numbers(path: &Path, accessor: &serde_json::Value) -> Vec<Vec<f64>> {
    let (bytes, document) = (std::fs::read(path).unwrap(), glb_json(path));
    let accessor = &document["accessors"][accessor.as_u64().unwrap() as usize];
    let view = &document["bufferViews"][accessor["bufferView"].as_u64().unwrap() as usize];
    let of = |value: &serde_json::Value| value.as_u64().unwrap_or(0) as usize;
    let binary = 28 + u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    let start = binary + of(&view["byteOffset"]) + of(&accessor["byteOffset"]);
    let width = ["SCALAR", "", "VEC2", "VEC3", "VEC4"];
    let width = width.iter().position(|kind| accessor["type"] == **kind).unwrap().max(1);
    let n_bytes = match of(&accessor["componentType"]) {
        5121 => 1,
        5123 => 2,
        _ => 4,
    };
    let is_float = accessor["componentType"] == 5126;
    let stride = match of(&view["byteStride"]) {
        0 => width * n_bytes,
        stride => stride,
    };
    let number = |row: usize, k: usize| {
        let at = start + row * stride + k * n_bytes;
        let mut word = [0; 4];
        word[..n_bytes].copy_from_slice(&bytes[at..at + n_bytes]);
        if is_float {
            f64::from(f32::from_le_bytes(word))
        } else {
            f64::from(u32::from_le_bytes(word))
        }
    };
    (0..of(&accessor["count"])).map(|row| (0..width).map(|k| number(row, k)).collect()).collect()
}

/// Coordinates turned by a quarter, and mirrored: the frames of the input are not those of the result.
#[test]
fn maps_besides_colour_are_baked() {
    for (name, uv) in
        [("turned", (|x, y| [y, 1.0 - x]) as fn(f64, f64) -> [f64; 2]), ("mirrored", |x, y| [y, x])]
    {
        let folder = &scratch();
        images(folder);
        let text = |x: f64, y: f64| {
            let [u, v] = uv(x, y);
            format!("{u} {v}")
        };
        sheet(folder, text, LIBRARY);
        let command = format!("simplify sheet.obj {name}.obj --ratio 20% --texture bake");
        let said = expect(folder, &command, 0);
        assert!(
            !said.contains("not baked") && said.contains("texture of image of metal"),
            "{said}"
        );
        assert!(!folder.join(format!("{name}.obj.stonecut-job")).exists(), "{name}");
        let (faces, map) = read(folder, name);
        let pages = ["map_Ke", "map_Pr", "map_Pm"].map(|word| (word, page(folder, name, word)));
        for face in &faces {
            let corners = face.map(|([x, y, _], [u, v], _)| [x, y, u, v]);
            for [x, y, u, v] in points_of(corners) {
                let [s, t] = uv(x, y);
                // Beyond the middles of the first and last pixels images repeat.
                if [s, t].iter().any(|x| !(0.04..0.96).contains(x)) {
                    continue;
                }
                let [light, rough, metal] = pages.each_ref().map(|(_, page)| look_up(page, [u, v]));
                for (seen, wanted) in
                    [(light[0], s), (light[2], t), (light[1], 0.0), (rough[0], s), (metal[1], t)]
                {
                    assert!((seen - 255.0 * wanted).abs() < 8.0, "{name} {x} {y}: {seen} {wanted}");
                }
            }
        }
        let mut off: Vec<f64> = Vec::new();
        for ([x, y, _], seen) in directions(&faces, &map) {
            let slopes = [
                0.1 * (5.0 * x).cos() * (4.0 * y).cos(),
                -0.08 * (5.0 * x).sin() * (4.0 * y).sin(),
            ];
            let normal = unit([-slopes[0], -slopes[1], 1.0]);
            // The direction along the sheet in which the coordinate rises that the map leans to.
            let [s, t] = uv(x, y);
            let (leans_to_u, is_clear) =
                (s < 0.5, (0.05..0.95).contains(&s) && (s - 0.5).abs() > 0.05);
            if !is_clear || !(0.05..0.95).contains(&t) {
                continue;
            }
            let along = match (leans_to_u, name) {
                (true, _) => [0.0, 1.0, 0.0],
                (false, "turned") => [-1.0, 0.0, 0.0],
                (false, _) => [1.0, 0.0, 0.0],
            };
            let up = dot(along, normal);
            let across = unit([0, 1, 2].map(|k| along[k] - up * normal[k]));
            let wanted = [0, 1, 2].map(|k| 0.6 * across[k] + 0.8 * normal[k]);
            off.push(degrees_between(seen, wanted));
        }
        off.sort_by(f64::total_cmp);
        assert!(off[off.len() / 2] < 1.5 && off[off.len() * 98 / 100] < 5.0, "{name}: {off:?}");
        // GLB has roughness and metal in one image, in the same places.
        expect(folder, &format!("simplify sheet.obj {name}.glb --ratio 20% --texture bake -q"), 0);
        let surface = embedded(&folder.join(format!("{name}.glb")), "_surface");
        let [_, (_, rough), (_, metal)] = &pages;
        let same = surface.pixels().zip(rough.pixels()).zip(metal.pixels());
        assert!(
            same.clone().all(|((both, rough), metal)| both[1] == rough[0] && both[2] == metal[0])
        );
        assert_eq!(embedded(&folder.join(format!("{name}.glb")), "_emission"), pages[0].1);
        let material = &glb_json(&folder.join(format!("{name}.glb")))["materials"][0];
        assert!(material["normalTexture"].is_object() && material["emissiveTexture"].is_object());
        assert_eq!(material["emissiveFactor"], json!([1.0, 1.0, 1.0]));
        assert_eq!(material["pbrMetallicRoughness"]["metallicFactor"], 1.0);
    }
}

/// Two squares of glTF: one has an image of shade, both have the same one of roughness and metal, of another factor.
#[test]
fn shade_and_factors_of_gltf_are_baked() {
    let folder = &scratch();
    let shade = RgbImage::from_pixel(8, 8, Rgb([100, 7, 9]));
    shade.save(folder.join("shade.png")).unwrap();
    RgbImage::from_pixel(4, 4, Rgb([0, 200, 50])).save(folder.join("surface.png")).unwrap();
    let bytes = crate::opacity::two_squares([[0.0, 0.0, 1.0], [2.0, 0.0, 1.0]]);
    let data = base64::engine::general_purpose::STANDARD.encode(&bytes);
    let accessor = |at: usize, component: u32, count: u32, kind: &str| json!({ "bufferView": 0, "byteOffset": at, "componentType": component, "count": count, "type": kind });
    let square = |positions: u32, material: u32| json!({ "attributes": { "POSITION": positions, "TEXCOORD_0": 2 }, "indices": 3, "material": material });
    let surface = |factor: f64| json!({ "metallicRoughnessTexture": { "index": 1 }, "roughnessFactor": factor });
    let document = json!({
        "asset": { "version": "2.0" },
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "mesh": 0 }],
        "meshes": [{ "primitives": [square(0, 0), square(1, 1)] }],
        "materials": [
            { "pbrMetallicRoughness": surface(1.0), "occlusionTexture": { "index": 0 } },
            { "pbrMetallicRoughness": surface(0.5), "emissiveFactor": [0, 0, 1] },
        ],
        "textures": [{ "source": 0 }, { "source": 1 }],
        "images": [{ "uri": "shade.png" }, { "uri": "surface.png" }],
        "accessors": [
            accessor(0, 5126, 4, "VEC3"), accessor(48, 5126, 4, "VEC3"), accessor(96, 5126, 4, "VEC2"),
            accessor(128, 5121, 6, "SCALAR"),
        ],
        "bufferViews": [{ "buffer": 0, "byteLength": bytes.len() }],
        "buffers": [{
            "byteLength": bytes.len(), "uri": format!("data:application/octet-stream;base64,{data}"),
        }],
    });
    std::fs::write(folder.join("in.gltf"), document.to_string()).unwrap();
    let said = expect(folder, "simplify in.gltf out.glb --triangles 4 --texture bake", 0);
    assert!(!said.contains("not baked"), "{said}");
    let count =
        |image: &RgbImage, wanted: [u8; 3]| image.pixels().filter(|p| p.0 == wanted).count();
    let out = folder.join("out.glb");
    let surface = embedded(&out, "_surface");
    assert!(count(&surface, [100, 200, 50]) > 60 && count(&surface, [255, 100, 50]) > 60);
    let light = embedded(&out, "_emission");
    assert!(count(&light, [0, 0, 255]) > 60 && count(&light, [0; 3]) > 60);
    let material = &glb_json(&out)["materials"][0];
    assert_eq!(
        material["occlusionTexture"],
        material["pbrMetallicRoughness"]["metallicRoughnessTexture"]
    );
    // OBJ has no place for shade, and says so.
    let said = expect(folder, "simplify in.gltf out.obj --triangles 4 --texture bake", 0);
    assert!(said.contains("image of ambient shade") && said.contains("not baked"), "{said}");
}

/// A square of glTF whose images have strengths and places: those of the input are kept, and a new texture has their effect.
#[test]
fn strengths_and_places_of_images_are_kept_and_baked() {
    let folder = &scratch();
    for (name, colour) in
        [("a.png", [200, 40, 0]), ("b.png", [100, 0, 0]), ("c.png", [192, 128, 222])]
    {
        RgbImage::from_pixel(8, 8, Rgb(colour)).save(folder.join(name)).unwrap();
    }
    let half = |x: u32, _| if x < 4 { Rgb([0, 0, 255]) } else { Rgb([0, 255, 0]) };
    RgbImage::from_fn(8, 8, half).save(folder.join("d.png")).unwrap();
    let bytes = crate::opacity::two_squares([[0.0, 0.0, 1.0], [2.0, 0.0, 1.0]]);
    let data = base64::engine::general_purpose::STANDARD.encode(&bytes);
    let accessor = |at: usize, component: u32, count: u32, kind: &str| json!({ "bufferView": 0, "byteOffset": at, "componentType": component, "count": count, "type": kind });
    let halved = json!({ "KHR_texture_transform": { "scale": [0.5, 1.0], "offset": [0.5, 0.0] } });
    let document = json!({
        "asset": { "version": "2.0" },
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "mesh": 0 }],
        "meshes": [{ "primitives": [
            { "attributes": { "POSITION": 0, "TEXCOORD_0": 1 }, "indices": 2, "material": 0 },
        ] }],
        "materials": [{
            "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } },
            "occlusionTexture": { "index": 1, "strength": 0.5 },
            "normalTexture": { "index": 2, "scale": 0.5 },
            "emissiveTexture": { "index": 3, "extensions": halved },
            "emissiveFactor": [1, 1, 1],
            "extensions": { "KHR_materials_emissive_strength": { "emissiveStrength": 4.0 } },
        }],
        "textures": [{ "source": 0 }, { "source": 1 }, { "source": 2 }, { "source": 3 }],
        "images": [{ "uri": "a.png" }, { "uri": "b.png" }, { "uri": "c.png" }, { "uri": "d.png" }],
        "accessors": [
            accessor(0, 5126, 4, "VEC3"), accessor(96, 5126, 4, "VEC2"), accessor(128, 5121, 6, "SCALAR"),
        ],
        "bufferViews": [{ "buffer": 0, "byteLength": bytes.len() }],
        "buffers": [{
            "byteLength": bytes.len(), "uri": format!("data:application/octet-stream;base64,{data}"),
        }],
    });
    std::fs::write(folder.join("in.gltf"), document.to_string()).unwrap();
    let strength = |material: &serde_json::Value| {
        material["extensions"]["KHR_materials_emissive_strength"]["emissiveStrength"].as_f64()
    };
    let said = expect(folder, "convert in.gltf kept.glb", 0);
    assert!(!said.contains("carried"), "{said}");
    let kept = &glb_json(&folder.join("kept.glb"))["materials"][0];
    assert_eq!(
        (&kept["normalTexture"]["scale"], &kept["occlusionTexture"]["strength"]),
        (&json!(0.5), &json!(0.5))
    );
    assert_eq!((&kept["emissiveTexture"]["extensions"], strength(kept)), (&halved, Some(4.0)));
    let said = expect(folder, "convert in.gltf kept.obj", 0);
    assert!(said.contains("strength of the normal map"), "{said}");
    assert!(said.contains("strength of emitted light"), "{said}");
    for mesh in ["in.gltf", "kept.glb"] {
        let said = expect(
            folder,
            &format!("simplify {mesh} out.glb --triangles 2 --texture bake --force"),
            0,
        );
        assert!(!said.contains("not baked") && !said.contains("carried"), "{said}");
        let out = folder.join("out.glb");
        assert_eq!(strength(&glb_json(&out)["materials"][0]), Some(4.0));
        let middle = |end: &str| {
            let page = embedded(&out, end);
            page.get_pixel(page.width() / 2, page.height() / 2).0
        };
        assert!(middle("_surface")[0].abs_diff(178) < 2, "{:?}", middle("_surface"));
        let [x, y, _] = middle("_normal");
        let slopes = [x.abs_diff(169).min(x.abs_diff(86)), y.abs_diff(169).min(y.abs_diff(86))];
        assert!(slopes.iter().any(|off| *off < 3), "{:?}", middle("_normal"));
        let light = embedded(&out, "_emission");
        let n = [[0, 255, 0], [0, 0, 255]]
            .map(|wanted| light.pixels().filter(|pixel| pixel.0 == wanted).count());
        assert!(n[0] > 20 && n[0] > 4 * n[1], "{n:?} green and blue");
    }
}

/// Two squares of glTF, of which one has colours of vertices: the other one's material is seen in OBJ and PLY, too.
#[test]
fn vertices_without_a_colour_show_their_material() {
    let folder = &scratch();
    tinted_squares(folder);
    let text = std::fs::read_to_string(folder.join("both.gltf")).unwrap();
    let mut document: serde_json::Value = serde_json::from_str(&text).unwrap();
    let attributes = &mut document["meshes"][0]["primitives"];
    attributes[0]["attributes"].as_object_mut().unwrap().remove("COLOR_0");
    attributes[1]["material"] = 2.into();
    let white = document["materials"][0].take();
    document["materials"].as_array_mut().unwrap().push(json!({}));
    document["materials"][0] = white;
    std::fs::write(folder.join("in.gltf"), document.to_string()).unwrap();
    document["materials"][0] = json!({});
    let attributes = &mut document["meshes"][0]["primitives"][1]["attributes"];
    attributes.as_object_mut().unwrap().remove("TEXCOORD_0");
    std::fs::write(folder.join("plain.gltf"), document.to_string()).unwrap();
    for command in [
        "convert in.gltf",
        "convert plain.gltf",
        "simplify in.gltf --triangles 4",
        "simplify plain.gltf --triangles 4",
    ] {
        for kind in ["ply", "obj"] {
            let said = expect(folder, &format!("{command} out.{kind} --force"), 0);
            assert!(!said.contains("vertices without colour"), "{said}");
            assert!(!said.contains("lost: colour"), "{said}");
        }
        let wanted = FACTOR.map(|light| (255.0 * (1.055 * light.powf(1.0 / 2.4) - 0.055)).round());
        let lines = vertex_lines(folder, "out.ply");
        let is_wanted = |line: &&Vec<f64>| {
            line[3..6].iter().zip(wanted).all(|(share, byte)| (255.0 * share).round() == byte)
        };
        assert_eq!(lines.iter().filter(is_wanted).count(), 4, "{lines:?}");
        let text = std::fs::read_to_string(folder.join("out.obj")).unwrap();
        let n_bare =
            text.lines().filter(|line| line.starts_with("v ") && line.split(' ').count() == 4);
        assert_eq!(n_bare.count(), 4, "{text}");
    }
}

const COLOURS: [[f32; 3]; 2] = [[0.25, 0.5, 1.0], [0.5, 1.0, 0.25]];
const FACTOR: [f64; 3] = [0.5, 0.25, 0.75];

/// Two squares with colours of vertices, the first of a material with a colour, the second with an image: `both.gltf`, and
/// the first one alone: `plain.gltf`. Returns the light of both.
fn tinted_squares(folder: &Path) -> [[f64; 3]; 2] {
    RgbImage::from_pixel(8, 8, Rgb([200, 120, 60])).save(folder.join("image.png")).unwrap();
    let mut bytes = crate::opacity::two_squares([[0.0, 0.0, 1.0], [2.0, 0.0, 1.0]]);
    bytes.resize(136, 0);
    for colour in COLOURS.iter().flat_map(|colour| [colour; 4]) {
        bytes.extend(colour.map(f32::to_le_bytes).as_flattened());
    }
    let data = base64::engine::general_purpose::STANDARD.encode(&bytes);
    let accessor = |at: usize, component: u32, count: u32, kind: &str| json!({ "bufferView": 0, "byteOffset": at, "componentType": component, "count": count, "type": kind });
    let mut document = json!({
        "asset": { "version": "2.0" },
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "mesh": 0 }],
        "meshes": [{ "primitives": [
            { "attributes": { "POSITION": 0, "COLOR_0": 4 }, "indices": 3, "material": 1 },
            { "attributes": { "POSITION": 1, "COLOR_0": 5, "TEXCOORD_0": 2 }, "indices": 3, "material": 0 },
        ] }],
        "materials": [
            { "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } } },
            { "pbrMetallicRoughness": { "baseColorFactor": [FACTOR[0], FACTOR[1], FACTOR[2], 1.0] } },
        ],
        "textures": [{ "source": 0 }],
        "images": [{ "uri": "image.png" }],
        "accessors": [
            accessor(0, 5126, 4, "VEC3"), accessor(48, 5126, 4, "VEC3"), accessor(96, 5126, 4, "VEC2"),
            accessor(128, 5121, 6, "SCALAR"), accessor(136, 5126, 4, "VEC3"), accessor(184, 5126, 4, "VEC3"),
        ],
        "bufferViews": [{ "buffer": 0, "byteLength": bytes.len() }],
        "buffers": [{
            "byteLength": bytes.len(), "uri": format!("data:application/octet-stream;base64,{data}"),
        }],
    });
    std::fs::write(folder.join("both.gltf"), document.to_string()).unwrap();
    document["meshes"][0]["primitives"].as_array_mut().unwrap().pop();
    std::fs::write(folder.join("plain.gltf"), document.to_string()).unwrap();
    let image = [200.0, 120.0, 60.0].map(light);
    [0, 1].map(|i| [0, 1, 2].map(|k| f64::from(COLOURS[i][k]) * [FACTOR, image][i][k]))
}

fn light(shown: f64) -> f64 {
    ((shown / 255.0 + 0.055) / 1.055).powf(2.4)
}

/// Pixels of an image that show this light.
fn count_near(image: &RgbImage, wanted: &[f64; 3]) -> usize {
    let is_near =
        |p: &&Rgb<u8>| (0..3).all(|k| (light(f64::from(p.0[k])) - wanted[k]).abs() < 0.01);
    image.pixels().filter(is_near).count()
}

/// A viewer multiplies page, material and vertices, so a colour is in one of them.
#[test]
fn colours_of_vertices_are_counted_once() {
    let folder = &scratch();
    let wanted = tinted_squares(folder);
    for (input, n_triangles) in [("both", 4), ("plain", 2)] {
        let command = format!("simplify {input}.gltf out.glb --triangles 4 --texture bake --force");
        expect(folder, &command, 0);
        let out = folder.join("out.glb");
        let (document, page, mut n) = (glb_json(&out), embedded(&out, "_0"), 0);
        for primitive in document["meshes"][0]["primitives"].as_array().unwrap() {
            let attribute = |name: &str| numbers(&out, &primitive["attributes"][name]);
            let (places, ids) = (attribute("TEXCOORD_0"), numbers(&out, &primitive["indices"]));
            let has_colours = primitive["attributes"]["COLOR_0"].is_u64();
            let white = || vec![vec![65_535.0; 4]; places.len()];
            let values = if has_colours { attribute("COLOR_0") } else { white() };
            for t in ids.as_chunks::<3>().0 {
                let mean = |of: &[Vec<f64>], k: usize| {
                    t.iter().map(|v| of[v[0] as usize][k]).sum::<f64>() / 3.0
                };
                let seen = look_up(&page, [mean(&places, 0), 1.0 - mean(&places, 1)]);
                let seen = [0, 1, 2].map(|k| light(seen[k]) * mean(&values, k) / 65_535.0);
                let is_near =
                    |wanted: &[f64; 3]| (0..3).all(|k| (seen[k] - wanted[k]).abs() < 0.02);
                assert!(wanted.iter().any(is_near), "{seen:?} for {wanted:?}");
                n += 1;
            }
        }
        assert_eq!(n, n_triangles);
    }
    // Where images hide the colours of vertices, the pages show both; images that are kept do not.
    for output in ["kept.obj", "kept.ply", "kept.glb"] {
        let said = expect(folder, &format!("convert both.gltf {output}"), 0);
        let is_named =
            said.contains("colours of vertices under images, 4 of them: hidden by the images");
        assert_eq!(is_named, output != "kept.glb", "{said}");
    }
    for output in ["out.obj", "out.ply"] {
        let command = format!("simplify both.gltf {output} --triangles 4 --texture bake --force");
        let said = expect(folder, &command, 0);
        assert!(!said.contains("under images"), "{said}");
        assert!(said.contains("in the new texture, no longer at the vertices"), "{said}");
        assert!(!vertex_lines(folder, output).iter().any(|numbers| numbers.len() > 3));
        let page = image::open(folder.join("out_textures/out_0.png")).unwrap().into_rgb8();
        for wanted in &wanted {
            assert!(count_near(&page, wanted) > 60, "{output} {wanted:?}");
        }
    }
}

/// Numbers of the lines of vertices of a mesh as OBJ.
pub fn vertex_lines(folder: &Path, mesh: &str) -> Vec<Vec<f64>> {
    expect(folder, &format!("convert {mesh} lines.obj --textures none --force"), 0);
    let text = std::fs::read_to_string(folder.join("lines.obj")).unwrap();
    let lines = text.lines().filter_map(|line| line.strip_prefix("v "));
    lines.map(|line| line.split(' ').map(|word| word.parse().unwrap()).collect()).collect()
}

#[test]
fn tiles_and_pictures_multiply_colours_of_vertices() {
    let folder = &scratch();
    let wanted = tinted_squares(folder);
    expect(folder, "render both.gltf -o p.png --unlit --view front --size 200x80", 0);
    let picture = image::open(folder.join("p.png")).unwrap().into_rgb8();
    // So small that triangles are averaged into a sample.
    expect(folder, "render both.gltf -o s.png --unlit --view front --size 6x2", 0);
    let small = image::open(folder.join("s.png")).unwrap().into_rgb8();
    for wanted in &wanted {
        assert!(count_near(&picture, wanted) > 500, "{wanted:?}");
        assert!(count_near(&small, wanted) > 0, "{wanted:?} {small:?}");
    }
    for options in ["", "--texture colors"] {
        expect(folder, &format!("tiles both.gltf tree --force {options}"), 0);
        expect(folder, "extract tree all.ply --max-error 0 --force", 0);
        for vertex in vertex_lines(folder, "all.ply") {
            let light = [3, 4, 5].map(|k| light(255.0 * vertex[k]));
            let is_near = |wanted: &[f64; 3]| (0..3).all(|k| (light[k] - wanted[k]).abs() < 0.02);
            assert!(wanted.iter().any(is_near), "{options} {light:?} for {wanted:?}");
        }
    }
}
