//! The memory promise: scans of every kind stay alive in a cgroup hardly larger than their budget.
//!
//! Skipped, and said so, where cgroups of version 1 cannot be made.

#![allow(clippy::unwrap_used)] // A test fails by panicking.
#![allow(clippy::print_stdout)] // Skipped tests say so.

mod common;

use common::expect;
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
        ("ordinary", "statue in.ply --triangles 1500k", 100_000, 110),
        ("shuffled", "statue in.ply --triangles 1500k --shuffle", 100_000, 110),
        ("fragmented", "", 60_000, 150),
        ("textured", "terrain in.ply --triangles 800k --color --uv", 60_000, 150),
        ("volume", "volume in.ply --triangles 800k", 60_000, 150),
    ];
    for (name, synth, cells, budget) in scans {
        // A budget is taken down to nine tenths of the limit.
        let Some(group) = Group::new(name, (budget << 20) * 10 / 9 + (1 << 20)) else {
            println!("skipped: no cgroup can be made here");
            return;
        };
        let folder = tempfile::tempdir().unwrap();
        match synth {
            "" => write_fragments(&folder.path().join("in.ply"), 320),
            _ => {
                let made = common::run(folder.path(), &format!("synth {synth}"));
                if !made.status.success() && name == "volume" {
                    println!("skipped: no synth volume here");
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
            let report = std::fs::read(folder.path().join("r.json")).unwrap();
            let report: serde_json::Value = serde_json::from_slice(&report).unwrap();
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
        println!("skipped: no cgroup can be made here");
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
