//! GLB out: one binary glTF 2.0 for browsers, with positions of 16 bits an axis.
//!
//! `KHR_mesh_quantization` allows integer positions; the node's scale and translation bring them back to
//! input units. One scale for all axes, so that nothing is distorted: the error is at most half of
//! 1/65535 of the longest side. Colours are bytes, normals signed bytes, all padded to 4 bytes as the
//! format wants.

use super::obj::{find_colour, find3, unit_colour};
use crate::error::{Error, Result};
use crate::io::ply::OutputHeader;
use crate::io::ply::raw::Spool;
use crate::mesh::property::{Scalar, read_scalar};
use crate::system::disk::folder_of;
use crate::system::pending_file::{PendingFile, Place};
use serde_json::{Value, json};

// Numbers that glTF 2.0 gives to types of components, uses of buffers and kinds of primitives.
const I8: u32 = 5120;
const U8: u32 = 5121;
const U16: u32 = 5123;
const U32: u32 = 5125;
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;
const TRIANGLES: u32 = 4;

/// Bytes of x, y, z as `u16` and padding.
pub(super) const POSITION_BYTES: u64 = 8;
/// Bytes of a colour or a normal.
pub(super) const EXTRA_BYTES: u64 = 4;
/// Bytes of x, y, z as doubles while they are spooled.
pub(super) const SPOOLED_BYTES: usize = 24;

/// Writes GLB; vertices are spooled until their bounds are known.
pub struct GlbWriter {
    out: PendingFile,
    header: OutputHeader,
    colour: Option<[(Scalar, usize); 3]>,
    normal: Option<[(Scalar, usize); 3]>,
    spool: Option<Spool>,
    least: [f64; 3],
    most: [f64; 3],
    vertices_left: u64,
    faces_left: u64,
}

impl GlbWriter {
    /// Creates the output; fails if it is empty or would exceed the 4 GiB that GLB can count.
    pub fn create(place: impl Into<Place>, header: OutputHeader) -> Result<Self> {
        let place = place.into();
        let path = place.path.clone();
        let colour = find_colour(&header.schema);
        let normal = find3(&header.schema, ["nx", "ny", "nz"]);
        let extras = u64::from(colour.is_some()) + u64::from(normal.is_some());
        let vertex_bytes = POSITION_BYTES + EXTRA_BYTES * extras;
        let bytes = header
            .n_vertices
            .checked_mul(vertex_bytes)
            .and_then(|v| header.n_faces.checked_mul(12)?.checked_add(v))
            .filter(|bytes| bytes.saturating_add(65_536) <= u64::from(u32::MAX));
        if bytes.is_none() {
            return Err(Error::Usage(format!(
                "the output would have {} vertices and {} triangles, more than the 4 GiB of a GLB file; \
                 simplify further or write PLY",
                header.n_vertices, header.n_faces
            )));
        }
        if header.n_vertices == 0 || header.n_faces == 0 {
            return Err(Error::Usage("a GLB file cannot be empty; write PLY".to_owned()));
        }
        let (vertices_left, faces_left) = (header.n_vertices, header.n_faces);
        Ok(GlbWriter {
            out: PendingFile::create(place)?,
            header,
            colour,
            normal,
            spool: Some(Spool::new(folder_of(&path))),
            least: [f64::MAX; 3],
            most: [f64::MIN; 3],
            vertices_left,
            faces_left,
        })
    }

    fn has_colour_and_normal(&self) -> [bool; 2] {
        [self.colour.is_some(), self.normal.is_some()]
    }

    /// Appends packed records of the header's schema.
    pub fn write_vertices(&mut self, records: &[u8]) -> Result<()> {
        let Some(spool) = &mut self.spool else { return Ok(()) };
        for record in records.chunks_exact(self.header.schema.record_bytes()) {
            self.vertices_left =
                self.vertices_left.checked_sub(1).expect("no more vertices than promised");
            let mut row = Vec::with_capacity(SPOOLED_BYTES + 8);
            for (axis, value) in self.header.schema.position(record).into_iter().enumerate() {
                self.least[axis] = self.least[axis].min(value);
                self.most[axis] = self.most[axis].max(value);
                row.extend_from_slice(&value.to_le_bytes());
            }
            if let Some(colour) = self.colour {
                row.extend(
                    colour.map(|(scalar, at)| {
                        (unit_colour(scalar, record, at) * 255.0).round() as u8
                    }),
                );
                row.push(255);
            }
            if let Some(normal) = self.normal {
                row.extend(normal.map(|(scalar, at)| {
                    (read_scalar(scalar, record, at).clamp(-1.0, 1.0) * 127.0).round() as i8 as u8
                }));
                row.push(0);
            }
            spool.write(&row)?;
        }
        Ok(())
    }

    /// Appends triangles; all vertices must have been written.
    pub fn write_faces(&mut self, triangles: &[[u64; 3]]) -> Result<()> {
        self.begin_faces()?;
        self.faces_left = self
            .faces_left
            .checked_sub(triangles.len() as u64)
            .expect("no more faces than promised");
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

    /// Syncs and renames; returns the file's length in bytes.
    pub fn finish(self) -> Result<u64> {
        assert!(self.faces_left == 0 && self.spool.is_none(), "as many rows as promised");
        self.out.finish()
    }

    /// The file as bytes, for a page that holds it; nothing appears under its name.
    pub fn finish_bytes(self) -> Result<Vec<u8>> {
        assert!(self.faces_left == 0 && self.spool.is_none(), "as many rows as promised");
        self.out.into_bytes()
    }

    /// Writes everything up to the indices, once.
    fn begin_faces(&mut self) -> Result<()> {
        let Some(spool) = self.spool.take() else { return Ok(()) };
        assert!(self.vertices_left == 0, "all vertices come before the first face");
        let extent = (0..3).map(|i| self.most[i] - self.least[i]).fold(0.0, f64::max);
        let scale = if extent > 0.0 { extent / 65_535.0 } else { 1.0 };
        let layout = ChunkLayout::new(&self.header, self.has_colour_and_normal());
        let mut text =
            layout.description(&self.header, self.least, self.most, scale).to_string().into_bytes();
        text.resize(text.len().next_multiple_of(4), b' ');
        let total = 12 + 8 + text.len() as u64 + 8 + layout.total;
        self.out.write(b"glTF")?;
        for word in [2, total as u32, text.len() as u32] {
            self.out.write(&word.to_le_bytes())?;
        }
        self.out.write(b"JSON")?;
        self.out.write(&text)?;
        self.out.write(&(layout.total as u32).to_le_bytes())?;
        self.out.write(b"BIN\0")?;

        let file = spool.finish(self.out.target())?;
        let row_bytes =
            SPOOLED_BYTES + 4 * self.has_colour_and_normal().iter().filter(|h| **h).count();
        let mut chunk = vec![0; row_bytes * 16_384];
        let mut at = 0;
        let mut rows = Vec::new();
        while at < file.len() {
            let n = (file.len() - at).min(chunk.len() as u64) as usize;
            file.read_exact_at(&mut chunk[..n], at)?;
            at += n as u64;
            rows.clear();
            for row in chunk[..n].chunks_exact(row_bytes) {
                for axis in 0..3 {
                    let bytes = row[8 * axis..8 * axis + 8].try_into().expect("8 bytes");
                    let steps = (f64::from_le_bytes(bytes) - self.least[axis]) / scale;
                    rows.extend_from_slice(&(steps.round() as u16).to_le_bytes());
                }
                rows.extend_from_slice(&[0, 0]);
                rows.extend_from_slice(&row[SPOOLED_BYTES..]);
            }
            self.out.write(&rows)?;
        }
        Ok(())
    }
}

/// Places of the parts of the binary chunk: vertices interleaved, then indices.
struct ChunkLayout {
    vertex_bytes: u64,
    colour_at: Option<u64>,
    normal_at: Option<u64>,
    indices_at: u64,
    total: u64,
}

impl ChunkLayout {
    fn new(header: &OutputHeader, [colour, normal]: [bool; 2]) -> Self {
        let colour_at = colour.then_some(POSITION_BYTES);
        let after_colour = POSITION_BYTES + if colour { EXTRA_BYTES } else { 0 };
        let normal_at = normal.then_some(after_colour);
        let vertex_bytes = after_colour + if normal { EXTRA_BYTES } else { 0 };
        let indices_at = vertex_bytes * header.n_vertices;
        let total = indices_at + 12 * header.n_faces;
        ChunkLayout { vertex_bytes, colour_at, normal_at, indices_at, total }
    }

    /// Describes the binary chunk as glTF 2.0 (Khronos, sections 3.6 and 5), in JSON.
    fn description(
        &self,
        header: &OutputHeader,
        least: [f64; 3],
        most: [f64; 3],
        scale: f64,
    ) -> Value {
        let (n_vertices, n_indices) = (header.n_vertices, 3 * header.n_faces);
        let steps = [0, 1, 2].map(|i| ((most[i] - least[i]) / scale).round() as u16);
        let mut accessors = vec![json!({
            "bufferView": 0, "byteOffset": 0, "count": n_vertices,
            "componentType": U16, "type": "VEC3", "min": [0, 0, 0], "max": steps,
        })];
        let mut attributes = json!({ "POSITION": 0 });
        let extras =
            [("COLOR_0", self.colour_at, U8, "VEC4"), ("NORMAL", self.normal_at, I8, "VEC3")];
        for (name, at, component, kind) in extras {
            let Some(at) = at else { continue };
            attributes[name] = accessors.len().into();
            accessors.push(json!({
                "bufferView": 0, "byteOffset": at, "count": n_vertices,
                "componentType": component, "type": kind, "normalized": true,
            }));
        }
        let indices = accessors.len();
        accessors.push(json!({
            "bufferView": 1, "byteOffset": 0, "count": n_indices,
            "componentType": U32, "type": "SCALAR",
        }));
        let side = [scale as f32; 3];
        let generator = format!("stonecut {} {}", env!("CARGO_PKG_VERSION"), header.settings);
        json!({
            "asset": { "version": "2.0", "generator": generator.trim_end() },
            "extensionsUsed": ["KHR_mesh_quantization"],
            "extensionsRequired": ["KHR_mesh_quantization"],
            "buffers": [{ "byteLength": self.total }],
            "bufferViews": [
                {
                    "buffer": 0, "byteOffset": 0, "byteLength": self.indices_at,
                    "byteStride": self.vertex_bytes, "target": ARRAY_BUFFER,
                },
                {
                    "buffer": 0, "byteOffset": self.indices_at, "byteLength": 4 * n_indices,
                    "target": ELEMENT_ARRAY_BUFFER,
                },
            ],
            "accessors": accessors,
            "meshes": [{
                "primitives": [{ "attributes": attributes, "indices": indices, "mode": TRIANGLES }],
            }],
            "nodes": [{
                "mesh": 0,
                "scale": side,
                "translation": least.map(|v| v as f32),
            }],
            "scenes": [{ "nodes": [0] }],
            "scene": 0,
        })
    }
}
