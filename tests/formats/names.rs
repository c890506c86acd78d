//! Names of objects and groups: with every face through every format that has names, and through a simplification.

use crate::common::{expect, glb_json, json, run, scratch};
use serde_json::json;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Object and group.
type Name = (String, String);

/// Cells of a side of the plate.
const SIDE: usize = 48;

/// Names of the three stripes along y: lines of OBJ, and what they mean.
const STRIPES: [(&str, (&str, &str)); 3] = [
    ("o house one\ng wall north\n", ("house one", "wall north")),
    ("o house one\ng roof\n", ("house one", "roof")),
    ("o tree\n", ("tree", "")),
];

/// A wavy plate of squares in three stripes; names repeat with every row, and two materials part it the other way.
fn plate(path: &Path, materials: bool, names: bool) {
    let mut text = String::new();
    for y in 0..=SIDE {
        for x in 0..=SIDE {
            let z = (x as f64 * 0.21).sin() * (y as f64 * 0.17).cos();
            text += &format!("v {x} {y} {z}\n");
        }
    }
    for y in 0..SIDE {
        if materials && y % (SIDE / 2) == 0 {
            text += if y == 0 { "usemtl red\n" } else { "usemtl blue\n" };
        }
        for x in 0..SIDE {
            if names && x % 16 == 0 {
                text += STRIPES[x / 16].0;
            }
            let a = y * (SIDE + 1) + x + 1;
            text += &format!("f {a} {} {} {}\n", a + 1, a + SIDE + 2, a + SIDE + 1);
        }
    }
    std::fs::write(path, text).unwrap();
}

/// Corners and name of every face of an OBJ file, by the lines before it.
fn faces_of_obj(path: &Path) -> Vec<([[f64; 3]; 3], Name)> {
    let text = std::fs::read_to_string(path).unwrap();
    let (mut points, mut faces) = (Vec::<[f64; 3]>::new(), Vec::new());
    let mut name = Name::default();
    for line in text.lines() {
        let (word, rest) = line.split_once(' ').unwrap_or((line, ""));
        match word {
            "v" => {
                let numbers: Vec<f64> = rest.split(' ').map(|x| x.parse().unwrap()).collect();
                points.push([numbers[0], numbers[1], numbers[2]]);
            }
            "o" => name = (rest.to_owned(), String::new()),
            "g" => name.1 = rest.to_owned(),
            "f" => {
                let corner = |word: &str| {
                    points[word.split('/').next().unwrap().parse::<usize>().unwrap() - 1]
                };
                let c: Vec<[f64; 3]> = rest.split(' ').map(corner).collect();
                faces.push(([c[0], c[1], c[2]], name.clone()));
            }
            _ => {}
        }
    }
    faces
}

/// Area seen from above of all faces of each name; every one has to lie in its own stripe.
fn areas(path: &Path) -> BTreeMap<Name, f64> {
    let mut out = BTreeMap::new();
    for (c, name) in faces_of_obj(path) {
        let stripe = STRIPES.iter().position(|(_, (o, g))| (*o, *g) == (&name.0, &name.1));
        let stripe = stripe.unwrap_or_else(|| panic!("{name:?} in {}", path.display()));
        let (low, high) = (16.0 * stripe as f64 - 1e-2, 16.0 * (stripe + 1) as f64 + 1e-2);
        assert!(c.iter().all(|p| (low..high).contains(&p[0])), "{name:?}: {c:?}");
        let area =
            (c[1][0] - c[0][0]) * (c[2][1] - c[0][1]) - (c[2][0] - c[0][0]) * (c[1][1] - c[0][1]);
        *out.entry(name).or_default() += 0.5 * area;
    }
    out
}

fn all_have_their_stripe(path: &Path) {
    let areas = areas(path);
    assert_eq!(areas.len(), 3);
    for (name, area) in areas {
        assert!((area - 16.0 * SIDE as f64).abs() < 0.5, "{name:?}: {area}");
    }
}

#[test]
fn names_survive_every_format_that_has_them_and_a_simplification() {
    let at = &scratch();
    for materials in [false, true] {
        plate(&at.join("in.obj"), materials, true);
        for command in [
            "convert in.obj a.ply",
            "convert a.ply b.glb --format float",
            "convert b.glb c.ply --format ascii",
            "convert c.ply d.obj",
            "simplify in.obj e.obj --ratio 10%",
            "simplify in.obj f.glb --ratio 10% --cell-triangles 1000 --format float",
            "convert f.glb g.obj",
            "simplify in.obj h.ply --ratio 10%",
            "convert h.ply i.obj",
            "convert i.obj j.obj",
        ] {
            let said = expect(at, &format!("{command} --force"), 0);
            assert!(!said.contains("names of objects"), "{command}: {said}");
        }
        for obj in ["d.obj", "e.obj", "g.obj", "i.obj", "j.obj"] {
            all_have_their_stripe(&at.join(obj));
            let text = std::fs::read_to_string(at.join(obj)).unwrap();
            assert_eq!(text.matches("\no ").count(), 2, "an object is one run of faces: {obj}");
        }
        assert_eq!(faces_of_obj(&at.join("d.obj")).len(), 2 * SIDE * SIDE);
        // glTF: a mesh and a node for each name, a primitive in it for each material.
        let document = glb_json(&at.join("f.glb"));
        let name = |list: &str, i: usize| document[list][i]["name"].as_str().unwrap().to_owned();
        let nodes: Vec<_> = (0..3).map(|i| (name("nodes", i), name("meshes", i))).collect();
        let wanted = [("house one", "wall north"), ("house one", "roof"), ("tree", "tree")];
        assert_eq!(nodes, wanted.map(|(a, b)| (a.to_owned(), b.to_owned())));
        let n = if materials { 2 } else { 1 };
        assert_eq!(document["meshes"][0]["primitives"].as_array().unwrap().len(), n);
        let text = std::fs::read(at.join("a.ply")).unwrap();
        let head = String::from_utf8_lossy(&text[..600]).into_owned();
        assert!(head.contains("comment ObjectName 1 o house one\ncomment ObjectName 1 g roof\n"));
        assert!(head.contains("property int objectnumber\n"), "{head}");
    }
}

#[test]
fn names_that_are_given_up_leave_no_trace() {
    let at = &scratch();
    plate(&at.join("named.obj"), false, true);
    plate(&at.join("plain.obj"), false, false);
    let bytes = |name: &str| std::fs::read(at.join(name)).unwrap();
    for output in ["obj", "ply", "glb"] {
        for command in ["convert", "simplify"] {
            let target = if command == "simplify" { "--ratio 20%" } else { "" };
            let said = expect(
                at,
                &format!("{command} named.obj a.{output} {target} --drop-names --force"),
                0,
            );
            assert!(!said.contains("names"), "{said}");
            expect(at, &format!("{command} plain.obj b.{output} {target} --force"), 0);
            if command == "convert" {
                assert_eq!(bytes(&format!("a.{output}")), bytes(&format!("b.{output}")));
            } else {
                assert_eq!(
                    bytes(&format!("a.{output}")).len() / 100,
                    bytes(&format!("b.{output}")).len() / 100
                );
            }
        }
    }
    // Also those of a file that was written here.
    expect(at, "convert named.obj named.ply", 0);
    expect(at, "convert named.ply again.ply --drop-names", 0);
    expect(at, "convert plain.obj plain.ply", 0);
    expect(at, "convert plain.ply twice.ply", 0);
    assert!(bytes("again.ply") == bytes("twice.ply"));
}

#[test]
fn a_single_name_stays_beside_the_same_mesh() {
    let at = &scratch();
    plate(&at.join("plain.obj"), false, false);
    let text = std::fs::read_to_string(at.join("plain.obj")).unwrap();
    std::fs::write(
        at.join("one.obj"),
        format!("g default\n{text}").replacen("\nf ", "\no Cube\nf ", 1),
    )
    .unwrap();
    for command in ["convert NAME.obj NAME.ply", "simplify NAME.obj NAME.ply --ratio 20% --force"] {
        for name in ["one", "plain"] {
            expect(at, &command.replace("NAME", name), 0);
        }
        let bytes = |name: &str| std::fs::read(at.join(name)).unwrap();
        let (one, plain) = (bytes("one.ply"), bytes("plain.ply"));
        let comment = b"comment ObjectName 0 o Cube\n";
        let place = one.windows(comment.len()).position(|w| w == comment).unwrap();
        assert_eq!([&one[..place], &one[place + comment.len()..]].concat(), plain);
    }
    expect(at, "convert one.ply a.glb", 0);
    let found = glb_json(&at.join("a.glb"));
    assert_eq!(
        (&found["nodes"][0]["name"], &found["meshes"][0]["name"]),
        (&json!("Cube"), &json!("Cube"))
    );
    expect(at, "convert a.glb b.obj", 0);
    let names: BTreeSet<Name> = faces_of_obj(&at.join("b.obj")).into_iter().map(|f| f.1).collect();
    assert_eq!(names, BTreeSet::from([("Cube".to_owned(), String::new())]));
}

/// Four triangles: nodes and meshes with the same name, different ones, one alone, and none.
#[test]
fn names_of_nodes_and_meshes_are_objects_and_groups() {
    let at = &scratch();
    let positions = [0.0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    let bytes: Vec<u8> = positions.iter().flat_map(|x| x.to_le_bytes()).collect();
    std::fs::write(at.join("in.bin"), &bytes).unwrap();
    let mesh = json!({ "primitives": [{ "attributes": { "POSITION": 0 } }] });
    let given = [("a", "a"), ("b", "c\nd"), ("", "e"), ("f", ""), ("", "")];
    let mut document = json!({
        "asset": { "version": "2.0" },
        "buffers": [{ "uri": "in.bin", "byteLength": 36 }],
        "bufferViews": [{ "buffer": 0, "byteLength": 36 }],
        "accessors": [{ "bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3" }],
        "meshes": vec![mesh; 5], "nodes": vec![json!({}); 5], "scenes": [{ "nodes": [0, 1, 2, 3, 4] }], "scene": 0,
    });
    for (i, (node, of_mesh)) in given.into_iter().enumerate() {
        document["nodes"][i] = json!({ "mesh": i, "translation": [2 * i, 0, 0] });
        for (list, name) in [("nodes", node), ("meshes", of_mesh)] {
            if !name.is_empty() {
                document[list][i]["name"] = name.into();
            }
        }
    }
    std::fs::write(at.join("in.gltf"), document.to_string()).unwrap();
    let wanted = [("a", ""), ("b", "c d"), ("", "e"), ("f", ""), ("", "")];
    expect(at, "convert in.gltf a.obj", 0);
    expect(at, "convert in.gltf b.glb", 0);
    expect(at, "convert b.glb c.obj", 0);
    for file in ["a.obj", "c.obj"] {
        let faces = faces_of_obj(&at.join(file));
        assert_eq!(faces.len(), 5);
        for (c, name) in faces {
            let (o, g) = wanted[(c[0][0] / 2.0).round() as usize];
            assert_eq!(name, (o.to_owned(), g.to_owned()), "{file} {c:?}");
        }
    }
}

#[test]
fn names_without_a_place_are_noted() {
    let at = &scratch();
    plate(&at.join("in.obj"), false, true);
    expect(at, "convert in.obj in.ply", 0);
    for input in ["in.obj", "in.ply"] {
        for command in [
            "convert IN out.stl",
            "simplify IN out.stl --ratio 20%",
            "simplify IN out.ply --ratio 20% --pairs",
            "simplify IN out.ply --ratio 20% --method cluster",
            "simplify IN out.ply --ratio 20% --optimize 1",
            "simplify IN out.ply --ratio 20% --progressive p.stp",
            "tiles IN tiles",
        ] {
            let command = format!("{command} --force --report r.json").replace("IN", input);
            let said = expect(at, &command, 0);
            assert!(
                said.contains("note: names of objects and groups, 3 of them"),
                "{command}: {said}"
            );
            let report = json(at, "r.json");
            let losses = report["losses"].as_array().unwrap();
            assert!(
                losses.iter().all(|loss| loss["kind"] != "attributes"),
                "{command}: {losses:?}"
            );
        }
        let head = std::fs::read(at.join("out.ply")).unwrap();
        assert!(!String::from_utf8_lossy(&head[..400]).contains("ObjectName"));
    }
}

/// `mtllib a.mtl sub/b.mtl` names two libraries, though the end of the line is the name of a file, too.
#[test]
fn libraries_on_one_line_are_all_read() {
    let at = &scratch();
    std::fs::create_dir(at.join("sub")).unwrap();
    std::fs::write(at.join("a.mtl"), "newmtl red\nKd 1 0 0\n").unwrap();
    std::fs::write(at.join("sub/b.mtl"), "newmtl blue\nKd 0 0 1\n").unwrap();
    let faces = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nusemtl red\nf 1 2 3\nusemtl blue\nf 2 4 3\n";
    std::fs::write(at.join("in.obj"), format!("mtllib a.mtl sub/b.mtl\n{faces}")).unwrap();
    let said = expect(at, "convert in.obj out.glb", 0);
    assert!(!said.contains("material"), "{said}");
    let document = glb_json(&at.join("out.glb"));
    let colour = |k: usize| &document["materials"][k]["pbrMetallicRoughness"]["baseColorFactor"];
    assert_eq!(*colour(0), json!([1.0, 0.0, 0.0, 1.0]));
    assert_eq!(*colour(1), json!([0.0, 0.0, 1.0, 1.0]));
}

#[test]
fn more_names_than_can_be_carried_are_lost_and_named() {
    let at = &scratch();
    let write = |n: usize, name: &str| {
        let mut text = String::new();
        for i in 0..=n {
            text += &format!("v {i} 0 0\nv {i} 1 0\n");
        }
        for i in 0..n {
            let a = 2 * i + 1;
            text += &format!("g {name}{i}\nf {a} {} {}\n", a + 2, a + 1);
        }
        std::fs::write(at.join("in.obj"), text).unwrap();
    };
    write(65_536, "");
    let said = expect(at, "convert in.obj out.ply", 0);
    assert!(said.contains("lost in part: names of objects and groups, 65535 of them"), "{said}");
    let bytes = std::fs::read(at.join("out.ply")).unwrap();
    assert!(!String::from_utf8_lossy(&bytes[..400]).contains("objectnumber"));
    write(20_000, &"x".repeat(200));
    let output = run(at, "convert in.obj out.ply --force --memory 40MiB");
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(said.contains("--drop-names") && output.status.code() == Some(6), "{output:?}");
    expect(at, "convert in.obj out.ply --force --memory 40MiB --drop-names", 0);
    write(15_000, &"x".repeat(200));
    expect(at, "convert in.obj out.ply --force", 0);
}
