//! Moves data of face corners to vertices: one vertex for each distinct pair of texture coordinates and region.
//!
//! A vertex on a seam of the texture, or on the border of a region, is then several vertices in exactly the
//! same place, which is what the kernel knows how to keep together. Out of core: a sort by vertex,
//! coordinates and region numbers the new vertices and mixes the values of their faces, a sort by corner puts
//! them back into faces. The staged mesh has the properties of `FacePropertyPlan::vertex_properties` behind its own.

use super::external_sort::{halves, whole};
use super::face_labels::{FaceLabels, SIDES};
use super::open_options::StageOptions;
use crate::ply::header::Encoding;
use crate::ply::raw::Spool;
use crate::ply::row_window::RowWindow;
use crate::ply::source::Staged;
use crate::ply::{Faults, MeshSource, VertexRecords};
use stonecut_mesh::face_properties::{FaceMixer, FacePropertyPlan, Regions};
use stonecut_mesh::property::Property;
use stonecut_mesh::record::VertexSchema;
use stonecut_system::error::{Error, Result};

/// Words of a corner besides the values of its face: vertex, coordinates, region, number.
const OWN_WORDS: usize = 7;

/// The same mesh with what `carry` says at vertices; where nothing is to move, as it is.
///
/// Memory: a third of the stage's for each sort; disk at peak 44 bytes a corner, what its face carries, and
/// the staged mesh.
pub fn faces_to_vertices(
    mut source: MeshSource,
    carry: FacePropertyPlan,
    options: &StageOptions,
) -> Result<MeshSource> {
    if !carry.is_moved() {
        source.note_carried(carry);
        return Ok(source);
    }
    let own = |name: &&str| source.schema().own_property(name).is_some();
    if let Some(name) = ["texture_u", "texture_v"].iter().find(|name| carry.texture && own(name)) {
        let what = format!(
            "has texture coordinates at vertices (property '{name}') and at corners; drop the latter with --drop-texture"
        );
        return Err(Error::bad_input(source.path(), what));
    }
    // Records of a sort have a width that the compiler knows.
    match FaceMixer::new(&carry).value_bytes().div_ceil(4) {
        0 => split::<OWN_WORDS>(source, carry, options),
        1 => split::<{ OWN_WORDS + 1 }>(source, carry, options),
        2 => split::<{ OWN_WORDS + 2 }>(source, carry, options),
        3..=4 => split::<{ OWN_WORDS + 4 }>(source, carry, options),
        5..=8 => split::<{ OWN_WORDS + 8 }>(source, carry, options),
        _ => split::<{ OWN_WORDS + 32 }>(source, carry, options),
    }
}

fn split<const N: usize>(
    source: MeshSource,
    carry: FacePropertyPlan,
    options: &StageOptions,
) -> Result<MeshSource> {
    let memory_bytes = (options.memory_bytes / 3) as usize;
    let mut corners = options.sort::<N>(memory_bytes);
    let mut counts = options.spool();
    let (mut n_corners, mut n_faces, mut most_corners) = (0u64, 0u64, 0);
    let path = source.path().to_path_buf();
    let mut regions = Regions::default();
    let (mut moved, mut region) = (Vec::new(), Vec::new());
    let walls = FaceLabels::named(&source, &SIDES).filter(|_| carry.turns_walls);
    let mut values = Vec::new();
    let n_bad = source.each_full_face(|_, face| {
        if face.is_bad {
            return Ok(());
        }
        // At most MAX_CORNERS, as the reader of rows has checked.
        let count = face.corners.len() as u32;
        counts.write(&count.to_le_bytes())?;
        most_corners = most_corners.max(count);
        n_faces += 1;
        values.clone_from(&face.values);
        let is_turned = walls.as_ref().is_some_and(|walls| walls.put_in_order(&mut values));
        region.clear();
        carry.pack_region(&values, &mut region);
        moved.clear();
        carry.pack(&values, &mut moved);
        let mut record = [0; N];
        record[4] = if region.is_empty() { 0 } else { regions.number(&region) as u32 };
        let place = bytemuck::cast_slice_mut::<u32, u8>(&mut record[OWN_WORDS..]);
        place[..moved.len()].copy_from_slice(&moved);
        for i in 0..face.corners.len() {
            // Begins with the same corner.
            let i = if is_turned && i > 0 { face.corners.len() - i } else { i };
            let (v, uv) = (face.corners[i], face.texture[i]);
            [record[0], record[1]] = halves(v);
            if carry.texture {
                // Adding 0 turns -0 into 0.
                [record[2], record[3]] = uv.map(|x| (x + 0.0).to_bits());
            }
            [record[5], record[6]] = halves(n_corners);
            corners.push(record)?;
            n_corners += 1;
        }
        Ok(())
    })?;

    let mut writer = Vertices {
        records: VertexRecords::new(&source),
        carry: &carry,
        mixer: FaceMixer::new(&carry),
        out: options.spool(),
        row: Vec::new(),
    };
    let mut by_corner = options.sort::<4>(memory_bytes);
    let (mut n_vertices, mut n_used, mut last) = (0u64, 0u64, None);
    corners.drain(|record| {
        let own: [u32; 5] = std::array::from_fn(|i| record[i]);
        let values = bytemuck::cast_slice(&record[OWN_WORDS..]);
        if last == Some(own) {
            writer.mixer.add(values);
        } else {
            if let Some(last) = last {
                writer.put(last)?;
            }
            writer.mixer.begin(values);
            n_used += u64::from(last.is_none_or(|last| last[..2] != own[..2]));
            last = Some(own);
            n_vertices += 1;
        }
        let [id_high, id_low] = halves(n_vertices - 1);
        by_corner.push([record[5], record[6], id_high, id_low])
    })?;
    if let Some(last) = last {
        writer.put(last)?;
    }
    let vertices = writer.out;

    let header = source.kept_header(staged_schema(source.schema(), &carry), n_vertices, n_faces);
    let index = header.index_type()?;
    let mut out = options.spool();
    let has_large = most_corners > u32::from(u8::MAX);
    let mut text = header.text_signed(Encoding::BinaryLittleEndian, index, None);
    if has_large {
        text = text.replace("property list uchar ", "property list uint ");
    }
    out.write(text.as_bytes())?;
    let vertices = vertices.finish(&path)?;
    out.append_file(&vertices)?;
    drop(vertices);
    let counts = counts.finish(&path)?;
    let (mut sizes, mut next_face, mut left) = (RowWindow::new(counts, 4), 0u64, 0u32);
    let mut row = Vec::new();
    let mut begin = |row: &mut Vec<u8>, left: &mut u32| -> Result<()> {
        // Faces without corners are separate rows.
        while *left == 0 && next_face < n_faces {
            *left = u32::from_le_bytes(sizes.get(next_face)?.try_into().expect("4 bytes"));
            match has_large {
                true => row.extend_from_slice(&left.to_le_bytes()),
                false => row.push(*left as u8),
            }
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
    let found = source.faults();
    let staged = Staged {
        given_bytes: Some(source.given_bytes()),
        faults: Faults { bad_faces: found.bad_faces + n_bad, ..found },
        unreferenced_vertices: source.n_vertices().saturating_sub(found.bad_vertices + n_used),
        faces: Some(carry),
        texture: None,
        ..source.into_staged()
    };
    let mut read = options.read.clone();
    read.temp_dir = Some(options.temp_dir.clone());
    MeshSource::from_staged(out.finish(&path)?, read, staged)
}

/// Layout of vertices in the staged file. In its header, the only place where names must differ, properties that come
/// from faces have others.
fn staged_schema(own: &VertexSchema, carry: &FacePropertyPlan) -> VertexSchema {
    let mut schema = own.clone();
    let mut prefix = "from_faces_".to_owned();
    while own.properties.iter().any(|p| p.name.starts_with(&prefix)) {
        prefix.push('_');
    }
    for (i, property) in carry.vertex_properties().iter().enumerate() {
        schema.properties.push(Property::new(&format!("{prefix}{i}"), property.scalar));
    }
    schema
}

/// Writes the new vertices, in the order of the old ones.
struct Vertices<'a> {
    records: VertexRecords<'a>,
    carry: &'a FacePropertyPlan,
    /// Holds the values of the faces of the vertex to come.
    mixer: FaceMixer,
    out: Spool,
    row: Vec<u8>,
}

impl Vertices<'_> {
    /// Takes the old vertex, and the coordinates and the region that part it from others.
    fn put(&mut self, [high, low, s, t, region]: [u32; 5]) -> Result<()> {
        let v = whole(high, low);
        self.row.clear();
        self.row.extend_from_slice(self.records.get(v)?);
        self.mixer.end(&mut self.row);
        let texture = [s, t].into_iter().filter(|_| self.carry.texture);
        let region = Some(region).filter(|_| self.carry.has_regions());
        texture.chain(region).for_each(|bits| self.row.extend_from_slice(&bits.to_le_bytes()));
        self.out.write(&self.row)
    }
}
