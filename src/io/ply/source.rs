//! `MeshSource`: a mesh file whose header has been held against its length.

use super::fields::{FieldPlan, Step, first_not_finite, not_finite, wire_value};
use super::fixed_faces::{Decoded, Stop};
use super::header::{Element, Encoding, Header, Kind};
use super::layout::{FaceLayout, Layout, VertexLayout, explain, index_faces, locate, with_scan};
use super::lookup::Lookup;
use super::raw::RawFile;
use super::rows::{FaceContext, RowIndex, face_row, out_of_range, vertex_row};
use super::scan::{Mark, Scan};
use super::skipped::BadVertices;
use super::strips::read_strips;
use super::{BLOCK_ROWS, FaceBlock, VertexBlock};
use crate::error::Result;
use crate::mesh::face_properties::FaceCarry;
use crate::mesh::record::VertexSchema;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

/// How a file is read.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ReadOptions {
    /// Drop and count what is broken (indices out of range, positions that are not finite, missing rows
    /// at the end) instead of failing. Costs one more pass over the vertices.
    pub skip_bad: bool,
    /// Where the positions of a body without fixed rows go if quads ask for them; the system's folder
    /// for temporary files otherwise.
    pub temp_dir: Option<PathBuf>,
}

/// What `ReadOptions::skip_bad` left out when the file was opened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Faults {
    /// Vertices whose position is not finite; faces that use them are dropped.
    pub bad_vertices: u64,
    /// Vertices that the header promises and the file does not hold.
    pub missing_vertices: u64,
    /// Face records that the header promises and the file does not hold.
    pub missing_faces: u64,
    /// Broken faces of an STL or OBJ file.
    pub bad_faces: u64,
}

/// Texture images that the faces refer to by coordinates at their corners.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TextureInfo {
    /// The images' file names.
    pub files: Vec<String>,
    /// The face property that holds the coordinates.
    pub property: String,
}

/// A mesh file whose header has been read and held against the file's length.
pub struct MeshSource {
    pub(super) file: RawFile,
    pub(super) header: Header,
    pub(super) options: ReadOptions,
    plan: FieldPlan,
    pub(super) layout: Layout,
    pub(super) bad_vertices: BadVertices,
    positions: OnceLock<RawFile>,
    positions_lock: Mutex<()>,
    staged: Staged,
}

/// What is known of an input that was turned into PLY before it was opened.
#[derive(Debug, Default)]
pub(crate) struct Staged {
    /// Broken faces that were dropped on the way.
    pub bad_faces: u64,
    /// A texture that the PLY no longer mentions.
    pub texture: Option<TextureInfo>,
    /// What faces carried, where it has been looked at (`io::survey_faces`).
    pub faces: Option<FaceCarry>,
}

impl MeshSource {
    /// Opens a file and checks its header against its length.
    ///
    /// Bodies without fixed rows (ASCII, polygons, strips, lists at vertices) are passed over once here,
    /// at about disk speed; the index takes 32 to 80 bytes for 65,536 rows.
    pub fn open(path: &Path) -> Result<Self> {
        Self::open_with(path, ReadOptions::default())
    }

    /// Opens a file with other than the default options.
    pub fn open_with(path: &Path, options: ReadOptions) -> Result<Self> {
        Self::new(RawFile::open(path)?, options)
    }

    /// Reads bytes in memory as if they were the file `name`.
    pub fn from_bytes(name: &str, bytes: Vec<u8>, options: ReadOptions) -> Result<Self> {
        Self::new(RawFile::from_bytes(name, bytes), options)
    }

    /// Takes a file that stands for a staged input, with what the staging found.
    pub(crate) fn from_staged(file: RawFile, options: ReadOptions, staged: Staged) -> Result<Self> {
        let mut source = Self::new(file, options)?;
        source.staged = staged;
        Ok(source)
    }

    pub(crate) fn new(file: RawFile, options: ReadOptions) -> Result<Self> {
        let header = Header::read(&file)?;
        let layout = locate(&file, &header, options.skip_bad)?;
        let vertex = &header.elements[layout.vertex_element];
        let plan = FieldPlan::new(vertex, header.encoding)
            .map_err(|what| file.bad(format!("element vertex: {what}")))?;
        let mut source = MeshSource {
            file,
            header,
            options,
            plan,
            layout,
            bad_vertices: BadVertices::default(),
            positions: OnceLock::new(),
            positions_lock: Mutex::new(()),
            staged: Staged::default(),
        };
        if source.options.skip_bad {
            source.bad_vertices = source.find_bad_vertices()?;
        }
        Ok(source)
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

    /// Images that per-corner texture coordinates refer to; these coordinates are not carried.
    pub fn texture(&self) -> Option<TextureInfo> {
        if let Some(texture) = &self.staged.texture {
            return (!texture.files.is_empty()).then(|| texture.clone());
        }
        let files = self.header.texture_files();
        let element = &self.header.elements[self.layout.face_element?];
        let property = element.properties.iter().find(|p| {
            let name = p.name.to_ascii_lowercase();
            matches!(p.kind, Kind::List { .. }) && name.replace('_', "").starts_with("texcoord")
        })?;
        (!files.is_empty()).then(|| TextureInfo { files, property: property.name.clone() })
    }

    /// The face property that holds texture coordinates of corners, whether or not an image is known.
    pub(super) fn texture_property(&self) -> Option<String> {
        let staged = self.staged.texture.as_ref().map(|texture| texture.property.clone());
        staged.or_else(|| self.texture().map(|texture| texture.property))
    }

    /// What faces carried and where it is now, where that has been decided (`io::survey_faces`).
    pub fn carried(&self) -> Option<&FaceCarry> {
        self.staged.faces.as_ref()
    }

    /// Notes what faces carry, where nothing of it had to be moved to vertices.
    pub(crate) fn note_carried(&mut self, carry: FaceCarry) {
        self.staged.faces = Some(carry);
    }

    /// Refuses a file that has no faces, saying what it has.
    pub fn require_faces(&self) -> Result<()> {
        if self.n_face_rows() > 0 {
            return Ok(());
        }
        let names: Vec<_> = self.header.elements.iter().map(|e| e.name.as_str()).collect();
        Err(self.file.bad(format!(
            "it has {} vertices but no faces (its elements: {}); make a mesh of the points first, for \
             instance with PoissonRecon",
            self.n_vertices(),
            names.join(", ")
        )))
    }

    /// Refuses a file whose texture would be lost, naming the images.
    pub fn require_no_texture(&self) -> Result<()> {
        match self.texture() {
            None => Ok(()),
            Some(texture) => Err(self.file.bad(format!(
                "its faces have texture coordinates (property '{}') for {}, which simplifying would \
                 lose; bake the texture into vertex colours first, or give the texture up with \
                 --drop-texture",
                texture.property,
                texture.files.join(", ")
            ))),
        }
    }

    /// What was left out when the file was opened; all zero without `skip_bad`.
    pub fn faults(&self) -> Faults {
        let promised = &self.header.elements[self.layout.vertex_element];
        let faces = self.layout.face_element.map(|i| &self.header.elements[i]);
        let faces = faces.filter(|e| e.name != "tristrips").map_or(0, |e| e.count);
        Faults {
            bad_vertices: self.bad_vertices.len(),
            missing_vertices: promised.count - self.n_vertices(),
            missing_faces: faces.saturating_sub(self.n_face_rows()),
            bad_faces: self.staged.bad_faces,
        }
    }

    /// Number of vertices.
    pub fn n_vertices(&self) -> u64 {
        self.layout.n_vertices
    }

    /// Number of rows that hold faces: a polygon counts once, a strip as often as it has triangles.
    ///
    /// For those who read rows; everything else counts triangles.
    pub fn n_face_rows(&self) -> u64 {
        self.layout.n_face_rows
    }

    /// Number of triangles that the faces make, degenerate and broken ones included.
    pub fn n_triangles(&self) -> u64 {
        self.layout.n_triangles
    }

    /// Number of corners of all faces.
    pub fn n_corners(&self) -> u64 {
        match self.layout.faces {
            FaceLayout::Strips(_) => 3 * self.n_triangles(),
            _ => self.n_triangles() + 2 * self.n_face_rows(),
        }
    }

    /// Number of vertex blocks, each of `BLOCK_ROWS` vertices but the last.
    pub fn n_vertex_blocks(&self) -> u64 {
        self.n_vertices().div_ceil(BLOCK_ROWS)
    }

    /// Number of face blocks, each of at most `BLOCK_ROWS` faces.
    pub fn n_face_blocks(&self) -> u64 {
        match &self.layout.faces {
            FaceLayout::None => 0,
            FaceLayout::Fixed { .. } => self.n_face_rows().div_ceil(BLOCK_ROWS),
            FaceLayout::Indexed(index) => index.blocks.len() as u64,
            FaceLayout::Strips(index) => index.blocks.len() as u64,
        }
    }

    /// The row of the face record that a block of faces begins with.
    pub(crate) fn first_row(&self, index: u64) -> u64 {
        match &self.layout.faces {
            FaceLayout::Indexed(rows) => rows.blocks[index as usize].1,
            _ => index * BLOCK_ROWS,
        }
    }

    /// Reads and checks one block of vertices; callable from any thread. Reuses `block`'s memory.
    pub fn read_vertices(&self, index: u64, block: &mut VertexBlock) -> Result<()> {
        self.read_unchecked(index, block)?;
        if self.options.skip_bad {
            self.bad_vertices.replace(block, &self.plan.schema);
            return Ok(());
        }
        match first_not_finite(&self.plan.schema, &block.records) {
            None => Ok(()),
            Some(i) => {
                let at = i * self.plan.schema.record_bytes();
                Err(not_finite(
                    self.file.path(),
                    block.first + i as u64,
                    self.place_of_vertex(index, i as u64),
                    self.plan.schema.position(&block.records[at..]),
                ))
            }
        }
    }

    /// Reads one block of vertices as they stand in the file.
    fn read_unchecked(&self, index: u64, block: &mut VertexBlock) -> Result<()> {
        assert!(index < self.n_vertex_blocks(), "the block exists");
        block.first = index * BLOCK_ROWS;
        let n = BLOCK_ROWS.min(self.n_vertices() - block.first) as usize;
        let record_bytes = self.plan.schema.record_bytes();
        block.records.resize(n * record_bytes, 0);
        match &self.layout.vertices {
            VertexLayout::Fixed { offset, row_bytes } => {
                let offset = offset + block.first * row_bytes;
                if self.plan.is_identity() {
                    return self.file.read_exact_at(&mut block.records, offset);
                }
                block.scratch.resize(n * *row_bytes as usize, 0);
                self.file.read_exact_at(&mut block.scratch, offset)?;
                self.plan.convert(&block.scratch, *row_bytes as usize, &mut block.records);
                Ok(())
            }
            VertexLayout::Indexed(rows) => {
                let (mark, first) = rows.blocks[index as usize];
                with_scan!(&self.file, self.header.encoding, mark, |scan| {
                    for (i, record) in block.records.chunks_exact_mut(record_bytes).enumerate() {
                        if let Err(fault) = vertex_row(&mut scan, &self.plan, record) {
                            let (row, at) = (first + i as u64, scan.last());
                            return Err(explain(&self.file, self.vertex(), row, at, fault));
                        }
                    }
                    Ok(())
                })
            }
        }
    }

    fn vertex(&self) -> &Element {
        &self.header.elements[self.layout.vertex_element]
    }

    /// Where row `i` of a block of vertices begins.
    fn place_of_vertex(&self, block: u64, i: u64) -> Mark {
        match &self.layout.vertices {
            VertexLayout::Fixed { offset, row_bytes } => {
                let offset = offset + (block * BLOCK_ROWS + i) * row_bytes;
                Mark { offset, ..Mark::default() }
            }
            VertexLayout::Indexed(rows) => {
                let (mark, _) = rows.blocks[block as usize];
                with_scan!(&self.file, self.header.encoding, mark, |scan| {
                    // The row was read a moment ago; should it fail now, the block's place must do.
                    let properties = &self.vertex().properties;
                    let passed = (0..i)
                        .flat_map(|_| properties)
                        .chain(properties.first())
                        .try_for_each(|p| scan.skip_property(p));
                    if passed.is_ok() { scan.last() } else { mark }
                })
            }
        }
    }

    /// Reads and checks one block of faces; callable from any thread. Reuses `block`'s memory.
    pub fn read_faces(&self, index: u64, block: &mut FaceBlock) -> Result<()> {
        self.read_face_block(index, block, false)
    }

    /// The same, with the row of every triangle in `block.rows`.
    pub fn read_faces_with_rows(&self, index: u64, block: &mut FaceBlock) -> Result<()> {
        self.read_face_block(index, block, true)
    }

    fn read_face_block(&self, index: u64, block: &mut FaceBlock, tracked: bool) -> Result<()> {
        assert!(index < self.n_face_blocks(), "the block exists");
        let mut out = Decoded {
            triangles: std::mem::take(&mut block.triangles),
            rows: std::mem::take(&mut block.rows),
            skip_bad: self.options.skip_bad,
            tracked,
            ..Decoded::default()
        };
        out.truncate(0);
        match &self.layout.faces {
            FaceLayout::None => {}
            FaceLayout::Fixed { .. } => self.read_fixed_faces(index, block, &mut out)?,
            FaceLayout::Indexed(rows) => {
                block.first_row = rows.blocks[index as usize].1;
                self.read_face_rows(index, rows, &mut out)?;
            }
            FaceLayout::Strips(strips) => {
                block.first_row = index * BLOCK_ROWS;
                let n = BLOCK_ROWS.min(strips.n_triangles - block.first_row);
                let state = strips.blocks[index as usize];
                let element = self.face();
                with_scan!(&self.file, self.header.encoding, state.mark, |scan| {
                    read_strips(&mut scan, element, self.n_vertices(), state, n, &mut out).map_err(
                        |(fault, row)| explain(&self.file, element, row, scan.last(), fault),
                    )
                })?;
            }
        }
        if self.bad_vertices.len() > 0 {
            let before = out.triangles.len();
            let is_bad = |t: &[u64; 3]| t.iter().any(|&v| self.bad_vertices.contains(v));
            if tracked {
                let mut bad = out.triangles.iter().map(is_bad);
                out.rows.retain(|_| bad.next() == Some(false));
            }
            out.triangles.retain(|t| !is_bad(t));
            out.n_bad += (before - out.triangles.len()) as u64;
        }
        block.triangles = out.triangles;
        block.rows = out.rows;
        block.n_degenerate = out.n_degenerate;
        block.n_bad = out.n_bad;
        Ok(())
    }

    pub(super) fn face(&self) -> &Element {
        let i = self.layout.face_element.unwrap_or(self.layout.vertex_element);
        &self.header.elements[i]
    }

    fn read_fixed_faces(&self, index: u64, block: &mut FaceBlock, out: &mut Decoded) -> Result<()> {
        let FaceLayout::Fixed { offset, rows, checked, fallback } = &self.layout.faces else {
            return Ok(());
        };
        block.first_row = index * BLOCK_ROWS;
        let built = fallback.lock().unwrap_or_else(PoisonError::into_inner).clone();
        if let Some(rows) = built {
            return self.read_face_rows(index, &rows, out);
        }
        let n = self.read_fixed_rows(index, &mut block.scratch)?;
        out.triangles.reserve(n);
        let mut found = rows.decode(&block.scratch, self.n_vertices(), out);
        // These rows are where they seem to be only if all before them are triangles.
        while found != Err(Stop::OtherLayout)
            && let Some(earlier) = checked.gap_before(index)
        {
            self.read_fixed_rows(earlier, &mut block.scratch)?;
            if block.scratch.chunks_exact(rows.stride).all(|row| rows.matches(row)) {
                checked.add(earlier);
            } else {
                found = Err(Stop::OtherLayout);
            }
        }
        if found == Ok(()) {
            checked.add(index);
        }
        match found {
            Ok(()) => Ok(()),
            Err(Stop::OutOfRange(i)) => {
                let row = block.first_row + i as u64;
                let at = Mark { offset: offset + row * rows.stride as u64, ..Mark::default() };
                let what = super::scan::Fault::Text(out_of_range(self.n_vertices()));
                Err(explain(&self.file, self.face(), row, at, what))
            }
            Err(Stop::OtherLayout) => {
                *out = Decoded {
                    triangles: std::mem::take(&mut out.triangles),
                    rows: std::mem::take(&mut out.rows),
                    skip_bad: out.skip_bad,
                    tracked: out.tracked,
                    ..Decoded::default()
                };
                out.truncate(0);
                let rows = {
                    let mut built = fallback.lock().unwrap_or_else(PoisonError::into_inner);
                    match &*built {
                        Some(rows) => rows.clone(),
                        None => {
                            let rows = index_faces(
                                &self.file,
                                self.header.encoding,
                                self.face(),
                                *offset,
                            )?;
                            built.insert(Arc::new(rows)).clone()
                        }
                    }
                };
                self.read_face_rows(index, &rows, out)
            }
        }
    }

    /// Reads the bytes of a block of rows of one size; returns the number of rows.
    fn read_fixed_rows(&self, index: u64, bytes: &mut Vec<u8>) -> Result<usize> {
        let FaceLayout::Fixed { offset, rows, .. } = &self.layout.faces else { return Ok(0) };
        let first = index * BLOCK_ROWS;
        let n = BLOCK_ROWS.min(self.n_face_rows() - first) as usize;
        bytes.resize(n * rows.stride, 0);
        self.file.read_exact_at(bytes, offset + first * rows.stride as u64)?;
        Ok(n)
    }

    fn read_face_rows(&self, index: u64, rows: &RowIndex, out: &mut Decoded) -> Result<()> {
        let (mark, first) = rows.blocks[index as usize];
        let next = rows.blocks.get(index as usize + 1).map_or(rows.n_rows, |b| b.1);
        let element = self.face();
        let Some(corners) = element.index_list() else { return Ok(()) };
        let mut open = || self.lookup();
        let mut context =
            FaceContext { element, n_vertices: self.n_vertices(), lookup: &mut open, opened: None };
        with_scan!(&self.file, self.header.encoding, mark, |scan| {
            for row in first..next {
                out.row = (row - first) as u32;
                if let Err(fault) = face_row(&mut scan, &mut context, corners, out) {
                    return Err(explain(&self.file, element, row, scan.last(), fault));
                }
            }
            Ok(())
        })
    }

    /// Random access to positions, for the diagonals of quads.
    fn lookup(&self) -> Result<Lookup<'_>> {
        match &self.layout.vertices {
            VertexLayout::Fixed { offset, row_bytes } => {
                let axes = self.plan.axes();
                let swap = self.header.encoding == Encoding::BinaryBigEndian;
                Ok(Lookup::new(&self.file, *offset, *row_bytes, move |row| {
                    axes.map(|(wire, at)| wire_value(wire, &row[at..], swap))
                }))
            }
            VertexLayout::Indexed(_) => {
                let _one_at_a_time =
                    self.positions_lock.lock().unwrap_or_else(PoisonError::into_inner);
                let file = match self.positions.get() {
                    Some(file) => file,
                    None => {
                        let spooled = self.spool_positions()?;
                        self.positions.get_or_init(|| spooled)
                    }
                };
                Ok(Lookup::new(file, 0, 24, |row| {
                    [0, 8, 16]
                        .map(|at| f64::from_le_bytes(row[at..at + 8].try_into().expect("8 bytes")))
                }))
            }
        }
    }

    /// Writes all positions to a nameless temporary file, 24 bytes each.
    fn spool_positions(&self) -> Result<RawFile> {
        let folder = self.options.temp_dir.clone().unwrap_or_else(std::env::temp_dir);
        let mut spool = super::raw::Spool::new(&folder);
        let (mut block, mut bytes) = (VertexBlock::default(), Vec::new());
        for index in 0..self.n_vertex_blocks() {
            self.read_unchecked(index, &mut block)?;
            bytes.clear();
            for record in block.records.chunks_exact(self.plan.schema.record_bytes()) {
                for value in self.plan.schema.position(record) {
                    bytes.extend_from_slice(&value.to_le_bytes());
                }
            }
            spool.write(&bytes)?;
        }
        spool.finish(self.file.path())
    }

    fn find_bad_vertices(&self) -> Result<BadVertices> {
        let mut bad = BadVertices::default();
        let mut block = VertexBlock::default();
        for index in 0..self.n_vertex_blocks() {
            self.read_unchecked(index, &mut block)?;
            bad.collect(&block, &self.plan.schema);
        }
        Ok(bad)
    }
}

impl FieldPlan {
    /// Type and place in a binary row of fixed size of x, y and z.
    fn axes(&self) -> [(super::header::Wire, usize); 3] {
        let size = self.schema.coordinate.bytes();
        let mut axes = [(super::header::Wire::F16, 0); 3];
        for step in &self.steps {
            if let Step::Take(field) = step
                && field.target < 3 * size
            {
                axes[field.target / size] = (field.wire, field.source);
            }
        }
        axes
    }
}

impl std::fmt::Debug for MeshSource {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("MeshSource")
            .field("path", &self.file.path())
            .field("n_vertices", &self.n_vertices())
            .field("n_triangles", &self.n_triangles())
            .finish_non_exhaustive()
    }
}
