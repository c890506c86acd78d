//! What engines are handed: the script for Slurm, and the recipes of `tools/recipes`, with a unit that is killed.

#![allow(clippy::print_stdout)] // Skipped tests say so.

use crate::cluster::{bytes, plan, scan};
use crate::common::{expect, run, scratch, stonecut};
use std::path::{Path, PathBuf};
use std::process::Command;

#[test]
fn a_script_for_slurm_chains_arrays() {
    let at = &scratch();
    expect(at, "synth statue in.ply --triangles 10k", 0);
    let job = at.join("it's a job");
    let output = stonecut()
        .current_dir(at)
        .arg("plan")
        .arg(&job)
        .args([
            "in.ply",
            "out.ply",
            "--ratio",
            "1%",
            "--cell-triangles",
            "1000",
            "--units",
            "1200",
            "--slurm",
            "-p compute -c 2",
        ])
        .output()
        .unwrap();
    assert!(output.status.success());
    // An sbatch that prints what it would run, and a number.
    let bin = at.join("bin");
    std::fs::create_dir(&bin).unwrap();
    let sbatch = "#!/bin/sh\necho \"$*\" >>calls\nwc -l <calls\n";
    std::fs::write(bin.join("sbatch"), sbatch).unwrap();
    let status = Command::new("chmod").arg("755").arg(bin.join("sbatch")).status();
    assert!(status.unwrap().success());
    std::fs::write(at.join("chain.sh"), &output.stdout).unwrap();
    let path = format!("{}:{}", bin.display(), std::env::var("PATH").unwrap());
    let ran =
        Command::new("sh").current_dir(at).arg("chain.sh").env("PATH", path).output().unwrap();
    assert!(ran.status.success(), "{}", String::from_utf8_lossy(&ran.stderr));
    let calls = std::fs::read_to_string(at.join("calls")).unwrap();
    let calls: Vec<&str> = calls.lines().collect();
    assert_eq!(calls.len(), 6, "1,200 units of simplify are two arrays: {calls:#?}");
    assert!(
        calls.iter().all(|call| call.contains("-p compute -c 2") && call.contains("--retry 5,10"))
    );
    for (call, words) in [
        (0, &["-a 0-0", "partition/$((SLURM_ARRAY_TASK_ID + 0))"][..]),
        (2, &["-d afterok:2", "-a 0-999", "simplify/$((SLURM_ARRAY_TASK_ID + 0))"]),
        (3, &["-d afterok:2", "-a 0-199", "simplify/$((SLURM_ARRAY_TASK_ID + 1000))"]),
        (4, &["-d afterok:3:4", "-a 0-0", "finish/$(("]),
        (5, &["-d afterok:5", "-a 0-0", "rest/$(("]),
    ] {
        words
            .iter()
            .for_each(|word| assert!(calls[call].contains(word), "{word}: {}", calls[call]));
    }
}

/// A stonecut that is killed the first time it is to do a batch of cells.
fn killed_once(at: &Path) -> PathBuf {
    let path = at.join("killed-once");
    let program = env!("CARGO_BIN_EXE_stonecut");
    let text = format!(
        "#!/bin/sh\ncase \"$3\" in simplify/*) mkdir '{}/killed' 2>/dev/null && kill -KILL $$ ;; esac\nexec '{program}' \"$@\"\n",
        at.display()
    );
    std::fs::write(&path, text).unwrap();
    std::fs::set_permissions(&path, std::os::unix::fs::PermissionsExt::from_mode(0o755)).unwrap();
    path
}

/// Plans a job and keeps its graph in `plan.json`.
fn plan_file(at: &Path) {
    let words = "plan job in.ply out.ply --ratio 5% --cell-triangles 3000 --units 4 --parts 2";
    std::fs::write(at.join("plan.json"), run(at, words).stdout).unwrap();
}

fn recipe(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tools/recipes").join(name)
}

fn has(program: &str) -> bool {
    let is_there =
        Command::new(program).arg("--version").output().is_ok_and(|o| o.status.success());
    if !is_there {
        crate::common::skipped(&format!("no {program} on this machine"));
    }
    is_there
}

#[test]
fn the_recipe_without_an_engine_survives_a_killed_unit() {
    if !has("python3") || !has("xargs") {
        return;
    }
    let (folder, whole) = scan("statue", "60k", "--ratio 5% --cell-triangles 3000");
    let at = folder.path();
    plan_file(at);
    let output = Command::new(recipe("loop"))
        .current_dir(at)
        .args(["job", "plan.json", "3"])
        .env("STONECUT", killed_once(at))
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(at.join("killed").exists());
    assert!(bytes(&at.join("out.ply")) == whole);
}

#[test]
fn the_recipe_for_arrays_takes_the_numbers_of_queues() {
    let (folder, whole) = scan("statue", "60k", "--ratio 5% --cell-triangles 3000");
    let at = folder.path();
    let words = "job in.ply out.ply --ratio 5% --cell-triangles 3000 --units 4 --parts 2";
    for (k, (phase, units)) in plan(at, words).into_iter().enumerate() {
        for index in 0..units.len() {
            let (name, number) = match k % 4 {
                0 => ("AWS_BATCH_JOB_ARRAY_INDEX", index),
                1 => ("SGE_TASK_ID", index + 1),
                2 => ("PBS_ARRAY_INDEX", index),
                _ => ("LSB_JOBINDEX", index + 1),
            };
            let status = Command::new(recipe("array"))
                .current_dir(at)
                .args(["job", &phase])
                .env(name, number.to_string())
                .env("STONECUT", env!("CARGO_BIN_EXE_stonecut"))
                .status();
            assert!(status.unwrap().success(), "{phase}/{index} by {name}");
        }
    }
    assert!(bytes(&at.join("out.ply")) == whole);
}

#[test]
fn the_recipe_for_snakemake_survives_a_killed_unit() {
    if !has("snakemake") {
        return;
    }
    let (folder, whole) = scan("statue", "60k", "--ratio 5% --cell-triangles 3000");
    let at = folder.path();
    plan_file(at);
    let output = Command::new("snakemake")
        .current_dir(at)
        .arg("-s")
        .arg(recipe("Snakefile"))
        .args(["-j", "3", "--config"])
        .arg(format!("stonecut={}", killed_once(at).display()))
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(at.join("killed").exists());
    assert!(bytes(&at.join("out.ply")) == whole);
}
