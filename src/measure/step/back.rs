//! From the simplified version back to the mesh: a proven bound for every triangle.
//!
//! Triangles that the mesh covers within what is accepted already need nothing else (`below`); that is nearly all of them.
//! The others are bounded as those of the mesh are, with the two meshes in each other's place.

use super::around::{Around, Forward, NONE};
use super::below::Below;
use super::exact::Exact;
use super::foot::Feet;
use super::forward::is_beside;
use super::largest::Largest;
use super::patches::Patches;
use super::within::{Found, Within};

/// Bounds the distances of all triangles of the version from the mesh.
///
/// `hints`: the vertices that the vertices of the mesh went into. Memory: 30 bytes for each triangle of the mesh.
pub(super) fn triangles(
    forward: &Forward,
    patches: &Patches,
    hints: &[u32],
    largest: &mut Largest,
) {
    let Forward { fine, coarse, around } = *forward;
    let limit_sq = largest.bound_sq.max(largest.rounding_sq);
    let limit = limit_sq.sqrt();
    let mut back = vec![NONE; coarse.positions.len()];
    for (v, &hint) in (0u32..).zip(hints).filter(|(_, hint)| **hint != NONE) {
        back[hint as usize] = v;
    }
    let corners = |t: u32| {
        let own = coarse.triangles[t as usize];
        own.map(|v| (coarse.positions[v as usize], back[v as usize]))
    };
    let mut within = Within::new(fine, patches, hints, limit);
    let mut below = Below::new(fine, limit);
    let is_open = |&t: &u32| {
        if is_beside(&corners(t), fine, limit_sq) {
            return false;
        }
        let (own, places) = (coarse.triangles[t as usize], coarse.corners(t as usize));
        match within.look(&places, own) {
            Found::Covered => return false,
            Found::Open => return true,
            Found::Perhaps => {}
        }
        // What went into the vertices next to its own may reach over it.
        let next = own.iter().flat_map(|&v| around.of(v));
        let wider = next.flat_map(|&t| coarse.triangles[t as usize]).map(|v| patches.triangles(v));
        !below.covers(&places, wider)
    };
    let open: Vec<u32> = (0..coarse.triangles.len() as u32).filter(is_open).collect();
    drop(within);
    if open.is_empty() {
        return;
    }
    let around = Around::vertices(fine);
    let reverse = Forward { fine: coarse, coarse: fine, around: &around };
    let mut feet = Feet::new(coarse.positions.len());
    let mut exact = Exact::new(fine);
    for t in open {
        reverse.look(coarse.triangles[t as usize], corners(t), &mut feet, largest, &mut exact);
    }
}
