//! A piece of the input that is simplified before the run: for its pace, and for the triangles that a bound leaves.

use crate::config::Config;
use crate::io::ply::{FaceBlock, MeshSource};
use crate::kernel::{self, Options, Stop};
use crate::mesh::Mesh;
use std::collections::HashMap;

/// Triangles of a piece at most.
pub(super) const PIECE: usize = 40_000;
/// The same within a bound, where a triangle takes ten times as long.
const BOUNDED_PIECE: usize = 10_000;
/// A piece with more vertices a triangle is in pieces itself, and says nothing. Raw marching cubes of 1.5 to 2.7 million triangles,
/// in the order of their slices, have 0.64 to 0.66, and faces in no order 2.
const LOOSE: f64 = 0.8;
/// Inputs with fewer triangles are not worth a look at what a bound leaves of them.
const BOUNDED_FROM: u64 = 100_000;

/// The first triangles of a block of faces, at most `most`, as a mesh; `None` where they are few, do not hang together, or cannot be
/// read.
pub(super) fn piece(source: &MeshSource, block: u64, most: usize) -> Option<Mesh> {
    if block >= source.n_face_blocks() || !source.has_even_vertices() {
        return None;
    }
    let mut faces = FaceBlock::default();
    source.read_faces(block, &mut faces).ok()?;
    let mut lookup = source.positions().ok()?;
    let mut mesh = Mesh::default();
    let mut known = HashMap::new();
    for corners in faces.triangles.iter().take(most) {
        let mut place = |vertex: u64| {
            let next = known.len() as u32;
            let id = *known.entry(vertex).or_insert(next);
            if id == next {
                mesh.positions.push(lookup.position(vertex).ok()?);
            }
            Some(id)
        };
        let &[a, b, c] = corners;
        let triangle = [place(a)?, place(b)?, place(c)?];
        mesh.triangles.push(triangle);
    }
    let n = mesh.triangles.len();
    let is_whole = n >= most / 4 && mesh.positions.len() as f64 <= LOOSE * n as f64;
    is_whole.then_some(mesh)
}

/// Share of its triangles that the bound of a run leaves of a piece from the middle, about.
pub(super) fn share_within_bound(source: &MeshSource, config: &Config) -> Option<f64> {
    let bound = config.kernel.bound.filter(|_| source.n_triangles() >= BOUNDED_FROM)?;
    let mesh = piece(source, source.n_face_blocks() / 2, BOUNDED_PIECE)?;
    let n = mesh.triangles.len() as f64;
    let options = Options { stop: Stop::Triangles(0), bound: Some(bound), ..Options::default() };
    let locked = vec![false; mesh.positions.len()];
    let left = kernel::simplify_mesh(mesh, &locked, &options).mesh.triangles.len();
    Some(left as f64 / n)
}
