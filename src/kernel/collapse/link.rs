//! The link condition of a collapse, and all else that topology asks of it: boundaries and locks.
//!
//! It looks at what `gather` has sorted, at nothing else, and changes only what it notes for carrying the
//! collapse out: the open edges that will move, and the hole that will close.
//!
//! Source: Dey et al. 1999 (docs/references.md; docs/algorithm.md, section 4).

use std::ops::Range;

use super::collapser::{Collapser, ROOM};
use crate::collapse::legality::Reject;
use crate::simd::Lanes;
use crate::simd::unchecked::{KnownIds, prefetch};
use crate::surface::Surface;
use crate::surface::class::Class;

/// True if a number is in a range of a list.
#[inline(always)]
fn has<L: Lanes>(list: &[u32; ROOM], range: Range<usize>, number: u32) -> bool {
    let mut found = 0;
    for from in range.clone().step_by(8) {
        let Some(eight) = list[from..].first_chunk::<8>() else { break };
        found |= L::matches(eight, number) & (0xFF >> (8 - (range.end - from).min(8)));
    }
    found != 0
}

impl Collapser {
    /// The link condition, boundaries and locks.
    #[inline(always)]
    pub(super) fn link<L: Lanes>(
        &mut self,
        known: KnownIds,
        surface: &Surface,
        v0: u32,
        v1: u32,
    ) -> Result<(), Reject> {
        let inner = |v: u32| known.at(&surface.rings, v).class == Some(Class::Interior);
        let usual = self.n - self.n_kept == 2 && (1..64).contains(&self.n_kept);
        if inner(v0) && inner(v1) && usual {
            self.open.clear();
            self.closes = None;
            self.link_inside::<L>(known, surface)
        } else if known.at(&surface.rings, v0).class == Some(Class::Junction) {
            self.link_along(surface, v0, v1)
        } else {
            self.link_anywhere::<L>(surface, v0, v1)
        }
    }

    /// The link condition of an edge between interior vertices.
    #[inline(always)]
    fn link_inside<L: Lanes>(&self, known: KnownIds, surface: &Surface) -> Result<(), Reject> {
        let [first, second, ..] = self.opposite;
        let len = |v: u32| {
            let ring = known.at(&surface.rings, v);
            // A triangle is taken out of it soon.
            prefetch(&surface.arena, ring.start);
            ring.len
        };
        let (len0, len1) = (len(first), len(second));
        if (first == second) | (len0 == 1) | (len1 == 1) {
            return Err(Reject::LinkCondition);
        }
        let (n0, n_kept) = (self.n0, self.n_kept);
        // Each neighbour comes up as `b` exactly once. One of both ends must be opposite to the edge.
        let mut common = 0;
        for from in (n0..n_kept).step_by(8) {
            let Some(list) = self.b[from..].first_chunk::<8>() else { break };
            let mut both = 0;
            for &w in &self.b[..n0] {
                both |= L::matches(list, w);
            }
            let known = L::matches(list, first) | L::matches(list, second);
            common |= both & !known & (0xFF >> (8 - (n_kept - from).min(8)));
        }
        // A triangle over both opposite corners at either end: the two would fall together.
        let mut over = 0u64;
        let lists = self.b.as_chunks::<8>().0.iter().zip(self.c.as_chunks::<8>().0);
        for (part, (b, c)) in lists.enumerate().take(n_kept.div_ceil(8)) {
            let b = L::matches(b, first) | L::matches(b, second);
            let c = L::matches(c, first) | L::matches(c, second);
            over |= u64::from(b & c) << (8 * part);
        }
        let of_v0 = (1u64 << n0) - 1;
        let of_v1 = ((1u64 << n_kept) - 1) & !of_v0;
        if (common != 0) | ((over & of_v0 != 0) & (over & of_v1 != 0)) {
            return Err(Reject::LinkCondition);
        }
        Ok(())
    }

    /// The same wherever a boundary, a lock or a crowd is near.
    #[inline(always)]
    fn link_anywhere<L: Lanes>(
        &mut self,
        surface: &Surface,
        v0: u32,
        v1: u32,
    ) -> Result<(), Reject> {
        let class = |v: u32| surface.rings[v as usize].class.unwrap_or(Class::Complex);
        let (class0, class1) = (class(v0), class(v1));
        let (n0, n_kept) = (self.n0, self.n_kept);
        let n_gone = self.n - n_kept;
        if n_gone == 2 && (class0 == Class::Boundary || self.opposite[0] == self.opposite[1]) {
            let bridge = class0 == Class::Boundary;
            return Err(if bridge { Reject::Boundary } else { Reject::LinkCondition });
        }
        // The edges to the third corner become one, which another triangle has to have.
        for &w in &self.opposite[..n_gone] {
            if !has::<L>(&self.b, 0..n_kept, w) && !has::<L>(&self.c, 0..n_kept, w) {
                return Err(Reject::Boundary);
            }
        }
        self.open.clear();
        if class0 == Class::Boundary {
            self.open_edges::<L>(v0, true);
        }
        match class1 {
            Class::Boundary => self.open_edges::<L>(v1, false),
            Class::Junction => self.curve_edges(surface, v1, v0),
            _ => {}
        }
        self.closes = None;
        // Every neighbour of v0 that also is one of v1 must be opposite to the edge.
        let (b0, c0) = (&self.b[..n0], &self.c[..n0]);
        let (b1, c1) = (&self.b[n0..n_kept], &self.c[n0..n_kept]);
        let opposite = self.opposite;
        let common_neighbour = |w: u32| w != opposite[0] && w != opposite[1];
        if class0 == Class::Interior && class1 == Class::Interior {
            // Each neighbour comes up as `b` exactly once.
            if b0.iter().any(|&w| common_neighbour(w) && has::<L>(&self.b, n0..n_kept, w)) {
                return Err(Reject::LinkCondition);
            }
        } else {
            let common =
                |w: u32| has::<L>(&self.b, n0..n_kept, w) || has::<L>(&self.c, n0..n_kept, w);
            for &w in b0.iter().chain(c0) {
                if !common_neighbour(w) || !common(w) {
                    continue;
                }
                let hole = self.open.contains(&(w, v0)) && self.open.contains(&(w, v1));
                if !(self.may_close && n_gone == 1 && hole && class(w) == Class::Boundary)
                    || self.closes.is_some_and(|other| other != w)
                {
                    return Err(Reject::LinkCondition);
                }
                self.closes = Some(w);
            }
        }
        if class1 == Class::Locked {
            for &w in b0.iter().chain(c0) {
                if class(w) == Class::Locked && common_neighbour(w) {
                    return Err(Reject::Locked);
                }
            }
        }
        if surface.has_locked_copies && self.meets_copy(surface) {
            return Err(Reject::LinkCondition);
        }
        if n_gone == 2 {
            // A triangle over both opposite corners at either end: the two would fall together.
            let over = |(&b, &c): (&u32, &u32)| !common_neighbour(b) && !common_neighbour(c);
            if b0.iter().zip(c0).any(over) && b1.iter().zip(c1).any(over) {
                return Err(Reject::LinkCondition);
            }
        }
        Ok(())
    }

    /// True if the ends have a common neighbour that neither sees as such: each is next to another copy of a locked vertex.
    #[inline(never)]
    pub(super) fn meets_copy(&self, surface: &Surface) -> bool {
        let is_locked = |w: &&u32| surface.rings[**w as usize].class == Some(Class::Locked);
        let place = |w: u32| surface.vertices[w as usize].position;
        let around = |range: Range<usize>| self.b[range.clone()].iter().chain(&self.c[range]);
        let opposite = &self.opposite[..self.n - self.n_kept];
        let mut of_v0 = around(0..self.n0).filter(is_locked).filter(|w| !opposite.contains(w));
        let of_v1 = || around(self.n0..self.n_kept).chain(opposite).filter(is_locked);
        of_v0.any(|&w| of_v1().any(|&x| x != w && place(x) == place(w)))
    }

    /// Collects the neighbours of an end over its open edges, the other end left out.
    #[inline(always)]
    fn open_edges<L: Lanes>(&mut self, v: u32, is_v0: bool) {
        let own = if is_v0 { 0..self.n0 } else { self.n0..self.n_kept };
        let n_gone = self.n - self.n_kept;
        // The vanishing triangles are noted as seen from v1: from v0 the third corner changes sides.
        let is_first = |i: usize| (self.b[self.n_kept + i] == self.opposite[i]) != is_v0;
        let vanishing = |w: u32, first: bool| {
            (0..n_gone).any(|i| self.opposite[i] == w && is_first(i) == first)
        };
        for i in own.clone() {
            let (b_i, c_i) = (self.b[i], self.c[i]);
            if !has::<L>(&self.c, own.clone(), b_i) && !vanishing(b_i, false) {
                self.open.push((b_i, v));
            }
            if !has::<L>(&self.b, own.clone(), c_i) && !vanishing(c_i, true) {
                self.open.push((c_i, v));
            }
        }
        for i in 0..n_gone {
            let w = self.opposite[i];
            let (facing, first) = if is_first(i) { (&self.c, true) } else { (&self.b, false) };
            if !has::<L>(facing, own.clone(), w) && !vanishing(w, !first) {
                self.open.push((w, v));
            }
        }
    }

    /// After a refusal: a common neighbour of both ends that no vanishing triangle explains.
    pub(crate) fn common_neighbour(&self, surface: &Surface) -> Option<u32> {
        if self.n - self.n_kept != 2 {
            return None;
        }
        let (b0, b1) = (&self.b[..self.n0], &self.b[self.n0..self.n_kept]);
        let inner = |w: u32| surface.rings[w as usize].class == Some(Class::Interior);
        let known = |w: u32| self.opposite[..2].contains(&w);
        b0.iter().copied().find(|&w| inner(w) && !known(w) && b1.contains(&w))
    }
}
