//! Boxes of triangles: each in the box of its middle, small boxes in a larger neighbour.

use crate::mesh::Mesh;
use crate::store::cells::{BoxKey, Lattice, clamp_below, clamp_to, parent_of};
use std::collections::BTreeMap;

/// A box with less than this share of a full tile joins a neighbour.
const SMALL: u64 = 16;

/// Triangles put in order of boxes.
#[derive(Default)]
pub(super) struct Boxes {
    /// The boxes with the number of their triangles, sorted.
    pub(super) counts: Vec<(BoxKey, u64)>,
    /// Numbers of the triangles, box by box, in their order within a box.
    pub(super) order: Vec<u32>,
}

/// The boxes of level `round` of what is left of `group`, small ones joined within the group.
pub(super) fn of_parts(
    mesh: &Mesh,
    lattice: &Lattice,
    (round, group): (u32, BoxKey),
    tile_triangles: u64,
) -> Boxes {
    let place = |t| clamp_to(group, lattice.box_of(round, middle(mesh, t)));
    boxes(mesh, place, |_| [0; 3], tile_triangles)
}

/// The boxes of level 0 of a group of the first round, small ones joined within the box of level 1.
pub(super) fn of_leaves(
    mesh: &Mesh,
    lattice: &Lattice,
    group: BoxKey,
    tile_triangles: u64,
) -> Boxes {
    let place = |t| clamp_below(group, lattice.box_of(0, middle(mesh, t)));
    boxes(mesh, place, parent_of, tile_triangles)
}

fn middle(mesh: &Mesh, triangle: usize) -> [f64; 3] {
    let [a, b, c] = mesh.corners(triangle);
    [0, 1, 2].map(|k| (a[k] + b[k] + c[k]) / 3.0)
}

fn boxes(
    mesh: &Mesh,
    place: impl Fn(usize) -> BoxKey,
    family: impl Fn(BoxKey) -> BoxKey,
    tile_triangles: u64,
) -> Boxes {
    let mut keys: Vec<BoxKey> = (0..mesh.triangles.len()).map(place).collect();
    let mut counts: BTreeMap<BoxKey, u64> = BTreeMap::new();
    keys.iter().for_each(|key| *counts.entry(*key).or_default() += 1);
    // The largest box of each family; of equal ones the first.
    let mut largest: BTreeMap<BoxKey, (u64, BoxKey)> = BTreeMap::new();
    for (&key, &n) in &counts {
        let most = largest.entry(family(key)).or_insert((n, key));
        if n > most.0 {
            *most = (n, key);
        }
    }
    let joined = |key: BoxKey| match counts[&key] < tile_triangles / SMALL {
        true => largest[&family(key)].1,
        false => key,
    };
    let mut last = None;
    for key in &mut keys {
        let (_, new) = last.filter(|(old, _)| old == key).unwrap_or_else(|| (*key, joined(*key)));
        last = Some((*key, new));
        *key = new;
    }
    let mut order: Vec<u32> = (0..keys.len() as u32).collect();
    order.sort_by_key(|&t| keys[t as usize]);
    let runs = order.chunk_by(|a, b| keys[*a as usize] == keys[*b as usize]);
    let counts = runs.map(|run| (keys[run[0] as usize], run.len() as u64)).collect();
    Boxes { counts, order }
}
