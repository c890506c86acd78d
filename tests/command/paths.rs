//! Every command and option that takes a path, against every kind of bad path: refused with the documented exit
//! code, before any work, and nothing on the disk is touched. docs/design/paths.md has the rules.

use crate::common::{expect, scratch, start, stonecut};
use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::os::unix::ffi::OsStrExt;
use std::os::unix::fs::FileTypeExt;
use std::path::Path;
use std::process::{Command, Stdio};

/// A path in a command.
struct Slot {
    /// What stands for it in the command.
    mark: &'static str,
    /// A path that is right.
    good: &'static str,
    is_read: bool,
}

const fn read(mark: &'static str, good: &'static str) -> Slot {
    Slot { mark, good, is_read: true }
}

const fn written(mark: &'static str, good: &'static str) -> Slot {
    Slot { mark, good, is_read: false }
}

/// Every command with all options that take a file.
const COMMANDS: [(&str, &[Slot]); 7] = [
    (
        "simplify {in} {out} --ratio 50% --report {report} --seams {seams} --log-file {log}",
        &[
            read("{in}", "in.ply"),
            written("{out}", "new.ply"),
            written("{report}", "new.json"),
            written("{seams}", "seams.ply"),
            written("{log}", "new.log"),
        ],
    ),
    (
        "convert {in} {out} --log-file {log}",
        &[read("{in}", "in.ply"), written("{out}", "new.stl"), written("{log}", "new.log")],
    ),
    ("info {in} --check --log-file {log}", &[read("{in}", "in.ply"), written("{log}", "new.log")]),
    (
        "measure {in} {other} --samples 1k --report {report} --heatmap {heat} --near {near} --within 1 \
         --log-file {log}",
        &[
            read("{in}", "in.ply"),
            read("{other}", "small.ply"),
            read("{near}", "near.ply"),
            written("{report}", "new.json"),
            written("{heat}", "heat.ply"),
            written("{log}", "new.log"),
        ],
    ),
    (
        "render {in} {other} -o {out} --size 40x30 --log-file {log}",
        &[
            read("{in}", "in.ply"),
            read("{other}", "small.ply"),
            written("{out}", "new.png"),
            written("{log}", "new.log"),
        ],
    ),
    (
        "report {in} --measured {other} -o {out} --log-file {log}",
        &[
            read("{in}", "run.json"),
            read("{other}", "measured.json"),
            written("{out}", "new.html"),
            written("{log}", "new.log"),
        ],
    ),
    (
        "synth terrain {out} --triangles 500 --log-file {log}",
        &[written("{out}", "new.ply"), written("{log}", "new.log")],
    ),
];

/// The command with good paths but one.
fn command(template: &str, slots: &[Slot], bad: &Slot, path: &str) -> String {
    let fill = |text: String, slot: &Slot| {
        text.replace(slot.mark, if slot.mark == bad.mark { path } else { slot.good })
    };
    slots.iter().fold(template.to_owned(), fill)
}

/// What is on the disk: kind and contents of everything in the folder.
fn snapshot(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut found = BTreeMap::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let entry = entry.unwrap();
        let kind = entry.file_type().unwrap();
        let contents = if kind.is_file() {
            std::fs::read(entry.path()).unwrap()
        } else if kind.is_symlink() {
            let target = std::fs::read_link(entry.path()).unwrap();
            format!("link to {}", target.display()).into_bytes()
        } else {
            assert!(kind.is_dir() || kind.is_fifo());
            format!("{kind:?}").into_bytes()
        };
        found.insert(entry.file_name().into_string().unwrap(), contents);
    }
    found
}

fn bench() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    expect(at, "synth statue in.ply --triangles 3000", 0);
    expect(at, "simplify in.ply small.ply --ratio 20% --report run.json -q", 0);
    expect(at, "measure in.ply small.ply --samples 1k --report measured.json", 0);
    expect(at, "convert small.ply near.ply", 0);
    std::fs::write(at.join("precious.txt"), "precious\0").unwrap();
    std::fs::create_dir(at.join("folder")).unwrap();
    std::os::unix::fs::symlink("precious.txt", at.join("link")).unwrap();
    std::os::unix::fs::symlink("nothing", at.join("dangling")).unwrap();
    assert!(Command::new("mkfifo").arg(at.join("fifo")).status().unwrap().success());
    folder
}

/// Runs a command that must be refused, with a guard against hanging; gives the code and the words.
fn refused(at: &Path, arguments: &str) -> (Option<i32>, String) {
    let child = stonecut()
        .current_dir(at)
        .args(arguments.split_whitespace())
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let id = child.id().to_string();
    let (send, receive) = std::sync::mpsc::channel();
    std::thread::spawn(move || send.send(child.wait_with_output()));
    match receive.recv_timeout(std::time::Duration::from_secs(20)) {
        Ok(output) => {
            let output = output.unwrap();
            (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
        }
        Err(_) => {
            let _ = Command::new("kill").args(["-9", &id]).status();
            panic!("stonecut {arguments}: hangs");
        }
    }
}

#[test]
fn every_bad_path_of_every_command_is_refused_and_nothing_is_touched() {
    let folder = bench();
    let at = folder.path();
    let before = snapshot(at);
    let mut n = 0;
    for (template, slots) in COMMANDS {
        for slot in slots {
            let bad: &[(&str, i32)] = if slot.is_read {
                &[
                    ("missing", 4),
                    ("nowhere/missing", 4),
                    ("folder", 4),
                    ("fifo", 4),
                    ("/dev/null", 4),
                    ("dangling", 4),
                ]
            } else {
                &[
                    ("folder", 2),
                    ("fifo", 2),
                    ("/dev/null", 2),
                    ("/dev/full", 2),
                    ("link", 2),
                    ("dangling", 2),
                    ("precious.txt", 2),
                    ("nowhere/new", 2),
                    ("precious.txt/new", 2),
                    ("folder/", 2),
                    ("..", 2),
                    ("/proc/new", 10),
                ]
            };
            // Names with the right ending, so that nothing but the path itself is at fault.
            let ending = slot.good.rsplit_once('.').unwrap().1;
            for &(path, code) in bad {
                let path = match path {
                    "nowhere/new" | "precious.txt/new" | "/proc/new" => format!("{path}.{ending}"),
                    other => other.to_owned(),
                };
                for force in ["", " --force"] {
                    let arguments = command(template, slots, slot, &path);
                    let has_force = !arguments.starts_with("info");
                    let arguments = arguments + if has_force { force } else { "" };
                    if path == "precious.txt" && force == " --force" && slot.mark == "{out}" {
                        continue;
                    }
                    let (found, said) = refused(at, &arguments);
                    assert_eq!(found, Some(code), "stonecut {arguments}\n{said}");
                    assert_eq!(said.lines().count(), 1, "{arguments}\n{said}");
                    assert!(snapshot(at) == before, "stonecut {arguments}: changes the disk");
                    n += 1;
                }
            }
        }
    }
    assert!(n > 300, "{n} commands");
    assert!(std::fs::metadata("/dev/null").unwrap().file_type().is_char_device());
    assert!(std::fs::metadata("/dev/full").unwrap().file_type().is_char_device());
}

/// Reports and records name paths in UTF-8, which names in Latin-1 are not.
#[test]
fn paths_that_are_not_utf8_are_refused_before_the_work() {
    let folder = bench();
    let at = folder.path();
    let named = |ending: &[u8]| at.join(OsStr::from_bytes(&[b"H\xf6he", ending].concat()));
    std::fs::copy(at.join("in.ply"), named(b".ply")).unwrap();
    std::fs::create_dir(at.join("tiles")).unwrap();
    std::fs::rename(named(b".ply"), at.join("tiles").join(named(b".ply").file_name().unwrap()))
        .unwrap();
    std::fs::write(named(b".obj"), "").unwrap();
    for (words, path, code) in [
        ("info", named(b".obj"), 4),
        ("simplify in.ply --ratio 50%", named(b".ply"), 2),
        ("simplify in.ply o.ply --ratio 50% --report", named(b".json"), 2),
        ("simplify in.ply o.ply --ratio 50% --temp-dir", named(b""), 2),
        ("tiles in.ply", named(b""), 2),
        ("render in.ply -o", named(b".png"), 2),
        ("info", at.join("tiles"), 4),
    ] {
        let run = stonecut().current_dir(at).args(words.split(' ')).arg(path).output().unwrap();
        let said = String::from_utf8_lossy(&run.stderr);
        assert_eq!(run.status.code(), Some(code), "{words}: {said}");
        assert!(said.contains("not UTF-8; rename") && !at.join("o.ply").exists(), "{said}");
    }
}

#[test]
fn no_two_paths_of_a_command_may_be_the_same_file() {
    let folder = bench();
    let at = folder.path();
    std::fs::hard_link(at.join("in.ply"), at.join("hard.ply")).unwrap();
    std::os::unix::fs::symlink("in.ply", at.join("soft.ply")).unwrap();
    std::os::unix::fs::symlink(".", at.join("here")).unwrap();
    let before = snapshot(at);
    for (template, slots) in COMMANDS {
        for (i, a) in slots.iter().enumerate() {
            for b in slots.iter().skip(i + 1).filter(|b| !(a.is_read && b.is_read)) {
                let mut names =
                    vec![a.good.to_owned(), format!("./{}", a.good), format!("here/{}", a.good)];
                if a.good == "in.ply" {
                    names.extend(["hard.ply", "soft.ply"].map(str::to_owned));
                }
                for name in names {
                    let arguments = command(template, slots, b, &name);
                    let has_force = !arguments.starts_with("info");
                    let arguments = arguments + if has_force { " --force" } else { "" };
                    let (found, said) = refused(at, &arguments);
                    assert_eq!(found, Some(2), "stonecut {arguments}\n{said}");
                    assert!(snapshot(at) == before, "stonecut {arguments}: changes the disk");
                }
            }
        }
    }
    // Reading one file twice is no clash.
    expect(at, "measure in.ply in.ply --samples 1k", 0);
}

/// `--force` replaces files that stand for nothing; an image or the library of the input is a part of it.
#[test]
fn files_that_the_input_names_are_never_replaced() {
    let at = &scratch();
    std::fs::write(at.join("a.mtl"), "newmtl m\nmap_Kd a.png\n").unwrap();
    let text = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 1\nvt 0 0\nvt 1 0\nvt 0 1\nvt 1 1\nusemtl m\n\
                f 1/1 2/2 3/3\nf 2/2 4/4 3/3\n";
    std::fs::write(at.join("a.obj"), text).unwrap();
    // Its image is not there yet.
    expect(at, "render a.obj -o a.png --size 8x8", 3);
    let before = snapshot(at);
    for command in [
        "render a.obj -o a.png --size 8x8 --force",
        "simplify a.obj a.png --format obj --ratio 50% --force",
        "simplify a.obj a.mtl --format obj --ratio 50% --force",
        "simplify a.obj a.png --format obj --ratio 50% --method cluster --drop-texture --force",
        "convert a.obj a.mtl --format ply --force",
    ] {
        let said = expect(at, command, 2);
        assert!(said.contains("of the input"), "{command}: {said}");
        assert_eq!(snapshot(at), before, "{command}");
    }
}

#[test]
fn only_files_of_their_own_kind_are_replaced() {
    let folder = bench();
    let at = folder.path();
    let text = |name: &str| std::fs::read(at.join(name)).unwrap();
    // Reports replace reports, of either command, and empty files that a script made for them.
    std::fs::write(at.join("empty.json"), "").unwrap();
    std::fs::write(at.join("other.json"), "{\"asset\": {\"version\": \"2.0\"}}").unwrap();
    for (name, code) in
        [("run.json", 0), ("measured.json", 0), ("empty.json", 0), ("other.json", 2), ("in.ply", 2)]
    {
        let arguments = format!("measure small.ply near.ply --samples 1k --report {name} --force");
        let before = text(name);
        expect(at, &arguments, code);
        assert_eq!(text(name) == before, code != 0, "{name}");
    }
    // Seams and heatmaps replace their own kind, heatmaps with --force only.
    let seams = "simplify in.ply o.ply --ratio 50% --cell-triangles 1k --force -q --seams";
    expect(at, &format!("{seams} s.ply"), 0);
    expect(at, &format!("{seams} s.ply"), 0);
    expect(at, &format!("{seams} near.ply"), 2);
    let heat = "measure in.ply small.ply --samples 1k --heatmap";
    expect(at, &format!("{heat} h.ply"), 0);
    expect(at, &format!("{heat} h.ply"), 2);
    expect(at, &format!("{heat} h.ply --force"), 0);
    expect(at, &format!("{heat} near.ply --force"), 2);
    // A log is appended to, but only to a text.
    std::fs::write(at.join("l.log"), "earlier\n").unwrap();
    expect(at, "convert in.ply c.stl --log-file l.log", 0);
    assert!(String::from_utf8(text("l.log")).unwrap().starts_with("earlier\nc.stl"), "appended");
    expect(at, "convert in.ply d.stl --log-file run.json", 2);
    // Main outputs replace what is there, with --force only.
    std::fs::write(at.join("p.png"), "precious").unwrap();
    expect(at, "render in.ply -o p.png --size 40x30", 2);
    expect(at, "render in.ply -o p.png --size 40x30 --force", 0);
    assert!(text("p.png").starts_with(b"\x89PNG"));
    expect(at, "report run.json -o in.ply --force", 2);
}

/// Temporary names have once been the output's stem and `.part`.
#[test]
fn nobodys_files_are_taken_for_temporary_ones() {
    let folder = bench();
    let at = folder.path();
    let mut kept = Vec::new();
    for stem in ["o", "r", "p", "h", "l", "s"] {
        for name in [format!("{stem}.part"), format!(".{stem}.tmp")] {
            std::fs::write(at.join(&name), "precious").unwrap();
            kept.push(name);
        }
    }
    expect(at, "simplify in.ply o.ply --ratio 50% --report r.json --seams s.ply", 0);
    expect(at, "render in.ply -o p.png --size 40x30", 0);
    expect(at, "report r.json -o h.html", 0);
    for name in kept {
        assert_eq!(std::fs::read(at.join(&name)).unwrap(), b"precious", "{name}");
    }
}

#[test]
fn the_kind_of_an_output_is_known_before_the_work() {
    let folder = bench();
    let at = folder.path();
    let before = snapshot(at);
    for arguments in [
        "simplify in.ply o.xyz --ratio 50%",
        "simplify in.ply o --ratio 50%",
        "simplify in.ply o.stl --ratio 50% --format double",
        "simplify in.ply o.glb --ratio 50% --format ascii",
        "convert in.ply o.xyz",
        "convert in.ply o.obj --format uint",
        "synth terrain o.txt --triangles 100",
        "render in.ply -o p.jpg",
        "report run.json -o page",
        "measure in.ply small.ply --heatmap h.stl",
        "simplify in.ply o.ply --ratio 50% --seams s.obj",
        "simplify in.ply o.ply --max-error 1 --seams s.ply",
        "simplify in.ply o.stl --max-error 1 --error-field",
        "simplify in.ply o.ply --ratio 50% --error-field",
        "simplify in.ply o.ply --ratio 50% --temp-dir /etc/passwd",
        "convert in.ply o.stl --temp-dir in.ply",
        "info in.ply --check --temp-dir in.ply",
    ] {
        let (code, said) = refused(at, arguments);
        assert_eq!(code, Some(2), "stonecut {arguments}\n{said}");
        assert!(snapshot(at) == before, "stonecut {arguments}: changes the disk");
    }
    expect(at, "simplify in.ply o.xyz --ratio 50% --format ply", 0);
}

#[test]
fn outputs_of_one_name_share_a_folder_for_temporary_data() {
    let folder = bench();
    let at = folder.path();
    for name in ["a", "b", "t"] {
        std::fs::create_dir(at.join(name)).unwrap();
    }
    for name in ["a", "b"] {
        expect(
            at,
            &format!("simplify in.ply {name}/o.ply --ratio 50% --temp-dir t --until partition"),
            0,
        );
    }
    assert_eq!(std::fs::read_dir(at.join("t")).unwrap().count(), 2);
    for name in ["a", "b"] {
        expect(at, &format!("simplify in.ply {name}/o.ply --ratio 50% --temp-dir t"), 0);
    }
    assert_eq!(std::fs::read_dir(at.join("t")).unwrap().count(), 0);
}

#[test]
fn a_pipe_that_is_closed_ends_the_command_without_a_word() {
    let at = &scratch();
    expect(at, "synth terrain in.ply --triangles 200k", 0);
    let mut child = start(at, "convert in.ply -");
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(141));
    assert!(output.stderr.is_empty(), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(expect(at, "status .", 4).contains("there is no such job"));
}

#[test]
fn a_job_that_another_folder_has_finished_goes() {
    let at = &scratch();
    expect(at, "synth terrain in.ply --triangles 2000", 0);
    std::fs::create_dir(at.join("t")).unwrap();
    let command = "simplify in.ply o.ply --ratio 50% --temp-dir t";
    let n_jobs = || std::fs::read_dir(at.join("t")).unwrap().count();
    expect(at, &format!("{command} --until partition"), 0);
    expect(at, "simplify in.ply o.ply --ratio 50%", 0);
    expect(at, "simplify in.ply o.ply --ratio 50% --fit off --temp-dir t", 2);
    assert_eq!(n_jobs(), 1);
    assert!(expect(at, command, 0).contains("already done"));
    assert_eq!(n_jobs(), 0);
}

#[test]
fn pipelines_side_by_side_leave_nothing_behind() {
    let at = &scratch();
    expect(at, "synth terrain in.ply --triangles 60k", 0);
    let command = "simplify in.ply - --ratio 90% --cell-triangles 5k -q";
    let mut both = [start(at, command), start(at, command)];
    drop(both[0].stdout.take());
    let [closed, open] = both.map(|child| child.wait_with_output().unwrap());
    assert_eq!(closed.status.code(), Some(141), "{closed:?}");
    assert_eq!(open.status.code(), Some(0), "{}", String::from_utf8_lossy(&open.stderr));
    assert!(open.stdout.starts_with(b"ply"));
    let names = std::fs::read_dir(at).unwrap().map(|entry| entry.unwrap().file_name());
    assert_eq!(names.collect::<Vec<_>>(), ["in.ply"]);
    let said = expect(at, "simplify in.ply - --ratio 50% --until partition", 2);
    assert!(said.contains("standard output is not continued"), "{said}");
}

/// What only the end of the work would notice is refused before it begins.
#[test]
fn pictures_in_the_way_and_no_samples_are_refused_before_any_work() {
    let at = &scratch();
    expect(at, "synth statue in.ply --triangles 1000", 0);
    std::fs::create_dir(at.join("shots")).unwrap();
    std::fs::write(at.join("shots/view-01.png"), "mine").unwrap();
    let measure = "measure in.ply in.ply --samples 1k --heatmap heat.ply --appearance --views 2";
    let said = expect(at, &format!("{measure} --pictures shots"), 2);
    assert!(said.contains("view-01.png") && said.contains("--force"), "{said}");
    // The heatmap comes before the pictures.
    assert!(!at.join("heat.ply").exists() && !at.join("shots/view-00.png").exists());
    let said = expect(at, &format!("{measure} --pictures in.ply"), 2);
    assert!(said.contains("--pictures") && !at.join("heat.ply").exists(), "{said}");
    expect(at, &format!("{measure} --pictures shots --force"), 0);
    assert_eq!(&std::fs::read(at.join("shots/view-01.png")).unwrap()[1..4], b"PNG");
    // The words are read before the input is opened.
    let compare = "compare cluster missing.ply --triangles 100 -o page.html";
    let said = expect(at, &format!("{compare} --samples 0"), 2);
    assert!(said.contains("at least one sample"), "{said}");
}
