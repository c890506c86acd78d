//! What is fuzzed: every reader, from bytes to the last block, strict and with `skip_bad`.
//!
//! Used by the targets of cargo-fuzz and, with a seeded generator, by `tests/formats/fuzz.rs`. A target
//! may return errors; it must not panic, hang or take more memory than the bytes are worth.

#![allow(dead_code)]

use stonecut::io::ply::{FaceBlock, MeshSource, ReadOptions, VertexBlock};
use stonecut::io::{StageOptions, SurveyOptions, faces_to_vertices, survey_faces};

/// Everything that the rest of the program relies on once a file was opened.
fn read_all(source: &MeshSource) -> stonecut::Result<()> {
    let (mut vertices, mut faces) = (VertexBlock::default(), FaceBlock::default());
    let schema = source.schema();
    for i in 0..source.n_vertex_blocks() {
        source.read_vertices(i, &mut vertices)?;
        assert!(!vertices.records.is_empty());
        assert!(vertices.records.len().is_multiple_of(schema.record_bytes()));
        for record in vertices.records.chunks_exact(schema.record_bytes()) {
            assert!(schema.position(record).iter().all(|v| v.is_finite()), "finite positions");
        }
    }
    for i in 0..source.n_face_blocks() {
        source.read_faces(i, &mut faces)?;
        for t in &faces.triangles {
            assert!(t.iter().all(|&v| v < source.n_vertices()), "corners exist");
            assert!(t[0] != t[1] && t[1] != t[2] && t[2] != t[0], "three corners");
        }
    }
    let _ = (source.texture(), source.faults(), source.require_faces());
    let _ = (source.face_properties(), source.dropped_face_properties());
    Ok(())
}

/// What faces carry, moved to vertices.
fn move_faces(source: MeshSource, options: &StageOptions) -> stonecut::Result<()> {
    let (n_vertices, n_faces) = (source.n_vertices(), source.n_face_rows());
    let labels = ["quality".to_owned()];
    let survey = SurveyOptions { labels: &labels, ..SurveyOptions::default() };
    let carry = survey_faces(&source, &survey)?;
    let is_moved = carry.is_moved();
    let source = faces_to_vertices(source, carry, options)?;
    assert!(source.n_face_rows() <= n_faces && (is_moved || source.n_vertices() == n_vertices));
    read_all(&source)
}

fn ply(bytes: Vec<u8>, skip_bad: bool) {
    let read = ReadOptions { skip_bad, ..ReadOptions::default() };
    let mut options = StageOptions::new(std::env::temp_dir());
    (options.memory_bytes, options.read) = (3 << 20, read.clone());
    let _ = MeshSource::from_bytes("fuzz.ply", bytes, read).and_then(|source| {
        read_all(&source)?;
        move_faces(source, &options)
    });
}

fn staged(name: &str, bytes: &[u8], skip_bad: bool) {
    let mut options = StageOptions::new(std::env::temp_dir());
    options.memory_bytes = 3 << 20;
    options.read.skip_bad = skip_bad;
    let _ = MeshSource::staged_from_bytes(name, bytes.to_vec(), &options).and_then(|source| {
        read_all(&source)?;
        move_faces(source, &options)
    });
}

/// A header and whatever follows it.
pub fn header(bytes: &[u8]) {
    ply(bytes.to_vec(), bytes.len() % 2 == 1);
}

/// Elements of the dialects; the first byte of the input takes one, the second the strictness.
const ELEMENTS: [&str; 8] = [
    "element vertex 5\nproperty float x\nproperty float y\nproperty float z\nelement face 4\n\
     property list uchar int vertex_indices\n",
    "element vertex 4\nproperty double x\nproperty double y\nproperty double z\nproperty uchar red\n\
     element face 3\nproperty list int uint vertex_index\nproperty uchar red\n",
    "element camera 1\nproperty float a\nproperty list uchar short b\nelement vertex 3\n\
     property float x\nproperty list uchar float w\nproperty float y\nproperty float z\n\
     element face 3\nproperty int flags\nproperty list uchar int64 vertex_indices\n\
     property list uchar float texcoord\n",
    "element face 3\nproperty list ushort ushort vertex_indices\nelement vertex 6\n\
     property short x\nproperty int y\nproperty float16 z\nproperty uint64 label\n",
    "element vertex 70000\nproperty char x\nproperty char y\nproperty uchar z\nelement face 70000\n\
     property list uchar uchar vertex_indices\n",
    "element vertex 18446744073709551615\nproperty float x\nproperty float y\nproperty float z\n\
     element face 18446744073709551615\nproperty list uchar int vertex_indices\n",
    "element vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement edge 9\n\
     property int a\nelement face 9223372036854775808\nproperty list int64 uint64 vertex_indices\n",
    "element odd 3\nproperty list uint64 double a\nelement vertex 3\nproperty float x\n\
     property float y\nproperty float z\nelement face 2\nproperty list char char vertex_indices\n",
];

fn body(format: &str, bytes: &[u8]) {
    let [which, strict, rest @ ..] = bytes else { return };
    let elements = ELEMENTS[usize::from(*which) % ELEMENTS.len()];
    let mut file = format!("ply\nformat {format} 1.0\n{elements}end_header\n").into_bytes();
    file.extend_from_slice(rest);
    ply(file, strict % 2 == 1);
}

/// A binary body, least significant byte first.
pub fn body_little_endian(bytes: &[u8]) {
    body("binary_little_endian", bytes);
}

/// A binary body, most significant byte first.
pub fn body_big_endian(bytes: &[u8]) {
    body("binary_big_endian", bytes);
}

/// A body of text.
pub fn body_ascii(bytes: &[u8]) {
    body("ascii", bytes);
}

/// Triangle strips of several types, binary and ASCII.
pub fn tristrips(bytes: &[u8]) {
    let [which, strict, rest @ ..] = bytes else { return };
    let format = ["binary_little_endian", "binary_big_endian", "ascii"][usize::from(*which) % 3];
    let list = ["list int int", "list uchar short", "list uint64 uint", "list int int64"]
        [usize::from(*which / 3) % 4];
    let strips = [1u64, 3, u64::MAX][usize::from(*which / 12) % 3];
    let mut file = format!(
        "ply\nformat {format} 1.0\nelement vertex 9\nproperty char x\nproperty char y\n\
         property char z\nelement tristrips {strips}\nproperty {list} vertex_indices\n\
         property uchar more\nend_header\n"
    )
    .into_bytes();
    let vertices: &[u8] = if format == "ascii" {
        b"1 2 3 4 5 6 7 8 9 1 2 3 4 5 6 7 8 9 1 2 3 4 5 6 7 8 9\n"
    } else {
        &[7; 27]
    };
    file.extend_from_slice(vertices);
    file.extend_from_slice(rest);
    ply(file, strict % 2 == 1);
}

/// STL, binary and ASCII.
pub fn stl(bytes: &[u8]) {
    staged("fuzz.stl", bytes, bytes.len() % 2 == 1);
}

/// OBJ.
pub fn obj(bytes: &[u8]) {
    staged("fuzz.obj", bytes, bytes.len() % 2 == 1);
}

/// glTF, as text or as GLB.
pub fn gltf(bytes: &[u8]) {
    staged("fuzz.gltf", bytes, bytes.len() % 2 == 1);
}

/// Whatever it says it is: compressed, PLY, STL, OBJ.
pub fn compressed(bytes: &[u8]) {
    staged("standard input", bytes, bytes.len() % 2 == 1);
}
