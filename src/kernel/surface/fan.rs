//! The triangles around a vertex as fans, and the class that follows from them.

use crate::simd::Lanes;
use crate::simd::unchecked::KnownIds;
use crate::surface::class::Class;
use crate::surface::{MAX_VALENCE, Surface, boundary_quadric};
use crate::vertex::GONE;
use stonecut_mesh::corners::others;

impl Surface {
    /// Finds the class of a vertex that is not locked and adds the quadrics of its edges on boundaries or junction curves.
    pub(crate) fn classify(&mut self, v: u32, fan: &mut Fan) {
        if self.rings[v as usize].class == Some(Class::Locked) {
            return;
        }
        let valence = self.rings[v as usize].len;
        let class = if valence > MAX_VALENCE { Class::Complex } else { fan.look(self, v) };
        self.rings[v as usize].class = Some(class);
        self.has_junctions |= class == Class::Junction;
        if matches!(class, Class::Boundary | Class::Junction) {
            for &w in &fan.ends {
                let quadric = boundary_quadric(self.edge(v, w));
                let sum = &mut self.vertices[v as usize].quadric;
                for (sum, x) in sum.iter_mut().zip(quadric) {
                    *sum += x;
                }
            }
        }
    }
}

/// Returns whether the triangles of a vertex form one closed fan; false if they are more than eight or too few to
/// tell quickly.
#[inline(always)]
pub(crate) fn is_one_fan<L: Lanes>(known: KnownIds, surface: &Surface, v: u32) -> bool {
    let ring = known.at(&surface.rings, v);
    let ring = known.part(&surface.arena, ring.start, ring.len);
    if ring.is_empty() || ring.len() > 8 {
        return false;
    }
    let (mut b, mut c) = ([GONE; 8], [GONE; 8]);
    for ((b, c), &t) in b.iter_mut().zip(&mut c).zip(ring) {
        (*b, *c) = others(*known.at(&surface.triangles, t), v);
    }
    // From triangle to triangle; a walk that is back after all of them, not earlier, has met each once.
    let (mut at, mut early) = (0, false);
    for _ in 1..ring.len() {
        at = L::matches(&b, c[at & 7]).trailing_zeros() as usize;
        early |= (at == 0) | (at > 7);
    }
    !early && L::matches(&b, c[at & 7]) & 1 == 1
}

/// The triangles of one vertex as pairs of corners; re-used from vertex to vertex.
#[derive(Clone)]
pub(crate) struct Fan {
    pub(super) b: [u32; MAX_VALENCE as usize],
    pub(super) c: [u32; MAX_VALENCE as usize],
    pub(super) n: usize,
    /// Neighbours over open edges; in the middle of a junction curve over its edges.
    pub(crate) ends: Vec<u32>,
}

impl Fan {
    pub(crate) fn new() -> Self {
        let none = [0; MAX_VALENCE as usize];
        Fan { b: none, c: none, n: 0, ends: Vec::new() }
    }

    /// Looks at a vertex of at most `MAX_VALENCE` triangles.
    pub(crate) fn look(&mut self, surface: &Surface, v: u32) -> Class {
        self.ends.clear();
        self.n = 0;
        for &t in surface.ring(v) {
            (self.b[self.n], self.c[self.n]) = others(surface.triangles[t as usize], v);
            self.n += 1;
        }
        let (b, c) = (&self.b[..self.n], &self.c[..self.n]);
        if b.is_empty() {
            return Class::Interior;
        }
        // A walk that comes back to its start after all triangles has met each once.
        if walk(b, c, b[0]) == (b.len(), true) {
            return Class::Interior;
        }
        let repeated = |list: &[u32]| (1..list.len()).any(|i| list[..i].contains(&list[i]));
        let mut start = None;
        for i in 0..b.len() {
            if !c.contains(&b[i]) {
                start = Some(b[i]);
                self.ends.push(b[i]);
            }
            if !b.contains(&c[i]) {
                self.ends.push(c[i]);
            }
        }
        match start {
            Some(start) if walk(b, c, start).0 == b.len() && !repeated(b) && !repeated(c) => {
                Class::Boundary
            }
            _ if self.is_book() => Class::Junction,
            _ => Class::Complex,
        }
    }
}

/// Walks from triangle to triangle around a vertex: how many it met, and whether it came back.
fn walk(b: &[u32], c: &[u32], start: u32) -> (usize, bool) {
    let (mut at, mut seen) = (start, 0);
    while let Some(i) = b.iter().position(|&x| x == at) {
        at = c[i];
        seen += 1;
        if at == start || seen > b.len() {
            return (seen, at == start);
        }
    }
    (seen, false)
}
