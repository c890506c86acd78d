//! Finds duplicate triangles and surplus back-to-back pairs.
//!
//! A triangle over the three vertices of another, turned over, may be a flap in a sheet, or belong to a
//! second sheet that touches the first one there. The edges tell: a sheet brings neighbours that run
//! against it, a flap has none left. It looks at indices only, and is used by the kernel, for cells that
//! were just partitioned, and for meshes that other methods read.

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
    /// Those of `n_triangles` that go, in order: all in the same sense of rotation, and of the reversed ones all of a two-sided mesh,
    /// or those for which `are_flaps` is true; it gets them, and those that go already.
    pub fn that_go(
        self,
        n_triangles: usize,
        are_flaps: impl FnOnce(&[u32], &[u32]) -> Vec<bool>,
    ) -> Vec<u32> {
        let Repeats { same: mut repeats, reversed } = self;
        repeats.sort_unstable();
        if is_two_sided(reversed.len(), n_triangles - repeats.len()) {
            repeats.extend(reversed);
        } else if !reversed.is_empty() {
            let are_flaps = are_flaps(&reversed, &repeats);
            repeats
                .extend(reversed.into_iter().zip(are_flaps).filter(|(_, flap)| *flap).map(|t| t.0));
        }
        repeats.sort_unstable();
        repeats
    }
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

/// For each of `reversed` whether it is a flap: at one of its edges more triangles run with it than against it.
/// The neighbours of a flap go with it, so that whole patches do.
///
/// `all`: every triangle at these edges, `reversed` included, once. `is_known`: whether all triangles of a
/// vertex are in `all`; a triangle none of whose edges has such an end counts as a flap.
pub fn flaps(
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

/// True if four fifths of a mesh are there twice, turned over: a sheet whose faces were written for both sides. Those that
/// are turned over tell nothing, and with them every edge has four triangles and no collapse is legal.
fn is_two_sided(n_reversed: usize, n_triangles: usize) -> bool {
    2 * n_reversed as u64 * 10 >= 8 * n_triangles as u64 && n_reversed >= LEAST_TWO_SIDED
}

/// A closed body of fewer pairs may be flat.
const LEAST_TWO_SIDED: usize = 16;

/// Drops the triangles that repeat another one, turned over or not; the first stays. Returns their number.
///
/// One that is turned over and belongs to a second sheet stays, unless the whole mesh is two-sided. Memory while it runs: 20 bytes a
/// triangle.
pub fn drop_repeats(triangles: &mut Vec<[u32; 3]>) -> u64 {
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
    let repeats = found.that_go(triangles.len(), |reversed, gone| {
        let turned: Vec<[u32; 3]> = reversed.iter().map(|&i| triangles[i as usize]).collect();
        let all = (0u32..).zip(&*triangles).filter(|(i, _)| gone.binary_search(i).is_err());
        flaps(&turned, all.map(|(_, t)| *t), |_| true)
    });
    remove(triangles, &repeats);
    repeats.len() as u64
}

/// A triangle with its least corner first, in its sense of rotation.
pub fn from_least(t: [u32; 3]) -> [u32; 3] {
    let mut t = t;
    let least = (0..3).min_by_key(|&i| t[i]).unwrap_or(0);
    t.rotate_left(least);
    t
}
