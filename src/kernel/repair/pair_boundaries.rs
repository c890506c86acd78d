//! Moves boundaries that lie near each other onto each other: Garland & Heckbert's pairs of vertices that no
//! edge joins, restricted to open boundaries.
//!
//! Only if a distance is given, and before boundaries are joined: two free boundary vertices that are each
//! other's nearest meet in their middle, and vertices that have no partner between two that have are cut off by
//! triangles, so that the same edges run on both sides; `make_manifold` or `weld` then join them. Vertices of
//! different components may meet across the whole distance, those of one component across no more than their
//! shortest open edge, lest a boundary be pinched. Locked vertices never move and are never paired.
//!
//! Source: Garland & Heckbert 1997 (docs/references.md).

use std::collections::{BTreeMap, BTreeSet};

use crate::options::Placement;
use crate::simd::Simd;
use crate::state::MeshState;
use crate::surface::Surface;
use crate::surface::class::Class;
use crate::surface::fan::Fan;
use crate::topology::components::components;
use stonecut_mesh::corners::others;
use stonecut_mesh::vec3::{Vec3, add, length_sq, scale, sub};

/// No gap is bridged that is wider than this many mean open edges: boundaries are lines, so this bounds how
/// many vertices are near one.
const MOST_EDGES: f64 = 16.0;

/// Moves vertices in pairs; gives back how many pairs. `distance` in input units.
pub(crate) fn pair_boundaries(state: &mut MeshState, distance: f64, simd: Simd) -> u64 {
    let surface = &mut state.surface;
    let shortest = open_edges(surface);
    let mean = shortest.values().sum::<f64>() / shortest.len().max(1) as f64;
    let reach = distance.min(MOST_EDGES * mean);
    if !(reach > 0.0 && reach.is_finite()) {
        return 0;
    }
    let component = components(surface);
    let place = |v: u32| surface.vertices[v as usize].position;
    let key = |p: Vec3| p.map(|x| (x / reach).floor() as i64);
    let mut cells: BTreeMap<[i64; 3], Vec<u32>> = BTreeMap::new();
    for &v in shortest.keys() {
        cells.entry(key(place(v))).or_default().push(v);
    }
    // The nearest of each, between equals the least.
    let mut nearest: BTreeMap<u32, (f64, u32)> = BTreeMap::new();
    for (&v, &edge) in &shortest {
        let at = key(place(v));
        let mut best = (f64::INFINITY, u32::MAX);
        for step in 0..27 {
            let near = [step % 3, step / 3 % 3, step / 9];
            let cell: [i64; 3] = std::array::from_fn(|k| at[k].saturating_add(near[k] - 1));
            for &w in cells.get(&cell).into_iter().flatten().filter(|&&w| w != v) {
                let apart = length_sq(sub(place(w), place(v))).sqrt();
                let limit = match component[v as usize] == component[w as usize] {
                    true => reach.min(edge).min(shortest[&w]),
                    false => reach,
                };
                if apart <= limit && (apart, w) < best && !are_close_by_edges(surface, v, w) {
                    best = (apart, w);
                }
            }
        }
        if best.1 != u32::MAX {
            nearest.insert(v, best);
        }
    }
    let mut partner = BTreeMap::new();
    for (&v, &(apart, w)) in &nearest {
        if v < w && apart > 0.0 && nearest.get(&w).is_some_and(|&(_, back)| back == v) {
            let (p, q) =
                (surface.vertices[v as usize].position, surface.vertices[w as usize].position);
            let middle = match surface.placement {
                Placement::Subset => p,
                _ => add(p, scale(sub(q, p), 0.5)),
            };
            surface.vertices[v as usize].position = middle;
            surface.vertices[w as usize].position = middle;
            partner.extend([(v, w), (w, v)]);
        }
    }
    if partner.is_empty() {
        return 0;
    }
    fill(surface, &partner);
    state.compact(simd);
    partner.len() as u64 / 2
}

/// Fills with triangles what lies between the boundary and the straight edge from one vertex with a partner to
/// the next, where the partners follow each other, too.
///
/// Sides that are there already, or that another filling makes, are not made again.
fn fill(surface: &mut Surface, partner: &BTreeMap<u32, u32>) {
    let mut filled = Vec::new();
    let mut made = BTreeSet::new();
    for (&v, &w) in partner {
        let Some(path) = to_next(surface, partner, v) else { continue };
        let last = path[path.len() - 1];
        let Some(&opposite) = partner.get(&last) else { continue };
        let back = to_next(surface, partner, opposite);
        let faces = back.is_some_and(|back| back.last() == Some(&w));
        let is_edge =
            |w: u32| surface.ring(v).iter().any(|&t| surface.triangles[t as usize].contains(&w));
        if !faces || path[1..].contains(&v) || path[2..].iter().any(|&w| is_edge(w)) {
            continue;
        }
        let fan: Vec<[u32; 3]> = path[1..].windows(2).map(|pair| [v, pair[1], pair[0]]).collect();
        let sides = || fan.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]);
        // Another filling may have the same straight edge, from the other side.
        let is_free = |side: [u32; 2]| {
            !made.contains(&side) && (side == [v, last] || !made.contains(&[side[1], side[0]]))
        };
        let distinct: BTreeSet<[u32; 2]> = sides().collect();
        if distinct.len() == 3 * fan.len() && sides().all(is_free) {
            made.extend(sides());
            filled.extend(fan);
        }
    }
    surface.n_alive += filled.len() as u64;
    surface.triangles.extend(filled);
}

/// The boundary from a vertex up to the next one that has a partner, both included; `None` if that is far.
fn to_next(surface: &Surface, partner: &BTreeMap<u32, u32>, v: u32) -> Option<Vec<u32>> {
    let mut path = vec![v];
    while path.len() <= MOST_EDGES as usize {
        let at = path[path.len() - 1];
        if path.len() > 1 && partner.contains_key(&at) {
            return Some(path);
        }
        let around = || surface.ring(at).iter().map(|&t| others(surface.triangles[t as usize], at));
        path.push(around().map(|(b, _)| b).find(|&b| around().all(|(_, c)| c != b))?);
    }
    None
}

/// Free boundary vertices with the length of their shortest open edge.
fn open_edges(surface: &Surface) -> BTreeMap<u32, f64> {
    let mut shortest = BTreeMap::new();
    let mut fan = Fan::new();
    for v in 0..surface.vertices.len() as u32 {
        if surface.rings[v as usize].class != Some(Class::Boundary) || surface.ring(v).is_empty() {
            continue;
        }
        fan.look(surface, v);
        let place = |v: u32| surface.vertices[v as usize].position;
        let lengths = fan.ends.iter().map(|&w| length_sq(sub(place(w), place(v))).sqrt());
        let least = lengths.fold(f64::INFINITY, f64::min);
        if least.is_finite() {
            shortest.insert(v, least);
        }
    }
    shortest
}

/// Returns whether an edge joins two vertices, or each to a common neighbour.
fn are_close_by_edges(surface: &Surface, v: u32, w: u32) -> bool {
    let around = |v: u32| surface.ring(v).iter().flat_map(|&t| surface.triangles[t as usize]);
    around(v).any(|x| around(w).any(|y| x == y))
}
