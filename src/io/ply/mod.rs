//! Meshes on disk: opened and checked once, read block by block, written whole or not at all.
//!
//! A `MeshSource` gives random access to blocks of vertices and faces, from any thread, however the file
//! is laid out; whatever has no fixed record size gets an index of block offsets first. Nothing behind
//! this module ever sees a dialect.

mod ascii;
mod binary;
mod checked;
mod colour_survey;
mod face_blocks;
mod fields;
mod fixed_faces;
mod full_faces;
mod grid_mesh;
pub mod header;
mod layout;
pub mod lookup;
mod lost;
mod place;
mod placed;
mod range_grid;
pub mod raw;
mod reports;
mod rewrite;
pub mod row_window;
pub mod rows;
pub mod scan;
mod skipped;
pub mod source;
mod strips;
mod textures;
mod vertex_blocks;
mod vertex_records;
pub mod writer;

pub use full_faces::{FaceLook, FaceLooks, FullFace};
pub use header::Encoding;
pub use reports::{PartReport, WeldReport};
pub use rewrite::rewrite_vertices;
pub use source::LockedBy;
pub use source::{Faults, MeshSource, ReadOptions, TextureInfo};
pub use stonecut_system::pending_file::Place;
pub use vertex_records::VertexRecords;
pub use writer::type_name;
pub use writer::{FaceSchema, OutputHeader, PlyFormat, PlyWriter, TexturedTriangle};

/// Vertices or faces in one block.
pub const BLOCK_ROWS: u64 = 65_536;

/// A block of vertices: packed records after `VertexSchema`, every coordinate finite.
#[derive(Default)]
pub struct VertexBlock {
    /// Id of the first vertex.
    pub first: u64,
    /// `record_bytes` bytes a vertex.
    pub records: Vec<u8>,
    /// Bytes of the file as they came, before they are records; kept for its memory.
    pub scratch: Vec<u8>,
}

/// A block of faces as triangles; every index is below the number of vertices.
#[derive(Default)]
pub struct FaceBlock {
    /// Row of the first face record in the file.
    pub first_row: u64,
    /// Corner ids. Faces with repeated corners are left out.
    pub triangles: Vec<[u64; 3]>,
    /// Row of each triangle, from `first_row`; only where it was asked for.
    pub rows: Vec<u32>,
    /// Faces left out because a corner repeats or there are fewer than three.
    pub n_degenerate: u64,
    /// Faces left out because of a fault in the file; only with `ReadOptions::skip_bad`.
    pub n_bad: u64,
    /// Bytes of the file as they came; kept for its memory.
    pub scratch: Vec<u8>,
}
