//! The command line end to end: standard input and output, progress as JSON, the log, the demo, merging.

use crate::common::{check, count, expect, json, scratch, start};
use std::io::Write;
use std::path::Path;
use std::process::Output;

/// Runs the command with `input` on standard input.
fn piped(folder: &Path, arguments: &str, input: &[u8]) -> Output {
    let mut child = start(folder, arguments);
    let (mut stdin, input) = (child.stdin.take().unwrap(), input.to_vec());
    // A command that ends early closes its end; what it says then is the test's business.
    let writer = std::thread::spawn(move || drop(stdin.write_all(&input)));
    let output = child.wait_with_output().unwrap();
    writer.join().unwrap();
    output
}

fn succeeds(folder: &Path, arguments: &str, input: &[u8]) -> Vec<u8> {
    let output = piped(folder, arguments, input);
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{arguments}: {said}");
    output.stdout
}

/// A text without the settings and file names that its lines may hold.
fn without_comments(mesh: &[u8]) -> Vec<u8> {
    let end = mesh.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    let header = String::from_utf8_lossy(&mesh[..end]);
    let kept: String =
        header.lines().filter(|line| !line.starts_with("comment")).collect::<Vec<_>>().join("\n");
    [kept.as_bytes(), &mesh[end..]].concat()
}

#[test]
fn a_dash_is_standard_input_or_output() {
    let at = &scratch();
    expect(at, "synth statue in.ply --triangles 30k", 0);
    let input = std::fs::read(at.join("in.ply")).unwrap();
    for (command, named) in [
        ("simplify {in} {out} --ratio 10% --format ply --quiet", "small.ply"),
        ("convert {in} {out} --format ply,ascii --quiet", "text.ply"),
        ("convert {in} {out} --format stl --quiet", "mesh.stl"),
        ("convert {in} {out} --format obj --quiet", "mesh.obj"),
        ("convert {in} {out} --format glb --quiet", "mesh.glb"),
        ("render {in} -o {out} --size 60x40 --quiet", "picture.png"),
    ] {
        let fill = |from: &str, to: &str| command.replace("{in}", from).replace("{out}", to);
        expect(at, &fill("in.ply", named), 0);
        let expected = std::fs::read(at.join(named)).unwrap();
        let same = |found: &[u8], what: &str| {
            let is_same = match named.ends_with(".ply") {
                true => without_comments(found) == without_comments(&expected),
                false => found == expected,
            };
            assert!(is_same, "{command}: {what}");
        };
        same(&succeeds(at, &fill("in.ply", "-"), b""), "to standard output");
        same(&succeeds(at, &fill("-", "-"), &input), "both ways");
        std::fs::remove_file(at.join(named)).unwrap();
        succeeds(at, &fill("-", named), &input);
        same(&std::fs::read(at.join(named)).unwrap(), "from standard input");
        std::fs::remove_file(at.join(named)).unwrap();
    }
    let told = succeeds(at, "info - --check --json", &input);
    let told: serde_json::Value = serde_json::from_slice(&told).unwrap();
    let known = check(at, "in.ply");
    for key in ["vertices", "triangles", "components", "euler_characteristic", "boundary_edges"] {
        assert_eq!(count(&told, key), count(&known, key), "{key}");
    }
    succeeds(at, "measure - in.ply --samples 2k --report m.json --quiet", &input);
    let measured = json(at, "m.json");
    assert_eq!(measured["rms"].as_f64(), Some(0.0));
    let synth = succeeds(at, "synth statue - --triangles 30k --quiet", b"");
    assert!(without_comments(&synth) == without_comments(&input));
    // Nothing but what was named stays behind.
    let mut left: Vec<String> = std::fs::read_dir(at)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    left.sort();
    assert_eq!(left, ["in.ply", "m.json"]);
}

#[test]
fn what_is_piped_in_is_checked_like_a_file() {
    let at = &scratch();
    expect(at, "synth terrain in.ply --triangles 2k", 0);
    let input = std::fs::read(at.join("in.ply")).unwrap();
    for (what, bytes) in [
        ("nothing", &b""[..]),
        ("a cut file", &input[..input.len() / 2]),
        ("no mesh", &b"hello, world\n"[..]),
    ] {
        for arguments in
            ["simplify - o.ply --ratio 10%", "info -", "convert - o.stl", "measure - in.ply"]
        {
            let output = piped(at, arguments, bytes);
            let said = String::from_utf8_lossy(&output.stderr);
            // `info` without `--check` reads headers alone.
            let may_pass = what == "a cut file" && arguments.starts_with("info");
            assert!(
                output.status.code() == Some(4) || may_pass,
                "{arguments}, {what}: {:?} {said}",
                output.status
            );
            assert!(!said.contains("panicked"), "{said}");
        }
        let names: Vec<_> =
            std::fs::read_dir(at).unwrap().map(|entry| entry.unwrap().file_name()).collect();
        assert_eq!(names, ["in.ply"], "{what}");
    }
}

#[test]
fn progress_is_json_line_by_line_if_asked_for() {
    let at = &scratch();
    expect(at, "synth statue in.ply --triangles 60k", 0);
    for command in [
        "simplify in.ply out.ply --ratio 10% --cell-triangles 5k",
        "measure in.ply in.ply --samples 5k",
    ] {
        let said = expect(at, &format!("{command} --progress json"), 0);
        // Nothing but objects, one a line, the last of them the end.
        let mut objects: Vec<serde_json::Value> = said
            .lines()
            .map(|line| serde_json::from_str(line).unwrap_or_else(|e| panic!("{line}: {e}")))
            .collect();
        assert_eq!(objects.last().unwrap()["event"], "end", "{command}: {said}");
        objects.retain(|object| object["event"] == "progress");
        assert!(!objects.is_empty(), "{command}: {said}");
        for object in &objects {
            assert!(object["stage"].is_string(), "{object}");
            for key in ["number", "stages", "seconds", "triangles", "triangles_done"] {
                assert!(object[key].as_f64().is_some_and(|x| x >= 0.0), "{key} in {object}");
            }
            assert!(object["triangles_done"].as_u64() <= object["triangles"].as_u64(), "{object}");
            assert!(object["number"].as_u64() <= object["stages"].as_u64(), "{object}");
        }
        let done = |object: &serde_json::Value| object["seconds"].as_f64();
        assert!(objects.is_sorted_by(|a, b| done(a) <= done(b)), "{command}: {said}");
    }
    // Nothing of it without being asked for.
    let said = expect(at, "simplify in.ply out.ply --ratio 10% --force --progress none", 0);
    assert!(!said.contains('{'), "{said}");
}

#[test]
fn the_log_holds_what_was_said_and_is_appended_to() {
    let at = &scratch();
    expect(at, "synth statue in.ply --triangles 20k", 0);
    let said = expect(at, "simplify in.ply out.ply --ratio 10% --log-file log.txt", 0);
    let log = std::fs::read_to_string(at.join("log.txt")).unwrap();
    for line in said.lines().filter(|line| line.contains("memory   ") || line.contains("out.ply:"))
    {
        assert!(log.contains(line.trim()), "'{line}' is not in the log:\n{log}");
    }
    assert!(log.contains("triangles"), "{log}");
    // A failure is told there too, behind what was there, and --quiet leaves the log alone.
    let mesh = std::fs::read(at.join("in.ply")).unwrap();
    std::fs::write(at.join("cut.ply"), &mesh[..mesh.len() / 2]).unwrap();
    let error = expect(at, "simplify cut.ply o.ply --ratio 10% --log-file log.txt", 4);
    let longer = std::fs::read_to_string(at.join("log.txt")).unwrap();
    assert!(longer.starts_with(&log) && longer.len() > log.len(), "{longer}");
    assert!(longer.contains(error.lines().last().unwrap().trim()), "{error}\n{longer}");
    expect(at, "convert in.ply out.stl --quiet --log-file log.txt", 0);
    let longest = std::fs::read_to_string(at.join("log.txt")).unwrap();
    assert!(longest.starts_with(&longer) && longest.len() > longer.len(), "{longest}");
}

#[test]
fn the_demo_ends_well_where_its_files_are() {
    let at = &scratch();
    std::fs::create_dir(at.join("here")).unwrap();
    // As an earlier one leaves them, but small.
    for words in [
        "synth statue here/statue.ply --triangles 600",
        "simplify here/statue.ply here/small.ply --ratio 50% --report here/small.json",
        "render here/small.ply -o here/pictures.png --size 100x100",
    ] {
        expect(at, words, 0);
    }
    let output = crate::common::run(at, "demo here");
    let said = String::from_utf8_lossy(&output.stderr).into_owned()
        + &String::from_utf8_lossy(&output.stdout);
    assert_eq!(output.status.code(), Some(0), "{said}");
    assert!(said.contains("checked: the scan was closed and in one piece"), "{said}");
    for (name, least) in
        [("statue.ply", 70 << 20), ("small.ply", 500 << 10), ("pictures.png", 20 << 10)]
    {
        assert!(at.join("here").join(name).metadata().unwrap().len() > least, "{name}");
    }
    assert_eq!(std::fs::read_dir(at.join("here")).unwrap().count(), 4);
}

/// Two sheets side by side, 0.01 apart: one component where boundaries may merge over that, two where not.
#[test]
fn boundaries_merge_as_far_as_asked() {
    let at = &scratch();
    let n = 30;
    let mut text = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
         element face {}\nproperty list uchar int vertex_indices\nend_header\n",
        2 * (n + 1) * (n + 1),
        4 * n * n
    );
    for sheet in 0..2 {
        for y in 0..=n {
            for x in 0..=n {
                let across = x as f64 + f64::from(sheet) * (n as f64 + 0.01);
                let z = (across * 0.3).sin() * (y as f64 * 0.2).cos();
                text += &format!("{across} {y} {z}\n");
            }
        }
    }
    for sheet in 0..2 {
        for quad in 0..n * n {
            let a = sheet * (n + 1) * (n + 1) + quad / n * (n + 1) + quad % n;
            text += &format!("3 {a} {} {}\n3 {a} {} {}\n", a + 1, a + n + 2, a + n + 2, a + n + 1);
        }
    }
    std::fs::write(at.join("in.ply"), text).unwrap();
    for (distance, components) in [("0", 2), ("0.001", 2), ("0.02", 1)] {
        let command =
            format!("simplify in.ply o.ply --ratio 50% --force --merge-distance {distance}");
        expect(at, &command, 0);
        let found = check(at, "o.ply");
        assert_eq!(count(&found, "components"), components, "{distance}: {found}");
        assert_eq!(count(&found, "non_manifold_edges"), 0, "{distance}");
    }
    for (distance, word) in [("-1", "length"), ("nan", "length"), ("x", "length")] {
        let said = expect(
            at,
            &format!("simplify in.ply o.ply --ratio 50% --force --merge-distance={distance}"),
            2,
        );
        assert!(said.contains(word), "{said}");
    }
    let said = expect(
        at,
        "simplify in.ply o.ply --ratio 50% --force --merge-distance 1 --topology keep",
        2,
    );
    assert!(said.contains("--topology keep"), "{said}");
}

/// Refused before any work, where the disk would hold the run but not the reserve.
#[test]
fn a_run_leaves_as_much_of_a_disk_free_as_was_asked_for() {
    let at = &scratch();
    expect(at, "synth terrain in.ply --triangles 500", 0);
    let said = expect(at, "simplify in.ply out.ply --ratio 50% --min-free 100000TB", 5);
    assert!(said.contains("--min-free keeps"), "{said}");
    assert!(!at.join("out.ply").exists() && !at.join("out.ply.stonecut-job").exists());
    expect(at, "simplify in.ply out.ply --ratio 50% --min-free 1MB", 0);
}
