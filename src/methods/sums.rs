//! Sums over the triangles at a cell, of a grid or of the surface, and the point of the cell that fits them best.
//!
//! Everything is in units of cells, relative to the centre of the cell, so that no constant depends on the input's units.

use stonecut_mesh::eigen::eigen;
use stonecut_mesh::vec3::{Vec3, add, cross, dot, length_sq, scale, sub};

/// Singular values below this share of the largest one count as 0: across them the point stays at the mean
/// (Lindstrom 2000, section 3.2). 0.02 costs 13 % of error on a noisy scan (docs/design/methods.md).
pub(super) const LEAST_SINGULAR: f64 = 0.001;

/// Farthest that the point lies from the centre of its cell along an axis: half a cell beyond the walls. At the walls
/// themselves (0.5) the error is 2 to 4 % higher, and a whole cell beyond them gains nothing.
const FARTHEST: f64 = 1.0;

/// Weight of the line along an open boundary against the planes of triangles.
const BOUNDARY_WEIGHT: f64 = 1.0;

/// Squared length of a chord below which a cell has no open boundary: sums of cancelled edges are rounding.
const LEAST_CHORD_SQ: f64 = 1e-8;

/// Sums over the triangles that have a corner in a cell.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct CellSums {
    /// Upper triangle of the sum of `w n n^T`, by rows; `w` is twice the area, `n` the unit normal.
    a: [f64; 6],
    /// Sum of `w n (n . p)` for a point `p` of the triangle.
    b: Vec3,
    /// Sum of corners in the cell, and their number.
    corners: Vec3,
    n_corners: f64,
    /// Sum of directed edges `q - p`, and of `p x q`: within a closed, oriented surface they cancel (Lindstrom & Silva
    /// 2001).
    chord: Vec3,
    moment: Vec3,
}

/// A triangle on its way into the sums.
#[derive(Clone, Copy)]
pub(super) struct Term {
    places: [Vec3; 3],
    normal: Vec3,
    a: [f64; 6],
    inverse: f64,
}

impl Term {
    #[inline(always)]
    pub(super) fn new(places: [Vec3; 3]) -> Term {
        let normal = cross(sub(places[1], places[0]), sub(places[2], places[0]));
        let length = length_sq(normal).sqrt();
        let inverse = if length > 0.0 { 1.0 / length } else { 0.0 };
        let [x, y, z] = normal;
        let s = scale(normal, inverse);
        let a = [s[0] * x, s[0] * y, s[0] * z, s[1] * y, s[1] * z, s[2] * z];
        Term { places, normal, a, inverse }
    }
}

impl CellSums {
    /// Adds a triangle all of whose corners lie in the cell: once for each corner.
    #[inline(always)]
    pub(super) fn add_whole(&mut self, term: &Term, centre: Vec3) {
        let [p, q, r] = term.places.map(|place| sub(place, centre));
        for (sum, x) in self.a.iter_mut().zip(term.a) {
            *sum += 3.0 * x;
        }
        let height = 3.0 * dot(term.normal, p) * term.inverse;
        self.b = add(self.b, scale(term.normal, height));
        self.corners = add(self.corners, add(p, add(q, r)));
        self.n_corners += 3.0;
        // The chord of a closed loop is nothing, its moment twice the area.
        self.moment = add(self.moment, scale(term.normal, 2.0));
    }

    /// Adds a triangle for those of its corners that lie in the cell.
    #[inline(always)]
    pub(super) fn add_part(&mut self, term: &Term, centre: Vec3, inside: [bool; 3]) {
        let corners = term.places.map(|place| sub(place, centre));
        let count = inside.iter().filter(|&&is| is).count() as f64;
        for (sum, x) in self.a.iter_mut().zip(term.a) {
            *sum += count * x;
        }
        let height = count * dot(term.normal, corners[0]) * term.inverse;
        self.b = add(self.b, scale(term.normal, height));
        self.n_corners += count;
        for k in 0..3 {
            let next = (k + 1) % 3;
            if inside[k] {
                self.corners = add(self.corners, corners[k]);
            }
            let times = f64::from(u8::from(inside[k]) + u8::from(inside[next]));
            self.chord = add(self.chord, scale(sub(corners[next], corners[k]), times));
            self.moment = add(self.moment, scale(cross(corners[k], corners[next]), times));
        }
    }

    /// Adds the sums of further triangles.
    pub(super) fn merge(&mut self, other: &CellSums) {
        for (sum, x) in self.a.iter_mut().zip(other.a) {
            *sum += x;
        }
        self.b = add(self.b, other.b);
        self.corners = add(self.corners, other.corners);
        self.n_corners += other.n_corners;
        self.chord = add(self.chord, other.chord);
        self.moment = add(self.moment, other.moment);
    }

    /// The point with the least quadric error, relative to the centre of the cell, each coordinate within `FARTHEST`.
    ///
    /// From the mean of the corners straight towards the least error, as far as that bound allows: the error is convex, so
    /// it falls all the way. Singular values below the share `least_singular` of the largest count as 0.
    pub(super) fn point(&self, least_singular: f64) -> Vec3 {
        let mean = scale(self.corners, 1.0 / self.n_corners.max(1.0)).map(|x| x.clamp(-0.5, 0.5));
        let (mut a, mut b) = (self.a, self.b);
        let chord_sq = length_sq(self.chord);
        if chord_sq > LEAST_CHORD_SQ {
            // |x cross chord - moment|^2: squared distance from the line times the squared length of the chord.
            let [x, y, z] = self.chord;
            let line =
                [chord_sq - x * x, -x * y, -x * z, chord_sq - y * y, -y * z, chord_sq - z * z];
            for (sum, value) in a.iter_mut().zip(line) {
                *sum += BOUNDARY_WEIGHT * value;
            }
            b = add(b, scale(cross(self.chord, self.moment), BOUNDARY_WEIGHT));
        }
        let (values, vectors) = eigen(a);
        let most = values.iter().fold(0.0f64, |most, x| most.max(x.abs()));
        let [xx, xy, xz, yy, yz, zz] = a;
        let product = [
            xx * mean[0] + xy * mean[1] + xz * mean[2],
            xy * mean[0] + yy * mean[1] + yz * mean[2],
            xz * mean[0] + yz * mean[1] + zz * mean[2],
        ];
        let residual = sub(b, product);
        let mut step = [0.0; 3];
        for (value, vector) in values.into_iter().zip(vectors) {
            if value > least_singular * most {
                step = add(step, scale(vector, dot(vector, residual) / value));
            }
        }
        let mut share = 1.0f64;
        for axis in 0..3 {
            let room =
                if step[axis] > 0.0 { FARTHEST - mean[axis] } else { -FARTHEST - mean[axis] };
            if step[axis].abs() > room.abs() {
                share = share.min(room / step[axis]);
            }
        }
        let point = add(mean, scale(step, share));
        if point.iter().all(|x| x.is_finite()) { point } else { mean }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sums(triangles: &[[Vec3; 3]]) -> CellSums {
        let mut sums = CellSums::default();
        for &triangle in triangles {
            sums.add_part(&Term::new(triangle), [0.0; 3], [true, false, false]);
        }
        sums
    }

    #[test]
    fn a_corner_is_found_and_a_plane_leaves_the_mean() {
        let corner = [0.2, -0.1, 0.3];
        let arms = [[0.3, 0.0, 0.0], [0.0, 0.3, 0.0], [0.0, 0.0, 0.3]];
        // Triangles of three walls, none of which touches the corner itself.
        let walls = [(0, 1), (1, 2), (2, 0)].map(|(i, j)| {
            let at = |s: f64, t: f64| add(corner, add(scale(arms[i], s), scale(arms[j], t)));
            [at(0.2, 0.2), at(0.9, 0.3), at(0.3, 0.8)]
        });
        let mut of_walls = CellSums::default();
        walls.iter().for_each(|&w| of_walls.add_whole(&Term::new(w), [0.0; 3]));
        let found = of_walls.point(LEAST_SINGULAR);
        assert!(length_sq(sub(found, corner)) < 1e-6, "{found:?}");
        let flat = sums(&[[[0.1, 0.2, 0.25], [0.4, 0.2, 0.25], [0.1, 0.4, 0.25]]]);
        assert!(length_sq(sub(flat.point(LEAST_SINGULAR), [0.1, 0.2, 0.25])) < 1e-20);
    }

    #[test]
    fn the_point_stays_near_the_cell() {
        // Two nearly parallel planes that meet far outside.
        let far = sums(&[
            [[0.0, 0.0, 0.0], [0.4, 0.0, 0.04], [0.0, 0.4, 0.0]],
            [[0.0, 0.0, 0.1], [0.4, 0.0, 0.18], [0.0, 0.4, 0.1]],
        ]);
        assert!(far.point(LEAST_SINGULAR).iter().all(|x| x.abs() <= FARTHEST));
        assert_eq!(CellSums::default().point(LEAST_SINGULAR), [0.0; 3]);
        let degenerate = sums(&[[[0.3; 3]; 3]]);
        assert!(length_sq(sub(degenerate.point(LEAST_SINGULAR), [0.3; 3])) < 1e-20);
    }

    /// A strip that ends at x = 0.25: the point stays on the boundary, though the mean of corners does not.
    #[test]
    fn an_open_boundary_holds_the_point() {
        let mut sums = CellSums::default();
        let at = |i: i32, j: i32| [0.25 - 0.1 * f64::from(i), -0.4 + 0.1 * f64::from(j), 0.0];
        let inside = |p: Vec3| p.iter().all(|x| x.abs() <= 0.5);
        for (i, j) in (0..12).flat_map(|i| (-4..12).map(move |j| (i, j))) {
            for t in [
                [at(i, j), at(i, j + 1), at(i + 1, j)],
                [at(i + 1, j), at(i, j + 1), at(i + 1, j + 1)],
            ] {
                sums.add_part(&Term::new(t), [0.0; 3], t.map(inside));
            }
        }
        let point = sums.point(LEAST_SINGULAR);
        assert!((point[0] - 0.25).abs() < 0.03, "{point:?}");
        let mean = sums.corners[0] / sums.n_corners;
        assert!((mean - 0.25).abs() > 0.2);
    }
}
