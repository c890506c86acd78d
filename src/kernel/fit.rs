//! Moves the vertices of a simplified mesh so that its error against the original falls.
//!
//! Each sample of the original pulls at the triangle it is nearest to, along the normal of that triangle.
//! A sweep finds the triangles, solves the normal equations of all vertices at once by a few steps of
//! conjugate gradients, and moves as far as a trust region allows. The triangles stay what they are, and
//! vertices that are not interior stay where they are. What the samples are, `samples` decides; how they
//! are found, `nearest`.

use super::lanes::Simd;
use super::legal::Class;
use super::nearest::{Foot, feet};
use super::samples::{Sample, Samples};
use super::surface::{GONE, Surface};
use super::vector::{add, cross, dot, normal, scale, sub};

/// Times that the nearest triangles are found and the vertices moved.
const SWEEPS: u64 = 2;
/// Steps of conjugate gradients a sweep.
const STEPS: usize = 4;
/// Share of a vertex' trace that is added to its diagonal.
const DAMPING: f32 = 1e-3;
/// A step squared is at most this share of the area around the vertex.
const TRUST: f32 = 0.02;
/// No triangle turns further than this cosine within a sweep.
const TURN_COSINE: f32 = 0.5;
/// Double area over the sum of squared sides: no triangle that is worse than this gets worse still.
const MIN_SHAPE: f32 = 0.02;
/// Times that steps are cut in half where triangles would turn or become needles; then they are left out.
const HALVINGS: usize = 3;
/// A vertex goes back to where it was if the worst sample next to it is now farther off than the worst there was,
/// and than this many times the RMS of all.
const TAIL: f64 = 4.0;

/// Where nothing moves nothing is unsound, so holding back ends long before that.
const MAX_ROUNDS: usize = 64;

type V = [f32; 3];

/// Whether the vertices of the result are fitted to the original; only where the stop is a count.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Fit {
    /// Always.
    On,
    /// Never.
    Off,
    /// Where it is cheap against the collapses: at most `AUTO_FIT_RATIO` of the triangles are left.
    #[default]
    Auto,
}

/// `Fit::Auto` fits where at most this share of the triangles is left: 1 %, with room for targets that were rounded
/// up. There it costs 15 % of a run in memory and 5 % of one through cells (docs/results/kernel.md).
pub const AUTO_FIT_RATIO: f64 = 0.011;

impl Fit {
    /// Whether to fit a mesh that goes from `n_triangles` to `target`.
    pub fn applies(self, n_triangles: u64, target: u64) -> bool {
        match self {
            Fit::On => target < n_triangles,
            Fit::Off => false,
            Fit::Auto => target as f64 <= n_triangles as f64 * AUTO_FIT_RATIO,
        }
    }

    /// The same, decided: for a part of a job whose counts are not those of the whole.
    pub fn decided(self, n_triangles: u64, target: u64) -> Fit {
        if self.applies(n_triangles, target) { Fit::On } else { Fit::Off }
    }
}

/// What the fit did.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct FitStatistics {
    /// Points of the original that the mesh was fitted to.
    pub samples: u64,
    /// Times that the nearest triangles were found and the vertices moved.
    pub sweeps: u64,
    /// Vertices that lie elsewhere than before.
    pub moved: u64,
    /// Root mean square distance of the samples before, in input units.
    pub rms_before: f64,
    /// The same afterwards.
    pub rms_after: f64,
}

/// What the samples of one triangle ask for: sums of weight times products of barycentric weights (00, 01,
/// 02, 11, 12, 22), and of weight times barycentric weight times height.
#[derive(Clone, Copy)]
struct Element {
    mass: [f32; 6],
    pull: [f32; 3],
}

impl Element {
    const ZERO: Element = Element { mass: [0.0; 6], pull: [0.0; 3] };

    #[inline]
    fn add(&mut self, weight: f32, foot: &Foot) {
        let b = foot.weights;
        let w = b.map(|b| b * weight);
        let products =
            [w[0] * b[0], w[0] * b[1], w[0] * b[2], w[1] * b[1], w[1] * b[2], w[2] * b[2]];
        for (sum, product) in self.mass.iter_mut().zip(products) {
            *sum += product;
        }
        for (sum, w) in self.pull.iter_mut().zip(w) {
            *sum += w * foot.height;
        }
    }
}

/// An element in its place.
struct Plate {
    corners: [u32; 3],
    normal: V,
    element: Element,
}

/// Area-weighted squared distances.
#[derive(Default)]
struct Energy {
    sum: f64,
    weight: f64,
}

impl Energy {
    fn add(&mut self, sample: &Sample, foot: &Foot) {
        self.sum += f64::from(sample.weight) * f64::from(foot.distance_sq);
        self.weight += f64::from(sample.weight);
    }

    fn mean(&self) -> f64 {
        if self.weight > 0.0 { self.sum / self.weight } else { 0.0 }
    }

    fn rms(&self, scale: f64) -> f64 {
        self.mean().sqrt() / scale
    }
}

/// Fits the surface to the samples; vertices that are not interior keep their bits.
///
/// Memory: about 140 bytes a triangle of the surface and 40 a sample, those that are given included.
pub(crate) fn fit(surface: &mut Surface, mut samples: Samples, simd: Simd) -> FitStatistics {
    samples.follow(&surface.rings);
    surface.vertices.shrink_to_fit();
    surface.rings.shrink_to_fit();
    surface.arena.shrink_to_fit();
    surface.triangles.shrink_to_fit();
    let mut work = Work::new(surface, &samples);
    let mut statistics = FitStatistics { sweeps: SWEEPS, ..FitStatistics::default() };
    let mut worst_before = Vec::new();
    for sweep in 0..SWEEPS {
        let (plates, energy, worst) = work.plates(&mut samples.list, simd);
        if sweep == 0 {
            statistics.rms_before = energy.rms(work.surface.scale);
            statistics.samples = samples.list.len() as u64;
            worst_before = worst;
        }
        let steps = work.solve(&plates);
        work.go(&plates, steps);
    }
    let (plates, energy, worst) = work.plates(&mut samples.list, simd);
    statistics.rms_after = energy.rms(work.surface.scale);
    let goes_up = statistics.rms_after >= statistics.rms_before;
    if goes_up {
        return statistics;
    }
    let floor = (TAIL * TAIL * energy.mean()) as f32;
    work.take_back(&plates, &worst_before, &worst, floor);
    statistics.moved = work.write_back();
    statistics
}

/// The surface in f32, relative to the centre of the samples.
struct Work<'a> {
    surface: &'a mut Surface,
    place: Vec<V>,
    before: Vec<V>,
    /// Whether each vertex may move.
    free: Vec<bool>,
    /// Double area around each vertex.
    around: Vec<f32>,
}

impl<'a> Work<'a> {
    fn new(surface: &'a mut Surface, samples: &Samples) -> Self {
        let local = |position: &[f64; 3]| -> V {
            std::array::from_fn(|k| ((position[k] - samples.centre[k]) * surface.scale) as f32)
        };
        let place: Vec<V> = surface.vertices.iter().map(|v| local(&v.position)).collect();
        let is_free = |r: &super::surface::Ring| r.class == Some(Class::Interior) && r.len > 0;
        let free = surface.rings.iter().map(is_free).collect();
        let around = vec![0.0; place.len()];
        Work { surface, before: place.clone(), place, free, around }
    }

    /// What the samples ask of each triangle; their error; the worst squared distance next to each vertex.
    fn plates(&mut self, samples: &mut Vec<Sample>, simd: Simd) -> (Vec<Plate>, Energy, Vec<f32>) {
        let mut elements = vec![Element::ZERO; self.surface.triangles.len()];
        let mut worst_here = vec![0.0f32; elements.len()];
        let mut energy = Energy::default();
        feet(self.surface, &self.place, samples, simd, |sample, foot| {
            elements[foot.triangle as usize].add(sample.weight, &foot);
            energy.add(sample, &foot);
            let worst = &mut worst_here[foot.triangle as usize];
            *worst = worst.max(foot.distance_sq);
        });
        let mut plates = Vec::with_capacity(self.surface.n_alive as usize);
        self.around.fill(0.0);
        let mut worst = vec![0.0f32; self.place.len()];
        for (id, (&corners, &element)) in self.surface.triangles.iter().zip(&elements).enumerate() {
            if corners[0] == GONE {
                continue;
            }
            let n = normal(corners.map(|v| self.place[v as usize]));
            let length = dot(n, n).sqrt();
            for v in corners.map(|v| v as usize) {
                self.around[v] += length;
                worst[v] = worst[v].max(worst_here[id]);
            }
            let normal = if length > 0.0 { scale(n, 1.0 / length) } else { [0.0; 3] };
            plates.push(Plate { corners, normal, element });
        }
        (plates, energy, worst)
    }

    /// How far each vertex should go.
    fn solve(&self, plates: &[Plate]) -> Vec<V> {
        let n = self.place.len();
        let mut blocks = vec![[0.0f32; 6]; n];
        let mut rest = vec![[0.0f32; 3]; n];
        for plate in plates {
            let m = plate.normal;
            let outer =
                [m[0] * m[0], m[0] * m[1], m[0] * m[2], m[1] * m[1], m[1] * m[2], m[2] * m[2]];
            for (k, diagonal) in [0, 3, 5].into_iter().enumerate() {
                let v = plate.corners[k] as usize;
                let mass = plate.element.mass[diagonal];
                for (sum, x) in blocks[v].iter_mut().zip(outer) {
                    *sum += mass * x;
                }
                rest[v] = add(rest[v], scale(m, plate.element.pull[k]));
            }
        }
        let mut damping = vec![0.0f32; n];
        for v in 0..n {
            let trace = blocks[v][0] + blocks[v][3] + blocks[v][5];
            let is_used = self.free[v] && trace > 0.0;
            if !is_used {
                rest[v] = [0.0; 3];
                continue;
            }
            damping[v] = DAMPING * trace;
            for k in [0, 3, 5] {
                blocks[v][k] += damping[v];
            }
            blocks[v] = inverse(blocks[v]);
        }
        conjugate_gradients(plates, &damping, &blocks, rest, STEPS)
    }

    /// Moves the vertices by `steps` as far as they may.
    fn go(&mut self, plates: &[Plate], mut steps: Vec<V>) {
        let mut moved = self.place.clone();
        for (v, step) in steps.iter_mut().enumerate() {
            let sq = dot(*step, *step);
            let most = TRUST * 0.5 * self.around[v];
            let is_sound = sq.is_finite() && self.free[v];
            if !is_sound {
                *step = [0.0; 3];
            } else if sq > most {
                *step = scale(*step, (most / sq).sqrt());
            }
            moved[v] = add(self.place[v], *step);
        }
        for round in 0..MAX_ROUNDS {
            let touched = unsound(plates, &self.place, &moved);
            if touched.is_empty() {
                break;
            }
            for v in touched.into_iter().map(|v| v as usize) {
                steps[v] = if round < HALVINGS { scale(steps[v], 0.5) } else { [0.0; 3] };
                moved[v] = add(self.place[v], steps[v]);
            }
        }
        self.place = moved;
    }

    /// Puts vertices back to where they were before the fit where the worst sample has become worse.
    fn take_back(&mut self, plates: &[Plate], before: &[f32], after: &[f32], floor: f32) {
        for (v, (&before, &after)) in before.iter().zip(after).enumerate() {
            if after > before.max(floor) {
                self.place[v] = self.before[v];
            }
        }
        for _ in 0..MAX_ROUNDS {
            let touched = unsound(plates, &self.before, &self.place);
            if touched.is_empty() {
                break;
            }
            touched.iter().for_each(|&v| self.place[v as usize] = self.before[v as usize]);
        }
    }

    /// Brings what has moved back into the surface; how many vertices those are.
    fn write_back(&mut self) -> u64 {
        let mut moved = 0;
        for (v, (now, before)) in self.place.iter().zip(&self.before).enumerate() {
            if self.free[v] && now != before {
                moved += 1;
                let position = &mut self.surface.vertices[v].position;
                for k in 0..3 {
                    position[k] += f64::from(now[k] - before[k]) / self.surface.scale;
                }
            }
        }
        moved
    }
}

/// Corners of triangles that turn too far or become needles on the way from one place to the other: those
/// that do move.
fn unsound(plates: &[Plate], from: &[V], to: &[V]) -> Vec<u32> {
    let mut corners = Vec::new();
    for plate in plates {
        let before = plate.corners.map(|v| from[v as usize]);
        let after = plate.corners.map(|v| to[v as usize]);
        if before != after && !stays_sound(before, after) {
            let moves = |v: &&u32| from[**v as usize] != to[**v as usize];
            corners.extend(plate.corners.iter().filter(moves));
        }
    }
    corners.sort_unstable();
    corners.dedup();
    corners
}

/// Whether a triangle neither turns too far nor becomes a needle.
fn stays_sound(before: [V; 3], after: [V; 3]) -> bool {
    let shape = |t: [V; 3]| {
        let e = [sub(t[1], t[0]), sub(t[2], t[0]), sub(t[2], t[1])];
        let n = cross(e[0], e[1]);
        let length = dot(n, n).sqrt();
        (n, length, length / (dot(e[0], e[0]) + dot(e[1], e[1]) + dot(e[2], e[2])))
    };
    let ((n0, l0, s0), (n1, l1, s1)) = (shape(before), shape(after));
    dot(n0, n1) >= TURN_COSINE * l0 * l1 && (s1 >= MIN_SHAPE || s1 >= s0)
}

/// The inverse of a symmetric positive definite matrix (xx, xy, xz, yy, yz, zz).
fn inverse(m: [f32; 6]) -> [f32; 6] {
    let m = m.map(f64::from);
    let c = [
        m[3] * m[5] - m[4] * m[4],
        m[2] * m[4] - m[1] * m[5],
        m[1] * m[4] - m[2] * m[3],
        m[0] * m[5] - m[2] * m[2],
        m[1] * m[2] - m[0] * m[4],
        m[0] * m[3] - m[1] * m[1],
    ];
    let determinant = m[0] * c[0] + m[1] * c[1] + m[2] * c[2];
    c.map(|c| (c / determinant) as f32)
}

fn product(m: [f32; 6], x: V) -> V {
    [dot([m[0], m[1], m[2]], x), dot([m[1], m[3], m[4]], x), dot([m[2], m[4], m[5]], x)]
}

/// Solves (sum over plates + damping) x = `rest`, with inverse blocks as preconditioner; where a block is zero,
/// x stays zero. Sums run in f64 and in one order.
fn conjugate_gradients(
    plates: &[Plate],
    damping: &[f32],
    blocks: &[[f32; 6]],
    mut rest: Vec<V>,
    n_steps: usize,
) -> Vec<V> {
    let n = rest.len();
    let mut x = vec![[0.0f32; 3]; n];
    let mut image = vec![[0.0f32; 3]; n];
    let mut way: Vec<V> = rest.iter().zip(blocks).map(|(&r, &b)| product(b, r)).collect();
    let total =
        |a: &[V], b: &[V]| -> f64 { a.iter().zip(b).map(|(a, b)| f64::from(dot(*a, *b))).sum() };
    let mut left = total(&rest, &way);
    for step in 0..n_steps {
        for v in 0..n {
            image[v] = scale(way[v], damping[v]);
        }
        for plate in plates {
            let h = plate.corners.map(|v| dot(plate.normal, way[v as usize]));
            let m = &plate.element.mass;
            let g = [
                m[0] * h[0] + m[1] * h[1] + m[2] * h[2],
                m[1] * h[0] + m[3] * h[1] + m[4] * h[2],
                m[2] * h[0] + m[4] * h[1] + m[5] * h[2],
            ];
            for (&v, g) in plate.corners.iter().zip(g) {
                let image = &mut image[v as usize];
                *image = add(*image, scale(plate.normal, g));
            }
        }
        let along = total(&way, &image);
        let goes_on = along > 0.0 && left > 0.0;
        if !goes_on {
            break;
        }
        let length = (left / along) as f32;
        let is_last = step + 1 == n_steps;
        let mut next = 0.0f64;
        for v in 0..n {
            x[v] = add(x[v], scale(way[v], length));
            if !is_last {
                rest[v] = sub(rest[v], scale(image[v], length));
                image[v] = product(blocks[v], rest[v]);
                next += f64::from(dot(rest[v], image[v]));
            }
        }
        if is_last {
            break;
        }
        let share = (next / left) as f32;
        left = next;
        for v in 0..n {
            way[v] = add(image[v], scale(way[v], share));
        }
    }
    x
}
