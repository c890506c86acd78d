//! Names that a command may replace or remove: those that it has written itself, nothing that appeared meanwhile, nothing in a
//! folder of others.

use crate::common::{expect, scratch, start, stonecut};
use crate::populated::snapshot;
use std::io::Write;
use std::os::unix::fs::{PermissionsExt, symlink};
use std::path::Path;
use std::process::{Command, Stdio};
use stonecut::config::{Config, Target};
use stonecut::pipeline;
use stonecut::system::disk::Disk;
use stonecut::system::progress::Progress;

fn scan(triangles: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    expect(folder.path(), &format!("synth statue in.ply --triangles {triangles}"), 0);
    folder
}

#[test]
fn a_tree_goes_only_if_nothing_else_lies_in_it() {
    let folder = scan("4000");
    let at = folder.path();
    expect(at, "tiles in.ply t --tile-triangles 500 --viewer -q", 0);
    let again = "tiles in.ply t --tile-triangles 600 --viewer --force -q";
    for (name, contents) in [
        ("notes", "mine"),
        ("tiles/0/0/scan.ply", "mine"),
        ("tiles/mine/x", "mine"),
        ("index.html", "mine"),
        ("tiles/0/0/0-0.glb", "mine"),
    ] {
        let path = at.join("t").join(name);
        let earlier = std::fs::read(&path).ok();
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, contents).unwrap();
        let before = snapshot(at);
        let said = expect(at, again, 2);
        assert!(said.contains(name.trim_end_matches("/x")), "{name}: {said}");
        assert!(snapshot(at) == before, "{name}");
        match earlier {
            Some(bytes) => std::fs::write(&path, bytes).unwrap(),
            None => std::fs::remove_file(&path).unwrap(),
        }
        if name.starts_with("tiles/mine") {
            let said = expect(at, again, 2);
            assert!(said.contains("tiles/mine"), "an empty folder of others: {said}");
            std::fs::remove_dir(at.join("t/tiles/mine")).unwrap();
        }
    }
    std::fs::copy(at.join("in.ply"), at.join("t/in.ply")).unwrap();
    let said = expect(at, "tiles t/in.ply t --force -q", 2);
    assert!(said.contains("INPUT lies in OUTPUT"), "{said}");
    std::fs::remove_file(at.join("t/in.ply")).unwrap();
    let said = expect(at, "tiles in.ply new --temp-dir new -q", 2);
    assert!(said.contains("--temp-dir lies in OUTPUT") && !at.join("new").exists(), "{said}");
    // The list alone makes no tree.
    std::fs::create_dir(at.join("home")).unwrap();
    std::fs::copy(at.join("t/tileset.json"), at.join("home/tileset.json")).unwrap();
    std::fs::write(at.join("home/thesis"), "years of work").unwrap();
    let said = expect(at, "tiles in.ply home --force -q", 2);
    assert!(said.contains("thesis") && at.join("home/tileset.json").exists(), "{said}");
    expect(at, again, 0);
    expect(at, "info t --check", 0);
    let left = std::fs::read_dir(at).unwrap().flatten().count();
    assert_eq!(left, 3, "{:?}", snapshot(at).keys());
}

#[test]
fn job_folders_are_our_own() {
    let folder = scan("2000");
    let at = folder.path();
    let simplify = "simplify in.ply o.ply --ratio 50% -q";
    expect(at, &format!("{simplify} --until partition"), 0);
    let job = at.join("o.ply.stonecut-job");
    assert_eq!(std::fs::metadata(&job).unwrap().permissions().mode() & 0o777, 0o700);
    // Files in it are no links.
    std::fs::write(at.join("victim"), "precious").unwrap();
    for name in ["lock", "manifest.jsonl", "round-0.cells"] {
        let path = job.join(name);
        let earlier = std::fs::read(&path).unwrap();
        std::fs::remove_file(&path).unwrap();
        symlink("../victim", &path).unwrap();
        let said = expect(at, simplify, 2);
        assert!(said.contains(name), "{said}");
        expect(at, &format!("{simplify} --restart"), 2);
        assert_eq!(std::fs::read(at.join("victim")).unwrap(), b"precious", "{name}");
        std::fs::remove_file(&path).unwrap();
        std::fs::write(&path, earlier).unwrap();
    }
    expect(at, simplify, 0);
    assert!(!job.exists());
    // A prepared one, in a folder for all.
    std::fs::create_dir(at.join("shared")).unwrap();
    expect(at, "simplify in.ply p.ply --ratio 50% -q --temp-dir shared --until partition", 0);
    let entry = std::fs::read_dir(at.join("shared")).unwrap().flatten().next().unwrap();
    std::fs::rename(entry.path(), at.join("elsewhere")).unwrap();
    symlink("../elsewhere", entry.path()).unwrap();
    let said = expect(at, "simplify in.ply p.ply --ratio 50% -q --temp-dir shared", 2);
    assert!(said.contains("symbolic link"), "{said}");
    std::fs::remove_file(entry.path()).unwrap();
    std::fs::rename(at.join("elsewhere"), entry.path()).unwrap();
    // Only root can give a folder to others.
    if std::os::unix::fs::chown(entry.path(), Some(12345), None).is_ok() {
        let said = expect(at, "simplify in.ply p.ply --ratio 50% -q --temp-dir shared", 2);
        assert!(said.contains("belongs to user 12345"), "{said}");
    }
}

#[test]
fn files_of_others_in_a_job_of_ours_stay() {
    let folder = scan("2000");
    let at = folder.path();
    let simplify = "simplify in.ply o.ply --ratio 50% -q";
    expect(at, &format!("{simplify} --until partition"), 0);
    let mine = ["notes.txt", "my.cells", "thesis.part"]
        .map(|name| at.join("o.ply.stonecut-job").join(name));
    mine.iter().for_each(|path| std::fs::write(path, "mine").unwrap());
    expect(at, simplify, 0);
    mine.iter().for_each(|path| assert_eq!(std::fs::read(path).unwrap(), b"mine"));
    assert_eq!(std::fs::read_dir(at.join("o.ply.stonecut-job")).unwrap().count(), 3);
}

/// Killed at any of its last steps, a run is ended by the same command.
#[test]
fn a_run_that_was_stopped_while_it_cleared_up_ends() {
    let folder = scan("3000");
    let config = Config {
        job_folder: folder.path().join("out.ply.stonecut-job"),
        ..crate::common::config(folder.path(), Target::Triangles(300))
    };
    let simplify = |disk: &Disk| {
        let prepared = pipeline::prepare(&config)?;
        pipeline::simplify_on(disk, prepared, &Progress::default())
    };
    let disk = Disk::default();
    simplify(&disk).unwrap();
    let (n, whole) = (disk.changes(), std::fs::read(&config.output).unwrap());
    let mut after_the_output = 0;
    for back in 0..14 {
        std::fs::remove_file(&config.output).unwrap();
        let disk = Disk::default();
        disk.freeze_at(n - back);
        assert!(simplify(&disk).is_err(), "{back}");
        after_the_output += usize::from(config.output.exists());
        let report = simplify(&Disk::default());
        let report = report.unwrap_or_else(|e| panic!("{back} changes before the end: {e}"));
        assert_eq!(report.unwrap().output.triangles, 300);
        assert!(std::fs::read(&config.output).unwrap() == whole, "{back}");
        assert!(!config.job_folder.exists(), "{back}");
    }
    assert!(after_the_output > 5, "{after_the_output}");
    // Another run is not taken for it.
    let disk = Disk::default();
    disk.freeze_at(n - 1);
    std::fs::remove_file(&config.output).unwrap();
    assert!(simplify(&disk).is_err() && config.output.exists());
    let said = expect(folder.path(), "simplify in.ply out.ply --triangles 200 -q", 2);
    assert!(said.contains("--force"), "{said}");
    assert!(std::fs::read(&config.output).unwrap() == whole);
}

#[test]
fn a_job_for_many_machines_does_not_take_a_folder_in_use() {
    let folder = scan("3000");
    let at = folder.path();
    let plan = "plan job in.ply o.ply --ratio 50% --units 1 --report r.json -q";
    std::fs::create_dir(at.join("job")).unwrap();
    std::fs::write(at.join("job/notes.txt"), "mine").unwrap();
    let said = expect(at, plan, 2);
    assert!(said.contains("notes.txt") && !at.join("job/units").exists(), "{said}");
    std::fs::remove_file(at.join("job/notes.txt")).unwrap();
    expect(at, plan, 0);
    let units = ["notes.txt", "my.cells", "partition-0000.cells"]
        .map(|name| at.join("job/units").join(name));
    units.iter().for_each(|path| std::fs::write(path, "mine").unwrap());
    let record = std::fs::read_to_string(at.join("job/plan.record")).unwrap();
    let phases: Vec<String> =
        ["partition", "finish"].map(|phase| format!("work job {phase}/0 -q")).to_vec();
    for unit in phases.iter().filter(|unit| record.contains(unit.split(['/', ' ']).nth(2).unwrap()))
    {
        expect(at, unit, 0);
    }
    // Days later.
    std::fs::write(at.join("o.ply"), "mine").unwrap();
    let said = expect(at, "work job rest/0 -q", 2);
    assert!(said.contains("o.ply"), "{said}");
    assert_eq!(std::fs::read(at.join("o.ply")).unwrap(), b"mine");
    std::fs::remove_file(at.join("o.ply")).unwrap();
    std::fs::write(at.join("r.json"), "mine").unwrap();
    expect(at, "work job rest/0 -q", 2);
    // A report of another run.
    expect(at, "simplify in.ply other.ply --ratio 20% --report r.json -q --force", 2);
    std::fs::remove_file(at.join("r.json")).unwrap();
    expect(at, "simplify in.ply other.ply --ratio 20% --report r.json -q", 0);
    let report = std::fs::read(at.join("r.json")).unwrap();
    let said = expect(at, "work job rest/0 -q", 2);
    assert!(said.contains("r.json has appeared"), "{said}");
    assert!(std::fs::read(at.join("r.json")).unwrap() == report);
    units.iter().for_each(|path| assert_eq!(std::fs::read(path).unwrap(), b"mine"));
}

#[test]
fn an_edited_plan_replaces_nothing() {
    let folder = scan("3000");
    let at = folder.path();
    expect(at, "plan job in.ply o.ply --ratio 50% --units 1 --report r.json -q", 0);
    std::fs::write(at.join("victim.json"), "{\"mine\": 1}").unwrap();
    std::fs::write(at.join("victim.ply"), "mine").unwrap();
    let record = std::fs::read_to_string(at.join("job/plan.record")).unwrap();
    let json = record.split('\t').next().unwrap();
    for (from, to) in [("\"r.json\"", "\"victim.json\""), ("\"o.ply\"", "\"victim.ply\"")] {
        let forged = json.replace(from, to);
        assert_ne!(forged, json);
        let sum = xxhash_rust::xxh3::xxh3_64(forged.as_bytes());
        std::fs::write(at.join("job/plan.record"), format!("{forged}\t{sum:016x}\n")).unwrap();
        let before = snapshot(at);
        expect(at, "work job partition/0 -q", 2);
        assert!(snapshot(at) == before, "{to}");
    }
}

/// Ends what hangs.
fn ends(at: &Path, words: &str) -> (Option<i32>, String) {
    let output = Command::new("timeout")
        .current_dir(at)
        .args(["-s", "KILL", "20"])
        .arg(stonecut().get_program())
        .args(words.split_whitespace())
        .stdin(Stdio::null())
        .output()
        .unwrap();
    (
        output.status.code(),
        String::from_utf8_lossy(&output.stderr).into_owned()
            + &String::from_utf8_lossy(&output.stdout),
    )
}

#[test]
fn special_files_in_a_tree_are_refused_by_name() {
    let folder = scan("4000");
    let at = folder.path();
    expect(at, "tiles in.ply t --tile-triangles 500 -q", 0);
    for name in ["tiles/0/0/0-0.glb", "tiles/0/0/0.ids", "tileset.json"] {
        let path = at.join("t").join(name);
        let earlier = std::fs::read(&path).unwrap();
        for kind in ["a FIFO", "a device", "1099511627776 bytes"] {
            std::fs::remove_file(&path).unwrap();
            match kind {
                "a FIFO" => assert!(Command::new("mkfifo").arg(&path).status().unwrap().success()),
                "a device" => symlink("/dev/zero", &path).unwrap(),
                _ => std::fs::File::create(&path).unwrap().set_len(1 << 40).unwrap(),
            }
            for command in ["info t --check", "extract t x.ply --max-error 0"] {
                let (code, said) = ends(at, command);
                assert!(matches!(code, Some(1..=8)), "{command}, {name}, {kind}: {code:?} {said}");
                let words = [name, kind];
                assert!(
                    words.iter().all(|word| said.contains(word)),
                    "{command}, {name}, {kind}: {said}"
                );
                assert!(!at.join("x.ply").exists());
            }
        }
        std::fs::remove_file(&path).unwrap();
        std::fs::write(&path, earlier).unwrap();
    }
    expect(at, "extract t x.ply --max-error 0 -q", 0);
}

/// Libraries beside a mesh that are no files, and a folder of images that leads elsewhere.
#[test]
fn libraries_that_are_no_files_and_linked_folders() {
    let at = &scratch();
    let text = "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl a\nf 1/1 2/2 3/3\n";
    std::fs::write(at.join("m.obj"), text).unwrap();
    assert!(Command::new("mkfifo").arg(at.join("m.mtl")).status().unwrap().success());
    for command in ["info m.obj", "convert m.obj o.glb --force"] {
        let (code, said) = ends(at, command);
        assert!(code.is_some(), "{command}: {said}");
    }
    std::fs::remove_file(at.join("m.mtl")).unwrap();
    symlink("/dev/zero", at.join("m.mtl")).unwrap();
    let (code, said) = ends(at, "info m.obj");
    assert!(code.is_some(), "{said}");
    std::fs::remove_file(at.join("m.mtl")).unwrap();
    std::fs::write(at.join("m.mtl"), "newmtl a\nmap_Kd q.png\n").unwrap();
    let image = stonecut::render::Picture { width: 2, height: 2, rgb: vec![90; 12] };
    std::fs::write(at.join("q.png"), image.to_png().unwrap()).unwrap();
    std::fs::create_dir_all(at.join("theirs")).unwrap();
    std::fs::create_dir_all(at.join("out")).unwrap();
    symlink("../theirs", at.join("out/o_textures")).unwrap();
    let said = expect(at, "convert m.obj out/o.obj", 2);
    assert!(said.contains("out/o_textures") && said.contains("symbolic link"), "{said}");
    assert!(std::fs::read_dir(at.join("theirs")).unwrap().next().is_none());
}

/// Files that appear while standard input is read, for as long as somebody takes to write it.
#[test]
fn what_appears_while_the_input_comes_in_is_not_replaced() {
    let folder = scan("16k");
    let at = folder.path();
    let input = std::fs::read(at.join("in.ply")).unwrap();
    // More than a pipe holds: once it is written, reading has begun.
    let (first, rest) = input.split_at(200_000);
    for (command, name) in [
        ("simplify - o.ply --ratio 50% -q", "o.ply"),
        ("simplify - o.ply --ratio 50% -q --report r.json", "r.json"),
        ("simplify - o.ply --ratio 50% -q --seams s.ply", "s.ply"),
        ("simplify - o.ply --ratio 50% -q --progressive p.pm", "p.pm"),
        ("convert - o.obj", "o.obj"),
        ("tiles - t -q", "t"),
        ("render - -o o.png --size 9x9", "o.png"),
    ] {
        let mut child = start(at, command);
        let mut pipe = child.stdin.take().unwrap();
        pipe.write_all(first).unwrap();
        std::fs::write(at.join(name), "mine").unwrap();
        pipe.write_all(rest).unwrap();
        drop(pipe);
        assert_eq!(child.wait().unwrap().code(), Some(2), "{command}");
        assert_eq!(std::fs::read(at.join(name)).unwrap(), b"mine", "{command}");
        for name in [name, "o.ply", "o.ply.stonecut-job", ".t.stonecut-tiles", "t.stonecut-job"] {
            let path = at.join(name);
            let _ = std::fs::remove_file(&path).or_else(|_| std::fs::remove_dir_all(&path));
        }
    }
}
