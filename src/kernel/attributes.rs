//! Attributes in the error: their sums at every vertex, kept up to date from collapse to collapse.
//!
//! Exists only while some channel has a weight; without, no other part of the kernel does anything more
//! than ask whether it is there. What the sums mean, and the cost that follows from them, is in
//! `attribute_lanes`. Does not choose edges and does not know what a channel stands for.

use super::attribute_lanes::{AttributeEdges, AttributeTriangles, Rows, numbers};
use super::evaluate::Evaluated;
use super::lanes::Simd;
use super::surface::Surface;
use super::vector::Vec3;

/// Channels that can be weighted at once.
pub const MAX_WEIGHTED: usize = 14;

/// Calls a method with the number of eights as a constant.
macro_rules! with_eights {
    ($eights:expr, $object:ident.$method:ident($($argument:expr),*)) => {
        match $eights {
            2 => $object.$method::<2>($($argument),*),
            3 => $object.$method::<3>($($argument),*),
            4 => $object.$method::<4>($($argument),*),
            5 => $object.$method::<5>($($argument),*),
            _ => $object.$method::<6>($($argument),*),
        }
    };
}

/// The sums of all vertices: 64 bytes a vertex for up to 3 channels, 32 more for each 2 or 3 further ones.
pub(crate) struct Attributes {
    /// Channel and scaled length per unit of it.
    active: Vec<(usize, f32)>,
    eights: usize,
    /// `eights` a vertex: M, then an L for each active channel.
    sums: Vec<[f32; 8]>,
    patch: Patch,
}

/// What a collapse under way has found so far.
#[derive(Default)]
struct Patch {
    /// The ring's rows before, `eights` for each eight triangles, one [eight] a triangle.
    before: Vec<[[f32; 8]; 8]>,
    /// New values of the active channels.
    values: Vec<f32>,
}

/// The triangles around both ends of a collapse, as the collapse has sorted them.
#[derive(Clone, Copy)]
pub(crate) struct RingLists<'a> {
    pub(crate) v0: u32,
    pub(crate) v1: u32,
    /// The corners that do not move, filled up to whole eights.
    pub(crate) b: &'a [u32],
    pub(crate) c: &'a [u32],
    /// Below 0 for a triangle of `v0`.
    pub(crate) side: &'a [f32],
    pub(crate) n_kept: usize,
    pub(crate) n: usize,
}

/// Values and places of vertices, without the sums.
#[derive(Clone, Copy)]
struct Values<'a> {
    channels: &'a [f32],
    n_channels: usize,
    active: &'a [(usize, f32)],
}

impl Values<'_> {
    /// An attribute of `to` minus that of `from`, as a scaled length.
    #[inline(always)]
    fn step(&self, attribute: usize, from: u32, to: u32) -> f32 {
        let (channel, factor) = self.active[attribute];
        let at = |v: u32| self.channels[v as usize * self.n_channels + channel];
        (at(to) - at(from)) * factor
    }
}

impl Attributes {
    /// `None` if no channel has a weight. Weights are lengths in input units per unit of a channel.
    pub(crate) fn new(weights: &[f32], scale: f64) -> Option<Self> {
        let active: Vec<(usize, f32)> = weights
            .iter()
            .enumerate()
            .filter(|(_, weight)| **weight > 0.0)
            .map(|(channel, &weight)| (channel, (f64::from(weight) * scale) as f32))
            .take(MAX_WEIGHTED)
            .collect();
        let eights = numbers(active.len()).div_ceil(8).max(2);
        let none = active.is_empty();
        (!none).then(|| Attributes { active, eights, sums: Vec::new(), patch: Patch::default() })
    }

    /// Sums up all triangles anew; none of them may be gone.
    pub(crate) fn build(&mut self, surface: &Surface, simd: Simd) {
        self.sums.clear();
        self.sums.resize(surface.vertices.len() * self.eights, [0.0; 8]);
        with_eights!(self.eights, self.add_all(surface, simd));
    }

    fn add_all<const K: usize>(&mut self, surface: &Surface, simd: Simd) {
        let mut rows = [[[0.0; 8]; 8]; K];
        let mut steps = vec![[[0.0; 8]; 2]; self.active.len()];
        let sums = self.sums.as_chunks_mut::<K>().0;
        let values = values(&self.active, surface);
        for eight in surface.triangles.chunks(8) {
            let corner = |i: usize, k: usize| eight[i.min(eight.len() - 1)][k];
            let (a, b, c) = (
                std::array::from_fn(|i| corner(i, 0)),
                std::array::from_fn(|i| corner(i, 1)),
                std::array::from_fn(|i| corner(i, 2)),
            );
            let at = a.map(|v| &surface.vertices[v as usize].position);
            triangles(surface, values, (a, at), b, c, &mut steps, &mut rows, simd);
            for (i, t) in eight.iter().enumerate() {
                for &v in t {
                    add(&mut sums[v as usize], &rows, i, 1.0);
                }
            }
        }
    }

    /// The sums of one vertex from its ring.
    pub(crate) fn refresh(&mut self, surface: &Surface, v: u32, simd: Simd) {
        self.sums.resize(surface.vertices.len() * self.eights, [0.0; 8]);
        with_eights!(self.eights, self.add_ring(surface, v, simd));
    }

    fn add_ring<const K: usize>(&mut self, surface: &Surface, v: u32, simd: Simd) {
        let mut rows = [[[0.0; 8]; 8]; K];
        let mut steps = vec![[[0.0; 8]; 2]; self.active.len()];
        let sum = &mut self.sums.as_chunks_mut::<K>().0[v as usize];
        *sum = [[0.0; 8]; K];
        let values = values(&self.active, surface);
        for eight in surface.ring(v).chunks(8) {
            let corner =
                |i: usize, k: usize| surface.triangles[eight[i.min(eight.len() - 1)] as usize][k];
            let (a, b, c) = (
                std::array::from_fn(|i| corner(i, 0)),
                std::array::from_fn(|i| corner(i, 1)),
                std::array::from_fn(|i| corner(i, 2)),
            );
            let at = a.map(|v| &surface.vertices[v as usize].position);
            triangles(surface, values, (a, at), b, c, &mut steps, &mut rows, simd);
            for i in 0..eight.len() {
                add(sum, &rows, i, 1.0);
            }
        }
    }

    /// Cost and place of eight edges, attributes included.
    pub(crate) fn evaluate(
        &self,
        surface: &Surface,
        pairs: &[(u32, u32); 8],
        fixed: [f32; 8],
        simd: Simd,
    ) -> Evaluated {
        with_eights!(self.eights, self.evaluate_eight(surface, pairs, fixed, simd))
    }

    fn evaluate_eight<const K: usize>(
        &self,
        surface: &Surface,
        pairs: &[(u32, u32); 8],
        fixed: [f32; 8],
        simd: Simd,
    ) -> Evaluated {
        let sums = self.sums.as_chunks::<K>().0;
        let values = values(&self.active, surface);
        let mut half_step = [[0.0f32; 8]; MAX_WEIGHTED];
        for (j, half) in half_step.iter_mut().enumerate().take(self.active.len()) {
            *half = pairs.map(|(v0, v1)| 0.5 * values.step(j, v0, v1));
        }
        simd.run(AttributeEdges::<K> {
            v0: pairs.map(|(v0, _)| &surface.vertices[v0 as usize]),
            v1: pairs.map(|(_, v1)| &surface.vertices[v1 as usize]),
            numbers0: pairs.map(|(v0, _)| &sums[v0 as usize]),
            numbers1: pairs.map(|(_, v1)| &sums[v1 as usize]),
            half_step: &half_step[..self.active.len()],
            fixed,
            scale: surface.scale,
        })
    }

    /// Before a collapse: what its ring's triangles have added, and the survivor's best values at `place`
    /// (relative to the edge's midpoint, scaled).
    pub(crate) fn before(
        &mut self,
        surface: &Surface,
        ring: RingLists,
        place: [f32; 3],
        simd: Simd,
    ) {
        let mut rows = std::mem::take(&mut self.patch.before);
        rows.resize(ring.n.div_ceil(8) * self.eights, [[0.0; 8]; 8]);
        let ends = [ring.v0, ring.v1].map(|v| surface.vertices[v as usize].position);
        with_eights!(self.eights, self.ring_rows(surface, ring, ends, &mut rows, simd));
        self.patch.before = rows;
        self.best_values(surface, ring, place);
    }

    fn best_values(&mut self, surface: &Surface, ring: RingLists, place: [f32; 3]) {
        let values = values(&self.active, surface);
        let (v0, v1) = (ring.v0, ring.v1);
        let half = surface.edge(v0, v1).map(|x| 0.5 * x);
        let area = |v: u32| {
            let q = &surface.vertices[v as usize].quadric;
            q[0] + q[3] + q[5]
        };
        let (area0, area1) = (area(v0), area(v1));
        let first = |v: u32, j: usize| {
            let at = |i: usize| self.sums[v as usize * self.eights + i / 8][i % 8];
            [at(6 + 3 * j), at(7 + 3 * j), at(8 + 3 * j)]
        };
        let dot = |a: [f32; 3], b: [f32; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        let from0 = [0, 1, 2].map(|k| place[k] + half[k]);
        let from1 = [0, 1, 2].map(|k| place[k] - half[k]);
        self.patch.values.clear();
        for (j, &(channel, factor)) in self.active.iter().enumerate() {
            let step = 0.5 * values.step(j, v0, v1);
            let sum = dot(first(v0, j), from0) + dot(first(v1, j), from1) + (area1 - area0) * step;
            let best = sum / (area0 + area1) / factor;
            let at = |v: u32| surface.channels[v as usize * surface.n_channels + channel];
            let middle = 0.5 * (at(v0) + at(v1));
            self.patch.values.push(if best.is_finite() { middle + best } else { middle });
        }
    }

    /// After a collapse: sets the survivor's values unless it is `fixed`, and brings the sums of the ring
    /// up to date.
    pub(crate) fn after(
        &mut self,
        surface: &mut Surface,
        ring: RingLists,
        fixed: bool,
        simd: Simd,
    ) {
        if !fixed {
            let first = ring.v1 as usize * surface.n_channels;
            for (&(channel, _), &value) in self.active.iter().zip(&self.patch.values) {
                surface.channels[first + channel] = value;
            }
        }
        with_eights!(self.eights, self.update(surface, ring, simd));
    }

    fn update<const K: usize>(&mut self, surface: &Surface, ring: RingLists, simd: Simd) {
        let mut rows = vec![[[0.0; 8]; 8]; ring.n_kept.div_ceil(8) * K];
        let ends = [surface.vertices[ring.v1 as usize].position; 2];
        let kept = RingLists { n: ring.n_kept, v0: ring.v1, ..ring };
        self.ring_rows::<K>(surface, kept, ends, &mut rows, simd);
        let (before, after) = (self.patch.before.as_chunks::<K>().0, rows.as_chunks::<K>().0);
        let sums = self.sums.as_chunks_mut::<K>().0;
        let mut total = [[0.0; 8]; K];
        for i in 0..ring.n {
            for w in [ring.b[i], ring.c[i]] {
                let sum = &mut sums[w as usize];
                add(sum, &before[i / 8], i % 8, -1.0);
                if i < ring.n_kept {
                    add(sum, &after[i / 8], i % 8, 1.0);
                }
            }
            if i < ring.n_kept {
                add(&mut total, &after[i / 8], i % 8, 1.0);
            }
        }
        sums[ring.v1 as usize] = total;
    }

    /// Rows of the first `ring.n` triangles, their moving corners at `ends`.
    fn ring_rows<const K: usize>(
        &self,
        surface: &Surface,
        ring: RingLists,
        ends: [Vec3; 2],
        rows: &mut [[[f32; 8]; 8]],
        simd: Simd,
    ) {
        let values = values(&self.active, surface);
        let mut steps = [[[0.0; 8]; 2]; MAX_WEIGHTED];
        let steps = &mut steps[..self.active.len()];
        for (part, out) in rows.as_chunks_mut::<K>().0.iter_mut().enumerate() {
            let lane = |i: usize| (part * 8 + i).min(ring.n - 1);
            let is_v0: [bool; 8] = std::array::from_fn(|i| ring.side[lane(i)] < 0.0);
            let a = is_v0.map(|is_v0| if is_v0 { ring.v0 } else { ring.v1 });
            let at = is_v0.map(|is_v0| &ends[usize::from(!is_v0)]);
            let b = std::array::from_fn(|i| ring.b[lane(i)]);
            let c = std::array::from_fn(|i| ring.c[lane(i)]);
            triangles(surface, values, (a, at), b, c, steps, out, simd);
        }
    }
}

fn values<'a>(active: &'a [(usize, f32)], surface: &'a Surface) -> Values<'a> {
    Values { channels: &surface.channels, n_channels: surface.n_channels, active }
}

/// Rows of eight triangles; `a` with its positions, which need not be those of the vertices.
#[allow(clippy::too_many_arguments)] // The triangles' corners, scratch space, and the way to compute.
#[inline(always)]
fn triangles<const K: usize>(
    surface: &Surface,
    values: Values,
    (a, at): ([u32; 8], [&Vec3; 8]),
    b: [u32; 8],
    c: [u32; 8],
    steps: &mut [[[f32; 8]; 2]],
    out: &mut Rows<K>,
    simd: Simd,
) {
    for (j, [to_b, to_c]) in steps.iter_mut().enumerate() {
        *to_b = std::array::from_fn(|i| values.step(j, a[i], b[i]));
        *to_c = std::array::from_fn(|i| values.step(j, a[i], c[i]));
    }
    simd.run(AttributeTriangles {
        a: at,
        b: b.map(|v| &surface.vertices[v as usize]),
        c: c.map(|v| &surface.vertices[v as usize]),
        steps,
        scale: surface.scale,
        out,
    });
}

/// Adds a triangle's row, or takes it away.
#[inline(always)]
fn add<const K: usize>(sum: &mut [[f32; 8]; K], rows: &Rows<K>, triangle: usize, sign: f32) {
    for (sum, rows) in sum.iter_mut().zip(rows) {
        let row = &rows[triangle];
        *sum = std::array::from_fn(|i| sum[i] + sign * row[i]);
    }
}
