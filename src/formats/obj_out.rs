//! OBJ out: text with positions, colours as MeshLab and Blender read them, and normals.

use crate::error::Result;
use crate::ply::OutputHeader;
use crate::ply::writer::{PendingFile, Place, Shortest};
use crate::schema::{Scalar, VertexSchema, read_scalar};
use std::io::Write;

/// Writes OBJ.
pub struct ObjWriter {
    out: PendingFile,
    schema: VertexSchema,
    colour: Option<[(Scalar, usize); 3]>,
    normal: Option<[(Scalar, usize); 3]>,
    vertices_left: u64,
    faces_left: u64,
}

/// Types and places in the record of three properties, if all are there.
pub(crate) fn find3(schema: &VertexSchema, names: [&str; 3]) -> Option<[(Scalar, usize); 3]> {
    let mut at = schema.position_bytes();
    let mut found = [None; 3];
    for property in &schema.properties {
        if let Some(i) = names.iter().position(|n| *n == property.name) {
            found[i] = Some((property.scalar, at));
        }
        at += property.scalar.bytes();
    }
    match found {
        [Some(a), Some(b), Some(c)] => Some([a, b, c]),
        _ => None,
    }
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
        for line in header.comments.iter().chain(&header.obj_infos) {
            out.write(format!("# {}\n", line.replace(['\n', '\r'], " ")).as_bytes())?;
        }
        let own = format!("# stonecut {} {}", env!("CARGO_PKG_VERSION"), header.settings);
        out.write(format!("{}\n", own.trim_end().replace(['\n', '\r'], " ")).as_bytes())?;
        let schema = header.schema;
        let (colour, normal) = (find_colour(&schema), find3(&schema, ["nx", "ny", "nz"]));
        let (vertices_left, faces_left) = (header.n_vertices, header.n_faces);
        Ok(ObjWriter { out, schema, colour, normal, vertices_left, faces_left })
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
        let mut rows = Vec::new();
        self.faces_left = self
            .faces_left
            .checked_sub(triangles.len() as u64)
            .expect("no more faces than promised");
        for triangle in triangles {
            let [a, b, c] = triangle.map(|v| v + 1);
            let _ = match self.normal {
                Some(_) => writeln!(rows, "f {a}//{a} {b}//{b} {c}//{c}"),
                None => writeln!(rows, "f {a} {b} {c}"),
            };
            if rows.len() > 1 << 18 {
                self.out.write(&rows)?;
                rows.clear();
            }
        }
        self.out.write(&rows)
    }

    /// Syncs and renames; returns the file's length in bytes.
    pub fn finish(self) -> Result<u64> {
        assert!(self.vertices_left == 0 && self.faces_left == 0, "as many rows as promised");
        self.out.finish()
    }
}
