//! The triangles between clusters: where three meet, on a triangle of the surface, there is one.

use super::clusters::NONE;
use std::collections::{BTreeMap, BTreeSet};
use stonecut_mesh::steps::count;

/// The mesh of the clusters' neighbourhoods.
pub(super) struct Dual {
    pub(super) triangles: Vec<[u32; 3]>,
    /// Clusters at edges of more than two triangles, at vertices of more than one fan, and of triangles that are there twice.
    pub(super) faulty: Vec<u32>,
}

impl Dual {
    /// Each triangle of the surface whose corners belong to three clusters makes one; each of them once.
    pub(super) fn new(triangles: &[[u32; 3]], owner: &[u32]) -> Dual {
        let mut faulty = BTreeSet::new();
        let meets = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|v| owner[v as usize]);
            (a != b && b != c && c != a && ![a, b, c].contains(&NONE)).then_some([a, b, c])
        };
        let mut all: Vec<[u32; 3]> = triangles.iter().filter_map(meets).collect();
        let least_first = |t: &mut [u32; 3]| {
            let k = (0..3).min_by_key(|&k| t[k]).unwrap_or(0);
            t.rotate_left(k);
        };
        all.iter_mut().for_each(least_first);
        all.sort_unstable();
        for pair in all.windows(2).filter(|pair| pair[0] == pair[1]) {
            faulty.extend(pair[0]);
        }
        all.dedup();
        let mut edges: Vec<[u32; 2]> =
            all.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]).collect();
        edges.sort_unstable();
        for pair in edges.windows(2).filter(|pair| pair[0] == pair[1]) {
            faulty.extend(pair[0]);
        }
        drop(edges);
        // A triangle and its back.
        let mut backs: Vec<[u32; 3]> =
            all.iter().map(|&[a, b, c]| [a, b.min(c), b.max(c)]).collect();
        backs.sort_unstable();
        for pair in backs.windows(2).filter(|pair| pair[0] == pair[1]) {
            faulty.extend(pair[0]);
        }
        drop(backs);
        find_fans(&all, &mut faulty);
        Dual { triangles: all, faulty: faulty.into_iter().collect() }
    }

    /// Drops triangles with their backs, which enclose nothing. Returns their number.
    pub(super) fn drop_pillows(&mut self) -> u64 {
        let n_before = self.triangles.len();
        let faulty: BTreeSet<u32> = self.faulty.iter().copied().collect();
        let sorted = |&[a, b, c]: &[u32; 3]| [a, b.min(c), b.max(c)];
        let is_faulty = |t: &&[u32; 3]| t.iter().any(|c| faulty.contains(c));
        let mut n_of = BTreeMap::<[u32; 3], u32>::new();
        for t in self.triangles.iter().filter(is_faulty) {
            *n_of.entry(sorted(t)).or_default() += 1;
        }
        self.triangles.retain(|t| n_of.get(&sorted(t)).is_none_or(|n| *n == 1));
        (n_before - self.triangles.len()) as u64
    }
}

/// Finds vertices whose triangles are more than one fan.
fn find_fans(triangles: &[[u32; 3]], faulty: &mut BTreeSet<u32>) {
    let mut around: Vec<[u32; 3]> =
        triangles.iter().flat_map(|&[a, b, c]| [[a, b, c], [b, c, a], [c, a, b]]).collect();
    around.sort_unstable();
    let mut ends = Vec::new();
    for of_one in around.chunk_by(|x, y| x[0] == y[0]) {
        // In the order of their second corners.
        let after = |v: u32| {
            let edge = of_one.get(of_one.partition_point(|edge| edge[1] < v));
            edge.filter(|edge| edge[1] == v).map(|edge| edge[2])
        };
        ends.clear();
        ends.extend(of_one.iter().map(|edge| edge[2]));
        ends.sort_unstable();
        count(of_one.len());
        let open = of_one.iter().find(|edge| ends.binary_search(&edge[1]).is_err());
        let start = open.unwrap_or(&of_one[0])[1];
        let (mut at, mut n) = (start, 0);
        while let Some(next) = after(at) {
            n += 1;
            at = next;
            if at == start || n > of_one.len() {
                break;
            }
        }
        if n != of_one.len() {
            faulty.insert(of_one[0][0]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_are_named() {
        let own: Vec<u32> = (0..12).collect();
        let tetrahedron = [[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]];
        let whole = Dual::new(&tetrahedron, &own);
        assert_eq!((whole.triangles.len(), whole.faulty.len()), (4, 0));
        // Two fans at 0.
        let bow = Dual::new(&[[0, 1, 2], [0, 3, 4]], &own);
        assert_eq!(bow.faulty, [0]);
        // Three triangles at an edge, two of them in the same direction.
        let mut book = Dual::new(&[[0, 1, 2], [1, 0, 3], [0, 1, 4]], &own);
        assert!(book.faulty.contains(&0) && book.faulty.contains(&1));
        assert_eq!((book.drop_pillows(), book.triangles.len()), (0, 3));
        let mut pillow = Dual::new(&[[0, 1, 2], [0, 2, 1]], &own);
        assert_eq!(pillow.faulty, [0, 1, 2]);
        assert_eq!(pillow.drop_pillows(), 2);
        // Inside of a cluster, between two, and with a vertex that belongs to none.
        let inside = Dual::new(&[[0, 1, 2], [0, 1, 3], [1, 2, 4]], &[0, 0, 1, 0, NONE]);
        assert!(inside.triangles.is_empty());
    }
}
