//! One collapse: is it legal, and carrying it out.
//!
//! `v0` goes and `v1` stays. Looks at the two rings once, so that the tests, the new quadrics and the new
//! ring come from the same pass. It does not choose edges; `drive` does.

use super::evaluate::{RingGeometry, RingPart};
use super::lanes::Simd;
use super::legal::{Class, MAY_COLLAPSE, Reject};
use super::surface::{Fan, GONE, HUB, MAX_VALENCE, Surface, boundary_quadric, others};
use super::vector::Vec3;

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

/// Which end goes and which stays: the lower class goes, between equals the shorter ring.
#[inline(always)]
pub(crate) fn roles(surface: &Surface, a: u32, b: u32) -> (u32, u32) {
    let key = |v: u32| {
        let ring = &surface.rings[v as usize];
        let class = ring.class.map_or(0, |class| class as u64);
        class << 40 | u64::from(ring.room.min(255)) << 32 | u64::from(v)
    };
    let (a, b) = (key(a), key(b));
    (a.min(b) as u32, a.max(b) as u32)
}

/// Whether the classes of the ends allow it.
#[inline(always)]
pub(crate) fn classes_allow(surface: &Surface, v0: u32, v1: u32) -> Result<(), Reject> {
    match (surface.rings[v0 as usize].class, surface.rings[v1 as usize].class) {
        (Some(class0), Some(class1)) => MAY_COLLAPSE[class0 as usize][class1 as usize],
        _ => Err(Reject::LinkCondition),
    }
}

/// Room for the triangles of both ends, in whole parts of eight.
const ROOM: usize = MAX_VALENCE as usize + 8;

/// Scratch space of one collapse, re-used.
pub(crate) struct Collapser {
    /// Triangles of `v0` (first `n0`) and of `v1` that stay (up to `n_kept`), then those that vanish (up
    /// to `n`).
    ids: [u32; ROOM],
    b: [u32; ROOM],
    c: [u32; ROOM],
    /// -1 for a triangle of `v0`, 1 for one of `v1`.
    side: [f32; ROOM],
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
    parts: Vec<RingGeometry>,
}

impl Collapser {
    /// `may_close`: whether holes of three edges may close.
    pub(crate) fn new(may_close: bool) -> Self {
        Collapser {
            ids: [0; ROOM],
            b: [0; ROOM],
            c: [0; ROOM],
            side: [0.0; ROOM],
            n0: 0,
            n_kept: 0,
            n: 0,
            opposite: [0; 2],
            open: Vec::new(),
            closes: None,
            may_close,
            fan: Fan::new(),
            parts: vec![RingGeometry::ZERO; ROOM / 8],
        }
    }

    /// Checks topology, then geometry; carries the collapse out if both agree. `number` becomes the
    /// stamp of every vertex whose quadric changes.
    pub(crate) fn attempt(
        &mut self,
        surface: &mut Surface,
        plan: Plan,
        number: u32,
        simd: Simd,
    ) -> Result<(), Reject> {
        let (v0, v1) = (plan.v0, plan.v1);
        self.gather(surface, v0, v1)?;
        self.link(surface, v0, v1)?;
        let (p0, p1) =
            (surface.vertices[v0 as usize].position, surface.vertices[v1 as usize].position);
        let centre: Vec3 = std::array::from_fn(|i| p0[i] + (p1[i] - p0[i]) * 0.5);
        self.measure(surface, plan, &centre, simd);
        self.shapes(plan.may_turn)?;
        self.carry_out(surface, plan, &centre, number);
        Ok(())
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
        let mut gone = [[0u32; 3]; 4];
        let mut n_gone = 0;
        let mut n = 0;
        for &t in ring0 {
            let (b, c) = others(surface.triangles[t as usize], v0);
            let vanishes = b == v1 || c == v1;
            gone[n_gone] = [t, b, c];
            (self.ids[n], self.b[n], self.c[n], self.side[n]) = (t, b, c, -1.0);
            n_gone = (n_gone + usize::from(vanishes)).min(3);
            n += usize::from(!vanishes);
        }
        if n_gone > 2 {
            return Err(Reject::NonManifold);
        }
        self.n0 = n;
        for &t in ring1 {
            let (b, c) = others(surface.triangles[t as usize], v1);
            (self.ids[n], self.b[n], self.c[n], self.side[n]) = (t, b, c, 1.0);
            n += usize::from(b != v0 && c != v0);
        }
        self.n_kept = n;
        for (i, &[t, b, c]) in gone[..n_gone].iter().enumerate() {
            (self.ids[n], self.b[n], self.c[n], self.side[n]) = (t, b, c, -1.0);
            n += 1;
            self.opposite[i] = if b == v1 { c } else { b };
        }
        self.n = n;
        match n_gone {
            // Nothing is left of the edge.
            0 => return Err(Reject::LinkCondition),
            1 => self.opposite[1] = self.opposite[0],
            _ => {}
        }
        let filled = n.next_multiple_of(8);
        self.b[n..filled].fill(v1);
        self.c[n..filled].fill(v1);
        Ok(())
    }

    /// The link condition, boundaries and locks.
    fn link(&mut self, surface: &Surface, v0: u32, v1: u32) -> Result<(), Reject> {
        let class = |v: u32| surface.rings[v as usize].class.unwrap_or(Class::Complex);
        let (class0, class1) = (class(v0), class(v1));
        let (n0, n_kept) = (self.n0, self.n_kept);
        let n_gone = self.n - n_kept;
        if n_gone == 2 && (class0 == Class::Boundary || self.opposite[0] == self.opposite[1]) {
            let bridge = class0 == Class::Boundary;
            return Err(if bridge { Reject::Boundary } else { Reject::LinkCondition });
        }
        for &w in &self.opposite[..n_gone] {
            if surface.rings[w as usize].len == 1 {
                return Err(Reject::Boundary);
            }
        }
        self.open.clear();
        if class0 == Class::Boundary {
            self.open_edges(v0, v1, true);
        }
        if class1 == Class::Boundary {
            self.open_edges(v1, v0, false);
        }
        self.closes = None;
        // Every neighbour of v0 that also is one of v1 must be opposite to the edge.
        let (b0, c0) = (&self.b[..n0], &self.c[..n0]);
        let (b1, c1) = (&self.b[n0..n_kept], &self.c[n0..n_kept]);
        let opposite = self.opposite;
        let stranger = |w: u32| w != opposite[0] && w != opposite[1];
        if class0 == Class::Interior && class1 == Class::Interior {
            // Each neighbour comes up as `b` exactly once.
            if b0.iter().any(|&w| b1.contains(&w) && stranger(w)) {
                return Err(Reject::LinkCondition);
            }
        } else {
            let common = |w: u32| b1.contains(&w) || c1.contains(&w);
            for &w in b0.iter().chain(c0).filter(|&&w| stranger(w) && common(w)) {
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
                if class(w) == Class::Locked && stranger(w) {
                    return Err(Reject::Locked);
                }
            }
        }
        if n_gone == 2 {
            // A triangle over both opposite corners at either end: the two would fall together.
            let over = |(&b, &c): (&u32, &u32)| !stranger(b) && !stranger(c);
            if b0.iter().zip(c0).any(over) && b1.iter().zip(c1).any(over) {
                return Err(Reject::LinkCondition);
            }
        }
        Ok(())
    }

    /// Collects the neighbours of an end over its open edges, the other end left out.
    fn open_edges(&mut self, v: u32, other: u32, is_v0: bool) {
        let own = if is_v0 { 0..self.n0 } else { self.n0..self.n_kept };
        // The vanishing triangles are noted as seen from v0: from v1 the third corner changes sides.
        let vanishing = (self.n_kept..self.n).map(|i| {
            let w = self.opposite[i - self.n_kept];
            let other_first = (self.b[i] == w) != is_v0;
            if other_first { (other, w) } else { (w, other) }
        });
        let pairs: Vec<(u32, u32)> = own.map(|i| (self.b[i], self.c[i])).chain(vanishing).collect();
        for &(b, c) in &pairs {
            if b != other && !pairs.iter().any(|&(_, x)| x == b) {
                self.open.push((b, v));
            }
            if c != other && !pairs.iter().any(|&(x, _)| x == c) {
                self.open.push((c, v));
            }
        }
    }

    /// Normals, quadrics and shapes of all triangles of both rings, before and after.
    #[inline(always)]
    fn measure(&mut self, surface: &Surface, plan: Plan, centre: &Vec3, simd: Simd) {
        let half = surface.edge(plan.v0, plan.v1).map(|x| x * 0.5);
        let parts = self.n.div_ceil(8);
        let (bs, cs) = (self.b.as_chunks::<8>().0, self.c.as_chunks::<8>().0);
        let sides = self.side.as_chunks::<8>().0;
        for (part, out) in self.parts.iter_mut().enumerate().take(parts) {
            let vertex = |v: u32| &surface.vertices[v as usize];
            simd.run(RingPart {
                b: bs[part].map(vertex),
                c: cs[part].map(vertex),
                side: &sides[part],
                half,
                after: plan.place,
                centre,
                scale: surface.scale,
                n_kept: self.n_kept as f32 - (part * 8) as f32,
                n_used: self.n as f32 - (part * 8) as f32,
                out,
            });
        }
    }

    /// Refuses what would turn too far, or become a needle.
    fn shapes(&self, may_turn: bool) -> Result<(), Reject> {
        let (mut cosine, mut before, mut after) = (1.0f32, 1.0f32, 1.0f32);
        for part in &self.parts[..self.n.div_ceil(8)] {
            cosine = cosine.min(part.cosine);
            before = before.min(part.shape_before);
            after = after.min(part.shape_after);
        }
        if cosine < FLIP_COSINE && !may_turn {
            return Err(Reject::Flip);
        }
        if after < MIN_SHAPE && after < before && !may_turn {
            return Err(Reject::Sliver);
        }
        Ok(())
    }

    fn carry_out(&mut self, surface: &mut Surface, plan: Plan, centre: &Vec3, number: u32) {
        let (v0, v1) = (plan.v0, plan.v1);
        let fixed = surface.rings[v1 as usize].class.is_some_and(Class::is_fixed);
        // The open edges change before the corner moves: their old lengths are still to be had.
        for &(w, from) in &self.open {
            let old = boundary_quadric(surface.edge(w, from));
            let sum = &mut surface.vertices[w as usize].quadric;
            for (sum, x) in sum.iter_mut().zip(old) {
                *sum -= x;
            }
        }
        if !fixed {
            let place = plan.place.map(|x| f64::from(x) / surface.scale);
            self.move_survivor(surface, plan, std::array::from_fn(|i| centre[i] + place[i]));
        }
        let mut quadric = [0.0f32; 9];
        for part in &self.parts[..self.n.div_ceil(8)] {
            for (sum, x) in quadric.iter_mut().zip(part.total) {
                *sum += x;
            }
        }
        // The rows of vanishing triangles also touch v1, whose quadric is replaced below.
        for i in 0..self.n {
            let change = &self.parts[i / 8].change;
            for w in [self.b[i], self.c[i]] {
                let vertex = &mut surface.vertices[w as usize];
                change.add_to(i % 8, &mut vertex.quadric);
                vertex.stamp = number;
            }
        }
        let class0 = surface.rings[v0 as usize].class;
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
        surface.vertices[v1 as usize].quadric = quadric;
        surface.vertices[v1 as usize].stamp = number;
        self.rewire(surface, v0, v1);
        let ring = &mut surface.rings[v1 as usize];
        ring.class = ring.class.max(class0);
        if let Some(w) = self.closes {
            for v in [v1, w] {
                surface.rings[v as usize].class = Some(self.fan.look(surface, v));
            }
        }
    }

    /// After a refusal: a common neighbour of both ends that no vanishing triangle explains.
    pub(crate) fn stranger(&self, surface: &Surface) -> Option<u32> {
        if self.n - self.n_kept != 2 {
            return None;
        }
        let (b0, b1) = (&self.b[..self.n0], &self.b[self.n0..self.n_kept]);
        let inner = |w: u32| surface.rings[w as usize].class == Some(Class::Interior);
        let known = |w: u32| self.opposite.contains(&w);
        b0.iter().copied().find(|&w| inner(w) && !known(w) && b1.contains(&w))
    }

    /// Puts the survivor in its place, its channels interpolated along the edge.
    fn move_survivor(&self, surface: &mut Surface, plan: Plan, place: Vec3) {
        let (i0, i1) = (plan.v0 as usize, plan.v1 as usize);
        let n = surface.n_channels;
        if n > 0 {
            let (p0, p1) = (surface.vertices[i0].position, surface.vertices[i1].position);
            let t = super::vector::along(place, p0, p1) as f32;
            for channel in 0..n {
                let c0 = surface.channels[i0 * n + channel];
                let c1 = &mut surface.channels[i1 * n + channel];
                *c1 = c0 + t * (*c1 - c0);
            }
        }
        surface.vertices[i1].position = place;
    }

    /// Triangles and rings after the collapse.
    fn rewire(&mut self, surface: &mut Surface, v0: u32, v1: u32) {
        for &t in &self.ids[..self.n0] {
            let triangle = &mut surface.triangles[t as usize];
            *triangle = triangle.map(|v| if v == v0 { v1 } else { v });
        }
        for (&t, &w) in self.ids[self.n_kept..self.n].iter().zip(&self.opposite) {
            surface.triangles[t as usize][0] = GONE;
            surface.n_alive -= 1;
            let ring = &mut surface.rings[w as usize];
            // Never gathered, and built anew by the next compaction: a search would cost its length each time.
            if ring.len > HUB {
                continue;
            }
            let (start, end) = (ring.start as usize, (ring.start + ring.len) as usize);
            let list = &mut surface.arena[start..end];
            if let Some(at) = list.iter().position(|&x| x == t) {
                list[at] = list[list.len() - 1];
                ring.len -= 1;
            }
        }
        let kept = &self.ids[..self.n_kept];
        let (ring0, ring1) = (surface.rings[v0 as usize], surface.rings[v1 as usize]);
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
        surface.arena[start as usize..(start + n) as usize].copy_from_slice(kept);
        let ring = &mut surface.rings[v1 as usize];
        (ring.start, ring.len, ring.room) = (start, n, room);
        let ring = &mut surface.rings[v0 as usize];
        (ring.start, ring.len, ring.class) = (v1, 0, None);
    }
}
