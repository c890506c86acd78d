//! Files that have everything their format can hold, through every format and command: each kind of content is in the output,
//! by small readers that share nothing with the program, or its loss is in the ledger.
//!
//! `cargo test --test formats kept_and_named -- --nocapture` prints the table of docs/results/formats.md. With a folder in
//! `STONECUT_KEPT` the files are written there; `tools/kept_by_others.py` reads what becomes of them with other programs.

#![allow(clippy::print_stdout)] // The table.

mod held;
mod written;

use crate::common::{json, run, scratch};
use held::held;
use written::{SIDE, image, write_gltf, write_obj, write_ply, write_stl};

/// A kind of content: its name, and the kind of loss and the words by which the ledger may name it instead.
type Kind = (&'static str, &'static [(&'static str, &'static str)]);

/// All kinds.
const KINDS: [Kind; 30] = [
    ("places far away", &[("precision", "")]),
    ("normals", &[("normals", "")]),
    ("colours of vertices", &[("colors", "colours of vertices")]),
    ("opacity", &[("colors", "opacity"), ("colors", "colours of vertices")]),
    ("texture coordinates", &[("texture_coordinates", ""), ("images", "texture coordinates")]),
    ("second coordinates", &[("texture_coordinates", ""), ("attributes", "(s, t)")]),
    ("materials", &[("materials", ""), ("images", "images")]),
    ("images", &[("images", "")]),
    ("normal map", &[("images", "normal map"), ("images", "images"), ("materials", "normal map")]),
    ("colours of materials", &[("colors", "material"), ("materials", "")]),
    ("names", &[("names", "names of objects")]),
    ("labels of vertices", &[("attributes", "class")]),
    ("numbers of vertices", &[("attributes", "quality")]),
    ("lists of vertices", &[("attributes", "rings")]),
    ("colours of faces", &[("colors", "colours of faces"), ("attributes", "red")]),
    ("labels of faces", &[("attributes", "part")]),
    ("numbers of faces", &[("attributes", "score")]),
    ("lists of faces", &[("attributes", "flags")]),
    ("lines and points", &[("elements", "")]),
    ("smoothing groups", &[("normals", "smoothing")]),
    ("comments", &[("names", "comments")]),
    ("bytes of facets", &[("attributes", "attribute bytes")]),
    ("tangents", &[("normals", "tangent")]),
    ("skins", &[("elements", "skins")]),
    ("morph targets", &[("elements", "morph")]),
    ("cameras", &[("elements", "cameras")]),
    ("lights", &[("elements", "extension")]),
    ("other scenes", &[("elements", "meshes")]),
    ("names of other nodes", &[("names", "nodes without a mesh")]),
    ("material extensions", &[("materials", "clearcoat")]),
];

/// Contents of each input.
const INPUTS: [(&str, &str); 5] = [
    (
        "full.ply",
        "places far away, normals, colours of vertices, opacity, texture coordinates, \
         second coordinates, images, labels of vertices, numbers of vertices, lists of vertices, \
         colours of faces, labels of faces, numbers of faces, lists of faces, lines and points, \
         comments",
    ),
    (
        "full.obj",
        "places far away, normals, colours of vertices, opacity, texture coordinates, materials, \
         colours of materials, images, normal map, names, lines and points, smoothing groups, \
         comments",
    ),
    ("colours.stl", "colours of faces, comments"),
    ("bytes.stl", "bytes of facets, comments"),
    (
        "full.gltf",
        "normals, tangents, colours of vertices, opacity, texture coordinates, \
         second coordinates, materials, colours of materials, images, normal map, names, \
         numbers of vertices, lines and points, skins, morph targets, cameras, lights, \
         other scenes, names of other nodes, material extensions, comments",
    ),
];

/// Commands by the columns of the table; IN and the output's ending follow.
const COMMANDS: [(&str, &str, &str); 11] = [
    ("convert, PLY", "convert IN OUT", "ply"),
    ("OBJ", "convert IN OUT", "obj"),
    ("STL", "convert IN OUT", "stl"),
    ("GLB", "convert IN OUT", "glb"),
    ("simplify, PLY", "simplify IN OUT --ratio 50% --texture keep", "ply"),
    ("OBJ", "simplify IN OUT --ratio 50% --texture keep", "obj"),
    ("STL", "simplify IN OUT --ratio 50% --texture keep", "stl"),
    ("GLB", "simplify IN OUT --ratio 50% --texture keep", "glb"),
    (
        "bake, GLB",
        "simplify IN OUT --ratio 50% --texture bake --bake-size 64 --normals recompute",
        "glb",
    ),
    (
        "bake, OBJ",
        "simplify IN OUT --ratio 50% --texture bake --bake-size 64 --normals recompute",
        "obj",
    ),
    ("tiles", "tiles IN OUT", "tiles"),
];

#[test]
fn every_kind_of_content_is_kept_or_named() {
    let folder = tempfile::tempdir().unwrap();
    let named = std::env::var_os("STONECUT_KEPT").map(std::path::PathBuf::from);
    let at = named.as_deref().unwrap_or(folder.path());
    for (name, colour) in
        [("a.png", [200, 30, 30]), ("b.png", [30, 30, 200]), ("n.png", [128, 128, 255])]
    {
        image(&at.join(name), colour);
    }
    write_ply(at);
    write_obj(at);
    write_stl(at, "colours.stl", |part| if part == 0 { 0x801f } else { 0xfc00 });
    write_stl(at, "bytes.stl", |part| part as u16 + 1);
    write_gltf(at);
    let heads: Vec<&str> = COMMANDS.iter().map(|(head, _, _)| *head).collect();
    println!(
        "| input | content | {} |\n|---|---|{}",
        heads.join(" | "),
        "---|".repeat(heads.len())
    );
    let mut silent = Vec::new();
    for (input, kinds) in INPUTS {
        let known = |name: &str| KINDS.iter().find(|kind| kind.0 == name).unwrap();
        let kinds: Vec<&Kind> = kinds.split(", ").map(known).collect();
        let mut columns = Vec::new();
        for (i, (_, command, ending)) in COMMANDS.iter().enumerate() {
            let stem = input.replace('.', "_");
            let output = format!("{stem}_{i}.{ending}");
            let mut command = command.replace("IN", input).replace("OUT", &output);
            let has_looks = kinds.iter().any(|kind| kind.0 == "images");
            if !has_looks {
                command = command.split(" --texture").next().unwrap().to_owned();
            }
            let done = run(at, &format!("{command} --force --report r.json"));
            let said = String::from_utf8_lossy(&done.stderr).into_owned();
            // A refusal says what to do; nothing is written then.
            if done.status.code() == Some(2) && command.contains("--texture bake") {
                columns.push(vec!["refused"; kinds.len()]);
                continue;
            }
            assert!([Some(0), Some(3)].contains(&done.status.code()), "{command}\n{said}");
            let report = json(at, "r.json");
            let losses = report["losses"].as_array().unwrap().clone();
            let held = held(&at.join(&output));
            columns.push(
                kinds
                    .iter()
                    .map(|(kind, losses_of)| {
                        let is_named = losses.iter().any(|loss| {
                            let what =
                                format!("{} {} {}", loss["what"], loss["example"], loss["reason"])
                                    .to_lowercase();
                            losses_of
                                .iter()
                                .any(|(of, words)| loss["kind"] == *of && what.contains(words))
                        });
                        match () {
                            () if held.contains(kind) => "kept",
                            () if is_named => "named",
                            () => {
                                silent.push(format!("{kind}: {command}\n{said}"));
                                "SILENT"
                            }
                        }
                    })
                    .collect::<Vec<_>>(),
            );
        }
        for (k, (kind, _)) in kinds.iter().enumerate() {
            let cells: Vec<&str> = columns.iter().map(|column| column[k]).collect();
            println!("| {input} | {kind} | {} |", cells.join(" | "));
        }
    }
    // A mesh out of tiles has colours in place of their images.
    let done = run(at, "extract full_obj_10.tiles out.ply --max-error 0");
    let said = String::from_utf8_lossy(&done.stderr).into_owned();
    assert!(said.contains("texture coordinates and images: not carried"), "{said}");
    assert!(silent.is_empty(), "lost in silence:\n{}", silent.join("\n"));
}

/// Colours beyond white, through those who show them.
#[test]
fn clamped_colours_are_named_by_every_command_that_clamps() {
    let at = &scratch();
    write_ply(at);
    let text = std::fs::read_to_string(at.join("full.ply")).unwrap();
    let (head, body) = text.split_once("end_header\n").unwrap();
    // Shares of white, one of them too bright; images are not wanted here.
    let head = ["red", "green", "blue"].iter().fold(head.to_owned(), |head, name| {
        head.replace(&format!("property uchar {name}"), &format!("property float {name}"))
    });
    let head: String = head
        .lines()
        .filter(|line| !line.contains("TextureFile"))
        .map(|line| line.to_owned() + "\n")
        .collect();
    let head = head.replace("list uchar float texcoord", "list uchar float rest");
    let rows = body.lines().enumerate().map(|(i, line)| {
        let mut words: Vec<String> = line.split(' ').map(str::to_owned).collect();
        if i < SIDE * SIDE {
            words[6] = if i == 7 { "1.5".to_owned() } else { "0.25".to_owned() };
            (words[7], words[8]) = ("0.5".to_owned(), "0.75".to_owned());
        }
        words.join(" ") + "\n"
    });
    std::fs::write(at.join("in.ply"), head + "end_header\n" + &rows.collect::<String>()).unwrap();
    for command in [
        "convert in.ply a.obj",
        "convert in.ply a.glb",
        "simplify in.ply b.glb --ratio 100%",
        "render in.ply -o a.png --size 64x64",
        "tiles in.ply tiles",
    ] {
        let done = run(at, &format!("{command} --force"));
        let said = String::from_utf8_lossy(&done.stderr).into_owned();
        assert!(said.contains("outside of black to white: clamped"), "{command}\n{said}");
    }
    let done = run(at, "convert in.ply same.ply");
    assert!(!String::from_utf8_lossy(&done.stderr).contains("clamped"), "{done:?}");
}
