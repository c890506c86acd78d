//! OBJ out: text with positions, colours as MeshLab and Blender read them, normals and texture coordinates.
//!
//! Faces are grouped by name and material: with more than one, they are sorted before they are written. The library beside
//! the file is written by `io::materials`.

use crate::by_material::{ByMaterial, FaceLabel, LabelOf};
use crate::materials::TexturePlan;
use crate::names::{Name, is_name};
use crate::ply::writer::Shortest;
use crate::ply::{OutputHeader, TexturedTriangle};
use std::collections::HashMap;
use std::io::Write;
use stonecut_mesh::codec::TEXTURE_NAMES;
use stonecut_mesh::colours::ColourPlace;
use stonecut_mesh::property::{Scalar, read_scalar};
use stonecut_mesh::record::VertexSchema;
use stonecut_system::disk::folder_of;
use stonecut_system::error::Result;
use stonecut_system::pending_file::{PendingFile, Place};

/// Triangles whose texture coordinates are written once together.
const CHUNK: usize = 65_536;

/// Writes OBJ.
pub struct ObjWriter {
    out: PendingFile,
    schema: VertexSchema,
    colour: Option<ColourPlace>,
    /// White stands for no colour: the material's is seen.
    has_bare: bool,
    normal: Option<[(Scalar, usize); 3]>,
    /// Texture coordinates at vertices.
    texture: Option<[(Scalar, usize); 2]>,
    /// True if each corner has its own coordinates.
    corner_texture: bool,
    label_of: LabelOf,
    /// Names of materials by number.
    names: Vec<String>,
    /// Faces on their way into order, if there are several names or materials.
    sort: Option<ByMaterial>,
    chunk: TextChunk,
    n_coordinates: u64,
    vertices_left: u64,
    faces_left: u64,
}

/// Rows of faces that are written together, behind the coordinates that they name.
#[derive(Default)]
struct TextChunk {
    n_faces: usize,
    coordinates: Vec<u8>,
    faces: Vec<u8>,
    known: HashMap<[u32; 2], u64>,
    label: FaceLabel,
}

/// Type and place in the record of a property.
fn place(schema: &VertexSchema, name: &str) -> Option<(Scalar, usize)> {
    let i = schema.own_property(name)?;
    let before: usize = schema.properties[..i].iter().map(|p| p.scalar.bytes()).sum();
    Some((schema.properties[i].scalar, schema.position_bytes() + before))
}

/// Types and places in the record of three properties, if all are there.
pub fn find3(schema: &VertexSchema, names: [&str; 3]) -> Option<[(Scalar, usize); 3]> {
    let [a, b, c] = names.map(|name| place(schema, name));
    Some([a?, b?, c?])
}

/// Types and places of texture coordinates at vertices.
pub fn find_texture(schema: &VertexSchema) -> Option<[(Scalar, usize); 2]> {
    TEXTURE_NAMES.iter().find_map(|[s, t]| Some([place(schema, s)?, place(schema, t)?]))
}

impl ObjWriter {
    /// Creates the output and writes the comments.
    pub fn create(place: impl Into<Place>, header: OutputHeader) -> Result<Self> {
        let place = place.into();
        let folder = folder_of(&place.path).to_path_buf();
        let mut out = PendingFile::create(place)?;
        let comments = header.comments.iter().filter(|comment| !is_name(comment));
        for line in comments.chain(&header.obj_infos) {
            let line = line.replace(['\n', '\r'], " ");
            out.write(format!("# {line}\n").as_bytes())?;
        }
        let own = format!("# stonecut {} {}", env!("CARGO_PKG_VERSION"), header.settings);
        out.write(format!("{}\n", own.trim_end().replace(['\n', '\r'], " ")).as_bytes())?;
        let plan = header.textures.as_ref();
        if let Some(library) = plan.and_then(TexturePlan::library_name) {
            out.write(format!("mtllib {library}\n").as_bytes())?;
        }
        let names = plan.map_or_else(Vec::new, |plan| {
            plan.materials.list.iter().map(|material| material.name.clone()).collect()
        });
        let has_many = plan.is_some_and(TexturePlan::has_many);
        let label_of = LabelOf::new(&header);
        let has_many = has_many || label_of.has_many_names();
        let sort = has_many.then(|| ByMaterial::new(&folder, &header)).transpose()?;
        let corner_texture = header.faces.texture;
        let schema = header.schema;
        let (colour, normal) = (ColourPlace::find(&schema), find3(&schema, ["nx", "ny", "nz"]));
        let texture = find_texture(&schema).filter(|_| !corner_texture);
        Ok(ObjWriter {
            out,
            schema,
            colour,
            has_bare: header.n_bare > 0,
            normal,
            texture,
            corner_texture,
            label_of,
            names,
            sort,
            chunk: TextChunk::default(),
            n_coordinates: 0,
            vertices_left: header.n_vertices,
            faces_left: header.n_faces,
        })
    }

    /// Appends packed records of the header's schema.
    pub fn write_vertices(&mut self, records: &[u8]) -> Result<()> {
        let mut rows = Vec::new();
        for record in records.chunks_exact(self.schema.record_bytes()) {
            self.vertices_left =
                self.vertices_left.checked_sub(1).expect("no more vertices than promised");
            rows.push(b'v');
            // Writing into memory cannot fail.
            for value in self.schema.position(record) {
                let _ = match self.schema.coordinate {
                    Scalar::F64 => write!(rows, " {}", Shortest(value)),
                    _ => write!(rows, " {}", Shortest(value as f32)),
                };
            }
            let is_bare = |colour: &&ColourPlace| self.has_bare && colour.bytes(record) == [255; 3];
            let colour = self.colour.as_ref().filter(|colour| !is_bare(colour));
            for value in colour.iter().flat_map(|colour| colour.shares(record)) {
                let _ = write!(rows, " {}", Shortest(value as f32));
            }
            rows.push(b'\n');
            if let Some(texture) = self.texture {
                rows.extend_from_slice(b"vt");
                for (scalar, at) in texture {
                    let value = read_scalar(scalar, record, at) as f32;
                    let _ = write!(rows, " {}", Shortest(value));
                }
                rows.push(b'\n');
            }
            if let Some(normal) = self.normal {
                rows.extend_from_slice(b"vn");
                for (scalar, at) in normal {
                    let value = read_scalar(scalar, record, at) as f32;
                    let _ = write!(rows, " {}", Shortest(value));
                }
                rows.push(b'\n');
            }
            if rows.len() > 1 << 18 {
                self.out.write(&rows)?;
                rows.clear();
            }
        }
        self.out.write(&rows)
    }

    /// Appends triangles; all vertices must have been written.
    pub fn write_faces(&mut self, triangles: &[[u64; 3]]) -> Result<()> {
        let label = self.label_of.find_without_values();
        triangles.iter().try_for_each(|&corners| {
            self.take(label, &TexturedTriangle { corners, ..TexturedTriangle::default() })
        })
    }

    /// Appends triangles with texture coordinates at their corners, which stand before them, and labels; all
    /// vertices must have been written. Coordinates that are the same within 65,536 triangles are written once.
    pub fn write_full_faces(
        &mut self,
        triangles: &[TexturedTriangle],
        values: &[u8],
    ) -> Result<()> {
        for (i, triangle) in triangles.iter().enumerate() {
            self.take(self.label_of.find(values, i), triangle)?;
        }
        Ok(())
    }

    fn take(&mut self, label: u32, triangle: &TexturedTriangle) -> Result<()> {
        self.faces_left = self.faces_left.checked_sub(1).expect("no more faces than promised");
        match &mut self.sort {
            Some(sort) => sort.push(label, triangle),
            None => self.put(label, triangle),
        }
    }

    /// Puts a face into the chunk, with its names and that of its material where they change.
    fn put(&mut self, label: u32, triangle: &TexturedTriangle) -> Result<()> {
        let chunk = &mut self.chunk;
        let FaceLabel { name, material } = self.label_of.parts(label);
        let is_new = chunk.label.name != name;
        if is_new {
            let of = |name: Option<u32>| name.map(|name| &self.label_of.names[name as usize]);
            put_name(of(chunk.label.name), of(name), &mut chunk.faces);
        }
        // Some readers forget the material where an object begins.
        if chunk.label.material != material || (is_new && material.is_some()) {
            let name = material.and_then(|number| self.names.get(number as usize));
            // No line of OBJ ends a material, so a face without one after others names one that is not there.
            // Writing into memory cannot fail.
            let _ = writeln!(chunk.faces, "usemtl {}", name.map_or("none", String::as_str));
        }
        chunk.label = FaceLabel { name, material };
        if self.corner_texture {
            chunk.faces.push(b'f');
            for (corner, uv) in triangle.corners.iter().zip(triangle.texture) {
                let uv = uv.map(|x| if x.is_finite() { x } else { 0.0 });
                let next = self.n_coordinates + 1;
                let number = *chunk.known.entry(uv.map(f32::to_bits)).or_insert(next);
                if number == next {
                    self.n_coordinates = next;
                    let [u, v] = uv.map(Shortest);
                    let _ = writeln!(chunk.coordinates, "vt {u} {v}");
                }
                let v = corner + 1;
                let _ = match self.normal {
                    Some(_) => write!(chunk.faces, " {v}/{number}/{v}"),
                    None => write!(chunk.faces, " {v}/{number}"),
                };
            }
            chunk.faces.push(b'\n');
        } else {
            let [a, b, c] = triangle.corners.map(|v| v + 1);
            let _ = match (self.texture, self.normal) {
                (Some(_), Some(_)) => {
                    writeln!(chunk.faces, "f {a}/{a}/{a} {b}/{b}/{b} {c}/{c}/{c}")
                }
                (Some(_), None) => writeln!(chunk.faces, "f {a}/{a} {b}/{b} {c}/{c}"),
                (None, Some(_)) => writeln!(chunk.faces, "f {a}//{a} {b}//{b} {c}//{c}"),
                (None, None) => writeln!(chunk.faces, "f {a} {b} {c}"),
            };
        }
        chunk.n_faces += 1;
        if chunk.n_faces == CHUNK { self.flush() } else { Ok(()) }
    }

    fn flush(&mut self) -> Result<()> {
        let chunk = &mut self.chunk;
        self.out.write(&chunk.coordinates)?;
        self.out.write(&chunk.faces)?;
        (chunk.n_faces, chunk.known) = (0, HashMap::new());
        chunk.coordinates.clear();
        chunk.faces.clear();
        Ok(())
    }

    /// Syncs and renames; returns the file's length in bytes.
    pub fn finish(mut self) -> Result<u64> {
        assert!(self.vertices_left == 0 && self.faces_left == 0, "as many rows as promised");
        if let Some(sort) = self.sort.take() {
            sort.drain(|label, triangle| self.put(label, triangle))?;
        }
        self.flush()?;
        self.out.finish()
    }
}

/// Writes the lines that name the faces to come: an object ends the group before it.
fn put_name(old: Option<&Name>, new: Option<&Name>, rows: &mut Vec<u8>) {
    let none = Name::default();
    let (old, new) = (old.unwrap_or(&none), new.unwrap_or(&none));
    let ends_group = new.group.is_empty() && !old.group.is_empty();
    let is_other = old.object != new.object || ends_group;
    // A line that ends in a backslash goes on in the next.
    let shown = |text: &str| text.trim_end_matches('\\').to_owned();
    // Writing into memory cannot fail.
    if is_other {
        let _ = writeln!(rows, "o {}", shown(&new.object));
    }
    if !new.group.is_empty() && (is_other || old.group != new.group) {
        let _ = writeln!(rows, "g {}", shown(&new.group));
    }
}
