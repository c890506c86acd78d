//! The mesh as it was given: its vertices, its triangles, and which triangles are around a vertex.
//!
//! Only read, but for what is known of the witnesses.

use crate::vertex::GONE;
use stonecut_mesh::steps::HUB;
use stonecut_mesh::vec3::{dot, sub};

/// No witness follows.
pub(super) const NONE: u32 = u32::MAX;

/// A vertex of the input.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Witness {
    /// Relative to `Tracker::centre`, scaled.
    pub(super) at: [f32; 3],
    /// Distance of the input from the original here, scaled.
    pub(super) before: f32,
    /// Its longest edge, scaled.
    pub(super) longest: f32,
    /// Distance from the surface, at most; scaled.
    pub(super) distance: f32,
    /// Triangle of the surface that it belongs to.
    pub(super) owner: u32,
    /// The next witness of the same triangle.
    pub(super) next: u32,
}

/// Witnesses, and for each of them the triangles around it.
#[derive(Clone)]
pub(super) struct BoundInput {
    /// Those of the vertices first.
    pub(super) witnesses: Vec<Witness>,
    /// True for vertices that lie on the original; empty if all do.
    pub(super) is_original: Vec<bool>,
    /// For each vertex, how much farther the input may be from the original where the surface is held against it than
    /// where it is held against the surface; empty if it is the original.
    pub(super) behind: Vec<f32>,
    /// First place of the triangles of a witness in `around`; one more than there are witnesses.
    first: Vec<u32>,
    /// The other two corners of each triangle.
    around: Vec<[u32; 2]>,
    /// True for witnesses with an open edge.
    is_open: Vec<bool>,
}

impl BoundInput {
    /// Takes the triangles that are there.
    pub(super) fn new(mut witnesses: Vec<Witness>, triangles: &[[u32; 3]]) -> BoundInput {
        let there = || triangles.iter().filter(|t| t[0] != GONE);
        let mut first = vec![0u32; witnesses.len() + 1];
        for &v in there().flatten() {
            first[v as usize + 1] += 1;
        }
        for v in 1..first.len() {
            first[v] += first[v - 1];
        }
        for t in there() {
            for k in 0..3 {
                let (v, w) = (t[k] as usize, t[(k + 1) % 3] as usize);
                let edge = sub(witnesses[w].at, witnesses[v].at);
                let length = dot(edge, edge).sqrt();
                for v in [v, w] {
                    witnesses[v].longest = witnesses[v].longest.max(length);
                }
            }
        }
        let mut place = first.clone();
        let mut around = vec![[0; 2]; 3 * there().count()];
        for t in there() {
            for k in 0..3 {
                let place = &mut place[t[k] as usize];
                around[*place as usize] = [t[(k + 1) % 3], t[(k + 2) % 3]];
                *place += 1;
            }
        }
        let mut input = BoundInput {
            witnesses,
            is_original: Vec::new(),
            behind: Vec::new(),
            first,
            around,
            is_open: Vec::new(),
        };
        // Every neighbour is a second corner once and a third corner once, but at open ends.
        let is_open = |v: u32| input.around(v).iter().fold(0, |sum, [b, c]| sum ^ b ^ c) != 0;
        input.is_open = (0..input.witnesses.len() as u32).map(is_open).collect();
        input
    }

    /// True for a vertex with an open edge.
    pub(super) fn is_open(&self, witness: u32) -> bool {
        self.is_open.get(witness as usize).is_some_and(|&is_open| is_open)
    }

    /// Memory that it holds, in bytes.
    pub(super) fn bytes(&self) -> u64 {
        let witnesses = self.witnesses.len() * size_of::<Witness>();
        (witnesses
            + self.is_open.len()
            + self.is_original.len()
            + 4 * self.behind.len()
            + 4 * self.first.len()
            + size_of::<[u32; 2]>() * self.around.len()) as u64
    }

    /// The witnesses at the other ends of the edges of a witness; each once where the input is manifold.
    pub(super) fn neighbours(&self, witness: u32) -> impl Iterator<Item = u32> {
        let around = self.around(witness);
        // All are second corners but one at each open end, where a third corner has an edge of one triangle.
        let thirds = if self.is_open(witness) { around } else { &[] };
        // Around a hub each third corner is looked up instead.
        let mut seconds = Vec::new();
        if !thirds.is_empty() && around.len() > HUB {
            seconds.extend(around.iter().map(|[b, _]| *b));
            seconds.sort_unstable();
        }
        let is_end = move |c: &u32| match seconds.is_empty() {
            true => !around.iter().any(|[b, _]| b == c),
            false => seconds.binary_search(c).is_err(),
        };
        let ends = thirds.iter().map(|&[_, c]| c).filter(is_end);
        around.iter().map(|&[b, _]| b).chain(ends)
    }

    /// True for a witness that is a vertex, and so has triangles around it.
    pub(super) fn is_vertex(&self, witness: u32) -> bool {
        (witness as usize) + 1 < self.first.len()
    }

    /// Distance of the input from the original at a vertex, as far as it counts for points of the surface; scaled.
    pub(super) fn behind(&self, witness: u32) -> f32 {
        self.witnesses[witness as usize].before + self.behind.get(witness as usize).unwrap_or(&0.0)
    }

    /// The other two corners of each triangle around a witness; none for one that is not a vertex.
    pub(super) fn around(&self, witness: u32) -> &[[u32; 2]] {
        if !self.is_vertex(witness) {
            return &[];
        }
        let [first, end] = [0, 1].map(|i| self.first[witness as usize + i] as usize);
        &self.around[first..end]
    }
}
