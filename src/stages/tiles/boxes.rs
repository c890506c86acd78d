//! Boxes of triangles: each in the box of its middle, small boxes in a larger neighbour.

use std::collections::BTreeMap;
use stonecut_io::TileMesh;
use stonecut_mesh::Mesh;
use stonecut_store::cells::{BoxKey, Lattice, clamp_below, clamp_to, parent_of};

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

/// Bounds in whole steps.
type Steps = [[i32; 3]; 2];

/// Bounds around nothing.
const NOTHING: Steps = [[i32::MAX; 3], [i32::MIN; 3]];

/// The bounds of the triangles of a tile in each box of the level below, in steps of the tile's own.
pub(super) fn bounds_by_box(tile: &TileMesh) -> Vec<Steps> {
    let mut out: BTreeMap<BoxKey, Steps> = BTreeMap::new();
    // Triangles after each other are mostly in the same box.
    let (mut last, mut bounds) = (None, NOTHING);
    let joined = |a: Steps, b: Steps| {
        [[0, 1, 2].map(|k| a[0][k].min(b[0][k])), [0, 1, 2].map(|k| a[1][k].max(b[1][k]))]
    };
    for t in &tile.triangles {
        let corners = t.map(|v| tile.positions[v as usize]);
        let key = Lattice::box_below(corners);
        if last != Some(key) {
            if let Some(last) = last {
                out.insert(last, bounds);
            }
            (last, bounds) = (Some(key), out.get(&key).copied().unwrap_or(NOTHING));
        }
        corners.iter().for_each(|&p| bounds = joined(bounds, [p, p]));
    }
    if let Some(last) = last {
        out.insert(last, bounds);
    }
    out.into_values().collect()
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
    // Boxes by the order in which they are met; triangles after each other are mostly in the same one.
    let mut numbers: BTreeMap<BoxKey, u32> = BTreeMap::new();
    let mut met: Vec<(BoxKey, u64)> = Vec::new();
    let mut last = 0u32;
    let number_of = |t: usize| {
        let key = place(t);
        if met.get(last as usize).is_none_or(|(old, _)| *old != key) {
            last = *numbers.entry(key).or_insert(met.len() as u32);
            if last as usize == met.len() {
                met.push((key, 0));
            }
        }
        met[last as usize].1 += 1;
        last
    };
    let of_triangle: Vec<u32> = (0..mesh.triangles.len()).map(number_of).collect();
    // The largest box of each family; of equal ones the first.
    let mut largest: BTreeMap<BoxKey, (u64, BoxKey)> = BTreeMap::new();
    for (&key, &number) in &numbers {
        let n = met[number as usize].1;
        let most = largest.entry(family(key)).or_insert((n, key));
        if n > most.0 {
            *most = (n, key);
        }
    }
    let mut counts: BTreeMap<BoxKey, u64> = BTreeMap::new();
    let mut joined: Vec<BoxKey> = Vec::with_capacity(met.len());
    for &(key, n) in &met {
        let is_small = n < tile_triangles / SMALL;
        let key = if is_small { largest[&family(key)].1 } else { key };
        *counts.entry(key).or_default() += n;
        joined.push(key);
    }
    let counts: Vec<(BoxKey, u64)> = counts.into_iter().collect();
    // Where the next triangle of each box goes.
    let mut next: Vec<usize> = Vec::with_capacity(counts.len());
    let mut sum = 0;
    for (_, n) in &counts {
        next.push(sum);
        sum += *n as usize;
    }
    let find = |key| counts.binary_search_by_key(key, |(key, _)| *key).expect("counted above");
    let places: Vec<usize> = joined.iter().map(find).collect();
    let mut order = vec![0u32; sum];
    for (t, number) in (0u32..).zip(&of_triangle) {
        let next = &mut next[places[*number as usize]];
        order[*next] = t;
        *next += 1;
    }
    Boxes { counts, order }
}
