//! Streams a surface: blocks computed in parallel, handed on in order as PLY records.
//!
//! Memory is a few blocks a thread, whatever the mesh's size. The bytes depend on the surface alone: a
//! block's place in the file is fixed before any thread begins.

use super::surface::{Surface, Vertex};
use stonecut_io::MeshSink;
use stonecut_io::ply::{FaceSchema, TexturedTriangle};
use stonecut_mesh::property::{Property, Scalar};
use stonecut_mesh::record::VertexSchema;
use stonecut_system::error::Result;
use stonecut_system::parallel::in_order;
use stonecut_system::progress::Progress;

/// Properties of a vertex in the file, besides its position in floats.
#[derive(Clone, Copy, Debug)]
pub(super) struct FileProperties {
    /// `uchar red green blue` after the position.
    pub(super) color: bool,
    /// `float s t` after the colour.
    pub(super) uv: bool,
    /// `uint left right` at faces: the regions behind and in front of each.
    pub(super) labels: bool,
}

impl FileProperties {
    /// The layout for the writer.
    pub(super) fn schema(&self) -> VertexSchema {
        let property = Property::new;
        let mut properties = Vec::new();
        if self.color {
            properties.extend(["red", "green", "blue"].map(|name| property(name, Scalar::U8)));
        }
        if self.uv {
            properties.extend(["s", "t"].map(|name| property(name, Scalar::F32)));
        }
        VertexSchema { coordinate: Scalar::F32, properties }
    }

    /// The properties of faces.
    pub(super) fn faces(&self) -> FaceSchema {
        let names = ["left", "right"].into_iter().filter(|_| self.labels);
        let properties = names.map(|name| Property::new(name, Scalar::U32)).collect();
        FaceSchema { texture: false, properties }
    }

    /// Appends one vertex record.
    fn put_vertex(&self, vertex: &Vertex, out: &mut Vec<u8>) {
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
}

/// Settings of streaming a surface.
#[derive(Clone, Copy)]
pub(super) struct Stream<'a> {
    /// The surface that is written.
    pub(super) surface: &'a dyn Surface,
    /// As which records.
    pub(super) layout: FileProperties,
    /// Number of threads.
    pub(super) threads: usize,
    /// Counts faces, and may ask to stop.
    pub(super) progress: &'a Progress,
}

/// A block under way, and the memory it is made in.
#[derive(Default)]
struct Block<T, U> {
    rows: Vec<T>,
    encoded: Vec<U>,
    labels: Vec<[u32; 2]>,
}

/// Appends faces, with their labels if there are any.
pub(super) fn put_faces(
    file: &mut MeshSink,
    faces: &[[u32; 3]],
    labels: &[[u32; 2]],
) -> Result<()> {
    if labels.is_empty() {
        return file.write_faces_u32(faces);
    }
    let full = faces.iter().map(|face| {
        let corners = face.map(u64::from);
        TexturedTriangle { corners, ..TexturedTriangle::default() }
    });
    let values: Vec<u8> = labels.as_flattened().iter().flat_map(|v| v.to_le_bytes()).collect();
    file.write_full_faces(&full.collect::<Vec<_>>(), &values)
}

impl Stream<'_> {
    /// Encodes all vertices, block after block, into `sink`.
    pub(super) fn vertices(&self, mut sink: impl FnMut(&[u8]) -> Result<()>) -> Result<()> {
        let produce = |index: u64, block: &mut Block<Vertex, u8>| {
            block.rows.clear();
            block.encoded.clear();
            self.surface.vertices(index, &mut block.rows);
            block.rows.iter().for_each(|v| self.layout.put_vertex(v, &mut block.encoded));
            Ok(())
        };
        let n_blocks = self.surface.n_vertex_blocks();
        in_order(n_blocks, self.threads, self.progress, produce, |_, block| sink(&block.encoded))
    }

    /// Hands all faces with their labels, block after block, to `sink`; counts them as progress. `renumber` gives the
    /// corners of each face their final numbers, knowing the face's row.
    pub(super) fn faces(
        &self,
        renumber: impl Fn(u64, [u64; 3]) -> [u64; 3] + Sync,
        mut sink: impl FnMut(&[[u32; 3]], &[[u32; 2]]) -> Result<()>,
    ) -> Result<()> {
        let produce = |index: u64, block: &mut Block<[u64; 3], [u32; 3]>| {
            block.rows.clear();
            block.encoded.clear();
            block.labels.clear();
            self.surface.faces(index, &mut block.rows);
            self.surface.labels(index, &mut block.labels);
            let first = self.surface.first_face(index);
            // Ids are below 2^32: larger meshes are refused before anything is made.
            let renumbered = (first..).zip(&block.rows).map(|(row, face)| renumber(row, *face));
            block.encoded.extend(renumbered.map(|face| face.map(|id| id as u32)));
            Ok(())
        };
        let n_blocks = self.surface.n_face_blocks();
        in_order(n_blocks, self.threads, self.progress, produce, |_, block| {
            self.progress.add(block.rows.len() as u64);
            sink(&block.encoded, &block.labels)
        })
    }
}
