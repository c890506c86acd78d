//! A synthetic mesh as its writer sees it: blocks of vertices and blocks of faces, each computable alone.
//!
//! `Indexed` surfaces know every vertex and face by its number, so their blocks are plain ranges, and a
//! shuffled mesh is the same surface read through a permutation. `Sliced` ones (sliced.rs) have counts
//! that only looking at them tells.

use super::noise::hash2;
use super::permutation::Permutation;
use std::ops::Range;
use stonecut_mesh::vec3::length_sq;

/// Rows in a block, where a surface does not say otherwise: large enough to amortise a thread's start, small enough that
/// some dozen of them are nothing against any memory budget.
const BLOCK_ROWS: u64 = 65_536;

/// A direction with length 1; that of a point is 0.
pub(super) fn unit_vector(v: [f64; 3]) -> [f64; 3] {
    let length = length_sq(v).sqrt().max(1e-12);
    v.map(|x| x / length)
}

/// One vertex as it is written.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Vertex {
    /// Position in input units.
    pub(super) position: [f32; 3],
    /// Red, green, blue; left at 0 without `--color`.
    pub(super) color: [u8; 3],
    /// Texture coordinates in [0, 1].
    pub(super) uv: [f32; 2],
}

/// A mesh given block by block; every block may be asked for alone and by any thread.
pub(super) trait Surface: Sync {
    /// Number of vertices.
    fn n_vertices(&self) -> u64;
    /// Number of triangles.
    fn n_faces(&self) -> u64;
    /// Number of vertex blocks; the blocks in order are all vertices in order.
    fn n_vertex_blocks(&self) -> u64 {
        self.n_vertices().div_ceil(BLOCK_ROWS)
    }
    /// Number of face blocks.
    fn n_face_blocks(&self) -> u64 {
        self.n_faces().div_ceil(BLOCK_ROWS)
    }
    /// Number of the first face of a block.
    fn first_face(&self, block: u64) -> u64 {
        block * BLOCK_ROWS
    }
    /// Appends the vertices of one block.
    fn vertices(&self, block: u64, out: &mut Vec<Vertex>);
    /// Appends the triangles of one block.
    fn faces(&self, block: u64, out: &mut Vec<[u64; 3]>);
    /// Appends the regions behind and in front of each of these triangles, if the surface has regions.
    fn labels(&self, _block: u64, _out: &mut Vec<[u32; 2]>) {}
    /// Returns whether the order is already the one asked for with `--shuffle`.
    fn is_shuffled(&self) -> bool {
        false
    }
}

/// A mesh whose vertices and faces are closed-form functions of their numbers.
pub(super) trait Indexed: Sync {
    /// Number of vertices.
    fn n_vertices(&self) -> u64;
    /// Number of triangles.
    fn n_faces(&self) -> u64;
    /// One vertex.
    fn vertex(&self, id: u64) -> Vertex;
    /// The corners of one triangle, counter-clockwise seen from outside.
    fn face(&self, row: u64) -> [u64; 3];
}

/// An indexed surface in its natural order: row by row, as a scanner writes it.
pub(super) struct InOrder<S>(pub(super) S);

impl<S: Indexed> Surface for InOrder<S> {
    fn n_vertices(&self) -> u64 {
        self.0.n_vertices()
    }

    fn n_faces(&self) -> u64 {
        self.0.n_faces()
    }

    fn vertices(&self, block: u64, out: &mut Vec<Vertex>) {
        out.extend(rows(block, self.n_vertices()).map(|id| self.0.vertex(id)));
    }

    fn faces(&self, block: u64, out: &mut Vec<[u64; 3]>) {
        out.extend(rows(block, self.n_faces()).map(|row| self.0.face(row)));
    }
}

/// An indexed surface in random order: vertices, faces and the first corner of each face.
pub(super) struct Shuffled<S> {
    surface: S,
    order: Order,
}

impl<S: Indexed> Shuffled<S> {
    /// The surface in the order that belongs to `seed`.
    pub(super) fn new(surface: S, seed: u64) -> Self {
        let order = Order::new(surface.n_vertices(), surface.n_faces(), seed);
        Shuffled { surface, order }
    }
}

impl<S: Indexed> Surface for Shuffled<S> {
    fn n_vertices(&self) -> u64 {
        self.surface.n_vertices()
    }

    fn n_faces(&self) -> u64 {
        self.surface.n_faces()
    }

    fn vertices(&self, block: u64, out: &mut Vec<Vertex>) {
        let ids = rows(block, self.n_vertices()).map(|at| self.order.vertices.invert(at));
        out.extend(ids.map(|id| self.surface.vertex(id)));
    }

    fn faces(&self, block: u64, out: &mut Vec<[u64; 3]>) {
        let faces = rows(block, self.n_faces()).map(|at| self.order.faces.invert(at));
        out.extend(faces.map(|row| self.order.renumber(row, self.surface.face(row))));
    }

    fn is_shuffled(&self) -> bool {
        true
    }
}

/// The random order of a shuffled mesh.
pub(super) struct Order {
    /// From a vertex to its place.
    pub(super) vertices: Permutation,
    /// From a face to its place.
    pub(super) faces: Permutation,
    seed: u64,
}

impl Order {
    /// The order that belongs to `seed`.
    pub(super) fn new(n_vertices: u64, n_faces: u64, seed: u64) -> Self {
        Order {
            vertices: Permutation::new(n_vertices, hash2(1, seed)),
            faces: Permutation::new(n_faces, hash2(2, seed)),
            seed: hash2(3, seed),
        }
    }

    /// The corners of face `row` under their new numbers, turned by a random third of a circle.
    pub(super) fn renumber(&self, row: u64, corners: [u64; 3]) -> [u64; 3] {
        let mut corners = corners.map(|id| self.vertices.apply(id));
        corners.rotate_left(self.turn(row));
        corners
    }

    /// The corner of face `row` that comes first.
    pub(super) fn turn(&self, row: u64) -> usize {
        (hash2(row, self.seed) % 3) as usize
    }
}

fn rows(block: u64, n_rows: u64) -> Range<u64> {
    block * BLOCK_ROWS..((block + 1) * BLOCK_ROWS).min(n_rows)
}
