//! The link condition along a junction curve, where one triangle of each sheet vanishes with the edge.
//!
//! `v0` is in the middle of a curve; `v1` may be at its end. The curve and each sheet keep their topology: of the neighbours
//! along curves none is common to both ends, of the others only those opposite to the edge.
//!
//! Source: Dey et al. 1999 (docs/references.md; docs/design/junctions.md).

use crate::collapse::collapser::Collapser;
use crate::collapse::legality::Reject;
use crate::surface::Surface;
use crate::surface::class::Class;

impl Collapser {
    /// The link condition of an edge from a vertex in the middle of a junction curve.
    #[inline(never)]
    pub(super) fn link_along(&mut self, surface: &Surface, v0: u32, v1: u32) -> Result<(), Reject> {
        let class = |v: u32| surface.rings[v as usize].class.unwrap_or(Class::Complex);
        let (n0, n_kept) = (self.n0, self.n_kept);
        let n_gone = self.n - n_kept;
        self.closes = None;
        self.open.clear();
        // Not across a sheet, from one curve to another or to another part of the same one.
        if n_gone < 3 || !self.may_go_along {
            return Err(Reject::NonManifold);
        }
        self.curve_edges(surface, v0, v1);
        let n_before = self.open.len();
        self.curve_edges(surface, v1, v0);
        let (before, behind) = self.open.split_at(n_before);
        if before.iter().any(|(w, _)| behind.iter().any(|(other, _)| w == other)) {
            return Err(Reject::LinkCondition);
        }
        if class(v1) != Class::Junction {
            self.open.truncate(n_before);
        }
        let (b0, c0) = (&self.b[..n0], &self.c[..n0]);
        let (b1, c1) = (&self.b[n0..n_kept], &self.c[n0..n_kept]);
        let opposite = &self.opposite[..n_gone];
        let is_near_v1 = |w: &u32| b1.contains(w) || c1.contains(w);
        // The edges to a third corner become one, which another triangle has to have.
        let has_others = |w: &u32| is_near_v1(w) || b0.contains(w) || c0.contains(w);
        if !opposite.iter().all(has_others) {
            return Err(Reject::Boundary);
        }
        for w in b0.iter().chain(c0).filter(|w| !opposite.contains(w)) {
            if is_near_v1(w) {
                return Err(Reject::LinkCondition);
            }
            if class(v1) == Class::Locked && class(*w) == Class::Locked {
                return Err(Reject::Locked);
            }
        }
        // Triangles over the same two opposite corners at both ends would fall together.
        let over = |b: &u32, c: &u32| opposite.contains(b) && opposite.contains(c);
        let falls = |(b, c): (&u32, &u32)| {
            let mut others = b1.iter().zip(c1);
            over(b, c) && others.any(|(d, e)| (b == d && c == e) || (b == e && c == d))
        };
        if b0.iter().zip(c0).any(falls) {
            return Err(Reject::LinkCondition);
        }
        if surface.has_locked_copies && self.meets_copy(surface) {
            return Err(Reject::LinkCondition);
        }
        if !surface.may_shorten(v0, n_gone) {
            return Err(Reject::NonManifold);
        }
        Ok(())
    }

    /// Collects the neighbours of a vertex along junction curves, the other end of its edge left out.
    pub(super) fn curve_edges(&mut self, surface: &Surface, v: u32, other: u32) {
        let mut around = Vec::new();
        surface.junction_neighbours(v, &mut around);
        self.open.extend(around.into_iter().filter(|&w| w != other).map(|w| (w, v)));
    }
}
