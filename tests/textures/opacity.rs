//! Opacity of images: it counts where the material says so, and of glTF without `alphaMode` it does not.

use super::bake::sheet;
use crate::common::{expect, glb_json, scratch};
use base64::Engine;
use image::{Rgb, RgbImage, Rgba, RgbaImage};
use serde_json::{Value, json};
use std::path::Path;

/// Pixels of an unlit picture without a surface.
const BACKGROUND: Rgb<u8> = Rgb([128; 3]);

/// A leaf whose right half is not there, though it has a colour.
fn leaf(folder: &Path) {
    let leaf = RgbaImage::from_fn(64, 64, |x, _| match x / 32 {
        0 => Rgba([20, 60, 10, 255]),
        _ => Rgba([0, 90, 200, 0]),
    });
    leaf.save(folder.join("leaf.png")).unwrap();
}

/// Numbers of a glTF file: corners of two squares (x and y of the lowest corner, side), coordinates and indices of each.
pub fn two_squares(squares: [[f32; 3]; 2]) -> Vec<u8> {
    let mut bytes: Vec<u8> = Vec::new();
    for [x, y, side] in squares {
        for [x, y] in [[x, y], [x + side, y], [x + side, y + side], [x, y + side]] {
            bytes.extend([x, y, 0.0].map(f32::to_le_bytes).as_flattened());
        }
    }
    for uv in [[0f32, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]] {
        bytes.extend(uv.map(f32::to_le_bytes).as_flattened());
    }
    bytes.extend([0u8, 1, 2, 0, 2, 3]);
    bytes
}

/// Two quads that show the leaf, without a word about opacity and with a mask:
///
/// ```text
///   -1  opaque  1      2  mask  4
/// ```
fn two_quads(folder: &Path) {
    leaf(folder);
    let bytes = two_squares([[-1.0, -1.0, 2.0], [2.0, -1.0, 2.0]]);
    let data = base64::engine::general_purpose::STANDARD.encode(&bytes);
    let accessor = |at: usize, component: u32, count: u32, kind: &str| json!({ "bufferView": 0, "byteOffset": at, "componentType": component, "count": count, "type": kind });
    let quad = |positions: u32, material: u32| json!({ "attributes": { "POSITION": positions, "TEXCOORD_0": 2 }, "indices": 3, "material": material });
    let surface = json!({ "baseColorFactor": [1, 1, 1, 0.25], "baseColorTexture": { "index": 0 } });
    let cut = json!({ "baseColorTexture": { "index": 0 } });
    let document = json!({
        "asset": { "version": "2.0" },
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "mesh": 0 }],
        "meshes": [{ "primitives": [quad(0, 0), quad(1, 1)] }],
        "materials": [
            { "name": "opaque", "pbrMetallicRoughness": surface },
            { "name": "cut", "pbrMetallicRoughness": cut, "alphaMode": "MASK" },
        ],
        "textures": [{ "source": 0 }],
        "images": [{ "uri": "leaf.png" }],
        "accessors": [
            accessor(0, 5126, 4, "VEC3"), accessor(48, 5126, 4, "VEC3"), accessor(96, 5126, 4, "VEC2"),
            accessor(128, 5121, 6, "SCALAR"),
        ],
        "bufferViews": [{ "buffer": 0, "byteLength": bytes.len() }],
        "buffers": [{
            "byteLength": bytes.len(), "uri": format!("data:application/octet-stream;base64,{data}"),
        }],
    });
    std::fs::write(folder.join("quads.gltf"), document.to_string()).unwrap();
}

fn picture(folder: &Path, arguments: &str) -> RgbImage {
    let said = expect(folder, &format!("render {arguments} -o p.png --unlit --force"), 0);
    assert!(!said.contains("warning"), "{said}");
    image::open(folder.join("p.png")).unwrap().into_rgb8()
}

#[test]
fn opacity_means_nothing_in_gltf_that_does_not_name_it() {
    let folder = &scratch();
    two_quads(folder);
    // Large, and so small that an image of few texels is looked up.
    for size in [200, 16] {
        for (middle, right) in [(0.0, Rgb([0, 90, 200])), (3.0, BACKGROUND)] {
            let seen = picture(
                folder,
                &format!("quads.gltf --view front --zoom {middle},0,0,1 --size {size}x{size}"),
            );
            let at = |share: f64| *seen.get_pixel((f64::from(size) * share) as u32, size / 2);
            assert_eq!(at(0.25), Rgb([20, 60, 10]), "{middle} {size}");
            assert_eq!(at(0.75), right, "{middle} {size}");
        }
    }
}

#[test]
fn opaque_materials_are_written_as_such() {
    let folder = &scratch();
    two_quads(folder);
    expect(folder, "convert quads.gltf out.glb", 0);
    let materials = glb_json(&folder.join("out.glb"))["materials"].clone();
    let of = |name: &str| {
        let list = materials.as_array().unwrap();
        list.iter().find(|material| material["name"] == name).unwrap().clone()
    };
    assert_eq!(of("opaque")["alphaMode"], Value::Null);
    assert_eq!(of("opaque")["pbrMetallicRoughness"]["baseColorFactor"], Value::Null);
    assert_eq!(of("cut")["alphaMode"], "MASK");
    let said = expect(folder, "convert quads.gltf out.obj", 0);
    assert!(!said.contains("opacity"), "{said}");
    let library = std::fs::read_to_string(folder.join("out.mtl")).unwrap();
    assert!(library.contains("newmtl opaque") && !library.contains("\nd "), "{library}");
    assert_eq!(library.matches("map_d ").count(), 1, "{library}");
}

#[test]
fn a_new_texture_of_opaque_materials_is_opaque() {
    let folder = &scratch();
    let clear = RgbaImage::from_fn(64, 64, |x, _| Rgba([0, 90, 200, 4 * x as u8]));
    clear.save(folder.join("clear.png")).unwrap();
    sheet(folder, |x, y| format!("{x} {y}"), "newmtl only\nKd 1 1 1\nmap_Kd clear.png\n");
    expect(folder, "convert sheet.obj sheet.glb", 0);
    assert_eq!(glb_json(&folder.join("sheet.glb"))["materials"][0]["alphaMode"], "BLEND");
    // The same without a word on opacity.
    let mut bytes = std::fs::read(folder.join("sheet.glb")).unwrap();
    let at = bytes.windows(9).position(|word| word == b"alphaMode").unwrap();
    bytes[at..at + 9].copy_from_slice(b"alphaNone");
    std::fs::write(folder.join("sheet.glb"), bytes).unwrap();
    expect(folder, "simplify sheet.glb out.glb --ratio 20% --texture bake -q", 0);
    assert_eq!(glb_json(&folder.join("out.glb"))["materials"][0]["alphaMode"], Value::Null);
    expect(folder, "simplify sheet.glb out.obj --ratio 20% --texture bake -q", 0);
    let page = image::open(folder.join("out_textures/out_0.png")).unwrap();
    assert!(!page.color().has_alpha(), "{:?}", page.color());
    let seen = picture(folder, "out.obj --view top --zoom 0.5,0.5,0,0.5 --size 100x100");
    for x in [30, 50, 70] {
        assert_eq!(*seen.get_pixel(x, 50), Rgb([0, 90, 200]), "at {x}");
    }
}

/// An image of opacity that is the colour image itself: its opacity counts, not its brightness.
#[test]
fn dark_texels_of_a_leaf_are_there() {
    let folder = &scratch();
    leaf(folder);
    let library = "newmtl only\nKd 1 1 1\nmap_Kd leaf.png\nmap_d leaf.png\n";
    sheet(folder, |x, y| format!("{x} {y}"), library);
    expect(folder, "render sheet.obj -o p.png --view top --unlit --zoom 0.5,0.5,0,0.5", 0);
    let seen = image::open(folder.join("p.png")).unwrap().into_rgb8();
    let [x, y] = [seen.width(), seen.height()];
    assert_eq!(*seen.get_pixel(x / 2 - y / 5, y / 2), Rgb([20, 60, 10]));
    assert_eq!(*seen.get_pixel(x / 2 + y / 5, y / 2), BACKGROUND);
    // Other formats have a place for it, and back.
    let said = expect(folder, "convert sheet.obj leaf.glb", 0);
    assert!(!said.contains("opacity"), "{said}");
    assert_eq!(glb_json(&folder.join("leaf.glb"))["materials"][0]["alphaMode"], "MASK");
    let said = expect(folder, "convert leaf.glb back.obj", 0);
    assert!(!said.contains("opacity"), "{said}");
    let library = std::fs::read_to_string(folder.join("back.mtl")).unwrap();
    assert!(library.contains("map_d back_textures/leaf.png"), "{library}");
}

/// A wall and beside it a pane, each a grid of 20 x 20 quads; `pane` are the lines of its material:
///
/// ```text
///   0  wall  1      2  pane  3
/// ```
fn wall_and_pane(folder: &Path, pane: &str) {
    sheet(
        folder,
        |x, y| format!("{x} {y}"),
        &format!("newmtl only\nKd 1 1 1\nmap_Kd wall.png\nnewmtl pane\n{pane}"),
    );
    RgbImage::from_pixel(64, 64, Rgb([200, 90, 30])).save(folder.join("wall.png")).unwrap();
    let wall = std::fs::read_to_string(folder.join("sheet.obj")).unwrap();
    let mut text = wall.clone();
    text += "usemtl pane\n";
    for line in wall.lines() {
        let words: Vec<&str> = line.split_whitespace().collect();
        match words[0] {
            "v" => {
                let x: f64 = words[1].parse().unwrap();
                text += &format!("v {} {} {}\n", x + 2.0, words[2], words[3]);
            }
            "vt" => text += &format!("{line}\n"),
            "f" => {
                let moved = words[1..].iter().map(|corner| {
                    let id: usize = corner.split('/').next().unwrap().parse().unwrap();
                    format!(" {0}/{0}", id + 441)
                });
                text += &format!("f{}\n", moved.collect::<String>());
            }
            _ => {}
        }
    }
    std::fs::write(folder.join("sheet.obj"), text).unwrap();
}

/// Viewers draw what blends without depth: the wall behind it has to be opaque.
#[test]
fn only_triangles_that_let_light_through_blend_in_a_new_texture() {
    let folder = &scratch();
    wall_and_pane(folder, "Kd 0.2 0.4 0.5\nd 0.3\n");
    expect(folder, "simplify sheet.obj out.glb --ratio 20% --texture bake -q", 0);
    let document = glb_json(&folder.join("out.glb"));
    assert_eq!(document["images"].as_array().unwrap().len(), 1);
    let materials = document["materials"].as_array().unwrap();
    let modes: Vec<&Value> = materials.iter().map(|material| &material["alphaMode"]).collect();
    assert_eq!(modes, [&Value::Null, &json!("BLEND")]);
    // The wall is opaque, the pane is not.
    for primitive in document["meshes"][0]["primitives"].as_array().unwrap() {
        let positions = primitive["attributes"]["POSITION"].as_u64().unwrap() as usize;
        let least = document["accessors"][positions]["min"][0].as_f64().unwrap();
        assert_eq!(least > 1e4, primitive["material"] == 1, "{primitive}");
    }
    expect(folder, "simplify sheet.obj out.obj --ratio 20% --texture bake -q", 0);
    let library = std::fs::read_to_string(folder.join("out.mtl")).unwrap();
    assert_eq!(library.matches("map_Kd out_textures/out_0.png").count(), 2, "{library}");
    assert_eq!(library.matches("map_d ").count(), 1, "{library}");
    assert!(library.contains("newmtl out_0\n") && library.contains("newmtl out_0_clear\n"));
    // PLY has images, no materials.
    expect(folder, "simplify sheet.obj plain.ply --ratio 20% --texture bake -q", 0);
    let ply = std::fs::read(folder.join("plain.ply")).unwrap();
    assert_eq!(String::from_utf8_lossy(&ply).matches("TextureFile").count(), 1);
}

/// Opacity of the image, meaning of it in GLB, and words about it.
#[test]
fn texels_say_what_opacity_means_where_the_library_does_not() {
    // Opacity at x: opaque, a mask, nothing, any.
    let opacities: [fn(u32) -> u8; 4] =
        [|_| 255, |x| if x < 32 { 0 } else { 255 }, |_| 0, |x| 4 * x as u8];
    let modes = [Value::Null, json!("MASK"), Value::Null, json!("BLEND")];
    for ((opacity, mode), is_said) in opacities.iter().zip(modes).zip([false, false, true, false]) {
        let folder = &scratch();
        let image = RgbaImage::from_fn(64, 64, |x, _| Rgba([0, 90, 200, opacity(x)]));
        image.save(folder.join("image.png")).unwrap();
        sheet(folder, |x, y| format!("{x} {y}"), "newmtl only\nKd 1 1 1\nmap_Kd image.png\n");
        for command in [
            "convert",
            "simplify --ratio 50% --texture keep",
            "simplify --ratio 20% --texture bake",
        ] {
            let said = expect(folder, &format!("{command} sheet.obj out.glb --force"), 0);
            let materials = &glb_json(&folder.join("out.glb"))["materials"];
            let last = materials.as_array().unwrap().last().unwrap();
            assert_eq!(last["alphaMode"], mode, "{command}");
            let words = "image with opacity 0 everywhere of material 'only'";
            assert_eq!(said.contains(words), is_said, "{command}: {said}");
        }
    }
}

/// An image whose texels all have opacity 0 would leave nothing to be seen: pictures take it as opaque, as new textures do.
#[test]
fn pictures_take_opacity_as_new_textures_do() {
    let folder = &scratch();
    RgbaImage::from_pixel(16, 16, Rgba([200, 40, 0, 0])).save(folder.join("image.png")).unwrap();
    sheet(folder, |x, y| format!("{x} {y}"), "newmtl only\nmap_Kd image.png\n");
    let said = expect(folder, "render sheet.obj -o p.png --unlit --size 90x60", 0);
    assert!(said.contains("image with opacity 0 everywhere"), "{said}");
    let found = image::open(folder.join("p.png")).unwrap().to_rgb8();
    assert_eq!(found.get_pixel(45, 30), &Rgb([200, 40, 0]));
}
