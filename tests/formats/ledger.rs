//! The ledger of losses: what an input had and the output has not, in lines, in the report and in the exit code.

use crate::common::{expect, glb_json, json, run, scratch};
use serde_json::Value;
use std::path::Path;

/// A pyramid whose vertices and faces have `vertex` and `face` besides places and corners, all 7.
fn pyramid(path: &Path, comments: &str, vertex: &[&str], face: &[&str]) {
    let properties =
        |list: &[&str]| -> String { list.iter().map(|p| format!("property {p}\n")).collect() };
    let values = |list: &[&str]| -> String {
        list.iter().map(|p| if p.starts_with("list") { " 2 7 7" } else { " 7" }).collect()
    };
    let mut text = format!(
        "ply\nformat ascii 1.0\n{comments}element vertex 5\nproperty float x\nproperty float y\nproperty float z\n{}\
         element face 4\nproperty list uchar int vertex_indices\n{}end_header\n",
        properties(vertex),
        properties(face)
    );
    for place in ["0 0 0", "1 0 0", "1 1 0", "0 1 0", "0.5 0.5 1"] {
        text += &format!("{place}{}\n", values(vertex));
    }
    for corners in ["0 1 4", "1 2 4", "2 3 4", "3 0 4"] {
        text += &format!("3 {corners}{}\n", values(face));
    }
    std::fs::write(path, text).unwrap();
}

fn losses(folder: &Path) -> Vec<(String, String, String)> {
    let report = json(folder, "r.json");
    let text = |loss: &Value, key: &str| loss[key].as_str().unwrap().to_owned();
    let list = report["losses"].as_array().expect("a list");
    list.iter()
        .map(|loss| (text(loss, "kind"), text(loss, "what"), text(loss, "severity")))
        .collect()
}

const COLOURS: [&str; 3] = ["uchar red", "uchar green", "uchar blue"];

#[test]
fn every_kind_that_a_format_cannot_hold_is_in_the_ledger() {
    let at = &scratch();
    for (vertex, face, kept_by, kind) in [
        (&COLOURS[..], &[][..], "ply obj glb", "colors"),
        (&["float s", "float t"][..], &[][..], "ply obj glb", "texture_coordinates"),
        (&["float quality"][..], &[][..], "ply", "attributes"),
        (&["list uchar int rings"][..], &[][..], "", "attributes"),
        (&["float nx", "float ny", "float nz"][..], &[][..], "ply obj glb stl", ""),
        (&[][..], &["int label"][..], "ply", "attributes"),
        (&[][..], &COLOURS[..], "ply", "colors"),
        (&[][..], &["list uchar int rings"][..], "", "attributes"),
        (&[][..], &[][..], "ply obj glb stl", ""),
    ] {
        pyramid(&at.join("in.ply"), "", vertex, face);
        for output in ["ply", "obj", "glb", "stl"] {
            // Seven is not a colour of 5 bits a channel.
            if (output, face) == ("stl", &COLOURS[..]) {
                continue;
            }
            let is_kept = kept_by.contains(output);
            let code = if is_kept { 0 } else { 3 };
            for command in ["convert in.ply", "simplify in.ply --triangles 4"] {
                let command = format!("{command} out.{output} --force --report r.json");
                let said = expect(at, &command, code);
                let found = losses(at);
                assert_eq!(
                    said.contains("  lost: "),
                    !is_kept,
                    "{command} {vertex:?} {face:?}\n{said}"
                );
                assert_eq!(found.len(), usize::from(!is_kept), "{command}: {found:?}");
                for (of, what, severity) in &found {
                    assert_eq!((of.as_str(), severity.as_str()), (kind, "whole"), "{command}");
                    assert!(said.contains(what.as_str()), "{said}");
                }
            }
        }
    }
}

#[test]
fn opacity_is_lost_only_where_something_is_not_opaque() {
    let at = &scratch();
    let all = ["uchar red", "uchar green", "uchar blue", "uchar alpha"];
    pyramid(&at.join("clear.ply"), "", &all, &[]);
    let text = std::fs::read_to_string(at.join("clear.ply")).unwrap();
    std::fs::write(at.join("opaque.ply"), text.replace(" 7 7 7 7\n", " 7 7 7 255\n")).unwrap();
    let said = expect(at, "convert clear.ply clear.obj", 0);
    assert!(said.contains("lost in part: opacity of vertices, 5 of them"), "{said}");
    let said = expect(at, "convert opaque.ply opaque.obj", 0);
    assert!(!said.contains("lost"), "{said}");
}

#[test]
fn images_that_are_all_missing_end_with_3_unless_they_are_given_up() {
    let at = &scratch();
    let text = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl m\nf 1/1 2/2 3/3\n";
    std::fs::write(at.join("in.obj"), text).unwrap();
    std::fs::write(at.join("a.mtl"), "newmtl m\nmap_Kd gone.png\n").unwrap();
    for output in ["out.obj", "out.glb", "out.ply"] {
        for command in ["convert in.obj", "simplify in.obj --ratio 100%"] {
            let said = expect(at, &format!("{command} {output} --force --report r.json"), 3);
            assert!(said.contains("lost: none of the images that the mesh names"), "{said}");
            assert!(
                losses(at)
                    .iter()
                    .any(|(kind, _, severity)| kind == "images" && severity == "whole")
            );
            expect(at, &format!("{command} {output} --force --textures none"), 0);
            expect(at, &format!("{command} {output} --force --drop-texture"), 0);
        }
    }
    expect(at, "render in.obj -o p.png --size 32x32", 3);
    // Colours of materials are all that this mesh has of colour, grey says nothing.
    std::fs::write(at.join("a.mtl"), "newmtl m\nKd 0.8 0.1 0.1\n").unwrap();
    expect(at, "convert in.obj red.ply", 3);
    std::fs::write(at.join("a.mtl"), "newmtl m\nKd 0.8 0.8 0.8\n").unwrap();
    expect(at, "convert in.obj grey.ply", 0);
    expect(at, "convert in.obj grey.glb", 0);
}

/// Two triangles with an edge in common, each with its own vertices, whose normals are `normals`.
///
/// ```text
///   2-------1 4
///   | 0   / /|     the second one lies flat, or stands up
///   |   / /  |
///   0 3-----5
/// ```
fn roof(path: &Path, normals: [[i32; 3]; 2]) {
    let mut text = "ply\nformat ascii 1.0\nelement vertex 6\n".to_owned();
    ["x", "y", "z", "nx", "ny", "nz"]
        .iter()
        .for_each(|name| text += &format!("property float {name}\n"));
    text += "element face 2\nproperty list uchar int vertex_indices\nend_header\n";
    let corners = ["0 0 0", "1 1 0", "0 1 0", "0 0 0", "1 0 -1", "1 1 0"];
    for (i, corner) in corners.iter().enumerate() {
        let [x, y, z] = normals[i / 3];
        text += &format!("{corner} {x} {y} {z}\n");
    }
    std::fs::write(path, text + "3 0 1 2\n3 3 4 5\n").unwrap();
}

#[test]
fn normals_along_hard_edges_of_gltf_are_kept_or_their_loss_is_said() {
    let at = &scratch();
    roof(&at.join("hard.ply"), [[0, 0, 1], [0, 1, 0]]);
    roof(&at.join("soft.ply"), [[0, 0, 1], [0, 0, 1]]);
    for (name, n_vertices) in [("hard", 6), ("soft", 4)] {
        expect(at, &format!("convert {name}.ply {name}.glb --format float"), 0);
        let back = format!("convert {name}.glb back.ply --format ascii --force");
        let said = expect(at, &back, 0);
        assert!(!said.contains("lost"), "{said}");
        let text = std::fs::read_to_string(at.join("back.ply")).unwrap();
        assert!(text.contains(&format!("element vertex {n_vertices}\n")), "{text}");
        assert_eq!(text.contains("0 1 0\n3 "), name == "hard", "{text}");
        for ending in ["glb", "ply"] {
            let simplify = format!("simplify {name}.{ending} out.ply --triangles 2 --force");
            let said = expect(at, &simplify, 0);
            assert_eq!(said.contains("normals of vertices, 2 of them: "), name == "hard", "{said}");
            let said = expect(at, &format!("{simplify} --normals drop"), 0);
            assert!(!said.contains("lost"), "{said}");
        }
    }
    let said = expect(at, "convert hard.glb welded.ply --weld auto", 0);
    assert!(said.contains("--weld off keeps them apart"), "{said}");
}

/// A PNG as far as its header and its end go.
fn png() -> Vec<u8> {
    b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\0\x02\0\0\0\x02\x08\x02\0\0\0\0\0\0\0IEND\xaeB`\x82"
        .to_vec()
}

#[test]
fn the_only_image_of_an_obj_is_found_or_missed() {
    let at = &scratch();
    std::fs::write(at.join("i.png"), png()).unwrap();
    for (used, library, code, line) in [
        ("usemtl b.001\n", "newmtl b\nmap_Kd i.png\n", 0, "is taken for 'b.001'"),
        ("", "newmtl b\nmap_Kd i.png\n", 0, "is taken for all faces"),
        ("usemtl b\n", "newmtl b\nKd 1 1 1\nnewmtl b\nmap_Kd i.png\n", 0, "described again"),
        ("usemtl b\n", "map_Kd i.png\nnewmtl b\n", 3, "before the first 'newmtl'"),
        ("usemtl b\n", "newmtl b\nmap_Kd\n", 3, "name no file"),
        ("usemtl c\n", "newmtl a\nmap_Kd i.png\nnewmtl b\n", 3, "no material that a face names"),
        ("", "newmtl a\nmap_Kd i.png\nnewmtl b\n", 3, "no material that a face names"),
        ("usemtl b\n", "newmtl a\nmap_Kd i.png\nnewmtl b\n", 0, ""),
    ] {
        std::fs::write(at.join("a.mtl"), library).unwrap();
        let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\n";
        let text = format!("mtllib a.mtl\n{text}{used}f 1/1 2/2 3/3\n");
        std::fs::write(at.join("in.obj"), text).unwrap();
        for command in ["convert in.obj", "simplify in.obj --ratio 100%"] {
            let said = expect(at, &format!("{command} out.glb --force"), code);
            assert!(said.contains(line), "{library}: {said}");
            let has_image = !glb_json(&at.join("out.glb"))["images"].is_null();
            assert_eq!(has_image, code == 0 && !line.is_empty(), "{library}: {said}");
            expect(at, &format!("{command} out.glb --force --drop-texture"), 0);
        }
    }
}

#[test]
fn options_of_an_image_go_into_the_coordinates_of_a_ply() {
    let at = &scratch();
    std::fs::write(at.join("i.png"), png()).unwrap();
    let text = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl a\nf 1/1 2/2 3/3\n";
    std::fs::write(at.join("in.obj"), text).unwrap();
    for (options, texcoord) in [
        ("-s 2 3 1 -o 0.5", "6 0.5 0 2.5 0 0.5 3"),
        ("-s -1 1 1", "6 0 0 -1 0 0 1"),
        ("", "6 0 0 1 0 0 1"),
    ] {
        std::fs::write(at.join("a.mtl"), format!("newmtl a\nmap_Kd {options} i.png\n")).unwrap();
        for command in ["convert in.obj", "simplify in.obj --texture keep --ratio 100%"] {
            let said = expect(at, &format!("{command} out.ply --format ascii --force"), 0);
            assert!(!said.contains("lost"), "{said}");
            let text = std::fs::read_to_string(at.join("out.ply")).unwrap();
            assert!(text.replace("-0 ", "0 ").contains(texcoord), "{command}: {text}");
        }
    }
}

#[test]
fn remedies_and_reasons_of_glb_are_true() {
    let at = &scratch();
    pyramid(&at.join("in.ply"), "", &["uchar red"], &[]);
    let said = expect(at, "convert in.ply out.glb", 3);
    assert!(said.contains("colours of vertices (red)") && said.contains("; PLY has"), "{said}");
    pyramid(&at.join("in.ply"), "", &[], &[]);
    for (output, is_said) in [("out.glb", true), ("out.ply", false)] {
        let lock = format!("simplify in.ply {output} --lock boundary --ratio 100% --force");
        assert_eq!(expect(at, &lock, 0).contains("places of locked vertices"), is_said);
    }
    let text = std::fs::read_to_string(at.join("in.ply")).unwrap();
    let text = text.replace("float x", "double x").replace("float y", "double y");
    let text = text.replace("float z", "double z");
    std::fs::write(at.join("in.ply"), text).unwrap();
    expect(at, "convert in.ply small.ply --scale 1e-46", 0);
    let said = expect(at, "convert small.ply small.glb", 4);
    assert!(said.contains("--scale"), "{said}");
}

#[test]
fn losses_are_objects_in_progress_json() {
    let at = &scratch();
    pyramid(&at.join("in.ply"), "", &COLOURS, &[]);
    let output = run(at, "simplify in.ply out.stl --triangles 4 --progress json");
    assert_eq!(output.status.code(), Some(3));
    let said = String::from_utf8(output.stderr).unwrap();
    let lines = said.lines().filter_map(|line| serde_json::from_str::<Value>(line).ok());
    let found: Vec<Value> = lines.filter(|line| line["loss"].is_object()).collect();
    assert_eq!(found.len(), 1, "{said}");
    assert_eq!(found[0]["loss"]["kind"], "colors");
}
