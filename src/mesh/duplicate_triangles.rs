//! Finds duplicate triangles and surplus back-to-back pairs.
//!
//! A triangle over the three vertices of another, turned over, may be a flap in a sheet, the back of a sheet with faces for
//! both sides, or belong to a second body that touches the first one there. The edges tell: a body brings neighbours that run
//! against it, a flap has none left, and a sheet ends with its back. It looks at indices only, and is used by the kernel, for cells that
//! were just partitioned, and for meshes that other methods read.

use crate::curves::meet_along_curves;
use crate::union_find::Union;
use std::collections::BTreeMap;

/// Triangles over the same three vertices as an earlier one.
#[derive(Debug, Default)]
pub struct Repeats {
    /// In the same sense of rotation as an earlier one.
    pub same: Vec<u32>,
    /// The first that is turned over against those before it.
    pub reversed: Vec<u32>,
}

impl Repeats {
    /// Adds what repeats among `known`: triangles by number, each with a key that is the same for all that may
    /// repeat each other, in order. `oriented`: a triangle's vertices in its sense of rotation, as `from_least`
    /// has them.
    pub fn add(&mut self, known: &[([u32; 3], u32)], oriented: impl Fn(u32) -> [u32; 3]) {
        for alike in known.chunk_by(|a, b| a.0 == b.0).filter(|alike| alike.len() > 1) {
            let first = oriented(alike[0].1);
            let mut is_met = false;
            for &(_, t) in &alike[1..] {
                let is_turned = oriented(t) != first;
                let list = if is_turned && !is_met { &mut self.reversed } else { &mut self.same };
                is_met |= is_turned;
                list.push(t);
            }
        }
    }
}

impl Repeats {
    /// Those of `triangles` that go: all in the same sense of rotation, and of the reversed ones all of a two-sided mesh, or those
    /// that do not stay by `fates`. `is_known`: whether all triangles of a vertex are among these.
    pub fn that_go(self, triangles: &[[u32; 3]], is_known: impl Fn(u32) -> bool) -> Going {
        let Repeats { same: mut gone, reversed } = self;
        gone.sort_unstable();
        let turned: Vec<[u32; 3]> = reversed.iter().map(|&t| triangles[t as usize]).collect();
        let fates = match is_two_sided(&turned, triangles.len() - gone.len(), &is_known) {
            true => vec![Fate::Back; turned.len()],
            false => {
                let n = turned.iter().flatten().max().map_or(0, |&v| v as usize + 1);
                let mut is_near = vec![false; n];
                turned.iter().flatten().for_each(|&v| is_near[v as usize] = true);
                let has_edge_there = |t: &[u32; 3]| {
                    t.iter().filter(|&&v| is_near.get(v as usize) == Some(&true)).count() > 1
                };
                let all = (0u32..).zip(triangles).filter(|(_, t)| has_edge_there(t));
                let all = all.filter(|(i, _)| gone.binary_search(i).is_err()).map(|(_, t)| *t);
                fates(&turned, triangles.len(), all, is_known)
            }
        };
        let backs = fates.iter().filter(|fate| **fate == Fate::Back).count() as u64;
        let turned = reversed.into_iter().zip(fates).filter(|(_, fate)| *fate != Fate::Stays);
        gone.extend(turned.map(|(t, _)| t));
        gone.sort_unstable();
        Going { triangles: gone, backs }
    }
}

/// Triangles that go.
pub struct Going {
    /// Their numbers, in order.
    pub triangles: Vec<u32>,
    /// Those of them that are backs of two-sided sheets.
    pub backs: u64,
}

/// Fate of a triangle that is turned over against another one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fate {
    /// It belongs to a second body that touches there.
    Stays,
    /// It goes as a flap in a sheet.
    Flap,
    /// It goes as the back of a sheet whose faces are there for both sides.
    Back,
}

/// Removes the triangles of these numbers, which are in order.
pub fn remove(triangles: &mut Vec<[u32; 3]>, gone: &[u32]) {
    let (mut next, mut at) = (gone.iter().peekable(), 0);
    triangles.retain(|_| {
        let goes = next.next_if(|&&gone| gone == at).is_some();
        at += 1;
        !goes
    });
}

/// An edge of triangles that are there turned over as well.
#[derive(Default)]
struct Edge {
    /// Triangles that run upwards along it, less those that run downwards.
    surplus: i64,
    n_triangles: u32,
    n_reversed: u32,
    /// The first of the reversed ones, by its place among them.
    first: u32,
}

/// A patch of pairs that hang together over edges, and its rim.
#[derive(Clone, Copy, Default)]
struct PairPatch {
    n_pairs: usize,
    /// Edges of no other triangle, and of others as well; those whose triangles are not all known left out.
    free: usize,
    joined: usize,
}

/// The fate of each of `reversed`.
///
/// A patch of pairs whose rim is mostly free is a two-sided sheet; where bodies touch, their walls go on around. A flap has more
/// triangles with it than against it at one of its edges. The neighbours of a flap go with it, so that whole patches do.
///
/// `all`: every triangle at these edges, `reversed` included, once. `is_known`: whether all triangles of a
/// vertex are in `all`; a triangle none of whose edges has such an end is a flap if more of the others are than belong to bodies;
/// else it stays, since later rounds know more. `n_triangles`: those of the whole mesh.
pub fn fates(
    reversed: &[[u32; 3]],
    n_triangles: usize,
    all: impl Iterator<Item = [u32; 3]>,
    is_known: impl Fn(u32) -> bool,
) -> Vec<Fate> {
    let sides = |t: [u32; 3]| [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]];
    let key = |[a, b]: [u32; 2]| [a.min(b), a.max(b)];
    let sign = |[a, b]: [u32; 2]| if a < b { 1i64 } else { -1 };
    let mut edges: BTreeMap<[u32; 2], Edge> = BTreeMap::new();
    let mut patches = Union::new(reversed.len());
    for (&t, i) in reversed.iter().zip(0..) {
        for side in sides(t) {
            let edge = edges.entry(key(side)).or_insert(Edge { first: i, ..Edge::default() });
            edge.n_reversed += 1;
            patches.join(edge.first, i);
        }
    }
    for side in all.flat_map(sides) {
        if let Some(edge) = edges.get_mut(&key(side)) {
            edge.surplus += sign(side);
            edge.n_triangles += 1;
        }
    }
    let backs = are_backs(&edges, &patches.into_roots(), n_triangles, &is_known);
    let mut fates = vec![Fate::Stays; reversed.len()];
    let mut waiting: Vec<usize> = (0..reversed.len()).collect();
    loop {
        let before = waiting.len();
        waiting.retain(|&i| {
            let own = sides(reversed[i]);
            let mut known = own.iter().filter(|side| side.iter().any(|&v| is_known(v)));
            let is_surplus = |side: &[u32; 2]| {
                edges.get(&key(*side)).is_some_and(|edge| edge.surplus * sign(*side) > 0)
            };
            if !backs[i] && !known.any(is_surplus) {
                return true;
            }
            for side in own {
                edges.entry(key(side)).and_modify(|edge| edge.surplus -= sign(side));
            }
            fates[i] = if backs[i] { Fate::Back } else { Fate::Flap };
            false
        });
        if waiting.len() == before {
            break;
        }
    }
    let has_known = |i: &usize| sides(reversed[*i]).into_iter().flatten().any(&is_known);
    let n_flaps = fates.iter().filter(|fate| **fate == Fate::Flap).count();
    if n_flaps > waiting.iter().filter(|i| has_known(i)).count() {
        waiting.iter().filter(|i| !has_known(i)).for_each(|&i| fates[i] = Fate::Flap);
    }
    fates
}

/// For each pair whether it belongs to a two-sided sheet; `patch` is the patch of each.
fn are_backs(
    edges: &BTreeMap<[u32; 2], Edge>,
    patch: &[u32],
    n_triangles: usize,
    is_known: impl Fn(u32) -> bool,
) -> Vec<bool> {
    let mut patches = vec![PairPatch::default(); patch.len()];
    patch.iter().for_each(|&root| patches[root as usize].n_pairs += 1);
    let is_rim = |(ends, edge): &(&[u32; 2], &Edge)| {
        edge.n_reversed == 1 && ends.iter().any(|&v| is_known(v))
    };
    for (_, edge) in edges.iter().filter(is_rim) {
        let patch = &mut patches[patch[edge.first as usize] as usize];
        *if edge.n_triangles == 2 { &mut patch.free } else { &mut patch.joined } += 1;
    }
    // One pair, and what has no rim, may be a body; so may a few pairs, unless such are many: leaves of a few triangles each.
    let is_sheet = |patch: &&PairPatch| patch.n_pairs > 1 && patch.free > patch.joined;
    let n_pairs: usize = patches.iter().filter(is_sheet).map(|patch| patch.n_pairs).sum();
    let are_leaves = n_pairs >= LEAST_TWO_SIDED.max(n_triangles / LEAF_SHARE);
    let goes = |&root: &u32| {
        let patch = &patches[root as usize];
        is_sheet(&patch) && (are_leaves || patch.n_pairs >= LEAST_TWO_SIDED)
    };
    patch.iter().map(goes).collect()
}

/// True if four fifths of a mesh are there twice, turned over: sheets whose faces were written for both sides, of which no rim may be
/// in this cell. Those that are turned over tell nothing, and with them every edge has four triangles and no collapse is legal.
/// Where three or more of them meet along curves, they are walls of bodies that fill space.
fn is_two_sided(turned: &[[u32; 3]], n_triangles: usize, is_known: impl Fn(u32) -> bool) -> bool {
    2 * turned.len() as u64 * 10 >= 8 * n_triangles as u64
        && turned.len() >= LEAST_TWO_SIDED
        && !meet_along_curves(turned, is_known)
}

/// A closed body of fewer pairs may be flat.
const LEAST_TWO_SIDED: usize = 16;

/// Pairs in small patches are leaves, not crumbs, if they are more than one in this many triangles; in dragon_res2 35 of 202,520 are crumbs.
const LEAF_SHARE: usize = 200;

/// Drops the triangles that repeat another one, turned over or not; the first stays. Returns those that went.
///
/// One that is turned over and belongs to a second body stays. Memory while it runs: 20 bytes a
/// triangle.
pub fn drop_repeats(triangles: &mut Vec<[u32; 3]>) -> Going {
    let mut keys: Vec<([u32; 3], u32)> = (0u32..)
        .zip(&*triangles)
        .map(|(i, t)| {
            let mut corners = *t;
            corners.sort_unstable();
            (corners, i)
        })
        .collect();
    keys.sort_unstable();
    let mut found = Repeats::default();
    found.add(&keys, |i| from_least(triangles[i as usize]));
    drop(keys);
    let going = found.that_go(triangles, |_| true);
    remove(triangles, &going.triangles);
    going
}

/// A triangle with its least corner first, in its sense of rotation.
pub fn from_least(t: [u32; 3]) -> [u32; 3] {
    let mut t = t;
    let least = (0..3).min_by_key(|&i| t[i]).unwrap_or(0);
    t.rotate_left(least);
    t
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two triangles for each square of a strip.
    fn strip(n: u32) -> Vec<[u32; 3]> {
        (0..n).map(|i| 2 * i).flat_map(|v| [[v, v + 2, v + 3], [v, v + 3, v + 1]]).collect()
    }

    fn back(t: &[u32; 3]) -> [u32; 3] {
        [t[0], t[2], t[1]]
    }

    #[test]
    fn walls_that_meet_along_a_curve_stay_though_all_are_there_twice() {
        // Three strips around the line 0 - 2 - 4 - ...; in a cell of which nothing else is known but that line.
        let n = 10;
        let turn = |k: u32| move |v: u32| v + 100 * k * (v % 2);
        let pages = (0..3).flat_map(|k| strip(n).into_iter().map(move |t| t.map(turn(k))));
        let pages: Vec<[u32; 3]> = pages.collect();
        let both = [&pages[..], &pages.iter().map(back).collect::<Vec<_>>()].concat();
        for (pages, backs) in
            [(both, 0), ([strip(n), strip(n).iter().map(back).collect()].concat(), 20)]
        {
            let reversed = (pages.len() as u32 / 2..pages.len() as u32).collect();
            let found = Repeats { reversed, ..Repeats::default() };
            let is_inner = |v: u32| v.is_multiple_of(2) && v > 0 && v < 2 * n;
            assert_eq!(found.that_go(&pages, is_inner).triangles.len(), backs);
        }
    }

    #[test]
    fn backs_of_sheets_go_and_walls_of_bodies_stay() {
        // 1 - 3 - 5 - ...
        // | / | / |         and walls up and down from all of its rim
        // 0 - 2 - 4 - ...
        let n = 10;
        let both =
            |strip: &[[u32; 3]]| [strip, &strip.iter().map(back).collect::<Vec<_>>()].concat();
        let sheet = both(&strip(n));
        let mut body = sheet.clone();
        let rim = (0..n).flat_map(|i| [[2 * i, 2 * i + 2], [2 * i + 3, 2 * i + 1]]);
        for [a, b] in rim.chain([[2 * n, 2 * n + 1], [1, 0]]) {
            body.extend([[b, a, 100], [a, b, 101]]);
        }
        // Other bodies, so that few of all triangles are there twice.
        let other: Vec<[u32; 3]> = strip(500).iter().map(|t| t.map(|v| v + 200)).collect();
        let mut leaf: Vec<[u32; 3]> = both(&strip(1));
        leaf = (0..9).flat_map(|k| leaf.iter().map(move |t| t.map(|v| v + 4 * k))).collect();
        for (mesh, backs) in [(sheet, 20), (body, 0), (leaf.clone(), 18), (leaf[..20].to_vec(), 0)]
        {
            let n = mesh.len() + other.len();
            let mut all = [mesh, other.clone()].concat();
            let going = drop_repeats(&mut all);
            assert_eq!((going.backs, going.triangles.len() as u64), (backs, backs));
            assert_eq!(all.len() as u64, n as u64 - backs);
        }
    }
}
