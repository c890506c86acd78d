//! Meshes into PLY files that appear whole or not at all.
//!
//! The header stands first, so the exact counts must be known before the first record; `finish` holds
//! what was written against them. The other formats are in `formats`.

use super::header::Encoding;
use super::textures::{self, Renumbered};
use crate::materials::{NUMBER, TexturePlan};
use crate::names::OBJECT;
use std::io::Write;
use stonecut_mesh::property::{Property, Scalar};
use stonecut_mesh::record::VertexSchema;
use stonecut_system::error::{Error, Result};
use stonecut_system::pending_file::{PendingFile, Place};

/// Above this many vertices corner indices are `uint`, not `int`.
const MAX_INT_VERTICES: u64 = 1 << 31;

/// Above this many vertices corner indices would need 8 bytes, which hardly any program reads.
const MAX_UINT_VERTICES: u64 = 1 << 32;

/// Content of the header of an output.
#[derive(Clone, Debug)]
pub struct OutputHeader {
    /// The layout of the vertex records.
    pub schema: VertexSchema,
    /// Exactly how many vertices will be written.
    pub n_vertices: u64,
    /// Exactly how many triangles will be written.
    pub n_faces: u64,
    /// `comment` lines of the input, kept.
    pub comments: Vec<String>,
    /// `obj_info` lines of the input, kept.
    pub obj_infos: Vec<String>,
    /// Properties of faces besides their corners.
    pub faces: FaceSchema,
    /// The settings of this run, for the line `comment stonecut <version> <settings>`.
    pub settings: String,
    /// Materials of the faces, by the number in their property `texnumber`.
    pub textures: Option<TexturePlan>,
    /// True if images hide the colours of vertices, as in PLY and OBJ; glTF multiplies the two.
    pub images_hide_colours: bool,
    /// Vertices of the input without a colour where others have one, which are white; 0 if there are none.
    pub n_bare: u64,
    /// True if corners have tangents, which only GLB holds; normals are then as precise.
    pub has_tangents: bool,
    /// Memory for sorting faces by material, in the formats that group them.
    pub sort_memory_bytes: usize,
}

/// Memory for sorting, unless a run has another budget.
const SORT_MEMORY_BYTES: usize = 16 << 20;

impl OutputHeader {
    /// A header without comments of an input.
    pub fn new(schema: VertexSchema, n_vertices: u64, n_faces: u64) -> Self {
        let (comments, obj_infos, settings) = (Vec::new(), Vec::new(), String::new());
        OutputHeader {
            schema,
            n_vertices,
            n_faces,
            comments,
            obj_infos,
            faces: FaceSchema::default(),
            settings,
            textures: None,
            images_hide_colours: false,
            n_bare: 0,
            has_tangents: false,
            sort_memory_bytes: SORT_MEMORY_BYTES,
        }
    }

    /// Settings as the line of the header has them.
    pub fn line_of<'a>(settings: impl IntoIterator<Item = (&'a String, &'a String)>) -> String {
        let settings = settings.into_iter().map(|(name, value)| format!("{name}={value}"));
        settings.collect::<Vec<_>>().join(" ")
    }

    /// The type of corner indices: `int`, above 2^31 vertices `uint`; above 2^32 there is none.
    pub fn index_type(&self) -> Result<Scalar> {
        match self.n_vertices {
            n if n <= MAX_INT_VERTICES => Ok(Scalar::I32),
            n if n <= MAX_UINT_VERTICES => Ok(Scalar::U32),
            n => Err(Error::Usage(format!(
                "the output would have {n} vertices; PLY files of more than {MAX_UINT_VERTICES} \
                 vertices need 8-byte indices, which hardly any program reads: simplify further"
            ))),
        }
    }

    /// The header's text, with the line that names this program and its settings.
    pub fn text(&self, encoding: Encoding, index: Scalar) -> String {
        let version = env!("CARGO_PKG_VERSION");
        let own = format!("stonecut {version} {}", one_line(&self.settings));
        self.text_signed(encoding, index, Some(own.trim_end()))
    }

    /// The header's text; staged files carry no program comment.
    pub fn text_signed(&self, encoding: Encoding, index: Scalar, own: Option<&str>) -> String {
        let mut text = format!("ply\nformat {} 1.0\n", encoding.name());
        // The lines of earlier runs stay too: they are the history of the data.
        let textures = self.textures.as_ref().map_or_else(Vec::new, textures::comments);
        let comments = self.comments.iter().chain(&textures).map(String::as_str);
        for comment in comments.chain(own) {
            text.push_str(&format!("comment {}\n", one_line(comment)));
        }
        for info in &self.obj_infos {
            text.push_str(&format!("obj_info {}\n", one_line(info)));
        }
        text.push_str(&format!("element vertex {}\n", self.n_vertices));
        let coordinate = type_name(self.schema.coordinate);
        for axis in ["x", "y", "z"] {
            text.push_str(&format!("property {coordinate} {axis}\n"));
        }
        for property in &self.schema.properties {
            text.push_str(&format!("property {} {}\n", type_name(property.scalar), property.name));
        }
        text.push_str(&format!(
            "element face {}\nproperty list uchar {} vertex_indices\n",
            self.n_faces,
            type_name(index)
        ));
        text.push_str(if self.faces.texture { "property list uchar float texcoord\n" } else { "" });
        for property in &self.faces.properties {
            text.push_str(&format!("property {} {}\n", type_name(property.scalar), property.name));
        }
        text.push_str("end_header\n");
        text
    }
}

/// The name that every reader knows; 64-bit integers have none, these are trimesh's.
pub fn type_name(scalar: Scalar) -> &'static str {
    match scalar {
        Scalar::I8 => "char",
        Scalar::U8 => "uchar",
        Scalar::I16 => "short",
        Scalar::U16 => "ushort",
        Scalar::I32 => "int",
        Scalar::U32 => "uint",
        Scalar::I64 => "int64",
        Scalar::U64 => "uint64",
        Scalar::F32 => "float",
        Scalar::F64 => "double",
    }
}

fn one_line(text: &str) -> String {
    text.replace(['\n', '\r'], " ")
}

/// Settings of a PLY file that is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PlyFormat {
    /// Encoding of numbers.
    pub encoding: Encoding,
    /// `F32` or `F64`; the input's type if `None`.
    pub coordinate: Option<Scalar>,
    /// `I32` or `U32`; what `OutputHeader::index_type` says if `None`.
    pub index: Option<Scalar>,
}

impl Default for PlyFormat {
    /// The one form that every program reads.
    fn default() -> Self {
        PlyFormat { encoding: Encoding::BinaryLittleEndian, coordinate: None, index: None }
    }
}

/// Writes a PLY file: all vertices, then all faces.
pub struct PlyWriter {
    out: PendingFile,
    /// Layout of the records that come in.
    schema: VertexSchema,
    /// Type of x, y and z in the file.
    coordinate: Scalar,
    encoding: Encoding,
    record_bytes: u64,
    n_vertices: u64,
    vertices_left: u64,
    faces_left: u64,
    faces: FaceSchema,
    numbers: Option<Renumbered>,
    rows: Vec<u8>,
}

/// Properties of faces besides their corners.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct FaceSchema {
    /// Texture coordinates at the corners.
    pub texture: bool,
    /// Scalar properties, in order.
    pub properties: Vec<Property>,
}

impl FaceSchema {
    /// Returns whether there is nothing.
    pub fn is_empty(&self) -> bool {
        !self.texture && self.properties.is_empty()
    }

    /// Type and place of the number of the material among a face's packed values.
    pub fn number_at(&self) -> Option<(Scalar, usize)> {
        self.place_of(NUMBER)
    }

    /// Returns whether faces have the number of a material or of a name.
    pub fn has_labels(&self) -> bool {
        [NUMBER, OBJECT].iter().any(|name| self.place_of(name).is_some())
    }

    /// Type and place of a property among a face's packed values.
    pub fn place_of(&self, name: &str) -> Option<(Scalar, usize)> {
        let i = self.properties.iter().position(|p| p.name == name)?;
        let before = self.properties[..i].iter().map(|p| p.scalar.bytes()).sum();
        Some((self.properties[i].scalar, before))
    }

    /// Bytes of a face's packed properties.
    pub fn value_bytes(&self) -> usize {
        self.properties.iter().map(|p| p.scalar.bytes()).sum()
    }
}

/// A triangle with texture coordinates at its corners.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TexturedTriangle {
    /// Corner ids.
    pub corners: [u64; 3],
    /// Two coordinates for each corner; only written if the header says so.
    pub texture: [[f32; 2]; 3],
    /// Tangents of the corners in steps of 1/32767, the last number 1 or -1 of these; only for GLB, if the header says so.
    pub tangents: [[i16; 4]; 3],
}

impl PlyWriter {
    /// Creates the output in the default format under a temporary name in its folder and writes the
    /// header.
    pub fn create(place: impl Into<Place>, header: OutputHeader) -> Result<Self> {
        Self::create_as(place, header, PlyFormat::default())
    }

    /// Creates the output in a format of choice.
    pub fn create_as(
        place: impl Into<Place>,
        mut header: OutputHeader,
        format: PlyFormat,
    ) -> Result<Self> {
        let needed = header.index_type()?;
        let index = format.index.unwrap_or(needed);
        if index == Scalar::I32 && needed != Scalar::I32 {
            return Err(Error::Usage(format!(
                "{} vertices need 'uint' indices; leave 'int' out of --format",
                header.n_vertices
            )));
        }
        let number_at = header.faces.number_at();
        let numbers = header.textures.as_ref().and_then(|plan| Renumbered::new(plan, number_at));
        let schema = header.schema.clone();
        header.schema.coordinate = format.coordinate.unwrap_or(schema.coordinate);
        let mut out = PendingFile::create(place)?;
        out.write(header.text(format.encoding, index).as_bytes())?;
        Ok(PlyWriter {
            out,
            record_bytes: schema.record_bytes() as u64,
            schema,
            coordinate: header.schema.coordinate,
            encoding: format.encoding,
            n_vertices: header.n_vertices,
            vertices_left: header.n_vertices,
            faces_left: header.n_faces,
            numbers,
            faces: header.faces,
            rows: Vec::new(),
        })
    }

    /// Appends packed records of the header's schema.
    pub fn write_vertices(&mut self, records: &[u8]) -> Result<()> {
        let n = records.len() as u64 / self.record_bytes;
        assert!(n * self.record_bytes == records.len() as u64, "whole records");
        assert!(n <= self.vertices_left, "no more vertices than the header says");
        self.vertices_left -= n;
        if self.encoding == Encoding::BinaryLittleEndian
            && self.coordinate == self.schema.coordinate
        {
            return self.out.write(records);
        }
        for chunk in records.chunks(16_384 * self.record_bytes as usize) {
            self.rows.clear();
            for record in chunk.chunks_exact(self.record_bytes as usize) {
                put_vertex(&self.schema, self.coordinate, self.encoding, record, &mut self.rows);
            }
            self.out.write(&self.rows)?;
        }
        Ok(())
    }

    /// Appends triangles; all vertices must have been written.
    pub fn write_faces(&mut self, triangles: &[[u64; 3]]) -> Result<()> {
        let n_vertices = self.n_vertices;
        self.write_rows(triangles, |t| {
            debug_assert!(t.iter().all(|&v| v < n_vertices), "corners exist");
            // Checked when the output was created: there are no more than 2^32 vertices.
            t.map(|v| v as u32)
        })
    }

    /// Appends triangles; all vertices must have been written.
    pub fn write_faces_u32(&mut self, triangles: &[[u32; 3]]) -> Result<()> {
        self.write_rows(triangles, |t| *t)
    }

    /// Appends triangles with what the header says of faces: `values` holds the packed properties of all.
    pub fn write_full_faces(
        &mut self,
        triangles: &[TexturedTriangle],
        values: &[u8],
    ) -> Result<()> {
        assert!(self.vertices_left == 0, "all vertices come before the first face");
        assert!(triangles.len() as u64 <= self.faces_left, "no more faces than the header says");
        let value_bytes = self.faces.value_bytes();
        assert!(values.len() == value_bytes * triangles.len(), "values for every face");
        self.faces_left -= triangles.len() as u64;
        let mut renumbered = Vec::new();
        let values = match &self.numbers {
            Some(numbers) => {
                renumbered.extend_from_slice(values);
                renumbered.chunks_exact_mut(value_bytes).for_each(|own| numbers.apply(own));
                &renumbered
            }
            None => values,
        };
        for (chunk, triangles) in triangles.chunks(16_384).enumerate() {
            self.rows.clear();
            let (rows, encoding) = (&mut self.rows, self.encoding);
            let mut put = |scalar: Scalar, bytes: &[u8], end: u8| match encoding {
                Encoding::Ascii => {
                    put_text(scalar, bytes, rows);
                    rows.push(end);
                }
                Encoding::BinaryLittleEndian => rows.extend_from_slice(bytes),
                Encoding::BinaryBigEndian => rows.extend(bytes.iter().rev()),
            };
            let end = |last: bool| if last { b'\n' } else { b' ' };
            let (texture, properties) = (self.faces.texture, &self.faces.properties);
            for (i, triangle) in triangles.iter().enumerate() {
                put(Scalar::U8, &[3], b' ');
                for (k, corner) in triangle.corners.into_iter().enumerate() {
                    // Checked when the output was created: there are no more than 2^32 vertices.
                    let last = k == 2 && self.faces.is_empty();
                    put(Scalar::U32, &(corner as u32).to_le_bytes(), end(last));
                }
                if texture {
                    put(Scalar::U8, &[6], b' ');
                    for (k, x) in triangle.texture.iter().flatten().enumerate() {
                        put(Scalar::F32, &x.to_le_bytes(), end(k == 5 && properties.is_empty()));
                    }
                }
                let mut at = (chunk * 16_384 + i) * value_bytes;
                for (k, property) in properties.iter().enumerate() {
                    let bytes = &values[at..at + property.scalar.bytes()];
                    put(property.scalar, bytes, end(k + 1 == properties.len()));
                    at += bytes.len();
                }
            }
            self.out.write(&self.rows)?;
        }
        Ok(())
    }

    fn write_rows<T>(&mut self, triangles: &[T], narrow: impl Fn(&T) -> [u32; 3]) -> Result<()> {
        assert!(self.vertices_left == 0, "all vertices come before the first face");
        assert!(triangles.len() as u64 <= self.faces_left, "no more faces than the header says");
        self.faces_left -= triangles.len() as u64;
        let mut rows = std::mem::take(&mut self.rows);
        for chunk in triangles.chunks(16_384) {
            rows.clear();
            for triangle in chunk {
                let [a, b, c] = narrow(triangle);
                match self.encoding {
                    Encoding::Ascii => {
                        let _ = writeln!(rows, "3 {a} {b} {c}");
                    }
                    Encoding::BinaryLittleEndian => {
                        put_row(&mut rows, [a, b, c].map(u32::to_le_bytes));
                    }
                    Encoding::BinaryBigEndian => {
                        put_row(&mut rows, [a, b, c].map(u32::to_be_bytes));
                    }
                }
            }
            self.out.write(&rows)?;
        }
        self.rows = rows;
        Ok(())
    }

    /// Syncs and renames; returns the file's length in bytes. Counts that differ from the header's are a
    /// fault of ours.
    pub fn finish(self) -> Result<u64> {
        assert!(self.vertices_left == 0 && self.faces_left == 0, "as many rows as the header says");
        self.out.finish()
    }
}

fn put_row(rows: &mut Vec<u8>, corners: [[u8; 4]; 3]) {
    let mut row = [3u8; 13];
    row[1..5].copy_from_slice(&corners[0]);
    row[5..9].copy_from_slice(&corners[1]);
    row[9..13].copy_from_slice(&corners[2]);
    rows.extend_from_slice(&row);
}

/// Appends one vertex in the given encoding, with coordinates of the given type.
pub(super) fn put_vertex(
    schema: &VertexSchema,
    coordinate: Scalar,
    encoding: Encoding,
    record: &[u8],
    rows: &mut Vec<u8>,
) {
    let mut put = |scalar: Scalar, bytes: &[u8]| match encoding {
        Encoding::Ascii => {
            put_text(scalar, bytes, rows);
            rows.push(b' ');
        }
        Encoding::BinaryLittleEndian => rows.extend_from_slice(bytes),
        Encoding::BinaryBigEndian => rows.extend(bytes.iter().rev()),
    };
    if coordinate == schema.coordinate {
        record[..schema.position_bytes()]
            .chunks_exact(coordinate.bytes())
            .for_each(|bytes| put(coordinate, bytes));
    } else {
        for value in schema.position(record) {
            match coordinate {
                Scalar::F64 => put(coordinate, &value.to_le_bytes()),
                _ => put(coordinate, &(value as f32).to_le_bytes()),
            }
        }
    }
    let mut at = schema.position_bytes();
    for property in &schema.properties {
        let end = at + property.scalar.bytes();
        put(property.scalar, &record[at..end]);
        at = end;
    }
    if encoding == Encoding::Ascii
        && let Some(last) = rows.last_mut()
    {
        *last = b'\n';
    }
}

/// The shortest text that reads back as the same number.
pub fn put_text(scalar: Scalar, little: &[u8], rows: &mut Vec<u8>) {
    let mut bytes = [0u8; 8];
    bytes[..little.len()].copy_from_slice(little);
    let unsigned = u64::from_le_bytes(bytes);
    // Writing into memory cannot fail.
    let _ = match scalar {
        Scalar::U8 | Scalar::U16 | Scalar::U32 | Scalar::U64 => write!(rows, "{unsigned}"),
        Scalar::I8 => write!(rows, "{}", unsigned as i8),
        Scalar::I16 => write!(rows, "{}", unsigned as i16),
        Scalar::I32 => write!(rows, "{}", unsigned as i32),
        Scalar::I64 => write!(rows, "{}", unsigned as i64),
        Scalar::F32 => write!(rows, "{}", Shortest(f32::from_bits(unsigned as u32))),
        Scalar::F64 => write!(rows, "{}", Shortest(f64::from_bits(unsigned))),
    };
}

/// Prints a float as C programs read it: an exponent where the digits would be many, lower-case names.
pub struct Shortest<T>(pub T);

impl<T: Copy + Into<f64> + std::fmt::Display + std::fmt::LowerExp> std::fmt::Display
    for Shortest<T>
{
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let value: f64 = self.0.into();
        let size = value.abs();
        if value.is_nan() {
            f.write_str("nan")
        } else if size == 0.0 || (1e-5..1e16).contains(&size) || size.is_infinite() {
            write!(f, "{}", self.0)
        } else {
            write!(f, "{:e}", self.0)
        }
    }
}
