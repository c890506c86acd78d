//! Commands in a folder full of other people's files, some of them under names that are nearly ours: afterwards every
//! byte but those of the output is as it was.

#![allow(clippy::print_stdout)] // The figures.

use crate::common::{expect, run, scratch};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Kind and contents of everything below a folder; the target of a link.
pub fn snapshot(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut open = vec![folder.to_path_buf()];
    while let Some(at) = open.pop() {
        for entry in std::fs::read_dir(&at).unwrap().flatten() {
            let (path, kind) = (entry.path(), entry.file_type().unwrap());
            let contents = if kind.is_file() {
                std::fs::read(&path).unwrap()
            } else if kind.is_symlink() {
                std::fs::read_link(&path).unwrap().to_string_lossy().into_owned().into_bytes()
            } else {
                b"folder".to_vec()
            };
            if kind.is_dir() {
                open.push(path.clone());
            }
            found.insert(path.strip_prefix(folder).unwrap().to_path_buf(), contents);
        }
    }
    found
}

/// Files of others, at places where a command makes its own.
const JUNK: &str = "o.ply.stonecut-job/notes.txt p.ply.stonecut-job/keep.cells p.ply.stonecut-job/lock \
    q.ply.stonecut-job/manifest.jsonl r.ply.stonecut-job/trials/thesis.ply \
    new.stonecut-job/round-0.cells/notes.txt .new.stonecut-tiles/notes.txt \
    page.html.stonecut-compare/collapse.ply mine.stonecut-scratch/notes.txt \
    .in.ply.1-0.stonecut-scratch/notes.txt .o.ply.tmp .o.ply.x-1.tmp job/notes.txt \
    job/simplify-0000.x.cells s.mtl s_textures/t.png shots/notes.txt shots/view-00.png \
    full/notes.txt temp/o.ply.stonecut-job/notes.txt tree/notes.txt cells/1.stl parts/notes.txt \
    precious.json";

/// A command, and what it may change.
const COMMANDS: [(&str, &[&str]); 41] = [
    ("simplify in.ply o.ply --ratio 50% -q", &["o.ply"]),
    ("simplify in.ply o.ply --ratio 50% -q --force --restart", &["o.ply"]),
    ("simplify in.ply p.ply --ratio 50% -q --restart", &["p.ply"]),
    ("simplify in.ply q.ply --ratio 50% -q", &["q.ply"]),
    ("simplify in.ply r.ply --ratio 50% -q --restart", &["r.ply"]),
    ("simplify in.ply s.obj --ratio 50% -q --report precious.json", &["s.obj"]),
    ("simplify in.ply g.ply --ratio 50% -q --receipt precious.json", &["g.ply"]),
    ("simplify in.ply h.ply --ratio 50% -q --receipt h.json", &["h.ply", "h.json"]),
    ("verify h.json --again", &[]),
    ("simplify in.ply s.obj --ratio 50% -q --temp-dir temp", &["s.obj"]),
    ("simplify tex.obj s.obj --ratio 50% -q", &["s.obj"]),
    ("simplify in.ply a.ply --ratio 50% -q --verify --seams seams.ply", &["a.ply", "seams.ply"]),
    ("simplify in.ply b.ply --ratio 50% -q --method cluster", &["b.ply"]),
    ("simplify in.ply c.ply --ratio 50% -q --optimize 1", &["c.ply"]),
    ("simplify in.ply d.ply --ratio 50% -q --temp-dir full", &["d.ply"]),
    ("simplify in.ply f.ply --ratio 50% -q --force --progressive precious.json", &["f.ply"]),
    ("convert in.ply e.stl --temp-dir full", &["e.stl"]),
    ("convert tex.obj s.obj", &["s.obj"]),
    ("convert two.ply parts/{label}.stl --split label", &[]),
    ("convert two.ply cells/{label}.stl --split label", &[]),
    ("convert two.ply o-{label}.ply --split label --report precious.json", &[]),
    ("info in.ply --check --temp-dir full", &[]),
    ("info in.ply --check", &[]),
    ("info tree --check", &[]),
    ("measure in.ply small.ply --samples 1k --heatmap heat.ply --report precious.json", &[]),
    ("measure in.ply small.ply --samples 1k --heatmap heat.ply", &["heat.ply"]),
    ("measure in.ply small.ply --samples 1k --appearance --views 2 --pictures shots", &[]),
    ("render in.ply -o pic.png --size 40x30", &["pic.png"]),
    ("synth terrain ter.ply --triangles 500", &["ter.ply"]),
    ("synth rooms s.obj --triangles 3000", &["s.obj"]),
    ("tiles in.ply new", &["new"]),
    ("tiles in.ply new --force --restart", &["new"]),
    ("tiles in.ply tree --force", &[]),
    ("tiles in.ply full --force", &[]),
    ("tiles in.ply . --force", &[]),
    ("tiles tree/in.ply tree --force", &[]),
    ("tiles in.ply other --temp-dir tree", &["other"]),
    ("extract tree x.ply --max-error 1", &["x.ply"]),
    ("compare collapse,cluster in.ply --triangles 500 --samples 1k -o page.html", &["page.html"]),
    ("plan job in.ply u.ply --ratio 50% --units 2", &[]),
    ("plan . in.ply u.ply --ratio 50% --units 2", &[]),
];

/// Files that `convert --split` may write.
const REGIONS: [&str; 2] = ["parts/1.stl", "parts/2.stl"];

#[test]
fn nothing_but_the_output_changes() {
    let at = &scratch();
    expect(at, "synth statue in.ply --triangles 4000", 0);
    let two = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
               element face 2\nproperty list uchar int vertex_indices\nproperty int label\nend_header\n\
               0 0 0\n1 0 0\n0 1 0\n1 1 1\n3 0 1 2 1\n3 1 3 2 2\n";
    std::fs::write(at.join("two.ply"), two).unwrap();
    expect(at, "simplify in.ply small.ply --ratio 50% -q", 0);
    expect(at, "tiles in.ply tree --tile-triangles 500 -q", 0);
    std::fs::copy(at.join("in.ply"), at.join("tree/in.ply")).unwrap();
    let text = "mtllib tex.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 1\nvt 0 0\nvt 1 0\nvt 0 1\nvt 1 1\n\
                usemtl m\nf 1/1 2/2 3/3\nf 2/2 4/4 3/3\n";
    std::fs::write(at.join("tex.obj"), text).unwrap();
    std::fs::write(at.join("tex.mtl"), "newmtl m\nKd 1 0 0\n").unwrap();
    for name in JUNK.split(' ') {
        let path = at.join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, format!("precious {name}")).unwrap();
    }
    std::os::unix::fs::symlink("full", at.join("l.ply.stonecut-job")).unwrap();
    std::os::unix::fs::symlink("../full", at.join("temp/link.stonecut-scratch")).unwrap();
    let linked = [("simplify in.ply l.ply --ratio 50% -q --restart", &["l.ply"][..])];
    let (mut n_commands, mut n_compared) = (0, 0);
    for (command, outputs) in COMMANDS.into_iter().chain(linked) {
        let before = snapshot(at);
        (n_commands, n_compared) = (n_commands + 1, n_compared + before.len());
        let output = run(at, command);
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(
            matches!(output.status.code(), Some(0 | 2 | 3 | 4)),
            "stonecut {command}: {:?}\n{said}",
            output.status.code()
        );
        let mut after = snapshot(at);
        // One file a region.
        let is_output = |path: &Path| {
            outputs.iter().any(|output| path.starts_with(output))
                || path.to_str().is_some_and(|path| REGIONS.contains(&path))
        };
        after.retain(|path, _| !is_output(path));
        for (path, bytes) in before.iter().filter(|(path, _)| !is_output(path)) {
            assert!(
                after.remove(path).as_ref() == Some(bytes),
                "stonecut {command}: {path:?}\n{said}"
            );
        }
        assert!(after.is_empty(), "stonecut {command} leaves {:?}\n{said}", after.keys());
    }
    println!("{n_commands} commands, {n_compared} files and folders compared");
}

/// Every option of every command that names something to write; `@` is where it is put.
const WRITERS: [&str; 23] = [
    "simplify in.ply @ --ratio 50% -q --format ascii",
    "simplify in.ply new.ply --ratio 50% -q --report @",
    "simplify in.ply new.ply --ratio 50% -q --receipt @.json",
    "simplify in.ply new.ply --ratio 50% -q --seams @",
    "simplify in.ply new.ply --ratio 50% -q --progressive @",
    "simplify in.ply new.ply --ratio 50% -q --log-file @",
    "simplify in.ply @ --ratio 50% -q --method cluster --format ascii",
    "convert in.ply @ --format ascii",
    "convert in.ply new.ply --report @",
    "convert foam.ply @/{label}.stl --split label",
    "info in.ply --log-file @",
    "tiles in.ply @ -q",
    "tiles in.ply newtree -q --report @",
    "extract tree @ --max-error 1 --format ascii",
    "measure in.ply small.ply --samples 500 --heatmap @",
    "measure in.ply small.ply --samples 500 --report @",
    "measure in.ply small.ply --samples 500 --appearance --views 1 --pictures @",
    "render in.ply --size 20x20 -o @",
    "compare cluster in.ply --ratio 50% --samples 500 -o @",
    "synth terrain @ --triangles 100 --format ascii",
    "plan @ in.ply new.ply --ratio 50% --units 2",
    "plan newjob in.ply @ --ratio 50% --units 2 --format ascii",
    "man @",
];

/// Things of others: a text, a folder, a link to a text, one to a folder, one to nothing, a FIFO, a file in a tree, in somebody's
/// job, and a folder that is not there.
const PLACES: [&str; 9] = [
    "mine.txt",
    "home",
    "link",
    "links",
    "nowhere",
    "fifo",
    "tree/tileset.json",
    "mine.stonecut-job/notes",
    "missing/x",
];

/// Whatever is named as an output, with `--force` where there is one: what lay there before is there afterwards.
#[test]
fn no_output_takes_the_place_of_what_is_not_a_mesh_of_ours() {
    let at = &scratch();
    expect(at, "synth statue in.ply --triangles 600", 0);
    expect(at, "synth foam foam.ply --triangles 600", 0);
    expect(at, "simplify in.ply small.ply --ratio 50% -q", 0);
    expect(at, "tiles in.ply tree --tile-triangles 500 -q", 0);
    std::fs::write(at.join("mine.txt"), [7u8, 0, 200, 1]).unwrap();
    for name in ["home", "mine.stonecut-job"] {
        std::fs::create_dir(at.join(name)).unwrap();
        std::fs::write(at.join(name).join("notes"), [9u8, 0, 255]).unwrap();
    }
    for (name, target) in [("link", "mine.txt"), ("links", "home"), ("nowhere", "gone")] {
        std::os::unix::fs::symlink(target, at.join(name)).unwrap();
    }
    rustix::fs::mkfifoat(rustix::fs::CWD, at.join("fifo"), rustix::fs::Mode::RWXU).unwrap();
    let before = snapshot(at);
    let mut n_compared = 0;
    for writer in WRITERS {
        for place in PLACES {
            let command = writer.replace('@', place);
            let output = run(at, &command);
            let said = String::from_utf8_lossy(&output.stderr);
            let code = output.status.code();
            assert!(matches!(code, Some(0 | 2 | 4)), "stonecut {command}: {code:?}\n{said}");
            let mut after = snapshot(at);
            for (path, bytes) in &before {
                n_compared += 1;
                let is_same = after.remove(path).as_ref() == Some(bytes);
                assert!(is_same, "stonecut {command}: {path:?}\n{said}");
            }
            // What is new is the output, and goes.
            for path in after.keys().rev() {
                let path = at.join(path);
                let is_folder = path.symlink_metadata().unwrap().is_dir();
                let gone = if is_folder { std::fs::remove_dir } else { std::fs::remove_file };
                gone(&path).unwrap();
            }
        }
    }
    let n = WRITERS.len() * PLACES.len();
    println!(
        "{} commands at {} places: {n} runs, {n_compared} files and folders compared",
        WRITERS.len(),
        PLACES.len()
    );
}
