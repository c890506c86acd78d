//! One collapse: is it legal, and carrying it out.
//!
//! `v0` goes and `v1` stays. Looks at the two rings once, so that the tests, the new quadrics and the new
//! ring come from the same pass. The topological part is in `link`. It does not choose edges; `drive` does.

mod link;

use std::hint::select_unpredictable;

use super::Placement;
use super::attributes::RingLists;
use super::evaluate::{Around, Found, Rows};
use super::lanes::Lanes;
use super::legal::{Class, MAY_COLLAPSE, Reject};
use super::placement;
use super::surface::{Fan, GONE, HUB, MAX_VALENCE, Surface, Vertex, boundary_quadric, others};
use super::unchecked::{at, at_mut, part_mut};
use super::vector::Vec3;
use super::wedges::{Wedges, place_on_edge};

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
const GONE_AT: usize = ROOM - 8;
const _: () = assert!(GONE_AT >= MAX_VALENCE as usize + 16);

/// Scratch space of one collapse, re-used.
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
        self.gather(surface, v0, v1)?;
        self.link::<L>(surface, v0, v1)?;
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
            self.carry_out(surface, plan, &around, found.quadric(), number);
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
                surface.wedges = Some(wedges);
            }
            return;
        }
        let seam = wedges.plan(surface, (v0, v1), place_on_edge(around.half, plan.place));
        self.carry_out(surface, plan, around, quadric, number);
        wedges.carry_out(surface, &self.ids[..self.n0], v1, seam);
        surface.wedges = Some(wedges);
        if let Some(mut attributes) = surface.attributes.take() {
            attributes.refresh(surface, v1);
            for &w in self.b[..self.n].iter().chain(&self.c[..self.n]) {
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
            self.carry_out(surface, plan, around, quadric, number);
            return;
        };
        let fixed = at(&surface.rings, plan.v1).class.is_some_and(Class::is_fixed);
        attributes.before(surface, self.lists(plan), (&around.centre, plan.place), fixed);
        self.carry_out(surface, plan, around, quadric, number);
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
    fn gather(&mut self, surface: &Surface, v0: u32, v1: u32) -> Result<(), Reject> {
        let (ring0, ring1) = (surface.ring(v0), surface.ring(v1));
        if ring0.len() + ring1.len() > MAX_VALENCE as usize {
            return Err(Reject::Sliver);
        }
        // Everything is written where the next kept one goes and overwritten if it was not one: which
        // triangles vanish cannot be predicted.
        let mut n = 0;
        for &t in ring0 {
            let (b, c) = others(*at(&surface.triangles, t), v0);
            let place = n & (ROOM - 1);
            (self.ids[place], self.b[place], self.c[place]) = (t, b, c);
            n += usize::from((b != v1) & (c != v1));
        }
        self.n0 = n;
        let mut n_gone = 0;
        for &t in ring1 {
            let (b, c) = others(*at(&surface.triangles, t), v1);
            let vanishes = (b == v0) | (c == v0);
            let place = select_unpredictable(vanishes, GONE_AT | (n_gone & 3), n & (ROOM - 1));
            (self.ids[place], self.b[place], self.c[place]) = (t, b, c);
            n += usize::from(!vanishes);
            n_gone += usize::from(vanishes);
        }
        self.n_kept = n;
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

    #[inline(always)]
    fn carry_out(
        &mut self,
        surface: &mut Surface,
        plan: Plan,
        around: &Around,
        mut quadric: [f32; 9],
        number: u32,
    ) {
        let (v0, v1) = (plan.v0, plan.v1);
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
        let survivor = at_mut(&mut surface.vertices, v1);
        (survivor.quadric, survivor.stamp) = (quadric, number);
        self.rewire(surface, v0, v1);
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
        let t = super::vector::along(place, p0, p1) as f32;
        for channel in 0..n {
            let c0 = surface.channels[i0 * n + channel];
            let c1 = &mut surface.channels[i1 * n + channel];
            *c1 = c0 + t * (*c1 - c0);
        }
    }

    /// Triangles and rings after the collapse.
    #[inline(always)]
    fn rewire(&mut self, surface: &mut Surface, v0: u32, v1: u32) {
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
            let list = part_mut(&mut surface.arena, ring.start, ring.len);
            // Most rings are shorter than eight, and what comes after them in the arena is anyone's.
            let place = list.iter().position(|&x| x == t);
            if let Some(place) = place {
                list[place] = list[list.len() - 1];
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
            let start = surface.arena.len() as u32;
            surface.arena.resize(surface.arena.len() + n as usize, 0);
            (start, n)
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
