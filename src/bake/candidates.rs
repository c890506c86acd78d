//! Triangles of the original that may be nearest to a point, with bounds of their distances.
//!
//! A bound takes nine products, a distance many times as many. Uses neither cells nor trees.

use stonecut_measure::triangle::{self, Inside, Vector};
use stonecut_measure::wide::{self, WideJob};
use stonecut_mesh::vec3::{cross, dot, length_sq, sub};

/// Bounds of distances count up to this share of the lengths that they come from.
pub(super) const SLACK: f64 = 1e-9;

/// A triangle of the original that may be nearest to a point of a patch, with what bounds its distance.
#[derive(Clone, Copy, Debug)]
pub(super) struct Candidate {
    pub cell: u32,
    pub slot: u32,
    /// Bound on the rounding of the bound.
    pub slack: f64,
    corner: Vector,
    /// Unit normal; zeros where the triangle is too thin for bounds.
    normal: Vector,
    /// Gradients of the barycentric coordinates of the second and the third corner.
    rise: [Vector; 2],
    /// Squared heights of the triangle over its three edges.
    heights_sq: [f64; 3],
}

impl Candidate {
    pub fn new((cell, slot): (u32, u32), t: &[Vector; 3]) -> Candidate {
        let (u, v) = (sub(t[1], t[0]), sub(t[2], t[0]));
        let n = cross(u, v);
        let (n_sq, longest_sq) = (length_sq(n), length_sq(u).max(length_sq(v)));
        let mut out = Candidate {
            cell,
            slot,
            slack: SLACK * longest_sq.sqrt(),
            corner: t[0],
            normal: [0.0; 3],
            rise: [[0.0; 3]; 2],
            heights_sq: [0.0; 3],
        };
        // Slivers of a thousandth of their length are measured, not bounded.
        let is_thick = n_sq > 1e-6 * longest_sq * longest_sq;
        if is_thick {
            let length = n_sq.sqrt();
            out.normal = n.map(|x| x / length);
            out.rise = [cross(v, n), cross(n, u)].map(|g| g.map(|x| x / n_sq));
            let first = [0, 1, 2].map(|k| out.rise[0][k] + out.rise[1][k]);
            out.heights_sq = [first, out.rise[0], out.rise[1]].map(|g| 1.0 / length_sq(g));
        }
        out
    }

    /// A lower bound of the squared distance from a point.
    #[inline(always)]
    pub fn bound_sq(&self, point: Vector) -> f64 {
        let from = sub(point, self.corner);
        let height = dot(self.normal, from);
        let (v, w) = (dot(self.rise[0], from), dot(self.rise[1], from));
        let mut beyond_sq = 0.0;
        for (share, height_sq) in [1.0 - v - w, v, w].into_iter().zip(self.heights_sq) {
            let out = if share < 0.0 { share * share * height_sq } else { 0.0 };
            beyond_sq = if out > beyond_sq { out } else { beyond_sq };
        }
        height * height + beyond_sq
    }
}

/// Points that are worked on at once.
pub(super) const LANES: usize = 8;

/// Up to `LANES` points and what is known of their distances from candidates.
#[derive(Default)]
pub(super) struct PointGroup {
    /// Axis by axis.
    points: [[f64; LANES]; 3],
    /// For each candidate of the list a lower bound of the squared distance of each point.
    pub bounds_sq: Vec<[f64; LANES]>,
    /// For each point the place in the list of the candidate whose bound is least.
    pub likeliest: [u32; LANES],
    /// For each candidate of the list the place of its nearest places in `inside`, once they have been found.
    places: Vec<Option<u32>>,
    inside: Vec<Inside<LANES>>,
    /// Places in the list of candidates that `open` found.
    pub opened: Vec<u32>,
}

impl PointGroup {
    /// Takes other points, with the bounds of the candidates of a list.
    pub fn begin(&mut self, candidates: &[Candidate], list: &[Near], points: &[(Vector, u32)]) {
        for (lane, (point, _)) in points.iter().enumerate() {
            (0..3).for_each(|k| self.points[k][lane] = point[k]);
        }
        self.inside.clear();
        self.places.clear();
        self.places.resize(list.len(), None);
        self.bounds_sq.clear();
        let (points, out) = (&self.points, &mut self.bounds_sq);
        self.likeliest = wide::run(AllBounds { candidates, list, points, out });
    }

    /// Finds the candidates that any of the points may be nearer to than its limit.
    pub fn open(&mut self, limits_sq: &[f64; LANES]) {
        self.opened.clear();
        wide::run(OpenBounds { bounds_sq: &self.bounds_sq, limits_sq, out: &mut self.opened });
    }

    /// The same as `triangle::closest` of a point and the candidate at `i` of the list, whose corners are given.
    pub fn closest(&mut self, i: usize, lane: usize, t: &[Vector; 3]) -> (f64, [f64; 3]) {
        let points = &self.points;
        let place = *self.places[i].get_or_insert_with(|| {
            self.inside.push(wide::run(AllInside { points, t }));
            self.inside.len() as u32 - 1
        });
        let inside = &self.inside[place as usize];
        let distance_sq = inside.distance_sq[lane];
        if distance_sq.is_nan() {
            return triangle::closest([0, 1, 2].map(|k| points[k][lane]), t);
        }
        let [v, w] = [0, 1].map(|k: usize| inside.weights[k][lane]);
        (distance_sq, [1.0 - v - w, v, w])
    }
}

/// A candidate in the list of some points.
#[derive(Clone, Copy, Debug)]
pub(super) struct Near {
    pub candidate: u32,
    /// A lower bound of its squared distance from the middle of the points.
    pub bound_sq: f64,
}

struct AllBounds<'a> {
    candidates: &'a [Candidate],
    list: &'a [Near],
    points: &'a [[f64; LANES]; 3],
    out: &'a mut Vec<[f64; LANES]>,
}

impl WideJob for AllBounds<'_> {
    type Output = [u32; LANES];

    #[inline(always)]
    fn run(self) -> [u32; LANES] {
        let [xs, ys, zs] = self.points;
        let (mut least, mut likeliest) = ([f64::INFINITY; LANES], [0u64; LANES]);
        for (i, near) in (0u64..).zip(self.list) {
            let candidate = &self.candidates[near.candidate as usize];
            let mut bounds = [0.0; LANES];
            for lane in 0..LANES {
                let bound = candidate.bound_sq([xs[lane], ys[lane], zs[lane]]);
                likeliest[lane] = if bound < least[lane] { i } else { likeliest[lane] };
                least[lane] = if bound < least[lane] { bound } else { least[lane] };
                bounds[lane] = bound;
            }
            self.out.push(bounds);
        }
        likeliest.map(|i| i as u32)
    }
}

struct OpenBounds<'a> {
    bounds_sq: &'a [[f64; LANES]],
    limits_sq: &'a [f64; LANES],
    out: &'a mut Vec<u32>,
}

impl WideJob for OpenBounds<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        for (i, bounds) in (0u32..).zip(self.bounds_sq) {
            let mut is_open = false;
            for (bound, limit) in bounds.iter().zip(self.limits_sq) {
                is_open |= bound <= limit;
            }
            if is_open {
                self.out.push(i);
            }
        }
    }
}

struct AllInside<'a> {
    points: &'a [[f64; LANES]; 3],
    t: &'a [Vector; 3],
}

impl WideJob for AllInside<'_> {
    type Output = Inside<LANES>;

    #[inline(always)]
    fn run(self) -> Inside<LANES> {
        triangle::closest_inside(self.points, self.t)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bounds_are_below_distances() {
        let triangles = [
            [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            [[0.0, 0.0, 0.0], [1.0, 0.0, 0.2], [-0.9, 0.1, 0.0]],
            [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, 1e-13, 0.0]],
        ];
        for t in &triangles {
            let candidate = Candidate::new((0, 0), t);
            for i in 0..343 {
                let at = |k: usize| k as f64 * 0.5 - 1.5 + 0.03;
                let point = [at(i % 7), at(i / 7 % 7), at(i / 49)];
                let (exact, _) = triangle::closest(point, t);
                assert!(candidate.bound_sq(point) <= exact * (1.0 + 1e-9), "{t:?} {point:?}");
            }
        }
    }
}
