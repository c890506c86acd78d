//! OBJ out: text with positions, colours as MeshLab and Blender read them, normals and texture coordinates.
//!
//! Materials are named as the comments of an OBJ input name them (`texture`); libraries are not written.

use crate::error::Result;
use crate::io::ply::writer::Shortest;
use crate::io::ply::{OutputHeader, TexturedTriangle};
use crate::mesh::codec::TEXTURE_NAMES;
use crate::mesh::property::{Scalar, read_scalar};
use crate::mesh::record::VertexSchema;
use crate::system::pending_file::{PendingFile, Place};
use std::collections::HashMap;
use std::io::Write;

/// Triangles whose texture coordinates are written once together.
const CHUNK: usize = 65_536;

/// Writes OBJ.
pub struct ObjWriter {
    out: PendingFile,
    schema: VertexSchema,
    colour: Option<[(Scalar, usize); 3]>,
    normal: Option<[(Scalar, usize); 3]>,
    /// Texture coordinates at vertices.
    texture: Option<[(Scalar, usize); 2]>,
    /// True if each corner has its own coordinates.
    corner_texture: bool,
    /// Names of materials by number; faces have one if there are any.
    materials: Vec<String>,
    /// Type and place of the number of an image among a face's values, and bytes of all of them.
    image_at: Option<(Scalar, usize)>,
    value_bytes: usize,
    image: Option<i32>,
    n_coordinates: u64,
    vertices_left: u64,
    faces_left: u64,
}

/// Type and place in the record of a property.
fn place(schema: &VertexSchema, name: &str) -> Option<(Scalar, usize)> {
    let i = schema.own_property(name)?;
    let before: usize = schema.properties[..i].iter().map(|p| p.scalar.bytes()).sum();
    Some((schema.properties[i].scalar, schema.position_bytes() + before))
}

/// Types and places in the record of three properties, if all are there.
pub(crate) fn find3(schema: &VertexSchema, names: [&str; 3]) -> Option<[(Scalar, usize); 3]> {
    let [a, b, c] = names.map(|name| place(schema, name));
    Some([a?, b?, c?])
}

/// Types and places of texture coordinates at vertices.
pub(crate) fn find_texture(schema: &VertexSchema) -> Option<[(Scalar, usize); 2]> {
    TEXTURE_NAMES.iter().find_map(|[s, t]| Some([place(schema, s)?, place(schema, t)?]))
}

/// Properties that hold a colour, and what makes it go from 0 to 1.
pub(crate) fn find_colour(schema: &VertexSchema) -> Option<[(Scalar, usize); 3]> {
    find3(schema, ["red", "green", "blue"])
        .or_else(|| find3(schema, ["diffuse_red", "diffuse_green", "diffuse_blue"]))
        .or_else(|| find3(schema, ["r", "g", "b"]))
}

/// A colour component from 0 to 1.
pub(crate) fn unit_colour(scalar: Scalar, record: &[u8], at: usize) -> f64 {
    let full = match scalar {
        Scalar::U8 => 255.0,
        Scalar::U16 => 65_535.0,
        _ => 1.0,
    };
    (read_scalar(scalar, record, at) / full).clamp(0.0, 1.0)
}

impl ObjWriter {
    /// Creates the output and writes the comments.
    pub fn create(place: impl Into<Place>, header: OutputHeader) -> Result<Self> {
        let mut out = PendingFile::create(place)?;
        let mut materials = Vec::new();
        for line in header.comments.iter().chain(&header.obj_infos) {
            let line = line.replace(['\n', '\r'], " ");
            if let Some(name) = line.strip_prefix("usemtl ") {
                materials.push(name.to_owned());
            } else if line.starts_with("mtllib ") {
                out.write(format!("{line}\n").as_bytes())?;
            } else {
                out.write(format!("# {line}\n").as_bytes())?;
            }
        }
        let own = format!("# stonecut {} {}", env!("CARGO_PKG_VERSION"), header.settings);
        out.write(format!("{}\n", own.trim_end().replace(['\n', '\r'], " ")).as_bytes())?;
        let schema = header.schema;
        let (colour, normal) = (find_colour(&schema), find3(&schema, ["nx", "ny", "nz"]));
        let faces = &header.faces;
        let number = faces.properties.iter().position(|p| p.name == "texnumber");
        let image_at = number.map(|i| {
            let before = faces.properties[..i].iter().map(|p| p.scalar.bytes()).sum();
            (faces.properties[i].scalar, before)
        });
        let (corner_texture, value_bytes) = (faces.texture, faces.value_bytes());
        if image_at.is_some() && materials.is_empty() {
            let files = header.comments.iter().filter_map(|c| c.strip_prefix("TextureFile "));
            materials.extend(files.map(|name| name.trim().to_owned()));
        }
        let texture = find_texture(&schema).filter(|_| !corner_texture);
        Ok(ObjWriter {
            out,
            schema,
            colour,
            normal,
            texture,
            corner_texture,
            materials,
            image_at,
            value_bytes,
            image: None,
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
            for (scalar, at) in self.colour.iter().flatten() {
                let value = unit_colour(*scalar, record, *at);
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
        for chunk in triangles.chunks(CHUNK) {
            let mut rows = Vec::new();
            self.promise(chunk.len());
            chunk.iter().for_each(|&triangle| self.put_face(triangle, &mut rows));
            self.out.write(&rows)?;
        }
        Ok(())
    }

    fn promise(&mut self, n: usize) {
        self.faces_left =
            self.faces_left.checked_sub(n as u64).expect("no more faces than promised");
    }

    /// A face whose corners have no data besides the vertex.
    fn put_face(&self, triangle: [u64; 3], rows: &mut Vec<u8>) {
        let [a, b, c] = triangle.map(|v| v + 1);
        // Writing into memory cannot fail.
        let _ = match (self.texture, self.normal) {
            (Some(_), Some(_)) => writeln!(rows, "f {a}/{a}/{a} {b}/{b}/{b} {c}/{c}/{c}"),
            (Some(_), None) => writeln!(rows, "f {a}/{a} {b}/{b} {c}/{c}"),
            (None, Some(_)) => writeln!(rows, "f {a}//{a} {b}//{b} {c}//{c}"),
            (None, None) => writeln!(rows, "f {a} {b} {c}"),
        };
    }

    /// Appends triangles with texture coordinates at their corners, which stand before them, and the names of
    /// their materials; all vertices must have been written. Coordinates that are the same within 65,536
    /// triangles are written once.
    pub fn write_full_faces(
        &mut self,
        triangles: &[TexturedTriangle],
        values: &[u8],
    ) -> Result<()> {
        self.promise(triangles.len());
        for (start, chunk) in triangles.chunks(CHUNK).enumerate() {
            let (mut coordinates, mut faces) = (Vec::new(), Vec::new());
            let mut known = HashMap::new();
            for (i, triangle) in chunk.iter().enumerate() {
                let own = (start * CHUNK + i) * self.value_bytes;
                let image = match self.image_at {
                    // A number beyond the type's names no image, as one beyond the images does.
                    Some((scalar, at)) => Some(read_scalar(scalar, &values[own..], at) as i32),
                    None => self.corner_texture.then_some(0),
                };
                if self.image != image {
                    self.image = image;
                    let name = image.and_then(|image| usize::try_from(image).ok());
                    if let Some(name) = name.and_then(|number| self.materials.get(number)) {
                        let _ = writeln!(faces, "usemtl {name}");
                    }
                }
                if !self.corner_texture {
                    self.put_face(triangle.corners, &mut faces);
                    continue;
                }
                faces.push(b'f');
                for (corner, uv) in triangle.corners.iter().zip(triangle.texture) {
                    let next = self.n_coordinates + 1;
                    let number = *known.entry(uv.map(f32::to_bits)).or_insert(next);
                    if number == next {
                        self.n_coordinates = next;
                        let [u, v] = uv.map(Shortest);
                        let _ = writeln!(coordinates, "vt {u} {v}");
                    }
                    let v = corner + 1;
                    let _ = match self.normal {
                        Some(_) => write!(faces, " {v}/{number}/{v}"),
                        None => write!(faces, " {v}/{number}"),
                    };
                }
                faces.push(b'\n');
            }
            self.out.write(&coordinates)?;
            self.out.write(&faces)?;
        }
        Ok(())
    }

    /// Syncs and renames; returns the file's length in bytes.
    pub fn finish(self) -> Result<u64> {
        assert!(self.vertices_left == 0 && self.faces_left == 0, "as many rows as promised");
        self.out.finish()
    }
}
