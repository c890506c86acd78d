//! Triangles at hubs, as these see them: boxes in space of triangles with a common corner all touch.
//!
//! A hub is a vertex of too many triangles to be moved or to take another one in, so it stays where it is while others
//! come and go around it. Triangles that have it no longer go back to the tree of all others.

use super::tree::{Hull, Tree};
use crate::simd::Portable;
use crate::surface::Surface;
use crate::vertex::GONE;
use std::collections::HashMap;
use stonecut_mesh::bounds::Bounds;
use stonecut_mesh::morton::spread;
use stonecut_mesh::sight::{Faces, seen_of};
use stonecut_mesh::steps::{self, count};
use stonecut_mesh::vec3::{Vec3, sub};

/// A triangle's corners.
type Corners = [Vec3; 3];

/// Hubs, and the hub and place of each of their triangles.
#[derive(Clone, Default)]
pub(super) struct Hubs {
    all: Vec<Hub>,
    places: HashMap<u32, (u32, u32)>,
    found: Vec<u32>,
}

/// The triangles of a hub. About 180 bytes for each.
#[derive(Clone)]
struct Hub {
    vertex: u32,
    eye: Vec3,
    triangles: Vec<u32>,
    /// Boxes of their images on each face.
    faces: [Tree; 6],
    /// The box of all.
    hull: Hull,
}

/// The direction of a triangle's middle from a place, as a number by which neighbours are mostly near each other.
fn order(eye: Vec3, corners: &Corners) -> u32 {
    let off = corners.iter().fold([0.0; 3], |sum: Vec3, p| {
        let off = sub(*p, eye);
        [0, 1, 2].map(|k| sum[k] + off[k])
    });
    let far = off.iter().fold(f64::MIN_POSITIVE, |far, x| far.max(x.abs()));
    let at = off.map(|x| spread(((x / far + 1.0) * 511.0) as u32));
    at[0] | at[1] << 1 | at[2] << 2
}

fn hull_of(tree: &Tree, bounds: &Bounds) -> Hull {
    if bounds.is_empty() { Hull::EMPTY } else { tree.hull(&[bounds.low, bounds.high]) }
}

impl Hubs {
    /// Finds the hubs of a surface; `space` gives boxes in space.
    pub(super) fn of(surface: &Surface, space: &Tree) -> Hubs {
        let mut hubs = Hubs::default();
        if surface.rings.iter().all(|ring| ring.len as usize <= steps::HUB) {
            return hubs;
        }
        let mut n_around = vec![0u32; surface.vertices.len()];
        let alive = || surface.triangles.iter().zip(0u32..).filter(|(t, _)| t[0] != GONE);
        alive().flat_map(|(t, _)| t).for_each(|&v| n_around[v as usize] += 1);
        let is_hub = |v: &&u32| n_around[**v as usize] as usize > steps::HUB;
        let mut of_hub: HashMap<u32, Vec<u32>> = HashMap::new();
        for (corners, t) in alive() {
            if let Some(&hub) = corners.iter().filter(is_hub).min() {
                of_hub.entry(hub).or_default().push(t);
            }
        }
        let mut sorted: Vec<(u32, Vec<u32>)> = of_hub.into_iter().collect();
        sorted.sort_unstable();
        for (vertex, mut triangles) in sorted {
            let eye = surface.vertices[vertex as usize].position;
            triangles.sort_by_cached_key(|&t| order(eye, &corners(surface, t)));
            let mut faces: [Tree; 6] = std::array::from_fn(|_| Tree::new([0.0; 3]));
            let mut hull = Hull::EMPTY;
            for (&t, place) in triangles.iter().zip(0u32..) {
                let own = corners(surface, t);
                for (tree, bounds) in faces.iter_mut().zip(&seen_of(eye, &own)) {
                    tree.push(hull_of(tree, bounds));
                }
                hull.join(&space.hull(&own));
                hubs.places.insert(t, (hubs.all.len() as u32, place));
            }
            hubs.all.push(Hub { vertex, eye, triangles, faces, hull });
        }
        hubs
    }

    /// Memory that they hold, in bytes.
    pub(super) fn bytes(&self) -> u64 {
        let trees = self.all.iter().flat_map(|hub| &hub.faces).map(Tree::bytes);
        trees.sum::<u64>() + 24 * self.places.len() as u64
    }

    /// True without hubs.
    pub(super) fn are_none(&self) -> bool {
        self.all.is_empty()
    }

    /// The triangles of hubs.
    pub(super) fn triangles(&self) -> impl Iterator<Item = u32> {
        self.places.keys().copied()
    }

    /// Takes over where a triangle of a hub is now; false if it is not of that hub any longer, or of none.
    pub(super) fn moved(&mut self, surface: &Surface, space: &Tree, t: u32) -> bool {
        let Some(&(number, place)) = self.places.get(&t) else { return false };
        let hub = &mut self.all[number as usize];
        let triangle = surface.triangles[t as usize];
        let is_there = surface.vertices[hub.vertex as usize].position == hub.eye;
        if triangle[0] == GONE || !triangle.contains(&hub.vertex) || !is_there {
            hub.faces.iter_mut().for_each(|tree| tree.set(place, Hull::EMPTY));
            self.places.remove(&t);
            return false;
        }
        let own = corners(surface, t);
        for (tree, bounds) in hub.faces.iter_mut().zip(&seen_of(hub.eye, &own)) {
            tree.set(place, hull_of(tree, bounds));
        }
        hub.hull.join(&space.hull(&own));
        true
    }

    /// Calls `visit` for the numbers of some triangles and for those of hubs that these may meet, until it says that it is enough.
    ///
    /// `whole` is the box of the former, `space` gives boxes in space.
    pub(super) fn near<'a>(
        &mut self,
        surface: &Surface,
        (own, whole): (impl Iterator<Item = &'a Corners> + Clone, &Hull),
        mut visit: impl FnMut(usize, u32) -> bool,
    ) {
        let Hubs { all, found, .. } = self;
        for hub in all.iter_mut().filter(|hub| hub.hull.touches(whole)) {
            for (number, corners_of_own) in own.clone().enumerate() {
                let faces = seen_of(hub.eye, corners_of_own);
                for (face, seen) in faces.iter().enumerate() {
                    let tree = &mut hub.faces[face];
                    let hull = hull_of(tree, seen);
                    tree.touching::<Portable>(&hull, found);
                    count(found.len());
                    for &place in found.iter() {
                        let t = hub.triangles[place as usize];
                        if is_first(surface, (hub.eye, t), &faces, face) && visit(number, t) {
                            return;
                        }
                    }
                }
            }
        }
    }
}

/// True if what is seen of a triangle touches another one on this face, and on none before it. Boxes in trees are rounded.
fn is_first(surface: &Surface, (eye, t): (Vec3, u32), other: &Faces, face: usize) -> bool {
    if surface.triangles[t as usize][0] == GONE {
        return false;
    }
    let own = seen_of(eye, &corners(surface, t));
    (0..=face).find(|&face| own[face].touches(&other[face])) == Some(face)
}

fn corners(surface: &Surface, t: u32) -> Corners {
    surface.triangles[t as usize].map(|v| surface.vertices[v as usize].position)
}
