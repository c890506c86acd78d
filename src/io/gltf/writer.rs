//! GLB out: one binary glTF 2.0 for browsers, with positions of 16 bits an axis, or floats.
//!
//! `KHR_mesh_quantization` allows integer positions; the node's scale and translation bring them back to
//! input units. One scale for all axes, so that nothing is distorted: the error is at most half of
//! 1/65535 of the longest side. Colours are linear light of 16 bits, normals signed bytes, padded to 4 bytes as the
//! format wants; beside tangents, normals have 16 bits. Faces with names, materials or texture coordinates are parted by these first (`split`), and
//! coordinates are floats; images follow the indices.

use super::document::{Frame, Positions, Primitive, VertexLayout, binary_bytes, describe};
use super::materials_out::OutImages;
use super::split::Split;
use crate::by_material::{FaceLabel, LabelOf};
use crate::materials::copy_bytes;
use crate::names::own_comments;
use crate::obj::{find_texture, find3};
use crate::ply::raw::{RawFile, Spool};
use crate::ply::{OutputHeader, TexturedTriangle};
use std::path::PathBuf;
use stonecut_mesh::colours::ColourPlace;
use stonecut_mesh::placing::offset_in;
use stonecut_mesh::property::{Scalar, read_scalar};
use stonecut_system::disk::folder_of;
use stonecut_system::error::{Error, Result};
use stonecut_system::pending_file::{PendingFile, Place};

/// Bytes of x, y, z as `u16` and padding.
pub(crate) const POSITION_BYTES: u64 = 8;
/// Bytes of x, y, z as floats.
pub(crate) const FLOAT_BYTES: u64 = 12;
/// Bytes of a colour: red, green, blue and alpha as `u16`.
pub(crate) const COLOUR_BYTES: u64 = 8;
/// Bytes of a normal.
pub(crate) const NORMAL_BYTES: u64 = 4;
/// Bytes of a tangent, and of a normal beside it.
const FINE_BYTES: u64 = 8;
/// Bytes of texture coordinates.
pub(crate) const TEXTURE_BYTES: u64 = 8;
/// Bytes of x, y, z as doubles while they are spooled.
pub(crate) const SPOOLED_BYTES: usize = 24;

/// Bytes of the file's own header and of those of its two chunks.
const FRAME_BYTES: u64 = 28;

/// Writes GLB; vertices are spooled until their bounds are known.
pub struct GlbWriter {
    out: PendingFile,
    header: OutputHeader,
    colour: Option<ColourPlace>,
    normal: Option<[(Scalar, usize); 3]>,
    /// Texture coordinates at vertices, where corners have none.
    texture: Option<[(Scalar, usize); 2]>,
    layout: VertexLayout,
    label_of: LabelOf,
    /// Faces on their way to primitives, if there is more to them than corners.
    split: Option<Split>,
    spool: Option<Spool>,
    least: [f64; 3],
    most: [f64; 3],
    vertices_left: u64,
    faces_left: u64,
}

impl GlbWriter {
    /// Creates the output with positions in steps; fails if it is empty or would exceed the 4 GiB that GLB can count.
    pub fn create(place: impl Into<Place>, header: OutputHeader) -> Result<Self> {
        Self::create_as(place, header, Positions::Steps)
    }

    /// The same with positions in a form of choice.
    pub fn create_as(
        place: impl Into<Place>,
        header: OutputHeader,
        positions: Positions,
    ) -> Result<Self> {
        let place = place.into();
        let folder = folder_of(&place.path).to_path_buf();
        let colour = ColourPlace::find(&header.schema);
        let normal = find3(&header.schema, ["nx", "ny", "nz"]);
        let plan = header.textures.as_ref();
        let images = plan.map_or(0, |plan| plan.bytes);
        let has_materials = plan.is_some_and(|plan| !plan.materials.list.is_empty());
        let own = find_texture(&header.schema).filter(|_| !header.faces.texture);
        let has_texture = own.is_some() || header.faces.texture;
        // Without normals there are no tangents, says glTF.
        let has_tangents = header.has_tangents && normal.is_some() && has_texture;
        let header = OutputHeader { has_tangents, ..header };
        let extras = [colour.is_some(), normal.is_some(), has_texture, has_tangents];
        let layout = vertex_layout(positions, extras);
        let bytes = header
            .n_vertices
            .checked_mul(layout.n_bytes)
            .and_then(|v| header.n_faces.checked_mul(12)?.checked_add(v)?.checked_add(images))
            .filter(|&bytes| fits(bytes));
        if bytes.is_none() {
            return Err(too_large(&header));
        }
        if header.n_vertices == 0 || header.n_faces == 0 {
            return Err(Error::Usage("a GLB file cannot be empty; write PLY".to_owned()));
        }
        let label_of = LabelOf::new(&header);
        let is_split = has_materials || has_texture || label_of.has_many_names();
        let split = is_split.then(|| Split::new(&folder, &header));
        let (vertices_left, faces_left) = (header.n_vertices, header.n_faces);
        Ok(GlbWriter {
            out: PendingFile::create(place)?,
            colour,
            normal,
            texture: own,
            layout,
            label_of,
            split,
            spool: Some(Spool::new(&folder)),
            least: [f64::MAX; 3],
            most: [f64::MIN; 3],
            vertices_left,
            faces_left,
            header,
        })
    }

    /// Appends packed records of the header's schema.
    pub fn write_vertices(&mut self, records: &[u8]) -> Result<()> {
        let Some(spool) = &mut self.spool else { return Ok(()) };
        for record in records.chunks_exact(self.header.schema.record_bytes()) {
            self.vertices_left =
                self.vertices_left.checked_sub(1).expect("no more vertices than promised");
            let mut row = Vec::with_capacity(SPOOLED_BYTES + 24);
            for (axis, value) in self.header.schema.position(record).into_iter().enumerate() {
                self.least[axis] = self.least[axis].min(value);
                self.most[axis] = self.most[axis].max(value);
                row.extend_from_slice(&value.to_le_bytes());
            }
            if let Some(colour) = self.colour {
                let words = colour.linear_words(record).map(u16::to_le_bytes);
                row.extend_from_slice(words.as_flattened());
            }
            if let Some(normal) = self.normal {
                let normal =
                    normal.map(|(scalar, at)| read_scalar(scalar, record, at).clamp(-1.0, 1.0));
                if self.layout.tangent_at.is_some() {
                    let steps = normal.map(|x| (x * 32767.0).round() as i16);
                    row.extend_from_slice(steps.map(i16::to_le_bytes).as_flattened());
                    row.extend_from_slice(&[0; 2]);
                } else {
                    row.extend(normal.map(|x| (x * 127.0).round() as i8 as u8));
                    row.push(0);
                }
            }
            if let Some(texture) = self.texture {
                let uv = texture.map(|(scalar, at)| read_scalar(scalar, record, at));
                // glTF has its origin at the top.
                for x in [uv[0], 1.0 - uv[1]] {
                    let x = if x.is_finite() { x as f32 } else { 0.0 };
                    row.extend_from_slice(&x.to_le_bytes());
                }
            }
            spool.write(&row)?;
        }
        Ok(())
    }

    /// Appends triangles; all vertices must have been written.
    pub fn write_faces(&mut self, triangles: &[[u64; 3]]) -> Result<()> {
        self.promise(triangles.len());
        if let Some(split) = &mut self.split {
            let label = self.label_of.find_without_values();
            return triangles.iter().try_for_each(|&corners| {
                split.push(label, &TexturedTriangle { corners, ..TexturedTriangle::default() })
            });
        }
        self.begin_faces()?;
        let mut rows = Vec::with_capacity(12 * triangles.len().min(16_384));
        for chunk in triangles.chunks(16_384) {
            rows.clear();
            for &vertex in chunk.as_flattened() {
                // Fewer than 2^32 vertices: `create` made sure of it.
                rows.extend_from_slice(&(vertex as u32).to_le_bytes());
            }
            self.out.write(&rows)?;
        }
        Ok(())
    }

    /// Appends triangles with texture coordinates at their corners, and labels; all vertices must have been written.
    pub fn write_full_faces(
        &mut self,
        triangles: &[TexturedTriangle],
        values: &[u8],
    ) -> Result<()> {
        if self.split.is_none() {
            let corners: Vec<[u64; 3]> = triangles.iter().map(|face| face.corners).collect();
            return self.write_faces(&corners);
        }
        self.promise(triangles.len());
        let Some(split) = &mut self.split else { return Ok(()) };
        for (i, face) in triangles.iter().enumerate() {
            split.push(self.label_of.find(values, i), face)?;
        }
        Ok(())
    }

    fn promise(&mut self, n: usize) {
        self.faces_left =
            self.faces_left.checked_sub(n as u64).expect("no more faces than promised");
    }

    /// Syncs and renames; returns the file's length in bytes.
    pub fn finish(mut self) -> Result<u64> {
        self.end_faces()?;
        self.out.finish()
    }

    /// The file as bytes, for a page that holds it; nothing appears under its name.
    pub fn finish_bytes(mut self) -> Result<Vec<u8>> {
        self.end_faces()?;
        self.out.into_bytes()
    }

    /// Writes what had to wait for the last face.
    fn end_faces(&mut self) -> Result<()> {
        if let Some(split) = self.split.take() {
            self.write_split(split)?;
        }
        assert!(self.faces_left == 0 && self.spool.is_none(), "as many rows as promised");
        Ok(())
    }

    /// Bytes of a vertex while it is spooled: what it will have but for the position, and coordinates if they are its.
    fn spooled_bytes(&self) -> usize {
        let colour = if self.colour.is_some() { COLOUR_BYTES } else { 0 };
        let normal = match (self.normal, self.layout.tangent_at) {
            (None, _) => 0,
            (Some(_), None) => NORMAL_BYTES,
            (Some(_), Some(_)) => FINE_BYTES,
        };
        let texture = if self.texture.is_some() { TEXTURE_BYTES } else { 0 };
        SPOOLED_BYTES + (colour + normal + texture) as usize
    }

    /// Length of a step of a coordinate.
    fn scale(&self) -> f64 {
        let extent = (0..3).map(|i| self.most[i] - self.least[i]).fold(0.0, f64::max);
        if extent > 0.0 { extent / 65_535.0 } else { 1.0 }
    }

    /// A position as it is stored.
    fn stored(&self, scale: f64, position: [f64; 3]) -> [f64; 3] {
        let from_least = [0, 1, 2].map(|axis| position[axis] - self.least[axis]);
        match self.layout.positions {
            Positions::Steps => from_least.map(|x| (x / scale).round()),
            Positions::Floats => from_least.map(|x| f64::from(x as f32)),
        }
    }

    /// Turns a spooled row into that of the file; returns its position as it is stored.
    fn row(&self, scale: f64, spooled: &[u8], out: &mut Vec<u8>) -> [f64; 3] {
        let position = [0, 1, 2].map(|axis| {
            let bytes = spooled[8 * axis..8 * axis + 8].try_into().expect("8 bytes");
            f64::from_le_bytes(bytes)
        });
        let stored = self.stored(scale, position);
        match self.layout.positions {
            Positions::Steps => {
                stored.iter().for_each(|x| out.extend_from_slice(&(*x as u16).to_le_bytes()));
                out.extend_from_slice(&[0, 0]);
            }
            Positions::Floats => {
                stored.iter().for_each(|x| out.extend_from_slice(&(*x as f32).to_le_bytes()));
            }
        }
        out.extend_from_slice(&spooled[SPOOLED_BYTES..]);
        stored
    }

    /// Writes everything up to the vertices; returns the images that follow the indices.
    fn begin(&mut self, primitives: &[Primitive]) -> Result<Option<OutImages>> {
        let materials = primitives.iter().filter_map(|primitive| primitive.label.material);
        let mut used: Vec<u32> = materials.collect();
        used.sort_unstable();
        used.dedup();
        let images = self.header.textures.as_ref().map(|plan| OutImages::new(plan, used));
        let total = binary_bytes(self.layout, primitives, images.as_ref());
        if !fits(total) {
            return Err(too_large(&self.header));
        }
        let generator = format!("stonecut {} {}", env!("CARGO_PKG_VERSION"), self.header.settings);
        let frame = Frame {
            generator: generator.trim_end().to_owned(),
            least: self.least,
            scale: self.scale(),
            offset: offset_in(&self.header.comments),
            textures: self.header.textures.as_ref().zip(images.as_ref()),
            names: &self.label_of.names,
            comments: own_comments(&self.header.comments, &self.header.obj_infos),
        };
        let mut text = describe(self.layout, primitives, &frame).into_bytes();
        text.resize(text.len().next_multiple_of(4), b' ');
        if text.len() as u64 + total + FRAME_BYTES > u64::from(u32::MAX) {
            return Err(too_large(&self.header));
        }
        self.out.write(b"glTF")?;
        for word in [2, (FRAME_BYTES + text.len() as u64 + total) as u32, text.len() as u32] {
            self.out.write(&word.to_le_bytes())?;
        }
        self.out.write(b"JSON")?;
        self.out.write(&text)?;
        self.out.write(&(total as u32).to_le_bytes())?;
        self.out.write(b"BIN\0")?;
        Ok(images)
    }

    /// The vertices as they were spooled, once.
    fn spooled(&mut self) -> Result<Option<RawFile>> {
        let Some(spool) = self.spool.take() else { return Ok(None) };
        assert!(self.vertices_left == 0, "all vertices come before the first face");
        let name: PathBuf = self.out.target().to_path_buf();
        spool.finish(&name).map(Some)
    }

    /// Writes everything up to the indices, once; all faces are one primitive.
    fn begin_faces(&mut self) -> Result<()> {
        let Some(file) = self.spooled()? else { return Ok(()) };
        let scale = self.scale();
        let high = self.stored(scale, self.most);
        let (n_vertices, n_corners) = (self.header.n_vertices, 3 * self.header.n_faces);
        let label = self.label_of.parts(self.label_of.find_without_values());
        let whole = Primitive { label, n_vertices, n_corners, low: [0.0; 3], high };
        self.begin(&[whole])?;
        let row_bytes = self.spooled_bytes();
        let mut rows = Vec::new();
        file.each_piece(0..file.len(), row_bytes * 16_384, |bytes| {
            rows.clear();
            for row in bytes.chunks_exact(row_bytes) {
                self.row(scale, row, &mut rows);
            }
            self.out.write(&rows)
        })
    }

    /// Writes a file of several primitives, with its images.
    fn write_split(&mut self, split: Split) -> Result<()> {
        let Some(file) = self.spooled()? else { return Ok(()) };
        let (scale, row_bytes) = (self.scale(), self.spooled_bytes());
        let plan = self.header.textures.as_ref().filter(|_| self.header.images_hide_colours);
        let has_image = |label: FaceLabel| {
            let number = label.material.and_then(|number| i32::try_from(number).ok());
            number.zip(plan).is_some_and(|(number, plan)| plan.materials.has_base(number))
        };
        let row = |label: FaceLabel, spooled: &[u8], out: &mut Vec<u8>| {
            let stored = self.row(scale, spooled, out);
            if let Some(at) = self.layout.colour_at.filter(|_| has_image(label)) {
                out[at as usize..(at + COLOUR_BYTES) as usize].fill(u8::MAX);
            }
            stored
        };
        let has_own_texture = self.texture.is_some() || self.layout.texture_at.is_none();
        let parts = split.finish(&self.label_of, (&file, row_bytes), has_own_texture, row)?;
        let images = self.begin(&parts.primitives)?;
        parts
            .vertices
            .each_piece(0..parts.vertices.len(), 1 << 20, |bytes| self.out.write(bytes))?;
        parts.indices.drain(|[_, _, _, number]| self.out.write(&number.to_le_bytes()))?;
        let (Some(plan), Some(images)) = (&self.header.textures, images) else { return Ok(()) };
        for &(image, n_bytes) in images.embedded() {
            let image = &plan.materials.images[image];
            let n = copy_bytes(&image.data, |bytes| self.out.write(bytes))?;
            if n != n_bytes {
                let what = format!("image '{}' was changed during the run", image.name);
                return Err(Error::bad_input(self.out.target(), what));
            }
            let padding = n.next_multiple_of(4) - n;
            self.out.write(&[0; 3][..padding as usize])?;
        }
        Ok(())
    }
}

fn vertex_layout(
    positions: Positions,
    [colour, normal, texture, tangent]: [bool; 4],
) -> VertexLayout {
    let mut n_bytes = match positions {
        Positions::Steps => POSITION_BYTES,
        Positions::Floats => FLOAT_BYTES,
    };
    let mut place = |has: bool, bytes: u64| {
        let at = has.then_some(n_bytes);
        n_bytes += if has { bytes } else { 0 };
        at
    };
    let colour_at = place(colour, COLOUR_BYTES);
    let normal_at = place(normal, if tangent { FINE_BYTES } else { NORMAL_BYTES });
    let texture_at = place(texture, TEXTURE_BYTES);
    let tangent_at = place(tangent, FINE_BYTES);
    VertexLayout { n_bytes, positions, colour_at, normal_at, texture_at, tangent_at }
}

/// Returns whether a binary chunk leaves room for its description.
fn fits(bytes: u64) -> bool {
    bytes.saturating_add(65_536) <= u64::from(u32::MAX)
}

fn too_large(header: &OutputHeader) -> Error {
    let images = header.textures.as_ref().map_or(0, |plan| plan.bytes);
    let with = match images {
        0 => String::new(),
        _ => format!(" and {} of images", stonecut_system::units::show_bytes(images)),
    };
    Error::Usage(format!(
        "the output would have {} vertices and {} triangles{with}, more than the 4 GiB of a GLB file; \
         simplify further, choose --textures link, or write PLY",
        header.n_vertices, header.n_faces
    ))
}
