//! Complete files of every format, spoiled at random, through `info`, `convert` and `simplify`; and random options on nasty
//! meshes. No run may panic, hang, or take memory that its file is not worth.
//!
//! `STONECUT_SPOILED=N` spoils N files of each format and `STONECUT_FUZZ_SEED=S` others than the usual ones (`.ci/nightly`).

#![allow(clippy::print_stdout)] // The figures of a long run.

use crate::common::{expect, scratch, stonecut};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// A run that takes more processor time hangs: the files have some hundred triangles.
const HANGS_SECONDS: u64 = 60;

/// A run that takes longer waits for something, on however busy a machine.
const WAITS: Duration = Duration::from_secs(900);

/// Address space of a run in KiB: threads, their heaps and the least budget fit, a size out of a file does not.
const ADDRESSES_KIB: u64 = 3 << 20;

/// Numbers that readers stumble over.
const NASTY: [&str; 24] = [
    "0",
    "-1",
    "1",
    "2",
    "255",
    "256",
    "65536",
    "2147483647",
    "-2147483648",
    "4294967295",
    "4294967296",
    "9223372036854775807",
    "18446744073709551615",
    "1e39",
    "-1e308",
    "1e-320",
    "1e400",
    "nan",
    "-nan(ind)",
    "1.#QNAN",
    "inf",
    "0.5",
    "\"\"",
    "1/2/3",
];

pub fn number(name: &str) -> Option<u64> {
    std::env::var(name).ok().and_then(|value| value.parse().ok())
}

/// A linear congruential generator; the upper bits of its state.
pub struct Random(u64);

impl Random {
    pub fn new(salt: u64) -> Random {
        Random(number("STONECUT_FUZZ_SEED").unwrap_or(1).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ salt)
    }

    pub fn below(&mut self, n: usize) -> usize {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 33) as usize % n.max(1)
    }

    pub fn of<T: Copy>(&mut self, choices: &[T]) -> T {
        choices[self.below(choices.len())]
    }
}

/// Replaces a token, repeats, drops or swaps lines, or cuts the text off.
fn spoil_text(text: &[u8], random: &mut Random) -> Vec<u8> {
    let mut lines: Vec<Vec<u8>> =
        text.split_inclusive(|&b| b == b'\n').map(<[u8]>::to_vec).collect();
    for _ in 0..=random.below(3) {
        let (i, j) = (random.below(lines.len()), random.below(lines.len()));
        match random.below(8) {
            0 => drop(lines.remove(i)),
            1 => lines.insert(i, lines[j].clone()),
            2 => lines.swap(i, j),
            3 => lines.truncate(i + 1),
            4 => {
                let at = random.below(lines[i].len());
                lines[i].truncate(at);
            }
            _ => {
                let mut words: Vec<&[u8]> = lines[i].split(|b| b.is_ascii_whitespace()).collect();
                let at = random.below(words.len());
                words[at] = random.of(&NASTY).as_bytes();
                let mut line = words.join(&b' ');
                line.push(b'\n');
                lines[i] = line;
            }
        }
        if lines.is_empty() {
            break;
        }
    }
    lines.concat()
}

/// Flips bits, writes extreme values, cuts off or repeats a piece; more often near the beginning.
fn spoil_bytes(bytes: &[u8], random: &mut Random) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    for _ in 0..=random.below(4) {
        let end = if random.below(2) == 0 { bytes.len().min(400) } else { bytes.len() };
        let at = random.below(end);
        match random.below(8) {
            0 => bytes.truncate(at),
            1 => drop(bytes.drain(at..(at + random.below(40)).min(end))),
            2 => {
                let piece = bytes[at..(at + 64).min(bytes.len())].to_vec();
                bytes.splice(at..at, piece);
            }
            3..=5 => {
                let value =
                    random.of(&[0, u32::MAX, 0x7fc0_0000, 0x7f80_0000, 0x8000_0000, 0x7f7f_ffff]);
                let place = bytes.len().min(at + 4);
                bytes[at..place].copy_from_slice(&value.to_le_bytes()[..place - at]);
            }
            _ if at < bytes.len() => bytes[at] ^= 1 << random.below(8),
            _ => {}
        }
        if bytes.is_empty() {
            break;
        }
    }
    bytes
}

/// Spoils the JSON of a GLB as text, with all lengths put right again; or its bytes.
fn spoil_glb(bytes: &[u8], random: &mut Random) -> Vec<u8> {
    if random.below(4) == 0 {
        return spoil_bytes(bytes, random);
    }
    let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    let (json, rest) = (&bytes[20..20 + length], &bytes[20 + length..]);
    let json = String::from_utf8_lossy(json).into_owned();
    // Numbers are tokens: everything between two of them stays.
    let mut pieces: Vec<String> = Vec::new();
    for c in json.chars() {
        let is_number = |c: char| c.is_ascii_digit() || "+-.".contains(c);
        match pieces.last_mut() {
            Some(last) if last.ends_with(is_number) == is_number(c) => last.push(c),
            _ => pieces.push(c.to_string()),
        }
    }
    for _ in 0..=random.below(3) {
        let at = random.below(pieces.len());
        pieces[at] = match random.below(4) {
            0 => pieces[random.below(pieces.len())].clone(),
            _ if pieces[at].starts_with(|c: char| c.is_ascii_digit()) => {
                random.of(&NASTY).to_owned()
            }
            1 => pieces[at].replacen("Accessor", "View", 1).replacen("ccessor", "ccessors", 1),
            _ => continue,
        };
    }
    glb(&bytes[..8], pieces.concat().into_bytes(), rest)
}

/// A GLB of its first eight bytes, its JSON and what follows.
fn glb(first: &[u8], mut json: Vec<u8>, rest: &[u8]) -> Vec<u8> {
    while !json.len().is_multiple_of(4) {
        json.push(b' ');
    }
    let mut glb = first.to_vec();
    glb.extend((20 + json.len() as u32 + rest.len() as u32).to_le_bytes());
    glb.extend((json.len() as u32).to_le_bytes());
    glb.extend(b"JSON");
    glb.extend(json);
    glb.extend(rest);
    glb
}

/// Runs the command within `ADDRESSES_KIB` and `HANGS_SECONDS`; its exit code must be one for bad input, bad usage or success.
fn judge(at: &Path, arguments: &[&str], kept: &str) {
    judge_codes(at, arguments, kept, |code| matches!(code, 0 | 2..=6));
}

/// The same for a command of other exit codes.
pub fn judge_codes(at: &Path, arguments: &[&str], kept: &str, is_fine: fn(i32) -> bool) {
    let mut command = Command::new("bash");
    let limit = format!("ulimit -v {ADDRESSES_KIB} -t {HANGS_SECONDS}; exec \"$0\" \"$@\"");
    command.current_dir(at).args(["-c", &limit]).arg(stonecut().get_program()).args(arguments);
    let errors = std::fs::File::create(at.join("said")).unwrap();
    let mut child =
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(errors).spawn().unwrap();
    let begun = Instant::now();
    let status = loop {
        if let Some(status) = child.try_wait().unwrap() {
            break status;
        }
        if begun.elapsed() > WAITS {
            child.kill().unwrap();
            panic!("stonecut {} does not end; its input: {}", arguments.join(" "), keep(at, kept));
        }
        std::thread::sleep(Duration::from_millis(1));
    };
    let fine = status.code().is_some_and(is_fine);
    let said = String::from_utf8_lossy(&std::fs::read(at.join("said")).unwrap()).into_owned();
    assert!(
        fine,
        "stonecut {}: {status}; its input: {}\n{said}",
        arguments.join(" "),
        keep(at, kept)
    );
}

/// Puts the file of a fault where it outlives the test.
fn keep(at: &Path, name: &str) -> String {
    let place = std::env::temp_dir().join(format!("spoiled-{}-{name}", std::process::id()));
    std::fs::copy(at.join(name), &place).unwrap();
    place.display().to_string()
}

/// A coloured mesh with a material and an image, and the same in all formats.
fn make_files(at: &Path) {
    expect(at, "synth scans a.ply --triangles 400 --seed 3", 0);
    for (arguments, name) in [
        ("--format ascii", "ascii.ply"),
        ("--format binary_big_endian", "big.ply"),
        ("--format binary_little_endian", "little.ply"),
        ("", "plain.stl"),
        ("", "plain.obj"),
    ] {
        let output = crate::common::run(at, &format!("convert a.ply {name} {arguments}"));
        assert!(
            matches!(output.status.code(), Some(0 | 3)),
            "{}",
            String::from_utf8_lossy(&output.stderr)
        );
    }
    let image =
        image::RgbImage::from_fn(16, 16, |x, y| image::Rgb([x as u8 * 16, y as u8 * 16, 99]));
    image.save(at.join("t.png")).unwrap();
    std::fs::write(at.join("m.mtl"), "newmtl m\nKd 1 1 1\nmap_Kd t.png\n").unwrap();
    let mut obj = String::from("mtllib m.mtl\no sheet\n");
    for i in 0..81 {
        obj += &format!("v {} {} {}\nvt {} {}\n", i % 9, i / 9, i % 2, i % 9 / 8, i / 9 / 8);
    }
    obj += "usemtl m\n";
    for i in 0..64 {
        let v = i % 8 + i / 8 * 9 + 1;
        obj += &format!("f {0}/{0} {1}/{1} {2}/{2} {3}/{3}\n", v, v + 1, v + 10, v + 9);
    }
    std::fs::write(at.join("textured.obj"), obj).unwrap();
    expect(at, "convert textured.obj textured.glb", 0);
    make_others(at);
    let stl = "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n";
    std::fs::write(at.join("ascii.stl"), stl.repeat(8).replace("solid a\n", "") + "endsolid a\n")
        .unwrap();
    let text = std::fs::read(at.join("ascii.stl")).unwrap();
    std::fs::write(at.join("ascii.stl"), [b"solid a\n".as_slice(), &text].concat()).unwrap();
}

/// Stars of up to forty corners; UTF-16, an archive, an image of floats; instances and a place of an image in a GLB.
fn make_others(at: &Path) {
    let (mut stars, mut corners) = (String::new(), String::new());
    for star in 0..12u32 {
        let n = 4 + 3 * star;
        for i in 0..n {
            let (sin, cos) = (f64::from(i) * std::f64::consts::TAU / f64::from(n)).sin_cos();
            let far = if i % 2 == 0 { 1.0 } else { 0.4 };
            stars += &format!("v {} {} 0\n", far * cos + 3.0 * f64::from(star), far * sin);
        }
        let relative: Vec<String> = (1..=n).rev().map(|i| format!("-{i}")).collect();
        corners += &format!("f {}\n", relative.join(" "));
        stars += &std::mem::take(&mut corners);
    }
    std::fs::write(at.join("stars.obj"), stars).unwrap();
    let textured = std::fs::read_to_string(at.join("textured.obj")).unwrap();
    let wide: Vec<u8> =
        [0xfeff].into_iter().chain(textured.encode_utf16()).flat_map(u16::to_le_bytes).collect();
    std::fs::write(at.join("utf16.obj"), wide).unwrap();
    let mut archive = zip::ZipWriter::new(std::fs::File::create(at.join("mesh.zip")).unwrap());
    archive.start_file("a/mesh.obj", zip::write::SimpleFileOptions::default()).unwrap();
    std::io::Write::write_all(&mut archive, textured.as_bytes()).unwrap();
    archive.finish().unwrap();
    let floats = image::Rgb32FImage::from_pixel(16, 16, image::Rgb([0.2, 0.5, 1.0]));
    image::DynamicImage::ImageRgb32F(floats).save(at.join("t.exr")).unwrap();
    std::fs::write(at.join("exr.mtl"), "newmtl m\nmap_Kd t.exr\n").unwrap();
    std::fs::write(at.join("exr.obj"), textured.replace("m.mtl", "exr.mtl")).unwrap();
    expect(at, "convert textured.obj float.glb --format float", 0);
    let bytes = std::fs::read(at.join("float.glb")).unwrap();
    let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    let mut document: serde_json::Value = serde_json::from_slice(&bytes[20..20 + length]).unwrap();
    let position = document["meshes"][0]["primitives"][0]["attributes"]["POSITION"].clone();
    document["extensionsUsed"] =
        serde_json::json!(["EXT_mesh_gpu_instancing", "KHR_texture_transform"]);
    document["nodes"][0]["extensions"] = serde_json::json!({
        "EXT_mesh_gpu_instancing": { "attributes": { "TRANSLATION": position } }
    });
    document["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]["extensions"] = serde_json::json!({
        "KHR_texture_transform": { "offset": [0.1, 0.2], "scale": [2, 3], "rotation": 0.5 }
    });
    let glb = glb(&bytes[..8], document.to_string().into_bytes(), &bytes[20 + length..]);
    std::fs::write(at.join("placed.glb"), glb).unwrap();
}

#[test]
fn spoiled_files_are_refused_or_read() {
    let at = &scratch();
    make_files(at);
    type Spoil = fn(&[u8], &mut Random) -> Vec<u8>;
    let files: [(&str, Spoil); 14] = [
        ("ascii.ply", spoil_text),
        ("big.ply", spoil_bytes),
        ("little.ply", spoil_bytes),
        ("plain.obj", spoil_text),
        ("textured.obj", spoil_text),
        ("m.mtl", spoil_text),
        ("ascii.stl", spoil_text),
        ("plain.stl", spoil_bytes),
        ("textured.glb", spoil_glb),
        ("stars.obj", spoil_text),
        ("utf16.obj", spoil_bytes),
        ("mesh.zip", spoil_bytes),
        ("t.exr", spoil_bytes),
        ("placed.glb", spoil_glb),
    ];
    let n = number("STONECUT_SPOILED").unwrap_or(4);
    let outputs = ["o.ply", "o.obj", "o.stl", "o.glb"];
    for (kind, (name, spoil)) in files.into_iter().enumerate() {
        let mut random = Random::new(kind as u64);
        let sound = std::fs::read(at.join(name)).unwrap();
        for _ in 0..n {
            let spoiled = spoil(&sound, &mut random);
            // A spoiled library or image is read through the mesh that names it.
            let (place, input) = match name {
                "m.mtl" => (name.to_owned(), "textured.obj".to_owned()),
                "t.exr" => (name.to_owned(), "exr.obj".to_owned()),
                _ => (format!("in-{name}"), format!("in-{name}")),
            };
            std::fs::write(at.join(&place), spoiled).unwrap();
            let skips = random.below(2) == 0;
            let output = random.of(&outputs);
            let skip: &[&str] = if skips { &["--skip-bad"] } else { &[] };
            judge(at, &["info", "--check", &input], &place);
            let convert = ["convert", &input, output, "--force", "-q"];
            judge(at, &[&convert[..], skip].concat(), &place);
            let simplify =
                ["simplify", &input, output, "--triangles", "60", "--force", "--restart", "-q"];
            judge(at, &[&simplify[..], skip].concat(), &place);
        }
        std::fs::write(at.join(name), sound).unwrap();
        println!("{name}: {n} files spoiled, three runs each, no fault");
    }
}

/// A mesh with what scanners and CAD leave behind: a fan, a book, slivers, repeated faces, values that are missing.
fn nasty_mesh(random: &mut Random) -> String {
    let mut obj = String::new();
    let n = 3 + random.below(60);
    let size = random.of(&["1", "1e-20", "1e20", "1e6"]);
    let size: f64 = size.parse().unwrap();
    for i in 0..n {
        let turn = i as f64 * 0.7;
        let height = if random.below(5) == 0 { 0.0 } else { turn.sin() * 0.3 };
        obj += &format!("v {} {} {}\n", turn.cos() * size, turn.sin() * size, height * size);
    }
    for i in 2..n {
        match random.below(6) {
            0 => obj += &format!("f 1 2 {}\n", i + 1),
            1 => obj += &format!("f 1 {i} {}\nf 1 {i} {}\n", i + 1, i + 1),
            2 => obj += &format!("f {} {} {}\n", i + 1, i, random.below(n) + 1),
            _ => obj += &format!("f 1 {i} {}\n", i + 1),
        }
    }
    obj
}

#[test]
fn random_options_on_nasty_meshes() {
    let at = &scratch();
    let mut random = Random::new(77);
    let n = number("STONECUT_SPOILED").unwrap_or(12);
    for _ in 0..n {
        std::fs::write(at.join("in.obj"), nasty_mesh(&mut random)).unwrap();
        let mut arguments = vec!["simplify", "in.obj", "o.ply", "--force", "--restart", "-q"];
        arguments.extend(random.of(&[
            ["--triangles", "1"],
            ["--triangles", "20"],
            ["--ratio", "50%"],
            ["--max-error", "0.01"],
            ["--max-error", "1e-30"],
        ]));
        let options: [&[&str]; 12] = [
            &["--method", "decimate"],
            &["--method", "retile"],
            &["--pairs"],
            &["--optimize", "1"],
            &["--no-self-intersections"],
            &["--topology", "keep"],
            &["--fit", "on"],
            &["--placement", "subset"],
            &["--cell-triangles", "1000"],
            &["--min-component", "3"],
            &["--progressive", "o.pm"],
            &["--verify"],
        ];
        for _ in 0..random.below(3) {
            arguments.extend(random.of(&options));
        }
        judge(at, &arguments, "in.obj");
    }
    println!("{n} runs with random options, no fault");
}
