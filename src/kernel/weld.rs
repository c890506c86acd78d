//! Joins open boundaries that touch: vertices in exactly the same place become one.
//!
//! Under `Topology::Error` only, before anything is collapsed. A scan that was split along texture seams
//! is otherwise a heap of charts, each with a boundary to be kept. Where joining would put two triangles
//! on the same side of an edge, it is not done. Locked vertices are never joined: another cell knows them.
//! The channels of the vertex with the lowest id are kept.

use std::collections::BTreeMap;

use super::lanes::Simd;
use super::legal::Class;
use super::surface::{GONE, Surface};

/// Joins what coincides; returns how many vertices went. Sorts boundary vertices only.
pub(crate) fn coincident(surface: &mut Surface, simd: Simd) -> u64 {
    let mut join = candidates(surface);
    while !join.is_empty() {
        let bad = conflicts(surface, &join);
        if bad.is_empty() {
            break;
        }
        join.retain(|v, into| bad.binary_search(v).is_err() && bad.binary_search(into).is_err());
    }
    if join.is_empty() {
        return 0;
    }
    for t in &mut surface.triangles {
        if t[0] != GONE {
            *t = t.map(|v| join.get(&v).copied().unwrap_or(v));
        }
    }
    for &v in join.keys() {
        surface.rings[v as usize].len = 0;
    }
    surface.compact(simd);
    join.len() as u64
}

/// Vertices with open edges, each with the one of lowest source in the same place.
fn candidates(surface: &Surface) -> BTreeMap<u32, u32> {
    // Where several fans of one chart meet in a vertex, the gaps may be what other charts fill.
    let open = |v: &u32| {
        matches!(surface.rings[*v as usize].class, Some(Class::Boundary | Class::Complex))
    };
    // Adding 0 makes -0 and 0 the same place.
    let place = |v: u32| surface.vertices[v as usize].position.map(|x| (x + 0.0).to_bits());
    let mut open: Vec<([u64; 3], u32, u32)> = (0..surface.vertices.len() as u32)
        .filter(open)
        .map(|v| (place(v), surface.source[v as usize], v))
        .collect();
    open.sort_unstable();
    let mut join = BTreeMap::new();
    for group in open.chunk_by(|a, b| a.0 == b.0) {
        for &(_, _, v) in &group[1..] {
            join.insert(v, group[0].2);
        }
    }
    join
}

/// Vertices, ascending, whose joining would repeat a directed edge or a corner.
fn conflicts(surface: &Surface, join: &BTreeMap<u32, u32>) -> Vec<u32> {
    let joined = |v: u32| join.get(&v).copied().unwrap_or(v);
    let mut touched: Vec<u32> = join.iter().flat_map(|(&v, &into)| [v, into]).collect();
    touched.sort_unstable();
    touched.dedup();
    let mut triangles: Vec<u32> =
        touched.iter().flat_map(|&v| surface.ring(v).iter().copied()).collect();
    triangles.sort_unstable();
    triangles.dedup();
    // Each directed edge as it would be, and as it is.
    let mut edges: Vec<([u32; 2], [u32; 2])> = Vec::with_capacity(triangles.len() * 3);
    let mut bad = Vec::new();
    for &t in &triangles {
        let t = surface.triangles[t as usize];
        for (a, b) in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
            let edge = [joined(a), joined(b)];
            if edge[0] == edge[1] {
                bad.extend([a, b]);
            }
            edges.push((edge, [a, b]));
        }
    }
    edges.sort_unstable();
    for same in edges.chunk_by(|a, b| a.0 == b.0).filter(|same| same.len() > 1) {
        bad.extend(same.iter().flat_map(|(_, now)| now));
    }
    bad.retain(|v| touched.binary_search(v).is_ok());
    bad.sort_unstable();
    bad.dedup();
    bad
}
