//! From vertices back to faces: texture coordinates to corners, values to the triangles between them.
//!
//! The properties that `io::faces_to_vertices` has put behind a vertex's own are taken off again. A
//! triangle has the mean of its corners; where they are of one region they agree.

use super::numbering::encode;
use stonecut_io::ply::FaceSchema;
use stonecut_mesh::face_properties::{FaceMixer, FacePropertyPlan};
use stonecut_mesh::property::Property;
use stonecut_mesh::record::VertexSchema;
use stonecut_store::cells::{SurvivorPack, Survivors};

/// Plan of turning properties of vertices into those of faces.
pub(super) struct BackToFaces<'a> {
    carry: &'a FacePropertyPlan,
    /// Properties of the faces of the output.
    pub(super) schema: FaceSchema,
    /// Number of the vertices' last properties that go to the faces.
    pub(super) n_properties: usize,
    /// Bytes of these, and of those that are values of faces.
    tail_bytes: usize,
    value_bytes: usize,
}

/// Properties of some triangles.
pub(super) struct Faces {
    pub(super) texture: Vec<[[f32; 2]; 3]>,
    /// Packed as the schema says.
    pub(super) values: Vec<u8>,
}

impl BackToFaces<'_> {
    /// `goes_back` is false where everything that went to vertices stays there, for writers that take none of it.
    pub(super) fn new<'a>(
        schema: &VertexSchema,
        carry: &'a FacePropertyPlan,
        goes_back: bool,
    ) -> BackToFaces<'a> {
        let stays = carry.is_moved() && !goes_back;
        let n_properties = if stays { 0 } else { carry.vertex_properties().len() };
        let tail = &schema.properties[schema.properties.len() - n_properties..];
        let bytes = |list: &[Property]| list.iter().map(|p| p.scalar.bytes()).sum::<usize>();
        let properties = carry.written().map(|p| p.property.clone()).filter(|_| !stays).collect();
        BackToFaces {
            carry,
            schema: FaceSchema { texture: carry.texture && !stays, properties },
            n_properties,
            tail_bytes: bytes(tail),
            value_bytes: FaceMixer::new(carry).value_bytes(),
        }
    }

    /// Takes the vertices of a cell. Memory: what they get from faces.
    pub(super) fn of_cell(&self, result: &SurvivorPack, part: &Survivors) -> CellFaces<'_> {
        let (mut tails, mut encoded) = (Vec::new(), Vec::new());
        for vertex in (0..part.ids.len()).filter(|_| self.tail_bytes > 0) {
            encoded.clear();
            encode(result, part, vertex, &mut encoded);
            tails.extend_from_slice(&encoded[encoded.len() - self.tail_bytes..]);
        }
        CellFaces { back: self, tails, mixer: FaceMixer::new(self.carry) }
    }
}

/// The vertices of a cell with the values that its faces need.
pub(super) struct CellFaces<'a> {
    back: &'a BackToFaces<'a>,
    /// `tail_bytes` a vertex.
    tails: Vec<u8>,
    mixer: FaceMixer,
}

impl CellFaces<'_> {
    /// Returns the properties of triangles of the cell.
    pub(super) fn faces(&mut self, triangles: &[[u32; 3]]) -> Faces {
        let back = self.back;
        let mut out = Faces { texture: vec![[[0.0; 2]; 3]; triangles.len()], values: Vec::new() };
        let mut moved = Vec::new();
        for (t, texture) in triangles.iter().zip(&mut out.texture) {
            let tails = t.map(|v| &self.tails[v as usize * back.tail_bytes..][..back.tail_bytes]);
            if back.schema.texture {
                *texture = tails.map(|tail| {
                    let words = tail[back.value_bytes..].as_chunks::<4>().0;
                    [0, 1].map(|i| words.get(i).map_or(0.0, |&bytes| f32::from_le_bytes(bytes)))
                });
            }
            moved.clear();
            if back.value_bytes > 0 {
                self.mixer.of_corners(tails, &mut moved);
            }
            back.carry.unpack(&moved, &mut out.values);
        }
        out
    }
}
