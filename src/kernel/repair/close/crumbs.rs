//! Drops crumbs: closed components of a few triangles that are too small to be printed.

use crate::surface::Surface;
use crate::vertex::GONE;
use stonecut_mesh::bounds::Bounds;
use stonecut_mesh::union_find::Union;
use stonecut_mesh::vec3::{cross, dot, sub};

/// A component of more triangles is not a crumb.
const MOST_TRIANGLES: usize = 30;
/// A crumb encloses at most the volume of a cube whose side is this share of the least size, if it is not below that itself.
const SIDE: f64 = 0.25;

/// Crumbs that were dropped.
pub(crate) struct Crumbs {
    pub(crate) n: u64,
    pub(crate) triangles: Vec<u32>,
}

/// Drops the components of a few triangles whose box has at most this diagonal or which enclose next to nothing; never the largest
/// one, nor one that is open.
pub(crate) fn drop_crumbs(surface: &mut Surface, size: f64) -> Crumbs {
    let mut crumbs = Crumbs { n: 0, triangles: Vec::new() };
    if size <= 0.0 {
        return crumbs;
    }
    let mut union = Union::new(surface.vertices.len());
    let there = |surface: &Surface, t: u32| surface.triangles[t as usize][0] != GONE;
    let all = 0..surface.triangles.len() as u32;
    let mut triangles: Vec<(u32, u32)> =
        all.filter(|&t| there(surface, t)).map(|t| (surface.triangles[t as usize][0], t)).collect();
    for &(_, t) in &triangles {
        let [a, b, c] = surface.triangles[t as usize];
        union.join(a, b);
        union.join(b, c);
    }
    triangles.iter_mut().for_each(|(root, _)| *root = union.root(*root));
    triangles.sort_unstable();
    let parts = || triangles.chunk_by(|a, b| a.0 == b.0);
    let largest = parts().map(<[_]>::len).max().unwrap_or(0);
    for part in parts().filter(|part| part.len() <= MOST_TRIANGLES && part.len() < largest) {
        let mut bounds = Bounds::EMPTY;
        let corners = |surface: &Surface, t: u32| {
            surface.triangles[t as usize].map(|v| surface.vertices[v as usize].position)
        };
        part.iter().flat_map(|&(_, t)| corners(surface, t)).for_each(|place| bounds.add(place));
        let middle = bounds.middle();
        let volume = |&(_, t): &(u32, u32)| {
            let [a, b, c] = corners(surface, t).map(|place| sub(place, middle));
            dot(a, cross(b, c)) / 6.0
        };
        let volume: f64 = part.iter().map(volume).sum();
        let sides = || {
            let corners = part.iter().map(|&(_, t)| surface.triangles[t as usize]);
            corners.flat_map(|[a, b, c]| [[a, b], [b, c], [c, a]])
        };
        let is_closed = sides().all(|[a, b]| sides().any(|side| side == [b, a]));
        let is_small = bounds.diagonal() <= size || volume.abs() <= (SIDE * size).powi(3);
        if is_closed && is_small {
            crumbs.n += 1;
            crumbs.triangles.extend(part.iter().map(|&(_, t)| t));
        }
    }
    for &t in &crumbs.triangles {
        for v in std::mem::replace(&mut surface.triangles[t as usize], [GONE; 3]) {
            surface.rings[v as usize].len = 0;
        }
    }
    surface.n_alive -= crumbs.triangles.len() as u64;
    crumbs
}
