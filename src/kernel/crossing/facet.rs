//! Triangles with their planes: whether two meet where they should not, most of the time from a few products.
//!
//! A sign that rounding could turn is unknown; what is unknown is decided exactly (`mesh::meeting`).

use stonecut_mesh::meeting::{self, Meeting};
use stonecut_mesh::vec3::{Vec3, cross, dot, sub};

/// Bounds the rounding of a height over a plane, as a share of the product of the lengths that it is made of: ten times what
/// the sums can lose.
const ROUNDING: f64 = 32.0 * f64::EPSILON;

/// A triangle and its plane.
#[derive(Clone, Copy, Debug)]
pub(super) struct Facet {
    pub(super) ids: [u32; 3],
    pub(super) corners: [Vec3; 3],
    /// Not of length 1.
    pub(super) normal: Vec3,
    /// Most that a height may be off for a point at a distance of 1, in the sum of coordinates.
    rounding: f64,
}

/// The sum of the sizes of coordinates.
fn size(v: Vec3) -> f64 {
    v[0].abs() + v[1].abs() + v[2].abs()
}

impl Facet {
    pub(super) fn new(ids: [u32; 3], corners: [Vec3; 3]) -> Facet {
        let (b, c) = (sub(corners[1], corners[0]), sub(corners[2], corners[0]));
        Facet { ids, corners, normal: cross(b, c), rounding: ROUNDING * size(b) * size(c) }
    }

    /// The side of the plane that a point is on: 1 or -1, and 0 where that is not certain.
    #[inline(always)]
    fn side(&self, point: Vec3) -> i32 {
        let off = sub(point, self.corners[0]);
        let height = dot(self.normal, off);
        match height.abs() > self.rounding * size(off) {
            true if height > 0.0 => 1,
            true => -1,
            false => 0,
        }
    }

    /// Returns whether all corners of another triangle that are not common to both are for certain on one side.
    #[inline(always)]
    fn parts(&self, other: &Facet) -> bool {
        let mut seen = 0;
        for (&v, &corner) in other.ids.iter().zip(&other.corners) {
            if self.ids.contains(&v) {
                continue;
            }
            let side = self.side(corner);
            if side == 0 || side + seen == 0 {
                return false;
            }
            seen = side;
        }
        seen != 0
    }

    /// Returns whether two triangles have more in common than corners and edges; those without area have nothing.
    #[inline(always)]
    pub(super) fn meets(&self, other: &Facet) -> bool {
        !self.parts(other)
            && !other.parts(self)
            && !self.is_beside(other)
            && self.meets_exactly(other)
    }

    /// Returns whether an edge of one parts the two for certain, as they are seen along an axis: triangles of one plane, as in a
    /// filling, are beside each other so.
    #[inline(never)]
    fn is_beside(&self, other: &Facet) -> bool {
        let n = self.normal.map(f64::abs);
        let (x, y) = if n[0] > n[1] && n[0] > n[2] {
            (1, 2)
        } else if n[1] > n[2] {
            (2, 0)
        } else {
            (0, 1)
        };
        // 1 or -1 for the sense of three points, 0 where it is not certain (Shewchuk 1997, section 4.4).
        let turn = |a: Vec3, b: Vec3, c: Vec3| {
            let left = (b[x] - a[x]) * (c[y] - a[y]);
            let right = (b[y] - a[y]) * (c[x] - a[x]);
            let is_certain = (left - right).abs() > 4.0 * f64::EPSILON * (left.abs() + right.abs());
            if is_certain { (left - right).signum() } else { 0.0 }
        };
        let parts = |own: &Facet, other: &Facet, i: usize| {
            let (j, k) = ((i + 1) % 3, (i + 2) % 3);
            let [a, b, c] = [i, j, k].map(|i| own.corners[i]);
            let inner = turn(a, b, c);
            let mut corners = other.ids.iter().zip(&other.corners);
            let is_end = |v: u32| v == own.ids[i] || v == own.ids[j];
            inner != 0.0 && corners.all(|(&v, &p)| is_end(v) || turn(a, b, p) == -inner)
        };
        (0..3).any(|i| parts(self, other, i) || parts(other, self, i))
    }

    #[inline(never)]
    fn meets_exactly(&self, other: &Facet) -> bool {
        !meeting::is_flat(&self.corners)
            && !meeting::is_flat(&other.corners)
            && meeting::meet(&self.corners, &other.corners) != Meeting::None
    }
}

/// Returns whether triangles around one corner, the first of each, lie over a plane one beside the other: then no two of them
/// meet elsewhere.
pub(super) fn is_graph(facets: &[Facet]) -> bool {
    let Some(first) = facets.first() else { return true };
    let mut mean = [0.0; 3];
    for facet in facets {
        let length = dot(facet.normal, facet.normal).sqrt();
        if length <= facet.rounding {
            return false;
        }
        mean = [0, 1, 2].map(|k| mean[k] + facet.normal[k] / length);
    }
    // A direction within the first triangle; seen along the mean it may lie in no other one.
    let centre = first.corners[0];
    let ray = [0, 1, 2].map(|k| 0.5 * (first.corners[1][k] + first.corners[2][k]) - centre[k]);
    let mut n_over_ray = 0;
    for facet in facets {
        let (b, c) = (sub(facet.corners[1], centre), sub(facet.corners[2], centre));
        let least = facet.rounding * size(mean);
        if dot(facet.normal, mean) <= least {
            return false;
        }
        let turn = |from: Vec3, to: Vec3| dot(cross(from, to), mean);
        let slack = |v: Vec3| ROUNDING * size(v) * size(ray) * size(mean);
        let (before, after) = (turn(b, ray), turn(ray, c));
        if before.abs() <= slack(b) || after.abs() <= slack(c) {
            return false;
        }
        n_over_ray += usize::from(before > 0.0 && after > 0.0);
    }
    n_over_ray == 1
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Triangles around the origin over a regular polygon that winds `turns` times, at this height.
    fn fan(n: usize, turns: f64, height: f64) -> Vec<Facet> {
        let at = |i: usize| {
            let angle = std::f64::consts::TAU * turns * i as f64 / n as f64;
            [angle.cos(), angle.sin(), height]
        };
        (0..n)
            .map(|i| {
                let next = (i + 1) % n;
                Facet::new([0, 1 + i as u32, 1 + next as u32], [[0.0; 3], at(i), at(next)])
            })
            .collect()
    }

    #[test]
    fn only_a_fan_that_winds_once_is_a_graph() {
        assert!(is_graph(&fan(6, 1.0, 0.3)));
        assert!(is_graph(&fan(6, 1.0, -2.0)));
        assert!(!is_graph(&fan(9, 2.0, 0.3)));
        let mut folded = fan(6, 1.0, 0.1);
        folded[2] = Facet::new([0, 3, 4], [[0.0; 3], folded[2].corners[2], folded[2].corners[1]]);
        assert!(!is_graph(&folded));
    }

    #[test]
    fn quick_looks_say_what_the_exact_one_says() {
        let mut state = 3u64;
        let mut next = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            // Few values, so that corners, edges and planes are common at times.
            ((state >> 40) % 4) as f64
        };
        let mut n_meet = 0;
        for _ in 0..20_000 {
            let places: Vec<Vec3> = (0..5).map(|_| [next(), next(), next()]).collect();
            let corners = |ids: [usize; 3]| ids.map(|i| places[i]);
            for (a, b) in [([0, 1, 2], [0, 3, 4]), ([0, 1, 2], [0, 2, 3]), ([0, 1, 2], [3, 4, 1])] {
                let ids = |own: [usize; 3]| own.map(|i| i as u32);
                let (one, other) = (Facet::new(ids(a), corners(a)), Facet::new(ids(b), corners(b)));
                let exact = one.meets_exactly(&other);
                n_meet += u32::from(exact);
                assert_eq!(one.meets(&other), exact, "{one:?} {other:?}");
            }
        }
        assert!(n_meet > 1000);
    }
}
