//! Damaged and truncated job files, changed inputs, two runs at once: each is told or does no harm.

use crate::common::{expect, json, run, scratch, stonecut};
use std::path::{Path, PathBuf};

const COMMAND: &str = "simplify in.ply out.ply --triangles 4400 --cell-triangles 1000 --threads 1";

/// Damages per stage boundary; STONECUT_DAMAGES raises it (2,500 makes 10,000 in all).
fn n_damages() -> u64 {
    std::env::var("STONECUT_DAMAGES").ok().and_then(|n| n.parse().ok()).unwrap_or(15)
}

fn next(random: &mut u64) -> u64 {
    *random = random.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
    *random >> 20
}

fn job_files(folder: &Path) -> Vec<PathBuf> {
    let mut files: Vec<PathBuf> = std::fs::read_dir(folder.join("out.ply.stonecut-job"))
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.metadata().unwrap().len() > 0)
        .collect();
    files.sort();
    files
}

#[test]
fn damage_is_found_or_harmless() {
    let at = &scratch();
    expect(at, "synth terrain in.ply --triangles 8500", 0);
    expect(at, COMMAND, 0);
    let reference = std::fs::read(at.join("out.ply")).unwrap();
    std::fs::remove_file(at.join("out.ply")).unwrap();
    let (mut random, mut detected, mut harmless) = (1u64, 0u64, 0u64);
    for until in ["partition", "simplify", "stitch", "write"] {
        match until {
            "write" => {
                // The job as it stands when the output has just appeared.
                expect(at, &format!("{COMMAND} --keep-temp"), 0);
                std::fs::remove_file(at.join("out.ply")).unwrap();
            }
            _ => drop(expect(at, &format!("{COMMAND} --until {until}"), 0)),
        }
        let sound: Vec<(PathBuf, Vec<u8>)> =
            job_files(at).into_iter().map(|f| (f.clone(), std::fs::read(f).unwrap())).collect();
        for _ in 0..n_damages() {
            let (path, bytes) = &sound[next(&mut random) as usize % sound.len()];
            let mut damaged = bytes.clone();
            let place = next(&mut random) as usize % bytes.len();
            let what = match next(&mut random) % 4 {
                0 => {
                    damaged.truncate(place);
                    format!("{until}: {} cut to {place} bytes", path.display())
                }
                bit => {
                    damaged[place] ^= 1 << (next(&mut random) % 8);
                    format!("{until}: {} byte {place} of {}, {bit}", path.display(), bytes.len())
                }
            };
            std::fs::write(path, damaged).unwrap();
            let output = run(at, COMMAND);
            let said = String::from_utf8_lossy(&output.stderr);
            match output.status.code() {
                Some(0) => {
                    harmless += 1;
                    let found = std::fs::read(at.join("out.ply")).unwrap();
                    assert!(found == reference, "{what}: another mesh");
                    std::fs::remove_file(at.join("out.ply")).unwrap();
                }
                Some(1 | 8) => {
                    detected += 1;
                    assert!(said.contains("--restart"), "{what}: {said}");
                    assert!(!at.join("out.ply").exists(), "{what}: an output all the same");
                }
                code => panic!("{what}: {code:?} {said}"),
            }
            let job = at.join("out.ply.stonecut-job");
            let _ = std::fs::remove_dir_all(&job);
            std::fs::create_dir(&job).unwrap();
            sound.iter().for_each(|(path, bytes)| std::fs::write(path, bytes).unwrap());
        }
    }
    println!("{detected} detected, {harmless} harmless");
    // Most bytes of a job are checked; few damages hit one that no longer counts.
    assert!(4 * detected > n_damages(), "{detected} detected, {harmless} harmless");
    expect(at, &format!("{COMMAND} --restart"), 0);
    assert!(std::fs::read(at.join("out.ply")).unwrap() == reference);
}

#[test]
fn a_changed_input_is_refused_by_name() {
    let at = &scratch();
    expect(at, "synth terrain in.ply --triangles 8500", 0);
    expect(at, &format!("{COMMAND} --until partition"), 0);
    expect(at, "synth terrain in.ply --triangles 8500 --seed 9 --force", 0);
    let said = expect(at, COMMAND, 8);
    assert!(said.contains("input"), "{said}");
    let bytes = std::fs::read(at.join("in.ply")).unwrap();
    std::fs::write(at.join("in.ply"), &bytes[..bytes.len() / 2]).unwrap();
    expect(at, COMMAND, 4);
}

#[test]
fn other_settings_are_refused_until_restart() {
    let at = &scratch();
    expect(at, "synth terrain in.ply --triangles 8500", 0);
    expect(at, &format!("{COMMAND} --until partition"), 0);
    let other = "simplify in.ply out.ply --triangles 3000 --cell-triangles 1000";
    let said = expect(at, other, 8);
    assert!(said.contains("target") && said.contains("--restart"), "{said}");
    expect(at, &format!("{other} --restart"), 0);
    let said = expect(at, &other.replace("3000", "3002"), 2);
    assert!(said.contains("--force"), "{said}");
}

#[test]
fn a_second_run_says_who_works_and_a_dead_holder_is_followed() {
    let at = &scratch();
    expect(at, "synth terrain in.ply --triangles 1M", 0);
    let command = "simplify in.ply out.ply --ratio 1% --cell-triangles 20k --threads 1";
    let mut first = stonecut().current_dir(at).args(command.split(' ')).spawn().unwrap();
    let lock = at.join("out.ply.stonecut-job/lock");
    while !std::fs::read_to_string(&lock).is_ok_and(|holder| holder.contains("process")) {
        assert!(first.try_wait().unwrap().is_none(), "the first run ended without a lock");
        std::thread::yield_now();
    }
    // Stopped, it holds the lock for as long as the second run takes.
    crate::common::signal(&first, rustix::process::Signal::STOP);
    let said = expect(at, command, 7);
    assert!(said.contains(&format!("process {}", first.id())), "{said}");
    first.kill().unwrap();
    first.wait().unwrap();
    expect(at, command, 0);
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Shape {
    /// A vertex with all triangles around it, their last corner.
    Fan,
    /// The same with that vertex the first of all: all triangles belong to its cell.
    Hub,
    /// All vertices in one point.
    Point,
}

fn write_shape(path: &Path, shape: Shape, n: u32) {
    let mut bytes = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\nproperty float y\n\
         property float z\nelement face {n}\nproperty list uchar int vertex_indices\nend_header\n",
        n + 1
    )
    .into_bytes();
    // The hub is vertex 0 or vertex n, the rim the n others.
    let (hub, rim) = if shape == Shape::Hub { (0, 1) } else { (n, 0) };
    for i in 0..=n {
        let angle = f64::from(i) / f64::from(n) * std::f64::consts::TAU;
        let radius = if shape == Shape::Point || i == hub { 0.0 } else { 1.0 };
        for value in [radius * angle.cos(), radius * angle.sin(), 0.0] {
            bytes.extend_from_slice(&(value as f32).to_le_bytes());
        }
    }
    for i in 0..n {
        bytes.push(3);
        let corners = [rim + i, rim + (i + 1) % n, hub];
        corners.iter().for_each(|v| bytes.extend_from_slice(&v.to_le_bytes()));
    }
    std::fs::write(path, bytes).unwrap();
}

/// A million triangles around one vertex: done in the budget, and without looking at every edge again and again. In one
/// point they are no surface, and refused.
#[test]
fn degenerate_shapes_complete_in_the_budget() {
    let at = &scratch();
    for shape in [Shape::Fan, Shape::Hub, Shape::Point] {
        write_shape(&at.join("in.ply"), shape, 500_000);
        let command = "simplify in.ply out.ply --ratio 1% --cell-triangles 50k --memory 128MiB --force \
                       --restart --report r.json";
        let output = run(at, command);
        let said = String::from_utf8_lossy(&output.stderr);
        let code = output.status.code();
        assert!(!said.contains("panicked"), "{said}");
        if shape == Shape::Point {
            assert_eq!(code, Some(4), "{said}");
            continue;
        }
        assert!(matches!(code, Some(0 | 3)), "{shape:?}: {code:?} {said}");
        let report = json(at, "r.json");
        let peak = report["peak_memory_bytes"].as_u64().unwrap() >> 20;
        assert!(peak < 128, "{shape:?} takes {peak} MiB");
        // Refused and taken collapses: a few for each of 0.75 to 1 million edges, in all rounds together.
        let counts = ["rejects", "changes"].map(|key| {
            report[key].as_object().unwrap().values().filter_map(|n| n.as_u64()).sum::<u64>()
        });
        let looks = counts[0] + counts[1];
        println!("{shape:?}: exit {code:?}, {looks} looks, {peak} MiB\n{said}");
        assert!(looks < 20_000_000, "{shape:?}: {counts:?}");
    }
}

/// A glTF file of a wavy sheet, with its numbers in a file beside it.
fn write_sheet(at: &Path, height: f32) {
    const SIDE: u32 = 40;
    let mut bytes = Vec::new();
    for v in 0..SIDE * SIDE {
        let (x, y) = ((v % SIDE) as f32, (v / SIDE) as f32);
        bytes.extend([x, y, height * (0.3 * x).sin()].map(f32::to_le_bytes).concat());
    }
    let n_positions = bytes.len();
    for v in (0..SIDE * (SIDE - 1)).filter(|v| v % SIDE < SIDE - 1) {
        let corners = [v, v + 1, v + SIDE, v + 1, v + SIDE + 1, v + SIDE];
        bytes.extend(corners.map(u32::to_le_bytes).concat());
    }
    let (n_indices, end) = ((bytes.len() - n_positions) / 4, SIDE - 1);
    let text = format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],"nodes":[{{"mesh":0}}],
        "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}},"indices":1}}]}}],
        "accessors":[{{"bufferView":0,"componentType":5126,"count":{n},"type":"VEC3","min":[0,0,-9],"max":[{end},{end},9]}},
        {{"bufferView":1,"componentType":5125,"count":{n_indices},"type":"SCALAR"}}],
        "bufferViews":[{{"buffer":0,"byteLength":{n_positions}}},
        {{"buffer":0,"byteOffset":{n_positions},"byteLength":{}}}],
        "buffers":[{{"uri":"in.bin","byteLength":{}}}]}}"#,
        4 * n_indices,
        bytes.len(),
        n = SIDE * SIDE,
    );
    std::fs::write(at.join("in.bin"), bytes).unwrap();
    if !at.join("in.gltf").exists() {
        std::fs::write(at.join("in.gltf"), text).unwrap();
    }
}

#[test]
fn a_changed_buffer_beside_the_input_is_refused() {
    let at = &scratch();
    write_sheet(at, 1.0);
    let command = "simplify in.gltf out.ply --ratio 20%";
    expect(at, &format!("{command} --until partition"), 0);
    write_sheet(at, 3.0);
    let said = expect(at, command, 8);
    assert!(said.contains("in.bin"), "{said}");
    expect(at, &format!("{command} --restart"), 0);
}

#[test]
fn another_stream_is_refused() {
    let at = &scratch();
    let piped = |options: &str, input: &str| {
        let file = std::fs::File::open(at.join(input)).unwrap();
        let words = format!("simplify - out.ply --ratio 20% {options}");
        let words = words.split_whitespace();
        let mut command = stonecut();
        command.current_dir(at).args(words).stdin(file).output().unwrap().status.code()
    };
    expect(at, "synth terrain a.ply --triangles 8500", 0);
    expect(at, "synth terrain b.ply --triangles 8500 --seed 9", 0);
    assert_eq!(piped("--until partition", "a.ply"), Some(0));
    assert_eq!(piped("", "b.ply"), Some(8));
    assert_eq!(piped("", "a.ply"), Some(0));
}

#[test]
fn seams_are_written_once_and_a_run_goes_on_behind_them() {
    let at = &scratch();
    expect(at, "synth terrain in.ply --triangles 20k", 0);
    let command = "simplify in.ply out.ply --ratio 2% --cell-triangles 3000 --seams s.ply";
    expect(at, &format!("{command} --until simplify"), 0);
    let seams = std::fs::read(at.join("s.ply")).unwrap();
    expect(at, &format!("{command} --until stitch"), 0);
    expect(at, command, 0);
    assert!(std::fs::read(at.join("s.ply")).unwrap() == seams);
}

#[test]
fn nothing_of_a_progressive_mesh_stays_behind_a_restart() {
    let at = &scratch();
    expect(at, "synth terrain in.ply --triangles 8500", 0);
    let command = "simplify in.ply out.ply --ratio 10%";
    expect(at, &format!("{command} --progressive p.pm --until stitch"), 0);
    expect(at, &format!("{command} --restart"), 0);
    assert!(!at.join("out.ply.stonecut-job").exists());
}
