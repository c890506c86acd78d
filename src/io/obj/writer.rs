//! OBJ out: text with positions, colours as MeshLab and Blender read them, normals and texture coordinates.
//!
//! Faces are grouped by material: with more than one, they are sorted before they are written. The library beside
//! the file is written by `io::materials`.

use crate::by_material::{ByMaterial, MaterialOf};
use crate::materials::TexturePlan;
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
    normal: Option<[(Scalar, usize); 3]>,
    /// Texture coordinates at vertices.
    texture: Option<[(Scalar, usize); 2]>,
    /// True if each corner has its own coordinates.
    corner_texture: bool,
    material_of: MaterialOf,
    /// Names of materials by number.
    names: Vec<String>,
    /// Faces on their way into order, if there are several materials.
    sort: Option<ByMaterial>,
    chunk: Chunk,
    n_coordinates: u64,
    vertices_left: u64,
    faces_left: u64,
}

/// Rows of faces that are written together, behind the coordinates that they name.
#[derive(Default)]
struct Chunk {
    n_faces: usize,
    coordinates: Vec<u8>,
    faces: Vec<u8>,
    known: HashMap<[u32; 2], u64>,
    material: Option<u32>,
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
        for line in header.comments.iter().chain(&header.obj_infos) {
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
        let material_of = MaterialOf::new(&header.faces, plan);
        let sort = has_many.then(|| ByMaterial::new(&folder, &header)).transpose()?;
        let corner_texture = header.faces.texture;
        let schema = header.schema;
        let (colour, normal) = (ColourPlace::find(&schema), find3(&schema, ["nx", "ny", "nz"]));
        let texture = find_texture(&schema).filter(|_| !corner_texture);
        Ok(ObjWriter {
            out,
            schema,
            colour,
            normal,
            texture,
            corner_texture,
            material_of,
            names,
            sort,
            chunk: Chunk::default(),
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
            for value in self.colour.iter().flat_map(|colour| colour.shares(record)) {
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
        let material = self.material_of.find_without_values();
        triangles.iter().try_for_each(|&corners| {
            self.take(material, &TexturedTriangle { corners, ..TexturedTriangle::default() })
        })
    }

    /// Appends triangles with texture coordinates at their corners, which stand before them, and materials; all
    /// vertices must have been written. Coordinates that are the same within 65,536 triangles are written once.
    pub fn write_full_faces(
        &mut self,
        triangles: &[TexturedTriangle],
        values: &[u8],
    ) -> Result<()> {
        for (i, triangle) in triangles.iter().enumerate() {
            let material = self.material_of.find(values, i);
            self.take(material, triangle)?;
        }
        Ok(())
    }

    fn take(&mut self, material: Option<u32>, triangle: &TexturedTriangle) -> Result<()> {
        self.faces_left = self.faces_left.checked_sub(1).expect("no more faces than promised");
        match &mut self.sort {
            Some(sort) => sort.push(material, triangle),
            None => self.put(material, triangle),
        }
    }

    /// Puts a face into the chunk, with the name of its material where that changes.
    fn put(&mut self, material: Option<u32>, triangle: &TexturedTriangle) -> Result<()> {
        let chunk = &mut self.chunk;
        if chunk.material != material {
            chunk.material = material;
            let name = material.and_then(|number| self.names.get(number as usize));
            // No line of OBJ ends a material, so a face without one after others names one that is not there.
            // Writing into memory cannot fail.
            let _ = writeln!(chunk.faces, "usemtl {}", name.map_or("none", String::as_str));
        }
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
            sort.drain(|material, triangle| self.put(material, triangle))?;
        }
        self.flush()?;
        self.out.finish()
    }
}
