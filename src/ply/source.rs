//! `MeshSource`: a mesh file whose header has been held against its length.

use super::fields::{FieldPlan, first_not_finite, not_finite};
use super::fixed_faces::{Decoded, FixedFaces, Stop};
use super::header::{Element, Encoding, Header};
use super::raw::RawFile;
use super::{BLOCK_ROWS, FaceBlock, VertexBlock};
use crate::error::{Error, Result};
use crate::schema::VertexSchema;
use std::path::Path;

/// How strictly a file is read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ReadOptions {
    /// Drop and count what is broken (indices out of range, positions that are not finite, missing rows
    /// at the end) instead of failing.
    pub skip_bad: bool,
}

/// A mesh file whose header has been read and held against the file's length.
pub struct MeshSource {
    file: RawFile,
    header: Header,
    options: ReadOptions,
    plan: FieldPlan,
    n_vertices: u64,
    n_faces: u64,
    vertices: VertexLayout,
    faces: FaceLayout,
}

/// Where the rows of the vertex element are.
enum VertexLayout {
    Fixed { offset: u64, row_bytes: u64 },
}

/// Where the rows of the face element are.
enum FaceLayout {
    None,
    Fixed { offset: u64, rows: FixedFaces },
}

impl MeshSource {
    /// Opens a file and checks its header against its length.
    pub fn open(path: &Path) -> Result<Self> {
        Self::open_with(path, ReadOptions::default())
    }

    /// Opens a file with other than the default strictness.
    pub fn open_with(path: &Path, options: ReadOptions) -> Result<Self> {
        Self::new(RawFile::open(path)?, options)
    }

    /// Reads bytes in memory as if they were the file `name`.
    pub fn from_bytes(name: &str, bytes: Vec<u8>, options: ReadOptions) -> Result<Self> {
        Self::new(RawFile::from_bytes(name, bytes), options)
    }

    fn new(file: RawFile, options: ReadOptions) -> Result<Self> {
        let header = Header::read(&file)?;
        let vertex = header.elements.iter().find(|e| e.name == "vertex");
        let vertex = vertex.ok_or_else(|| file.bad("there is no element 'vertex'"))?;
        let plan = FieldPlan::new(vertex, header.encoding)
            .map_err(|what| file.bad(format!("element vertex: {what}")))?;
        let n_vertices = vertex.count;
        let mut source = MeshSource {
            n_vertices,
            n_faces: 0,
            vertices: VertexLayout::Fixed { offset: 0, row_bytes: 0 },
            faces: FaceLayout::None,
            file,
            header,
            options,
            plan,
        };
        source.locate()?;
        Ok(source)
    }

    /// Walks through the elements in file order and notes where vertices and faces lie.
    fn locate(&mut self) -> Result<()> {
        let mut at = self.header.body_offset;
        for i in 0..self.header.elements.len() {
            let element = &self.header.elements[i];
            self.check_plausible(element, at)?;
            let fixed = element.fixed_bytes().filter(|_| self.header.encoding != Encoding::Ascii);
            match (element.name.as_str(), fixed) {
                ("vertex", Some(row_bytes)) => {
                    self.vertices = VertexLayout::Fixed { offset: at, row_bytes };
                    at += row_bytes * element.count;
                }
                (_, Some(row_bytes)) => at += row_bytes * element.count,
                ("face", None) => {
                    let mut first = [0u8; 4096];
                    let n = self.file.read_at_most(&mut first, at)?;
                    let rows = FixedFaces::guess(element, self.header.encoding, &first[..n]);
                    let Some(rows) = rows else {
                        return Err(self.file.bad("faces other than triangles: not read yet"));
                    };
                    let bytes = (rows.stride as u64).checked_mul(element.count);
                    match bytes.and_then(|b| b.checked_add(at)) {
                        Some(end) if end <= self.file.len() => {
                            (self.n_faces, at) = (element.count, end);
                        }
                        _ => {
                            let row = (self.file.len() - at) / rows.stride as u64;
                            return Err(self.truncated(&element.name, row, self.file.len()));
                        }
                    }
                    self.faces = FaceLayout::Fixed { offset: at - bytes.unwrap_or(0), rows };
                }
                _ if element.count == 0 => {}
                _ => return Err(self.file.bad("this layout is not read yet")),
            }
        }
        Ok(())
    }

    /// Refuses a count that the rest of the file cannot hold, before anything is built upon it.
    fn check_plausible(&self, element: &Element, at: u64) -> Result<()> {
        let least = element.least_bytes(self.header.encoding);
        let left = self.file.len().saturating_sub(at);
        let needed = least.checked_mul(element.count);
        if element.count > 0 && needed.is_none_or(|bytes| bytes > left) {
            let row = left.checked_div(least).unwrap_or(0);
            return Err(self.truncated(&element.name, row, self.file.len()));
        }
        Ok(())
    }

    fn truncated(&self, element: &str, row: u64, offset: u64) -> Error {
        let count = self.header.elements.iter().find(|e| e.name == element).map_or(0, |e| e.count);
        self.file.bad(format!(
            "element {element}, row {row}, byte offset {offset}: the file ends here, but its header \
             promises {count} rows; copy or export it again, or read what is there with --skip-bad"
        ))
    }

    /// What a vertex record holds.
    pub fn schema(&self) -> &VertexSchema {
        &self.plan.schema
    }

    /// The file's name, for messages.
    pub fn path(&self) -> &Path {
        self.file.path()
    }

    /// The file's length in bytes.
    pub fn file_bytes(&self) -> u64 {
        self.file.len()
    }

    /// How the numbers of the body are written.
    pub fn encoding(&self) -> Encoding {
        self.header.encoding
    }

    /// The text of the header's `comment` lines, in order.
    pub fn comments(&self) -> &[String] {
        &self.header.comments
    }

    /// The text of the header's `obj_info` lines, in order.
    pub fn obj_infos(&self) -> &[String] {
        &self.header.obj_infos
    }

    /// Names of list properties of vertices, which records cannot carry.
    pub fn dropped_lists(&self) -> &[String] {
        &self.plan.dropped_lists
    }

    /// Number of vertices.
    pub fn n_vertices(&self) -> u64 {
        self.n_vertices
    }

    /// Number of face records (a polygon counts once).
    pub fn n_faces(&self) -> u64 {
        self.n_faces
    }

    /// Number of vertex blocks, each of `BLOCK_ROWS` vertices but the last.
    pub fn n_vertex_blocks(&self) -> u64 {
        self.n_vertices().div_ceil(BLOCK_ROWS)
    }

    /// Number of face blocks.
    pub fn n_face_blocks(&self) -> u64 {
        self.n_faces().div_ceil(BLOCK_ROWS)
    }

    /// Reads and checks one block of vertices; callable from any thread. Reuses `block`'s memory.
    pub fn read_vertices(&self, index: u64, block: &mut VertexBlock) -> Result<()> {
        assert!(index < self.n_vertex_blocks(), "the block exists");
        block.first = index * BLOCK_ROWS;
        let n = BLOCK_ROWS.min(self.n_vertices - block.first) as usize;
        let record_bytes = self.plan.schema.record_bytes();
        block.records.resize(n * record_bytes, 0);
        let VertexLayout::Fixed { offset, row_bytes } = self.vertices;
        let offset = offset + block.first * row_bytes;
        if self.plan.is_identity() {
            self.file.read_exact_at(&mut block.records, offset)?;
        } else {
            block.scratch.resize(n * row_bytes as usize, 0);
            self.file.read_exact_at(&mut block.scratch, offset)?;
            self.plan.convert(&block.scratch, row_bytes as usize, &mut block.records);
        }
        match first_not_finite(&self.plan.schema, &block.records) {
            None => Ok(()),
            Some(i) => Err(not_finite(
                self.file.path(),
                block.first + i as u64,
                format_args!("byte offset {}", offset + i as u64 * row_bytes),
                self.plan.schema.position(&block.records[i * record_bytes..]),
            )),
        }
    }

    /// Reads and checks one block of faces; callable from any thread. Reuses `block`'s memory.
    pub fn read_faces(&self, index: u64, block: &mut FaceBlock) -> Result<()> {
        assert!(index < self.n_face_blocks(), "the block exists");
        block.first_row = index * BLOCK_ROWS;
        let mut out = Decoded {
            triangles: std::mem::take(&mut block.triangles),
            skip_bad: self.options.skip_bad,
            ..Decoded::default()
        };
        out.triangles.clear();
        match &self.faces {
            FaceLayout::None => {}
            FaceLayout::Fixed { offset, rows } => {
                let n = BLOCK_ROWS.min(self.n_faces - block.first_row) as usize;
                let offset = offset + block.first_row * rows.stride as u64;
                block.scratch.resize(n * rows.stride, 0);
                self.file.read_exact_at(&mut block.scratch, offset)?;
                out.triangles.reserve(n);
                match rows.decode(&block.scratch, self.n_vertices, &mut out) {
                    Ok(()) => {}
                    Err(Stop::OtherLayout) => {
                        return Err(self.file.bad("faces other than triangles: not read yet"));
                    }
                    Err(Stop::OutOfRange(i)) => {
                        let row = block.first_row + i as u64;
                        return Err(self.out_of_range(row, offset + (i * rows.stride) as u64));
                    }
                }
            }
        }
        block.triangles = out.triangles;
        block.n_degenerate = out.n_degenerate;
        block.n_bad = out.n_bad;
        Ok(())
    }

    fn out_of_range(&self, row: u64, offset: u64) -> Error {
        self.file.bad(format!(
            "element face, row {row}, byte offset {offset}: a corner names a vertex that does not \
             exist (there are {}); export the mesh again, or drop such faces with --skip-bad",
            self.n_vertices
        ))
    }
}
