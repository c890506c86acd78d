//! Moves the vertices of a simplified mesh so that its error against the original falls.
//!
//! Each sample of the original pulls at the triangle it is nearest to, along the normal of that triangle.
//! A sweep finds the triangles, solves the normal equations of all vertices at once, and moves as far as
//! `bounds` allow. The triangles stay what they are, and vertices that are not interior stay where they are.
//! `samples` chooses the samples, `nearest` finds the triangle of each.
//!
//! Source: the vertex step of Hoppe et al. 1993, by the conjugate gradients of Hestenes & Stiefel 1952
//! (docs/references.md; docs/algorithm.md, section 8).

mod bounds;
mod nearest;
mod normal_equations;
mod relief;
pub(crate) mod samples;

use crate::crossing::{self, Change, Crossings, Look};
use crate::fit::nearest::{Foot, feet, nearest_around};
use crate::fit::samples::{Sample, Samples};
use crate::simd::Simd;
use crate::state::MeshState;
use crate::statistics::FitStatistics;
use crate::surface::class::Class;
use crate::surface::faces::Face;
use crate::surface::{MAX_VALENCE, Surface};
use crate::vertex::GONE;
use normal_equations::{Element, FaceTerm, V, solve};
use stonecut_mesh::relief::Relief;
use stonecut_mesh::vec3::{Vec3, dot, normal, scale, sub};

/// Share of the samples (one in this many) that check whether the fit lowered the error.
const CHECKED_STEP: u32 = 4;
/// Share of the samples that tell how far away the others are, roughly.
const TRIED_STEP: u32 = 16;
/// A foot is suspicious, and looked for in a wider search, beyond this many times the median squared distance (5.0 RMS of a
/// normal distribution), but at most one sample in 25.
const FAR_SQ: f32 = 55.0;
const FAR_SHARE: f64 = 0.04;

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
/// Gives back the relief of the samples over the triangles as well, in their order, if that is to be kept.
///
/// Memory: about 140 bytes a triangle of the surface (190 for the relief) and 40 a sample, those that are given included.
pub(crate) fn fit(
    state: &mut MeshState,
    mut samples: Samples,
    crossings: Option<&mut Crossings>,
    keeps_relief: bool,
    simd: Simd,
) -> (FitStatistics, Vec<Relief>) {
    let surface = &mut state.surface;
    samples.follow(&surface.rings);
    surface.vertices.shrink_to_fit();
    surface.rings.shrink_to_fit();
    surface.arena.shrink_to_fit();
    surface.triangles.shrink_to_fit();
    let mut work = Work::new(state, &samples);
    let sweeps = samples.goal.sweeps;
    // One sweep, in a round, must be cheap: the next round mends what it misses.
    let is_quick = sweeps == 1;
    if !is_quick {
        work.far_sq = work.suspicious(&samples, simd);
    }
    let mut statistics = FitStatistics { sweeps, ..FitStatistics::default() };
    let mut last = None;
    let mut change = 0.0;
    for sweep in 0..sweeps {
        let (terms, energy, checked) = work.terms(&mut samples.list, simd);
        let known = if is_quick { &energy } else { &checked };
        if sweep == 0 {
            statistics.rms_before = known.rms(work.state.surface.scale);
            statistics.samples = samples.list.len() as u64;
        }
        let steps = solve(&terms, &work.free);
        let from = if is_quick || keeps_relief { work.place.clone() } else { Vec::new() };
        work.go(&terms, steps, energy.mean(), simd);
        if is_quick {
            change = terms.iter().map(|term| term.change(&from, &work.place)).sum();
            let after = Energy { sum: (energy.sum + change).max(0.0), ..energy };
            statistics.rms_after = after.rms(work.state.surface.scale);
        }
        last = Some((terms, from)).filter(|_| keeps_relief);
    }
    if !is_quick {
        let energy = work.energy(samples.sparse(CHECKED_STEP), simd);
        statistics.rms_after = energy.rms(work.state.surface.scale);
        change = statistics.rms_after - statistics.rms_before;
    }
    // Written so that NaN is not a gain.
    if change < 0.0 {
        if let Some(crossings) = crossings {
            work.hold_apart(crossings, simd);
        }
        statistics.moved = work.write_back(simd);
    } else {
        work.place.clone_from(&work.before);
    }
    let relief = last.map(|(terms, from)| relief::relief(&terms, &from, &work.place));
    (statistics, relief.unwrap_or_default())
}

/// The surface in f32, relative to the centre of the samples.
struct Work<'a> {
    state: &'a mut MeshState,
    place: Vec<V>,
    before: Vec<V>,
    /// True if each vertex may move.
    free: Vec<bool>,
    /// Squared distance from which on a foot is suspicious.
    far_sq: f32,
    /// Double area around each vertex.
    around: Vec<f32>,
    /// Scratch space.
    faces: Vec<Face>,
}

impl<'a> Work<'a> {
    fn new(state: &'a mut MeshState, samples: &Samples) -> Self {
        let surface = &state.surface;
        let local = |position: &[f64; 3]| -> V {
            std::array::from_fn(|k| ((position[k] - samples.centre[k]) * surface.scale) as f32)
        };
        let place: Vec<V> = surface.vertices.iter().map(|v| local(&v.position)).collect();
        let is_free = |r: &crate::surface::Ring| r.class == Some(Class::Interior) && r.len > 0;
        // What lies in a plane exactly stays there.
        let in_plane =
            |v: usize| surface.flats.as_ref().is_some_and(|flats| flats.of(v as u32) != 0);
        // One sample for each triangle is too few to hold the border of a region or a chart.
        let wedges = state.wedges.as_ref().filter(|_| samples.goal.is_sparse);
        let is_held = |v: usize| wedges.is_some_and(|wedges| wedges.is_seam(v as u32));
        let free = surface.rings.iter().enumerate();
        let free = free.map(|(v, ring)| is_free(ring) && !in_plane(v) && !is_held(v)).collect();
        let around = vec![0.0; place.len()];
        Work {
            state,
            before: place.clone(),
            place,
            free,
            far_sq: f32::INFINITY,
            around,
            faces: Vec::new(),
        }
    }

    /// Squared distance from which on a foot is looked at twice, from those of a few samples.
    fn suspicious(&self, samples: &Samples, simd: Simd) -> f32 {
        let mut tried = samples.sparse(TRIED_STEP);
        let mut distances = Vec::with_capacity(tried.len());
        feet(&self.state.surface, &self.place, &mut tried, f32::INFINITY, simd, |_, foot| {
            distances.push(foot.distance_sq)
        });
        if distances.is_empty() {
            return f32::INFINITY;
        }
        distances.sort_unstable_by(f32::total_cmp);
        let at = |share: f64| distances[((distances.len() - 1) as f64 * share) as usize];
        (FAR_SQ * at(0.5)).max(at(1.0 - FAR_SHARE))
    }

    /// Returns the terms of each triangle from its samples, the error of the samples, and that of those that are checked
    /// at the end.
    fn terms(&mut self, samples: &mut Vec<Sample>, simd: Simd) -> (Vec<FaceTerm>, Energy, Energy) {
        let mut elements = vec![Element::ZERO; self.state.surface.triangles.len()];
        let (mut energy, mut checked) = (Energy::default(), Energy::default());
        let far_sq = self.far_sq;
        feet(&self.state.surface, &self.place, samples, far_sq, simd, |sample, foot| {
            elements[foot.triangle as usize].add(sample.weight, &foot);
            energy.add(sample, &foot);
            if sample.is_in(CHECKED_STEP) {
                checked.add(sample, &foot);
            }
        });
        let mut terms = Vec::with_capacity(self.state.surface.n_alive as usize);
        self.around.fill(0.0);
        for (&corners, &element) in self.state.surface.triangles.iter().zip(&elements) {
            if corners[0] == GONE {
                continue;
            }
            let n = normal(corners.map(|v| self.place[v as usize]));
            let length = dot(n, n).sqrt();
            corners.iter().for_each(|&v| self.around[v as usize] += length);
            let normal = if length > 0.0 { scale(n, 1.0 / length) } else { [0.0; 3] };
            terms.push(FaceTerm { corners, normal, element });
        }
        (terms, energy, checked)
    }

    /// The error of the samples.
    fn energy(&self, mut samples: Vec<Sample>, simd: Simd) -> Energy {
        let mut energy = Energy::default();
        feet(&self.state.surface, &self.place, &mut samples, self.far_sq, simd, |sample, foot| {
            energy.add(sample, &foot)
        });
        energy
    }

    /// Brings what has moved back into the surface; how many vertices those are.
    fn write_back(&mut self, simd: Simd) -> u64 {
        self.carry_channels(simd);
        let mut moved = 0;
        for (v, (now, before)) in self.place.iter().zip(&self.before).enumerate() {
            if self.free[v] && now != before {
                moved += 1;
                let to = moved_to(&self.state.surface, v, (before, now));
                self.state.surface.vertices[v].position = to;
            }
        }
        moved
    }

    /// Gives up the steps of vertices, one after the other, whose triangles would meet more others than they do.
    fn hold_apart(&mut self, crossings: &mut Crossings, simd: Simd) {
        let surface = &mut self.state.surface;
        let (mut b, mut c) = (Vec::new(), Vec::new());
        let mut taken = Vec::new();
        for v in 0..self.place.len() {
            if !self.free[v] || self.place[v] == self.before[v] {
                continue;
            }
            let place = moved_to(surface, v, (&self.before[v], &self.place[v]));
            crossing::around(surface, v as u32, &mut b, &mut c);
            let ids = surface.ring(v as u32);
            let (vertex, ends) = (v as u32, [v as u32; 2]);
            let change = Change { ids, ends, around: (&b, &c), vertex, place };
            let look = Look { crossings, surface, change: &change };
            if ids.len() > MAX_VALENCE as usize || !simd.run(look) {
                self.place[v] = self.before[v];
                continue;
            }
            let position = &mut surface.vertices[v].position;
            taken.push((v, std::mem::replace(position, place)));
            crossings.changed(surface, surface.ring(v as u32), &[]);
        }
        // They are made all at once, with all that rides along.
        taken.into_iter().for_each(|(v, position)| surface.vertices[v].position = position);
    }

    /// Gives the vertices that move the channels of the place that they move to; those on seams keep theirs.
    fn carry_channels(&mut self, simd: Simd) {
        let n = self.state.surface.n_channels;
        if n == 0 {
            return;
        }
        let label = self.state.labels.map(|labels| labels.channel);
        let mut channels = self.state.surface.channels.clone();
        let mut faces = std::mem::take(&mut self.faces);
        for v in (0..self.place.len()).filter(|&v| self.place[v] != self.before[v]) {
            let corners = self.state.corners();
            let surface = corners.surface;
            if corners.wedges.is_some_and(|wedges| wedges.is_seam(v as u32)) {
                continue;
            }
            let point = sub(self.place[v], self.before[v]);
            let near = nearest_around(surface, &self.before, v as u32, point, simd, &mut faces);
            let Some((t, weights)) = near else { continue };
            let triangle = surface.triangles[t as usize];
            let own = corners.values_at(t, v as u32);
            // Relative to its own values, so that what is the same everywhere stays so exactly: labels do.
            for (w, weight) in triangle.into_iter().zip(weights).filter(|&(w, _)| w != v as u32) {
                let values = corners.values_at(t, w);
                let all = channels[v * n..][..n].iter_mut().enumerate();
                for (k, channel) in all.filter(|(k, _)| Some(*k) != label) {
                    let step = weight * (values[k] - own[k]);
                    *channel += if step.is_finite() { step } else { 0.0 };
                }
            }
        }
        self.state.surface.channels = channels;
        if let Some(wedges) = &mut self.state.wedges {
            for v in (0..self.place.len()).filter(|&v| self.place[v] != self.before[v]) {
                wedges.set_single(&self.state.surface, v as u32);
            }
        }
    }
}

/// The place of a vertex after a step between two local places.
fn moved_to(surface: &Surface, v: usize, (before, now): (&V, &V)) -> Vec3 {
    let position = surface.vertices[v].position;
    let along = |k: usize| position[k] + f64::from(now[k] - before[k]) / surface.scale;
    surface.rounded([along(0), along(1), along(2)])
}
