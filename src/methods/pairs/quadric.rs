//! Sums of squared distances to planes, and the point where such a sum is least.
//!
//! Source: Garland & Heckbert 1997 (docs/references.md).

use stonecut_mesh::vec3::{Vec3, add, dot, scale, sub};

/// Share of the trace that pulls the best point to the middle of a pair where planes alone do not fix it.
const REGULARISATION: f64 = 1e-4;

/// `sum of w ((n . x) - d)^2` over planes.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct PairQuadric {
    /// Upper triangle of the sum of `w n n^T`, by rows.
    a: [f64; 6],
    /// Sum of `w d n`.
    b: Vec3,
    /// Sum of `w d^2`.
    c: f64,
}

impl PairQuadric {
    /// The plane through a point with a unit normal.
    pub(super) fn of_plane(point: Vec3, [x, y, z]: Vec3, weight: f64) -> PairQuadric {
        let d = dot(point, [x, y, z]);
        let a = [x * x, x * y, x * z, y * y, y * z, z * z].map(|value| weight * value);
        PairQuadric { a, b: scale([x, y, z], weight * d), c: weight * d * d }
    }

    /// Both sums together.
    pub(super) fn plus(&self, other: &PairQuadric) -> PairQuadric {
        let mut a = self.a;
        a.iter_mut().zip(other.a).for_each(|(sum, x)| *sum += x);
        PairQuadric { a, b: add(self.b, other.b), c: self.c + other.c }
    }

    /// The sum at a point; rounding below 0 is cut off.
    pub(super) fn error(&self, at: Vec3) -> f64 {
        (dot(at, self.times(at)) - 2.0 * dot(self.b, at) + self.c).max(0.0)
    }

    fn times(&self, [x, y, z]: Vec3) -> Vec3 {
        let [xx, xy, xz, yy, yz, zz] = self.a;
        [xx * x + xy * y + xz * z, xy * x + yy * y + yz * z, xz * x + yz * y + zz * z]
    }

    /// Sum of the weights, since normals have length 1.
    pub(super) fn weight(&self) -> f64 {
        self.a[0] + self.a[3] + self.a[5]
    }

    /// The point of least error near `middle`, to which a small spring pulls.
    pub(super) fn least(&self, middle: Vec3) -> Vec3 {
        let [xx, xy, xz, yy, yz, zz] = self.a;
        let spring = REGULARISATION * self.weight();
        let (xx, yy, zz) = (xx + spring, yy + spring, zz + spring);
        let pull = sub(self.b, self.times(middle));
        let minors = [yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy];
        let determinant = xx * minors[0] + xy * minors[1] + xz * minors[2];
        let step = [
            dot(minors, pull),
            dot([minors[1], xx * zz - xz * xz, xy * xz - xx * yz], pull),
            dot([minors[2], xy * xz - xx * yz, xx * yy - xy * xy], pull),
        ]
        .map(|value| value / determinant);
        // Without weights there is nothing to divide by.
        if step.iter().all(|x| x.is_finite()) { add(middle, step) } else { middle }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use stonecut_mesh::vec3::length_sq;

    #[test]
    fn three_planes_meet_in_their_corner_and_one_leaves_the_middle() {
        let corner = [1.5, -2.0, 0.25];
        let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let walls = axes.map(|axis| PairQuadric::of_plane(corner, axis, 2.0));
        let all = walls.iter().fold(PairQuadric::default(), |sum, wall| sum.plus(wall));
        let found = all.least([1.4, -2.1, 0.3]);
        assert!(length_sq(sub(found, corner)) < 1e-6, "{found:?}");
        assert!(all.error(found) < 1e-6 && (all.weight() - 6.0).abs() < 1e-12);
        let found = walls[0].least([1.0, 7.0, 8.0]);
        assert!(length_sq(sub(found, [1.5, 7.0, 8.0])) < 1e-6, "{found:?}");
        assert_eq!(PairQuadric::default().least([1.0, 2.0, 3.0]), [1.0, 2.0, 3.0]);
        assert!((walls[2].error([0.0, 0.0, 1.25]) - 2.0).abs() < 1e-12);
    }
}
