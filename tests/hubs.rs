//! Vertices and edges of thousands of triangles, and needles: four times as many take at most six times the steps, in every
//! command.
//!
//! Steps are counted where loops go around a vertex or look for something (`mesh::steps`), never timed. The count belongs to the
//! process, so these tests have a program for themselves and run one after another. `STONECUT_ALL=1 cargo test --test hubs --
//! --nocapture` prints the table of docs/results/reliability.md instead.

#![allow(clippy::unwrap_used, clippy::panic)] // A test fails by panicking.
#![allow(clippy::print_stdout, clippy::print_stderr)] // The table.

use std::f64::consts::TAU;
use std::ffi::OsString;
use std::fmt::Write as _;
use std::io::Write;
use std::path::Path;
use std::sync::{Mutex, PoisonError};
use stonecut::Mesh;

/// Triangles of the smaller input, unless it takes more for a bound to hold, and how many times as many the larger one has.
const FEW: u32 = 1000;
const TIMES: u32 = 4;

/// Steps for each triangle that any vertex may take.
const FREE: u64 = 256;

/// Times the steps that the larger one may take.
const MOST: u64 = 6;

/// Steps for each triangle that short loops may hide (`mesh::steps`).
const UNSEEN: f64 = 64.0;

/// Sizes of the table.
const SIZES: [u32; 4] = [1000, 4000, 16_000, 64_000];

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

/// A strip of `n` needles.
///
/// ```text
///   ________
///  |/|/|/|/|
///  |/|/|/|/|
/// ```
fn needles(n: u32) -> Mesh {
    let n = n / 2;
    let at = |v: u32| [f64::from(v / 2) / f64::from(n), f64::from(v % 2), 0.0];
    let pair = |i: u32| [[2 * i, 2 * i + 2, 2 * i + 3], [2 * i, 2 * i + 3, 2 * i + 1]];
    Mesh::new((0..2 * n + 2).map(at).collect(), (0..n).flat_map(pair).collect())
}

/// Writes a mesh with an image, in four charts.
fn write_textured(folder: &Path, mesh: &Mesh) {
    let mut out = String::from("mtllib in.mtl\n");
    for [x, y, z] in &mesh.positions {
        writeln!(out, "v {x} {y} {z}").unwrap();
    }
    for side in [0.25, 0.75] {
        for [x, y, z] in &mesh.positions {
            writeln!(out, "vt {} {}", 0.2 * x + side, 0.2 * y + 0.05 * z + 0.5).unwrap();
        }
    }
    out += "usemtl a\n";
    let (n, n_vertices) = (mesh.triangles.len(), mesh.positions.len() as u32);
    for (i, t) in mesh.triangles.iter().enumerate() {
        let first = 1 + (4 * i / n) as u32 % 2 * n_vertices;
        let [a, b, c] = t.map(|v| format!("{}/{}", v + 1, v + first));
        writeln!(out, "f {a} {b} {c}").unwrap();
    }
    std::fs::write(folder.join("in.obj"), out).unwrap();
    std::fs::write(folder.join("in.mtl"), "newmtl a\nmap_Kd in.png\n").unwrap();
    let image = stonecut::render::Picture { width: 2, height: 2, rgb: [200, 90, 30].repeat(4) };
    std::fs::write(folder.join("in.png"), image.to_png().unwrap()).unwrap();
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

/// Steps that a command takes.
fn steps(command: &str, mesh: &Mesh) -> u64 {
    let folder = tempfile::tempdir().unwrap();
    write(&folder.path().join("in.ply"), mesh);
    if command.contains("TEXTURED") {
        write_textured(folder.path(), mesh);
    }
    let path = |name: &str| folder.path().join(name).display().to_string();
    let word = |word: &str| match word {
        "IN" => path("in.ply"),
        "TEXTURED" => path("in.obj"),
        "HALF" => (mesh.triangles.len() / 2).to_string(),
        _ if word.starts_with("OUT") => path(&word.replace("OUT", "out")),
        _ => word.to_owned(),
    };
    let mut n_before = 0;
    for part in command.split("; ") {
        n_before = stonecut::mesh::steps::taken();
        let words = part.split(' ').map(|w| OsString::from(word(w)));
        let all = std::iter::once("stonecut".into()).chain(words).chain(["-q".into()]);
        let code = stonecut::cli::main_from(all);
        assert!(code == 0 || code == 3, "{part}: exit code {code}");
    }
    stonecut::mesh::steps::taken() - n_before
}

const ALL: [&str; 6] = ["flat fan", "cone", "bicone", "touching cones", "book", "needles"];

fn shape(name: &str, n: u32) -> Mesh {
    match name {
        "flat fan" => cone(n, 0.0),
        "cone" => cone(n, 1.0),
        "bicone" => bicone(n),
        "touching cones" => touching(n),
        "book" => book(n),
        _ => needles(n),
    }
}

/// Fails unless a command takes steps nearly in proportion on some shapes; prints its row instead where all is asked for.
fn assert_proportional(command: &str, shapes: &[&str]) {
    if std::env::var_os("STONECUT_ALL").is_some() {
        return print_row(command);
    }
    assert_proportional_from(FEW, command, shapes);
}

fn assert_proportional_from(n: u32, command: &str, shapes: &[&str]) {
    let _one = ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner);
    let mut faults = String::new();
    for name in shapes {
        let few = steps(command, &shape(name, n));
        let many = steps(command, &shape(name, TIMES * n));
        println!("{command}, {name}: {few} steps, then {many}");
        if many > MOST * few.max(FREE * u64::from(n)) {
            writeln!(faults, "{command}, {name}: {few} steps, then {many}").unwrap();
        }
    }
    assert!(faults.is_empty(), "{faults}");
}

/// A test for each command that walks a mesh. IN, TEXTURED, OUT and names that begin with OUT are paths, HALF is half the
/// triangles; of several commands, the last one is counted.
macro_rules! commands {
    ($($name:ident: $command:literal, $shapes:expr;)*) => {
        $(#[test] fn $name() { assert_proportional($command, $shapes) })*
    };
}

/// Without needles: of these 1,000 are hardly any work for `tiles`, and each vertex looks at up to 4,096 others in `--pairs`, in proportion from 8,000 triangles on.
const HUBS: [&str; 5] = ["flat fan", "cone", "bicone", "touching cones", "book"];
commands! {
    collapse: "simplify IN OUT.ply --ratio 50%", &ALL;
    texture_kept: "simplify TEXTURED OUT.obj --ratio 50% --texture keep", &ALL;
    texture_baked: "simplify TEXTURED OUT.obj --ratio 50% --texture bake --bake-size 256", &ALL;
    pairs: "simplify IN OUT.ply --ratio 50% --pairs", &HUBS;
    optimize: "simplify IN OUT.ply --ratio 50% --optimize 1", &HUBS;
    no_self_intersections: "simplify IN OUT.ply --ratio 50% --no-self-intersections", &ALL;
    max_error: "simplify IN OUT.ply --ratio 50% --max-error 0.01", &ALL;
    decimate: "simplify IN OUT.ply --ratio 50% --method decimate", &ALL;
    cluster: "simplify IN OUT.ply --ratio 50% --method cluster", &ALL;
    retile: "simplify IN OUT.ply --ratio 50% --method retile", &ALL;
    progressive: "simplify IN OUT.ply --ratio 50% --progressive OUT.pm", &ALL;
    refine: "simplify IN OUT.ply --ratio 10% --progressive OUT.pm; refine OUT.pm OUT2.ply --triangles HALF", &ALL;
    tiles: "tiles IN OUT --tile-triangles 500", &HUBS;
    check: "info IN --check", &ALL;
    self_intersections: "info IN --check --self-intersections", &ALL;
    measure: "simplify IN OUT.ply --ratio 50%; measure IN OUT.ply --samples 10000", &ALL;
    certify: "simplify IN OUT.ply --ratio 50%; measure IN OUT.ply --samples 10000 --certify --tolerance 0.1", &ALL;
    convert: "convert IN OUT.glb --weld 1e-9", &ALL;
    convert_textured: "convert TEXTURED OUT.glb", &ALL;
    render: "render IN -o OUT.png --size 160x120", &ALL;
    // These take their time, whatever the mesh is. `compare` is not among them: it is `simplify` and `measure` in processes of their own, and `render`.
    tiles_baked: "tiles TEXTURED OUT --tile-triangles 500 --texture bake", &["cone"];
    extract: "tiles IN OUT --tile-triangles 500; extract OUT OUT.ply --triangles HALF", &["cone"];
    appearance: "simplify IN OUT.ply --ratio 50%; measure IN OUT.ply --samples 10000 --appearance --views 1", &["cone"];
    report: "simplify IN OUT.ply --ratio 50% --report OUT.json; report OUT.json -o OUT.html", &["cone"];
}

#[test]
fn tiles_of_needles() {
    assert_proportional_from(4 * FEW, "tiles IN OUT --tile-triangles 500", &["needles"]);
}

/// The kernel's rings of more than 4,096 triangles list those that are gone, too.
#[test]
fn a_vertex_of_many_thousands_keeps_its_texture() {
    let _one = ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner);
    steps("simplify TEXTURED OUT.obj --ratio 50% --texture keep", &cone(10_000, 1.0));
}

/// Prints a row of the table: the exponent of the steps from 1,000 to 64,000 triangles, and the steps for each triangle there. The
/// exponent is left out below `UNSEEN` steps a triangle, and counts from there on: shorter loops are not counted, so that counts
/// below say nothing about growth.
fn print_row(command: &str) {
    let _one = ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner);
    let mut row = format!("| `{command}` |");
    let [few, .., many] = SIZES;
    for name in ALL {
        let counted = SIZES.map(|n| steps(command, &shape(name, n)));
        eprintln!("{command}, {name}: {counted:?}");
        let [before, .., after] = counted;
        let each = after as f64 / f64::from(many);
        if each < UNSEEN {
            write!(row, " {} |", if each < 1.0 { "-".into() } else { format!("({each:.0})") })
                .unwrap();
            continue;
        }
        let before = (before as f64).max(UNSEEN * f64::from(few));
        let exponent = (after as f64 / before).ln() / f64::from(many / few).ln();
        write!(row, " {exponent:.1} ({each:.0}) |").unwrap();
    }
    println!("{row}");
}
