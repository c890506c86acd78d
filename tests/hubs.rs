//! Vertices and edges of thousands of triangles: four times as many take at most six times the steps, in every command.
//!
//! Steps are counted where loops go around a vertex (`mesh::steps`), never timed. The count belongs to the process, so these tests have
//! a program for themselves and run one after another.

#![allow(clippy::unwrap_used, clippy::panic)] // A test fails by panicking.

use std::f64::consts::TAU;
use std::ffi::OsString;
use std::io::Write;
use std::path::Path;
use std::sync::{Mutex, PoisonError};
use stonecut::Mesh;
use stonecut::system::progress::Progress;

/// Triangles of the smaller input, unless it takes more for a bound to hold, and how many times as many the larger one has.
const FEW: u32 = 1000;
const TIMES: u32 = 4;

/// Steps for each triangle that any vertex may take.
const FREE: u64 = 256;

/// Times the steps that the larger one may take.
const MOST: u64 = 6;

static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());

/// Points evenly on a circle around the z-axis.
fn rim(n: u32, z: f64) -> impl Iterator<Item = [f64; 3]> {
    (0..n).map(move |i| {
        let (y, x) = (TAU * f64::from(i) / f64::from(n)).sin_cos();
        [x, y, z]
    })
}

/// Triangles from a vertex to the edges of a rim that begins at `first`.
fn around(apex: u32, first: u32, n: u32, is_turned: bool) -> impl Iterator<Item = [u32; 3]> {
    (0..n).map(move |i| match is_turned {
        false => [apex, first + i, first + (i + 1) % n],
        true => [apex, first + (i + 1) % n, first + i],
    })
}

/// A fan of `n` triangles whose middle vertex is at this height over its rim.
///
/// ```text
///      .-'|'-.
///    /' \ | / '\
///   |____\|/____|
/// ```
fn cone(n: u32, height: f64) -> Mesh {
    let positions = std::iter::once([0.0, 0.0, height]).chain(rim(n, 0.0)).collect();
    Mesh::new(positions, around(0, 1, n, false).collect())
}

/// Two cones with one rim.
fn bicone(n: u32) -> Mesh {
    let n = n / 2;
    let positions = [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]].into_iter().chain(rim(n, 0.0)).collect();
    Mesh::new(positions, around(0, 2, n, false).chain(around(1, 2, n, true)).collect())
}

/// Two cones that have their apex in common.
fn touching(n: u32) -> Mesh {
    let n = n / 2;
    let positions = std::iter::once([0.0; 3]).chain(rim(n, 1.0)).chain(rim(n, -1.0)).collect();
    Mesh::new(positions, around(0, 1, n, true).chain(around(0, 1 + n, n, false)).collect())
}

/// Triangles that have one edge in common, as a book has pages; every other one is turned over.
fn book(n: u32) -> Mesh {
    let positions = [[0.0; 3], [0.0, 0.0, 1.0]].into_iter().chain(rim(n, 0.5)).collect();
    let page = |i| if i % 2 == 0 { [0, 1, 2 + i] } else { [1, 0, 2 + i] };
    Mesh::new(positions, (0..n).map(page).collect())
}

fn write(path: &Path, mesh: &Mesh) {
    let mut out = Vec::new();
    write!(
        out,
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty double x\nproperty double y\nproperty double z\n\
         element face {}\nproperty list uchar int vertex_indices\nend_header\n",
        mesh.positions.len(),
        mesh.triangles.len()
    )
    .unwrap();
    mesh.positions.iter().flatten().for_each(|x| out.extend(x.to_le_bytes()));
    for t in &mesh.triangles {
        out.push(3);
        t.iter().for_each(|v| out.extend(v.to_le_bytes()));
    }
    std::fs::write(path, out).unwrap();
}

/// Steps that a command takes; IN, OUT and OTHER in it are paths.
fn steps(command: &str, mesh: &Mesh) -> u64 {
    let folder = tempfile::tempdir().unwrap();
    write(&folder.path().join("in.ply"), mesh);
    let path = |name: &str| folder.path().join(name).display().to_string();
    let word = |word: &str| match word {
        "IN" => path("in.ply"),
        _ if word.starts_with("OUT") => path(&word.replace("OUT", "out")),
        _ => word.to_owned(),
    };
    let words: Vec<OsString> = command.split(' ').map(|w| word(w).into()).collect();
    let before = stonecut::mesh::steps::taken();
    if words[0] == "tiles" {
        let code = stonecut::cli::main_from(std::iter::once("stonecut".into()).chain(words));
        assert!(code == 0 || code == 3, "{command}: exit code {code}");
    } else {
        stonecut::cli::call::call(&words, &Progress::default()).unwrap();
    }
    stonecut::mesh::steps::taken() - before
}

const ALL: [&str; 5] = ["flat fan", "cone", "bicone", "touching cones", "book"];

fn shape(name: &str, n: u32) -> Mesh {
    match name {
        "flat fan" => cone(n, 0.0),
        "cone" => cone(n, 1.0),
        "bicone" => bicone(n),
        "touching cones" => touching(n),
        _ => book(n),
    }
}

/// Fails unless a command takes steps nearly in proportion on some shapes of `n` triangles.
fn assert_proportional(command: &str, shapes: &[&str], n: u32) {
    let _one = ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner);
    let mut faults = String::new();
    for name in shapes {
        let few = steps(command, &shape(name, n));
        let many = steps(command, &shape(name, TIMES * n));
        if many > MOST * few.max(FREE * u64::from(n)) {
            faults += &format!("{command}, {name}: {few} steps, then {many}\n");
        }
    }
    assert!(faults.is_empty(), "{faults}");
}

#[test]
fn tiles() {
    let command = "tiles IN OUT --tile-triangles 1000 -q";
    assert_proportional(command, &["flat fan", "cone", "bicone", "book"], FEW);
}

#[test]
fn self_intersections() {
    assert_proportional("info IN --check --self-intersections", &ALL, FEW);
}

#[test]
fn pairs() {
    assert_proportional("simplify IN OUT.ply --ratio 50% --pairs", &ALL, FEW);
}

#[test]
fn optimize() {
    assert_proportional("simplify IN OUT.ply --ratio 50% --optimize 1", &ALL, FEW);
}

#[test]
fn no_self_intersections() {
    assert_proportional("simplify IN OUT.ply --ratio 50% --no-self-intersections", &ALL, FEW);
}
