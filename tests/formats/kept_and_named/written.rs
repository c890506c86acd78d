//! Inputs that have everything their format can hold.

use serde_json::json;
use std::path::Path;

pub(super) const SIDE: usize = 9;

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

pub(super) fn image(path: &Path, colour: [u8; 3]) {
    image::RgbImage::from_pixel(8, 8, image::Rgb(colour)).save(path).unwrap();
}

pub(super) fn write_ply(folder: &Path) {
    let mut text = "ply\nformat ascii 1.0\ncomment made by hand\ncomment TextureFile a.png\ncomment TextureFile b.png\n\
        obj_info scanner 7\n"
        .to_owned();
    text += &format!("element vertex {}\n", SIDE * SIDE);
    let properties = "double x, double y, double z, float nx, float ny, float nz, uchar red, uchar green, \
        uchar blue, uchar alpha, float s, float t, int class, double quality, \
        list uchar int rings";
    for property in properties.split(", ") {
        text += &format!("property {property}\n");
    }
    let n = squares().count();
    text += &format!("element face {n}\n");
    let properties = "list uchar int vertex_indices, list uchar float texcoord, int texnumber, uchar red, \
        uchar green, uchar blue, int part, float score, list uchar int flags";
    for property in properties.split(", ") {
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

pub(super) fn write_obj(folder: &Path) {
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

pub(super) fn write_stl(folder: &Path, name: &str, bytes: impl Fn(usize) -> u16) {
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
pub(super) fn write_gltf(folder: &Path) {
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
