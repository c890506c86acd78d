//! Surfaces whose counts only looking at them tells: an isosurface, scans with holes.
//!
//! Such a surface is cut into blocks of bounded size. Counting every block first gives each block the
//! number of its first vertex; after that any block can be computed alone, like those of an `Indexed`
//! surface. Three looks at everything (count, vertices, faces) cost time, not memory.

use super::surface::{Surface, Vertex};
use stonecut_system::error::Result;
use stonecut_system::parallel::in_order;
use stonecut_system::progress::Progress;

/// Counts of one block.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct BlockCounts {
    /// Vertices of the first and of the second section of the block.
    pub(super) vertices: [u64; 2],
    /// Triangles.
    pub(super) faces: u64,
}

/// A surface in blocks; a block's faces use vertices of that block and of blocks near it.
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
    /// Appends the regions behind and in front of each of these triangles, if the surface has regions.
    fn labels(&self, _block: u64, _out: &mut Vec<[u32; 2]>) {}
}

/// A sliced surface with its counts. Memory: 24 bytes a block.
pub(super) struct CountedSurface<S> {
    surface: S,
    first_vertex: Vec<[u64; 2]>,
    first_face: Vec<u64>,
    n_vertices: u64,
    n_faces: u64,
}

impl<S: Sliced> CountedSurface<S> {
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
        Ok(CountedSurface { surface, first_vertex, first_face, n_vertices, n_faces })
    }

    /// Returns the surface that was counted.
    pub(super) fn surface(&self) -> &S {
        &self.surface
    }

    /// Number of a block's first vertex.
    pub(super) fn first_vertex(&self, block: u64) -> u64 {
        self.first_vertex[block as usize][0]
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
            let counted = CountedSurface::new(make(scale), threads, progress)?;
            if counted.n_faces >= n_triangles {
                return Ok(counted);
            }
            scale *= 1.004;
        }
    }

    /// A member of a family whose counts grow with the cube of the scale that has at least `n_triangles` and
    /// less than 2 % more; above 10^5 triangles found in two or three tries, whatever the family's settings.
    pub(super) fn near(
        n_triangles: u64,
        threads: usize,
        progress: &Progress,
        make: impl Fn(f64) -> S,
    ) -> Result<Self> {
        let wanted = n_triangles as f64;
        let mut scale = 1.0;
        // Few triangles come in leaps; then the best of the tries is taken.
        let mut best: Option<Self> = None;
        for _ in 0..12 {
            let counted = CountedSurface::new(make(scale), threads, progress)?;
            let n_faces = counted.n_faces;
            if n_faces >= n_triangles && best.as_ref().is_none_or(|b| n_faces < b.n_faces) {
                best = Some(counted);
            }
            if best.as_ref().is_some_and(|b| (b.n_faces as f64) < 1.02 * wanted) {
                break;
            }
            // `cbrt` of the library may differ between machines; two steps of Newton's from 1 suffice.
            let ratio = (1.006 * wanted / n_faces.max(1) as f64).clamp(0.1, 10.0);
            let root = (0..2).fold(1.0, |x: f64, _| x - (x * x * x - ratio) / (3.0 * x * x));
            scale *= root;
        }
        match best {
            Some(best) => Ok(best),
            None => {
                CountedSurface::at_least(n_triangles, threads, progress, |more| make(scale * more))
            }
        }
    }
}

impl<S: Sliced> Surface for CountedSurface<S> {
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

    fn labels(&self, block: u64, out: &mut Vec<[u32; 2]>) {
        self.surface.labels(block, out);
    }
}
