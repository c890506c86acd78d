//! Surfaces whose counts only looking at them tells: an isosurface, scans with holes.
//!
//! Such a surface is cut into blocks of bounded size. Counting every block first gives each block the
//! number of its first vertex; after that any block can be computed alone, like those of an `Indexed`
//! surface. Three looks at everything (count, vertices, faces) cost time, not memory.

use super::surface::{Surface, Vertex};
use rayon::prelude::*;

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

/// A sliced surface with its counts. Memory: 16 bytes a block.
pub(super) struct Counted<S> {
    surface: S,
    first: Vec<[u64; 2]>,
    n_vertices: u64,
    n_faces: u64,
}

impl<S: Sliced> Counted<S> {
    /// Counts all blocks, in parallel.
    pub(super) fn new(surface: S) -> Self {
        let counts: Vec<BlockCounts> =
            (0..surface.n_blocks()).into_par_iter().map(|block| surface.count(block)).collect();
        let (mut n_vertices, mut n_faces) = (0, 0);
        let mut first = Vec::with_capacity(counts.len());
        for count in &counts {
            first.push([n_vertices, n_vertices + count.vertices[0]]);
            n_vertices += count.vertices[0] + count.vertices[1];
            n_faces += count.faces;
        }
        Counted { surface, first, n_vertices, n_faces }
    }

    /// The least member of a family of surfaces, growing with their scale, that has at least
    /// `n_triangles`: tried from scale 1 in steps of 0.4 %.
    pub(super) fn at_least(n_triangles: u64, make: impl Fn(f64) -> S) -> Self {
        let mut scale = 1.0;
        loop {
            let counted = Counted::new(make(scale));
            if counted.n_faces >= n_triangles {
                return counted;
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
        self.first.len() as u64
    }

    fn n_face_blocks(&self) -> u64 {
        self.first.len() as u64
    }

    fn vertices(&self, block: u64, out: &mut Vec<Vertex>) {
        self.surface.vertices(block, out);
    }

    fn faces(&self, block: u64, out: &mut Vec<[u64; 3]>) {
        self.surface.faces(block, &self.first, out);
    }
}
