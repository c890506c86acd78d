//! Junction curves: edges at which three or more sheets meet, and which of them are more than noise.
//!
//! The triangles of a vertex in the middle of a curve form a book: three or more sheets, each a fan from one of two edges
//! to the other, and nothing else. Such a vertex may go along the curve. All other vertices on such edges stay where they are.
//!
//! Source: orders of simplices and the link condition by them of Dey et al. 1999 (docs/references.md; docs/design/junctions.md).

use crate::surface::class::Class;
use crate::surface::fan::Fan;
use crate::surface::{MAX_VALENCE, Surface};
use crate::vertex::GONE;
use stonecut_mesh::bounds::Bounds;
use stonecut_mesh::corners::others;
use stonecut_mesh::curves::{MANY, are_curves};

/// At edges of more triangles than this nothing collapses: room for those that vanish.
pub(crate) const MOST_SHEETS: usize = 7;
/// Edges that hang together are curves, however few, if their box has at least this share of the longest side of the whole mesh and
/// the number of their sheets is odd. Bodies that touch along an edge have an even number.
pub(crate) const LONG_CURVE: f64 = 0.25;

impl Fan {
    /// After a look at a vertex: true if its triangles form a book; then `ends` are the neighbours along the curve.
    pub(super) fn is_book(&mut self) -> bool {
        let (b, c) = (&self.b[..self.n], &self.c[..self.n]);
        let mut ends: [Option<(u32, usize)>; 2] = [None; 2];
        for (i, &w) in b.iter().chain(c).enumerate() {
            let is_seen = |list: &[u32]| list.contains(&w);
            let is_first = if i < self.n {
                !is_seen(&b[..i])
            } else {
                !is_seen(b) && !is_seen(&c[..i - self.n])
            };
            if !is_first {
                continue;
            }
            let n = b.iter().chain(c).filter(|&&other| other == w).count();
            if n == 2 {
                continue;
            }
            let Some(free) = ends.iter_mut().find(|end| end.is_none()) else { return false };
            *free = Some((w, n));
        }
        let [Some((from, n)), Some((to, n_to))] = ends else { return false };
        if n != n_to || !(3..=MOST_SHEETS).contains(&n) {
            return false;
        }
        // Every sheet leads from one end to the other, in its own sense of rotation.
        let (mut met, mut direct) = (0, 0);
        for i in 0..self.n {
            let ahead = b[i] == from;
            if !ahead && c[i] != from {
                continue;
            }
            let (list, other) = if ahead { (b, c) } else { (c, b) };
            let (mut at, mut length) = (other[i], 1);
            while at != to {
                let Some(next) = list.iter().position(|&w| w == at) else { return false };
                at = other[next];
                length += 1;
                if length > self.n || at == from {
                    return false;
                }
            }
            direct += usize::from(length == 1);
            met += length;
        }
        self.ends.clear();
        self.ends.extend([from, to]);
        met == self.n && direct <= 1
    }
}

/// True if the survivor of a collapse stays at `v1`, by the classes of both ends: where that must not move, and on a curve
/// that `v0` is not on.
#[inline(always)]
pub(crate) fn stays_at_v1(class0: Option<Class>, class1: Option<Class>) -> bool {
    class1 >= Some(Class::Junction) && (class1 != Some(Class::Junction) || class0 != class1)
}

impl Surface {
    /// True if the survivor of a collapse stays at `v1`.
    #[inline(always)]
    pub(crate) fn stays_at_v1(&self, v0: u32, v1: u32) -> bool {
        stays_at_v1(self.rings[v0 as usize].class, self.rings[v1 as usize].class)
    }

    /// Finds the neighbours over edges of three or more different triangles.
    pub(crate) fn junction_neighbours(&self, v: u32, found: &mut Vec<u32>) {
        let mut sides = [(0u32, 0u32); 2 * MAX_VALENCE as usize];
        let mut n = 0;
        found.clear();
        if self.rings[v as usize].len > MAX_VALENCE {
            return;
        }
        for &t in self.ring(v) {
            let triangle = self.triangles[t as usize];
            if triangle[0] != GONE {
                let (b, c) = others(triangle, v);
                (sides[n], sides[n + 1]) = ((b, c), (c, b));
                n += 2;
            }
        }
        let sides = &mut sides[..n];
        sides.sort_unstable();
        for edge in sides.chunk_by(|a, b| a.0 == b.0) {
            if edge.len() > 2 && edge.chunk_by(|a, b| a == b).count() > 2 {
                found.push(edge[0].0);
            }
        }
    }

    /// Returns whether the edges that hang together with a vertex on a curve of `n_sheets` would still be curves with one less.
    pub(crate) fn may_shorten(&self, v: u32, n_sheets: usize) -> bool {
        let (mut seen, mut at) = (vec![v], 0);
        let (mut n_sides, mut n_loose) = (0, 0);
        let mut around = Vec::new();
        while let Some(&v) = seen.get(at) {
            at += 1;
            // Beyond a locked vertex the curve is that of another cell.
            if self.rings[v as usize].class == Some(Class::Locked) {
                continue;
            }
            self.junction_neighbours(v, &mut around);
            n_loose += usize::from(around.len() == 1);
            for &w in &around {
                // Edges between two vertices that are not locked come up from both.
                n_sides += 1 + usize::from(self.rings[w as usize].class == Some(Class::Locked));
                if !seen.contains(&w) {
                    seen.push(w);
                }
            }
            if n_sides > 2 * (MANY + 1) {
                return true;
            }
        }
        let mut left = Bounds::EMPTY;
        seen[1..].iter().for_each(|&w| left.add(self.vertices[w as usize].position));
        n_sheets % 2 == 1 && left.side() >= self.long_curve
            || are_curves((n_sides / 2).saturating_sub(1), n_loose)
    }
}
