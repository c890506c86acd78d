//! Attributes in the error: their sums at every vertex, kept up to date from collapse to collapse.
//!
//! Exists only while some channel has a weight; without, no other part of the kernel does anything more
//! than ask whether it is there. What the sums mean, and the cost that follows from them, is in
//! `attribute_lanes`. Does not choose edges and does not know what a channel stands for.
//!
//! docs/algorithm.md, section 7.

use crate::cost::attribute_lanes::{
    AttributeEdges, AttributeRing, AttributeTriangles, Rows, numbers,
};
use crate::cost::placement::place_on_edge;
use crate::cost::quadric::Evaluated;
use crate::simd::Simd;
use crate::surface::Surface;
use crate::surface::wedges::Corners;
use crate::vertex::GONE;
use stonecut_mesh::blend::of_ends;
use stonecut_mesh::steps::count;
use stonecut_mesh::vec3::Vec3;

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
#[derive(Clone)]
pub(crate) struct Attributes {
    /// Channel and scaled length per unit of it.
    active: Vec<(usize, f32)>,
    /// True if an active channel is interpolated along the edge, and never leaves what the ends have.
    confined: Vec<bool>,
    /// True if some values of active channels are missing: NaN or infinite. They count as those beside them.
    has_gaps: bool,
    eights: usize,
    simd: Simd,
    /// `eights` a vertex: M, then an L for each active channel.
    sums: Vec<[f32; 8]>,
    patch: PendingChange,
}

/// Intermediate results of a collapse under way.
#[derive(Clone, Default)]
struct PendingChange {
    /// Numbers after minus before, `eights` for each eight triangles, one [eight] a triangle.
    change: Vec<[[f32; 8]; 8]>,
    /// The survivor's numbers.
    total: Vec<[f32; 8]>,
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
    /// The triangles themselves; places beyond `n` mean nothing.
    pub(crate) ids: &'a [u32],
    /// Number of triangles of `v0`, which come first; then those of `v1`.
    pub(crate) n0: usize,
    pub(crate) n_kept: usize,
    pub(crate) n: usize,
}

impl Attributes {
    /// `None` if no channel has a weight. Weights are lengths in input units per unit of a channel.
    pub(crate) fn new(weights: &[f32], confined: &[bool], scale: f64, simd: Simd) -> Option<Self> {
        let active: Vec<(usize, f32)> = weights
            .iter()
            .enumerate()
            .filter(|(_, weight)| **weight > 0.0)
            .map(|(channel, &weight)| (channel, (f64::from(weight) * scale) as f32))
            // Weights that round to nothing beside the extent of the mesh are ignored.
            .filter(|(_, factor)| factor.is_normal())
            .take(MAX_WEIGHTED)
            .collect();
        let eights = numbers(active.len()).div_ceil(8).max(2);
        let none = active.is_empty();
        let confined = active.iter().map(|&(c, _)| confined.get(c) == Some(&true)).collect();
        let (sums, patch, has_gaps) = (Vec::new(), PendingChange::default(), false);
        (!none).then_some(Attributes { active, confined, has_gaps, eights, simd, sums, patch })
    }

    /// The channels that count, with their factors.
    pub(crate) fn active(&self) -> &[(usize, f32)] {
        &self.active
    }

    /// The value, or 0 where it is missing.
    #[inline(always)]
    fn known(&self, value: f32) -> f32 {
        if self.has_gaps && !value.is_finite() { 0.0 } else { value }
    }

    /// Sums up all triangles again; none of them may be gone.
    pub(crate) fn build(&mut self, corners: Corners) {
        self.has_gaps = corners.has_gaps(&self.active);
        self.sums.clear();
        self.sums.resize(corners.surface.vertices.len() * self.eights, [0.0; 8]);
        with_eights!(self.eights, self.add_all(corners));
    }

    fn add_all<const K: usize>(&mut self, corners: Corners) {
        let mut rows = [[[0.0; 8]; 8]; K];
        let mut sums = std::mem::take(&mut self.sums);
        let by_vertex = sums.as_chunks_mut::<K>().0;
        for (block, eight) in corners.surface.triangles.chunks(8).enumerate() {
            let ids = std::array::from_fn(|i| (block * 8 + i.min(eight.len() - 1)) as u32);
            self.triangles(corners, ids, &mut rows);
            for (i, t) in eight.iter().enumerate() {
                for &v in t {
                    add(&mut by_vertex[v as usize], &rows, i);
                }
            }
        }
        self.sums = sums;
    }

    /// Checks the lengths against those of the surface; the contradiction in words.
    #[cfg(debug_assertions)]
    pub(crate) fn check(&self, surface: &Surface) -> Result<(), String> {
        match self.sums.len() == surface.vertices.len() * self.eights {
            true => Ok(()),
            false => Err(format!("{} sums of attributes", self.sums.len())),
        }
    }

    /// The sums of one vertex from its ring; they stay where that lists triangles that are gone, as long ones may.
    pub(crate) fn refresh(&mut self, corners: Corners, v: u32) {
        let ring = corners.surface.ring(v);
        count(ring.len());
        if ring.iter().any(|&t| corners.surface.triangles[t as usize][0] == GONE) {
            return;
        }
        self.sums.resize(corners.surface.vertices.len() * self.eights, [0.0; 8]);
        with_eights!(self.eights, self.add_ring(corners, v));
    }

    fn add_ring<const K: usize>(&mut self, corners: Corners, v: u32) {
        let mut rows = [[[0.0; 8]; 8]; K];
        let mut sum = [[0.0; 8]; K];
        for eight in corners.surface.ring(v).chunks(8) {
            let id = |i: usize| eight[i.min(eight.len() - 1)];
            self.triangles(corners, std::array::from_fn(id), &mut rows);
            for i in 0..eight.len() {
                add(&mut sum, &rows, i);
            }
        }
        self.sums.as_chunks_mut::<K>().0[v as usize] = sum;
    }

    /// Rows of eight triangles.
    fn triangles<const K: usize>(&self, corners: Corners, ids: [u32; 8], out: &mut Rows<K>) {
        let surface = corners.surface;
        let eight: [[u32; 3]; 8] = std::array::from_fn(|i| surface.triangles[ids[i] as usize]);
        let mut values = [[[0.0; 8]; 3]; MAX_WEIGHTED];
        for (i, t) in eight.iter().enumerate() {
            for k in 0..3 {
                let at_corner = corners.values_at(ids[i], t[k]);
                for (values, &(channel, factor)) in values.iter_mut().zip(&self.active) {
                    values[k][i] = at_corner[channel] * factor;
                }
            }
        }
        if self.has_gaps {
            fill(&mut values[..self.active.len()]);
        }
        let vertex = |i: usize, k: usize| &surface.vertices[eight[i][k] as usize];
        self.simd.run(AttributeTriangles {
            a: std::array::from_fn(|i| vertex(i, 0)),
            b: std::array::from_fn(|i| vertex(i, 1)),
            c: std::array::from_fn(|i| vertex(i, 2)),
            values: &values[..self.active.len()],
            scale: surface.scale,
            out,
        });
    }

    /// Cost and place of eight edges, attributes included.
    pub(crate) fn evaluate(
        &self,
        surface: &Surface,
        v0: &[u32; 8],
        v1: &[u32; 8],
        fixed: &[f32; 8],
    ) -> Evaluated {
        with_eights!(self.eights, self.evaluate_eight(surface, v0, v1, fixed))
    }

    fn evaluate_eight<const K: usize>(
        &self,
        surface: &Surface,
        v0: &[u32; 8],
        v1: &[u32; 8],
        fixed: &[f32; 8],
    ) -> Evaluated {
        let sums = self.sums.as_chunks::<K>().0;
        let mut half_step = [[0.0f32; 8]; MAX_WEIGHTED];
        for (i, (&v0, &v1)) in v0.iter().zip(v1).enumerate() {
            let (at0, at1) = (v0 as usize * surface.n_channels, v1 as usize * surface.n_channels);
            for (half, &(channel, factor)) in half_step.iter_mut().zip(&self.active) {
                let step = surface.channels[at1 + channel] - surface.channels[at0 + channel];
                half[i] = self.known(0.5 * factor * step);
            }
        }
        self.simd.run(AttributeEdges::<K> {
            v0: std::array::from_fn(|i| &surface.vertices[v0[i] as usize]),
            v1: std::array::from_fn(|i| &surface.vertices[v1[i] as usize]),
            numbers0: std::array::from_fn(|i| &sums[v0[i] as usize]),
            numbers1: std::array::from_fn(|i| &sums[v1[i] as usize]),
            half_step: &half_step[..self.active.len()],
            fixed: *fixed,
            scale: surface.scale,
        })
    }

    /// Before a collapse: how its ring's sums will change, and the survivor's values at `place` (relative
    /// to the edge's midpoint `centre`, scaled): its own if it is `fixed`, else the best.
    pub(crate) fn before(
        &mut self,
        corners: Corners,
        ring: RingLists,
        (centre, place): (&Vec3, [f32; 3]),
        fixed: bool,
    ) {
        with_eights!(self.eights, self.prepare(corners, ring, (centre, place), fixed));
    }

    fn prepare<const K: usize>(
        &mut self,
        corners: Corners,
        ring: RingLists,
        (centre, place): (&Vec3, [f32; 3]),
        fixed: bool,
    ) {
        let surface = corners.surface;
        let half = surface.edge(ring.v0, ring.v1).map(|x| 0.5 * x);
        let mut corner = [[0.0; 2]; MAX_WEIGHTED];
        let mut middle = [0.0; MAX_WEIGHTED];
        self.best_values::<K>(surface, ring, (half, place), fixed, (&mut corner, &mut middle));
        let mut values = [[[0.0; 8]; 2]; MAX_WEIGHTED];
        let mut after = [[[0.0; 8]; 8]; K];
        let parts = ring.n.div_ceil(8);
        let mut changes = std::mem::take(&mut self.patch.change);
        changes.resize(parts * K, [[0.0; 8]; 8]);
        let (bs, cs) = (ring.b.as_chunks::<8>().0, ring.c.as_chunks::<8>().0);
        for (part, change) in changes.as_chunks_mut::<K>().0.iter_mut().enumerate() {
            for (k, list) in [&bs[part], &cs[part]].into_iter().enumerate() {
                for (i, &v) in list.iter().enumerate() {
                    let at_corner = match part * 8 + i < ring.n {
                        true => corners.values_at(ring.ids[part * 8 + i], v),
                        false => surface.channels_of(v),
                    };
                    for (j, &(channel, factor)) in self.active.iter().enumerate() {
                        values[j][k][i] = self.known((at_corner[channel] - middle[j]) * factor);
                    }
                }
            }
            self.simd.run(AttributeRing {
                b: std::array::from_fn(|i| &surface.vertices[bs[part][i] as usize]),
                c: std::array::from_fn(|i| &surface.vertices[cs[part][i] as usize]),
                values: &values[..self.active.len()],
                corner: &corner[..self.active.len()],
                n0: ring.n0 as f32 - (part * 8) as f32,
                half,
                place,
                centre,
                scale: surface.scale,
                n_kept: ring.n_kept as f32 - (part * 8) as f32,
                n_used: ring.n as f32 - (part * 8) as f32,
                change,
                after: &mut after,
            });
        }
        self.patch.change = changes;
        self.patch.total.clear();
        for columns in &after {
            // One row a number, one place a lane.
            let total =
                columns.map(|x| ((x[0] + x[4]) + (x[1] + x[5])) + ((x[2] + x[6]) + (x[3] + x[7])));
            self.patch.total.push(total);
        }
    }

    /// Half steps and new values relative to the middle, scaled; the middle and the new values as they are.
    fn best_values<const K: usize>(
        &mut self,
        surface: &Surface,
        ring: RingLists,
        (half, place): ([f32; 3], [f32; 3]),
        fixed: bool,
        (corner, middle): (&mut [[f32; 2]; MAX_WEIGHTED], &mut [f32; MAX_WEIGHTED]),
    ) {
        let (v0, v1) = (ring.v0 as usize, ring.v1 as usize);
        let area = |v: usize| {
            let q = &surface.vertices[v].quadric;
            q[0] + q[3] + q[5]
        };
        let (area0, area1) = (area(v0), area(v1));
        let sums = self.sums.as_chunks::<K>().0;
        let dot = |v: usize, j: usize, x: [f32; 3]| {
            let at = |i: usize| sums[v][i / 8][i % 8];
            at(6 + 3 * j) * x[0] + at(7 + 3 * j) * x[1] + at(8 + 3 * j) * x[2]
        };
        let from0: [f32; 3] = std::array::from_fn(|k| place[k] + half[k]);
        let from1: [f32; 3] = std::array::from_fn(|k| place[k] - half[k]);
        let on_edge = place_on_edge(half, place);
        self.patch.values.clear();
        for (j, &(channel, factor)) in self.active.iter().enumerate() {
            let at = |v: usize| surface.channels[v * surface.n_channels + channel];
            middle[j] = 0.5 * at(v0) + 0.5 * at(v1);
            if !middle[j].is_finite() {
                middle[j] = of_ends(at(v0), at(v1), 0.5);
            }
            let step = self.known(0.5 * factor * (at(v1) - at(v0)));
            let sum = dot(v0, j, from0) + dot(v1, j, from1) + (area1 - area0) * step;
            let best = match self.confined[j] {
                true => step * (2.0 * on_edge - 1.0),
                false => sum / (area0 + area1),
            };
            let best = if fixed {
                step
            } else if best.is_finite() {
                best
            } else {
                0.0
            };
            corner[j] = [step, best];
            let value = middle[j] + best / factor;
            self.patch.values.push(if value.is_finite() { value } else { middle[j] });
        }
    }

    /// After a collapse: sets the survivor's values unless it is `fixed`, and brings the sums of the ring
    /// up to date.
    pub(crate) fn after(&mut self, surface: &mut Surface, ring: RingLists, fixed: bool) {
        if !fixed {
            let first = ring.v1 as usize * surface.n_channels;
            for (&(channel, _), &value) in self.active.iter().zip(&self.patch.values) {
                surface.channels[first + channel] = value;
            }
        }
        with_eights!(self.eights, self.update(ring));
    }

    fn update<const K: usize>(&mut self, ring: RingLists) {
        let changes = self.patch.change.as_chunks::<K>().0;
        let sums = self.sums.as_chunks_mut::<K>().0;
        for (i, (&b, &c)) in ring.b.iter().zip(ring.c).enumerate().take(ring.n) {
            add(&mut sums[b as usize], &changes[i / 8], i % 8);
            add(&mut sums[c as usize], &changes[i / 8], i % 8);
        }
        // The rows of vanishing triangles have touched v1 too.
        if let Ok(total) = self.patch.total.as_slice().try_into() {
            sums[ring.v1 as usize] = total;
        }
    }
}

/// Puts the mean of a triangle's other corners where a value is missing; 0 where all are.
fn fill(values: &mut [[[f32; 8]; 3]]) {
    for corners in values {
        for i in 0..8 {
            let known = corners.iter().map(|corner| corner[i]).filter(|x| x.is_finite());
            let n = known.clone().count();
            if n < 3 {
                let mean = known.sum::<f32>() / n.max(1) as f32;
                for corner in corners.iter_mut().filter(|corner| !corner[i].is_finite()) {
                    corner[i] = mean;
                }
            }
        }
    }
}

/// Adds a triangle's row.
#[inline(always)]
fn add<const K: usize>(sum: &mut [[f32; 8]; K], rows: &Rows<K>, triangle: usize) {
    for (sum, rows) in sum.iter_mut().zip(rows) {
        let row = &rows[triangle];
        *sum = std::array::from_fn(|i| sum[i] + row[i]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::schedule::driver::Driver;
    use crate::state::MeshState;
    use crate::{Options, Stop, run::run, tests::sheet};
    use stonecut_mesh::Mesh;

    /// A sheet with a smooth channel, a rough one and a step.
    fn coloured(n: usize) -> Mesh {
        let mut mesh = sheet(n);
        mesh.n_channels = 4;
        for (i, p) in mesh.positions.iter().enumerate() {
            let x = (p[0] - 1e5) as f32;
            let rough = (i as u32).wrapping_mul(2_654_435_761) as f32 / u32::MAX as f32;
            mesh.channels.extend([(7.0 * x).sin(), rough, f32::from(x > 0.5), 3.0]);
        }
        mesh
    }

    fn options(target: u64, weights: &[f32]) -> Options {
        let stop = Stop::Triangles(target);
        Options { stop, weights: weights.to_vec(), ..Options::default() }
    }

    #[test]
    fn sums_kept_up_to_date_are_the_sums_of_the_triangles() {
        let mesh = coloured(40);
        let locked: Vec<bool> = (0..mesh.positions.len()).map(|v| v % 97 == 0).collect();
        let simd = Simd::detect();
        let weights = [0.02, 0.01, 0.02, 0.0];
        let (state, ..) = MeshState::new(mesh, &locked, (&weights, &[]), simd);
        let mut driver = Driver::new(state, simd, crate::Topology::Error);
        assert!(driver.reach(900));
        let kept = driver.state.attributes.take().expect("there are weights");
        let surface = &driver.state.surface;
        let mut fresh =
            Attributes::new(&weights, &[], surface.scale, simd).expect("there are weights");
        fresh.sums.resize(surface.vertices.len() * fresh.eights, [0.0; 8]);
        let largest = kept.sums.iter().flatten().fold(0.0f32, |a, b| a.max(b.abs()));
        let mut n = 0;
        for v in 0..surface.vertices.len() as u32 {
            if surface.rings[v as usize].class.is_some() && surface.rings[v as usize].len > 0 {
                fresh.refresh(driver.state.corners(), v);
                let own = v as usize * kept.eights..(v as usize + 1) * kept.eights;
                for (a, b) in kept.sums[own.clone()].iter().zip(&fresh.sums[own]) {
                    assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-4 * largest));
                }
                n += 1;
            }
        }
        assert!(n > 400);
    }

    #[test]
    fn portable_lanes_give_the_same_bytes_and_no_weight_changes_nothing() {
        let mesh = coloured(240);
        let locked = vec![false; mesh.positions.len()];
        for weights in [&[0.01f32, 0.02, 0.005][..], &[0.01; 4]] {
            let options = options(8_000, weights);
            let portable = run(mesh.clone(), &locked, &options, Simd::Portable);
            assert_eq!(portable, run(mesh.clone(), &locked, &options, Simd::detect()));
            assert!(portable.mesh.channels.iter().all(|c| c.is_finite()));
        }
        let plain = run(mesh.clone(), &locked, &options(8_000, &[]), Simd::detect());
        let zero = run(mesh.clone(), &locked, &options(8_000, &[0.0; 4]), Simd::detect());
        assert_eq!(plain, zero);
    }

    #[test]
    fn a_step_in_a_channel_stays_where_it_is() {
        // A flat square, black on one side and white on the other.
        let mut mesh = coloured(64);
        for p in &mut mesh.positions {
            p[2] = 0.0;
        }
        let locked = vec![false; mesh.positions.len()];
        let deviation = |weights: &[f32]| -> f32 {
            let result = run(mesh.clone(), &locked, &options(200, weights), Simd::detect()).mesh;
            let off = |v: usize| {
                let step = f32::from(result.positions[v][0] - 1e5 > 0.5);
                (result.channels_of(v as u32)[2] - step).abs()
            };
            (0..result.positions.len()).map(off).sum::<f32>() / result.positions.len() as f32
        };
        let (with, without) = (deviation(&[0.0, 0.0, 0.1, 0.0]), deviation(&[]));
        assert!(with < 0.6 * without, "{with} against {without}");
    }
}
