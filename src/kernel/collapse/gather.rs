//! Collects the triangles of both ends of an edge: first those that stay, then those that vanish.

use std::hint::select_unpredictable;

use crate::collapse::collapser::{Collapser, GONE_AT, ROOM};
use crate::collapse::legality::Reject;
use crate::simd::Lanes;
use crate::simd::unchecked::KnownIds;
use crate::surface::class::Class;
use crate::surface::junction::MOST_SHEETS;
use crate::surface::{MAX_VALENCE, Ring, Surface};

impl Collapser {
    /// Sorts the triangles of both ends into those that stay and those that vanish.
    #[inline(always)]
    pub(super) fn gather<L: Lanes>(
        &mut self,
        known: KnownIds,
        surface: &Surface,
        v0: u32,
        v1: u32,
    ) -> Result<(), Reject> {
        let (ring0, ring1) = (known.at(&surface.rings, v0), known.at(&surface.rings, v1));
        if ring0.len + ring1.len > MAX_VALENCE {
            return Err(Reject::Sliver);
        }
        // Eight are written where the next kept one goes, and what was not one is overwritten by the next:
        // which triangles vanish cannot be predicted.
        let mut n = 0;
        let mut first = 0;
        while first < ring0.len {
            let (ids, in_ring) = ids_of_ring(known, &surface.arena, ring0, first);
            let [b, c] = L::others(ids.map(|t| known.at(&surface.triangles, t)), v0);
            let keep = in_ring & !(L::matches(&b, v1) | L::matches(&c, v1));
            self.put::<L>(n, [&ids, &b, &c], keep);
            n += keep.count_ones() as usize;
            first += 8;
        }
        self.n0 = n;
        let mut n_gone = 0;
        let mut first = 0;
        while first < ring1.len {
            let (ids, in_ring) = ids_of_ring(known, &surface.arena, ring1, first);
            let [b, c] = L::others(ids.map(|t| known.at(&surface.triangles, t)), v1);
            let vanish = in_ring & (L::matches(&b, v0) | L::matches(&c, v0));
            let keep = in_ring & !vanish;
            self.put::<L>(n, [&ids, &b, &c], keep);
            n += keep.count_ones() as usize;
            self.put::<L>(GONE_AT | (n_gone & 7), [&ids, &b, &c], vanish);
            n_gone += vanish.count_ones() as usize;
            first += 8;
        }
        // Should the edge be refused, nothing of the one before it must be taken for a part of it.
        (self.n_kept, self.n) = (n, n);
        // Nothing is left of the edge, or it has more than two triangles.
        if n_gone == 0 {
            return Err(Reject::LinkCondition);
        }
        if n_gone > 2 {
            return self.gather_sheets((v0, v1), ring0.class, n_gone);
        }
        for from in [GONE_AT, GONE_AT + n_gone - 1] {
            (self.ids[n], self.b[n], self.c[n]) = (self.ids[from], self.b[from], self.c[from]);
            n += 1;
        }
        n = self.n_kept + n_gone;
        self.n = n;
        let opposite = |i: usize| select_unpredictable(self.b[i] == v0, self.c[i], self.b[i]);
        (self.opposite[0], self.opposite[1]) = (opposite(self.n_kept), opposite(n - 1));
        // An empty lane has both corners in one place.
        self.b[n..][..8].fill(v1);
        self.c[n..][..8].fill(v1);
        Ok(())
    }

    /// Takes up the vanishing triangles of an edge of more than two, which only a vertex on a junction curve may leave by.
    #[inline(never)]
    fn gather_sheets(
        &mut self,
        (v0, v1): (u32, u32),
        class0: Option<Class>,
        n_gone: usize,
    ) -> Result<(), Reject> {
        if class0 != Some(Class::Junction) || n_gone > MOST_SHEETS {
            return Err(Reject::NonManifold);
        }
        let n_kept = self.n_kept;
        for i in 0..n_gone {
            let (from, to) = (GONE_AT + i, n_kept + i);
            (self.ids[to], self.b[to], self.c[to]) = (self.ids[from], self.b[from], self.c[from]);
            self.opposite[i] = if self.b[to] == v0 { self.c[to] } else { self.b[to] };
        }
        self.n = n_kept + n_gone;
        self.b[self.n..][..8].fill(v1);
        self.c[self.n..][..8].fill(v1);
        Ok(())
    }

    /// Puts the triangles whose bits are set to where the next ones go.
    #[inline(always)]
    fn put<L: Lanes>(&mut self, n: usize, [ids, b, c]: [&[u32; 8]; 3], bits: u32) {
        let n = n & (ROOM - 1);
        for (to, list) in [(&mut self.ids, ids), (&mut self.b, b), (&mut self.c, c)] {
            if let Some(to) = to[n..].first_chunk_mut::<8>() {
                *to = L::packed(list, bits);
            }
        }
    }
}

/// Up to eight triangles of a ring, from the `first` one on, and as bits which of them are. What else comes out
/// are triangles too.
#[inline(always)]
fn ids_of_ring(known: KnownIds, arena: &[u32], ring: &Ring, first: u32) -> ([u32; 8], u32) {
    let left = (ring.len - first).min(8);
    let bits = 0xFF >> (8 - left);
    // What comes after a ring in the arena is anyone's.
    match arena.get((ring.start + first) as usize..).and_then(|list| list.first_chunk::<8>()) {
        Some(ids) => (*ids, bits),
        None => {
            let list = known.part(arena, ring.start + first, left);
            (std::array::from_fn(|i| list[i.min(list.len() - 1)]), bits)
        }
    }
}
