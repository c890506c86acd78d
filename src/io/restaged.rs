//! A mesh written again as a staged PLY, with other vertices: faces keep their order and all they carry.

use super::open_options::StageOptions;
use crate::ply::header::Encoding;
use crate::ply::raw::RawFile;
use crate::ply::source::Staged;
use crate::ply::{FaceBlock, FaceSchema, Faults, MeshSource, OutputHeader, TextureInfo};
use stonecut_mesh::record::VertexSchema;
use stonecut_system::error::Result;

/// Rows of faces as they stand in a staged file.
pub(crate) struct FaceRows {
    pub rows: RawFile,
    pub n_faces: u64,
    pub n_bad: u64,
}

/// Writes the faces with their new corners; `None` if one has too many corners for a row.
pub(crate) fn face_rows(
    source: &MeshSource,
    mut number: impl FnMut(u64) -> Result<u32>,
    options: &StageOptions,
) -> Result<Option<FaceRows>> {
    let has_texture = source.has_corner_texture();
    let mut out = options.spool();
    let (mut n_faces, mut n_bad, mut row) = (0u64, 0, Vec::new());
    if source.has_strips() {
        let mut block = FaceBlock::default();
        for index in 0..source.n_face_blocks() {
            source.read_faces(index, &mut block)?;
            n_bad += block.n_bad;
            for triangle in &block.triangles {
                row.clear();
                row.push(3);
                for &v in triangle {
                    row.extend_from_slice(&number(v)?.to_le_bytes());
                }
                out.write(&row)?;
                n_faces += 1;
            }
        }
    } else {
        let mut is_too_wide = false;
        n_bad = source.each_full_face(|_, face| {
            is_too_wide |= face.corners.len() > 127;
            if face.is_bad || is_too_wide {
                return Ok(());
            }
            row.clear();
            row.push(face.corners.len() as u8);
            for &v in &face.corners {
                row.extend_from_slice(&number(v)?.to_le_bytes());
            }
            if has_texture {
                row.push(2 * face.corners.len() as u8);
                for uv in &face.texture {
                    row.extend_from_slice(uv.map(f32::to_le_bytes).as_flattened());
                }
            }
            row.extend_from_slice(&face.values);
            n_faces += 1;
            out.write(&row)
        })?;
        if is_too_wide {
            return Ok(None);
        }
    }
    Ok(Some(FaceRows { rows: out.finish(source.path())?, n_faces, n_bad }))
}

/// The mesh with these vertices and faces instead; `note` adds to what is known of it.
pub(crate) fn restage(
    source: MeshSource,
    schema: VertexSchema,
    (n_vertices, vertices): (u64, RawFile),
    faces: FaceRows,
    options: &StageOptions,
    note: impl FnOnce(&mut Staged),
) -> Result<MeshSource> {
    let path = source.path().to_path_buf();
    let header = OutputHeader {
        comments: source.comments().to_vec(),
        obj_infos: source.obj_infos().to_vec(),
        faces: FaceSchema {
            texture: source.has_corner_texture(),
            properties: source.face_properties(),
        },
        ..OutputHeader::new(schema, n_vertices, faces.n_faces)
    };
    let mut out = options.spool();
    let index = header.index_type()?;
    out.write(header.text_signed(Encoding::BinaryLittleEndian, index, None).as_bytes())?;
    out.append_file(&vertices)?;
    drop(vertices);
    out.append_file(&faces.rows)?;
    let counts = source.faults();
    let texture = source.has_corner_texture().then(|| TextureInfo {
        files: source.texture().map_or_else(Vec::new, |texture| texture.files),
        property: "texcoord".to_owned(),
    });
    let mut staged = Staged {
        given_bytes: Some(source.given_bytes()),
        faults: Faults { bad_faces: counts.bad_faces + faces.n_bad, ..counts },
        texture,
        ..source.into_staged()
    };
    note(&mut staged);
    let mut read = options.read.clone();
    read.temp_dir = Some(options.temp_dir.clone());
    MeshSource::from_staged(out.finish(&path)?, read, staged)
}
