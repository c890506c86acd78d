//! Moves the vertices of a simplified mesh so that its error against the original falls.
//!
//! Each sample of the original pulls at the triangle it is nearest to, along the normal of that triangle.
//! A sweep finds the triangles, solves the normal equations of all vertices at once, and moves as far as
//! `bounds` allow. The triangles stay what they are, and vertices that are not interior stay where they are.
//! What the samples are, `samples` decides; how they are found, `nearest`.
//!
//! Source: the vertex step of Hoppe et al. 1993, by the conjugate gradients of Hestenes & Stiefel 1952
//! (docs/references.md; docs/algorithm.md, section 8).

pub(crate) mod nearest;
pub(crate) mod samples;

mod bounds;
mod normal_equations;

use crate::kernel::collapse::legality::Class;
use crate::kernel::fit::nearest::{Face, Foot, feet, nearest_around};
use crate::kernel::fit::samples::{Sample, Samples};
use crate::kernel::simd::Simd;
use crate::kernel::surface::{GONE, Surface};
use crate::mesh::vec3::{dot, normal, scale, sub};
use normal_equations::{Element, Plate, solve};

/// Times that the nearest triangles are found and the vertices moved. One leaves 5 % more error on the
/// samples, a third gains 1 to 3 % for half as much time again (docs/results/kernel.md, "The fit").
const SWEEPS: u64 = 2;
/// One in so many samples tells whether the fit was one.
const CHECKED_STEP: usize = 4;

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

/// `Fit::Auto` fits where at most this share of the triangles is left: 1 %, with room for targets that were
/// rounded up. There it costs 13 % of a run in memory and 5 % of one through cells
/// (docs/results/kernel.md).
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
    /// The same of a quarter of them afterwards.
    pub rms_after: f64,
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
    for sweep in 0..SWEEPS {
        let (plates, energy) = work.plates(&mut samples.list, simd);
        if sweep == 0 {
            statistics.rms_before = energy.rms(work.surface.scale);
            statistics.samples = samples.list.len() as u64;
        }
        let steps = solve(&plates, &work.free);
        work.go(&plates, steps, energy.mean(), simd);
    }
    samples.thin_out(CHECKED_STEP);
    let energy = work.energy(&mut samples.list, simd);
    statistics.rms_after = energy.rms(work.surface.scale);
    // Written so that NaN is no gain.
    if statistics.rms_after < statistics.rms_before {
        statistics.moved = work.write_back(simd);
    }
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
    /// Scratch space.
    faces: Vec<Face>,
}

impl<'a> Work<'a> {
    fn new(surface: &'a mut Surface, samples: &Samples) -> Self {
        let local = |position: &[f64; 3]| -> V {
            std::array::from_fn(|k| ((position[k] - samples.centre[k]) * surface.scale) as f32)
        };
        let place: Vec<V> = surface.vertices.iter().map(|v| local(&v.position)).collect();
        let is_free =
            |r: &crate::kernel::surface::Ring| r.class == Some(Class::Interior) && r.len > 0;
        let free = surface.rings.iter().map(is_free).collect();
        let around = vec![0.0; place.len()];
        Work { surface, before: place.clone(), place, free, around, faces: Vec::new() }
    }

    /// What the samples ask of each triangle, and their error.
    fn plates(&mut self, samples: &mut Vec<Sample>, simd: Simd) -> (Vec<Plate>, Energy) {
        let mut elements = vec![Element::ZERO; self.surface.triangles.len()];
        let mut energy = Energy::default();
        feet(self.surface, &self.place, samples, simd, |sample, foot| {
            elements[foot.triangle as usize].add(sample.weight, &foot);
            energy.add(sample, &foot);
        });
        let mut plates = Vec::with_capacity(self.surface.n_alive as usize);
        self.around.fill(0.0);
        for (&corners, &element) in self.surface.triangles.iter().zip(&elements) {
            if corners[0] == GONE {
                continue;
            }
            let n = normal(corners.map(|v| self.place[v as usize]));
            let length = dot(n, n).sqrt();
            corners.iter().for_each(|&v| self.around[v as usize] += length);
            let normal = if length > 0.0 { scale(n, 1.0 / length) } else { [0.0; 3] };
            plates.push(Plate { corners, normal, element });
        }
        (plates, energy)
    }

    /// The error of the samples.
    fn energy(&self, samples: &mut Vec<Sample>, simd: Simd) -> Energy {
        let mut energy = Energy::default();
        feet(self.surface, &self.place, samples, simd, |sample, foot| energy.add(sample, &foot));
        energy
    }

    /// Brings what has moved back into the surface; how many vertices those are.
    fn write_back(&mut self, simd: Simd) -> u64 {
        self.carry_channels(simd);
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

    /// Gives the vertices that move the channels of the place that they move to; those on seams keep theirs.
    fn carry_channels(&mut self, simd: Simd) {
        let n = self.surface.n_channels;
        if n == 0 {
            return;
        }
        let mut channels = self.surface.channels.clone();
        let mut faces = std::mem::take(&mut self.faces);
        for v in (0..self.place.len()).filter(|&v| self.place[v] != self.before[v]) {
            let surface = &*self.surface;
            if surface.wedges.as_ref().is_some_and(|wedges| wedges.is_seam(v as u32)) {
                continue;
            }
            let point = sub(self.place[v], self.before[v]);
            let near = nearest_around(surface, &self.before, v as u32, point, simd, &mut faces);
            let Some((t, weights)) = near else { continue };
            let triangle = surface.triangles[t as usize];
            let own = surface.values_at(t, v as u32);
            // Relative to its own values, so that what is the same everywhere stays so exactly: labels do.
            for (w, weight) in triangle.into_iter().zip(weights).filter(|&(w, _)| w != v as u32) {
                let values = surface.values_at(t, w);
                for (k, channel) in channels[v * n..][..n].iter_mut().enumerate() {
                    *channel += weight * (values[k] - own[k]);
                }
            }
        }
        self.surface.channels = channels;
        if let Some(mut wedges) = self.surface.wedges.take() {
            for v in (0..self.place.len()).filter(|&v| self.place[v] != self.before[v]) {
                wedges.set_single(self.surface, v as u32);
            }
            self.surface.wedges = Some(wedges);
        }
    }
}
