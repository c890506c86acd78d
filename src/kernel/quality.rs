//! Estimates from a few probes how well a simplified surface stands for the one it came from.
//!
//! A probe is the middle of a triangle of the given surface with its normal. It follows a corner of that triangle
//! from merger to merger, and its distance to the triangles around is summed at the end. Only the
//! surroundings are searched, and the farthest probes are left out, so the sum is an estimate. Changes nothing.
//!
//! docs/algorithm.md, section 9.

use crate::surface::class::Class;
use crate::surface::{Ring, Surface};
use crate::vertex::GONE;
use stonecut_mesh::outward::{solid_volume, volume};
use stonecut_mesh::vec3::{Vec3, add, dot, length_sq, normal, scale, sub, triangle_distance_sq};

/// Each probe stands for this many triangles, within `N_PROBES`.
const TRIANGLES_PER_PROBE: usize = 512;
const N_PROBES: std::ops::RangeInclusive<usize> = 512..=4096;
/// On the way no more probes than these are looked at.
const PROBES_ON_THE_WAY: usize = 1024;
/// Mergers in a row that a probe follows; removed vertices lead nowhere.
const LONGEST_WAY: usize = 4096;
/// The farthest probe of this many is left out: what it lay on was removed, or it went astray.
const PROBES_PER_ASTRAY: usize = 512;
/// Vertices around which a probe may look for the nearest triangle: from the corners of the best one so far to
/// those of a better one.
const MAX_RINGS: usize = 32;

/// Sums over the probes of one or several runs.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default)]
pub struct Quality {
    /// Area of the given surface, in units^2.
    pub area: f64,
    /// Integral of the squared distance from it to the result, in units^4; removed components included.
    pub squared_error: f64,
    /// Area that faces against the triangle it is nearest to, in units^2.
    pub area_against: f64,
    /// Number of the result's edges that were looked at.
    pub n_edges: u64,
    /// Sum of their lengths, in units.
    pub edge_lengths: f64,
    /// Volume of the given surface and of the result, in units^3; zeros where it is open, a part of one, or bounded.
    pub volume: [f64; 2],
}

impl Quality {
    /// Adds what another part of the same mesh says.
    pub fn add(&mut self, other: &Quality) {
        self.area += other.area;
        self.squared_error += other.squared_error;
        self.area_against += other.area_against;
        self.n_edges += other.n_edges;
        self.edge_lengths += other.edge_lengths;
        self.volume = [0, 1].map(|i| self.volume[i] + other.volume[i]);
        *self = self.bounded();
    }

    /// Adds the edges of one triangle in `step`.
    fn add_edges(&mut self, surface: &Surface, step: usize) {
        for t in surface.triangles.iter().step_by(step).filter(|t| t[0] != GONE) {
            let [a, b, c] = t.map(|v| surface.vertices[v as usize].position);
            let lengths = [sub(b, a), sub(c, b), sub(a, c)].map(|edge| length_sq(edge).sqrt());
            self.edge_lengths += lengths.iter().sum::<f64>();
            self.n_edges += 3;
        }
    }

    /// The same without infinities, which cannot be written down.
    fn bounded(self) -> Quality {
        let finite = |x: f64| x.min(f64::MAX);
        Quality {
            area: finite(self.area),
            squared_error: finite(self.squared_error),
            area_against: finite(self.area_against),
            n_edges: self.n_edges,
            edge_lengths: finite(self.edge_lengths),
            volume: self.volume.map(finite),
        }
    }

    /// Mean squared distance, in units^2; 0 without area.
    pub fn mean_square(&self) -> f64 {
        if self.area > 0.0 { self.squared_error / self.area } else { 0.0 }
    }

    /// Mean edge of the result, in units; 0 without edges.
    pub fn mean_edge(&self) -> f64 {
        if self.n_edges > 0 { self.edge_lengths / self.n_edges as f64 } else { 0.0 }
    }

    /// Share of the area that faces against the result, 0 to 1.
    pub fn share_against(&self) -> f64 {
        if self.area > 0.0 { self.area_against / self.area } else { 0.0 }
    }
}

/// Estimated quality of the mesh at one number of triangles.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct QualityAt {
    /// Triangles left.
    pub triangles: u64,
    /// As estimated then.
    pub quality: Quality,
}

/// Volume of a surface that is closed and manifold and no part of another; `None` for others.
pub(crate) fn closed_volume(surface: &Surface) -> Option<f64> {
    let is_inner = |ring: &Ring| ring.class.is_none_or(|class| class == Class::Interior);
    surface.rings.iter().all(is_inner).then(|| solid_volume(corners(surface))).flatten()
}

/// Volume between the triangles of a surface.
pub(crate) fn volume_of(surface: &Surface) -> f64 {
    volume(corners(surface))
}

/// Corners of the triangles that are there.
fn corners(surface: &Surface) -> impl Iterator<Item = [Vec3; 3]> + Clone {
    let there = surface.triangles.iter().filter(|t| t[0] != GONE);
    there.map(|t| t.map(|v| surface.vertices[v as usize].position))
}

/// With fewer edges among those that were looked at, all are.
const FEWEST_EDGES: u64 = 300;

/// Triangles that a probe looks at around one vertex, at most, evenly spaced: from the best of them it walks on.
const MOST_FACES: usize = 1024;

/// A point of the given surface.
#[derive(Clone)]
struct Probe {
    at: Vec3,
    /// Twice the area it stands for times the unit normal.
    normal: Vec3,
    /// A vertex near it; `GONE` if it was removed.
    hint: u32,
}

/// Points of the given surface, 56 bytes each.
#[derive(Clone)]
pub(crate) struct Probes(Vec<Probe>);

impl Probes {
    /// Memory in bytes.
    pub(crate) fn bytes(&self) -> u64 {
        size_of_val(self.0.as_slice()) as u64
    }

    /// Takes evenly spaced triangles of a surface.
    pub(crate) fn take(surface: &Surface) -> Probes {
        let n = surface.triangles.len();
        let wanted = (n / TRIANGLES_PER_PROBE).clamp(*N_PROBES.start(), *N_PROBES.end());
        let step = n.div_ceil(wanted).max(1);
        let some = surface.triangles.iter().step_by(step).filter(|t| t[0] != GONE);
        let probes = some.map(|t| {
            let corners = t.map(|v| surface.vertices[v as usize].position);
            let sum = add(add(corners[0], corners[1]), corners[2]);
            let normal = scale(normal(corners), step as f64);
            // Around a hub there is too much to search.
            let hint = t.iter().copied().min_by_key(|&v| surface.rings[v as usize].len);
            Probe { at: scale(sum, 1.0 / 3.0), normal, hint: hint.unwrap_or(t[0]) }
        });
        Probes(probes.collect())
    }

    /// Follows every hint to the vertex that its own has been merged into.
    pub(crate) fn follow(&mut self, rings: &[Ring]) {
        for probe in &mut self.0 {
            for _ in 0..LONGEST_WAY {
                match rings.get(probe.hint as usize) {
                    Some(ring) if ring.class.is_none() => probe.hint = ring.start,
                    _ => break,
                }
            }
            let is_used = |ring: &Ring| ring.class.is_some() && ring.len > 0;
            if !rings.get(probe.hint as usize).is_some_and(is_used) {
                probe.hint = GONE;
            }
        }
    }

    /// Takes over new numbers of the vertices; `place` is `GONE` for those that are gone.
    pub(crate) fn renumber(&mut self, place: &[u32]) {
        for probe in &mut self.0 {
            probe.hint = place.get(probe.hint as usize).copied().unwrap_or(GONE);
        }
    }

    /// One probe in a few is enough on the way. In small meshes it is each one, so that a run which goes farther has
    /// seen what one that ends here sees, and judges no better.
    pub(crate) fn step_on_the_way(&self) -> usize {
        self.0.len().div_ceil(PROBES_ON_THE_WAY).max(1)
    }

    /// Sums up how far the probes are from the surface, of every `step`-th; `removed_error` is that of removed components.
    pub(crate) fn sum_up(&mut self, surface: &Surface, removed_error: f64, step: usize) -> Quality {
        self.follow(&surface.rings);
        let mut quality = Quality::default();
        let mut found: Vec<(f64, f64)> = Vec::with_capacity(self.0.len());
        for probe in self.0.iter().step_by(step) {
            let area = 0.5 * length_sq(probe.normal).sqrt() * step as f64;
            quality.area += area;
            if let Some((distance_sq, normal)) = nearest(surface, probe) {
                found.push((distance_sq, area));
                if dot(normal, probe.normal) < 0.0 {
                    quality.area_against += area;
                }
            }
        }
        found.sort_by(|a, b| b.0.total_cmp(&a.0));
        let astray = found.len() / PROBES_PER_ASTRAY;
        let sum: f64 =
            found.iter().skip(astray).map(|(distance_sq, area)| distance_sq * area).sum();
        quality.squared_error = sum + removed_error;
        let step = surface.triangles.len().div_ceil(*N_PROBES.end()).max(1);
        quality.add_edges(surface, step);
        // Where nearly everything is gone, what is left hides between the steps.
        if step > 1 && quality.n_edges < FEWEST_EDGES {
            (quality.edge_lengths, quality.n_edges) = (0.0, 0);
            quality.add_edges(surface, 1);
        }
        quality.bounded()
    }
}

/// Squared distance to the nearest triangle around the hint, and its normal; `None` if the hint is gone.
fn nearest(surface: &Surface, probe: &Probe) -> Option<(f64, Vec3)> {
    if probe.hint == GONE {
        return None;
    }
    let place = |v: u32| surface.vertices[v as usize].position;
    let mut best = (f64::INFINITY, [0.0; 3]);
    let (mut seen, mut next) = (Vec::new(), vec![probe.hint]);
    while let (Some(v), true) = (next.pop(), seen.len() < MAX_RINGS) {
        if seen.contains(&v) {
            continue;
        }
        seen.push(v);
        let ring = surface.ring(v);
        let step = ring.len().div_ceil(MOST_FACES).max(1);
        for &t in ring.iter().step_by(step) {
            let t = surface.triangles[t as usize];
            // Long rings keep what is gone.
            if t[0] == GONE {
                continue;
            }
            let corners = t.map(place);
            let distance_sq = triangle_distance_sq(probe.at, corners);
            if distance_sq < best.0 {
                best = (distance_sq, normal(corners));
                next = t.to_vec();
            }
        }
    }
    (best.0 < f64::INFINITY).then_some(best)
}
