//! The kind and the details of an output: chosen by the file's name, told in detail by `--format`.

use crate::ply::header::Encoding;
use std::path::Path;
use stonecut_mesh::property::Scalar;
use stonecut_system::error::{Error, Result};

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
    /// For browsers: positions of 16 bits an axis or floats, colours, normals, textures.
    Glb,
}

impl OutputKind {
    /// The name for people.
    pub fn name(self) -> &'static str {
        match self {
            OutputKind::Ply => "PLY",
            OutputKind::Stl => "STL",
            OutputKind::Obj => "OBJ",
            OutputKind::Glb => "GLB",
        }
    }

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
    /// The kind of file that `path` will be; PLY where neither its name nor the format says one.
    pub fn kind_of(&self, path: &Path) -> OutputKind {
        self.kind.or_else(|| OutputKind::of(path).ok()).unwrap_or(OutputKind::Ply)
    }

    /// The kind of file that `path` will be; refuses a name that says none, and words that do not fit the kind.
    pub fn check(&self, path: &Path) -> Result<OutputKind> {
        let kind = self.kind.map_or_else(|| OutputKind::of(path), Ok)?;
        let encoding = self.encoding.unwrap_or(Encoding::BinaryLittleEndian);
        let typed = self.coordinate.is_some() || self.index.is_some();
        let unfit = match kind {
            OutputKind::Ply => false,
            OutputKind::Stl | OutputKind::Obj => typed || encoding == Encoding::BinaryBigEndian,
            OutputKind::Glb => {
                let is_double = self.coordinate == Some(Scalar::F64);
                is_double || self.index.is_some() || encoding != Encoding::BinaryLittleEndian
            }
        };
        if unfit {
            return Err(Error::Usage(format!(
                "{}: --format asks for what only PLY can do (GLB has 'float' beside its 16 bits an axis)",
                path.display()
            )));
        }
        Ok(kind)
    }
}
