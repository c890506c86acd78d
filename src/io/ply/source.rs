//! `MeshSource`: a mesh file whose header has been held against its length; what it says of itself.
//!
//! Reading its rows is in `vertex_blocks` and `face_blocks`.

use super::BLOCK_ROWS;
use super::fields::FieldPlan;
use super::header::{Element, Encoding, Header, Kind};
use super::layout::{FaceLayout, Layout, VertexLayout, locate};
use super::placed::Placed;
use super::raw::RawFile;
use super::reports::{PartReport, WeldReport};
use super::skipped::BadVertices;
use super::textures;
use crate::materials::Materials;
use crate::names::NameUse;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, OnceLock};
use stonecut_mesh::face_properties::FacePropertyPlan;
use stonecut_mesh::placing::Placing;
use stonecut_mesh::record::VertexSchema;
use stonecut_system::error::Result;
use stonecut_system::losses::{Ledger, Loss};

/// Settings for reading a file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ReadOptions {
    /// Drop and count what is broken (indices out of range, positions that are not finite, missing rows
    /// at the end) instead of failing. Costs one more pass over the vertices.
    pub skip_bad: bool,
    /// Folder for the positions of a body without fixed rows, needed for quads; the system's folder
    /// for temporary files otherwise.
    pub temp_dir: Option<PathBuf>,
    /// Map that is applied to the mesh before all else; only `open_staged` applies it.
    pub placing: Placing,
    /// Fate of the names of objects and groups.
    pub names: NameUse,
}

/// Counts of rows that `ReadOptions::skip_bad` left out when the file was opened.
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
    pub(super) plan: FieldPlan,
    pub(super) layout: Layout,
    pub(super) bad_vertices: BadVertices,
    pub(super) positions: OnceLock<RawFile>,
    pub(super) positions_lock: Mutex<()>,
    pub(super) placed: Option<Placed>,
    /// A property of faces that is left out as if it was not there.
    pub(super) hidden: Option<&'static str>,
    /// Components of colours that are outside of black to white.
    pub(super) n_outside: u64,
    /// Polygons whose sides cross, by block of faces, as far as these were read.
    pub(super) crossing: Mutex<BTreeMap<u64, u64>>,
    pub(super) staged: Staged,
}

/// Facts about an input that was turned into PLY before it was opened.
#[derive(Debug, Default)]
pub struct Staged {
    /// Length of the file that was given, in bytes, packed if it was; `None` for a stream.
    pub given_bytes: Option<u64>,
    /// Rows that were left out on the way.
    pub faults: Faults,
    /// Vertices that were left out on the way, since no face has them.
    pub unreferenced_vertices: u64,
    /// Files beside the input that parts of the mesh were read from.
    pub beside: Vec<PathBuf>,
    /// Checksum of a stream, from its first to its last byte.
    pub stream_checksum: Option<u64>,
    /// A texture that the PLY no longer mentions.
    pub texture: Option<TextureInfo>,
    /// Face properties, once surveyed (`io::survey_faces`).
    pub faces: Option<FacePropertyPlan>,
    /// Materials of the faces, which the PLY does not name.
    pub materials: Option<Arc<Materials>>,
    /// The format of the file that was given, if it is not PLY.
    pub format: Option<&'static str>,
    /// Remarks on what was passed over, taken for something else or found to be odd.
    pub notes: Vec<Loss>,
    /// Outcome of joining copies of vertices (`io::weld`), if there was something to say.
    pub weld: Option<WeldReport>,
    /// For each vertex before copies were joined its number now, 4 bytes each, if that was asked for.
    pub numbers: Option<RawFile>,
    /// Property of vertices that says which of them must stay.
    pub lock: Option<LockedBy>,
    /// Files that became this mesh, if it was made of several.
    pub parts: Vec<PartReport>,
    /// Vertices without a colour where others have one: they are white.
    pub n_bare: u64,
    /// Parts of the input that the PLY does not have.
    pub losses: Ledger,
}

/// A property of vertices that is not 0 where they must stay.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LockedBy {
    /// Its name.
    pub property: String,
    /// True if the input does not have it: results leave it out.
    pub is_ours: bool,
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
    pub fn from_staged(file: RawFile, options: ReadOptions, staged: Staged) -> Result<Self> {
        let mut source = Self::new(file, options)?;
        if let Some(carry) = &staged.faces {
            source.plan.schema.set_last(carry.vertex_properties());
        }
        if let Some(LockedBy { property, is_ours: true }) = &staged.lock {
            source.plan.schema.set_lock(property);
        }
        source.staged = staged;
        Ok(source)
    }

    /// Reads the header. Fails as `BadInput` where the file breaks its format.
    pub fn new(file: RawFile, options: ReadOptions) -> Result<Self> {
        let header = Header::read(&file)?;
        let mut layout = locate(&file, &header, options.skip_bad)?;
        let notes = layout.rest.take().into_iter().collect();
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
            placed: None,
            hidden: None,
            n_outside: 0,
            crossing: Mutex::default(),
            staged: Staged { notes, ..Staged::default() },
        };
        source.survey_places();
        source.survey_colours();
        source.survey_doubles();
        source.give_up_names();
        source.staged.materials = textures::materials_of(&source.header, source.file.path());
        if source.options.skip_bad {
            source.bad_vertices = source.find_bad_vertices()?;
        }
        Ok(source)
    }

    /// Layout of a vertex record.
    pub fn schema(&self) -> &VertexSchema {
        self.placed.as_ref().map_or(&self.plan.schema, |placed| &placed.schema)
    }

    /// The file's name, for messages.
    pub fn path(&self) -> &Path {
        self.file.path()
    }

    /// Length of what is read, in bytes: of the file, or of its unpacked copy.
    pub fn file_bytes(&self) -> u64 {
        self.file.len()
    }

    /// Length of the file that was given, in bytes; of a stream that of its unpacked copy.
    pub fn given_bytes(&self) -> u64 {
        self.staged.given_bytes.unwrap_or_else(|| self.file_bytes())
    }

    /// Notes the length of the file that was given.
    pub fn set_given_bytes(&mut self, bytes: u64) {
        self.staged.given_bytes = Some(bytes);
    }

    /// The format of the file that was given.
    pub fn file_format(&self) -> &'static str {
        self.staged.format.unwrap_or("PLY")
    }

    /// True if images hide the colours of vertices in the format of the file; glTF multiplies the two.
    pub fn images_hide_colours(&self) -> bool {
        ["PLY", "OBJ"].contains(&self.file_format())
    }

    /// Adds a remark.
    pub fn note(&mut self, remark: Loss) {
        self.staged.notes.push(remark);
    }

    /// Notes the checksum of a stream.
    pub fn set_stream_checksum(&mut self, checksum: u64) {
        self.staged.stream_checksum = Some(checksum);
    }

    /// Notes what was seen of copies of vertices.
    pub fn note_weld(&mut self, report: WeldReport) {
        self.staged.weld = Some(report);
    }

    /// Notes what is lost when vertices are joined.
    pub(crate) fn note_loss(&mut self, loss: Loss) {
        self.staged.losses.lose(loss);
    }

    /// Notes the property that says which vertices must stay.
    pub fn note_lock(&mut self, lock: LockedBy) {
        self.staged.lock = Some(lock);
    }

    /// Files that became this mesh; empty for a single file.
    pub fn parts(&self) -> &[PartReport] {
        &self.staged.parts
    }

    /// Outcome of joining copies of vertices, where there was something to say.
    pub fn weld(&self) -> Option<&WeldReport> {
        self.staged.weld.as_ref()
    }

    /// For each vertex before copies were joined its number now, 4 bytes each: if any were, and this was to be kept.
    pub fn joined_numbers(&self) -> Option<&RawFile> {
        self.staged.numbers.as_ref()
    }

    /// Facts found before the PLY was opened, for another PLY that stands for this one.
    pub fn into_staged(self) -> Staged {
        Staged { losses: self.losses(), ..self.staged }
    }

    /// Encoding of the numbers in the body.
    pub fn encoding(&self) -> Encoding {
        self.header.encoding
    }

    /// The text of the header's `comment` lines, in order.
    pub fn comments(&self) -> &[String] {
        self.placed.as_ref().map_or(&self.header.comments, Placed::comments)
    }

    /// Materials of the faces, by the number that a face has.
    pub fn materials(&self) -> Option<&Arc<Materials>> {
        self.staged.materials.as_ref()
    }

    /// Refuses an output that would replace a file that the input names: an image or a material library.
    pub fn refuse_output(&self, output: &Path) -> Result<()> {
        self.materials().map_or(Ok(()), |materials| materials.refuse_output(output))
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

    /// Face properties and where they are carried, once decided (`io::survey_faces`).
    pub fn carried(&self) -> Option<&FacePropertyPlan> {
        self.staged.faces.as_ref()
    }

    /// Notes which properties of vertices are labels that lie in patches.
    pub fn note_patchy(&mut self, is_patchy: &[bool]) {
        let all = self.plan.schema.properties.iter_mut().zip(is_patchy);
        all.for_each(|(property, is_patchy)| property.is_patchy = *is_patchy);
    }

    /// The name of the property that locks vertices, if one of the input's does.
    pub fn lock_property(&self) -> Option<&str> {
        self.staged.lock.as_ref().map(|lock| lock.property.as_str())
    }

    /// Notes what faces carry, where nothing of it had to be moved to vertices.
    pub fn note_carried(&mut self, carry: FacePropertyPlan) {
        self.staged.faces = Some(carry);
    }

    /// Refuses a file that has no triangles, saying what it has.
    pub fn require_faces(&self) -> Result<()> {
        let names: Vec<_> = self.header.elements.iter().map(|e| e.name.as_str()).collect();
        let (n, names) = (self.n_vertices(), names.join(", "));
        let remedy = match (self.n_triangles(), self.n_face_rows()) {
            (0, 0) if n == 0 => "export it again",
            (0, 0) if names.contains("range_grid") => {
                "say the grid's obj_info num_cols and num_rows"
            }
            (0, 0) => "make a mesh of the points first, for instance with PoissonRecon",
            (0, _) => {
                let what = "has no triangles (element face, row 0): no face has three corners";
                return Err(self.file.bad(what));
            }
            _ => return Ok(()),
        };
        let what = format!("it has {n} vertices but no faces, so no triangles (its elements");
        Err(self.file.bad(format!("{what}: {names}); {remedy}")))
    }

    /// Refuses a file whose texture would be lost, naming some of the images.
    pub fn require_no_texture(&self) -> Result<()> {
        match self.texture() {
            None => Ok(()),
            Some(texture) => Err(self.file.bad(format!(
                "its faces have texture coordinates (property '{}') for {}, which simplifying would \
                 lose; bake the texture into vertex colours first, or give the texture up with \
                 --drop-texture",
                texture.property,
                some_of(&texture.files)
            ))),
        }
    }

    /// Counts of rows left out when the file was opened; all zero without `skip_bad`.
    pub fn faults(&self) -> Faults {
        let promised = &self.header.elements[self.layout.vertex_element];
        let faces = self.layout.face_element.map(|i| &self.header.elements[i]);
        let faces = faces.filter(|e| e.name != "tristrips").map_or(0, |e| e.count);
        let staged = &self.staged.faults;
        Faults {
            bad_vertices: staged.bad_vertices + self.bad_vertices.len(),
            missing_vertices: staged.missing_vertices + promised.count - self.n_vertices(),
            missing_faces: staged.missing_faces + faces.saturating_sub(self.n_face_rows()),
            bad_faces: staged.bad_faces,
        }
    }

    /// Remarks on what was passed over or found to be odd when the file was opened.
    pub fn notes(&self) -> &[Loss] {
        &self.staged.notes
    }

    /// Vertices that were left out when the file was opened, since no face has them.
    pub fn unreferenced_vertices(&self) -> u64 {
        self.staged.unreferenced_vertices
    }

    /// Files beside the input that parts of the mesh were read from: buffers of glTF.
    pub fn beside(&self) -> &[PathBuf] {
        &self.staged.beside
    }

    /// Checksum of standard input, from its first to its last byte; none for files.
    pub fn stream_checksum(&self) -> Option<u64> {
        self.staged.stream_checksum
    }

    /// Number of vertices.
    pub fn n_vertices(&self) -> u64 {
        self.layout.n_vertices
    }

    /// Number of rows that hold faces, for those who read rows: a polygon counts once, a strip as often as it has triangles.
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

    /// Returns whether any block is found in the file by arithmetic: nothing was unpacked, converted, scanned or moved
    /// when it was opened.
    pub fn is_read_in_place(&self) -> bool {
        self.file.is_original()
            && !self.options.skip_bad
            && matches!(self.layout.vertices, VertexLayout::Fixed { .. })
            && matches!(self.layout.faces, FaceLayout::Fixed { .. })
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
    pub fn first_row(&self, index: u64) -> u64 {
        match &self.layout.faces {
            FaceLayout::Indexed(rows) => rows.blocks[index as usize].1,
            _ => index * BLOCK_ROWS,
        }
    }

    pub(super) fn vertex(&self) -> &Element {
        &self.header.elements[self.layout.vertex_element]
    }

    pub(super) fn face(&self) -> &Element {
        let i = self.layout.face_element.unwrap_or(self.layout.vertex_element);
        &self.header.elements[i]
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

/// Names, each once, the first few of them.
fn some_of(names: &[String]) -> String {
    const MOST: usize = 5;
    let mut seen = std::collections::HashSet::new();
    let each: Vec<&str> =
        names.iter().map(String::as_str).filter(|&name| seen.insert(name)).collect();
    match each.len() {
        0..=MOST => each.join(", "),
        n => format!("{} and {} more", each[..MOST].join(", "), n - MOST),
    }
}
