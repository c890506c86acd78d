//! Extensions of glTF that move, repeat or scale: places of the whole, instances, places of images.

#![allow(clippy::unwrap_used)] // A test fails by panicking.

use crate::common::{expect, glb_json};
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
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
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

#[test]
fn a_tileset_without_a_mesh_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let text =
        r#"{"asset": {"version": "1.1"}, "geometricError": 5, "root": {"geometricError": 1}}"#;
    std::fs::write(folder.join("tileset.json"), text).unwrap();
    let said = expect(folder, "convert tileset.json out.ply", 4);
    assert!(said.contains("this tree of tiles has no mesh"), "{said}");
}

#[test]
fn every_instance_stands_in_its_place() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
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
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
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
    for (file, picture) in [("in.obj", "a.ppm.png"), ("out.glb", "b.png")] {
        expect(folder, &format!("render {file} -o {picture} --view top --unlit --size 40x40"), 0);
    }
    let [a, b] = ["a.ppm.png", "b.png"].map(|name| image::open(folder.join(name)).unwrap());
    assert_eq!(a, b);
}

#[cfg(feature = "draco")]
#[test]
fn meshes_that_draco_has_compressed_are_read() {
    use draco_core::{
        DataType, EncoderBuffer, EncoderOptions, GeometryAttributeType, Mesh, MeshEncoder,
        PointAttribute, PointIndex,
    };
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
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
