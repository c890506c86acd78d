//! Cost of collapses at attribute seams, and where their survivors go.
//!
//! The survivor goes to a place beside the edge, square to it, that keeps the volume, where the attributes' and the
//! geometric error are least together; what it carries is that of the nearest place on the edge. What that costs is summed up over both rings directly, eight triangles at once; nothing is
//! kept at a seam.

use crate::cost::attribute_lanes::LEAST_SHAPE_SQ;
use crate::cost::attributes::MAX_WEIGHTED;
use crate::cost::quadric::{Evaluated, LENGTH_COST, MAX_REACH, VOLUME_SHARE, cross3, dot3, sub3};
use crate::simd::{Job, Lanes};
use crate::surface::class::Class;
use crate::surface::wedges::Wedges;
use crate::surface::wedges::pairs::Pairs;
use crate::surface::{MAX_VALENCE, Surface, boundary_quadric};
use crate::vertex::GONE;
use stonecut_mesh::vec3::{Vec3, add, dot, length_sq, scale, sub};

/// A surface has a side where at least this share of its normal, squared, is square to the edge.
const STEEP: f64 = 0.25;

/// Room for a ring, in whole eights. Longer ones do not collapse.
const ROOM: usize = (MAX_VALENCE as usize).next_multiple_of(8);

/// Puts in cost and place of those of eight edges that end on a seam. `active`: the channels that count, with their
/// factors.
#[inline(never)]
pub(crate) fn correct(
    surface: &Surface,
    (wedges, active): (&Wedges, &[(usize, f32)]),
    v0: &[u32; 8],
    v1: &[u32; 8],
    fixed: &[f32; 8],
    found: &mut Evaluated,
) {
    if (0..8).any(|i| wedges.concern(v0[i], v1[i])) {
        wedges.simd.run(Correct { wedges, surface, active, v0, v1, fixed, found });
    }
}

/// Eight edges, of which those at a seam get their cost and place here.
struct Correct<'a> {
    wedges: &'a Wedges,
    surface: &'a Surface,
    active: &'a [(usize, f32)],
    v0: &'a [u32; 8],
    v1: &'a [u32; 8],
    fixed: &'a [f32; 8],
    found: &'a mut Evaluated,
}

/// The triangles around a vertex: their other corners in the sense of rotation, and the wedges of all three.
struct Ring {
    n: usize,
    b: [u32; ROOM],
    c: [u32; ROOM],
    wedge: [u32; ROOM],
    wedge_b: [u32; ROOM],
    wedge_c: [u32; ROOM],
    /// Bit by bit, the active channels in which all wedges of the vertex agree.
    common: u32,
}

impl Ring {
    fn new() -> Self {
        let none = [0; ROOM];
        Ring { n: 0, b: none, c: none, wedge: none, wedge_b: none, wedge_c: none, common: 0 }
    }

    /// Takes up the ring of a vertex; false if it is too long.
    #[inline(always)]
    fn fill(
        &mut self,
        wedges: &Wedges,
        surface: &Surface,
        v: u32,
        active: &[(usize, f32)],
    ) -> bool {
        let ring = surface.ring(v);
        self.n = 0;
        if ring.len() > ROOM || ring.is_empty() {
            return false;
        }
        self.common = (1 << active.len()) - 1;
        for &t in ring {
            let (t, corner) = (surface.triangles[t as usize], wedges.corner[t as usize]);
            // Long rings keep what is gone.
            if t[0] == GONE {
                continue;
            }
            let i = self.n;
            self.n += 1;
            let k = usize::from(t[1] == v) + 2 * usize::from(t[2] == v);
            let (next, last) = ((k + 1) % 3, (k + 2) % 3);
            (self.b[i], self.c[i]) = (t[next], t[last]);
            (self.wedge[i], self.wedge_b[i], self.wedge_c[i]) =
                (corner[k % 3], corner[next], corner[last]);
            if self.wedge[i] != self.wedge[0] {
                let (own, first) =
                    (wedges.values_of(self.wedge[i]), wedges.values_of(self.wedge[0]));
                for (bit, &(channel, _)) in active.iter().enumerate() {
                    let differ = own[channel].to_bits() != first[channel].to_bits();
                    self.common &= !(u32::from(differ) << bit);
                }
            }
        }
        self.n > 0
    }

    /// Index in the ring of the triangle across the edge to corner `b` of the `i`th.
    #[inline(always)]
    fn across<L: Lanes>(&self, i: usize) -> Option<usize> {
        for from in (0..self.n).step_by(8) {
            let Some(eight) = self.c[from..].first_chunk::<8>() else { break };
            let bits = L::matches(eight, self.b[i]) & (0xFF >> (8 - (self.n - from).min(8)));
            if bits != 0 {
                return Some(from + bits.trailing_zeros() as usize);
            }
        }
        None
    }
}

impl Job for Correct<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let mut rings = [Ring::new(), Ring::new()];
        for i in 0..8 {
            let (v0, v1) = (self.v0[i], self.v1[i]);
            if self.wedges.concern(v0, v1) {
                let fixed = self.fixed[i] > 0.0;
                let (cost, place) = self.wedges.evaluate::<L>(
                    self.surface,
                    (v0, v1),
                    fixed,
                    self.active,
                    &mut rings,
                );
                self.found.cost[i] = cost;
                (0..3).for_each(|k| self.found.place[k][i] = place[k]);
            }
        }
    }
}

/// Places for a survivor, relative to the edge's midpoint: `start + s way`, with `s` from 0 at `v0` to 1 at `v1`.
#[derive(Clone, Copy)]
pub(crate) struct Line {
    pub(crate) start: Vec3,
    pub(crate) way: Vec3,
}

impl Line {
    /// The places beside the edge, square to it, where the volume under the surface is kept; `None` where the surface has no
    /// side.
    pub(crate) fn of_volume(ends: [&[f32; 9]; 2], half: Vec3) -> Option<Line> {
        let [g0, g1] = ends.map(|q| [q[6], q[7], q[8]].map(f64::from));
        let g = add(g0, g1);
        let trace: f64 =
            ends.iter().map(|q| f64::from(q[0]) + f64::from(q[3]) + f64::from(q[5])).sum();
        let side = sub(g, scale(half, dot(g, half) / length_sq(half)));
        let steep = dot(g, side);
        let least = (trace * f64::from(VOLUME_SHARE)).powi(2);
        // Written so that NaN has no side.
        if !(steep > least && steep > STEEP * length_sq(g)) {
            return None;
        }
        let edge = scale(half, 2.0);
        let offset = dot(sub(g1, g0), half) + dot(g, half);
        let start = add(scale(half, -1.0), scale(side, offset / steep));
        let way = sub(edge, scale(side, dot(g, edge) / steep));
        Some(Line { start, way })
    }

    pub(crate) fn at(&self, s: f64) -> Vec3 {
        add(self.start, scale(self.way, s))
    }

    /// The cost as a polynomial in `s`, `c0 + 2 c1 s + c2 s^2`; `away` is what attributes add at the far end.
    pub(crate) fn cost(&self, quadrics: &[[f64; 9]; 2], half: Vec3, away: [f64; 2]) -> [f64; 3] {
        let mut c = [away[1], -away[1], away[0] + away[1]];
        for (q, from) in quadrics.iter().zip([half, scale(half, -1.0)]) {
            let product = |x: Vec3| {
                [
                    q[0] * x[0] + q[1] * x[1] + q[2] * x[2],
                    q[1] * x[0] + q[3] * x[1] + q[4] * x[2],
                    q[2] * x[0] + q[4] * x[1] + q[5] * x[2],
                ]
            };
            let start = add(self.start, from);
            let (at_start, on_way) = (product(start), product(self.way));
            c[0] += dot(start, at_start);
            c[1] += dot(self.way, at_start);
            c[2] += dot(self.way, on_way);
        }
        c
    }
}

impl Wedges {
    /// Cost and place (relative to the edge's midpoint) of a collapse at a seam: the best place beside the edge
    /// (on it where the volume says nothing). `active` are the channels that count, with their factors.
    #[inline(always)]
    fn evaluate<L: Lanes>(
        &self,
        surface: &Surface,
        (v0, v1): (u32, u32),
        fixed: bool,
        active: &[(usize, f32)],
        rings: &mut [Ring; 2],
    ) -> (f32, [f32; 3]) {
        let edge_f32 = surface.edge(v0, v1);
        let half = edge_f32.map(|x| 0.5 * f64::from(x));
        let half_f32 = half.map(|x| x as f32);
        let [ring0, ring1] = rings;
        if !ring0.fill(self, surface, v0, active) || !ring1.fill(self, surface, v1, active) {
            return (f32::INFINITY, half_f32);
        }
        let mut pairs = Pairs::default();
        for i in 0..ring0.n {
            if ring0.b[i] == v1 {
                pairs.add((ring0.wedge[i], ring0.wedge_b[i]));
            } else if ring0.c[i] == v1 {
                pairs.add((ring0.wedge[i], ring0.wedge_c[i]));
            }
        }
        // A seam that ends at v0 may only become shorter by going to v0.
        if (pairs.splits && fixed) || pairs.n == 0 {
            return (f32::INFINITY, half_f32);
        }
        let edge = half.map(|x| 2.0 * x);
        let ends = [v0, v1].map(|v| &surface.vertices[v as usize].quadric);
        let [area0, area1] = ends.map(|q| f64::from(q[0]) + f64::from(q[3]) + f64::from(q[5]));
        let common = ring0.common & ring1.common;
        let both = [&*ring0, &*ring1];
        let mut misfit = [0.0; 2];
        for end in 0..2 {
            let v = if end == 0 { v0 } else { v1 };
            let other_end = both[1 - end];
            let step = |wedge: u32, bit: usize, channel: usize| {
                let pair = if end == 0 { pairs.of_v0(wedge) } else { pairs.of_v1(wedge) };
                let to = match pair {
                    _ if common >> bit & 1 == 1 => other_end.wedge[0],
                    Some((w0, w1)) => {
                        if end == 0 {
                            w1
                        } else {
                            w0
                        }
                    }
                    None => return 0.0,
                };
                self.values_of(to)[channel] - self.values_of(wedge)[channel]
            };
            let sign = if end == 0 { 1.0 } else { -1.0 };
            misfit[end] =
                self.misfit::<L>(surface, (v, both[end]), edge_f32.map(|x| sign * x), active, step);
        }
        // Errors of what v0 and v1 carry, at the other end of the edge.
        let away = misfit.map(f64::from);
        let mut quadrics = ends.map(|q| q.map(f64::from));
        for (quadric, (v, ring)) in quadrics.iter_mut().zip([(v0, &*ring0), (v1, &*ring1)]) {
            if self.is_seam(v) {
                self.add_borders::<L>(surface, v, ring, quadric);
            }
        }
        let least = |line: &Line| {
            let c = line.cost(&quadrics, half, away);
            // Neither infinity nor NaN is a cost.
            if !c[2].is_finite() {
                return None;
            }
            let free = if c[2] > 0.0 { (-c[1] / c[2]).clamp(0.0, 1.0) } else { 0.5 };
            let s = match (fixed || pairs.joins, pairs.splits) {
                (true, _) => 1.0,
                (_, true) => 0.0,
                _ => free,
            };
            Some((s, (c[0] + s * (2.0 * c[1] + s * c[2])).max(0.0)))
        };
        let far_sq = length_sq(half) * f64::from(MAX_REACH * MAX_REACH);
        // Written so that NaN is too far.
        let is_near = |line: &Line, s: f64| length_sq(line.at(s)) <= far_sq;
        // Sheets that meet have no common side.
        let has_side = !fixed && surface.rings[v0 as usize].class != Some(Class::Junction);
        let volume = if has_side { Line::of_volume(ends, half) } else { None };
        let beside = volume.and_then(|line| Some((least(&line)?, line)));
        let beside = beside.filter(|((s, _), line)| is_near(line, *s));
        let is_on_edge = beside.is_none();
        let on_edge = || {
            let line = Line { start: half.map(|x| -x), way: edge };
            Some((least(&line)?, line))
        };
        let Some(((s, cost), line)) = beside.or_else(on_edge) else {
            return (f32::INFINITY, half_f32);
        };
        let floor = (area0 + area1) * length_sq(half) * f64::from(LENGTH_COST);
        let cost = cost + floor;
        // NaN is not a cost.
        let cost = if cost < f64::from(f32::MAX) { cost as f32 } else { f32::INFINITY };
        let place = match (is_on_edge, s) {
            (true, 1.0) => half_f32,
            (true, 0.0) => half_f32.map(|x| -x),
            _ => line.at(s).map(|x| x as f32),
        };
        (cost, place)
    }

    /// Area times squared difference, summed over a ring, between what each triangle says of the other end of
    /// the edge and what its corner's wedge will say there. `edge` runs to the other end, `step` is how much a
    /// channel changes on the way for a wedge.
    #[inline(always)]
    fn misfit<L: Lanes>(
        &self,
        surface: &Surface,
        (v, ring): (u32, &Ring),
        edge: [f32; 3],
        active: &[(usize, f32)],
        step: impl Fn(u32, usize, usize) -> f32,
    ) -> f32 {
        if active.is_empty() {
            return 0.0;
        }
        let mut sum = 0.0;
        let zero = L::splat(0.0);
        let edge = edge.map(|x| L::splat(x));
        let vertex = |v: u32| &surface.vertices[v as usize];
        let base = [&vertex(v).position; 8];
        for from in (0..ring.n).step_by(8) {
            let n = (ring.n - from).min(8);
            let at = |i: usize| from + i.min(n - 1);
            let corner = |list: &[u32; ROOM]| std::array::from_fn(|i| vertex(list[at(i)]));
            let to_b = L::relative(corner(&ring.b), base, surface.scale);
            let to_c = L::relative(corner(&ring.c), base, surface.scale);
            let normal = cross3(to_b, to_c);
            let normal_sq = dot3(normal, normal);
            let across = sub3(to_c, to_b);
            let edges_sq = dot3(to_b, to_b).plus(dot3(to_c, to_c)).plus(dot3(across, across));
            let damped = edges_sq.times(edges_sq).times(L::splat(LEAST_SHAPE_SQ));
            let below = normal_sq.greater(damped);
            // What a unit of step at b, and at c, is worth along the whole edge.
            let at_b = dot3(cross3(to_c, normal), edge).over(below);
            let at_c = dot3(cross3(normal, to_b), edge).over(below);
            let mut squares = zero;
            for (bit, &(channel, factor)) in active.iter().enumerate().take(MAX_WEIGHTED) {
                let value = |wedge: u32| self.values_of(wedge)[channel];
                let (mut b, mut c, mut steps) = ([0.0; 8], [0.0; 8], [0.0; 8]);
                for i in 0..n {
                    let own = ring.wedge[at(i)];
                    let here = value(own);
                    b[i] = value(ring.wedge_b[at(i)]) - here;
                    c[i] = value(ring.wedge_c[at(i)]) - here;
                    steps[i] = step(own, bit, channel);
                }
                let says = at_b.times(L::load(&b)).plus(at_c.times(L::load(&c)));
                let off = says.minus(L::load(&steps)).times(L::splat(factor));
                squares = squares.plus(off.times(off));
            }
            let area = L::splat(0.5).times(normal_sq.root());
            // Degenerate triangles and empty lanes add nothing.
            let lane: [f32; 8] = std::array::from_fn(|i| if i < n { 1.0 } else { 0.0 });
            let known = L::lt_select(zero, below, area.times(squares), zero);
            sum += L::lt_select(zero, L::load(&lane), known, zero).sum();
        }
        sum
    }

    /// Adds the cost of moving `v` off the seams that end there: squared length times squared distance for each, as at a
    /// boundary of the surface; less where it is not the border of a region.
    #[inline(always)]
    fn add_borders<L: Lanes>(&self, surface: &Surface, v: u32, ring: &Ring, sum: &mut [f64; 9]) {
        let region = |w: u32| self.region.map(|channel| self.values_of(w)[channel].to_bits());
        for i in 0..ring.n {
            let Some(next) = ring.across::<L>(i) else { continue };
            let (own, other) = (ring.wedge[i], ring.wedge[next]);
            if own == other {
                continue;
            }
            let share = if region(own) == region(other) { self.seam_share } else { 1.0 };
            if share > 0.0 {
                let q = boundary_quadric(surface.edge(v, ring.b[i]));
                for (sum, x) in sum.iter_mut().zip(q) {
                    *sum += share * f64::from(x);
                }
            }
        }
    }
}
