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
use stonecut_mesh::steps::{HUB, count};

/// Triangles of the mesh that are held against one of the version without a second thought.
const FEW: usize = 1024;

/// Triangles of the version that take more may take this many together, for each triangle of the mesh.
const MORE: usize = 64;

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
    let mut within = Within::new(fine, (patches, coarse.positions.len()), hints, limit);
    let mut below = Below::new(fine, limit);
    let mut wider = Wider { around, seen: vec![NONE; coarse.positions.len()], list: Vec::new() };
    let mut more = MORE * fine.triangles.len();
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
        let list = wider.of(&coarse.triangles, t);
        let n: usize = list.iter().map(|&v| patches.triangles(v).len()).sum();
        if n > FEW {
            if n > more {
                return true;
            }
            more -= n;
        }
        count(n);
        !below.covers(&places, list.iter().map(|&v| patches.triangles(v)))
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
    largest.share_pieces(fine.triangles.len(), open.len());
    for t in open {
        reverse.look(coarse.triangles[t as usize], corners(t), &mut feet, largest, &mut exact);
    }
}

/// The vertices of the version next to a triangle of it.
struct Wider<'a> {
    around: &'a Around,
    /// For each vertex the last triangle that it was listed for.
    seen: Vec<u32>,
    list: Vec<u32>,
}

impl Wider<'_> {
    /// Lists them, each once. Hubs, and vertices that only they lead to, are left out: what went into a hub beside the triangle has
    /// another corner that went into one of the vertices that are listed.
    fn of(&mut self, triangles: &[[u32; 3]], t: u32) -> &[u32] {
        let Wider { around, seen, list } = self;
        list.clear();
        let is_hub = |v: u32| around.of(v).len() > HUB;
        for &v in triangles[t as usize].iter().filter(|v| !is_hub(**v)) {
            for w in around.of(v).iter().flat_map(|&t| triangles[t as usize]) {
                if seen[w as usize] != t && !is_hub(w) {
                    seen[w as usize] = t;
                    list.push(w);
                }
            }
        }
        list
    }
}
