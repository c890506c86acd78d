//! Surfaces whose counts only looking at them tells: an isosurface, scans with holes.
//!
//! Such a surface is cut into blocks of bounded size. Counting every block first gives each block the
//! number of its first vertex; after that any block can be computed alone, like those of an `Indexed`
//! surface. Three looks at everything (count, vertices, faces) cost time, not memory.

use super::surface::{Surface, Vertex};
use crate::error::Result;
use crate::parallel::in_order;
use crate::progress::Progress;

/// What one block holds.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct BlockCounts {
    /// Vertices of the first and of the second section of the block.
    pub(super) vertices: [u64; 2],
    /// Triangles.
    pub(super) faces: u64,
}

/// A surface in blocks; a block's faces use vertices of its own and of some later blocks.
pub(super) trait Sliced: Sync {
    /// Number of blocks.
    fn n_blocks(&self) -> u64;
    /// Counts one block.
    fn count(&self, block: u64) -> BlockCounts;
    /// Appends the vertices of one block: those of its first section, then those of its second.
    fn vertices(&self, block: u64, out: &mut Vec<Vertex>);
    /// Appends the triangles of one block; `first[b]` are the numbers of the first vertices of both
    /// sections of block b.
    fn faces(&self, block: u64, first: &[[u64; 2]], out: &mut Vec<[u64; 3]>);
}

/// A sliced surface with its counts. Memory: 24 bytes a block.
pub(super) struct Counted<S> {
    surface: S,
    first_vertex: Vec<[u64; 2]>,
    first_face: Vec<u64>,
    n_vertices: u64,
    n_faces: u64,
}

impl<S: Sliced> Counted<S> {
    /// Counts all blocks on `threads` threads.
    pub(super) fn new(surface: S, threads: usize, progress: &Progress) -> Result<Self> {
        let (mut n_vertices, mut n_faces) = (0, 0);
        let (mut first_vertex, mut first_face) = (Vec::new(), Vec::new());
        let count = |block: u64, counts: &mut BlockCounts| {
            *counts = surface.count(block);
            Ok(())
        };
        in_order(surface.n_blocks(), threads, progress, count, |_, counts| {
            first_vertex.push([n_vertices, n_vertices + counts.vertices[0]]);
            first_face.push(n_faces);
            n_vertices += counts.vertices[0] + counts.vertices[1];
            n_faces += counts.faces;
            Ok(())
        })?;
        Ok(Counted { surface, first_vertex, first_face, n_vertices, n_faces })
    }

    /// The least member of a family of surfaces, growing with their scale, that has at least
    /// `n_triangles`: tried from scale 1 in steps of 0.4 %.
    pub(super) fn at_least(
        n_triangles: u64,
        threads: usize,
        progress: &Progress,
        make: impl Fn(f64) -> S,
    ) -> Result<Self> {
        let mut scale = 1.0;
        loop {
            let counted = Counted::new(make(scale), threads, progress)?;
            if counted.n_faces >= n_triangles {
                return Ok(counted);
            }
            scale *= 1.004;
        }
    }
}

impl<S: Sliced> Surface for Counted<S> {
    fn n_vertices(&self) -> u64 {
        self.n_vertices
    }

    fn n_faces(&self) -> u64 {
        self.n_faces
    }

    fn n_vertex_blocks(&self) -> u64 {
        self.first_face.len() as u64
    }

    fn n_face_blocks(&self) -> u64 {
        self.first_face.len() as u64
    }

    fn first_face(&self, block: u64) -> u64 {
        self.first_face[block as usize]
    }

    fn vertices(&self, block: u64, out: &mut Vec<Vertex>) {
        self.surface.vertices(block, out);
    }

    fn faces(&self, block: u64, out: &mut Vec<[u64; 3]>) {
        self.surface.faces(block, &self.first_vertex, out);
    }
}
