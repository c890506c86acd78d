//! Signals, limits and deaths: every command stops when it is asked to, whatever it waits for, and leaves nothing.

use crate::common::{expect, json, run, scratch, start};
use std::collections::BTreeSet;
use std::io::Write;
use std::path::Path;
use std::process::{Child, Command, Output};
use std::time::{Duration, Instant};

fn names(folder: &Path) -> BTreeSet<String> {
    let entries = std::fs::read_dir(folder).unwrap();
    entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect()
}

/// Waits until the process handles SIGTERM: a signal before that would end it anyway.
pub fn wait_for_handler(child: &Child) {
    let path = format!("/proc/{}/status", child.id());
    loop {
        let status = std::fs::read_to_string(&path).unwrap();
        let caught = status.lines().find_map(|line| line.strip_prefix("SigCgt:")).unwrap();
        if u64::from_str_radix(caught.trim(), 16).unwrap() >> 14 & 1 == 1 {
            return;
        }
        std::thread::yield_now();
    }
}

pub fn signal(child: &Child, name: &str) {
    let id = child.id().to_string();
    assert!(Command::new("kill").args([name, &id]).status().unwrap().success());
}

/// The outcome of a process that must end by itself; half a minute is a guard, not a measurement.
fn ended(mut child: Child, what: &str) -> Output {
    let start = Instant::now();
    while child.try_wait().unwrap().is_none() {
        if start.elapsed() > Duration::from_secs(30) {
            child.kill().unwrap();
            panic!("stonecut {what}: does not end");
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    child.wait_with_output().unwrap()
}

/// Commands that wait for ever: for input that does not come, or for a reader of their output.
#[test]
fn every_command_obeys_a_signal_while_it_waits() {
    let at = &scratch();
    expect(at, "synth statue in.ply --triangles 30k", 0);
    expect(at, "simplify in.ply small.ply --ratio 50% --report run.json -q", 0);
    let before = names(at);
    for arguments in [
        "simplify - o.ply --ratio 50%",
        "convert - o.ply",
        "convert in.ply -",
        "info - --check",
        "measure - in.ply",
        "render - -o p.png",
        "synth terrain - --triangles 3M",
        "report run.json -o -",
    ] {
        for (name, code) in [("-INT", 130), ("-TERM", 143)] {
            let mut child = start(at, arguments);
            let mut input = child.stdin.take().unwrap();
            input.write_all(b"ply\nformat").unwrap();
            wait_for_handler(&child);
            signal(&child, name);
            let output_pipe = child.stdout.take();
            let output = ended(child, arguments);
            drop((input, output_pipe));
            let said = String::from_utf8_lossy(&output.stderr);
            assert_eq!(output.status.code(), Some(code), "{arguments} {name}: {said}");
            let can_continue = arguments.starts_with("simplify");
            assert_eq!(said.contains("continue"), can_continue, "{arguments}: {said}");
            assert_eq!(names(at), before, "{arguments} {name}");
        }
    }
}

/// The last half second of a conversion, its sync included, is no refuge either.
#[test]
fn a_conversion_stops_whenever_it_is_asked_to() {
    let at = &scratch();
    expect(at, "synth terrain in.ply --triangles 1M", 0);
    let before = names(at);
    let mut stopped = 0;
    for wait_ms in [0, 30, 100, 200, 400] {
        let child = start(at, "convert in.ply o.obj -q");
        wait_for_handler(&child);
        std::thread::sleep(Duration::from_millis(wait_ms));
        signal(&child, "-TERM");
        let output = ended(child, "convert");
        match output.status.code() {
            Some(143) => stopped += 1,
            code => assert_eq!(code, Some(0)),
        }
        let _ = std::fs::remove_file(at.join("o.obj"));
        assert_eq!(names(at), before, "{wait_ms} ms");
    }
    assert!(stopped > 0, "none was stopped");
}

#[test]
fn nothing_is_left_by_a_kill() {
    let at = &scratch();
    expect(at, "synth terrain in.ply --triangles 1M", 0);
    let before = names(at);
    for arguments in [
        "convert in.ply o.obj",
        "render in.ply -o p.png",
        "synth gyroid o.ply --triangles 1M --shuffle",
        "info in.ply --check --memory 64MiB",
        "measure in.ply in.ply --memory 100MiB",
    ] {
        for wait_ms in [0, 100, 300] {
            let mut child = start(at, arguments);
            wait_for_handler(&child);
            std::thread::sleep(Duration::from_millis(wait_ms));
            child.kill().unwrap();
            child.wait().unwrap();
            for name in ["o.obj", "p.png", "o.ply"] {
                let _ = std::fs::remove_file(at.join(name));
            }
            let is_scratch = |name: &&String| name.ends_with(".stonecut-scratch");
            let left: Vec<String> =
                names(at).difference(&before).filter(|name| !is_scratch(name)).cloned().collect();
            assert!(left.is_empty(), "{arguments}, {wait_ms} ms: {left:?}");
        }
    }
    // What dies while it cuts a mesh into cells is swept by the next that does so.
    expect(at, "info in.ply --check --memory 64MiB", 0);
    assert_eq!(names(at), before);
}

#[test]
fn scratch_of_the_dead_is_swept_and_that_of_the_living_kept() {
    let at = &scratch();
    expect(at, "synth terrain in.ply --triangles 1M", 0);
    for (name, files) in [
        ("dead", &["lock", "round-0.cells"][..]),
        ("living", &["lock", "round-0.cells"]),
        // Killed while it removed its folder, the lock first.
        ("half-removed", &["round-0.cells"]),
        ("begun", &[]),
    ] {
        let scratch = at.join(format!(".in.ply.{name}.stonecut-scratch"));
        std::fs::create_dir(&scratch).unwrap();
        files.iter().for_each(|file| std::fs::write(scratch.join(file), "").unwrap());
    }
    let lock = std::fs::File::open(at.join(".in.ply.living.stonecut-scratch/lock")).unwrap();
    rustix::fs::flock(&lock, rustix::fs::FlockOperation::NonBlockingLockExclusive).unwrap();
    expect(at, "info in.ply --check --memory 64MiB", 0);
    let left = names(at);
    let scratch: Vec<&String> = left.iter().filter(|name| name.ends_with("-scratch")).collect();
    assert_eq!(scratch, [".in.ply.living.stonecut-scratch"]);
}

#[test]
fn a_limit_on_the_size_of_files_is_an_error_like_a_full_disk() {
    let at = &scratch();
    expect(at, "synth terrain in.ply --triangles 200k", 0);
    let before = names(at);
    for arguments in ["convert in.ply o.obj", "synth statue o.ply --triangles 300k"] {
        let output = limited(at, "ulimit -f 1000", arguments);
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(5), "{arguments}: {said}");
        assert!(said.contains("ulimit -f"), "{said}");
        assert_eq!(names(at), before, "{arguments}");
    }
    let simplify = "simplify in.ply o.ply --ratio 50% --cell-triangles 20k -q";
    let output = limited(at, "ulimit -f 1000", simplify);
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(5), "{said}");
    expect(at, simplify, 0);
}

#[test]
fn a_limit_on_address_space_is_no_crash() {
    let at = &scratch();
    expect(at, "synth terrain in.ply --triangles 500k", 0);
    let before = names(at);
    for kib in [60_000, 100_000, 150_000] {
        for arguments in
            ["convert in.ply o.ply --force", "info in.ply --check", "measure in.ply in.ply -q"]
        {
            let output = limited(at, &format!("ulimit -v {kib}"), arguments);
            let said = String::from_utf8_lossy(&output.stderr);
            assert!(matches!(output.status.code(), Some(0 | 6)), "{arguments}: {said}");
            let _ = std::fs::remove_file(at.join("o.ply"));
            let left: Vec<String> = names(at).difference(&before).cloned().collect();
            assert!(left.iter().all(|name| name.ends_with("-scratch")), "{left:?}");
        }
    }
}

#[test]
fn too_many_threads_are_fewer() {
    let at = &scratch();
    expect(at, "synth terrain in.ply --triangles 20k", 0);
    for arguments in [
        "simplify in.ply o.ply --ratio 50% --memory 256MiB",
        "info in.ply --check",
        "measure in.ply in.ply --samples 1k",
        "render in.ply -o p.png --size 40x30",
        "synth terrain s.ply --triangles 20k",
    ] {
        expect(at, &format!("{arguments} --threads 100000"), 0);
        expect(at, &format!("{arguments} --threads 0 --force"), 2);
    }
}

fn limited(at: &Path, limit: &str, arguments: &str) -> Output {
    let command = format!("{limit}; exec {} {arguments}", env!("CARGO_BIN_EXE_stonecut"));
    Command::new("sh").current_dir(at).args(["-c", &command]).output().unwrap()
}

/// Trials of `--max-error` belong to the job, and go with it; they once lay beside the output.
#[test]
fn no_trial_outlives_its_job() {
    let at = &scratch();
    expect(at, "synth statue in.ply --triangles 100k", 0);
    std::fs::write(at.join("o.trial-10000.ply"), "precious").unwrap();
    let child = start(at, "simplify in.ply o.ply --max-error 1e-4 -q");
    wait_for_handler(&child);
    while !at.join("o.ply.stonecut-job/trials").exists() {
        std::thread::sleep(Duration::from_millis(2));
    }
    signal(&child, "-INT");
    assert_eq!(ended(child, "--max-error").status.code(), Some(130));
    assert_eq!(run(at, "simplify in.ply o.ply --ratio 1% --restart -q").status.code(), Some(0));
    assert_eq!(names(at), ["in.ply", "o.ply", "o.trial-10000.ply"].map(str::to_owned).into());
    assert_eq!(std::fs::read(at.join("o.trial-10000.ply")).unwrap(), b"precious");
}

/// Cells that an attempt at a bound takes over from the one before it are as it would make them.
#[test]
fn cells_of_the_attempt_before_change_no_byte() {
    let at = &scratch();
    expect(at, "synth statue in.ply --triangles 20k", 0);
    let bounded = |output: &str| {
        format!("simplify in.ply {output} --max-error 2 --cell-triangles 1k -q --force")
    };
    expect(at, &bounded("whole.ply"), 0);
    let earlier = at.join("o.ply.stonecut-job/trials/job/round-1-trial.survivors");
    let mut child = start(at, &bounded("o.ply"));
    while !earlier.exists() && child.try_wait().unwrap().is_none() {
        std::thread::sleep(Duration::from_millis(1));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    // Without them, everything is made again.
    if earlier.exists() {
        std::fs::remove_file(&earlier).unwrap();
    }
    expect(at, &bounded("o.ply"), 0);
    let read = |name: &str| std::fs::read(at.join(name)).unwrap();
    assert!(read("o.ply") == read("whole.ply"));
}

/// A run that has lost what the first attempt at a bound did goes through it again.
#[test]
fn an_attempt_at_a_bound_in_one_cell_goes_on_to_the_same_bytes() {
    let at = &scratch();
    expect(at, "synth volume in.ply --triangles 20k", 0);
    let bounded = |output: &str| format!("simplify in.ply {output} --max-error 0.5 -q --force");
    expect(at, &format!("{} --report r.json", bounded("whole.ply")), 0);
    let report = json(at, "r.json");
    assert!(report["max_error"]["trials"].as_array().unwrap().len() > 1, "one attempt is enough");
    let folder = at.join("o.ply.stonecut-job");
    let has_tried = || {
        let files = std::fs::read_dir(&folder).into_iter().flatten().flatten();
        files
            .map(|file| std::fs::read_to_string(file.path()).unwrap_or_default())
            .any(|text| text.contains("trial 1"))
    };
    let mut child = start(at, &bounded("o.ply"));
    while !has_tried() && child.try_wait().unwrap().is_none() {
        std::thread::sleep(Duration::from_millis(1));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    expect(at, &bounded("o.ply"), 0);
    let read = |name: &str| std::fs::read(at.join(name)).unwrap();
    assert!(read("o.ply") == read("whole.ply"));
}
