//! Several files that become one mesh: joined borders, unions of what they carry, and sets that cannot be meant.

use crate::common::{expect, glb_json, json, printed, scratch};
use serde_json::Value;
use std::path::Path;

pub(crate) fn info(at: &Path, words: &str) -> Value {
    printed(at, &format!("info --json {words}"))
}

/// Refuses a mesh that is not one closed piece.
pub(crate) fn assert_closed(found: &Value, n_triangles: u64, words: &str) {
    let count = |key: &str| found[key].as_u64().unwrap();
    let open = [count("components"), count("boundary_edges"), count("non_manifold_edges")];
    assert_eq!(open, [1, 0, 0], "{words}: {found}");
    assert_eq!((count("triangles"), count("unreferenced_vertices")), (n_triangles, 0), "{words}");
}

/// Joins a folder in which a tile is there under another name, too, to the same closed piece.
pub(crate) fn assert_a_copy_is_taken_once(at: &Path, format: &str, n_triangles: u64, words: &str) {
    let ending = format!("tiles/tile_003.{format}");
    std::fs::copy(at.join(&ending), at.join(format!("tiles/copy.{format}"))).unwrap();
    let said = expect(at, "convert tiles joined.ply --force", 0);
    assert!(said.contains("is the same mesh as"), "{said}");
    assert_closed(&info(at, "joined.ply --check"), n_triangles, words);
}

#[test]
fn tiles_of_any_format_and_rounding_become_one_closed_mesh() {
    let at = &scratch();
    expect(at, "synth statue whole.ply --triangles 3000 --seed 3", 0);
    let n_triangles = info(at, "whole.ply --check")["triangles"].as_u64().unwrap();
    for (format, round) in
        [("ply", ""), ("ply", "--round 2"), ("obj", "--round 3"), ("glb", ""), ("stl", "")]
    {
        let words = format!(
            "synth statue tiles --triangles 3000 --seed 3 --tiles 8 --format {format} {round}"
        );
        expect(at, &words, 0);
        let found = info(at, "tiles --check");
        assert_closed(&found, n_triangles, &words);
        assert_eq!(found["inputs"].as_array().unwrap().len(), 8);
        assert!(found["joined"].as_u64().unwrap() > 100, "{found}");
        assert_a_copy_is_taken_once(at, format, n_triangles, &words);
        std::fs::remove_dir_all(at.join("tiles")).unwrap();
    }
}

#[test]
fn a_set_gives_the_same_bytes_in_any_order_and_with_any_memory() {
    let at = &scratch();
    expect(at, "synth statue tiles --triangles 4000 --tiles 8 --format obj --round 3", 0);
    let names: Vec<String> = (0..8).map(|i| format!("tiles/tile_00{i}.obj")).collect();
    let turned: Vec<String> = names.iter().rev().cloned().collect();
    std::fs::write(at.join("list.txt"), turned.join("\n")).unwrap();
    let twice = format!("{} tiles/../tiles/tile_003.obj", names.join(" "));
    let mut first = None;
    for inputs in ["tiles", "@list.txt", &names.join(" "), &turned.join(" "), &twice] {
        for memory in ["", "--memory 64MiB --threads 1"] {
            let words =
                format!("simplify {inputs} out.ply --ratio 20% --force --report r.json {memory}");
            let said = expect(at, &words, 0);
            assert!(said.contains("8 files became one mesh"), "{said}");
            assert_eq!(said.contains("named more than once"), inputs == twice, "{said}");
            let bytes = std::fs::read(at.join("out.ply")).unwrap();
            assert_eq!(first.get_or_insert_with(|| bytes.clone()), &bytes, "{words}");
        }
    }
    let report = json(at, "r.json");
    assert_eq!(report["inputs"].as_array().unwrap().len(), 8);
    assert_closed(
        &info(at, "out.ply --check"),
        report["output"]["triangles"].as_u64().unwrap(),
        "out.ply",
    );
    for words in [
        "convert tiles whole.ply",
        "measure tiles out.ply --samples 1000",
        "tiles tiles tree",
        "render tiles -o picture.png --size 64x64",
        "plan job tiles planned.ply --ratio 20% --units 2",
    ] {
        expect(at, words, 0);
    }
    assert_closed(
        &info(at, "whole.ply --check"),
        report["input"]["triangles"].as_u64().unwrap(),
        "whole.ply",
    );
    for unit in ["partition/0", "finish/0", "rest/0"] {
        expect(at, &format!("work job {unit}"), 0);
    }
    assert_eq!(first, std::fs::read(at.join("planned.ply")).ok());
}

#[test]
fn sets_that_cannot_be_meant_are_refused_by_name() {
    let at = &scratch();
    expect(at, "synth statue tiles --triangles 1000 --tiles 4 --format ply", 0);
    for (words, code, what) in [
        ("simplify tiles/tile_000.ply no.ply out.ply --ratio 5%", 4, "no.ply"),
        ("simplify tiles tiles/out.ply --ratio 5%", 2, "whose meshes are the input"),
        ("simplify tiles/tile_000.ply --ratio 5%", 2, "the path of the result comes"),
        ("simplify - tiles/tile_000.ply out.ply --ratio 5%", 2, "standard input"),
        ("simplify @none.txt out.ply --ratio 5%", 4, "none.txt"),
    ] {
        let said = expect(at, words, code);
        assert!(said.contains(what), "{words}: {said}");
    }
    std::fs::write(at.join("tiles/cut.ply"), "ply\nformat ascii 1.0\n").unwrap();
    let said = expect(at, "simplify tiles out.ply --ratio 50%", 4);
    assert!(said.contains("cut.ply"), "{said}");
    let said = expect(at, "simplify tiles out.ply --ratio 50% --skip-bad", 3);
    assert!(said.contains("cut.ply") && said.contains("left out"), "{said}");
    std::fs::write(at.join("list.txt"), "tiles/tile_000.ply\ntiles/gone.ply\n").unwrap();
    let said = expect(at, "convert @list.txt out.ply --force", 4);
    assert!(said.contains("tiles/gone.ply: the file does not exist"), "{said}");
    for inputs in ["@list.txt", "tiles/tile_000.ply tiles/gone.ply"] {
        let said = expect(at, &format!("convert {inputs} out.ply --force --skip-bad"), 3);
        assert!(said.contains("gone.ply: not there"), "{said}");
    }
    std::fs::create_dir(at.join("empty")).unwrap();
    std::fs::write(at.join("list.txt"), "\u{feff}tiles\\tile_000.ply\r\nempty\r\n").unwrap();
    for (skip, code) in [("", 4), (" --skip-bad", 3)] {
        let said = expect(at, &format!("convert @list.txt out.ply --force{skip}"), code);
        assert!(said.contains("empty: no mesh in this folder"), "{said}");
    }
    std::fs::write(at.join("tiles/other.obj"), "").unwrap();
    let said = expect(at, "simplify tiles out.ply --ratio 50%", 4);
    assert!(said.contains("1 .obj, 5 .ply"), "{said}");
}

/// Nothing that lies in a folder is left out in silence, and what does not fit the rest is named.
#[test]
fn odd_files_in_a_folder_are_named() {
    let at = &scratch();
    expect(at, "synth statue whole --triangles 2000 --tiles 8 --format obj --round 3", 0);
    let fresh = || {
        let _ = std::fs::remove_dir_all(at.join("t"));
        std::fs::create_dir(at.join("t")).unwrap();
        for n in 0..8 {
            let name = format!("tile_00{n}.obj");
            std::fs::copy(at.join("whole").join(&name), at.join("t").join(name)).unwrap();
        }
    };
    let third = std::fs::read_to_string(at.join("whole/tile_003.obj")).unwrap();
    let moved = |map: &dyn Fn([f64; 3]) -> [f64; 3]| -> String {
        let line = |line: &str| match line.strip_prefix("v ") {
            Some(place) => {
                let p: Vec<f64> = place.split(' ').map(|x| x.parse().unwrap()).collect();
                let [x, y, z] = map([p[0], p[1], p[2]]);
                format!("v {x} {y} {z}\n")
            }
            None => format!("{line}\n"),
        };
        third.lines().map(line).collect()
    };
    let points = third.lines().filter(|line| !line.starts_with('f')).collect::<Vec<_>>().join("\n");
    for (text, code, what) in [
        (String::new(), 4, "tile_003.obj: the file is empty"),
        (points, 4, "tile_003.obj: it has"),
        (moved(&|p| p.map(|x| 1000.0 * x)), 0, "tile_003.obj: is "),
        (moved(&|[x, y, z]| [x, z, -y]), 0, "tile_003.obj: no vertex of it lies at one of"),
        (moved(&|[x, y, z]| [x + 5e5, y, z]), 0, "tile_003.obj: no vertex of it lies at one of"),
    ] {
        fresh();
        std::fs::write(at.join("t/tile_003.obj"), text).unwrap();
        let said = expect(at, "convert t out.ply --force", code);
        assert!(said.contains(what), "{what}: {said}");
        if code == 4 {
            let said = expect(at, "convert t out.ply --force --skip-bad", 3);
            assert!(said.contains(what) && said.contains("7 files became"), "{what}: {said}");
        }
    }
    // What is no mesh, and meshes in folders beside meshes.
    fresh();
    for name in ["._tile_000.obj", "Thumbs.db", ".DS_Store", "notes.txt"] {
        std::fs::write(at.join("t").join(name), "x").unwrap();
    }
    std::fs::create_dir_all(at.join("t/images")).unwrap();
    std::fs::write(at.join("t/images/photo.jpg"), "x").unwrap();
    let said = expect(at, "convert t out.ply --force", 0);
    assert!(said.contains("8 files became") && !said.contains("note"), "{said}");
    std::fs::create_dir_all(at.join("t/b")).unwrap();
    std::fs::rename(at.join("t/tile_000.obj"), at.join("t/b/tile_000.obj")).unwrap();
    let said = expect(at, "convert t out.ply --force", 0);
    assert!(said.contains("7 files became"), "{said}");
    assert!(said.contains("t/b: meshes in it are not read (1)"), "{said}");
    let said = expect(at, "convert t t/b out.ply --force", 0);
    assert!(said.contains("8 files became"), "{said}");
    // The tree of a tile: the finest of each place.
    for (i, name) in ["L16_0", "L17_00", "L17_01", "L18_000"].iter().enumerate() {
        let inner = at.join("lods/Tile_+000_+001");
        std::fs::create_dir_all(&inner).unwrap();
        let from = at.join(format!("whole/tile_00{i}.obj"));
        std::fs::copy(from, inner.join(format!("Tile_+000_+001_{name}.obj"))).unwrap();
    }
    let said = expect(at, "convert lods out.ply --force", 0);
    assert!(said.contains("2 files became"), "{said}");
    assert!(said.contains("a coarser level of detail, left out (2 such in all)"), "{said}");
}

/// Parts that were recentred one by one, or have their own offset beside them, come to lie where they belong.
#[test]
fn files_that_count_from_different_places_are_brought_to_one() {
    let at = &scratch();
    let square = |name: &str, [x, y]: [i64; 2]| {
        let [right, back] = [x + 1, y + 1];
        let text = format!(
            "v {x} {y} 0\nv {right} {y} 0\nv {right} {back} 0\nv {x} {back} 0\nf 1 2 3 4\n"
        );
        std::fs::write(at.join(name), text).unwrap();
    };
    for inner in ["t", "beside", "mixed"] {
        std::fs::create_dir(at.join(inner)).unwrap();
    }
    for (name, x) in [("a", 5_000_000), ("b", 5_000_001)] {
        square(&format!("{name}.obj"), [x, 0]);
        expect(at, &format!("convert {name}.obj t/{name}.ply --recentre"), 0);
        square(&format!("beside/{name}.obj"), [0, 0]);
        let offset = format!("{x} 0 0\n");
        std::fs::write(at.join(format!("beside/{name}_offset.xyz")), offset).unwrap();
    }
    std::fs::write(at.join("beside/b.prj"), "EPSG:32633").unwrap();
    for set in ["t", "beside", "a.obj b.obj"] {
        let said = expect(at, &format!("convert {set} out.obj --force"), 0);
        let is_moved = set != "a.obj b.obj";
        assert_eq!(said.contains("1 files count from other places"), is_moved, "{said}");
        let text = std::fs::read_to_string(at.join("out.obj")).unwrap();
        let offset = if set == "t" { "# offset: 5000001 1 0 " } else { "# offset: 5000000 0 0 " };
        assert_eq!(text.contains(offset), is_moved, "{set}: {text}");
        assert_eq!(text.contains("# crs EPSG:32633"), set == "beside", "{set}: {text}");
        let last = match set {
            "t" => "v 1 0 0",
            "beside" => "v 2 1 0",
            _ => "v 5000002 1 0",
        };
        assert!(text.contains(last) && text.matches("\nv ").count() == 6, "{set}: {text}");
    }
    // One that says no offset could lie anywhere, and one of another system somewhere else.
    square("mixed/a.obj", [0, 0]);
    std::fs::copy(at.join("t/b.ply"), at.join("mixed/b.ply")).unwrap();
    let said = expect(at, "convert mixed/a.obj mixed/b.ply no.ply", 4);
    assert!(said.contains("b.ply") && said.contains("another place"), "{said}");
    assert!(said.contains("each of those") && said.contains("0 0 0"), "{said}");
    // No offset is one, too, once a file says so.
    square("mixed/a.obj", [5_000_000, 0]);
    std::fs::write(at.join("mixed/a_offset.xyz"), "0 0 0\n").unwrap();
    expect(at, "convert mixed/a.obj mixed/b.ply mixed.obj", 0);
    let text = std::fs::read_to_string(at.join("mixed.obj")).unwrap();
    assert!(text.contains("v 5000002 1 0") && text.matches("\nv ").count() == 6, "{text}");
    for (name, code) in [("a", 32633), ("b", 32632)] {
        std::fs::write(at.join(format!("beside/{name}.prj")), format!("EPSG:{code}")).unwrap();
    }
    let said = expect(at, "convert beside no.ply", 4);
    assert!(said.contains("EPSG:32632") && said.contains("not EPSG:32633"), "{said}");
}

#[test]
fn what_some_files_carry_is_there_and_neutral_elsewhere() {
    let at = &scratch();
    // Two squares side by side; each has a property that the other has not.
    let ply = |name: &str, property: &str, rows: [&str; 4]| {
        let text = format!(
            "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
             {property}element face 1\nproperty list uchar int vertex_indices\nend_header\n{}\n4 0 1 2 3\n",
            rows.join("\n")
        );
        std::fs::write(at.join(name), text).unwrap();
    };
    let red = "property uchar red\nproperty uchar green\nproperty uchar blue\n";
    ply("a.ply", red, ["0 0 0 9 0 0", "1 0 0 9 0 0", "1 1 0 9 0 0", "0 1 0 9 0 0"]);
    ply("b.ply", "property float quality\n", ["1 0 0 5", "2 0 0 5", "2 1 0 5", "1 1 0 5"]);
    let said = expect(at, "convert a.ply b.ply out.ply --format ascii", 0);
    assert!(said.contains("4 vertices") || said.contains("6 vertices"), "{said}");
    let text = std::fs::read_to_string(at.join("out.ply")).unwrap();
    assert!(
        text.contains("element vertex 6\n") && text.contains("2 0 0 255 255 255 5\n"),
        "{text}"
    );
    assert!(said.contains("red green blue of vertices: 1 of 2 files are without"), "{said}");
}

#[test]
fn equal_materials_and_images_of_tiles_are_one() {
    let at = &scratch();
    // Three squares in a row; the images of the first two have the same content.
    for (i, image) in ["same", "same", "other"].into_iter().enumerate() {
        let tile = at.join(format!("tiles/{i}"));
        std::fs::create_dir_all(&tile).unwrap();
        let mut png = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\0\x02\0\0\0\x02\x08\x02\0\0\0".to_vec();
        png.extend_from_slice(image.as_bytes());
        std::fs::write(tile.join("photo.png"), png).unwrap();
        std::fs::write(tile.join("t.mtl"), "newmtl photo\nmap_Kd photo.png\n").unwrap();
        let x = [i, i + 1];
        let text = format!(
            "mtllib t.mtl\nv {0} 0 0\nv {1} 0 0\nv {1} 1 0\nv {0} 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n\
             usemtl photo\nf 1/1 2/2 3/3 4/4\n",
            x[0], x[1]
        );
        std::fs::write(tile.join("t.obj"), text).unwrap();
    }
    let found = info(at, "tiles --check");
    assert_eq!(found["images"].as_array().unwrap().len(), 2, "{found}");
    assert_eq!(found["materials"].as_array().unwrap().len(), 2, "{found}");
    expect(at, "convert tiles out.obj --textures link", 0);
    let text = std::fs::read_to_string(at.join("out.obj")).unwrap();
    assert_eq!(text.matches("usemtl").count(), 2, "{text}");
    assert_eq!((text.matches("\nf ").count(), text.matches("\nv ").count()), (6, 8), "{text}");
}

/// Places in images stay without a material, and normals that only some files have go: those of length 0 are black.
#[test]
fn places_in_images_stay_and_normals_of_some_files_go() {
    let at = &scratch();
    for folder in ["flat", "lit"] {
        std::fs::create_dir(at.join(folder)).unwrap();
    }
    for x in 0..2 {
        let places = format!("v {x} 0 0\nv {} 0 0\nv {x} 1 0\n", x + 1);
        let text = format!("{places}vt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n");
        std::fs::write(at.join(format!("flat/{x}.obj")), text).unwrap();
        let (named, values) =
            [("", ""), ("property float nx\nproperty float ny\nproperty float nz\n", " 0 0 1")][x];
        let rows: String =
            [[x, 0], [x + 1, 0], [x, 1]].map(|[x, y]| format!("{x} {y} 0{values}\n")).concat();
        let text = format!(
            "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n{named}\
             element face 1\nproperty list uchar int vertex_indices\nend_header\n{rows}3 0 1 2\n"
        );
        std::fs::write(at.join(format!("lit/{x}.ply")), text).unwrap();
    }
    let attributes = |name: &str| {
        let said = expect(at, &format!("convert {name} {name}.glb"), 0);
        (
            glb_json(&at.join(format!("{name}.glb")))["meshes"][0]["primitives"][0]["attributes"]
                .clone(),
            said,
        )
    };
    let (flat, _) = attributes("flat");
    assert!(flat.get("TEXCOORD_0").is_some(), "{flat}");
    let (lit, said) = attributes("lit");
    assert!(
        lit.get("NORMAL").is_none() && said.contains("1 of 2 files are without, so no vertex"),
        "{lit} {said}"
    );
}

/// A GLB as a batched mesh whose coordinates count from a place.
fn batched(glb: &[u8], center: [f64; 3]) -> Vec<u8> {
    let mut table = serde_json::json!({ "BATCH_LENGTH": 0, "RTC_CENTER": center }).to_string();
    while table.len() % 8 != 4 {
        table.push(' ');
    }
    let mut out = b"b3dm".to_vec();
    for n in [1, 28 + table.len() + glb.len(), table.len(), 0, 0, 0] {
        out.extend((n as u32).to_le_bytes());
    }
    out.extend(table.as_bytes());
    out.extend(glb);
    out
}

/// The folder of a tree that another program has made is a mesh for `info`, too; a progressive mesh names its command.
#[test]
fn trees_of_others_and_progressive_meshes_are_known() {
    let at = &scratch();
    expect(at, "synth statue tree --triangles 1000 --tiles 2 --format glb", 0);
    let tile = |name: &str| {
        serde_json::json!({
            "boundingVolume": { "sphere": [0, 0, 0, 1e4] }, "geometricError": 0, "content": { "uri": name },
        })
    };
    let names: Vec<_> = std::fs::read_dir(at.join("tree")).unwrap().flatten().collect();
    let tiles: Vec<_> = names.iter().map(|name| tile(name.file_name().to_str().unwrap())).collect();
    let root = serde_json::json!({
        "boundingVolume": { "sphere": [0, 0, 0, 1e4] }, "geometricError": 9, "refine": "ADD", "children": tiles,
    });
    let set =
        serde_json::json!({ "asset": { "version": "1.1" }, "geometricError": 9, "root": root });
    std::fs::write(at.join("tree/tileset.json"), set.to_string()).unwrap();
    let of_folder = info(at, "tree")["triangles"].clone();
    assert_eq!(of_folder, info(at, "tree/tileset.json")["triangles"]);
    expect(at, "convert tree whole.ply", 0);
    expect(at, "simplify whole.ply o.ply --ratio 50% --progressive o.pm", 0);
    assert!(expect(at, "convert o.pm p.ply", 4).contains("'stonecut refine'"));
}

#[test]
fn trees_of_tiles_become_one_mesh_in_their_place() {
    let at = &scratch();
    // A tree of several levels: the finest tiles are the mesh, where it was.
    expect(at, "synth statue whole.ply --triangles 2000", 0);
    let n_triangles = info(at, "whole.ply")["triangles"].as_u64().unwrap();
    expect(at, "tiles whole.ply own --tile-triangles 500", 0);
    expect(at, "convert own/tileset.json own.ply --weld auto", 0);
    assert_closed(&info(at, "own.ply --check"), n_triangles, "own");
    // Batched meshes at the earth's centre, and points, which are named.
    let far = [4_278_000.0, 636_000.0, 4_672_000.0];
    expect(at, "synth statue glb --triangles 1000 --tiles 4 --format glb", 0);
    std::fs::create_dir(at.join("b3dm")).unwrap();
    let mut tiles = Vec::new();
    for n in 0..4 {
        let glb = std::fs::read(at.join(format!("glb/tile_00{n}.glb"))).unwrap();
        let name = format!("{n}.b3dm");
        std::fs::write(at.join("b3dm").join(&name), batched(&glb, far)).unwrap();
        tiles.push(serde_json::json!({ "geometricError": 0, "content": { "uri": name } }));
    }
    let mut points = b"pnts".to_vec();
    [1u32, 28, 0, 0, 0, 0].iter().for_each(|n| points.extend(n.to_le_bytes()));
    std::fs::write(at.join("b3dm/p.pnts"), points).unwrap();
    tiles.push(serde_json::json!({ "geometricError": 0, "content": { "uri": "p.pnts" } }));
    let set = serde_json::json!({ "asset": { "version": "1.0" }, "geometricError": 9,
        "root": { "refine": "ADD", "geometricError": 8, "children": tiles } });
    std::fs::write(at.join("b3dm/tileset.json"), set.to_string()).unwrap();
    let said = expect(at, "convert b3dm earth.ply --weld auto", 0);
    assert!(said.contains("pnts"), "{said}");
    // By any name.
    std::fs::copy(at.join("b3dm/tileset.json"), at.join("b3dm/root.json")).unwrap();
    expect(at, "convert b3dm/root.json named.ply --weld auto", 0);
    assert_eq!(info(at, "named.ply")["triangles"], info(at, "earth.ply")["triangles"]);
    let found = info(at, "earth.ply --check");
    assert_closed(&found, info(at, "glb --check")["triangles"].as_u64().unwrap(), "earth");
    assert_eq!(found["coordinate_bits"], 64, "places of the earth take doubles");
    // A tile by itself lies as it does in the tree.
    let alone = info(at, "b3dm/2.b3dm --check");
    assert_eq!(
        (alone["inputs"].as_array().unwrap().len(), &alone["file_format"]),
        (1, &"3D Tiles".into())
    );
    // A folder of trees is these, whatever lies below them; a root of another name among its meshes, too.
    std::fs::create_dir(at.join("both")).unwrap();
    std::fs::create_dir(at.join("both/named")).unwrap();
    for entry in std::fs::read_dir(at.join("b3dm")).unwrap() {
        let entry = entry.unwrap();
        std::fs::copy(entry.path(), at.join("both/named").join(entry.file_name())).unwrap();
    }
    std::fs::remove_file(at.join("both/named/tileset.json")).unwrap();
    expect(at, "convert both folder.ply --weld auto", 0);
    assert_eq!(
        std::fs::read(at.join("folder.ply")).unwrap(),
        std::fs::read(at.join("named.ply")).unwrap()
    );
    std::fs::copy(at.join("glb/tile_000.glb"), at.join("both/more.glb")).unwrap();
    std::fs::rename(at.join("both/named"), at.join("both/z")).unwrap();
    let said = expect(at, "convert both more.ply", 0);
    assert!(said.contains("z: meshes in it are not read"), "{said}");
    std::fs::remove_file(at.join("b3dm/2.b3dm")).unwrap();
    assert!(expect(at, "convert b3dm less.ply", 4).contains("2.b3dm"));
}
