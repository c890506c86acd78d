//! Streams a surface into a binary PLY: blocks computed in parallel, written in order, renamed at the end.
//!
//! Memory is a few blocks a thread, whatever the mesh's size. The bytes depend on the surface
//! alone: a block's place in the file is fixed before any thread begins.

use super::surface::{Surface, Vertex};
use crate::error::{Error, Result};
use crate::parallel::in_order;
use crate::progress::Progress;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

/// What a vertex and a face look like in the file.
#[derive(Clone, Copy, Debug)]
pub(super) struct Layout {
    /// `uchar red green blue` after the position.
    pub(super) color: bool,
    /// `float s t` after the colour.
    pub(super) uv: bool,
    /// `uint` indices instead of `int`: past 2^31 vertices.
    pub(super) unsigned: bool,
}

impl Layout {
    /// The header of a mesh, with a comment.
    pub(super) fn header(&self, n_vertices: u64, n_faces: u64, comment: &str) -> String {
        let mut text = String::from("ply\nformat binary_little_endian 1.0\n");
        text += &format!("comment {comment}\n");
        text += &format!("element vertex {n_vertices}\n");
        text += "property float x\nproperty float y\nproperty float z\n";
        if self.color {
            text += "property uchar red\nproperty uchar green\nproperty uchar blue\n";
        }
        if self.uv {
            text += "property float s\nproperty float t\n";
        }
        let index = if self.unsigned { "uint" } else { "int" };
        text += &format!("element face {n_faces}\nproperty list uchar {index} vertex_indices\n");
        text + "end_header\n"
    }

    /// Bytes of one vertex record.
    pub(super) fn vertex_bytes(&self) -> usize {
        12 + if self.color { 3 } else { 0 } + if self.uv { 8 } else { 0 }
    }

    /// Appends one vertex record.
    pub(super) fn put_vertex(&self, vertex: &Vertex, out: &mut Vec<u8>) {
        for value in vertex.position {
            out.extend_from_slice(&value.to_le_bytes());
        }
        if self.color {
            out.extend_from_slice(&vertex.color);
        }
        if self.uv {
            for value in vertex.uv {
                out.extend_from_slice(&value.to_le_bytes());
            }
        }
    }

    /// Appends one face record.
    pub(super) fn put_face(face: [u64; 3], out: &mut Vec<u8>) {
        let mut record = [3u8; FACE_BYTES];
        for (corner, id) in face.into_iter().enumerate() {
            // Ids are below 2^32: `synth::check` refuses larger meshes. Below 2^31, int and uint agree.
            let id = id as u32;
            record[1 + 4 * corner..5 + 4 * corner].copy_from_slice(&id.to_le_bytes());
        }
        out.extend_from_slice(&record);
    }
}

/// Bytes of one face record.
pub(super) const FACE_BYTES: usize = 13;

/// A file being written beside its final place; removed again unless `finish` is reached.
pub(super) struct Unfinished {
    path: PathBuf,
    target: PathBuf,
    file: BufWriter<File>,
    finished: bool,
}

impl Unfinished {
    /// Begins the file that shall become `target`; refuses an existing one without `force`.
    pub(super) fn create(target: &Path, force: bool) -> Result<Self> {
        if !force && target.exists() {
            let target = target.display();
            return Err(Error::Usage(format!("{target} exists; --force overwrites it")));
        }
        let mut name = target.file_name().map(ToOwned::to_owned).unwrap_or_default();
        name.push(format!(".part-{}", std::process::id()));
        let path = target.with_file_name(name);
        let file = File::create(&path).map_err(|e| Error::io(&path, "cannot create", e))?;
        let file = BufWriter::with_capacity(1 << 20, file);
        Ok(Unfinished { path, target: target.to_path_buf(), file, finished: false })
    }

    /// Appends bytes.
    pub(super) fn write(&mut self, bytes: &[u8]) -> Result<()> {
        self.file.write_all(bytes).map_err(|e| Error::io(&self.path, "cannot write", e))
    }

    /// A path beside the unfinished file for data that is needed while writing it.
    pub(super) fn companion(&self, suffix: &str) -> PathBuf {
        let mut name = self.path.file_name().map(ToOwned::to_owned).unwrap_or_default();
        name.push(suffix);
        self.path.with_file_name(name)
    }

    /// Makes the bytes durable and gives the file its name.
    pub(super) fn finish(mut self) -> Result<()> {
        self.file.flush().map_err(|e| Error::io(&self.path, "cannot write", e))?;
        self.file.get_ref().sync_all().map_err(|e| Error::io(&self.path, "cannot sync", e))?;
        std::fs::rename(&self.path, &self.target).map_err(|e| {
            Error::io(&self.target, "cannot rename the finished file to this name", e)
        })?;
        self.finished = true;
        Ok(())
    }
}

impl Drop for Unfinished {
    fn drop(&mut self) {
        if !self.finished {
            // Nothing can be done about a failure here, and the run has failed already.
            let _ = std::fs::remove_file(&self.path);
        }
    }
}

/// How a surface is streamed.
#[derive(Clone, Copy)]
pub(super) struct Stream<'a> {
    /// What.
    pub(super) surface: &'a dyn Surface,
    /// As which records.
    pub(super) layout: Layout,
    /// On so many threads.
    pub(super) threads: usize,
    /// Counts faces, and may ask to stop.
    pub(super) progress: &'a Progress,
}

/// A block under way, and the memory it is made in.
#[derive(Default)]
struct Block<T> {
    rows: Vec<T>,
    bytes: Vec<u8>,
}

impl Stream<'_> {
    /// Encodes all vertices, block after block, into `sink`.
    pub(super) fn vertices(&self, mut sink: impl FnMut(&[u8]) -> Result<()>) -> Result<()> {
        let produce = |index: u64, block: &mut Block<Vertex>| {
            block.rows.clear();
            block.bytes.clear();
            self.surface.vertices(index, &mut block.rows);
            block.rows.iter().for_each(|v| self.layout.put_vertex(v, &mut block.bytes));
            Ok(())
        };
        let n_blocks = self.surface.n_vertex_blocks();
        in_order(n_blocks, self.threads, self.progress, produce, |_, block| sink(&block.bytes))
    }

    /// Encodes all faces, block after block, into `sink`; counts them as progress. `renumber` gives the
    /// corners of each face their final numbers, knowing the face's row.
    pub(super) fn faces(
        &self,
        renumber: impl Fn(u64, [u64; 3]) -> [u64; 3] + Sync,
        mut sink: impl FnMut(&[u8]) -> Result<()>,
    ) -> Result<()> {
        let produce = |index: u64, block: &mut Block<[u64; 3]>| {
            block.rows.clear();
            block.bytes.clear();
            self.surface.faces(index, &mut block.rows);
            let first = self.surface.first_face(index);
            for (row, face) in block.rows.iter().enumerate() {
                Layout::put_face(renumber(first + row as u64, *face), &mut block.bytes);
            }
            Ok(())
        };
        let n_blocks = self.surface.n_face_blocks();
        in_order(n_blocks, self.threads, self.progress, produce, |_, block| {
            self.progress.add(block.rows.len() as u64);
            sink(&block.bytes)
        })
    }
}
