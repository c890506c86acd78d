//! Meshes into binary PLY files that appear whole or not at all.
//!
//! The header stands first, so the exact counts must be known before the first record; `finish` holds
//! what was written against them. Other encodings and formats build on this (`formats`).

use super::header::Encoding;
use crate::error::{Error, Result};
use crate::schema::{Scalar, VertexSchema};
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Bytes gathered before they go to the system; 1 MiB writes run at disk speed.
const BUFFER_BYTES: usize = 1 << 20;

/// Above this many vertices corner indices are `uint`, not `int`.
const MAX_INT_VERTICES: u64 = 1 << 31;

/// Above this many vertices corner indices would need 8 bytes, which hardly any program reads.
const MAX_UINT_VERTICES: u64 = 1 << 32;

/// What the header of an output says.
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
    /// The settings of this run, for the line `comment stonecut <version> <settings>`.
    pub settings: String,
}

impl OutputHeader {
    /// A header without comments of an input.
    pub fn new(schema: VertexSchema, n_vertices: u64, n_faces: u64) -> Self {
        let (comments, obj_infos, settings) = (Vec::new(), Vec::new(), String::new());
        OutputHeader { schema, n_vertices, n_faces, comments, obj_infos, settings }
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

    /// The header's text.
    pub(crate) fn text(&self, encoding: Encoding, index: Scalar) -> String {
        let mut text = format!("ply\nformat {} 1.0\n", encoding.name());
        let signature = "stonecut ";
        // The lines of earlier runs stay too: they are the history of the data.
        for comment in &self.comments {
            text.push_str(&format!("comment {}\n", one_line(comment)));
        }
        let version = env!("CARGO_PKG_VERSION");
        let own = format!("{signature}{version} {}", one_line(&self.settings));
        text.push_str(&format!("comment {}\n", own.trim_end()));
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
            "element face {}\nproperty list uchar {} vertex_indices\nend_header\n",
            self.n_faces,
            type_name(index)
        ));
        text
    }
}

/// The name that every reader knows; 64-bit integers have none, these are trimesh's.
pub(crate) fn type_name(scalar: Scalar) -> &'static str {
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

/// A file under a temporary name in its folder until `finish` renames it; dropped before, it is removed.
pub(crate) struct PendingFile {
    target: PathBuf,
    temporary: PathBuf,
    file: Option<File>,
    buffer: Vec<u8>,
    n_bytes: u64,
}

impl PendingFile {
    /// Creates `.NAME.PID.tmp` beside `target`.
    pub fn create(target: &Path) -> Result<Self> {
        let name = target.file_name().ok_or_else(|| {
            Error::Usage(format!("'{}' names no file to write", target.display()))
        })?;
        let mut hidden = std::ffi::OsString::from(".");
        hidden.push(name);
        hidden.push(format!(".{}.tmp", std::process::id()));
        let temporary = target.with_file_name(hidden);
        let file = File::options()
            .read(true)
            .write(true)
            .create(true)
            .truncate(true)
            .open(&temporary)
            .map_err(|e| Error::io(target, "cannot create the output", e))?;
        let buffer = Vec::with_capacity(BUFFER_BYTES);
        Ok(PendingFile {
            target: target.to_path_buf(),
            temporary,
            file: Some(file),
            buffer,
            n_bytes: 0,
        })
    }

    /// Appends bytes.
    pub fn write(&mut self, bytes: &[u8]) -> Result<()> {
        self.n_bytes += bytes.len() as u64;
        if self.buffer.len() + bytes.len() > BUFFER_BYTES {
            self.flush()?;
        }
        if bytes.len() >= BUFFER_BYTES {
            return write_all(&self.target, self.file.as_mut(), bytes);
        }
        self.buffer.extend_from_slice(bytes);
        Ok(())
    }

    /// Bytes written so far.
    pub fn n_bytes(&self) -> u64 {
        self.n_bytes
    }

    /// The name that the file will have.
    pub fn target(&self) -> &Path {
        &self.target
    }

    /// Hands what is buffered to the system.
    pub fn flush(&mut self) -> Result<()> {
        write_all(&self.target, self.file.as_mut(), &self.buffer)?;
        self.buffer.clear();
        Ok(())
    }

    /// Syncs, renames to the target and syncs the folder; returns the file's length.
    pub fn finish(mut self) -> Result<u64> {
        self.flush()?;
        if let Some(file) = self.file.take() {
            file.sync_all().map_err(|e| Error::io(&self.target, "cannot sync the output", e))?;
        }
        std::fs::rename(&self.temporary, &self.target)
            .map_err(|e| Error::io(&self.target, "cannot rename the output", e))?;
        self.temporary = PathBuf::new();
        let folder = match self.target.parent() {
            Some(folder) if !folder.as_os_str().is_empty() => folder,
            _ => Path::new("."),
        };
        // Some file systems cannot sync a folder; the file itself is safe by then.
        if let Ok(folder) = File::open(folder) {
            let _ = folder.sync_all();
        }
        Ok(self.n_bytes)
    }
}

impl Drop for PendingFile {
    fn drop(&mut self) {
        if !self.temporary.as_os_str().is_empty() {
            // Nothing can be done about a failure here, and the name tells what the file is.
            let _ = std::fs::remove_file(&self.temporary);
        }
    }
}

fn write_all(target: &Path, file: Option<&mut File>, bytes: &[u8]) -> Result<()> {
    match file {
        Some(file) => {
            file.write_all(bytes).map_err(|e| Error::io(target, "cannot write the output", e))
        }
        None => Ok(()),
    }
}

/// Writes a binary little-endian PLY file: all vertices, then all faces.
pub struct PlyWriter {
    out: PendingFile,
    header: OutputHeader,
    record_bytes: u64,
    vertices_left: u64,
    faces_left: u64,
    rows: Vec<u8>,
}

impl PlyWriter {
    /// Creates the output under a temporary name in its folder and writes the header.
    pub fn create(path: &Path, header: OutputHeader) -> Result<Self> {
        let index = header.index_type()?;
        let mut out = PendingFile::create(path)?;
        out.write(header.text(Encoding::BinaryLittleEndian, index).as_bytes())?;
        Ok(PlyWriter {
            out,
            record_bytes: header.schema.record_bytes() as u64,
            vertices_left: header.n_vertices,
            faces_left: header.n_faces,
            header,
            rows: Vec::new(),
        })
    }

    /// Appends packed records of the header's schema.
    pub fn write_vertices(&mut self, records: &[u8]) -> Result<()> {
        let n = records.len() as u64 / self.record_bytes;
        assert!(n * self.record_bytes == records.len() as u64, "whole records");
        assert!(n <= self.vertices_left, "no more vertices than the header says");
        self.vertices_left -= n;
        self.out.write(records)
    }

    /// Appends triangles; all vertices must have been written.
    pub fn write_faces(&mut self, triangles: &[[u64; 3]]) -> Result<()> {
        self.write_rows(
            triangles
                .iter()
                .map(|t| {
                    debug_assert!(t.iter().all(|&v| v < self.header.n_vertices), "corners exist");
                    t.map(|v| v as u32)
                })
                .collect::<Vec<_>>()
                .as_slice(),
        )
    }

    /// Appends triangles; all vertices must have been written.
    pub fn write_faces_u32(&mut self, triangles: &[[u32; 3]]) -> Result<()> {
        self.write_rows(triangles)
    }

    fn write_rows(&mut self, triangles: &[[u32; 3]]) -> Result<()> {
        assert!(self.vertices_left == 0, "all vertices come before the first face");
        assert!(triangles.len() as u64 <= self.faces_left, "no more faces than the header says");
        self.faces_left -= triangles.len() as u64;
        for chunk in triangles.chunks(16_384) {
            self.rows.clear();
            for t in chunk {
                let mut row = [3u8; 13];
                row[1..5].copy_from_slice(&t[0].to_le_bytes());
                row[5..9].copy_from_slice(&t[1].to_le_bytes());
                row[9..13].copy_from_slice(&t[2].to_le_bytes());
                self.rows.extend_from_slice(&row);
            }
            self.out.write(&self.rows)?;
        }
        Ok(())
    }

    /// Syncs and renames; returns the file's length in bytes. Counts that differ from the header's are a
    /// fault of ours.
    pub fn finish(self) -> Result<u64> {
        assert!(self.vertices_left == 0 && self.faces_left == 0, "as many rows as the header says");
        self.out.finish()
    }
}
