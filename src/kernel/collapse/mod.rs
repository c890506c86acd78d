//! One collapse: is it legal, and carrying it out.
//!
//! `v0` goes and `v1` stays. Looks at the two rings once, so that the tests, the new quadrics and the new
//! ring come from the same pass. The topological part is in `link`. It does not choose edges; `schedule::levels` does.

pub(crate) mod legality;
pub(crate) mod wedges;

mod link;

use std::hint::select_unpredictable;

use crate::kernel::Placement;
use crate::kernel::collapse::legality::{Class, MAY_COLLAPSE, Reject};
use crate::kernel::collapse::wedges::{Wedges, place_on_edge};
use crate::kernel::cost::attributes::RingLists;
use crate::kernel::cost::fold_quadric;
use crate::kernel::cost::placement;
use crate::kernel::cost::quadric::{Around, Found, Rows};
use crate::kernel::simd::unchecked::{at, at_mut, part, part_mut};
use crate::kernel::simd::{Lanes, Portable};
use crate::kernel::surface::{
    Fan, GONE, HUB, MAX_VALENCE, Ring, Surface, Vertex, boundary_quadric,
};
use crate::mesh::vec3::Vec3;

/// A normal that turns further than this cosine is put off.
const FLIP_COSINE: f32 = 0.5;
/// Double area over the sum of squared edges below which a triangle is a needle (an aspect of about 70),
/// unless there was a worse one before.
const MIN_SHAPE: f32 = 0.007;

/// A collapse as planned by the evaluation of its edge.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Plan {
    pub(crate) v0: u32,
    pub(crate) v1: u32,
    /// Survivor's place relative to the edge's midpoint, scaled.
    pub(crate) place: [f32; 3],
    /// Whether a triangle may turn further than `FLIP_COSINE`.
    pub(crate) may_turn: bool,
}

/// Which end goes and which stays: the lower class goes, between equals the smaller room.
#[inline(always)]
pub(crate) fn roles(surface: &Surface, a: u32, b: u32) -> (u32, u32) {
    if let Some(wedges) = &surface.wedges {
        return roles_at_seams(surface, wedges, a, b);
    }
    let key = |v: u32| {
        let ring = at(&surface.rings, v);
        (ring.class.map_or(0, |class| class as u64) << 32) | u64::from(ring.room)
    };
    let (of_a, of_b) = (key(a), key(b));
    let swap = (of_b < of_a) | ((of_b == of_a) & (b < a));
    (select_unpredictable(swap, b, a), select_unpredictable(swap, a, b))
}

/// The same where there are seams: between equals what is off the seams goes.
#[inline(never)]
fn roles_at_seams(surface: &Surface, wedges: &Wedges, a: u32, b: u32) -> (u32, u32) {
    let key = |v: u32| {
        let ring = at(&surface.rings, v);
        (ring.class, wedges.is_seam(v), ring.room, v)
    };
    if key(b) < key(a) { (b, a) } else { (a, b) }
}

/// Whether the classes of the ends allow it.
#[inline(always)]
pub(crate) fn classes_allow(surface: &Surface, v0: u32, v1: u32) -> Result<(), Reject> {
    match (at(&surface.rings, v0).class, at(&surface.rings, v1).class) {
        (Some(class0), Some(class1)) => MAY_COLLAPSE[class0 as usize][class1 as usize],
        _ => Err(Reject::LinkCondition),
    }
}

/// Room for the triangles of both ends, in whole parts of eight; a power of two, so that a place in it needs
/// no check.
const ROOM: usize = 256;
/// Where the vanishing triangles are put until it is known how many stay.
const GONE_AT: usize = ROOM - 16;
const _: () = assert!(GONE_AT >= MAX_VALENCE as usize + 16);

/// Scratch space of one collapse, re-used.
#[derive(Clone)]
pub(crate) struct Collapser {
    /// Triangles of `v0` (first `n0`) and of `v1` that stay (up to `n_kept`), then those that vanish (up
    /// to `n`).
    ids: [u32; ROOM],
    b: [u32; ROOM],
    c: [u32; ROOM],
    n0: usize,
    n_kept: usize,
    n: usize,
    /// Third corners of the vanishing triangles; the first twice if there is only one.
    opposite: [u32; 2],
    /// Neighbours over open edges of either end, and from which end.
    open: Vec<(u32, u32)>,
    /// Third vertex of a hole of three edges that the collapse closes.
    closes: Option<u32>,
    may_close: bool,
    fan: Fan,
    /// Quadrics of the triangles after minus before.
    changes: Vec<Rows>,
}

/// The vertices of some ids.
#[inline(always)]
pub(crate) fn eight<'a>(vertices: &'a [Vertex], ids: &[u32; 8]) -> [&'a Vertex; 8] {
    let of = |i: usize| at(vertices, ids[i]);
    [of(0), of(1), of(2), of(3), of(4), of(5), of(6), of(7)]
}

impl Collapser {
    /// `may_close`: whether holes of three edges may close.
    pub(crate) fn new(may_close: bool) -> Self {
        Collapser {
            ids: [0; ROOM],
            b: [0; ROOM],
            c: [0; ROOM],
            n0: 0,
            n_kept: 0,
            n: 0,
            opposite: [0; 2],
            open: Vec::new(),
            closes: None,
            may_close,
            fan: Fan::new(),
            changes: vec![Rows::ZERO; ROOM / 8],
        }
    }

    /// Checks topology, then geometry; carries the collapse out if both agree. `number` becomes the
    /// stamp of every vertex whose quadric changes.
    #[inline(always)]
    pub(crate) fn attempt<L: Lanes>(
        &mut self,
        surface: &mut Surface,
        plan: Plan,
        number: u32,
    ) -> Result<(), Reject> {
        let (v0, v1) = (plan.v0, plan.v1);
        self.gather::<L>(surface, v0, v1)?;
        self.link::<L>(surface, v0, v1)?;
        if let Some(wedges) = &surface.wedges {
            self.keep_locked_wedges(surface, wedges, plan)?;
        }
        let (p0, p1) = (at(&surface.vertices, v0).position, at(&surface.vertices, v1).position);
        let middle = |i: usize| p0[i] + (p1[i] - p0[i]) * 0.5;
        let around = Around {
            centre: [middle(0), middle(1), middle(2)],
            scale: surface.scale,
            half: surface.edge(v0, v1).map(|x| x * 0.5),
            after: plan.place,
        };
        let mut found = Found::<L>::new();
        let (bs, cs) = (self.b.as_chunks::<8>().0, self.c.as_chunks::<8>().0);
        let (mut n0, mut n_kept) = (self.n0 as f32, self.n_kept as f32);
        let parts = bs.iter().zip(cs).zip(&mut self.changes);
        for ((b, c), change) in parts.take(self.n.div_ceil(8)) {
            let corners = (eight(&surface.vertices, b), eight(&surface.vertices, c));
            found.look(&around, corners, (n0, n_kept), change);
            (n0, n_kept) = (n0 - 8.0, n_kept - 8.0);
        }
        if !plan.may_turn {
            if found.cosine() < FLIP_COSINE {
                return Err(Reject::Flip);
            }
            let (before, after) = found.shapes();
            if after < MIN_SHAPE && after < before {
                return Err(Reject::Sliver);
            }
        }
        if surface.attributes.is_some() | surface.wedges.is_some() {
            self.with_wedges(surface, plan, &around, found.quadric(), number);
        } else {
            self.carry_out::<L>(surface, plan, &around, found.quadric(), number);
        }
        Ok(())
    }

    /// A locked vertex keeps a triangle with the wedge that other cells know.
    #[inline(never)]
    fn keep_locked_wedges(
        &self,
        surface: &Surface,
        wedges: &Wedges,
        plan: Plan,
    ) -> Result<(), Reject> {
        let is_locked = |v: u32| at(&surface.rings, v).class == Some(Class::Locked);
        let vanishing = &self.ids[self.n_kept..self.n];
        let is_kept = |w: u32| {
            let mut others = surface.ring(w).iter().filter(|t| !vanishing.contains(t));
            others.any(|&t| wedges.is_own(surface, t, w))
        };
        let third = &self.opposite[..self.n - self.n_kept];
        if third.iter().any(|&w| is_locked(w) && !is_kept(w))
            || is_locked(plan.v1)
                && wedges.concern(plan.v0, plan.v1)
                && !is_kept(plan.v1)
                && !wedges.becomes_own(surface, &self.ids[..self.n0], (plan.v0, plan.v1))
        {
            return Err(Reject::Locked);
        }
        Ok(())
    }

    /// Carries the collapse out where channels count or seams are.
    #[inline(never)]
    fn with_wedges(
        &mut self,
        surface: &mut Surface,
        plan: Plan,
        around: &Around,
        quadric: [f32; 9],
        number: u32,
    ) {
        let (v0, v1) = (plan.v0, plan.v1);
        let Some(mut wedges) = surface.wedges.take() else {
            self.with_attributes(surface, plan, around, quadric, number);
            return;
        };
        if !wedges.concern(v0, v1) {
            let wedge = wedges.single(surface, v1);
            surface.wedges = Some(wedges);
            self.with_attributes(surface, plan, around, quadric, number);
            if let (Some(wedge), Some(mut wedges)) = (wedge, surface.wedges.take()) {
                wedges.rename(surface, &self.ids[..self.n0], v1, wedge);
                // A chart may have vanished from the third corners.
                for &w in &self.opposite[..self.n - self.n_kept] {
                    wedges.look_again(surface, w);
                }
                surface.wedges = Some(wedges);
            }
            return;
        }
        let seam = wedges.plan(surface, (v0, v1), place_on_edge(around.half, plan.place));
        self.carry_out::<Portable>(surface, plan, around, quadric, number);
        wedges.carry_out(surface, &self.ids[..self.n0], v1, seam);
        surface.wedges = Some(wedges);
        if let Some(mut attributes) = surface.attributes.take() {
            attributes.refresh(surface, v1);
            // Each neighbour comes up as both corners, as a rule.
            let mut around = [&self.b[..self.n], &self.c[..self.n]].concat();
            around.sort_unstable();
            around.dedup();
            for w in around {
                attributes.refresh(surface, w);
            }
            surface.attributes = Some(attributes);
        }
    }

    /// Carries the collapse out off the seams.
    fn with_attributes(
        &mut self,
        surface: &mut Surface,
        plan: Plan,
        around: &Around,
        quadric: [f32; 9],
        number: u32,
    ) {
        let Some(mut attributes) = surface.attributes.take() else {
            self.carry_out::<Portable>(surface, plan, around, quadric, number);
            return;
        };
        let fixed = at(&surface.rings, plan.v1).class.is_some_and(Class::is_fixed);
        attributes.before(surface, self.lists(plan), (&around.centre, plan.place), fixed);
        self.carry_out::<Portable>(surface, plan, around, quadric, number);
        attributes.after(surface, self.lists(plan), fixed);
        surface.attributes = Some(attributes);
    }

    fn lists(&self, plan: Plan) -> RingLists<'_> {
        RingLists {
            v0: plan.v0,
            v1: plan.v1,
            b: &self.b,
            c: &self.c,
            ids: &self.ids,
            n0: self.n0,
            n_kept: self.n_kept,
            n: self.n,
        }
    }

    /// Sorts the triangles of both ends into those that stay and those that vanish.
    #[inline(always)]
    fn gather<L: Lanes>(&mut self, surface: &Surface, v0: u32, v1: u32) -> Result<(), Reject> {
        let (ring0, ring1) = (at(&surface.rings, v0), at(&surface.rings, v1));
        if ring0.len + ring1.len > MAX_VALENCE {
            return Err(Reject::Sliver);
        }
        // Eight are written where the next kept one goes, and what was not one is overwritten by the next:
        // which triangles vanish cannot be predicted.
        let mut n = 0;
        let mut first = 0;
        while first < ring0.len {
            let (ids, in_ring) = ids_of_ring(&surface.arena, ring0, first);
            let [b, c] = L::others(ids.map(|t| at(&surface.triangles, t)), v0);
            let keep = in_ring & !(L::matches(&b, v1) | L::matches(&c, v1));
            self.put::<L>(n, (&ids, &b, &c), keep);
            n += keep.count_ones() as usize;
            first += 8;
        }
        self.n0 = n;
        let mut n_gone = 0;
        let mut first = 0;
        while first < ring1.len {
            let (ids, in_ring) = ids_of_ring(&surface.arena, ring1, first);
            let [b, c] = L::others(ids.map(|t| at(&surface.triangles, t)), v1);
            let vanish = in_ring & (L::matches(&b, v0) | L::matches(&c, v0));
            let keep = in_ring & !vanish;
            self.put::<L>(n, (&ids, &b, &c), keep);
            n += keep.count_ones() as usize;
            self.put::<L>(GONE_AT | (n_gone & 7), (&ids, &b, &c), vanish);
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
            return Err(Reject::NonManifold);
        }
        for from in [GONE_AT, GONE_AT + n_gone - 1] {
            (self.ids[n], self.b[n], self.c[n]) = (self.ids[from], self.b[from], self.c[from]);
            n += 1;
        }
        n = self.n_kept + n_gone;
        self.n = n;
        let opposite = |i: usize| select_unpredictable(self.b[i] == v0, self.c[i], self.b[i]);
        self.opposite = [opposite(self.n_kept), opposite(n - 1)];
        // An empty lane has both corners in one place.
        self.b[n..][..8].fill(v1);
        self.c[n..][..8].fill(v1);
        Ok(())
    }

    /// Puts the triangles whose bits are set to where the next ones go.
    #[inline(always)]
    fn put<L: Lanes>(
        &mut self,
        n: usize,
        (ids, b, c): (&[u32; 8], &[u32; 8], &[u32; 8]),
        bits: u32,
    ) {
        let n = n & (ROOM - 1);
        for (to, list) in [(&mut self.ids, ids), (&mut self.b, b), (&mut self.c, c)] {
            if let Some(to) = to[n..].first_chunk_mut::<8>() {
                *to = L::packed(list, bits);
            }
        }
    }

    #[inline(always)]
    fn carry_out<L: Lanes>(
        &mut self,
        surface: &mut Surface,
        plan: Plan,
        around: &Around,
        mut quadric: [f32; 9],
        number: u32,
    ) {
        let (v0, v1) = (plan.v0, plan.v1);
        let folds = fold_quadric::may_fold(&quadric);
        let fixed = at(&surface.rings, v1).class.is_some_and(Class::is_fixed);
        // The open edges change before the corner moves: their old lengths are still to be had.
        for &(w, from) in &self.open {
            let old = boundary_quadric(surface.edge(w, from));
            let sum = &mut surface.vertices[w as usize].quadric;
            for (sum, x) in sum.iter_mut().zip(old) {
                *sum -= x;
            }
        }
        if !fixed && surface.placement == Placement::Subset {
            placement::keep_an_end(surface, (v0, v1), &plan.place);
        } else if !fixed {
            let (centre, unscale) = (&around.centre, surface.unscale);
            let place = |i: usize| centre[i] + f64::from(plan.place[i]) * unscale;
            let place = [place(0), place(1), place(2)];
            if surface.n_channels > 0 {
                self.blend_channels(surface, plan, place);
            }
            at_mut(&mut surface.vertices, v1).position = place;
        }
        // The rows of vanishing triangles also touch v0, which is no more.
        let (bs, cs) = (self.b.as_chunks::<8>().0, self.c.as_chunks::<8>().0);
        let mut left = self.n;
        for ((b, c), change) in bs.iter().zip(cs).zip(&self.changes).take(self.n.div_ceil(8)) {
            for row in 0..left.min(8) {
                for w in [b[row], c[row]] {
                    let vertex = at_mut(&mut surface.vertices, w);
                    change.add_to(row, &mut vertex.quadric);
                    vertex.stamp = number;
                }
            }
            left = left.saturating_sub(8);
        }
        let class0 = at(&surface.rings, v0).class;
        for &(w, _) in &self.open {
            if self.closes == Some(w) {
                continue;
            }
            let new = boundary_quadric(surface.edge(w, v1));
            let sum = &mut surface.vertices[w as usize].quadric;
            for k in 0..6 {
                sum[k] += new[k];
                quadric[k] += new[k];
            }
            surface.vertices[w as usize].stamp = number;
        }
        if folds {
            let around = (&self.b[..self.n_kept], &self.c[..self.n_kept]);
            let held = fold_quadric::quadric(surface, v1, around.0, around.1);
            for (sum, x) in quadric.iter_mut().zip(held) {
                *sum += x;
            }
        }
        let survivor = at_mut(&mut surface.vertices, v1);
        (survivor.quadric, survivor.stamp) = (quadric, number);
        self.rewire::<L>(surface, v0, v1);
        if class0 != Some(Class::Interior) {
            let ring = at_mut(&mut surface.rings, v1);
            ring.class = ring.class.max(class0);
        }
        if let Some(w) = self.closes {
            for v in [v1, w] {
                surface.rings[v as usize].class = Some(self.fan.look(surface, v));
            }
        }
    }

    /// Interpolates the channels of the survivor along the edge.
    fn blend_channels(&self, surface: &mut Surface, plan: Plan, place: Vec3) {
        let (i0, i1) = (plan.v0 as usize, plan.v1 as usize);
        let n = surface.n_channels;
        let (p0, p1) = (surface.vertices[i0].position, surface.vertices[i1].position);
        let t = crate::mesh::vec3::along(place, p0, p1) as f32;
        for channel in 0..n {
            let c0 = surface.channels[i0 * n + channel];
            let c1 = &mut surface.channels[i1 * n + channel];
            *c1 = c0 + t * (*c1 - c0);
        }
    }

    /// Triangles and rings after the collapse.
    #[inline(always)]
    fn rewire<L: Lanes>(&mut self, surface: &mut Surface, v0: u32, v1: u32) {
        for &t in &self.ids[..self.n0] {
            let triangle = at_mut(&mut surface.triangles, t);
            let [x, y, z] = *triangle;
            let moved = |v: u32| select_unpredictable(v == v0, v1, v);
            *triangle = [moved(x), moved(y), moved(z)];
        }
        for (&t, &w) in self.ids[self.n_kept..self.n].iter().zip(&self.opposite) {
            at_mut(&mut surface.triangles, t)[0] = GONE;
            surface.n_alive -= 1;
            let ring = at_mut(&mut surface.rings, w);
            // Never gathered, and built anew by the next compaction: a search would cost its length each time.
            if ring.len > HUB {
                continue;
            }
            let place = place_in_ring::<L>(&surface.arena, ring, t);
            if place < ring.len {
                let last = *at(&surface.arena, ring.start + ring.len - 1);
                *at_mut(&mut surface.arena, ring.start + place) = last;
                ring.len -= 1;
            }
        }
        let kept = &self.ids[..self.n_kept];
        let (ring0, ring1) = (*at(&surface.rings, v0), *at(&surface.rings, v1));
        let n = kept.len() as u32;
        let (start, room) = if n <= ring1.room {
            (ring1.start, ring1.room)
        } else if n <= ring0.room {
            (ring0.start, ring0.room)
        } else {
            (surface.append_room(n as usize), n)
        };
        // Too few to be worth a call.
        for (to, &id) in part_mut(&mut surface.arena, start, n).iter_mut().zip(kept) {
            *to = id;
        }
        let ring = at_mut(&mut surface.rings, v1);
        (ring.start, ring.len, ring.room) = (start, n, room);
        let ring = at_mut(&mut surface.rings, v0);
        (ring.start, ring.len, ring.class) = (v1, 0, None);
    }
}

/// Where in a ring a triangle is; at its length or beyond if it is not in it.
#[inline(always)]
fn place_in_ring<L: Lanes>(arena: &[u32], ring: &Ring, triangle: u32) -> u32 {
    // Most rings are no longer than eight, and what comes after them in the arena is anyone's.
    if let Some(first) = arena.get(ring.start as usize..).and_then(|list| list.first_chunk::<8>()) {
        let place = L::matches(first, triangle).trailing_zeros();
        if place < 8 || ring.len <= 8 {
            return place;
        }
    }
    let place = part(arena, ring.start, ring.len).iter().position(|&x| x == triangle);
    place.map_or(ring.len, |place| place as u32)
}

/// Up to eight triangles of a ring, from the `first` one on, and as bits which of them are. What else comes out
/// are triangles too.
#[inline(always)]
fn ids_of_ring(arena: &[u32], ring: &Ring, first: u32) -> ([u32; 8], u32) {
    let left = (ring.len - first).min(8);
    let bits = 0xFF >> (8 - left);
    // What comes after a ring in the arena is anyone's.
    match arena.get((ring.start + first) as usize..).and_then(|list| list.first_chunk::<8>()) {
        Some(ids) => (*ids, bits),
        None => {
            let list = part(arena, ring.start + first, left);
            (std::array::from_fn(|i| list[i.min(list.len() - 1)]), bits)
        }
    }
}
