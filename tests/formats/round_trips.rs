//! Mesh files in and out, through the public interface only.

#![allow(clippy::type_complexity)]

use stonecut::io::ply::{
    BLOCK_ROWS, FaceBlock, MeshSource, OutputHeader, PlyWriter, ReadOptions, VertexBlock,
};
use stonecut::mesh::property::{Property, Scalar};
use stonecut::mesh::record::VertexSchema;

type AnyResult = Result<(), Box<dyn std::error::Error>>;

/// A flat grid of `side` x `side` vertices with a colour each.
fn grid(side: u64) -> (VertexSchema, Vec<u8>, Vec<[u64; 3]>) {
    let schema = VertexSchema {
        coordinate: Scalar::F32,
        properties: vec![Property::new("red", Scalar::U8)],
    };
    let mut records = Vec::new();
    for i in 0..side * side {
        for value in [(i % side) as f32, (i / side) as f32, 0.5] {
            records.extend_from_slice(&value.to_le_bytes());
        }
        records.push(i as u8);
    }
    let mut faces = Vec::new();
    for y in 0..side - 1 {
        for x in 0..side - 1 {
            let a = y * side + x;
            faces.push([a, a + 1, a + side]);
            faces.push([a + 1, a + side + 1, a + side]);
        }
    }
    (schema, records, faces)
}

fn read_all(source: &MeshSource) -> stonecut::Result<(Vec<u8>, Vec<[u64; 3]>)> {
    let (mut records, mut triangles) = (Vec::new(), Vec::new());
    let (mut vertices, mut faces) = (VertexBlock::default(), FaceBlock::default());
    for i in 0..source.n_vertex_blocks() {
        source.read_vertices(i, &mut vertices)?;
        assert_eq!(vertices.first, i * BLOCK_ROWS);
        records.extend_from_slice(&vertices.records);
    }
    for i in 0..source.n_face_blocks() {
        source.read_faces(i, &mut faces)?;
        triangles.extend_from_slice(&faces.triangles);
    }
    Ok((records, triangles))
}

#[test]
fn what_is_written_is_read_back() -> AnyResult {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("grid.ply");
    let (schema, records, faces) = grid(300);
    let mut header = OutputHeader::new(schema.clone(), 90_000, faces.len() as u64);
    header.comments = vec!["made by\nhand".into()];
    header.obj_infos = vec!["num_cols 300".into()];
    header.settings = "simplify --ratio 1%".into();
    let mut writer = PlyWriter::create(&path, header)?;
    for part in records.chunks(13 * 1000) {
        writer.write_vertices(part)?;
    }
    for part in faces.chunks(777) {
        writer.write_faces(part)?;
    }
    assert!(!path.exists(), "nothing appears before finish");
    let bytes = writer.finish()?;
    assert_eq!(bytes, std::fs::metadata(&path)?.len());
    assert_eq!(std::fs::read_dir(folder.path())?.count(), 1);

    let source = MeshSource::open(&path)?;
    assert_eq!(source.schema(), &schema);
    assert_eq!((source.n_vertices(), source.n_face_rows()), (90_000, faces.len() as u64));
    assert_eq!(source.comments()[0], "made by hand");
    assert!(source.comments()[1].starts_with("stonecut "));
    assert_eq!(source.obj_infos(), ["num_cols 300"]);
    assert_eq!(read_all(&source)?, (records, faces));
    Ok(())
}

#[test]
fn an_output_that_is_not_finished_leaves_nothing_behind() -> AnyResult {
    let folder = tempfile::tempdir()?;
    let (schema, records, _) = grid(10);
    let header = OutputHeader::new(schema, 100, 162);
    let mut writer = PlyWriter::create(&folder.path().join("grid.ply"), header)?;
    writer.write_vertices(&records)?;
    drop(writer);
    assert_eq!(std::fs::read_dir(folder.path())?.count(), 0);
    Ok(())
}

const HEADER: &str = "ply\nformat binary_little_endian 1.0\nelement vertex 4\nproperty float x\n\
     property float y\nproperty float z\nelement face 2\nproperty list uchar int vertex_indices\n\
     end_header\n";

fn square(header: &str, z: f32, corner: i32) -> Vec<u8> {
    let mut bytes = header.as_bytes().to_vec();
    for p in [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, z], [0.0, 1.0, 0.0]] {
        p.iter().for_each(|v: &f32| bytes.extend_from_slice(&v.to_le_bytes()));
    }
    for t in [[0, 1, 2], [0, 2, corner]] {
        bytes.push(3);
        t.iter().for_each(|v: &i32| bytes.extend_from_slice(&v.to_le_bytes()));
    }
    bytes
}

fn failure(bytes: Vec<u8>) -> String {
    let read = MeshSource::from_bytes("bad.ply", bytes, ReadOptions::default())
        .and_then(|source| read_all(&source));
    match read {
        Ok(_) => panic!("the file was read"),
        Err(error) => {
            assert_eq!(error.exit_code(), 4);
            error.to_string()
        }
    }
}

#[test]
fn broken_files_are_refused_with_element_row_and_offset() {
    let body = HEADER.len();
    let cases: Vec<(Vec<u8>, String)> = vec![
        (square(HEADER, 0.0, 4), format!("element face, row 1, byte offset {}", body + 48 + 13)),
        (square(HEADER, 0.0, -1), format!("element face, row 1, byte offset {}", body + 48 + 13)),
        (square(HEADER, f32::NAN, 3), format!("element vertex, row 2, byte offset {}", body + 24)),
        (
            square(HEADER, f32::INFINITY, 3),
            format!("element vertex, row 2, byte offset {}", body + 24),
        ),
        (
            square(HEADER, 0.0, 3)[..body + 48 + 14].to_vec(),
            format!("element face, row 1, byte offset {}", body + 48 + 14),
        ),
        (
            square(HEADER, 0.0, 3)[..body + 30].to_vec(),
            format!("element vertex, row 2, byte offset {}", body + 30),
        ),
        (
            square(&HEADER.replace("vertex 4", "vertex 9223372036854775808"), 0.0, 3),
            "element vertex, row".to_owned(),
        ),
        (
            square(&HEADER.replace("face 2", "face 18446744073709551615"), 0.0, 3),
            "element face, row".to_owned(),
        ),
    ];
    for (bytes, wanted) in cases {
        let message = failure(bytes);
        assert!(message.starts_with("bad.ply: "), "{message}");
        assert!(message.contains(&wanted), "{message} lacks {wanted}");
    }
}

#[test]
fn faces_with_repeated_corners_are_left_out_and_counted() -> AnyResult {
    let bytes = square(HEADER, 0.0, 0);
    let source = MeshSource::from_bytes("flat.ply", bytes, ReadOptions::default())?;
    let mut block = FaceBlock::default();
    source.read_faces(0, &mut block)?;
    assert_eq!((block.triangles.as_slice(), block.n_degenerate), (&[[0, 1, 2]][..], 1));
    Ok(())
}
