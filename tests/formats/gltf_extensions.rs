//! Extensions of glTF that move, repeat or scale: places of the whole, instances, places of images.

use crate::common::{expect, glb_json, scratch};
use serde_json::{Value, json};
use std::path::Path;

/// A glTF file of one triangle (0 0 0, 1 0 0, 0 1 0), `more` floats behind its positions, and parts of the document.
fn triangle(folder: &Path, more: &[f32], change: impl Fn(&mut Value)) {
    let positions = [0.0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    let bytes: Vec<u8> = positions.iter().chain(more).flat_map(|x| x.to_le_bytes()).collect();
    std::fs::write(folder.join("in.bin"), &bytes).unwrap();
    let mut document = json!({
        "asset": { "version": "2.0" },
        "buffers": [{ "uri": "in.bin", "byteLength": bytes.len() }],
        "bufferViews": [
            { "buffer": 0, "byteLength": 36 },
            { "buffer": 0, "byteOffset": 36, "byteLength": bytes.len() - 36 },
        ],
        "accessors": [{ "bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3" }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 } }] }],
        "nodes": [{ "mesh": 0 }],
        "scenes": [{ "nodes": [0] }],
        "scene": 0,
    });
    change(&mut document);
    std::fs::write(folder.join("in.gltf"), document.to_string()).unwrap();
}

/// Type of the coordinates, positions and faces of a mesh as they are converted to PLY.
fn shown(folder: &Path, file: &str) -> (String, Vec<[f64; 3]>, Vec<String>) {
    expect(folder, &format!("convert {file} out.ply --format ascii --force"), 0);
    let text = std::fs::read_to_string(folder.join("out.ply")).unwrap();
    let kind = text.lines().find_map(|line| line.strip_suffix(" x")).unwrap().to_owned();
    let (head, body) = text.split_once("end_header\n").unwrap();
    let n = head.lines().find_map(|line| line.strip_prefix("element vertex ")).unwrap();
    let n: usize = n.parse().unwrap();
    let point = |line: &str| -> [f64; 3] {
        let numbers: Vec<f64> = line.split(' ').map(|word| word.parse().unwrap()).collect();
        [numbers[0], numbers[1], numbers[2]]
    };
    let points = body.lines().take(n).map(point).collect();
    (kind, points, body.lines().skip(n).map(str::to_owned).collect())
}

#[test]
fn the_place_that_positions_count_from_is_added() {
    let folder = &scratch();
    for list in ["extensionsUsed", "extensionsRequired"] {
        triangle(folder, &[0.0], |document| {
            document[list] = json!(["CESIUM_RTC"]);
            document["extensions"] =
                json!({ "CESIUM_RTC": { "center": [1215012.0, -4736313.5, 4081605.0] } });
        });
        let (kind, points, _) = shown(folder, "in.gltf");
        assert_eq!(kind, "property double");
        assert_eq!(points[1], [1215013.0, -4736313.5, 4081605.0]);
        // Turned upright the mesh stands at the place that is named, as Cesium shows it.
        let (_, points, _) = shown(folder, "in.gltf --up y");
        let at = [1215012.0, -4736313.5, 4081605.0];
        assert_eq!(points, [at, [at[0] + 1.0, at[1], at[2]], [at[0], at[1], at[2] + 1.0]]);
    }
}

/// A skin stands where its first joint is, undone by the place where it was bound: its own node does not move it.
#[test]
fn a_skin_rests_where_its_joints_are() {
    let folder = &scratch();
    let undo = [1.0f32, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, -5.0, 0.0, 0.0, 1.0];
    for (matrices, x) in [(json!(1), 3.0), (Value::Null, 8.0)] {
        triangle(folder, &undo, |document| {
            let more =
                json!({ "bufferView": 1, "componentType": 5126, "count": 1, "type": "MAT4" });
            document["accessors"].as_array_mut().unwrap().push(more);
            document["skins"] = json!([{ "joints": [1], "inverseBindMatrices": matrices }]);
            document["nodes"] = json!([
                { "mesh": 0, "skin": 0, "scale": [100, 100, 100] },
                { "translation": [8, 0, 0] },
            ]);
            document["scenes"] = json!([{ "nodes": [0, 1] }]);
        });
        let (_, points, _) = shown(folder, "in.gltf");
        assert_eq!(points, [[x, 0.0, 0.0], [x + 1.0, 0.0, 0.0], [x, 1.0, 0.0]]);
    }
}

#[test]
fn a_tileset_without_a_mesh_is_named() {
    let folder = &scratch();
    let text =
        r#"{"asset": {"version": "1.1"}, "geometricError": 5, "root": {"geometricError": 1}}"#;
    std::fs::write(folder.join("tileset.json"), text).unwrap();
    let said = expect(folder, "convert tileset.json out.ply", 4);
    assert!(said.contains("this tree of tiles has no mesh"), "{said}");
}

#[test]
fn every_instance_stands_in_its_place() {
    let folder = &scratch();
    let shifts = [0.0f32, 0.0, 0.0, 10.0, 0.0, 0.0, 0.0, 0.0, 5.0];
    let scales = [1.0f32, 1.0, 1.0, 2.0, 2.0, 2.0, -1.0, 1.0, 1.0];
    let more: Vec<f32> = shifts.into_iter().chain(scales).collect();
    triangle(folder, &more, |document| {
        for at in [0, 36] {
            let accessor = json!({
                "bufferView": 1, "byteOffset": at, "componentType": 5126, "count": 3, "type": "VEC3",
            });
            document["accessors"].as_array_mut().unwrap().push(accessor);
        }
        document["nodes"][0]["translation"] = json!([0.0, 100.0, 0.0]);
        document["nodes"][0]["extensions"] = json!({
            "EXT_mesh_gpu_instancing": { "attributes": { "TRANSLATION": 1, "SCALE": 2 } }
        });
        document["extensionsRequired"] = json!(["EXT_mesh_gpu_instancing"]);
    });
    let (_, points, faces) = shown(folder, "in.gltf");
    assert_eq!((points.len(), faces.len()), (9, 3));
    assert_eq!(points[4], [12.0, 100.0, 0.0]);
    assert_eq!(points[7], [-1.0, 100.0, 5.0]);
    assert_eq!(faces, ["3 0 1 2", "3 3 4 5", "3 6 8 7"]);
    triangle(folder, &more, |document| {
        document["accessors"].as_array_mut().unwrap().push(json!({
            "bufferView": 1, "componentType": 5126, "count": 7, "type": "VEC3",
        }));
        document["nodes"][0]["extensions"] = json!({
            "EXT_mesh_gpu_instancing": { "attributes": { "TRANSLATION": 1 } }
        });
    });
    assert!(expect(folder, "convert in.gltf no.ply", 4).contains("accessor 1"));
}

#[test]
fn scale_and_offset_of_an_image_go_into_glb() {
    let folder = &scratch();
    image::RgbImage::from_pixel(2, 2, image::Rgb([9, 8, 7])).save(folder.join("a.png")).unwrap();
    let library = "newmtl m\nmap_Kd -o 0.25 0.5 -s 2 3 a.png\nnewmtl n\nmap_Kd -clamp on a.png\n";
    std::fs::write(folder.join("in.mtl"), library).unwrap();
    let text = "mtllib in.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl m\nf 1/1 2/2 3/3\n\
                usemtl n\nf 2/2 4/1 3/3\n";
    std::fs::write(folder.join("in.obj"), text).unwrap();
    let said = expect(folder, "convert in.obj out.glb", 0);
    assert!(!said.contains("options"), "{said}");
    let document = glb_json(&folder.join("out.glb"));
    let texture =
        |k: usize| document["materials"][k]["pbrMetallicRoughness"]["baseColorTexture"].clone();
    let transform = &texture(0)["extensions"]["KHR_texture_transform"];
    assert_eq!(*transform, json!({ "offset": [0.25, -2.5], "scale": [2.0, 3.0] }));
    assert!(
        document["extensionsUsed"].as_array().unwrap().contains(&"KHR_texture_transform".into())
    );
    assert_eq!(texture(1).get("extensions"), None);
    assert_eq!(document["samplers"], json!([{ "wrapS": 33071, "wrapT": 33071 }]));
    // What is read back is where the image was: u times 2 and 0.25, v times 3 and 0.5.
    expect(folder, "convert out.glb back.obj", 0);
    let back = std::fs::read_to_string(folder.join("back.obj")).unwrap();
    for place in ["vt 0.25 0.5\n", "vt 2.25 0.5\n", "vt 0.25 3.5\n"] {
        assert!(back.contains(place), "{place} {back}");
    }
    // The same numbers: in glTF y is up.
    for (file, side, picture) in [("in.obj", "top", "a.ppm.png"), ("out.glb", "front", "b.png")] {
        let view = format!("--view {side} --unlit --size 40x40");
        expect(folder, &format!("render {file} -o {picture} {view}"), 0);
    }
    let [a, b] = ["a.ppm.png", "b.png"].map(|name| image::open(folder.join(name)).unwrap());
    assert_eq!(a, b);
}

/// An image on other coordinates than the first one is not carried, and neither is its factor: all of the surface would shine.
#[test]
fn what_an_image_limits_goes_with_the_image() {
    let folder = &scratch();
    image::RgbImage::new(2, 2).save(folder.join("n.png")).unwrap();
    triangle(folder, &[0.0, 0.0, 1.0, 0.0, 0.0, 1.0], |document| {
        let coordinates =
            json!({ "bufferView": 1, "componentType": 5126, "count": 3, "type": "VEC2" });
        document["accessors"].as_array_mut().unwrap().push(coordinates);
        let attributes = json!({ "POSITION": 0, "TEXCOORD_0": 1, "TEXCOORD_1": 1 });
        document["meshes"][0]["primitives"][0] = json!({ "attributes": attributes, "material": 0 });
        document["images"] = json!([{ "uri": "n.png" }]);
        document["textures"] = json!([{ "source": 0 }]);
        let other = json!({ "index": 0, "texCoord": 1 });
        let surface =
            json!({ "baseColorTexture": { "index": 0 }, "metallicRoughnessTexture": other });
        document["materials"] = json!([{
            "pbrMetallicRoughness": surface, "emissiveTexture": other, "emissiveFactor": [1, 1, 1],
        }]);
    });
    let said = expect(folder, "convert in.gltf out.glb", 0);
    assert!(
        said.contains("emitted light with other texture coordinates than the colour image"),
        "{said}"
    );
    let material = &glb_json(&folder.join("out.glb"))["materials"][0];
    assert!(
        material.get("emissiveFactor").is_none_or(|light| *light == json!([0, 0, 0])),
        "{material}"
    );
    assert_eq!(material["pbrMetallicRoughness"]["metallicFactor"], 0.0, "{material}");
}

#[test]
fn strengths_of_maps_are_named() {
    let folder = &scratch();
    image::RgbImage::from_pixel(2, 2, image::Rgb([128, 128, 255]))
        .save(folder.join("n.png"))
        .unwrap();
    for (scale, is_lost) in [(1.0, false), (0.5, true)] {
        triangle(folder, &[0.0, 0.0, 1.0, 0.0, 0.0, 1.0], |document| {
            let coordinates =
                json!({ "bufferView": 1, "componentType": 5126, "count": 3, "type": "VEC2" });
            document["accessors"].as_array_mut().unwrap().push(coordinates);
            document["meshes"][0]["primitives"][0] =
                json!({ "attributes": { "POSITION": 0, "TEXCOORD_0": 1 }, "material": 0 });
            document["images"] = json!([{ "uri": "n.png" }]);
            document["textures"] = json!([{ "source": 0 }]);
            document["materials"] = json!([{ "normalTexture": { "index": 0, "scale": scale } }]);
        });
        let said = expect(folder, "convert in.gltf out.obj --force", 0);
        assert_eq!(said.contains("strength of the normal map"), is_lost, "{said}");
    }
}

#[cfg(feature = "draco")]
#[test]
fn meshes_that_draco_has_compressed_are_read() {
    use draco_core::{
        DataType, EncoderBuffer, EncoderOptions, GeometryAttributeType, Mesh, MeshEncoder,
        PointAttribute, PointIndex,
    };
    let folder = &scratch();
    let points = [[0.0f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.5]];
    let mut mesh = Mesh::new();
    mesh.set_num_points(4);
    let mut positions = PointAttribute::new();
    positions.init(GeometryAttributeType::Position, 3, DataType::Float32, false, 4);
    let bytes: Vec<u8> = points.as_flattened().iter().flat_map(|x| x.to_le_bytes()).collect();
    positions.buffer_mut().write(0, &bytes);
    let id = mesh.add_attribute(positions);
    let id = mesh.attribute(id).unique_id();
    for face in [[0, 1, 2], [1, 3, 2]] {
        mesh.add_face(face.map(PointIndex));
    }
    let mut encoder = MeshEncoder::new();
    encoder.set_mesh(mesh);
    let mut packed = EncoderBuffer::new();
    encoder.encode(&EncoderOptions::default(), &mut packed).unwrap();
    let write = |data: &[u8]| {
        std::fs::write(folder.join("in.bin"), data).unwrap();
        let accessor = |kind: u32, count: usize, shape: &str| json!({ "componentType": kind, "count": count, "type": shape });
        let document = json!({
            "asset": { "version": "2.0" },
            "extensionsRequired": ["KHR_draco_mesh_compression"],
            "buffers": [{ "uri": "in.bin", "byteLength": data.len() }],
            "bufferViews": [{ "buffer": 0, "byteLength": data.len() }],
            "accessors": [accessor(5126, 4, "VEC3"), accessor(5123, 6, "SCALAR")],
            "meshes": [{ "primitives": [{
                "attributes": { "POSITION": 0 }, "indices": 1,
                "extensions": { "KHR_draco_mesh_compression": {
                    "bufferView": 0, "attributes": { "POSITION": id },
                } },
            }] }],
            "nodes": [{ "mesh": 0 }, { "mesh": 0, "translation": [5.0, 0.0, 0.0] }],
            "scenes": [{ "nodes": [0, 1] }],
        });
        std::fs::write(folder.join("in.gltf"), document.to_string()).unwrap();
    };
    write(packed.data());
    let (_, found, faces) = shown(folder, "in.gltf");
    assert_eq!((found.len(), faces.len()), (8, 4));
    for (i, point) in points.iter().enumerate() {
        for shift in [0.0, 5.0] {
            let wanted = [f64::from(point[0]) + shift, f64::from(point[1]), f64::from(point[2])];
            let near = |p: &&[f64; 3]| p.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-4);
            assert!(found.iter().any(|p| near(&p)), "{i} {found:?}");
        }
    }
    let mut broken = packed.data().to_vec();
    broken.truncate(packed.data().len() / 2);
    write(&broken);
    let said = expect(folder, "convert in.gltf no.ply", 4);
    assert!(said.contains("Draco"), "{said}");
}

/// Signs of base64, without padding.
fn base64(bytes: &[u8]) -> String {
    const SIGNS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let group = |three: &[u8]| {
        let bits = three.iter().fold(0u32, |bits, &byte| bits << 8 | u32::from(byte));
        let bits = bits << (8 * (3 - three.len()));
        let signs = (0..=three.len()).map(|i| SIGNS[(bits >> (18 - 6 * i)) as usize & 63] as char);
        signs.collect::<String>()
    };
    bytes.chunks(3).map(group).collect()
}

#[test]
fn data_in_addresses_is_read_in_every_dialect_of_base64() {
    let folder = &scratch();
    // Eleven floats: a length that takes padding; the last have bits that take the signs 62 and 63.
    triangle(folder, &[f32::from_bits(0xffff_ffff), f32::from_bits(0xfbef_befb)], |_| {});
    let text = base64(&std::fs::read(folder.join("in.bin")).unwrap());
    assert!(text.contains('+') && text.contains('/') && text.len() % 4 == 3);
    let lines: Vec<&str> = text.as_bytes().chunks(20).map(|s| str::from_utf8(s).unwrap()).collect();
    let expected = shown(folder, "in.gltf");
    for (case, address) in [
        ("padded", format!("data:application/octet-stream;base64,{text}=")),
        ("without padding", format!("data:application/octet-stream;base64,{text}")),
        (
            "signs of addresses",
            format!("data:;base64,{}=", text.replace('+', "-").replace('/', "_")),
        ),
        ("wrapped", format!("data:application/octet-stream;base64,\n{}=\n ", lines.join("\r\n  "))),
        ("escaped", format!("data:;base64,{}%3D", text.replace('+', "%2B").replace('/', "%2f"))),
        ("capitals", format!("DATA:application/octet-stream;charset=utf-8;BASE64,{text}=")),
    ] {
        triangle(folder, &[0.0; 2], |document| {
            document["buffers"][0]["uri"] = address.clone().into()
        });
        assert_eq!(shown(folder, "in.gltf"), expected, "{case}");
    }
    let wrong = format!("data:;base64,{text}*");
    triangle(folder, &[0.0; 2], |document| document["buffers"][0]["uri"] = wrong.clone().into());
    assert!(expect(folder, "info in.gltf", 4).contains("buffer 0: its data is not base64"));
}

#[test]
fn buffers_under_another_spelling_of_their_name_are_found() {
    let folder = &scratch();
    for written in ["IN.Bin", "C:\\models\\in.bin", "/home/me/in.bin", "data/in%2Ebin"] {
        triangle(folder, &[0.0], |document| document["buffers"][0]["uri"] = written.into());
        assert_eq!(shown(folder, "in.gltf").1[1], [1.0, 0.0, 0.0], "{written}");
        let said = expect(folder, "convert in.gltf out.ply --force", 0);
        assert!(said.contains("in.bin is taken"), "{written}\n{said}");
    }
    triangle(folder, &[0.0], |document| document["buffers"][0]["uri"] = "other.bin".into());
    assert!(expect(folder, "info in.gltf", 4).contains("other.bin"));
}

#[test]
fn images_that_are_not_read_or_not_named_are_lost_by_name() {
    let folder = &scratch();
    std::fs::write(folder.join("t.avif"), b"\0\0\0\x1cftypavif\0\0\0\0avifmif1miaf").unwrap();
    let textured = |document: &mut Value, texture: Value| {
        document["materials"] =
            json!([{ "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } } }]);
        document["meshes"][0]["primitives"][0]["material"] = 0.into();
        document["textures"] = json!([texture]);
        document["images"] = json!([{ "uri": "t.avif" }]);
        document["extensionsRequired"] = json!(["EXT_texture_avif"]);
    };
    let avif = json!({ "extensions": { "EXT_texture_avif": { "source": 0 } } });
    for (texture, reason) in [(avif, "is AVIF, which is not read"), (json!({}), "names no image")] {
        triangle(folder, &[0.0], |document| textured(document, texture.clone()));
        for run in [
            "convert in.gltf out.glb --force",
            "convert in.gltf out.obj --force",
            "simplify in.gltf out.glb --ratio 1 --force",
        ] {
            let said = expect(folder, run, 3);
            assert!(said.contains(reason) && said.contains("none of the images"), "{run}\n{said}");
        }
    }
}

#[test]
fn faces_without_coordinates_of_their_image_are_named() {
    let folder = &scratch();
    image::RgbImage::new(2, 2).save(folder.join("t.png")).unwrap();
    std::fs::write(folder.join("in.mtl"), "newmtl a\nmap_Kd t.png\nnewmtl b\nKd 1 0 0\n").unwrap();
    let head = "mtllib in.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nusemtl a\nf 1/1 2/2 3/3\n";
    for (faces, n) in [("f 1 3 4\n", 1), ("f 1/1 3 4/2\nf 4 3 1\n", 2), ("usemtl b\nf 1 3 4\n", 0)]
    {
        std::fs::write(folder.join("in.obj"), format!("{head}{faces}")).unwrap();
        let said = expect(folder, "convert in.obj out.glb --force", 0);
        let words = "faces without texture coordinates";
        assert_eq!(said.contains(words), n > 0, "{faces}{said}");
        assert!(n < 2 || said.contains(&format!("{words}, {n} of them")), "{faces}{said}");
    }
    // A second primitive without coordinates, of the same material.
    triangle(folder, &[0.0, 0.0, 1.0, 0.0, 1.0, 1.0], |document| {
        let positions = document["accessors"][0].clone();
        document["accessors"] = json!([positions, { "bufferView": 1, "componentType": 5126, "count": 3, "type": "VEC2" }]);
        document["materials"] =
            json!([{ "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } } }]);
        document["textures"] = json!([{ "source": 0 }]);
        document["images"] = json!([{ "uri": "t.png" }]);
        document["meshes"][0]["primitives"] = json!([
            { "attributes": { "POSITION": 0, "TEXCOORD_0": 1 }, "material": 0 },
            { "attributes": { "POSITION": 0 }, "material": 0 },
        ]);
    });
    let said = expect(folder, "convert in.gltf out.glb --force", 0);
    assert!(said.contains("faces without texture coordinates: their material"), "{said}");
}

#[test]
fn integers_are_colours_also_where_the_file_does_not_say_normalized() {
    let folder = &scratch();
    // Linear 0.25 of opacity 64 / 255 at each vertex, in four bytes that lie in a float.
    let colour = f32::from_le_bytes([255, 64, 0, 64]);
    for normalized in [true, false] {
        triangle(folder, &[colour; 3], |document| {
            let positions = document["accessors"][0].clone();
            document["accessors"] = json!([positions, {
                "bufferView": 1, "componentType": 5121, "count": 3, "type": "VEC4", "normalized": normalized
            }]);
            document["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = 1.into();
        });
        let said = expect(folder, "convert in.gltf out.ply --format ascii --force", 0);
        assert!(!said.contains("lost"), "{normalized}\n{said}");
        let text = std::fs::read_to_string(folder.join("out.ply")).unwrap();
        assert!(text.contains("\n1 0 0 255 137 0 64\n"), "{normalized}\n{text}");
    }
}
