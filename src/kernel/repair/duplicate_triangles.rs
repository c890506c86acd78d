//! Finds duplicate triangles and surplus back-to-back pairs.
//!
//! A triangle over the three vertices of another, turned over, may be a flap in a sheet, or belong to a
//! second sheet that touches the first one there. The edges tell: a sheet brings neighbours that run
//! against it, a flap has none left. It looks at indices only, and is used by the kernel and for cells that
//! were just partitioned.

use std::collections::BTreeMap;

/// Triangles over the same three vertices as an earlier one.
#[derive(Debug, Default)]
pub(crate) struct Repeats {
    /// In the same sense of rotation as an earlier one.
    pub(crate) same: Vec<u32>,
    /// The first that is turned over against those before it.
    pub(crate) reversed: Vec<u32>,
}

impl Repeats {
    /// Adds what repeats among `known`: triangles by number, each with a key that is the same for all that may
    /// repeat each other, in order. `oriented`: a triangle's vertices in its sense of rotation, as `from_least`
    /// has them.
    pub(crate) fn add(&mut self, known: &[([u32; 3], u32)], oriented: impl Fn(u32) -> [u32; 3]) {
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

/// For each of `reversed` whether it is a flap: at one of its edges more triangles run with it than against it.
/// The neighbours of a flap go with it, so that whole patches do.
///
/// `all`: every triangle at these edges, `reversed` included, once. `is_known`: whether all triangles of a
/// vertex are in `all`; a triangle none of whose edges has such an end counts as a flap.
pub(crate) fn flaps(
    reversed: &[[u32; 3]],
    all: impl Iterator<Item = [u32; 3]>,
    is_known: impl Fn(u32) -> bool,
) -> Vec<bool> {
    let sides = |t: [u32; 3]| [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]];
    let key = |[a, b]: [u32; 2]| [a.min(b), a.max(b)];
    let sign = |[a, b]: [u32; 2]| if a < b { 1i64 } else { -1 };
    // How many more triangles run upwards along each edge than downwards.
    let mut surplus: BTreeMap<[u32; 2], i64> =
        reversed.iter().flat_map(|&t| sides(t)).map(|side| (key(side), 0)).collect();
    for side in all.flat_map(sides) {
        if let Some(n) = surplus.get_mut(&key(side)) {
            *n += sign(side);
        }
    }
    let mut is_flap = vec![false; reversed.len()];
    let mut waiting: Vec<usize> = (0..reversed.len()).collect();
    loop {
        let before = waiting.len();
        waiting.retain(|&i| {
            let own = sides(reversed[i]);
            let known = || own.iter().filter(|side| is_known(side[0]) || is_known(side[1]));
            let is_surplus =
                |side: &[u32; 2]| surplus.get(&key(*side)).is_some_and(|n| n * sign(*side) > 0);
            if known().next().is_some() && !known().any(is_surplus) {
                return true;
            }
            for side in own {
                surplus.entry(key(side)).and_modify(|n| *n -= sign(side));
            }
            is_flap[i] = true;
            false
        });
        if waiting.len() == before {
            return is_flap;
        }
    }
}

/// A triangle with its least corner first, in its sense of rotation.
pub(crate) fn from_least(t: [u32; 3]) -> [u32; 3] {
    let mut t = t;
    let least = (0..3).min_by_key(|&i| t[i]).unwrap_or(0);
    t.rotate_left(least);
    t
}
