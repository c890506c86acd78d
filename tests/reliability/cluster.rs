//! Jobs in units: the bytes of `simplify`, whatever the number of units, their order, repetitions and deaths.

#![allow(clippy::print_stdout)] // Skipped tests say so.

use crate::common::{expect, run, scratch, stonecut};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Duration;
use stonecut::pipeline::units::{Done, Pieces, Task, Unit, freeze, work};
use stonecut::system::disk::Disk;
use stonecut::system::progress::Progress;

/// Phases and numbers of units, as `plan` prints them.
pub fn plan(folder: &Path, arguments: &str) -> Vec<(String, Vec<String>)> {
    let output = run(folder, &format!("plan {arguments}"));
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "plan {arguments}\n{said}");
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(json["format"], 1);
    let phases = json["phases"].as_array().unwrap();
    for (i, phase) in phases.iter().enumerate() {
        let before: Vec<&str> =
            phases[..i].last().and_then(|p| p["name"].as_str()).into_iter().collect();
        assert_eq!(phase["after"], serde_json::json!(before));
    }
    let units = |phase: &serde_json::Value| {
        let name = phase["name"].as_str().unwrap();
        (0..phase["units"].as_u64().unwrap()).map(|i| format!("{name}/{i}")).collect()
    };
    phases.iter().map(|p| (p["name"].as_str().unwrap().to_owned(), units(p))).collect()
}

/// Another order of the same, by a generator of random numbers.
fn shuffled(units: &[String], seed: u64) -> Vec<String> {
    let mut keyed: Vec<(u64, &String)> = units
        .iter()
        .enumerate()
        .map(|(i, unit)| {
            let mut h = (seed + i as u64 + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
            h ^= h >> 29;
            (h.wrapping_mul(0xBF58_476D_1CE4_E5B9) >> 11, unit)
        })
        .collect();
    keyed.sort();
    keyed.into_iter().map(|(_, unit)| unit.clone()).collect()
}

fn start(folder: &Path, job: &str, unit: &str, options: &str) -> Child {
    stonecut()
        .current_dir(folder)
        .args(["work", job, unit, "-q", "--wait", "5"])
        .args(options.split_whitespace())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap()
}

fn ends_well(child: Child, unit: &str) {
    let output = child.wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{unit}: {said}");
}

pub fn bytes(path: &Path) -> Vec<u8> {
    std::fs::read(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// Files in the folder of units that are not records.
fn left_over(folder: &Path, job: &str) -> Vec<String> {
    let files = std::fs::read_dir(folder.join(job).join("units")).unwrap().flatten();
    let names = files.map(|file| file.file_name().to_string_lossy().into_owned());
    names.filter(|name| !name.ends_with(".record") && name != "writing").collect()
}

const SCAN: &str = "in.ply --ratio 10% --cell-triangles 1000";

/// A scan and the result of one process.
pub fn scan(kind: &str, triangles: &str, options: &str) -> (tempfile::TempDir, Vec<u8>) {
    let folder = tempfile::tempdir().unwrap();
    expect(folder.path(), &format!("synth {kind} in.ply --triangles {triangles}"), 0);
    expect(folder.path(), &format!("simplify in.ply whole.ply {options} -q"), 0);
    let whole = bytes(&folder.path().join("whole.ply"));
    (folder, whole)
}

#[test]
fn any_number_of_units_gives_the_bytes_of_one_process() {
    // The phases of rounds, with several units.
    let threshold = ["pilot", "simplify"];
    let exact = ["pilot", "trial", "simplify"];
    let two = ["recut-1", "pilot-1", "round-1", "recut-2", "pilot-2", "round-2"];
    let last_exact = ["recut-1", "pilot-1", "trial-1", "round-1"];
    let third_exact = ["recut-3", "pilot-3", "trial-3", "round-3"];
    for (kind, triangles, options, first, later) in [
        ("statue", "60k", "--ratio 5% --cell-triangles 3000", &threshold[..], &two[..3]),
        ("statue", "60k", "--ratio 4% --cell-triangles 3000", &threshold, &[]),
        ("scans", "100k", "--ratio 10% --cell-triangles 5k --min-component 50", &threshold, &two),
        ("terrain", "60k", "--ratio 60% --cell-triangles 2000", &threshold, &last_exact),
        ("terrain", "60k", "--ratio 97% --cell-triangles 2000", &exact, &[]),
        ("statue", "40k", "--ratio 5%", &[], &[]),
        (
            "statue",
            "60k",
            "--ratio 10% --cell-triangles 1000 --fit on",
            &threshold,
            &[&two[..], &third_exact].concat(),
        ),
    ] {
        let (folder, whole) = scan(kind, triangles, options);
        let at = folder.path();
        for (n, parts) in [(1, 1), (3, 2), (16, 4)] {
            let output = format!("out-{n}.ply");
            let cut = format!("--units {n} --parts {parts}");
            let phases = plan(at, &format!("job-{n} in.ply {output} {options} {cut}"));
            let names: Vec<&str> = phases.iter().map(|(name, _)| name.as_str()).collect();
            let of_parts = ["scan", "tree", "scatter", "share"];
            let wanted = [
                if parts == 1 { &[][..] } else { &of_parts },
                &["partition"],
                first,
                if n == 1 { &[] } else { later },
                &["finish", "rest"],
            ];
            assert_eq!(names, wanted.concat(), "{kind} {options}");
            for (_, units) in &phases {
                for unit in shuffled(units, n) {
                    let threads = 1 + unit.len() % 3;
                    ends_well(
                        start(at, &format!("job-{n}"), &unit, &format!("--threads {threads}")),
                        &unit,
                    );
                }
            }
            assert!(bytes(&at.join(output)) == whole, "{kind} {options}: {n} units");
            assert_eq!(left_over(at, &format!("job-{n}")), [""; 0]);
        }
    }
}

#[test]
fn every_unit_twice_and_at_once_gives_the_same_bytes() {
    let (folder, whole) = scan("statue", "60k", "--ratio 10% --cell-triangles 1000");
    let at = folder.path();
    for (_, units) in
        plan(at, &format!("job {} --units 12 --parts 3", SCAN.replace("in.ply", "in.ply out.ply")))
    {
        // All of the phase and its double together.
        let both = units.iter().chain(&units);
        let running: Vec<(Child, &String)> =
            both.map(|unit| (start(at, "job", unit, "--threads 2"), unit)).collect();
        running.into_iter().for_each(|(child, unit)| ends_well(child, unit));
        units.iter().for_each(|unit| ends_well(start(at, "job", unit, ""), unit));
    }
    assert!(bytes(&at.join("out.ply")) == whole);
    assert_eq!(left_over(at, "job"), [""; 0]);
    // Once it is over any unit says so, and the same plan is printed again.
    ends_well(start(at, "job", "simplify/5", ""), "simplify/5");
    ends_well(start(at, "job", "simplify/5", "--mend"), "simplify/5");
    plan(at, &format!("job {} --units 12 --parts 3", SCAN.replace("in.ply", "in.ply out.ply")));
    let status = run(at, "status job --json");
    let json: serde_json::Value = serde_json::from_slice(&status.stdout).unwrap();
    assert_eq!((json["is_over"].as_bool(), json["share"].as_f64()), (Some(true), Some(1.0)));
    let phases = json["phases"].as_array().unwrap();
    assert!(phases.iter().all(|phase| phase["done"] == phase["units"]));
    assert_eq!(json["report"]["target_met"], true);
}

#[test]
fn killed_units_are_done_again_and_leave_nothing() {
    let (folder, whole) = scan("statue", "300k", "--ratio 5% --cell-triangles 5k");
    let at = folder.path();
    let mut n_killed = 0;
    let mut seed = 17_u64;
    for (_, units) in
        plan(at, "job in.ply out.ply --ratio 5% --cell-triangles 5k --units 2 --parts 2")
    {
        for unit in units {
            for _ in 0..3 {
                seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                let mut child = start(at, "job", &unit, "--threads 1");
                std::thread::sleep(Duration::from_millis(seed >> 58));
                child.kill().unwrap();
                n_killed += u32::from(!child.wait().unwrap().success());
            }
            ends_well(start(at, "job", &unit, "--threads 1"), &unit);
        }
    }
    assert!(n_killed > 5, "{n_killed} killed");
    assert!(bytes(&at.join("out.ply")) == whole);
    assert_eq!(left_over(at, "job"), [""; 0]);
}

/// Plans a job and does all units of the first phases.
fn until(at: &Path, last: &str) -> Vec<(String, Vec<String>)> {
    until_of(at, "--ratio 5% --cell-triangles 3000 --units 8 --parts 2", last)
}

fn until_of(at: &Path, options: &str, last: &str) -> Vec<(String, Vec<String>)> {
    let phases = plan(at, &format!("job in.ply out.ply {options}"));
    for (name, units) in &phases {
        units.iter().for_each(|unit| ends_well(start(at, "job", unit, ""), unit));
        if name == last {
            break;
        }
    }
    phases
}

/// The first file that the record of a unit names.
fn file_of(at: &Path, unit: &str) -> PathBuf {
    let units = at.join("job/units");
    let record = std::fs::read_to_string(units.join(format!("{unit}.record"))).unwrap();
    let json: serde_json::Value = serde_json::from_str(record.split('\t').next().unwrap()).unwrap();
    units.join(json["outcome"]["files"][0]["pack"].as_str().unwrap())
}

/// Damages or removes the file of a unit, sees `victim` refused with a word on that, mends, and does `victim`.
fn damage_and_mend(at: &Path, (unit, is_gone): (&str, bool), victim: &str) {
    let record = |unit: &str| {
        let (phase, index) = unit.split_once('/').unwrap();
        format!("{phase}-{:04}", index.parse::<u32>().unwrap())
    };
    let path = file_of(at, &record(unit));
    // So that it has to read its cells again.
    let _ = std::fs::remove_file(at.join(format!("job/units/{}.record", record(victim))));
    if is_gone {
        std::fs::remove_file(&path).unwrap();
    } else {
        let mut damaged = bytes(&path);
        let n = damaged.len();
        (0..n).step_by(40).for_each(|i| damaged[i] ^= 0x5a);
        damaged[..16].copy_from_slice(b"stonecut pack 02");
        std::fs::write(&path, damaged).unwrap();
    }
    let said = expect(at, &format!("work job {victim} -q --wait 0"), 1);
    assert!(said.contains(&format!("work job {unit} --mend")) && said.contains(unit), "{said}");
    assert!(!said.contains("--restart"), "{said}");
    expect(at, &format!("work job {unit} -q"), 0);
    expect(at, &format!("work job {victim} -q --wait 0"), 1);
    expect(at, &format!("work job {unit} -q --mend"), 0);
    expect(at, &format!("work job {victim} -q --wait 0"), 0);
}

#[test]
fn a_damaged_pack_is_named_and_mended() {
    let options = "--ratio 4% --cell-triangles 3000";
    let (folder, whole) = scan("statue", "60k", options);
    let at = folder.path();
    until_of(at, &format!("{options} --units 8 --parts 2"), "simplify");
    for (unit, is_gone, victim) in [
        ("simplify/3", false, "finish/0"),
        ("simplify/3", true, "finish/0"),
        ("partition/0", false, "simplify/3"),
        ("scatter/1", false, "simplify/3"),
        ("scatter/1", true, "finish/0"),
        ("share/1", false, "simplify/3"),
        ("finish/0", false, "rest/0"),
    ] {
        damage_and_mend(at, (unit, is_gone), victim);
    }
    assert!(bytes(&at.join("out.ply")) == whole);
}

#[test]
fn damaged_packs_of_later_rounds_are_named_and_mended() {
    let options = "--ratio 10% --cell-triangles 1000";
    let (folder, whole) = scan("statue", "60k", options);
    let at = folder.path();
    let phases = until_of(at, &format!("{options} --units 8"), "round-2");
    for (unit, is_gone, victim) in [
        ("simplify/3", false, "recut-1/0"),
        ("recut-1/0", false, "pilot-1/1"),
        ("recut-1/0", true, "round-1/2"),
        ("recut-1/0", false, "round-1/5"),
        ("round-1/5", false, "recut-2/0"),
        ("recut-2/0", true, "round-2/0"),
    ] {
        damage_and_mend(at, (unit, is_gone), victim);
    }
    for (_, units) in &phases {
        units.iter().for_each(|unit| ends_well(start(at, "job", unit, ""), unit));
    }
    assert!(bytes(&at.join("out.ply")) == whole);
    assert_eq!(left_over(at, "job"), [""; 0]);
}

#[test]
fn another_input_program_or_plan_is_refused() {
    let (folder, _) = scan("statue", "60k", "--ratio 5% --cell-triangles 3000");
    let at = folder.path();
    until(at, "partition");
    let said = expect(at, "work job rest/0 -q --wait 0", 1);
    assert!(said.contains("pilot-0000.record"), "{said}");
    for unit in ["simplify/8", "knead/0"] {
        assert!(expect(at, &format!("work job {unit}"), 2).contains("simplify/0 to 7"));
    }
    for (other, code) in [
        ("job in.ply out.ply --ratio 6% --cell-triangles 3000 --units 8 --parts 2", 8),
        ("job in.ply other.ply --ratio 5% --cell-triangles 3000 --units 8 --parts 2", 8),
        ("job in.ply out.ply --ratio 5% --cell-triangles 3000 --units 3 --parts 2", 8),
        ("job in.ply out.ply --ratio 5% --cell-triangles 3000 --units 8 --parts 3", 8),
        ("other in.ply out.ply --max-error 0.1 --units 2", 2),
        ("other in.ply out.ply --ratio 5% --until partition --units 2", 2),
        ("other in.ply out.ply --ratio 5% --dry-run --units 2", 2),
        ("other in.ply out.ply --ratio 5% --optimize 1 --units 2", 2),
        ("other in.ply out.ply --ratio 5% --pairs --units 2", 2),
        ("other - out.ply --ratio 5% --units 2", 2),
        ("other in.ply whole.ply --ratio 5% --units 2", 2),
        ("other in.ply out.ply --ratio 5% --units 0", 2),
    ] {
        expect(at, &format!("plan {other}"), code);
    }
    let said = expect(at, "work job pilot/0 -q --memory 41MiB", 6);
    assert!(said.contains("at least --memory"), "{said}");
    // The same program with one byte more.
    let other = at.join("stonecut");
    let mut program = bytes(Path::new(env!("CARGO_BIN_EXE_stonecut")));
    program.push(0);
    std::fs::write(&other, program).unwrap();
    std::fs::set_permissions(&other, std::os::unix::fs::PermissionsExt::from_mode(0o755)).unwrap();
    let output =
        Command::new(&other).current_dir(at).args(["work", "job", "pilot/0"]).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(8), "{said}");
    assert!(said.contains("checksum"), "{said}");
    let mut changed = bytes(&at.join("in.ply"));
    *changed.last_mut().unwrap() ^= 1;
    std::fs::write(at.join("in.ply"), changed).unwrap();
    let said = expect(at, "work job pilot/0 -q", 8);
    assert!(said.contains("mtime") && said.contains("not the input"), "{said}");
}

#[test]
fn a_worker_ends_with_its_parent() {
    let (folder, _) = scan("statue", "60k", "--ratio 5% --cell-triangles 3000");
    let at = folder.path();
    plan(at, "job in.ply out.ply --ratio 5% --cell-triangles 3000 --units 8");
    // Waits for the partition, which never comes.
    let mut shell = Command::new("sh")
        .current_dir(at)
        .args(["-c", "\"$0\" work job pilot/0 --with-parent --wait 600 & echo $!; wait"])
        .arg(env!("CARGO_BIN_EXE_stonecut"))
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let mut line = String::new();
    let mut out = std::io::BufReader::new(shell.stdout.take().unwrap());
    std::io::BufRead::read_line(&mut out, &mut line).unwrap();
    let worker = PathBuf::from(format!("/proc/{}/stat", line.trim()));
    std::thread::sleep(Duration::from_millis(500));
    assert!(worker.exists(), "the worker waits");
    shell.kill().unwrap();
    shell.wait().unwrap();
    let is_gone = || {
        let state = std::fs::read_to_string(&worker).unwrap_or_default();
        state.is_empty() || state.contains(") Z ")
    };
    let gone = (0..100).any(|_| {
        std::thread::sleep(Duration::from_millis(50));
        is_gone()
    });
    assert!(gone, "the worker went on without its parent");
}

#[test]
fn a_chain_of_levels_has_the_bytes_of_one_process() {
    let at = &scratch();
    let levels = "--triangles 12k,3k,500 --cell-triangles 3000";
    expect(at, "synth statue in.ply --triangles 60k", 0);
    expect(at, &format!("simplify in.ply whole.ply {levels} -q"), 0);
    for (_, units) in plan(at, &format!("job in.ply out.ply {levels} --units 2")) {
        units.iter().for_each(|unit| ends_well(start(at, "job", unit, ""), unit));
    }
    for level in ["12k", "3k", "500"] {
        let of = |name: &str| bytes(&at.join(format!("{name}-{level}.ply")));
        assert!(of("whole") == of("out"), "{level}");
    }
}

/// Every operation of every unit fails once; the unit then leaves nothing and can be done again.
#[test]
fn a_failing_disk_ends_a_unit_and_harms_nothing() {
    let (folder, whole) = scan("statue", "12k", "--ratio 5% --cell-triangles 1000");
    let at = folder.path();
    let words = ["simplify", "in.ply", "out.ply", "--ratio", "5%", "--cell-triangles", "1000"];
    let words: Vec<std::ffi::OsString> = words.iter().map(std::convert::Into::into).collect();
    let typed = stonecut::cli::call::config(&words).unwrap();
    let config = stonecut::config::Config {
        input: at.join("in.ply").into(),
        output: at.join("out.ply"),
        job_folder: at.join("job/units"),
        threads: std::num::NonZeroUsize::MIN,
        ..typed
    };
    let job = at.join("job");
    let pieces = Pieces { units: 1, parts: Some(2) };
    let frozen =
        freeze(&job, (Vec::new(), at.to_owned()), &config, pieces, &Disk::default()).unwrap();
    let mut n_failures = 0;
    for phase in &frozen.phases {
        for index in 0..phase.units {
            let unit = Unit { phase: phase.name.clone(), index };
            let task = Task {
                folder: &job,
                frozen: &frozen,
                unit: &unit,
                patience: Duration::ZERO,
                mends: false,
            };
            for k in 1.. {
                let disk = Disk::default();
                disk.fail_at(k);
                let before = left_over(at, "job").len();
                match work(&task, &config, &disk, &Progress::default()) {
                    Ok(Done::Now(_) | Done::Before) => {}
                    Err(error) => {
                        n_failures += 1;
                        assert!(
                            matches!(error.exit_code(), 1 | 10),
                            "{unit}, operation {k}: {error}"
                        );
                        let after = left_over(at, "job");
                        assert!(after.len() <= before + 1, "{unit}, operation {k}: {after:?}");
                        continue;
                    }
                }
                if disk.operations() < k {
                    break;
                }
                // Done all the same, or by a record that was published before the failure: from the start.
                if unit.phase != "rest" {
                    std::fs::remove_file(
                        job.join(format!("units/{}-{index:04}.record", unit.phase)),
                    )
                    .unwrap();
                } else {
                    break;
                }
            }
        }
    }
    assert!(n_failures > 100, "{n_failures} failures");
    assert!(bytes(&at.join("out.ply")) == whole);
}

#[test]
fn a_full_disk_has_its_exit_code_and_the_unit_continues() {
    let (folder, whole) = scan("statue", "300k", "--ratio 20% --cell-triangles 10k");
    let at = folder.path();
    let job = at.join("job");
    std::fs::create_dir(&job).unwrap();
    let mount = |options: &str| {
        let status =
            Command::new("mount").args(["-t", "tmpfs", "-o", options, "tmpfs"]).arg(&job).output();
        status.is_ok_and(|output| output.status.success())
    };
    if !mount("size=64m") {
        crate::common::skipped("no right to mount a tmpfs here");
        return;
    }
    let remount = |size: &str| {
        let status =
            Command::new("mount").args(["-o", &format!("remount,size={size}")]).arg(&job).status();
        assert!(status.unwrap().success());
    };
    let outcome = std::panic::catch_unwind(|| {
        let phases = plan(at, "job in.ply out.ply --ratio 20% --cell-triangles 10k --units 1");
        for unit in ["partition/0", "pilot/0"] {
            ends_well(start(at, "job", unit, ""), unit);
        }
        let used = left_over(at, "job")
            .iter()
            .map(|n| bytes(&job.join("units").join(n)).len())
            .sum::<usize>();
        remount(&format!("{}", used + (100 << 10)));
        let n_files = left_over(at, "job").len();
        let said = expect(at, "work job simplify/0 -q", 5);
        assert!(said.contains("make space and run the same command"), "{said}");
        assert_eq!(left_over(at, "job").len(), n_files, "its files are gone");
        // With a retry: room comes while it waits.
        let child = start(at, "job", "simplify/0", "--retry 5,10 --retry-after 1");
        std::thread::sleep(Duration::from_millis(700));
        remount("64m");
        ends_well(child, "simplify/0");
        for (_, units) in &phases {
            units.iter().for_each(|unit| ends_well(start(at, "job", unit, ""), unit));
        }
        assert!(bytes(&at.join("out.ply")) == whole);
    });
    let _ = Command::new("umount").arg("-l").arg(&job).status();
    if let Err(panic) = outcome {
        std::panic::resume_unwind(panic);
    }
}
