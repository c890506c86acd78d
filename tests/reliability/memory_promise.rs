//! The memory promise: scans of every kind stay alive in a cgroup hardly larger than their budget.
//!
//! Skipped, and said so, where cgroups of version 1 cannot be made.

#![allow(clippy::print_stdout)] // Skipped tests say so.

use crate::common::{expect, json, scratch, skipped};
use std::path::{Path, PathBuf};
use std::process::Command;

/// A cgroup with a limit; removed when dropped.
struct Group(PathBuf);

impl Group {
    fn new(name: &str, limit_bytes: u64) -> Option<Group> {
        let folder = Path::new("/sys/fs/cgroup/memory");
        let group = folder.join(format!("stonecut-{}-{name}", std::process::id()));
        std::fs::create_dir(&group).ok()?;
        let group = Group(group);
        let limit = group.0.join("memory.limit_in_bytes");
        std::fs::write(limit, limit_bytes.to_string()).ok()?;
        Some(group)
    }

    /// Runs the command in it.
    fn run(&self, folder: &Path, arguments: &str) -> std::process::Output {
        let script = format!(
            "echo $$ > {}/cgroup.procs && exec {} {arguments}",
            self.0.display(),
            env!("CARGO_BIN_EXE_stonecut")
        );
        Command::new("sh").current_dir(folder).args(["-c", &script]).output().unwrap()
    }
}

impl Drop for Group {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir(&self.0);
    }
}

/// Squares of 2 x 2 quads, each with vertices of its own: nothing but boundaries in the same places, as in scans
/// that are published chart by chart.
fn write_fragments(path: &Path, n: u32) {
    let (mut vertices, mut faces) = (Vec::<u8>::new(), Vec::<u8>::new());
    let mut first = 0u32;
    for patch in 0..n * n {
        let (px, py) = (patch % n * 2, patch / n * 2);
        for v in 0..9 {
            let (x, y) = ((px + v % 3) as f32, (py + v / 3) as f32);
            let z = (x * 0.05).sin() * (y * 0.07).cos() * 5.0 + (x * 1.7 + y * 2.3).sin() * 0.05;
            [x, y, z].iter().for_each(|c| vertices.extend_from_slice(&c.to_le_bytes()));
        }
        for square in 0..4 {
            let a = first + square / 2 * 3 + square % 2;
            for t in [[a, a + 1, a + 3], [a + 1, a + 4, a + 3]] {
                faces.push(3);
                t.iter().for_each(|v| faces.extend_from_slice(&v.to_le_bytes()));
            }
        }
        first += 9;
    }
    let mut bytes = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {first}\nproperty float x\nproperty float y\n\
         property float z\nelement face {}\nproperty list uchar int vertex_indices\nend_header\n",
        faces.len() / 13
    )
    .into_bytes();
    bytes.extend(vertices);
    bytes.extend(faces);
    std::fs::write(path, bytes).unwrap();
}

#[test]
fn every_kind_of_scan_stays_within_its_budget() {
    // Name, how it is made, cell size, budget in MiB.
    let scans = [
        ("ordinary", "statue in.ply --triangles 700k", 100_000, 80),
        ("shuffled", "statue in.ply --triangles 700k --shuffle", 100_000, 80),
        ("fragmented", "", 60_000, 110),
        ("textured", "terrain in.ply --triangles 400k --color --uv", 60_000, 80),
        ("volume", "volume in.ply --triangles 400k", 60_000, 80),
    ];
    for (name, synth, cells, budget) in scans {
        // A budget is taken down to nine tenths of the limit.
        let Some(group) = Group::new(name, (budget << 20) * 10 / 9 + (1 << 20)) else {
            skipped("no cgroup can be made here");
            return;
        };
        let folder = tempfile::tempdir().unwrap();
        match synth {
            "" => write_fragments(&folder.path().join("in.ply"), 230),
            _ => {
                let made = crate::common::run(folder.path(), &format!("synth {synth}"));
                if !made.status.success() && name == "volume" {
                    skipped("no synth volume here");
                    continue;
                }
                assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
            }
        }
        for ratio in ["1%", "40%"] {
            let command = format!(
                "simplify in.ply out.ply --ratio {ratio} --cell-triangles {cells} --memory {budget}MiB \
                 --threads 2 --force --report r.json --drop-texture"
            );
            let command =
                if name == "textured" { command.replace(" --drop-texture", "") } else { command };
            let output = group.run(folder.path(), &command);
            let said = String::from_utf8_lossy(&output.stderr).into_owned();
            assert!(
                matches!(output.status.code(), Some(0 | 3)),
                "{name} {ratio}: {:?} {said}",
                output.status
            );
            let report = json(folder.path(), "r.json");
            let peak = report["peak_memory_bytes"].as_u64().unwrap();
            let usage = std::fs::read_to_string(group.0.join("memory.max_usage_in_bytes")).unwrap();
            println!(
                "{name} {ratio}: budget {budget} MiB, peak {} MiB, cgroup {} MiB",
                peak >> 20,
                usage.trim().parse::<u64>().unwrap_or(0) >> 20
            );
            assert!(peak <= (budget + 4) << 20, "{name} {ratio}: peak {peak}");
        }
    }
}

/// A budget beyond the limit of the cgroup is taken down, and refused if nothing would do.
#[test]
fn a_budget_beyond_the_cgroup_is_taken_down_or_refused() {
    let folder = tempfile::tempdir().unwrap();
    expect(folder.path(), "synth statue in.ply --triangles 600k", 0);
    let Some(group) = Group::new("small", 60 << 20) else {
        skipped("no cgroup can be made here");
        return;
    };
    let output = group.run(folder.path(), "simplify in.ply out.ply --ratio 1% --memory 2GiB");
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(6), "{said}");
    assert!(said.contains("limit 60.0 MiB"), "{said}");
    std::fs::write(group.0.join("memory.limit_in_bytes"), (130 << 20).to_string()).unwrap();
    let output = group.run(
        folder.path(),
        "simplify in.ply out.ply --ratio 1% --memory 2GiB --cell-triangles 60k",
    );
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(0), "{said}");
}

/// The least budget that the plan gives for a command, in MiB, rounded up.
fn least_mib(folder: &Path, command: &str) -> u64 {
    let least = |memory: &str| {
        let said = expect(folder, &format!("{command} --dry-run --memory {memory}"), 0);
        let least =
            said.split("at least ").nth(1).and_then(|rest| rest.split_once(" MiB")).unwrap().0;
        // It is rounded to a tenth.
        (least.parse::<f64>().unwrap() + 0.05).ceil() as u64
    };
    let found = least("8GiB");
    // It is the least for whoever has no more, too.
    assert_eq!(least(&format!("{found}MiB")), found, "{command}");
    found
}

fn peak_bytes(folder: &Path) -> u64 {
    let report = json(folder, "r.json");
    report["peak_memory_bytes"].as_u64().unwrap()
}

/// A bumpy sheet of 2 n^2 triangles whose vertices carry so many further numbers.
fn write_wide(path: &Path, n: usize, n_further: usize) {
    let mut bytes = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\nproperty float y\n\
         property float z\n{}element face {}\nproperty list uchar int vertex_indices\nend_header\n",
        (n + 1) * (n + 1),
        (0..n_further).map(|i| format!("property int further_{i}\n")).collect::<String>(),
        2 * n * n
    )
    .into_bytes();
    for v in 0..(n + 1) * (n + 1) {
        let (x, y) = ((v % (n + 1)) as f32, (v / (n + 1)) as f32);
        let z = (x * 0.05).sin() * (y * 0.07).cos() * 5.0 + (x * 1.7 + y * 2.3).sin() * 0.05;
        [x, y, z].iter().for_each(|c| bytes.extend(c.to_le_bytes()));
        (0..n_further).for_each(|i| bytes.extend(((v * i) as i32).to_le_bytes()));
    }
    for quad in 0..n * n {
        let a = (quad / n * (n + 1) + quad % n) as i32;
        let (b, c, d) = (a + 1, a + n as i32 + 2, a + n as i32 + 1);
        for triangle in [[a, b, c], [a, c, d]] {
            bytes.push(3);
            triangle.iter().for_each(|v| bytes.extend(v.to_le_bytes()));
        }
    }
    std::fs::write(path, bytes).unwrap();
}

/// With no more than the least budget, the peak stays below it; and the least is not out of all proportion.
#[test]
fn the_least_budget_is_enough_and_not_twice_the_need() {
    // How the scan is made, and what is asked of it.
    let scans = [
        ("statue", "statue in.ply --triangles 350k", "--ratio 1%"),
        ("statue", "statue in.ply --triangles 350k", "--ratio 50% --fit on"),
        ("volume", "volume in.ply --triangles 450k", "--ratio 60% --fit on"),
        ("volume", "volume in.ply --triangles 450k", "--ratio 5%"),
        // Rounds that fit, the last of them without a finish after it.
        ("statue", "statue in.ply --triangles 350k", "--ratio 30% --fit on --cell-triangles 20k"),
        ("colours", "terrain in.ply --triangles 300k --color --uv", "--ratio 10%"),
        ("fragments", "", "--ratio 5%"),
        ("wide", "", "--ratio 5%"),
        ("wide", "", "--ratio 95%"),
        ("wide", "", "--ratio 95% --cell-triangles 25k"),
    ];
    for (name, synth, options) in scans {
        let folder = tempfile::tempdir().unwrap();
        let input = folder.path().join("in.ply");
        match name {
            "fragments" => write_fragments(&input, 200),
            "wide" => write_wide(&input, 280, 60),
            _ => drop(expect(folder.path(), &format!("synth {synth}"), 0)),
        }
        let command =
            format!("simplify in.ply out.ply {options} --threads 1 --restart --report r.json");
        let least = least_mib(folder.path(), &command);
        let output = crate::common::run(folder.path(), &format!("{command} --memory {least}MiB"));
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(matches!(output.status.code(), Some(0 | 3)), "{name} {options}: {said}");
        let peak = peak_bytes(folder.path());
        println!("{name} {options}: least {least} MiB, peak {} MiB", peak >> 20);
        assert!(peak <= least << 20, "{name} {options}: peak {} of {least} MiB", peak >> 20);
        assert!(2 * peak + (40 << 20) > least << 20, "{name} {options}: {peak} of {least} MiB");
    }
}

/// Memory that threads have used and freed does not add up: they take turns where the budget is small.
#[test]
fn many_threads_stay_within_the_least_budget() {
    let folder = tempfile::tempdir().unwrap();
    expect(folder.path(), "synth statue in.ply --triangles 1M", 0);
    // Rounds only, whose least budget is little more than that of one cell; and a finish that takes all of it.
    for options in [
        "--ratio 30% --cell-triangles 60k --fit off",
        "--ratio 32% --cell-triangles 75k --fit off",
        "--ratio 4% --cell-triangles 40k --fit on",
    ] {
        let command =
            format!("simplify in.ply out.ply {options} --threads 8 --force --report r.json");
        let least = least_mib(folder.path(), &command);
        let command = format!("{command} --memory {least}MiB");
        let output = match Group::new("threads", (least << 20) * 10 / 9 + (1 << 20)) {
            Some(group) => group.run(folder.path(), &command),
            None => {
                skipped("no cgroup can be made here");
                crate::common::run(folder.path(), &command)
            }
        };
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(0), "{options}: {said}");
        let peak = peak_bytes(folder.path());
        println!("{options}: least {least} MiB, peak {} MiB", peak >> 20);
        assert!(peak <= least << 20, "{options}: peak {} of {least} MiB", peak >> 20);
    }
}

/// The memory that a refusal names is enough, and so is the size of cells.
#[test]
fn the_advice_of_a_refusal_for_memory_works() {
    let at = &scratch();
    expect(at, "synth terrain in.ply --triangles 900k --color", 0);
    let command = "simplify in.ply out.ply --ratio 30% --until partition --restart";
    let said = expect(at, &format!("{command} --memory 60MiB"), 6);
    let word = |start: &str| {
        let rest = said.split(start).nth(1).unwrap_or_else(|| panic!("no '{start}' in: {said}"));
        format!("{start}{}", rest.split([',', ' ', '\n']).next().unwrap())
    };
    expect(at, &format!("{command} {}", word("--memory ").trim()), 0);
    expect(at, &format!("{command} --memory 60MiB {}", word("--cell-triangles ").trim()), 0);
}
