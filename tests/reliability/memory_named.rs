//! A refusal for want of memory names a size, and that size is enough: given back, it is not refused again.

#![allow(clippy::print_stdout)] // Figures.

use crate::common::{expect, run, scratch, start};
use std::path::Path;

/// The size that a refusal names.
fn named(said: &str) -> String {
    let after = said.split("--memory ").nth(1).unwrap_or_else(|| panic!("no size: {said}"));
    after.chars().take_while(char::is_ascii_alphanumeric).collect()
}

/// Runs a command with too little memory, then with what it names.
fn is_enough(folder: &Path, command: &str, too_little: &str) {
    let said = expect(folder, &format!("{command} --memory {too_little}"), 6);
    is_not_refused(folder, command, &said);
}

/// Runs a command with the memory that a refusal names.
fn is_not_refused(folder: &Path, command: &str, said: &str) {
    let memory = named(said);
    let output = run(folder, &format!("{command} --memory {memory}"));
    let again = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_ne!(output.status.code(), Some(6), "{command}\n{said}\n{again}");
}

#[test]
fn what_is_named_is_enough() {
    let at = &scratch();
    expect(at, "synth statue in.ply --triangles 30k", 0);
    expect(at, "simplify in.ply small.ply --triangles 4k --progressive p.pm", 0);
    expect(at, "synth rooms rooms.obj --triangles 20k --uv", 0);
    expect(at, "tiles in.ply tree -q", 0);
    for (command, too_little) in [
        ("measure in.ply small.ply --samples 20k", "41MiB"),
        ("measure in.ply in.ply --samples 20k --near in.ply --within 0.01", "41MiB"),
        ("measure in.ply in.ply --samples 20k --heatmap h.ply --force", "44MiB"),
        ("measure in.ply small.ply --samples 500k", "44MiB"),
        ("measure in.ply small.ply --samples 20k --appearance --views 1", "60MiB"),
        ("render in.ply -o p.png --size 300x200 --force", "30MiB"),
        ("convert in.ply o.glb --force", "8MiB"),
        ("tiles in.ply t --dry-run", "41MiB"),
        ("simplify in.ply o.ply --triangles 4k --dry-run", "41MiB"),
        ("simplify in.ply o.ply --triangles 5k --method retile --force", "45MiB"),
        ("measure in.ply small.ply --samples 20k --appearance --views 2", "256MiB"),
        ("simplify in.ply o.ply --ratio 40% --pairs --force", "8MiB"),
        ("simplify in.ply o.ply --ratio 40% --optimize 1 --force", "8MiB"),
        ("simplify rooms.obj o.glb --ratio 10% --texture bake --force", "8MiB"),
        ("simplify rooms.obj o.glb --ratio 50% --texture keep --force", "8MiB"),
        ("tiles rooms.obj t --dry-run --texture bake", "8MiB"),
        ("extract tree o.ply --max-error 0 --force", "8MiB"),
        ("refine p.pm o.ply --triangles 20k --force", "8MiB"),
        ("refine p.pm --page o.html --force", "8MiB"),
        ("refine p.pm o.ply --view 0,0,0,1,1,1,40 --force", "8MiB"),
        ("compare cluster in.ply --ratio 10% -o c.html --samples 10k --force", "60MiB"),
    ] {
        is_enough(at, command, too_little);
    }
}

/// Two large triangles that are cut into many thousand before there is anything to choose from.
#[test]
fn a_surface_of_long_triangles_names_enough_for_their_pieces() {
    let at = &scratch();
    let mut text = String::new();
    for (x, y) in [(0, 0), (1, 0), (1, 1), (0, 1)] {
        text.push_str(&format!("v {x} {y} 0\n"));
    }
    // More triangles than are asked for, beside the large ones.
    for i in 0..2000 {
        text.push_str(&format!(
            "v {} 2 0\nv {} 2.001 0\n",
            f64::from(i) * 1e-3,
            f64::from(i) * 1e-3
        ));
    }
    text.push_str("f 1 2 3\nf 1 3 4\n");
    for i in 0..1999 {
        let a = 5 + 2 * i;
        text.push_str(&format!("f {} {} {}\nf {} {} {}\n", a, a + 2, a + 1, a + 1, a + 2, a + 3));
    }
    std::fs::write(at.join("in.obj"), text).unwrap();
    let command = "simplify in.obj o.ply --triangles 3k --method retile --force";
    // More than the plan asks for, less than the pieces take.
    let said = expect(at, &format!("{command} --memory 48MiB"), 6);
    assert!(said.contains("cuts long triangles"), "{said}");
    is_not_refused(at, command, &said);
}

/// The size that a refusal advises to make a picture of.
fn size_in(said: &str) -> &str {
    let rest = said.split("or make it ").nth(1).unwrap_or_else(|| panic!("{said}"));
    rest.split(|c: char| !c.is_ascii_alphanumeric()).next().unwrap()
}

/// The memory of a picture is known before anything is read.
#[test]
fn a_picture_beyond_the_memory_is_refused_with_a_size_that_fits() {
    let at = &scratch();
    expect(at, "synth statue in.ply --triangles 2k", 0);
    let said = expect(at, "render in.ply -o p.png --size 16000x16000 --memory 1GiB", 6);
    let size = size_in(&said);
    let (width, height) = size.split_once('x').unwrap();
    let sides = [width, height].map(|n| n.parse::<u32>().unwrap());
    assert!(sides.iter().all(|n| (1000..3000).contains(n)), "{said}");
    let said = expect(at, "render in.ply -o p.png --size 200x100 --memory 30MiB", 6);
    let size = size_in(&said);
    expect(at, &format!("render in.ply -o p.png --size {size} --memory 30MiB"), 0);
}

/// The JSON of a report is known before it is parsed, and only passed over where it could be replaced.
#[test]
fn reports_of_others_take_no_memory() {
    let at = &scratch();
    expect(at, "synth statue in.ply --triangles 500", 0);
    let list = vec!["{}"; 300_000].join(",");
    let text = format!("{{\"input\":{{}},\"output\":{{}},\"stages\":[{list}]}}");
    std::fs::write(at.join("r.json"), text).unwrap();
    is_enough(at, "report r.json -o r.html --force", "64MiB");
    expect(at, "simplify in.ply o.ply --ratio 50% -q --report r.json", 0);
    assert!(std::fs::metadata(at.join("r.json")).unwrap().len() < 100_000);
}

/// Lists and trees of tiles of others are weighed before their parts are looked for.
#[test]
fn lists_and_trees_of_others_take_a_share_of_the_memory() {
    let at = &scratch();
    expect(at, "synth statue in.ply --triangles 500", 0);
    std::fs::write(at.join("l.txt"), "in.ply\n".repeat(40_000)).unwrap();
    is_enough(at, "convert @l.txt o.ply --force", "64MiB");
    std::fs::create_dir(at.join("t")).unwrap();
    expect(at, "convert in.ply t/a.glb", 0);
    let tree = |children: &str| {
        let text =
            format!(r#"{{"asset":{{}},"geometricError":1,"root":{{"children":[{children}]}}}}"#);
        std::fs::write(at.join("t/tileset.json"), text).unwrap();
    };
    let leaf = r#"{"content":{"uri":"a.glb"}}"#;
    tree(&vec![leaf; 20_000].join(","));
    is_enough(at, "convert t o.ply --force", "64MiB");
    // Each mesh once, at each place.
    tree(&[leaf; 10].join(","));
    expect(at, "convert t o.ply --force", 0);
    let n_bytes = |name: &str| std::fs::metadata(at.join(name)).unwrap().len();
    assert!(n_bytes("o.ply") < 2 * n_bytes("in.ply"));
    tree(&format!(
        "{leaf},{}",
        r#"{"content":{"uri":"a.glb"},"transform":[1,0,0,0,0,1,0,0,0,0,1,0,9,0,0,1]}"#
    ));
    expect(at, "convert t o.ply --force", 0);
    // Far more than any machine has.
    tree(&vec!["{}"; 60_000].join(","));
    let said = expect(at, "info t/tileset.json --memory 64MiB", 6);
    assert!(said.contains("t/tileset.json"), "{said}");
}

/// The first refusal of a page of pictures counts the images of all its meshes; a picture without smooth shading says so.
#[test]
fn the_first_size_of_a_page_counts_normal_maps() {
    let at = &scratch();
    for (name, side) in [("a", 200u32), ("b", 1500)] {
        let rgb = vec![128; 3 * (side * side) as usize];
        let image = stonecut::render::Picture { width: side, height: side, rgb };
        std::fs::write(at.join(format!("{name}.png")), image.to_png().unwrap()).unwrap();
        std::fs::write(at.join(format!("{name}.mtl")), format!("newmtl m\nnorm {name}.png\n"))
            .unwrap();
        let mut text = format!("mtllib {name}.mtl\nusemtl m\n");
        text += "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n";
        text += "f 1/1 2/2 3/3\nf 1/1 3/3 4/4\n";
        std::fs::write(at.join(format!("{name}.obj")), text).unwrap();
    }
    let path = |name: &str| at.join(name).display().to_string();
    let report = format!(
        r#"{{"input":{{"path":"{}"}},"output":{{"path":"{}"}}}}"#,
        path("a.obj"),
        path("b.obj")
    );
    std::fs::write(at.join("r.json"), report).unwrap();
    is_enough(at, "report r.json -o r.html --force", "100MiB");
    is_enough(at, "compare cluster b.obj --ratio 50% -o c.html --samples 1k --force", "100MiB");
    expect(at, "synth statue in.ply --triangles 4000", 0);
    let said = expect(at, "render in.ply -o p.png --size 60x40 --memory 40MiB", 0);
    assert!(said.contains("smooth shading"), "{said}");
}

#[test]
fn a_library_of_materials_beyond_the_memory_is_refused_with_a_size_that_does() {
    let at = &scratch();
    let text = format!("newmtl a\nKd 1 0 0\n# {}\n", "x".repeat(3 << 20));
    std::fs::write(at.join("m.mtl"), text).unwrap();
    std::fs::write(
        at.join("m.obj"),
        "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl a\nf 1 2 3\n",
    )
    .unwrap();
    is_enough(at, "info m.obj", "8MiB");
}

fn glb(json: &str) -> Vec<u8> {
    let json = json.to_owned() + &" ".repeat(json.len().next_multiple_of(4) - json.len());
    let binary = [0u8; 48];
    let mut bytes = b"glTF".to_vec();
    let words =
        |words: &[u32]| words.iter().flat_map(|word| word.to_le_bytes()).collect::<Vec<u8>>();
    bytes.extend(words(&[2, (12 + 8 + json.len() + 8 + binary.len()) as u32, json.len() as u32]));
    bytes.extend(b"JSON");
    bytes.extend(json.as_bytes());
    bytes.extend(words(&[binary.len() as u32]));
    bytes.extend(b"BIN\0");
    bytes.extend(binary);
    bytes
}

/// A tile of some hundred bytes, or of millions of empty nodes, that claims gibibytes.
#[test]
fn a_tile_is_worth_no_more_memory_than_its_share() {
    let at = &scratch();
    expect(at, "synth statue in.ply --triangles 4000", 0);
    expect(at, "tiles in.ply t --tile-triangles 500 -q", 0);
    let nodes = vec!["{}"; 100_000].join(",");
    let many = format!(r#"{{"asset":{{"version":"2.0"}},"nodes":[{nodes}]}}"#);
    let packed = r#"{"asset":{"version":"2.0"},"accessors":[{"componentType":5126,"type":"VEC3","count":80000000,"bufferView":0}],
        "bufferViews":[{"buffer":0,"byteLength":48,"extensions":{"EXT_meshopt_compression":{"buffer":0,"byteLength":48,"byteStride":12,
        "count":80000000,"mode":"ATTRIBUTES"}}}],"buffers":[{"byteLength":48}],"meshes":[{"primitives":[{"attributes":{"POSITION":0},
        "indices":0}]}],"nodes":[{"mesh":0,"scale":[1,1,1],"translation":[0,0,0]}]}"#;
    for (json, words) in [(many.as_str(), "JSON has"), (packed, "80000000 elements")] {
        std::fs::write(at.join("t/tiles/0/0/0-0.glb"), glb(json)).unwrap();
        for command in ["info t --memory 64MiB", "extract t x.ply --max-error 0 --memory 64MiB"] {
            let output = run(at, command);
            let said = [output.stdout, output.stderr].concat();
            let said = String::from_utf8_lossy(&said).into_owned();
            assert_eq!(output.status.code(), Some(4), "{command}: {said}");
            assert!(said.contains(words), "{command}: {said}");
        }
    }
}

/// Runs a command and returns its exit code, its words and the most memory that it was seen to have had, in bytes.
fn watched(folder: &Path, command: &str) -> (i32, String, u64) {
    let mut child = start(folder, command);
    let status = format!("/proc/{}/status", child.id());
    let mut peak = 0;
    while child.try_wait().unwrap().is_none() {
        let text = std::fs::read_to_string(&status).unwrap_or_default();
        let kib =
            text.lines().find_map(|line| line.strip_prefix("VmHWM:")?.split(' ').rev().nth(1));
        peak = kib.and_then(|kib| kib.trim().parse().ok()).unwrap_or(0).max(peak);
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
    let output = child.wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    (output.status.code().unwrap_or(-1), said, peak << 10)
}

/// Images are weighed by their headers before they are decoded: pictures take what was named and no more.
#[test]
fn decoded_images_are_counted() {
    let at = &scratch();
    let side = 1600;
    let rgb = vec![90; 3 * side * side];
    let [width, height] = [side as u32; 2];
    let image = stonecut::render::Picture { width, height, rgb };
    std::fs::write(at.join("q.png"), image.to_png().unwrap()).unwrap();
    std::fs::write(at.join("q.mtl"), "newmtl a\nmap_Kd q.png\n").unwrap();
    let mut text = "mtllib q.mtl\nusemtl a\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n".to_owned();
    text += "f 1/1 2/2 3/3\nf 1/1 3/3 4/4\n";
    std::fs::write(at.join("q.obj"), text).unwrap();
    is_enough(at, "render q.obj -o p.png --size 100x100 --force", "8MiB");
    // Pixels with their halves, and the pixels that the decoder gives.
    let image_mib = ((4.0 * 4.0 / 3.0 + 4.0) * (side * side) as f64) as u64 >> 20;
    for (command, least_mib) in [
        ("render q.obj -o p.png --size 100x100 --force", 24 + 4 + image_mib),
        ("measure q.obj q.obj --appearance --views 3 --samples 1k", 235 + image_mib),
        ("tiles q.obj t --texture colors --force", 2 * image_mib),
        ("simplify q.obj o.obj --triangles 2 --texture bake --force", 3 * image_mib),
    ] {
        let said = expect(at, &format!("{command} --memory {}MiB", least_mib - 1), 6);
        let named = named(&said);
        let (code, said, peak) = watched(at, &format!("{command} --memory {named} --threads 4"));
        assert_eq!(code, 0, "{command}: {said}");
        let mib: u64 = named.trim_end_matches("MiB").parse().unwrap();
        println!("{command}: named {named}, peak {} MiB", peak >> 20);
        assert!(peak <= (mib + 8) << 20, "{command}: {} MiB of {named}", peak >> 20);
    }
}
