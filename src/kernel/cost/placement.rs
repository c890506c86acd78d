//! Survivors at an end or in the middle of their edge instead of where the error is least.
//!
//! Takes the place of what `cost::quadric` found, edge by edge, after its lanes are through, so that the usual
//! placement pays nothing for it. The costs mean the same: both quadrics at the place.
//!
//! docs/algorithm.md, section 2.

use crate::cost::quadric::{Evaluated, LENGTH_COST};
use crate::options::Placement;
use crate::surface::Surface;
use crate::vertex::Vertex;
use stonecut_mesh::vec3;

/// Replaces places and costs of eight edges; where `fixed` is not 0, the survivor stays at `v1`.
#[inline(never)]
pub(crate) fn choose(
    placement: Placement,
    (v0, v1): ([&Vertex; 8], [&Vertex; 8]),
    fixed: &[f32; 8],
    scale: f64,
    found: &mut Evaluated,
) {
    for i in 0..8 {
        // Refused for the sake of a seam.
        if found.cost[i] == f32::INFINITY {
            continue;
        }
        let (from, to) = (v0[i], v1[i]);
        let half: [f32; 3] =
            std::array::from_fn(|k| ((to.position[k] - from.position[k]) * scale * 0.5) as f32);
        let cost = |place: [f32; 3]| {
            let at_from = product(&from.quadric, std::array::from_fn(|k| place[k] + half[k]));
            at_from + product(&to.quadric, std::array::from_fn(|k| place[k] - half[k]))
        };
        let (at_v0, at_v1) = (cost(half.map(|x| -x)), cost(half));
        let (place, error) = match placement {
            _ if fixed[i] != 0.0 => (half, at_v1),
            Placement::Midpoint => ([0.0; 3], cost([0.0; 3])),
            // Written so that NaN chooses v1.
            _ if at_v0 < at_v1 => (half.map(|x| -x), at_v0),
            _ => (half, at_v1),
        };
        let trace: f32 = [0, 3, 5].iter().map(|&k: &usize| from.quadric[k] + to.quadric[k]).sum();
        let half_sq: f32 = half.iter().map(|x| x * x).sum();
        found.cost[i] = error.max(0.0) + trace * half_sq * LENGTH_COST;
        for (row, x) in found.place.iter_mut().zip(place) {
            row[i] = x;
        }
    }
}

/// x^T A x for the first six numbers of a quadric.
fn product(q: &[f32; 9], x: [f32; 3]) -> f32 {
    let row = |a: usize, b: usize, c: usize| q[a] * x[0] + q[b] * x[1] + q[c] * x[2];
    x[0] * row(0, 1, 2) + x[1] * row(1, 3, 4) + x[2] * row(2, 4, 5)
}

/// Makes `v1` the end that `place`, relative to the middle of the edge, is at: position, channels and
/// source, so that `v0` holds what is given up.
pub(crate) fn keep_an_end(surface: &mut Surface, (v0, v1): (u32, u32), place: &[f32; 3]) {
    if !is_nearer_to_v1(surface, (v0, v1), place) {
        let (i0, i1) = (v0 as usize, v1 as usize);
        surface.vertices[i1].position = surface.vertices[i0].position;
        surface.source.swap(i0, i1);
        let n = surface.n_channels;
        surface.channels.copy_within(i0 * n..(i0 + 1) * n, i1 * n);
    }
}

/// Returns whether a place relative to the middle of an edge is at `v1`, not at `v0`.
pub(crate) fn is_nearer_to_v1(surface: &Surface, (v0, v1): (u32, u32), place: &[f32; 3]) -> bool {
    let edge = surface.edge(v0, v1);
    let along: f32 = (0..3).map(|k| edge[k] * place[k]).sum();
    // Written so that NaN chooses v1.
    along.partial_cmp(&0.0) != Some(std::cmp::Ordering::Less)
}

/// Place on an edge (0 at `v0`) of a place relative to its midpoint, in f64 for either end exactly.
pub(crate) fn place_on_edge(half: [f32; 3], place: [f32; 3]) -> f32 {
    if place == half {
        return 1.0;
    }
    if place == half.map(|x| -x) {
        return 0.0;
    }
    let (half, place) = (half.map(f64::from), place.map(f64::from));
    vec3::along(place, half.map(|x| -x), half) as f32
}
