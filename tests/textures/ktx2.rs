//! Images in KTX2 files (`KHR_texture_basisu`): looked up as all others, and carried from GLB to GLB.

use crate::common::{expect, glb_json, scratch};
use basis_universal::{BasisTextureFormat, Compressor, CompressorParams};
use serde_json::json;
use std::path::Path;

/// Side of the image: red on the left, blue on the right, each a whole block of 4 x 4.
const SIDE: u32 = 8;

/// The image as a file of Basis Universal.
fn basis(format: BasisTextureFormat) -> Vec<u8> {
    let pixel = |i: u32| if i % SIDE < SIDE / 2 { [250, 10, 10] } else { [10, 10, 250] };
    let pixels: Vec<u8> = (0..SIDE * SIDE).flat_map(pixel).collect();
    let mut parameters = CompressorParams::new();
    parameters.set_basis_format(format);
    parameters.set_generate_mipmaps(false);
    parameters.set_print_status_to_stdout(false);
    parameters.source_image_mut(0).init(&pixels, SIDE, SIDE, 3);
    let mut compressor = Compressor::new(1);
    // SAFETY: the parameters are whole, and live until the compressor has copied them.
    assert!(unsafe { compressor.init(&parameters) });
    // SAFETY: the compressor was given its parameters.
    unsafe { compressor.process() }.unwrap();
    compressor.basis_file().to_vec()
}

/// A KTX2 file of one level.
fn ktx2(model: u8, (scheme, n_bytes): (u32, usize), global: &[u8], level: &[u8]) -> Vec<u8> {
    let (format_at, format_bytes) = (80 + 24, 44u32);
    let global_at = format_at + format_bytes as usize;
    let level_at = global_at + global.len();
    let mut out = b"\xabKTX 20\xbb\r\n\x1a\n".to_vec();
    for word in [0, 1, SIDE, SIDE, 0, 0, 1, 1, scheme, format_at as u32, format_bytes, 0, 0] {
        out.extend_from_slice(&word.to_le_bytes());
    }
    let global_place = if global.is_empty() { 0 } else { global_at };
    for word in [global_place, global.len(), level_at, level.len(), n_bytes] {
        out.extend_from_slice(&(word as u64).to_le_bytes());
    }
    for word in [format_bytes, 0, 2 | 40 << 16, u32::from(model) | 1 << 8 | 2 << 16, 3 | 3 << 8] {
        out.extend_from_slice(&word.to_le_bytes());
    }
    for word in [0u32, 0, 127 << 16, 0, 0, u32::MAX] {
        out.extend_from_slice(&word.to_le_bytes());
    }
    out.extend_from_slice(global);
    out.extend_from_slice(level);
    out
}

fn number(bytes: &[u8], at: usize, n: usize) -> usize {
    bytes[at..at + n].iter().rev().fold(0, |sum, &byte| sum << 8 | usize::from(byte))
}

/// A file of Basis Universal as KTX2.
fn converted(basis: &[u8], is_etc1s: bool, packs: bool) -> Vec<u8> {
    let part = |at: usize, n: usize| &basis[at..at + n];
    let slice = number(basis, 65, 4);
    let level = part(number(basis, slice + 13, 4), number(basis, slice + 17, 4));
    if !is_etc1s {
        let packed = zstd::bulk::compress(level, 3).unwrap();
        return match packs {
            true => ktx2(166, (2, level.len()), &[], &packed),
            false => ktx2(166, (0, level.len()), &[], level),
        };
    }
    let endpoints = part(number(basis, 41, 4), number(basis, 45, 3));
    let selectors = part(number(basis, 50, 4), number(basis, 54, 3));
    let tables = part(number(basis, 57, 4), number(basis, 61, 4));
    let mut global = [part(39, 2), part(48, 2)].concat();
    for n in [endpoints.len(), selectors.len(), tables.len(), 0, 0, 0, level.len(), 0, 0] {
        global.extend_from_slice(&(n as u32).to_le_bytes());
    }
    for bytes in [endpoints, selectors, tables] {
        global.extend_from_slice(bytes);
    }
    ktx2(163, (1, 0), &global, level)
}

/// A square with an image beside it.
fn square(folder: &Path, image: &[u8]) {
    std::fs::write(folder.join("a.ktx2"), image).unwrap();
    let floats = [
        0.0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0, // positions
        0.0, 1.0, 1.0, 1.0, 0.0, 0.0, 1.0, 0.0, // coordinates
    ];
    let mut bytes: Vec<u8> = floats.iter().flat_map(|x| x.to_le_bytes()).collect();
    bytes.extend([0u8, 1, 2, 1, 3, 2, 0, 0]);
    std::fs::write(folder.join("in.bin"), &bytes).unwrap();
    let document = json!({
        "asset": { "version": "2.0" },
        "extensionsRequired": ["KHR_texture_basisu"],
        "buffers": [{ "uri": "in.bin", "byteLength": bytes.len() }],
        "bufferViews": [{ "buffer": 0, "byteLength": bytes.len() }],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3" },
            { "bufferView": 0, "byteOffset": 48, "componentType": 5126, "count": 4, "type": "VEC2" },
            { "bufferView": 0, "byteOffset": 80, "componentType": 5121, "count": 6, "type": "SCALAR" },
        ],
        "images": [{ "uri": "a.ktx2", "mimeType": "image/ktx2" }],
        "textures": [{ "extensions": { "KHR_texture_basisu": { "source": 0 } } }],
        "materials": [{ "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } } }],
        "meshes": [{ "primitives": [{
            "attributes": { "POSITION": 0, "TEXCOORD_0": 1 }, "indices": 2, "material": 0,
        }] }],
        "nodes": [{ "mesh": 0 }],
        "scenes": [{ "nodes": [0] }],
    });
    std::fs::write(folder.join("in.gltf"), document.to_string()).unwrap();
}

/// Colours of the left and the right half of a picture of a mesh from above.
fn halves(folder: &Path, mesh: &str) -> [[u8; 3]; 2] {
    let arguments = format!("render {mesh} -o p.png --view front --unlit --size 64x64 --force");
    expect(folder, &arguments, 0);
    let picture = image::open(folder.join("p.png")).unwrap().to_rgb8();
    [24, 40].map(|x| picture.get_pixel(x, 32).0)
}

#[test]
fn basis_universal_is_looked_up_and_carried() {
    let folder = &scratch();
    for (is_etc1s, packs) in [(false, false), (false, true), (true, false)] {
        let format =
            if is_etc1s { BasisTextureFormat::ETC1S } else { BasisTextureFormat::UASTC4x4 };
        square(folder, &converted(&basis(format), is_etc1s, packs));
        for mesh in ["in.gltf", "out.glb"] {
            if mesh == "out.glb" {
                expect(folder, "convert in.gltf out.glb --force", 0);
            }
            let [left, right] = halves(folder, mesh);
            assert!(left[0] > 200 && left[2] < 60, "{is_etc1s} {packs} {mesh} {left:?}");
            assert!(right[2] > 200 && right[0] < 60, "{is_etc1s} {packs} {mesh} {right:?}");
        }
    }
    let document = glb_json(&folder.join("out.glb"));
    assert_eq!(document["images"][0]["mimeType"], "image/ktx2");
    assert!(
        document["extensionsRequired"].as_array().unwrap().contains(&"KHR_texture_basisu".into())
    );
}

#[test]
fn damaged_images_are_named() {
    let folder = &scratch();
    let whole = converted(&basis(BasisTextureFormat::ETC1S), true, false);
    for n in [60, 110, whole.len() - 20] {
        square(folder, &whole[..n]);
        let arguments = "render in.gltf -o p.png --view front --unlit --size 32x32 --force";
        let said = expect(folder, arguments, 3);
        assert!(said.contains("a.ktx2"), "{n}: {said}");
    }
    // Sizes of blocks beyond a byte, which nothing depends on; levels and a description that lie behind the end.
    for (at, byte, is_read) in [(120, 255, true), (87, 1, false), (51, 1, false), (116, 99, false)]
    {
        let mut spoiled = whole.clone();
        spoiled[at] = byte;
        square(folder, &spoiled);
        let arguments = "render in.gltf -o p.png --view front --unlit --size 32x32 --force";
        let said = expect(folder, arguments, if is_read { 0 } else { 3 });
        assert!(!said.contains("fault"), "{at}: {said}");
    }
}

/// The KTX2 files in a GLB.
fn files_in(glb: &Path) -> Vec<Vec<u8>> {
    let (json, bytes) = (glb_json(glb), std::fs::read(glb).unwrap());
    let binary = 28 + number(&bytes, 12, 4);
    let images = json["images"].as_array().unwrap();
    let file = |image: &serde_json::Value| {
        assert_eq!(image["mimeType"], "image/ktx2");
        let view = &json["bufferViews"][image["bufferView"].as_u64().unwrap() as usize];
        let [at, n] = ["byteOffset", "byteLength"].map(|key| view[key].as_u64().unwrap() as usize);
        bytes[binary + at..][..n].to_vec()
    };
    images.iter().map(file).collect()
}

/// Writes a sheet with waves of colour; a quarter of it is clear glass if `has_holes`.
fn waves(folder: &Path, has_holes: bool) {
    let image = image::RgbaImage::from_fn(128, 128, |x, y| {
        let wave = (127.0 + 120.0 * (f64::from(x) / 9.0 + f64::from(y) / 29.0).sin()) as u8;
        image::Rgba([
            wave,
            wave / 2,
            255 - wave,
            if has_holes && x < 64 && y < 64 { 40 } else { 255 },
        ])
    });
    image.save(folder.join("a.png")).unwrap();
    let n = 24;
    let mut obj = "mtllib in.mtl\nusemtl a\n".to_owned();
    for (y, x) in (0..=n).flat_map(|y| (0..=n).map(move |x| (y, x))) {
        let [u, v] = [x, y].map(|i| f64::from(i) / f64::from(n));
        obj += &format!("v {u} {v} {}\nvt {u} {v}\n", 0.03 * (9.0 * u).sin() * (7.0 * v).cos());
    }
    for (y, x) in (0..n).flat_map(|y| (0..n).map(move |x| (y, x))) {
        let [a, b, c, d] =
            [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(dx, dy)| 1 + x + dx + (y + dy) * (n + 1));
        obj += &format!("f {a}/{a} {b}/{b} {c}/{c}\nf {a}/{a} {c}/{c} {d}/{d}\n");
    }
    std::fs::write(folder.join("in.obj"), obj).unwrap();
    let glass = if has_holes { "map_d a.png\n" } else { "" };
    std::fs::write(folder.join("in.mtl"), format!("newmtl a\nmap_Kd a.png\n{glass}")).unwrap();
}

/// Mean squared difference of two pictures, in dB.
fn psnr(folder: &Path, meshes: [&str; 2]) -> f64 {
    let picture = |mesh: &str| {
        let arguments =
            format!("render {mesh} -o p.png --view front --unlit --size 160x160 --force");
        expect(folder, &arguments, 0);
        image::open(folder.join("p.png")).unwrap().to_rgb8().into_raw()
    };
    let [a, b] = meshes.map(picture);
    let off = |(a, b): (&u8, &u8)| (f64::from(*a) - f64::from(*b)).powi(2);
    let mean = a.iter().zip(&b).map(off).sum::<f64>() / a.len() as f64;
    10.0 * (255.0 * 255.0 / mean).log10()
}

#[test]
fn pages_of_a_new_texture_become_ktx2() {
    let folder = &scratch();
    waves(folder, false);
    let simplify = |rest: &str, code: i32| {
        expect(folder, &format!("simplify in.obj --texture bake --ratio 20% --force {rest}"), code)
    };
    simplify("png.glb", 0);
    for (textures, scheme, model, least) in [("ktx2", 2, 166, 38.0), ("etc1s", 1, 163, 26.0)] {
        simplify(&format!("o.glb --textures {textures} --bake-normals --threads 2"), 0);
        let document = glb_json(&folder.join("o.glb"));
        let required = document["extensionsRequired"].as_array().unwrap();
        assert!(required.contains(&"KHR_texture_basisu".into()));
        let found = psnr(folder, ["png.glb", "o.glb"]);
        assert!(found > least, "{textures} {found}");
        let files = files_in(&folder.join("o.glb"));
        // Colours, and directions, which are always UASTC and linear.
        let expected = [(scheme, model, 1, 2), (2, 166, 0, 1)];
        for (file, (scheme, model, primaries, transfer)) in files.iter().zip(expected) {
            let [width, height, n_levels] = [20, 24, 40].map(|at| number(file, at, 4));
            assert!(width % 4 == 0 && height % 4 == 0, "{width} {height}");
            assert_eq!(n_levels, 1 + width.max(height).ilog2() as usize);
            assert_eq!(number(file, 44, 4), scheme);
            let format = number(file, 48, 4);
            assert_eq!([12, 13, 14].map(|k| file[format + k]), [model, primaries, transfer]);
            // Levels follow each other up to the end, the smallest first.
            let level = |k: usize| [0, 8].map(|at| number(file, 80 + 24 * k + at, 8));
            let mut end = file.len();
            for [at, n] in (0..n_levels).map(level) {
                assert!(n > 0);
                assert_eq!(at + n, end);
                end = at;
            }
        }
        let bytes = std::fs::read(folder.join("o.glb")).unwrap();
        simplify(&format!("o.glb --textures {textures} --bake-normals --threads 1"), 0);
        assert!(bytes == std::fs::read(folder.join("o.glb")).unwrap(), "{textures}");
    }
    waves(folder, true);
    simplify("png.glb", 0);
    for (textures, samples) in [("ktx2", &[3][..]), ("etc1s", &[0, 15])] {
        simplify(&format!("o.glb --textures {textures}"), 0);
        let file = &files_in(&folder.join("o.glb"))[0];
        let format = number(file, 48, 4);
        let found: Vec<_> = (0..samples.len()).map(|k| file[format + 31 + 16 * k]).collect();
        assert_eq!((found, number(file, format, 4)), (samples.to_vec(), 28 + 16 * samples.len()));
        let found = psnr(folder, ["png.glb", "o.glb"]);
        assert!(found > 26.0, "{textures} {found}");
    }
    assert!(simplify("o.obj --textures ktx2", 2).contains("only GLB holds KTX2"));
    assert!(simplify("o.glb --textures etc1s --bake-size 250", 2).contains("multiples of 4"));
    // The truth at once, whatever the texture.
    for (rest, truth) in [
        ("o.obj", "only GLB holds KTX2"),
        ("o.ply", "only GLB holds KTX2"),
        ("o.stl", "only GLB holds KTX2"),
        ("o.glb --bake-size 250", "multiples of 4"),
    ] {
        let command = format!("simplify in.obj {rest} --ratio 20% --force --textures ktx2");
        let said = expect(folder, &command, 2);
        assert!(said.contains(truth) && !said.contains("--texture bake"), "{rest}: {said}");
    }
    let said = expect(folder, "convert in.obj o.glb --textures ktx2 --force", 2);
    assert!(said.contains("--texture bake") && said.contains("gltf-transform uastc"), "{said}");
}
