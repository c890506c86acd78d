//! Samples that the fit aims at: points of the surface as it was given, each with a vertex near it as a hint.
//!
//! A sample stands for the surface around one vertex: the mean of the second-order quadrature points that
//! its triangles have next to it. Where vertices are too few, edges or triangles are sampled. A sample
//! follows its vertex from merger to merger, so that looking for the nearest triangle of the result starts
//! beside it. Where there are far more samples than the fit needs, those that were merged into one vertex
//! become one: their mean stands for all of them, since the distance to a plane is linear. It moves
//! nothing; `fit` does.

use crate::options::FitGoal;
use crate::simd::unchecked::prefetch;
use crate::surface::class::Class;
use crate::surface::{AHEAD, Ring, Surface};
use crate::vertex::GONE;
use stonecut_mesh::relief::Relief;
use stonecut_mesh::vec3::{self, Vec3};

/// Samples are merged only as long as this many are left for a triangle of the result.
const MERGED_PER_TRIANGLE: f64 = 8.0;
/// Least number of vertices for one triangle of the result; with fewer, edges are sampled: there are three
/// times as many. With 5 vertices a triangle the error on igea fell to 0.96x only, with 15 edges to 0.85x.
const VERTICES_PER_TRIANGLE: f64 = 8.0;
/// Least number of triangles for one of the result; with fewer, each gets three points inside instead of its
/// edges: what cells leave for the finish has been thinned before.
const TRIANGLES_PER_TRIANGLE: f64 = 8.0;
/// Least number of triangles of the original for one that a round leaves; with fewer, the middles of triangles are
/// sampled. In a round to 40 % kept, vertices cost 7 % of error in the end.
const VERTICES_PER_ROUND: f64 = 8.0;
/// Weights of two of the three corners at those points, which integrate to second order, as edges do.
const INSIDE: f64 = 1.0 / 6.0;
/// Distance of the quadrature point from the middle of a triangle towards the corner, as a share: a half is exact to
/// second order. Between 0.35 and 0.65 it makes no difference at 1 %.
const SHIFT: f32 = 0.5;

/// Mergers in a row that a hint follows before it is given up; vertices of a removed speck lead nowhere.
const LONGEST_WAY: usize = 4096;

/// A point of the original surface.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sample {
    /// Relative to `Samples::centre`, in scaled units.
    pub(crate) at: [f32; 3],
    /// Area it stands for, scaled.
    pub(crate) weight: f32,
    /// A vertex near it; `GONE` if there is none any more.
    pub(crate) hint: u32,
}

impl Sample {
    /// True for one in about `step` samples, by the bits of its place.
    pub(crate) fn is_in(&self, step: u32) -> bool {
        let [x, y, z] = self.at.map(f32::to_bits);
        let mixed = (x ^ y.rotate_left(11) ^ z.rotate_left(22)).wrapping_mul(0x9e37_79b1);
        u64::from(mixed) * u64::from(step) < 1 << 32
    }
}

/// Points of the original surface. Memory: 20 bytes each, and as much again while they are sorted; there
/// are half as many as triangles given, or three or six times as many where that would be too few.
#[derive(Clone)]
pub(crate) struct Samples {
    /// In input units.
    pub(crate) centre: Vec3,
    pub(crate) list: Vec<Sample>,
    pub(crate) goal: FitGoal,
}

/// Bytes of the samples of `n_triangles`.
pub(crate) fn bytes(n_triangles: u64, target: u64) -> u64 {
    n_triangles * Density::of(n_triangles, target).bytes()
}

/// Bytes of the samples of `n_triangles` in a round, the first one or a later one.
pub(crate) fn round_bytes(n_triangles: u64, is_first: bool) -> u64 {
    n_triangles * if is_first { Density::Middles } else { Density::Triangles }.bytes()
}

/// Elements of the surface that get a sample each.
enum Density {
    Vertices,
    Middles,
    Edges,
    Triangles,
}

impl Density {
    /// Bytes for each triangle; where hardly fewer are left they are counted twice, since sorting makes a copy.
    fn bytes(self) -> u64 {
        match self {
            Density::Vertices => 20,
            Density::Edges => 30,
            Density::Middles => 40,
            Density::Triangles => 120,
        }
    }

    /// Over the relief of a round before.
    fn over_relief(n_triangles: u64, left: u64) -> Density {
        match n_triangles as f64 >= TRIANGLES_PER_TRIANGLE * left as f64 {
            true => Density::Middles,
            false => Density::Triangles,
        }
    }

    /// In a round, of the original.
    fn of_round(n_triangles: u64, left: u64) -> Density {
        match n_triangles as f64 >= VERTICES_PER_ROUND * left as f64 {
            true => Density::Vertices,
            false => Density::Middles,
        }
    }

    fn of(n_triangles: u64, target: u64) -> Density {
        let (n, target) = (n_triangles as f64, target as f64);
        if 0.5 * n >= VERTICES_PER_TRIANGLE * target {
            Density::Vertices
        } else if n >= TRIANGLES_PER_TRIANGLE * target {
            Density::Edges
        } else {
            Density::Triangles
        }
    }
}

/// Sums of one sample: weighted place and weight.
type Moment = [f64; 4];

fn add(sum: &mut Moment, at: Vec3, weight: f64) {
    for k in 0..3 {
        sum[k] += weight * at[k];
    }
    sum[3] += weight;
}

/// Raises the corners of a triangle to the original over it.
fn raise(corners: &mut [Vec3; 3], relief: Option<&Relief>) {
    let Some(relief) = relief.filter(|relief| **relief != Relief::default()) else { return };
    let n = vec3::normal(*corners);
    // Heights are in units of the root of the double area.
    let unit = vec3::length_sq(n).sqrt().sqrt();
    if unit > 0.0 {
        for (corner, height) in corners.iter_mut().zip(relief.heights()) {
            *corner = vec3::add(*corner, vec3::scale(n, f64::from(height) / unit));
        }
    }
}

impl Samples {
    /// Samples a surface that is to be simplified as `goal` says; the original if triangles have `relief`, which may
    /// be empty.
    pub(crate) fn take(surface: &Surface, goal: FitGoal, relief: &[Relief]) -> Samples {
        let centre = surface.vertices.first().map_or([0.0; 3], |vertex| vertex.position);
        let mut samples = Samples { centre, list: Vec::new(), goal };
        // What a round leaves is not the result yet.
        let (n, is_round) = (surface.n_alive, goal.sweeps == 1);
        let density = match is_round {
            _ if !relief.is_empty() && goal.is_sparse => Density::Middles,
            _ if !relief.is_empty() => Density::over_relief(n, goal.left),
            true => Density::of_round(n, goal.left),
            false => Density::of(n, goal.left),
        };
        match density {
            Density::Vertices => samples.take_vertices(surface),
            Density::Middles => samples.take_middles(surface, relief),
            Density::Edges => samples.take_edges(surface),
            Density::Triangles => samples.take_points(surface, relief),
        }
        samples
    }

    /// Memory in bytes.
    pub(crate) fn bytes(&self) -> u64 {
        (self.list.capacity() * size_of::<Sample>()) as u64
    }

    fn corners(&self, surface: &Surface, t: &[u32; 3]) -> ([Vec3; 3], f64) {
        let corners = t.map(|v| {
            let offset = vec3::sub(surface.vertices[v as usize].position, self.centre);
            vec3::scale(offset, surface.scale)
        });
        (corners, 0.5 * vec3::length_sq(vec3::normal(corners)).sqrt())
    }

    fn take_vertices(&mut self, surface: &Surface) {
        let mut sums: Vec<[f32; 4]> = vec![[0.0; 4]; surface.vertices.len()];
        // Sums are relative to the vertex itself, so that f32 is enough.
        let mut ahead = surface.triangles.iter().skip(AHEAD);
        for t in &surface.triangles {
            if let Some(&[_, next, last]) = ahead.next() {
                prefetch(&surface.vertices, next);
                prefetch(&surface.vertices, last);
            }
            if t[0] == GONE {
                continue;
            }
            let (b, c) = (surface.edge(t[0], t[1]), surface.edge(t[0], t[2]));
            let n = vec3::cross(b, c);
            let area = 0.5 * vec3::dot(n, n).sqrt();
            for (&v, corner) in t.iter().zip([[0.0; 3], b, c]) {
                let sum = &mut sums[v as usize];
                for k in 0..3 {
                    let middle = (b[k] + c[k]) * (1.0 / 3.0);
                    sum[k] += area * (middle - corner[k]) * (1.0 - SHIFT);
                }
                sum[3] += area;
            }
        }
        self.list.reserve_exact(sums.iter().filter(|sum| sum[3] > 0.0).count());
        for (v, sum) in sums.iter().enumerate().filter(|(_, sum)| sum[3] > 0.0) {
            let p = surface.vertices[v].position;
            let at = std::array::from_fn(|k| {
                ((p[k] - self.centre[k]) * surface.scale) as f32 + sum[k] / sum[3]
            });
            self.list.push(Sample { at, weight: sum[3] / 3.0, hint: v as u32 });
        }
    }

    /// The middles of the sides of triangles integrate to second order, too. An edge between two triangles is
    /// taken from one of them, whose area stands for that of the other.
    fn take_edges(&mut self, surface: &Surface) {
        let inner = |v: u32| surface.rings[v as usize].class == Some(Class::Interior);
        self.list.reserve_exact(surface.n_alive as usize * 3 / 2);
        for t in surface.triangles.iter().filter(|t| t[0] != GONE) {
            let (corners, area) = self.corners(surface, t);
            for k in 0..3 {
                let (a, b) = (t[k], t[(k + 1) % 3]);
                let is_shared = inner(a) || inner(b);
                if is_shared && a > b {
                    continue;
                }
                let (p, q) = (corners[k], corners[(k + 1) % 3]);
                let at = std::array::from_fn(|i| (0.5 * (p[i] + q[i])) as f32);
                let share = if is_shared { 2.0 / 3.0 } else { 1.0 / 3.0 };
                self.list.push(Sample { at, weight: (area * share) as f32, hint: a });
            }
        }
    }

    /// The middles of triangles; of the original over each, where there is relief.
    fn take_middles(&mut self, surface: &Surface, relief: &[Relief]) {
        self.list.reserve_exact(surface.n_alive as usize);
        for (i, t) in surface.triangles.iter().enumerate().filter(|(_, t)| t[0] != GONE) {
            let (mut corners, area) = self.corners(surface, t);
            raise(&mut corners, relief.get(i));
            let sum = vec3::add(corners[0], vec3::add(corners[1], corners[2]));
            let at = sum.map(|x| (x / 3.0) as f32);
            self.list.push(Sample { at, weight: area as f32, hint: t[0] });
        }
    }

    /// Three points inside each triangle; of the original over it, where there is relief.
    fn take_points(&mut self, surface: &Surface, relief: &[Relief]) {
        self.list.reserve_exact(surface.n_alive as usize * 3);
        for (i, t) in surface.triangles.iter().enumerate().filter(|(_, t)| t[0] != GONE) {
            let (mut corners, area) = self.corners(surface, t);
            raise(&mut corners, relief.get(i));
            for k in 0..3 {
                let near = vec3::scale(corners[k], 1.0 - 2.0 * INSIDE);
                let others = vec3::add(corners[(k + 1) % 3], corners[(k + 2) % 3]);
                let at = vec3::add(near, vec3::scale(others, INSIDE));
                let weight = (area / 3.0) as f32;
                self.list.push(Sample { at: at.map(|x| x as f32), weight, hint: t[k] });
            }
        }
    }

    /// Points the hints at vertices that are still there, as far as mergers lead to one.
    pub(crate) fn follow(&mut self, rings: &[Ring]) {
        for sample in &mut self.list {
            let mut at = sample.hint;
            for _ in 0..LONGEST_WAY {
                match rings.get(at as usize) {
                    Some(ring) if ring.class.is_none() => at = ring.start,
                    _ => break,
                }
            }
            let is_there = rings.get(at as usize).is_some_and(|ring| ring.class.is_some());
            sample.hint = if is_there { at } else { GONE };
        }
    }

    /// Takes over the new numbers of the vertices; `place` is `GONE` for those that are gone. Merges
    /// samples if there are more than enough.
    pub(crate) fn renumber(&mut self, place: &[u32], n_alive: u64, n_vertices: usize) {
        for sample in &mut self.list {
            sample.hint = place.get(sample.hint as usize).copied().unwrap_or(GONE);
        }
        if n_alive as f64 * 0.5 >= MERGED_PER_TRIANGLE * self.goal.merged as f64 {
            self.merge(n_vertices);
        }
    }

    /// One in about `step` samples; the same ones whatever their order.
    pub(crate) fn sparse(&self, step: u32) -> Vec<Sample> {
        self.list.iter().filter(|sample| sample.is_in(step)).copied().collect()
    }

    fn merge(&mut self, n_vertices: usize) {
        let mut sums: Vec<Moment> = vec![[0.0; 4]; n_vertices];
        for sample in self.list.iter().filter(|sample| sample.hint != GONE) {
            add(
                &mut sums[sample.hint as usize],
                sample.at.map(f64::from),
                f64::from(sample.weight),
            );
        }
        self.list.clear();
        for (v, sum) in sums.iter().enumerate().filter(|(_, sum)| sum[3] > 0.0) {
            let at = std::array::from_fn(|k| (sum[k] / sum[3]) as f32);
            self.list.push(Sample { at, weight: sum[3] as f32, hint: v as u32 });
        }
    }
}
