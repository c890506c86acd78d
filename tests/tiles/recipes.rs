//! The recipes of docs/recipes.md for the shell, run as they stand on made-up results of photogrammetry programs.

use crate::common::{expect, json};
use std::path::Path;
use std::process::Command;

/// Beyond this a recipe is a program.
const MOST_LINES: usize = 30;

/// The lines for the shell below a heading.
fn recipe(title: &str) -> String {
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/recipes.md");
    let page = std::fs::read_to_string(page).unwrap();
    let (_, section) = page.split_once(&format!("## {title}\n")).unwrap();
    let (_, block) = section.split_once("```sh\n").unwrap();
    block.split("```").next().unwrap().to_owned()
}

/// Runs a recipe in a folder; gives what it says.
fn cook(at: &Path, title: &str) -> String {
    let lines = recipe(title);
    assert!(lines.lines().count() <= MOST_LINES);
    let program = Path::new(env!("CARGO_BIN_EXE_stonecut"));
    let paths = std::env::var_os("PATH").unwrap_or_default();
    let paths = std::iter::once(program.parent().unwrap().to_path_buf())
        .chain(std::env::split_paths(&paths).collect::<Vec<_>>());
    let output = Command::new("sh")
        .args(["-euc", &lines])
        .current_dir(at)
        .env("PATH", std::env::join_paths(paths).unwrap())
        .output()
        .unwrap();
    let said = [output.stdout, output.stderr].concat();
    let said = String::from_utf8_lossy(&said).into_owned();
    assert!(output.status.success(), "{title}: {said}");
    said
}

#[test]
fn the_recipe_for_opendronemap_makes_tiles_in_their_place() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    for name in ["odm_texturing", "odm_georeferencing"] {
        std::fs::create_dir(at.join(name)).unwrap();
    }
    std::fs::write(at.join("odm_georeferencing/coords.txt"), "WGS84 UTM 32N\n500000 5200000\n")
        .unwrap();
    expect(at, "synth rooms odm_texturing/odm_textured_model_geo.obj --triangles 1500 -q", 0);
    let said = cook(at, "OpenDroneMap, WebODM");
    assert!(said.contains("EPSG:32632, offset 500000 5200000 0"), "{said}");
    assert!(said.contains("verified: "), "{said}");
    let set = json(at, "web/tileset.json");
    assert_eq!(set["extras"]["stonecut"]["crs"], "EPSG:32632");
    assert!(set["extras"]["stonecut"]["texels_per_unit"].is_number());
    assert!(at.join("web/index.html").exists() && at.join("model.glb").exists());
}

#[test]
fn the_recipe_for_openmvs_takes_its_textured_ply() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    expect(at, "synth rooms tex.obj --triangles 1500 -q", 0);
    expect(at, "convert tex.obj scene_dense_mesh_refine_texture.ply -q", 0);
    for name in ["tex.obj", "tex.mtl"] {
        std::fs::remove_file(at.join(name)).unwrap();
    }
    cook(at, "openMVS");
    assert!(json(at, "web/tileset.json")["extras"]["stonecut"]["texels_per_unit"].is_number());
    assert!(at.join("model.glb").exists() && at.join("plain.ply").exists());
}

#[test]
fn the_recipe_for_metashape_joins_a_folder_of_tiles() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    std::fs::create_dir(at.join("Production_1")).unwrap();
    expect(at, "synth terrain Production_1/Data --triangles 3000 --tiles 4 -q", 0);
    let place = "<?xml version=\"1.0\"?>\n<ModelMetadata version=\"1\">\n<SRS>EPSG:32633</SRS>\n\
                 <SRSOrigin>500400,4600200,100</SRSOrigin>\n</ModelMetadata>\n";
    std::fs::write(at.join("Production_1/metadata.xml"), place).unwrap();
    let said = cook(at, "Metashape, RealityCapture, ContextCapture");
    assert!(said.contains("EPSG:32633, offset 500400 4600200 100 ("), "{said}");
    assert!(said.contains("verified: "), "{said}");
    assert_eq!(json(at, "web/tileset.json")["extras"]["stonecut"]["crs"], "EPSG:32633");
}
