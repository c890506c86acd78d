//! What is nearly as formats say: names in another case, numbers in another notation, images in another place; and small
//! things that no output has, which are named.

use crate::common::{expect, json, run, scratch};
use serde_json::{Value, json};
use std::path::Path;

/// A triangle in a PLY file with three bytes at every vertex.
fn ply(path: &Path, places: [&str; 3], colours: [&str; 3], rows: [&str; 3]) {
    let property = |kind: &str, names: [&str; 3]| -> String {
        names.iter().map(|name| format!("property {kind} {name}\n")).collect()
    };
    let text = format!(
        "ply\nformat ascii 1.0\nelement vertex 3\n{}{}element face 1\n\
         property list uchar int vertex_indices\nend_header\n{}\n3 0 1 2\n",
        property("float", places),
        property("uchar", colours),
        rows.join("\n")
    );
    std::fs::write(path, text).unwrap();
}

const ROWS: [&str; 3] = ["0 0 0 255 0 0", "1 0 0 255 0 0", "0 1 0 255 0 0"];

#[test]
fn names_of_properties_in_any_case_are_known() {
    let at = &scratch();
    for places in [["x", "y", "z"], ["X", "Y", "Z"]] {
        for colours in [
            ["Red", "Green", "Blue"],
            ["RED", "GREEN", "BLUE"],
            ["R", "G", "B"],
            ["r", "g", "b"],
            ["Diffuse_Red", "Diffuse_Green", "Diffuse_Blue"],
        ] {
            ply(&at.join("in.ply"), places, colours, ROWS);
            let said = expect(at, "convert in.ply out.obj --force", 0);
            assert!(!said.contains("lost"), "{colours:?}\n{said}");
            let text = std::fs::read_to_string(at.join("out.obj")).unwrap();
            assert!(text.contains("v 1 0 0 1 0 0"), "{colours:?}\n{text}");
        }
    }
    // One letter alone is not a colour.
    ply(&at.join("in.ply"), ["x", "y", "z"], ["R", "label", "q"], ROWS);
    expect(at, "convert in.ply out.ply --force", 0);
    let bytes = std::fs::read(at.join("out.ply")).unwrap();
    assert!(String::from_utf8_lossy(&bytes).contains("property uchar R\n"));
}

#[test]
fn numbers_in_other_notations_are_read_or_named() {
    let at = &scratch();
    let colours = ["red", "green", "blue"];
    ply(
        &at.join("in.ply"),
        ["x", "y", "z"],
        colours,
        ["0 0 0 1 1 1", "1.5D+03 0 0 1 1 1", "0 -2d-1 0 1 1 1"],
    );
    std::fs::write(at.join("in.obj"), "v 0 0 0\nv 1.5D+03 0 0\nv 0 -2d-1 0\nf 1 2 3\n").unwrap();
    let facet = "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1.5D+03 0 0\nvertex 0 -2d-1 0\nendloop\nendfacet\n";
    std::fs::write(at.join("in.stl"), format!("solid a\n{facet}endsolid a\n")).unwrap();
    for input in ["in.ply", "in.obj", "in.stl"] {
        expect(at, &format!("convert {input} out.obj --force"), 0);
        let text = std::fs::read_to_string(at.join("out.obj")).unwrap();
        assert!(text.contains("v 1500 0 0") && text.contains("v 0 -0.2 0"), "{input}\n{text}");
        let comma = std::fs::read_to_string(at.join(input)).unwrap().replace("1.5D+03", "1,5");
        std::fs::write(at.join(input), comma).unwrap();
        let said = expect(at, &format!("convert {input} out.obj --force"), 4);
        assert!(said.contains("decimal comma") && said.contains("sed"), "{input}\n{said}");
    }
}

/// A triangle with coordinates and a material, and a red image at `place`.
fn textured(at: &Path, named: &str, place: &str) {
    let obj = "mtllib in.mtl\no left\ng wall\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0 0.5\nvt 1 0\nvt 0 1 0\nusemtl m\n\
        f 1/1 2/2 3/3\no right\nv 5 0 0\nv 6 0 0\nv 5 1 0\nf 4/1 5/2 6/3\n";
    std::fs::write(at.join("in.obj"), obj).unwrap();
    std::fs::write(at.join("in.mtl"), format!("newmtl m\nmap_Kd {named}\n")).unwrap();
    let path = at.join(place);
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    image::RgbImage::from_pixel(4, 4, image::Rgb([200, 30, 30])).save(path).unwrap();
}

#[test]
fn images_in_folders_below_and_of_another_kind_are_taken_with_a_line() {
    for (named, place) in [
        ("wall.png", "model/textures/wall.png"),
        ("wall.png", "textures/wall.png"),
        ("wall.png", "model/any/where/wall.png"),
        ("wall.jpg", "model/wall.png"),
        ("wall", "model/wall.png"),
        ("D:\\scan\\wall.tif", "model/tex/wall.png"),
        ("caf\u{e9}.png", "model/cafe\u{301}.png"),
        ("cafe\u{301}.png", "model/caf\u{e9}.png"),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let (at, model) = (folder.path(), folder.path().join("model"));
        std::fs::create_dir(&model).unwrap();
        textured(&model, named, &format!("../{place}"));
        let said = expect(at, "convert model/in.obj out.glb", 0);
        assert!(said.contains("is not there under this name"), "{named} {place}\n{said}");
        // A document that names it by a path.
        let done = run(at, "convert model/in.obj model/out.obj --textures none");
        assert!(done.status.success());
        let document = json!({
            "asset": { "version": "2.0", "extras": { "author": "Ada" } }, "scene": 0,
            "scenes": [{ "nodes": [0], "extras": { "seen": 1 } }],
            "nodes": [{ "name": "n", "mesh": 0, "extras": { "room": "7" } }],
            "meshes": [{ "extras": { "a": 1 }, "primitives": [{ "attributes": { "POSITION": 0, "TEXCOORD_0": 1 },
                "material": 0 }] }],
            "materials": [{ "extras": { "b": 2 }, "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } } }],
            "textures": [{ "source": 0 }], "images": [{ "uri": named }],
            "accessors": [
                { "bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3" },
                { "bufferView": 1, "componentType": 5126, "count": 3, "type": "VEC2" },
            ],
            "bufferViews": [{ "buffer": 0, "byteLength": 36 }, { "buffer": 0, "byteOffset": 36, "byteLength": 24 }],
            "buffers": [{ "uri": "in.bin", "byteLength": 60 }],
        });
        std::fs::write(model.join("in.gltf"), document.to_string()).unwrap();
        let numbers = [0., 0., 0., 1., 0., 0., 0., 1., 0., 0., 0., 1., 0., 0., 1.];
        let bytes: Vec<u8> = numbers.iter().flat_map(|x: &f32| x.to_le_bytes()).collect();
        std::fs::write(model.join("in.bin"), bytes).unwrap();
        let said = expect(at, "convert model/in.gltf gltf.glb --report r.json", 0);
        assert!(said.contains("is not there under this name"), "{named} {place}\n{said}");
        let losses = json(at, "r.json")["losses"].to_string();
        for what in ["nodes", "meshes", "materials", "scenes"] {
            assert!(losses.contains(&format!("extras of {what}")), "{what}\n{losses}");
        }
        let kept = crate::common::glb_json(&at.join("gltf.glb"))["asset"]["extras"].to_string();
        assert!(kept.contains("author: Ada"), "{kept}");
    }
    // Which of two is meant is not known.
    let at = &scratch();
    textured(at, "wall.png", "a/wall.png");
    textured(at, "wall.png", "b/wall.png");
    expect(at, "convert in.obj out.glb", 3);
}

#[test]
fn third_coordinates_are_named_and_objects_listed() {
    let at = &scratch();
    textured(at, "wall.png", "wall.png");
    let said = expect(at, "convert in.obj out.glb", 0);
    assert!(said.contains("third texture coordinates (w of vt): not carried"), "{said}");
    for file in ["in.obj", "out.glb"] {
        let listed: Value =
            serde_json::from_slice(&run(at, &format!("info --json {file}")).stdout).unwrap();
        assert_eq!(listed["names"], json!(["left / wall", "right"]), "{file}");
        assert!(!listed["face_properties"].to_string().contains("objectnumber"));
        let shown = String::from_utf8(run(at, &format!("info {file}")).stdout).unwrap();
        assert!(shown.contains("2: left / wall, right"), "{shown}");
    }
}

#[test]
fn lines_and_names_that_nothing_reads_are_named() {
    let at = &scratch();
    let places = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\n";
    for (lines, code, wanted) in [
        ("fo 1 2 3\n", 0, ""),
        ("f 1 2 3\ncall other.obj\nlod 2\n", 0, "'call'"),
        ("f 1/1 2/2 3/9\n", 0, "do not exist"),
        ("f 1/0 2/2 3/3\n", 0, "do not exist"),
        ("f 1/-3 2/-2 3/-1\n", 0, ""),
        ("#MRGB ffff0000ff00ff00ff0000ff\nf 1 2 3\n", 3, "#MRGB"),
    ] {
        std::fs::write(at.join("in.obj"), format!("{places}{lines}")).unwrap();
        let said = expect(at, "convert in.obj out.obj --force", code);
        assert!(said.contains("1 triangles") && said.contains(wanted), "{lines}\n{said}");
        assert!(!wanted.is_empty() || !said.contains("note") && !said.contains("lost"), "{said}");
    }
    let header = "ply\nformat ascii 1.0\nelement Vertex 3\nproperty float x\nproperty float y\nproperty float z\n";
    for name in ["vertex_indexes", "Vertex_Indices", "indices"] {
        let faces = format!("element Face 1\nproperty list uchar int {name}\nend_header\n");
        std::fs::write(at.join("in.ply"), format!("{header}{faces}0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"))
            .unwrap();
        assert!(expect(at, "convert in.ply out.obj --force", 0).contains("1 triangles"), "{name}");
    }
}

#[test]
fn normals_of_the_input_are_named_by_extract() {
    let at = &scratch();
    let obj = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    std::fs::write(at.join("in.obj"), obj).unwrap();
    expect(at, "convert in.obj plain.ply", 0);
    ply(
        &at.join("given.ply"),
        ["x", "y", "z"],
        ["nx", "ny", "nz"],
        ["0 0 0 0 0 1", "1 0 0 0 0 1", "0 1 0 0 0 1"],
    );
    for (name, is_named) in [("plain", false), ("given", true)] {
        expect(at, &format!("tiles {name}.ply {name}"), 0);
        let said = expect(at, &format!("extract {name} {name}.obj --max-error 0"), 0);
        assert_eq!(said.contains("normals: not carried from tiles"), is_named, "{said}");
    }
}

#[test]
fn lists_of_floats_are_corners_if_they_are_whole() {
    let at = &scratch();
    let head = |format: &str, count: &str, item: &str| {
        format!(
            "ply\nformat {format} 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
             element face 2\nproperty list {count} {item} vertex_indices\nend_header\n"
        )
    };
    let positions = [0.0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 0.0];
    // A number of the list: floats and doubles, in either order of bytes.
    let number = |kind: &str, big: bool, x: f64| {
        let mut bytes = match kind {
            "float" => (x as f32).to_le_bytes().to_vec(),
            "double" => x.to_le_bytes().to_vec(),
            _ => (x as i32).to_le_bytes().to_vec(),
        };
        if big {
            bytes.reverse();
        }
        bytes
    };
    let corners = [4.0, 0.0, 1.0, 2.0, 3.0, 3.0, 3.0, 2.0, 1.0];
    for (count, item) in [("float", "int"), ("int", "float"), ("double", "double")] {
        let text = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n3.0 3.0 2 1\n";
        std::fs::write(at.join("in.ply"), head("ascii", count, item) + text).unwrap();
        expect(at, "convert in.ply out.ply --format ascii --force", 0);
        let expected = std::fs::read_to_string(at.join("out.ply")).unwrap();
        assert!(expected.contains("element face 3\n"), "{expected}");
        for (format, big) in [("binary_little_endian", false), ("binary_big_endian", true)] {
            let mut bytes = head(format, count, item).into_bytes();
            for x in positions {
                bytes.extend(number("float", big, x.into()));
            }
            for (i, &x) in corners.iter().enumerate() {
                bytes.extend(number(if i % 5 == 0 { count } else { item }, big, x));
            }
            std::fs::write(at.join("in.ply"), bytes).unwrap();
            expect(at, "convert in.ply out.ply --format ascii --force", 0);
            let found = std::fs::read_to_string(at.join("out.ply")).unwrap();
            assert_eq!(found, expected, "{count} {item} {format}");
        }
        let wrong = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1.5 2\n3 0 1 2\n";
        std::fs::write(at.join("in.ply"), head("ascii", count, item) + wrong).unwrap();
        assert!(expect(at, "info in.ply --check", 4).contains("1.5"));
    }
}

#[test]
fn lines_of_libraries_in_other_orders_are_read_or_named() {
    let at = &scratch();
    image::RgbImage::new(2, 2).save(at.join("t.png")).unwrap();
    image::RgbImage::new(2, 2).save(at.join("u.png")).unwrap();
    let obj = "mtllib in.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl a\nf 1/1 2/2 3/3\n";
    std::fs::write(at.join("in.obj"), obj).unwrap();
    for (library, named) in [
        ("newmtl a\nmap_Kd t.png -s 2 2 1\n", ""),
        ("newmtl a\nmap_Kd \\\n  t.png\n", ""),
        ("newmtl a\n# a comment \\\nmap_Kd t.png\n", ""),
        ("newmtl a\nmap_Kd t.png\nnewmtl a\nKd 1 0 0\n", "materials described again 'a'"),
        ("newmtl a\nmap_Kd t.png\nmap_Kd u.png\n", "second colour image of one material 'u.png'"),
    ] {
        std::fs::write(at.join("in.mtl"), library).unwrap();
        let said = expect(at, "convert in.obj out.glb --force", 0);
        let glb = crate::common::glb_json(&at.join("out.glb"));
        assert_eq!(glb["images"].as_array().map(Vec::len), Some(1), "{library}{said}");
        assert_eq!(said.contains("lost"), !named.is_empty(), "{library}{said}");
        assert!(said.contains(named), "{library}{said}");
    }
}

#[test]
fn colours_in_words_that_nothing_reads_are_named() {
    let at = &scratch();
    let facet = "facet normal 0 0 1\ncolor 1 0 0\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n";
    std::fs::write(at.join("in.stl"), format!("solid color\n{facet}endsolid color\n")).unwrap();
    let said = expect(at, "convert in.stl out.ply", 3);
    assert!(said.contains("lost: lines 'color' of facets"), "{said}");
    for names in [["R", "G", "B", "A"], ["r", "g", "b", "a"]] {
        let [r, g, b, a] = names.map(|name| format!("property uchar {name}\n"));
        let head = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n";
        let faces = "element face 1\nproperty list uchar int vertex_indices\nend_header\n";
        let rows = "0 0 0 255 0 0 64\n1 0 0 255 0 0 64\n0 1 0 255 0 0 64\n3 0 1 2\n";
        std::fs::write(at.join("in.ply"), format!("{head}{r}{g}{b}{a}{faces}{rows}")).unwrap();
        let said = expect(at, "convert in.ply out.glb --force", 0);
        assert!(!said.contains("lost"), "{names:?}\n{said}");
    }
}
