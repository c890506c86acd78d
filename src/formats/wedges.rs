//! Texture coordinates at corners become vertices: one for every distinct pair of vertex and coordinates.
//!
//! A vertex on a seam of the texture is then several vertices in exactly the same place, which is what the
//! kernel knows how to keep together. Out of core: a sort by vertex, coordinates and image numbers the new
//! vertices, a sort by corner puts them back into faces. The staged mesh has the properties `texture_u`,
//! `texture_v` and, where the faces had one, `texnumber`.

use super::sort::{ExternalSort, halves, whole};
use super::stage::StageOptions;
use crate::error::{Error, Result};
use crate::ply::header::Encoding;
use crate::ply::raw::Spool;
use crate::ply::source::Staged;
use crate::ply::{BLOCK_ROWS, MeshSource, OutputHeader, VertexBlock};
use crate::schema::{Property, Scalar};

/// Names of the new properties.
const NAMES: [&str; 3] = ["texture_u", "texture_v", "texnumber"];

/// The same mesh with its texture coordinates at vertices; a source without any at corners as it is.
///
/// Memory: a third of the stage's for each sort; disk at peak 44 bytes a corner and the staged mesh.
pub fn at_vertices(source: MeshSource, options: &StageOptions) -> Result<MeshSource> {
    let Some(with_image) = source.corner_texture() else { return Ok(source) };
    if NAMES.iter().any(|name| source.schema().properties.iter().any(|p| p.name == *name)) {
        return Err(Error::bad_input(
            source.path(),
            "it has texture coordinates at vertices and at corners; drop the latter with --drop-texture",
        ));
    }
    let memory_bytes = (options.memory_bytes / 3) as usize;
    let mut corners = ExternalSort::<7>::new(&options.temp_dir, memory_bytes);
    let mut counts = Spool::new(&options.temp_dir);
    let (mut n_corners, mut n_faces) = (0u64, 0u64);
    let path = source.path().to_path_buf();
    let n_bad = source.each_textured_face(|face| {
        let Ok(count) = u8::try_from(face.corners.len()) else {
            let what = format!("a textured face has {} corners, 255 at most", face.corners.len());
            return Err(Error::bad_input(&path, what));
        };
        counts.write(&[count])?;
        n_faces += 1;
        for (&v, uv) in face.corners.iter().zip(&face.texture) {
            let ([v_high, v_low], [high, low]) = (halves(v), halves(n_corners));
            // Adding 0 turns -0 into 0.
            let [s, t] = uv.map(|x| (x + 0.0).to_bits());
            corners.push([v_high, v_low, s, t, face.image as u32, high, low])?;
            n_corners += 1;
        }
        Ok(())
    })?;

    let mut schema = source.schema().clone();
    let types = [Scalar::F32, Scalar::F32, Scalar::I32];
    let n_new = if with_image { 3 } else { 2 };
    for (name, scalar) in NAMES.into_iter().zip(types).take(n_new) {
        schema.properties.push(Property { name: name.to_owned(), scalar });
    }
    let mut vertices = Spool::new(&options.temp_dir);
    let mut by_corner = ExternalSort::<4>::new(&options.temp_dir, memory_bytes);
    let record_bytes = source.schema().record_bytes();
    let mut block = VertexBlock::default();
    let (mut n_vertices, mut last, mut loaded) = (0u64, None, None);
    corners.drain(|[v_high, v_low, s, t, image, high, low]| {
        if last != Some([v_high, v_low, s, t, image]) {
            last = Some([v_high, v_low, s, t, image]);
            let v = whole(v_high, v_low);
            let index = v / BLOCK_ROWS;
            if loaded != Some(index) {
                source.read_vertices(index, &mut block)?;
                loaded = Some(index);
            }
            let at = (v % BLOCK_ROWS) as usize * record_bytes;
            vertices.write(&block.records[at..at + record_bytes])?;
            for bits in &[s, t, image][..n_new] {
                vertices.write(&bits.to_le_bytes())?;
            }
            n_vertices += 1;
        }
        let [id_high, id_low] = halves(n_vertices - 1);
        by_corner.push([high, low, id_high, id_low])
    })?;

    let header = OutputHeader {
        comments: source.comments().to_vec(),
        obj_infos: source.obj_infos().to_vec(),
        ..OutputHeader::new(schema, n_vertices, n_faces)
    };
    let index = header.index_type()?;
    let mut out = Spool::new(&options.temp_dir);
    out.write(header.text_signed(Encoding::BinaryLittleEndian, index, None).as_bytes())?;
    let vertices = vertices.finish(&path)?;
    out.append_file(&vertices)?;
    drop(vertices);
    let counts = counts.finish(&path)?;
    let (mut sizes, mut next_face, mut left) = (Vec::new(), 0u64, 0u8);
    let mut row = Vec::new();
    let mut begin = |row: &mut Vec<u8>, left: &mut u8| -> Result<()> {
        // Faces without corners are rows of their own.
        while *left == 0 && next_face < n_faces {
            let at = (next_face % COUNTS) as usize;
            if at == 0 {
                sizes.resize((n_faces - next_face).min(COUNTS) as usize, 0);
                counts.read_exact_at(&mut sizes, next_face)?;
            }
            *left = sizes[at];
            row.push(*left);
            next_face += 1;
        }
        Ok(())
    };
    begin(&mut row, &mut left)?;
    by_corner.drain(|[_, _, _, id]| {
        row.extend_from_slice(&id.to_le_bytes());
        left -= 1;
        if left == 0 {
            out.write(&row)?;
            row.clear();
            begin(&mut row, &mut left)?;
        }
        Ok(())
    })?;
    out.write(&row)?;
    let bad_faces = source.faults().bad_faces + n_bad;
    let staged = Staged { bad_faces, wedges: Some(with_image), ..Staged::default() };
    let mut read = options.read.clone();
    read.temp_dir = Some(options.temp_dir.clone());
    MeshSource::from_staged(out.finish(&path)?, read, staged)
}

/// Counts of corners that are read at once.
const COUNTS: u64 = 1 << 16;
