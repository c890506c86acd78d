//! What several test programs need: a scratch folder, the command, real scans where they are.

#![allow(clippy::print_stdout)] // Skipped tests say so.
#![allow(clippy::unwrap_used)] // A test fails by panicking.
#![allow(dead_code)] // Each test program uses its own part.

pub mod meshes;
pub mod volume;

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use stonecut::config::{Config, Target, Texture};
use stonecut::io::ply::{OutputHeader, PlyWriter};
use stonecut::mesh::property::Scalar;
use stonecut::mesh::record::VertexSchema;

/// Every `n`-th case of many, so that tests stay quick; every one where `STONECUT_ALL` is set, as `.ci/nightly` does.
pub fn one_in(n: usize) -> usize {
    if std::env::var_os("STONECUT_ALL").is_some() { 1 } else { n }
}

/// A folder that goes with the test.
pub struct Scratch(tempfile::TempDir);

/// Makes one.
pub fn scratch() -> Scratch {
    Scratch(tempfile::tempdir().unwrap())
}

impl std::ops::Deref for Scratch {
    type Target = Path;

    fn deref(&self) -> &Path {
        self.0.path()
    }
}

impl<T: ?Sized> AsRef<T> for Scratch
where
    Path: AsRef<T>,
{
    fn as_ref(&self) -> &T {
        self.0.path().as_ref()
    }
}

/// The `stonecut` command of this build.
pub fn stonecut() -> Command {
    Command::new(env!("CARGO_BIN_EXE_stonecut"))
}

/// Runs the command with arguments separated by blanks, in `folder`.
pub fn run(folder: &Path, arguments: &str) -> Output {
    stonecut().current_dir(folder).args(arguments.split_whitespace()).output().expect("runs")
}

/// Starts the command in `folder`, with pipes to and from it.
pub fn start(folder: &Path, arguments: &str) -> Child {
    let mut command = stonecut();
    command.current_dir(folder).args(arguments.split_whitespace());
    command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    command.spawn().expect("runs")
}

/// Runs the command and insists on its exit code; gives back standard error.
pub fn expect(folder: &Path, arguments: &str, code: i32) -> String {
    let output = run(folder, arguments);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(code), "stonecut {arguments}\n{said}");
    said
}

/// The JSON that a command prints.
pub fn printed(folder: &Path, arguments: &str) -> serde_json::Value {
    let output = run(folder, arguments);
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "stonecut {arguments}\n{said}");
    serde_json::from_slice(&output.stdout).expect("JSON")
}

/// The JSON of `info --check`.
pub fn check(folder: &Path, file: &str) -> serde_json::Value {
    printed(folder, &format!("info --check --json {file}"))
}

/// A file of JSON.
pub fn json(folder: &Path, file: &str) -> serde_json::Value {
    serde_json::from_slice(&std::fs::read(folder.join(file)).unwrap()).unwrap()
}

/// The report of a run with `--report r.json`.
pub fn report(folder: &Path) -> serde_json::Value {
    json(folder, "r.json")
}

/// The JSON of a GLB.
pub fn glb_json(path: &Path) -> serde_json::Value {
    let bytes = std::fs::read(path).unwrap();
    let n = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    serde_json::from_slice(&bytes[20..20 + n]).unwrap()
}

/// One number of that JSON.
pub fn count(json: &serde_json::Value, key: &str) -> i64 {
    json[key].as_i64().unwrap_or_else(|| panic!("{key} in {json}"))
}

/// Root mean square deviation both ways, by `stonecut measure`.
pub fn rms(folder: &Path, original: &str, simplified: &str) -> f64 {
    expect(folder, &format!("measure {original} {simplified} --samples 200k --report m.json"), 0);
    json(folder, "m.json")["rms"].as_f64().expect("rms")
}

/// A real scan, got by `tools/fetch-scans` or unpacked by `../shared/tools/prepare-real-data`; `None` (and a word about it) without.
pub fn real_scan(name: &str) -> Option<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let unpacked = root.join("target/real-data").join(name);
    let packed = root.join("../shared/data/real").join(format!("{name}.zst"));
    if !unpacked.exists() && packed.exists() {
        static ONCE: std::sync::Once = std::sync::Once::new();
        ONCE.call_once(|| {
            let _ = Command::new("bash")
                .current_dir(root)
                .args(["../shared/tools/prepare-real-data", "target/real-data", "--no-terrain"])
                .output();
        });
    }
    if unpacked.exists() {
        return Some(unpacked);
    }
    skipped(&format!("no real scan {name} here (tools/fetch-scans)"));
    None
}

/// Says that a test, or a part of it, is left out, and why; `.ci/run` counts these lines at its end.
pub fn skipped(why: &str) {
    use std::io::Write;
    println!("skipped: {why}");
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join("skipped.txt");
    if let Ok(mut list) = std::fs::OpenOptions::new().create(true).append(true).open(path) {
        let _ = writeln!(list, "{why}");
    }
}

/// Returns whether the file system of a folder keeps extended attributes.
pub fn keeps_notes(folder: &Path) -> bool {
    use rustix::fs::{XattrFlags, setxattr};
    let path = folder.join("noted");
    std::fs::write(&path, "").unwrap();
    let keeps = setxattr(&path, "user.stonecut.done", b"", XattrFlags::empty()).is_ok();
    if !keeps {
        skipped("notes on files: this file system keeps no extended attributes");
    }
    keeps
}

/// Sends a signal to a process that the test has started.
pub fn signal(child: &std::process::Child, signal: rustix::process::Signal) {
    let id = rustix::process::Pid::from_child(child);
    rustix::process::kill_process(id, signal).unwrap();
}

/// Settings of a run from `in.ply` to `out.ply` of `folder`, on one thread.
pub fn config(folder: &Path, target: Target) -> Config {
    Config {
        memory_bytes: 256 << 20,
        threads: std::num::NonZeroUsize::MIN,
        cell_triangles: 1000,
        job_folder: folder.join("job"),
        texture: Texture::Keep,
        ..Config::new(folder.join("in.ply"), folder.join("out.ply"), target)
    }
}

/// Writes positions and triangles as a binary PLY file.
pub fn write_ply(path: &Path, coordinate: Scalar, positions: &[[f64; 3]], triangles: &[[u32; 3]]) {
    let schema = VertexSchema { coordinate, properties: Vec::new() };
    let mut records = Vec::new();
    positions.iter().for_each(|&p| schema.encode_position(p, &mut records));
    let header = OutputHeader::new(schema, positions.len() as u64, triangles.len() as u64);
    let mut writer = PlyWriter::create(path, header).unwrap();
    writer.write_vertices(&records).unwrap();
    writer.write_faces_u32(triangles).unwrap();
    writer.finish().unwrap();
}
