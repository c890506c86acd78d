//! Collapses at attribute seams: what one costs, where its survivor goes, and which values its wedges get.
//!
//! The survivor stays on the edge, at the place where the attributes' and the geometric error are least
//! together. What that costs is summed up over the rings directly; there is no sum to keep at a seam. Whether
//! the collapse is legal is not asked here.

use super::Wedges;
use crate::kernel::attributes::MAX_WEIGHTED;
use crate::kernel::evaluate::Evaluated;
use crate::kernel::legal::Class;
use crate::kernel::surface::{Surface, boundary_quadric, others};
use crate::mesh::vec3::{along, cross, dot, length_sq, sub};

/// Cost of an edge in a plane, as in `evaluate`.
const LENGTH_COST: f64 = 1e-6;
/// As in `attribute_lanes`: where gradients are damped.
const LEAST_SHAPE_SQ: f64 = 2.5e-4;

/// Which wedges of `v0` become which of `v1`: those of the triangles over the edge.
#[derive(Clone, Copy, Debug, Default)]
struct Pairs {
    list: [(u32, u32); 2],
    n: usize,
    /// One wedge would have to become two, or two would become one.
    splits: bool,
    joins: bool,
}

impl Pairs {
    fn of(wedges: &Wedges, surface: &Surface, v0: u32, v1: u32) -> Pairs {
        let mut pairs = Pairs::default();
        for &t in surface.ring(v0) {
            let (b, c) = others(surface.triangles[t as usize], v0);
            if b == v1 || c == v1 {
                let pair = (wedges.at(surface, t, v0), wedges.at(surface, t, v1));
                pairs.add(pair);
            }
        }
        pairs
    }

    fn add(&mut self, pair: (u32, u32)) {
        for known in &self.list[..self.n] {
            self.splits |= known.0 == pair.0 && known.1 != pair.1;
            self.joins |= known.0 != pair.0 && known.1 == pair.1;
            if *known == pair {
                return;
            }
        }
        if self.n < 2 {
            self.list[self.n] = pair;
            self.n += 1;
        }
    }

    fn of_v0(&self, wedge: u32) -> Option<(u32, u32)> {
        self.list[..self.n].iter().copied().find(|pair| pair.0 == wedge)
    }

    fn of_v1(&self, wedge: u32) -> Option<(u32, u32)> {
        self.list[..self.n].iter().copied().find(|pair| pair.1 == wedge)
    }
}

/// Values of a channel at both ends of an edge, if all wedges of either agree.
type CommonEnds = Option<[f32; 2]>;

/// A collapse at a seam under way.
pub(crate) struct SeamPlan {
    pairs: Pairs,
    /// New values of all wedges that the survivor will have.
    values: Vec<(u32, Vec<f32>)>,
}

impl Wedges {
    /// Puts in cost and place of those of eight edges that have to do with a seam.
    #[inline(never)]
    pub(crate) fn correct(
        &self,
        surface: &Surface,
        v0: &[u32; 8],
        v1: &[u32; 8],
        fixed: &[f32; 8],
        found: &mut Evaluated,
    ) {
        let active = surface.attributes.as_ref().map_or(&[][..], |a| a.active());
        for i in 0..8 {
            if self.concern(v0[i], v1[i]) {
                let (cost, place) = self.evaluate(surface, (v0[i], v1[i]), fixed[i] > 0.0, active);
                found.cost[i] = cost;
                (0..3).for_each(|k| found.place[k][i] = place[k]);
            }
        }
    }

    /// Cost and place (relative to the edge's midpoint) of a collapse at a seam: the best place on the edge
    /// itself. `active` are the channels that count, with their factors.
    fn evaluate(
        &self,
        surface: &Surface,
        (v0, v1): (u32, u32),
        fixed: bool,
        active: &[(usize, f32)],
    ) -> (f32, [f32; 3]) {
        let pairs = Pairs::of(self, surface, v0, v1);
        let half = surface.edge(v0, v1).map(|x| 0.5 * f64::from(x));
        let half_f32 = half.map(|x| x as f32);
        // A seam that ends at v0 may only become shorter by going to v0.
        if (pairs.splits && fixed) || pairs.n == 0 {
            return (f32::INFINITY, half_f32);
        }
        let edge = half.map(|x| 2.0 * x);
        // Quadratic in the place on the edge, 0 at v0 and 1 at v1: c0 + 2 c1 s + c2 s^2.
        let geometric = |v: u32| {
            let q = surface.vertices[v as usize].quadric.map(f64::from);
            let product = [
                q[0] * edge[0] + q[1] * edge[1] + q[2] * edge[2],
                q[1] * edge[0] + q[3] * edge[1] + q[4] * edge[2],
                q[2] * edge[0] + q[4] * edge[1] + q[5] * edge[2],
            ];
            (dot(edge, product), q[0] + q[3] + q[5])
        };
        let ((along0, area0), (along1, area1)) = (geometric(v0), geometric(v1));
        let mut c = [along1, -along1, along0 + along1];
        let mut common = [None; MAX_WEIGHTED];
        for (common, &(channel, _)) in common.iter_mut().zip(active) {
            let ends = [v0, v1].map(|v| self.common(surface, v, channel));
            *common = ends[0].zip(ends[1]).map(|(a, b)| [a, b]);
        }
        for (end, v) in [v0, v1].into_iter().enumerate() {
            for &t in surface.ring(v) {
                self.add_triangle(surface, (t, v, end), (&pairs, edge), (active, &common), &mut c);
            }
            if self.is_seam[v as usize] {
                let away = self.border_cost(surface, v, edge);
                match end {
                    0 => c[2] += away,
                    _ => c = [c[0] + away, c[1] - away, c[2] + away],
                }
            }
        }
        let free = if c[2] > 0.0 { (-c[1] / c[2]).clamp(0.0, 1.0) } else { 0.5 };
        let s = match (fixed || pairs.joins, pairs.splits) {
            (true, _) => 1.0,
            (_, true) => 0.0,
            _ => free,
        };
        let floor = (area0 + area1) * length_sq(half) * LENGTH_COST;
        let cost = (c[0] + s * (2.0 * c[1] + s * c[2])).max(0.0) + floor;
        // NaN is no cost.
        let cost = if cost < f64::from(f32::MAX) { cost as f32 } else { f32::INFINITY };
        let place = match s {
            1.0 => half_f32,
            0.0 => half_f32.map(|x| -x),
            _ => half.map(|x| ((2.0 * s - 1.0) * x) as f32),
        };
        (cost, place)
    }

    /// What it costs to take `v` from the seams that end there by the vector `way`: squared length times
    /// squared distance for each, as at a boundary of the surface; less where it is no border of a region.
    fn border_cost(&self, surface: &Surface, v: u32, way: [f64; 3]) -> f64 {
        let ring = surface.ring(v);
        let region = |w: u32| self.region.map(|channel| self.values_of(w)[channel].to_bits());
        let share = |a: u32, b: u32| match a == b {
            true => 0.0,
            false if region(a) != region(b) => 1.0,
            false => self.seam_share,
        };
        let mut cost = 0.0;
        for &t in ring {
            let (b, _) = others(surface.triangles[t as usize], v);
            let is_next = |n: &&u32| others(surface.triangles[**n as usize], v).1 == b;
            let Some(&next) = ring.iter().find(is_next) else { continue };
            let share = share(self.at(surface, t, v), self.at(surface, next, v));
            if share > 0.0 {
                let q = boundary_quadric(surface.edge(v, b)).map(f64::from);
                let product = [
                    q[0] * way[0] + q[1] * way[1] + q[2] * way[2],
                    q[1] * way[0] + q[3] * way[1] + q[4] * way[2],
                    q[2] * way[0] + q[4] * way[1] + q[5] * way[2],
                ];
                cost += share * dot(way, product);
            }
        }
        cost
    }

    /// Adds area times squared difference between what a triangle says of a place on the edge and what its
    /// corner's wedge will say.
    fn add_triangle(
        &self,
        surface: &Surface,
        (t, v, end): (u32, u32, usize),
        (pairs, edge): (&Pairs, [f64; 3]),
        (active, common): (&[(usize, f32)], &[CommonEnds]),
        c: &mut [f64; 3],
    ) {
        let (b, d) = others(surface.triangles[t as usize], v);
        let (to_b, to_d) = (surface.edge(v, b).map(f64::from), surface.edge(v, d).map(f64::from));
        let n = cross(to_b, to_d);
        let double_area = length_sq(n).sqrt();
        let edges_sq = length_sq(to_b) + length_sq(to_d) + length_sq(sub(to_d, to_b));
        let below = length_sq(n).max(edges_sq * edges_sq * LEAST_SHAPE_SQ);
        // NaN is no triangle either.
        if below <= 0.0 || below.is_nan() {
            return;
        }
        // What one unit of step at b, and at d, is worth along the whole edge.
        let (at_b, at_d) = (dot(cross(to_d, n), edge) / below, dot(cross(n, to_b), edge) / below);
        let own = self.values_at(surface, t, v);
        let (values_b, values_d) = (self.values_at(surface, t, b), self.values_at(surface, t, d));
        let wedge = self.at(surface, t, v);
        let pair = if end == 0 { pairs.of_v0(wedge) } else { pairs.of_v1(wedge) };
        let other = pair.map(|(w0, w1)| match end {
            0 => self.values_of(w1),
            _ => self.values_of(w0),
        });
        for (&(channel, factor), common) in active.iter().zip(common) {
            let value = |list: &[f32]| f64::from(list[channel]) * f64::from(factor);
            let here = value(own);
            let per_edge = at_b * (value(values_b) - here) + at_d * (value(values_d) - here);
            let step = match (common, other) {
                (Some(ends), _) => f64::from(ends[1 - end]) * f64::from(factor) - here,
                (None, Some(other)) => value(other) - here,
                (None, None) => 0.0,
            };
            // The residual at either end of the edge.
            let [r0, r1] = match end {
                0 => [0.0, per_edge - step],
                _ => [-per_edge - step, 0.0],
            };
            let area = 0.5 * double_area;
            c[0] += area * r0 * r0;
            c[1] += area * r0 * (r1 - r0);
            c[2] += area * (r1 - r0) * (r1 - r0);
        }
    }

    /// What a collapse at a seam will do, before it is carried out; `s` is its place on the edge, 0 at `v0`.
    pub(crate) fn plan(&self, surface: &Surface, (v0, v1): (u32, u32), s: f32) -> SeamPlan {
        let pairs = Pairs::of(self, surface, v0, v1);
        let mix = |a: f32, b: f32| match s {
            1.0 => b,
            0.0 => a,
            _ => a + s * (b - a),
        };
        let common: Vec<Option<f32>> = (0..self.n_channels)
            .map(|channel| {
                let ends = [v0, v1].map(|v| self.common(surface, v, channel));
                ends[0].zip(ends[1]).map(|(a, b)| mix(a, b))
            })
            .collect();
        let mut values: Vec<(u32, Vec<f32>)> = Vec::new();
        let after0 = surface.ring(v0).iter().map(|&t| {
            let wedge = self.at(surface, t, v0);
            pairs.of_v0(wedge).map_or(wedge, |pair| pair.1)
        });
        for wedge in after0.chain(surface.ring(v1).iter().map(|&t| self.at(surface, t, v1))) {
            if values.iter().any(|(known, _)| *known == wedge) {
                continue;
            }
            let own = self.values_of(wedge);
            let from = pairs.of_v1(wedge).map(|pair| self.values_of(pair.0));
            let value = |channel: usize| match (common[channel], from) {
                (Some(value), _) => value,
                (None, Some(from)) => mix(from[channel], own[channel]),
                (None, None) => own[channel],
            };
            values.push((wedge, (0..self.n_channels).map(value).collect()));
        }
        SeamPlan { pairs, values }
    }

    /// Whether one of these triangles of `v0` will use the wedge that came with `v1`.
    pub(crate) fn becomes_own(
        &self,
        surface: &Surface,
        triangles: &[u32],
        (v0, v1): (u32, u32),
    ) -> bool {
        let pairs = Pairs::of(self, surface, v0, v1);
        triangles.iter().any(|&t| {
            let pair = pairs.of_v0(self.at(surface, t, v0));
            pair.is_some_and(|(_, new)| self.source[new as usize] == surface.source[v1 as usize])
        })
    }

    /// The value of a channel that all wedges of a vertex have in common, if they do.
    fn common(&self, surface: &Surface, v: u32, channel: usize) -> Option<f32> {
        let ring = surface.ring(v);
        let value = |&t: &u32| self.values_of(self.at(surface, t, v))[channel];
        let first = value(ring.first()?);
        let same =
            !self.is_seam[v as usize] || ring.iter().all(|t| value(t).to_bits() == first.to_bits());
        same.then_some(first)
    }

    /// After the collapse: renames the corners that came from `v0` (those of `triangles`), and sets values.
    pub(crate) fn carry_out(
        &mut self,
        surface: &mut Surface,
        triangles: &[u32],
        v1: u32,
        plan: SeamPlan,
    ) {
        for (wedge, values) in plan.values {
            let at = wedge as usize * self.n_channels;
            self.values[at..at + self.n_channels].copy_from_slice(&values);
        }
        for &t in triangles {
            let corners = surface.triangles[t as usize];
            for (corner, &v) in self.corner[t as usize].iter_mut().zip(&corners) {
                if let (true, Some((_, new))) = (v == v1, plan.pairs.of_v0(*corner)) {
                    *corner = new;
                }
            }
        }
        // What it was before says nothing of what came with `v0`.
        self.is_seam[v1 as usize] = true;
        self.look_again(surface, v1);
        // Charts may have vanished from the third corners, too.
        let around: Vec<u32> = surface.ring(v1).to_vec();
        for t in around {
            let (b, c) = others(surface.triangles[t as usize], v1);
            for w in [b, c] {
                self.look_again(surface, w);
            }
        }
    }

    /// Whether `v` still has several wedges; if not, their values become the surface's.
    pub(crate) fn look_again(&mut self, surface: &mut Surface, v: u32) {
        if !self.is_seam[v as usize] {
            return;
        }
        let ring = surface.ring(v);
        // Wedges that have come to the same values are one: the seam is closed there.
        // That of a locked vertex is the one to stay: other cells know it.
        let own =
            ring.iter().find(|&&t| self.is_own(surface, t, v)).map(|&t| self.at(surface, t, v));
        let is_locked = surface.rings[v as usize].class == Some(Class::Locked);
        let mut kept: Vec<u32> = own.filter(|_| is_locked).into_iter().collect();
        for &t in ring {
            let wedge = self.at(surface, t, v);
            let own = self.values_of(wedge);
            match kept.iter().find(|&&w| w == wedge || self.values_of(w) == own).copied() {
                None => kept.push(wedge),
                Some(same) if same != wedge => {
                    let k = surface.triangles[t as usize].iter().position(|&x| x == v);
                    self.corner[t as usize][k.unwrap_or(0)] = same;
                }
                Some(_) => {}
            }
        }
        let Some(first) = self.single(surface, v) else { return };
        self.is_seam[v as usize] = ring.iter().any(|&t| self.at(surface, t, v) != first);
        if !self.is_seam[v as usize] {
            let at = v as usize * surface.n_channels;
            surface.channels[at..at + self.n_channels].copy_from_slice(self.values_of(first));
        }
    }
}

/// Place on an edge (0 at `v0`) of a place relative to its midpoint, in f64 for either end exactly.
pub(crate) fn place_on_edge(half: [f32; 3], place: [f32; 3]) -> f32 {
    if place == half {
        return 1.0;
    }
    if place == half.map(|x| -x) {
        return 0.0;
    }
    let (half, place) = (half.map(f64::from), place.map(f64::from));
    along(place, half.map(|x| -x), half) as f32
}
