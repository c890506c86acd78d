//! The mesh on the way: vertices, triangles, the triangles around each vertex, and the samples on each triangle.
//!
//! Numbers of triangles and vertices never change: what a collapse frees goes to a split at once. Knows which changes are
//! legal, and makes them; `patch` judges them.

use super::patch::{Point, settle};
use super::samples::Sample;
use stonecut_mesh::Mesh;
use stonecut_mesh::bounds::Bounds;
use stonecut_mesh::steps::{HUB, count};
use stonecut_mesh::vec3::{Vec3, add, dot, length_sq, normal, scale, sub};

/// Bytes of a sample beside the sample itself.
pub(super) const SAMPLE_BYTES: u64 = 4 + 4 + 8;

/// No sample, no triangle.
pub(super) const NONE: u32 = u32::MAX;

/// Triangles at an edge that changed may not be folded beyond this cosine of their normals, unless some were before.
const FOLDED: f64 = 0.2;

/// Double area over the square of the longest edge that a changed triangle has at least, unless one had less before.
const SLIVER: f64 = 0.06;

/// Triangles that change may be as far from the nearest sample as this many times the distance between samples, and as far from the
/// plane there as this many times the error.
const SPACINGS: f64 = 2.0;
const HEIGHTS: f64 = 5.0;

/// Rounding of coordinates as a share of the diagonal: 32-bit floats, and some for the sums behind them.
const ROUNDING: f64 = 2.5e-7;

pub(super) struct Surface {
    /// Positions relative to `centre`.
    pub places: Vec<Vec3>,
    pub triangles: Vec<[u32; 3]>,
    /// Triangles around each vertex; none at hubs, whose edges are found from their other ends.
    pub around: Vec<Vec<u32>>,
    /// True for vertices of too many triangles to be walked around at every move nearby.
    pub is_hub: Vec<bool>,
    has_hubs: bool,
    /// True for vertices that stay: hubs, and those that no closed fan of triangles is around.
    pub is_fixed: Vec<bool>,
    /// Positions of samples relative to `centre`.
    pub samples: Vec<Sample>,
    /// The first sample on each triangle.
    first: Vec<u32>,
    /// The next sample on the same triangle.
    next: Vec<u32>,
    /// Squared distances of samples; infinite for those that do not count.
    pub distance_sq: Vec<f32>,
    centre: Vec3,
    /// Squared distance that is nothing but the rounding of coordinates.
    pub floor_sq: f64,
    /// Triangles that change may be this far from the nearest sample, squared, and this far from its plane.
    pub spacing_sq: f64,
    pub height_sq: f64,
}

/// The place that positions are relative to while a mesh is optimised.
pub(super) fn centre(mesh: &Mesh) -> Vec3 {
    Bounds::of(mesh).or_origin().middle()
}

impl Surface {
    pub fn new(mesh: &Mesh, samples: Vec<Sample>) -> Surface {
        let centre = centre(mesh);
        let rounding = ROUNDING * Bounds::of(mesh).diagonal();
        let triangles = mesh.triangles.clone();
        let mut around = vec![Vec::new(); mesh.positions.len()];
        for (t, corners) in triangles.iter().enumerate() {
            for &v in corners {
                around[v as usize].push(t as u32);
            }
        }
        let is_hub: Vec<bool> = around.iter().map(|list| list.len() > HUB).collect();
        around.iter_mut().filter(|list| list.len() > HUB).for_each(|list| *list = Vec::new());
        let n = samples.len();
        let mut surface = Surface {
            has_hubs: is_hub.contains(&true),
            is_hub,
            places: mesh.positions.iter().map(|&p| sub(p, centre)).collect(),
            first: vec![NONE; triangles.len()],
            next: vec![NONE; n],
            distance_sq: vec![f32::INFINITY; n],
            is_fixed: Vec::new(),
            triangles,
            around,
            samples,
            centre,
            floor_sq: rounding * rounding,
            spacing_sq: f64::INFINITY,
            height_sq: f64::INFINITY,
        };
        surface.is_fixed = (0..surface.places.len()).map(|v| !surface.is_fan(v as u32)).collect();
        surface
    }

    /// Puts the result into the mesh that it was made from.
    pub fn give_back(self, mesh: &mut Mesh) {
        let centre = self.centre;
        for (position, &place) in mesh.positions.iter_mut().zip(&self.places) {
            // What stayed keeps its bits.
            if place != sub(*position, centre) {
                *position = add(place, centre);
            }
        }
        mesh.triangles = self.triangles;
        mesh.relief.clear();
    }

    pub fn corners(&self, t: u32) -> [Vec3; 3] {
        self.triangles[t as usize].map(|v| self.places[v as usize])
    }

    /// Triangles among which are all that have both vertices, of which one at most is a hub.
    fn around_either(&self, a: u32, b: u32) -> &[u32] {
        let list = &self.around[if self.is_hub[a as usize] { b } else { a } as usize];
        count(list.len());
        list
    }

    /// The triangle on the left of the edge from `a` to `b`, if there is exactly one.
    pub fn left_of(&self, a: u32, b: u32) -> Option<u32> {
        let mut found = None;
        for &t in self.around_either(a, b) {
            let is_left = is_edge(self.triangles[t as usize], a, b);
            if is_left && found.replace(t).is_some() {
                return None;
            }
        }
        found
    }

    /// True if an edge between two vertices is there, or may be, between hubs.
    pub fn has_edge(&self, a: u32, b: u32) -> bool {
        (self.is_hub[a as usize] && self.is_hub[b as usize])
            || self.around_either(a, b).iter().any(|&t| {
                let triangle = self.triangles[t as usize];
                triangle.contains(&a) && triangle.contains(&b)
            })
    }

    /// True if a vertex has at least as many triangles.
    pub fn has_around(&self, v: u32, least: usize) -> bool {
        self.is_hub[v as usize] || self.around[v as usize].len() >= least
    }

    /// The triangles on both sides of the edge from `a` to `b`, left one first, if these are all.
    pub fn sides(&self, a: u32, b: u32) -> Option<[u32; 2]> {
        let sides = [self.left_of(a, b)?, self.left_of(b, a)?];
        let at_edge = |&&t: &&u32| {
            let triangle = self.triangles[t as usize];
            triangle.contains(&a) && triangle.contains(&b)
        };
        (self.around_either(a, b).iter().filter(at_edge).count() == 2).then_some(sides)
    }

    /// True if the triangles around a vertex are one closed fan.
    fn is_fan(&self, v: u32) -> bool {
        let around = &self.around[v as usize];
        let Some(&start) = around.first() else { return false };
        let (mut at, mut n) = (start, 0);
        loop {
            let [_, b, c] = turned(self.triangles[at as usize], v);
            if b == c || self.sides(v, c).is_none() {
                return false;
            }
            let Some(next) = self.left_of(v, c) else { return false };
            n += 1;
            if next == start {
                return n == around.len() && n >= 3;
            }
            if n > around.len() {
                return false;
            }
            at = next;
        }
    }

    /// Vertices that share an edge with `v`, each once, in the order of the triangles around it.
    pub fn neighbours(&self, v: u32) -> Vec<u32> {
        let mut out = Vec::with_capacity(8);
        for &t in &self.around[v as usize] {
            for w in self.triangles[t as usize] {
                if w != v && !out.contains(&w) {
                    out.push(w);
                }
            }
        }
        out
    }

    /// Edges between two triangles, from the lower to the higher vertex, in the order of these; without those between hubs.
    pub fn inner_edges(&self) -> Vec<[u32; 2]> {
        let mut out = Vec::with_capacity(self.triangles.len() * 3 / 2);
        for a in 0..self.places.len() as u32 {
            let first = out.len();
            for &t in &self.around[a as usize] {
                let [_, b, c] = turned(self.triangles[t as usize], a);
                if b > a && self.sides(a, b).is_some() {
                    out.push([a, b]);
                }
                // Edges that begin at a hub.
                if self.is_hub[c as usize] && c < a && self.sides(c, a).is_some() {
                    out.push([c, a]);
                }
            }
            out[first..].sort_unstable();
        }
        if self.has_hubs {
            out.sort_unstable();
        }
        out
    }

    /// Samples on some triangles, and for each the place of its triangle among them.
    pub fn on(&self, triangles: &[u32]) -> (Vec<u32>, Vec<u32>) {
        let (mut out, mut hints) = (Vec::new(), Vec::new());
        for (number, &t) in (0..).zip(triangles) {
            let mut at = self.first[t as usize];
            while at != NONE {
                out.push(at);
                hints.push(number);
                at = self.next[at as usize];
            }
        }
        (out, hints)
    }

    /// Places and weights of samples.
    pub fn points(&self, samples: &[u32]) -> Vec<Point> {
        let point = |&s: &u32| {
            let sample = self.samples[s as usize];
            Point { at: sample.at(), weight: sample.weight() }
        };
        samples.iter().map(point).collect()
    }

    /// True if triangles are no farther from some samples than those that they replace, or than samples and errors are
    /// apart: what is good for the samples can be far from all of them.
    pub fn stays_near(&self, samples: &[u32], new: &[Facing], replaced: &[u32]) -> bool {
        let farthest = |all: &mut dyn Iterator<Item = [Vec3; 3]>| {
            all.flat_map(probes).fold([0.0f64; 2], |most, probe| {
                let found = self.distance_from(samples, probe);
                [most[0].max(found[0]), most[1].max(found[1])]
            })
        };
        let is = farthest(&mut new.iter().map(|facing| facing.corners));
        if is[0] <= self.spacing_sq && is[1] <= self.height_sq {
            return true;
        }
        let was = farthest(&mut replaced.iter().map(|&t| self.corners(t)));
        is[0] <= was[0].max(self.spacing_sq) && is[1] <= was[1].max(self.height_sq)
    }

    /// Squared distances of a place from the nearest of some samples, and from the plane there.
    fn distance_from(&self, samples: &[u32], place: Vec3) -> [f64; 2] {
        let mut best = (f64::INFINITY, 0.0);
        for &s in samples {
            let sample = &self.samples[s as usize];
            let off = sub(place, sample.at());
            let distance_sq = length_sq(off);
            if distance_sq < best.0 {
                best = (distance_sq, dot(sample.normal(), off));
            }
        }
        [best.0, best.1 * best.1]
    }

    /// Squared distances of some samples, summed up.
    pub fn energy(&self, samples: &[u32]) -> f64 {
        samples.iter().map(|&s| self.term(s as usize)).sum()
    }

    fn term(&self, s: usize) -> f64 {
        self.samples[s].weight() * f64::from(self.distance_sq[s])
    }

    /// Weights of some samples, summed up.
    pub fn weight(&self, samples: &[u32]) -> f64 {
        samples.iter().map(|&s| self.samples[s as usize].weight()).sum()
    }

    /// Energy and weight of all samples that count.
    fn sums(&self) -> [f64; 2] {
        let all = (0..self.samples.len()).filter(|&s| self.distance_sq[s].is_finite());
        all.fold([0.0; 2], |[e, w], s| [e + self.term(s), w + self.samples[s].weight()])
    }

    pub fn n_assigned(&self) -> usize {
        self.distance_sq.iter().filter(|d| d.is_finite()).count()
    }

    pub fn rms(&self) -> f64 {
        let [energy, weight] = self.sums();
        if weight > 0.0 { (energy / weight).sqrt() } else { 0.0 }
    }

    /// Takes the distances that triangles may have from samples from those that samples have now.
    pub fn set_limits(&mut self) {
        let area: f64 = (0..self.triangles.len() as u32)
            .map(|t| 0.5 * length_sq(normal(self.corners(t))).sqrt())
            .sum();
        self.spacing_sq = SPACINGS * SPACINGS * area / self.n_assigned().max(1) as f64;
        self.height_sq = (HEIGHTS * self.rms()).powi(2);
    }

    /// The spring with which all edges have this share of the energy of all samples.
    pub fn spring(&self, share: f64) -> f64 {
        let [energy, _] = self.sums();
        let squares = |t: u32| {
            let [a, b, c] = self.corners(t);
            length_sq(sub(b, a)) + length_sq(sub(c, b)) + length_sq(sub(a, c))
        };
        let lengths: f64 = (0..self.triangles.len() as u32).map(squares).sum::<f64>() / 2.0;
        if lengths > 0.0 { share * energy / lengths } else { 0.0 }
    }

    /// Takes all samples off all triangles.
    pub fn clear(&mut self) {
        self.first.fill(NONE);
    }

    /// Takes all samples off some triangles.
    pub fn take_off(&mut self, triangles: &[u32]) {
        for &t in triangles {
            self.first[t as usize] = NONE;
        }
    }

    /// Puts samples, which lie on no triangle, on the nearest of some triangles that have these corners now.
    pub fn lay(
        &mut self,
        (samples, points): (&[u32], &[Point]),
        triangles: &[u32],
        corners: &[[u32; 3]],
    ) {
        let facets: Vec<[Vec3; 3]> =
            corners.iter().map(|corners| corners.map(|v| self.places[v as usize])).collect();
        for (&s, lying) in samples.iter().zip(&settle(points, &[], &facets).lying) {
            self.put_on(s, triangles[lying.facet as usize], lying.distance_sq as f32);
        }
    }

    /// Puts a sample on a triangle.
    pub fn put_on(&mut self, sample: u32, triangle: u32, distance_sq: f32) {
        self.next[sample as usize] = self.first[triangle as usize];
        self.first[triangle as usize] = sample;
        self.distance_sq[sample as usize] = distance_sq;
    }

    /// Gives triangle `t` other corners.
    pub fn change(&mut self, t: u32, corners: [u32; 3]) {
        for v in self.triangles[t as usize] {
            self.around[v as usize].retain(|&other| other != t);
        }
        self.triangles[t as usize] = corners;
        for v in corners.into_iter().filter(|&v| !self.is_hub[v as usize]) {
            self.around[v as usize].push(t);
        }
    }

    /// True if triangles that replace others fold nothing and are not slivers, or are not worse than what they replace.
    pub fn is_sound(&self, new: &[Facing], replaced: &[u32]) -> bool {
        let limit = SLIVER.min(least(replaced.iter().map(|&t| shape(self.corners(t)))));
        if !new.iter().all(|facing| shape(facing.corners) >= limit) {
            return false;
        }
        let sharpest = least(new.iter().map(|facing| self.sharpest(facing, new, replaced)));
        if sharpest >= FOLDED {
            return true;
        }
        let old = replaced.iter().map(|&t| {
            let facing = Facing { vertices: self.triangles[t as usize], corners: self.corners(t) };
            self.sharpest(&facing, &[], &[])
        });
        sharpest >= least(old)
    }

    /// The least cosine between a triangle and those at its edges: among `new`, or of the surface but for `replaced`.
    fn sharpest(&self, facing: &Facing, new: &[Facing], replaced: &[u32]) -> f64 {
        let own = normal(facing.corners);
        let mut least = f64::INFINITY;
        for k in 0..3 {
            let (a, b) = (facing.vertices[k], facing.vertices[(k + 1) % 3]);
            let is_other = |[p, q, r]: [u32; 3]| {
                (p == b && q == a) || (q == b && r == a) || (r == b && p == a)
            };
            if let Some(other) = new.iter().find(|other| is_other(other.vertices)) {
                least = least.min(cosine(own, normal(other.corners)));
                continue;
            }
            for &t in self.around_either(b, a) {
                if is_other(self.triangles[t as usize]) && !replaced.contains(&t) {
                    least = least.min(cosine(own, normal(self.corners(t))));
                }
            }
        }
        least
    }
}

/// A triangle that is not there yet.
pub(super) struct Facing {
    pub vertices: [u32; 3],
    pub corners: [Vec3; 3],
}

fn least(values: impl Iterator<Item = f64>) -> f64 {
    values.fold(f64::INFINITY, f64::min)
}

fn cosine(a: Vec3, b: Vec3) -> f64 {
    let lengths = (length_sq(a) * length_sq(b)).sqrt();
    if lengths > 0.0 { dot(a, b) / lengths } else { 0.0 }
}

/// Places on a triangle that stand for it: its middle, corners and middles of edges.
fn probes([a, b, c]: [Vec3; 3]) -> [Vec3; 7] {
    let middle = |p: Vec3, q: Vec3| scale(add(p, q), 0.5);
    let centre = scale(add(add(a, b), c), 1.0 / 3.0);
    [centre, a, b, c, middle(a, b), middle(b, c), middle(c, a)]
}

/// Double area over the square of the longest edge.
fn shape([a, b, c]: [Vec3; 3]) -> f64 {
    let longest = length_sq(sub(b, a)).max(length_sq(sub(c, b))).max(length_sq(sub(a, c)));
    let doubled = length_sq(normal([a, b, c])).sqrt();
    if longest > 0.0 { doubled / longest } else { 0.0 }
}

/// True if a triangle has an edge from `a` to `b`.
fn is_edge([p, q, r]: [u32; 3], a: u32, b: u32) -> bool {
    (p == a && q == b) || (q == a && r == b) || (r == a && p == b)
}

/// The triangle with `v` as its first corner.
pub(super) fn turned([a, b, c]: [u32; 3], v: u32) -> [u32; 3] {
    match v {
        _ if a == v => [a, b, c],
        _ if b == v => [b, c, a],
        _ => [c, a, b],
    }
}
