//! The output of a run, whatever its format: chosen by the file's name, told in detail by `--format`.

use super::glb::GlbWriter;
use super::obj::ObjWriter;
use super::stl::StlWriter;
use crate::error::{Error, Result};
use crate::io::ply::{Encoding, OutputHeader, Place, PlyFormat, PlyWriter, TexturedTriangle};
use crate::mesh::property::Scalar;
use std::path::Path;

/// Parsed `--format`: words joined by commas or colons, in any order.
///
/// `ascii`, `binary`, `binary_little_endian`, `binary_big_endian`; `float` or `double` coordinates; `int`
/// or `uint` indices; `ply`, `stl`, `obj`, `glb` where the file's name does not say it (standard output).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct OutputFormat {
    /// The kind of file; by its name if `None`.
    pub kind: Option<OutputKind>,
    /// Encoding of numbers; binary, least significant byte first, if `None`.
    pub encoding: Option<Encoding>,
    /// The type of coordinates; the input's if `None`.
    pub coordinate: Option<Scalar>,
    /// The type of indices; `int` as long as it suffices if `None`.
    pub index: Option<Scalar>,
}

/// The kinds of files that can be written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OutputKind {
    /// Everything a vertex carries, any precision.
    Ply,
    /// Loose triangles of floats.
    Stl,
    /// Text: positions, colours, normals, texture coordinates.
    Obj,
    /// For browsers: positions of 16 bits an axis, colours, normals.
    Glb,
}

impl OutputKind {
    /// The kind that the file's name asks for.
    pub fn of(path: &Path) -> Result<Self> {
        let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
        match extension.as_deref() {
            Some("ply") => Ok(OutputKind::Ply),
            Some("stl") => Ok(OutputKind::Stl),
            Some("obj") => Ok(OutputKind::Obj),
            Some("glb") => Ok(OutputKind::Glb),
            None if path == Path::new("-") => Ok(OutputKind::Ply),
            _ => Err(Error::Usage(format!(
                "'{}' ends in none of .ply, .stl, .obj, .glb; name it so, or say which with --format",
                path.display()
            ))),
        }
    }
}

impl std::str::FromStr for OutputFormat {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let mut format = OutputFormat::default();
        for word in text.split([',', ':']).map(str::trim).filter(|w| !w.is_empty()) {
            let twice = match word {
                "ply" => format.kind.replace(OutputKind::Ply).is_some(),
                "stl" => format.kind.replace(OutputKind::Stl).is_some(),
                "obj" => format.kind.replace(OutputKind::Obj).is_some(),
                "glb" => format.kind.replace(OutputKind::Glb).is_some(),
                "ascii" => format.encoding.replace(Encoding::Ascii).is_some(),
                "binary" | "binary_little_endian" => {
                    format.encoding.replace(Encoding::BinaryLittleEndian).is_some()
                }
                "binary_big_endian" => format.encoding.replace(Encoding::BinaryBigEndian).is_some(),
                "float" => format.coordinate.replace(Scalar::F32).is_some(),
                "double" => format.coordinate.replace(Scalar::F64).is_some(),
                "int" => format.index.replace(Scalar::I32).is_some(),
                "uint" => format.index.replace(Scalar::U32).is_some(),
                _ => {
                    return Err(format!(
                        "'{word}' is none of ascii, binary_little_endian, binary_big_endian, float, \
                         double, int, uint, ply, stl, obj, glb"
                    ));
                }
            };
            if twice {
                return Err(format!("'{word}' contradicts an earlier word"));
            }
        }
        Ok(format)
    }
}

impl OutputFormat {
    /// The kind of file that `path` will be; refuses a name that says none, and words that do not fit the kind.
    pub fn check(&self, path: &Path) -> Result<OutputKind> {
        let kind = self.kind.map_or_else(|| OutputKind::of(path), Ok)?;
        let encoding = self.encoding.unwrap_or(Encoding::BinaryLittleEndian);
        let typed = self.coordinate.is_some() || self.index.is_some();
        let unfit = match kind {
            OutputKind::Ply => false,
            OutputKind::Stl | OutputKind::Obj => typed || encoding == Encoding::BinaryBigEndian,
            OutputKind::Glb => typed || encoding != Encoding::BinaryLittleEndian,
        };
        if unfit {
            return Err(Error::Usage(format!(
                "{}: --format asks for what only PLY can do",
                path.display()
            )));
        }
        Ok(kind)
    }
}

/// Writes a mesh in any format: all vertices, then all faces; the file appears when it is finished.
pub enum MeshSink {
    /// See `PlyWriter`.
    Ply(Box<PlyWriter>),
    /// See `StlWriter`.
    Stl(Box<StlWriter>),
    /// See `ObjWriter`.
    Obj(Box<ObjWriter>),
    /// See `GlbWriter`.
    Glb(Box<GlbWriter>),
}

impl MeshSink {
    /// Creates the output under a temporary name in its folder.
    ///
    /// STL and GLB spool the positions, 12 to 48 bytes a vertex, to a nameless file in that folder.
    pub fn create(
        place: impl Into<Place>,
        header: OutputHeader,
        format: OutputFormat,
    ) -> Result<Self> {
        let place = place.into();
        let encoding = format.encoding.unwrap_or(Encoding::BinaryLittleEndian);
        match format.check(&place.path)? {
            OutputKind::Ply => {
                let ply =
                    PlyFormat { encoding, coordinate: format.coordinate, index: format.index };
                PlyWriter::create_as(place, header, ply).map(|w| MeshSink::Ply(Box::new(w)))
            }
            OutputKind::Stl => {
                StlWriter::create(place, header, encoding).map(|w| MeshSink::Stl(Box::new(w)))
            }
            OutputKind::Obj => ObjWriter::create(place, header).map(|w| MeshSink::Obj(Box::new(w))),
            OutputKind::Glb => GlbWriter::create(place, header).map(|w| MeshSink::Glb(Box::new(w))),
        }
    }

    /// Appends packed records of the header's schema.
    pub fn write_vertices(&mut self, records: &[u8]) -> Result<()> {
        match self {
            MeshSink::Ply(sink) => sink.write_vertices(records),
            MeshSink::Stl(sink) => sink.write_vertices(records),
            MeshSink::Obj(sink) => sink.write_vertices(records),
            MeshSink::Glb(sink) => sink.write_vertices(records),
        }
    }

    /// Appends triangles; all vertices must have been written.
    pub fn write_faces(&mut self, triangles: &[[u64; 3]]) -> Result<()> {
        match self {
            MeshSink::Ply(sink) => sink.write_faces(triangles),
            MeshSink::Stl(sink) => sink.write_faces(triangles),
            MeshSink::Obj(sink) => sink.write_faces(triangles),
            MeshSink::Glb(sink) => sink.write_faces(triangles),
        }
    }

    /// Appends triangles with what the header says of faces, `values` being their packed properties. PLY takes
    /// it all, OBJ texture and `texnumber`, the others nothing.
    pub fn write_full_faces(
        &mut self,
        triangles: &[TexturedTriangle],
        values: &[u8],
    ) -> Result<()> {
        match self {
            MeshSink::Ply(sink) => sink.write_full_faces(triangles, values),
            MeshSink::Obj(sink) => sink.write_full_faces(triangles, values),
            _ => self.write_faces(&triangles.iter().map(|t| t.corners).collect::<Vec<_>>()),
        }
    }

    /// The same for indices of 32 bits, which PLY takes as they are.
    pub fn write_faces_u32(&mut self, triangles: &[[u32; 3]]) -> Result<()> {
        match self {
            MeshSink::Ply(sink) => sink.write_faces_u32(triangles),
            other => {
                let wide: Vec<[u64; 3]> = triangles.iter().map(|t| t.map(u64::from)).collect();
                other.write_faces(&wide)
            }
        }
    }

    /// Syncs and renames; returns the file's length in bytes.
    pub fn finish(self) -> Result<u64> {
        match self {
            MeshSink::Ply(sink) => sink.finish(),
            MeshSink::Stl(sink) => sink.finish(),
            MeshSink::Obj(sink) => sink.finish(),
            MeshSink::Glb(sink) => sink.finish(),
        }
    }
}
