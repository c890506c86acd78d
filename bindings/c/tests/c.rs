//! The C interface as C sees it: layouts, codes, bytes, threads, and the example compiled by `cc`.

#![allow(clippy::unwrap_used, clippy::panic)] // A test fails by panicking.
#![allow(clippy::undocumented_unsafe_blocks)] // All of them call C functions with arguments of the test's own.

#[path = "c/compiled.rs"]
mod compiled;
#[path = "c/faults.rs"]
mod faults;

use std::ffi::{CStr, CString, c_char, c_int, c_void};
use std::path::Path;
use std::ptr::{null, null_mut};
use stonecut_c::given::{Attribute, Mesh, RawOptions};
use stonecut_c::{
    ResultHandle, stonecut_init, stonecut_last_error, stonecut_measure, stonecut_result_free,
    stonecut_result_mesh, stonecut_result_number, stonecut_result_report, stonecut_run,
    stonecut_simplify, stonecut_version,
};

const F32: u32 = 9;
const F64: u32 = 10;

/// A plate of `n` by `n` squares with waves, in the unit square.
struct Plate {
    positions: Vec<[f32; 3]>,
    triangles: Vec<[u32; 3]>,
}

impl Plate {
    fn new(n: u32) -> Plate {
        let at = |i: u32| i as f32 / n as f32;
        let wave = |x: f32, y: f32| 0.05 * (9.0 * x).sin() * (7.0 * y).cos();
        let places = (0..(n + 1) * (n + 1)).map(|v| (at(v % (n + 1)), at(v / (n + 1))));
        let squares = (0..n * n).map(|i| i % n + i / n * (n + 1));
        Plate {
            positions: places.map(|(x, y)| [x, y, wave(x, y)]).collect(),
            triangles: squares
                .flat_map(|v| [[v, v + 1, v + n + 2], [v, v + n + 2, v + n + 1]])
                .collect(),
        }
    }

    fn mesh(&self) -> Mesh {
        Mesh {
            n_vertices: self.positions.len(),
            positions: self.positions.as_ptr().cast(),
            position_type: F32,
            n_triangles: self.triangles.len(),
            triangles: self.triangles.as_ptr().cast(),
            ..blank_mesh()
        }
    }
}

fn blank_mesh() -> Mesh {
    let mut mesh = std::mem::MaybeUninit::<Mesh>::uninit();
    unsafe {
        stonecut_init(mesh.as_mut_ptr().cast(), size_of::<Mesh>());
        mesh.assume_init()
    }
}

fn options() -> RawOptions {
    let mut options = std::mem::MaybeUninit::<RawOptions>::uninit();
    unsafe {
        stonecut_init(options.as_mut_ptr().cast(), size_of::<RawOptions>());
        options.assume_init()
    }
}

/// A result that frees itself.
struct Owned(ResultHandle);

impl Drop for Owned {
    fn drop(&mut self) {
        unsafe { stonecut_result_free(self.0) }
    }
}

impl Owned {
    fn mesh(&self) -> Mesh {
        unsafe { *stonecut_result_mesh(self.0) }
    }

    fn singles(&self) -> Vec<[f32; 3]> {
        let mesh = self.mesh();
        assert_eq!(mesh.position_type, F32);
        unsafe { std::slice::from_raw_parts(mesh.positions.cast(), mesh.n_vertices) }.to_vec()
    }

    fn triangles(&self) -> Vec<[u32; 3]> {
        let mesh = self.mesh();
        unsafe { std::slice::from_raw_parts(mesh.triangles.cast(), mesh.n_triangles) }.to_vec()
    }

    fn list(&self, first: *const u32, n: usize) -> Vec<u32> {
        unsafe { std::slice::from_raw_parts(first, n) }.to_vec()
    }

    fn number(&self, pointer: &str) -> f64 {
        let (pointer, mut number) = (CString::new(pointer).unwrap(), f64::NAN);
        let code = unsafe { stonecut_result_number(self.0, pointer.as_ptr(), &raw mut number) };
        assert_eq!(code, 0, "{}", message());
        number
    }
}

fn simplify(mesh: &Mesh, options: &RawOptions) -> (c_int, Owned) {
    let mut result = null_mut();
    let code = unsafe { stonecut_simplify(mesh, options, &raw mut result) };
    (code, Owned(result))
}

fn run(words: &str, options: *const RawOptions) -> (c_int, Owned) {
    let words: Vec<CString> = words.split(' ').map(|word| CString::new(word).unwrap()).collect();
    let words: Vec<*const c_char> = words.iter().map(|word| word.as_ptr()).collect();
    let mut result = null_mut();
    let code = unsafe { stonecut_run(words.as_ptr(), words.len(), options, &raw mut result) };
    (code, Owned(result))
}

fn message() -> String {
    let text = |text| unsafe { CStr::from_ptr(text) }.to_str().unwrap().to_owned();
    let error = unsafe { &*stonecut_last_error() };
    format!("{}: {}", text(error.name), text(error.message))
}

/// Says that a test is left out; `.ci/run` counts these lines at its end.
#[allow(clippy::print_stdout)] // A line of the test's own output.
fn skipped(why: &str) {
    use std::io::Write;
    println!("skipped: {why}");
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join("skipped.txt");
    let list = std::fs::OpenOptions::new().create(true).append(true).open(path);
    writeln!(list.unwrap(), "{why}").unwrap();
}

/// Vertices and triangles of a binary PLY file with float positions alone, as `stonecut` writes it.
fn read_ply(path: &Path) -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
    let bytes = std::fs::read(path).unwrap();
    let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    let header = String::from_utf8(bytes[..end].to_vec()).unwrap();
    let n = |what: &str| -> usize {
        let line = header.lines().find_map(|line| line.strip_prefix(what)).unwrap();
        line.trim().parse().unwrap()
    };
    let n_vertices = n("element vertex ");
    let (vertices, faces) = bytes[end..].split_at(12 * n_vertices);
    let word = |b: &[u8]| u32::from_le_bytes(b.try_into().unwrap());
    let three = |b: &[u8]| [word(&b[..4]), word(&b[4..8]), word(&b[8..12])];
    let triangles: Vec<[u32; 3]> = faces.chunks(13).map(|row| three(&row[1..])).collect();
    assert_eq!(triangles.len(), n("element face "));
    (vertices.chunks(12).map(|row| three(row).map(f32::from_bits)).collect(), triangles)
}

#[test]
fn arrays_give_the_mesh_of_the_command_to_the_bit() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).display().to_string();
    let (given, small) = (path("a.ply"), path("b.ply"));
    let (code, _) = run(&format!("synth statue {given} --triangles 20k"), null());
    assert_eq!(code, 0, "{}", message());
    let (positions, triangles) = read_ply(given.as_ref());
    let plate = Plate { positions, triangles };
    for ratio in [0.1, 0.01] {
        let wanted = RawOptions { ratio, ..options() };
        let (code, file) = run(&format!("simplify {given} {small} --force"), &wanted);
        assert_eq!(code, 0, "{}", message());
        let (code, arrays) = simplify(&plate.mesh(), &wanted);
        assert_eq!(code, 0, "{}", message());
        let (positions, triangles) = read_ply(small.as_ref());
        assert_eq!(file.number("/output/triangles"), triangles.len() as f64);
        let bits = |p: &[[f32; 3]]| p.iter().map(|p| p.map(f32::to_bits)).collect::<Vec<_>>();
        assert_eq!(bits(&arrays.singles()), bits(&positions));
        assert_eq!(arrays.triangles(), triangles);
        assert!(unsafe { stonecut_result_mesh(file.0) }.is_null());
    }
}

#[test]
fn doubles_strides_and_attributes_come_back_as_they_were_given() {
    #[repr(C)]
    #[derive(Clone, Copy)]
    struct Vertex {
        position: [f64; 3],
        heat: f32,
        color: [u8; 4],
    }
    let plate = Plate::new(60);
    let vertices: Vec<Vertex> = plate
        .positions
        .iter()
        .map(|p| Vertex {
            position: p.map(f64::from),
            heat: p[0],
            color: [(255.0 * p[0]) as u8, (255.0 * p[1]) as u8, 7, 255],
        })
        .collect();
    let ids: Vec<u64> = (0..vertices.len() as u64).map(|v| v + (1 << 40)).collect();
    let stride = size_of::<Vertex>();
    let attribute = |name: &'static CStr, values: *const c_void, stride, scalar, width| Attribute {
        name: name.as_ptr(),
        values,
        stride,
        scalar,
        width,
    };
    let attributes = [
        attribute(c"color", (&raw const vertices[0].color).cast(), stride, 2, 4),
        attribute(c"heat", (&raw const vertices[0].heat).cast(), stride, F32, 1),
        attribute(c"id", ids.as_ptr().cast(), 0, 8, 1),
    ];
    let mesh = Mesh {
        positions: vertices.as_ptr().cast(),
        position_type: F64,
        position_stride: stride,
        n_attributes: 3,
        attributes: attributes.as_ptr(),
        ..plate.mesh()
    };
    let words = [c"--weight=heat=1".as_ptr()];
    let wanted = RawOptions { triangles: 400, words: words.as_ptr(), n_words: 1, ..options() };
    let (code, result) = simplify(&mesh, &wanted);
    assert_eq!(code, 0, "{}", message());
    let out = result.mesh();
    assert_eq!((out.position_type, out.n_attributes, out.n_triangles), (F64, 3, 400));
    let n = out.n_vertices;
    let of = unsafe { std::slice::from_raw_parts(out.attributes, 3) };
    let positions: &[[f64; 3]] = unsafe { std::slice::from_raw_parts(out.positions.cast(), n) };
    let colors: &[[u8; 4]] = unsafe { std::slice::from_raw_parts(of[0].values.cast(), n) };
    let heat: &[f32] = unsafe { std::slice::from_raw_parts(of[1].values.cast(), n) };
    let back: &[u64] = unsafe { std::slice::from_raw_parts(of[2].values.cast(), n) };
    let source = result.list(out.source, n);
    assert!(source.is_sorted());
    for (v, &from) in source.iter().enumerate() {
        assert!((f64::from(heat[v]) - positions[v][0]).abs() < 0.02, "{v}");
        assert!((f64::from(colors[v][1]) / 255.0 - positions[v][1]).abs() < 0.05, "{v}");
        assert_eq!((colors[v][3], back[v]), (255, ids[from as usize]));
    }
    assert_eq!(unsafe { CStr::from_ptr(of[1].name) }, c"heat");
}

/// Three regions, one of them a disc:
///
/// ```text
/// +-----+-----+
/// |  10 | 20  |
/// |   ( 30 )  |
/// |     |     |
/// +-----+-----+
/// ```
#[test]
fn borders_of_labels_stay_and_every_triangle_has_its_label() {
    let plate = Plate::new(120);
    let middle = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|v| plate.positions[v as usize]);
        [0, 1].map(|i| (a[i] + b[i] + c[i]) / 3.0)
    };
    let label = |[x, y]: [f32; 2]| {
        let is_in_disc = (x - 0.5).hypot(y - 0.5) < 0.2;
        if is_in_disc { 30 } else { 10 + 10 * u32::from(x >= 0.5) }
    };
    let labels: Vec<u32> = plate.triangles.iter().map(|t| label(middle(t))).collect();
    let mesh = Mesh { labels: labels.as_ptr(), ..plate.mesh() };
    for cells in ["--cell-triangles=256k", "--cell-triangles=2k"] {
        let cells = CString::new(cells).unwrap();
        let words = [cells.as_ptr()];
        let wanted = RawOptions { triangles: 800, words: words.as_ptr(), n_words: 1, ..options() };
        let (code, result) = simplify(&mesh, &wanted);
        assert_eq!(code, 0, "{}", message());
        let (out, positions, triangles) = (result.mesh(), result.singles(), result.triangles());
        let found = result.list(out.labels, out.n_triangles);
        // Vertices were joined again: one piece without a border inside.
        let edges = |t: &[u32; 3]| [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]];
        let mut sides: Vec<[u32; 2]> = triangles.iter().flat_map(edges).collect();
        sides.iter_mut().for_each(|side| side.sort_unstable());
        sides.sort_unstable();
        let open = sides.chunk_by(|a, b| a == b).filter(|same| same.len() == 1);
        let at_rim = |v: u32| {
            let [x, y, _] = positions[v as usize];
            x.min(y) < 0.01 || x.max(y) > 0.99
        };
        for side in open {
            let ends = side[0].map(|v| positions[v as usize]);
            assert!(side[0].iter().all(|&v| at_rim(v)), "{ends:?}");
        }
        let source = result.list(out.source, out.n_vertices);
        assert!(source.windows(2).all(|pair| pair[0] < pair[1]));
        // The area of each label, seen from above.
        let area = |wanted: u32| -> f32 {
            let labelled = triangles.iter().zip(&found).filter(|(_, l)| **l == wanted);
            let doubled = labelled.map(|(t, _)| {
                let [a, b, c] = t.map(|v| positions[v as usize]);
                (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
            });
            doubled.sum::<f32>() / 2.0
        };
        let disc = std::f32::consts::PI * 0.04;
        for (label, wanted) in [(10, 0.5 - disc / 2.0), (20, 0.5 - disc / 2.0), (30, disc)] {
            assert!((area(label) - wanted).abs() < 0.004, "{label}: {} of {wanted}", area(label));
        }
    }
    // Another label on every triangle is noise.
    let noise: Vec<u32> = (0..labels.len() as u32).collect();
    let mesh = Mesh { labels: noise.as_ptr(), ..plate.mesh() };
    let (code, _) = simplify(&mesh, &RawOptions { triangles: 800, ..options() });
    assert_eq!(code, 2);
    assert!(message().contains("differ nearly everywhere"), "{}", message());
}

#[test]
fn meshes_and_files_are_measured() {
    let plate = Plate::new(40);
    let (code, small) = simplify(&plate.mesh(), &RawOptions { ratio: 0.1, ..options() });
    assert_eq!(code, 0, "{}", message());
    let wanted = RawOptions { samples: 20_000, ..options() };
    let mut apart = null_mut();
    let out = small.mesh();
    let code = unsafe { stonecut_measure(&plate.mesh(), &out, &wanted, &raw mut apart) };
    assert_eq!(code, 0, "{}", message());
    let apart = Owned(apart);
    let rms = apart.number("/relative_rms");
    assert!(rms > 0.0 && rms < 0.01, "{rms}");
    assert!(apart.number("/forward/max") >= apart.number("/forward/mean"));
    let report = unsafe { CStr::from_ptr(stonecut_result_report(apart.0)) }.to_str().unwrap();
    assert!(report.contains("\"relative_rms\""), "{report}");
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).display().to_string();
    let (a, b) = (path("a.ply"), path("b.ply"));
    assert_eq!(run(&format!("synth terrain {a} --triangles 5000"), null()).0, 0);
    assert_eq!(run(&format!("simplify {a} {b} --ratio 0.2"), null()).0, 0);
    let (code, measured) = run(&format!("measure {a} {b}"), &wanted);
    assert_eq!(code, 0, "{}", message());
    assert!(measured.number("/rms") > 0.0);
}
