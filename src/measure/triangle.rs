//! Exact geometry of single triangles: canonical corner order, area, normal, closest point.
//!
//! Everything here is a pure function of the three corner positions, and everything else in `measure`
//! works on triangles in canonical order; so a triangle gives the same numbers, bit for bit, wherever it
//! stands in whichever file or cell. Knows no meshes and no trees.

use stonecut_mesh::vec3::{cross, dot, length_sq, sub};

/// A position or direction in input units.
pub type Vector = [f64; 3];

/// Returns the first corner of the canonical order: the index of the lexicographically smallest corner.
///
/// Orientation is kept, so this is a rotation. Of equal corners the first counts; such a triangle is
/// degenerate, and its rotation shows in nothing but the choice between equal numbers.
#[inline]
pub fn rotation(corners: &[Vector; 3]) -> usize {
    let less = |a: &Vector, b: &Vector| (a[0], a[1], a[2]) < (b[0], b[1], b[2]);
    let mut first = 0;
    for i in 1..3 {
        if less(&corners[i], &corners[first]) {
            first = i;
        }
    }
    first
}

/// The corners in canonical order.
#[inline]
pub fn canonical(corners: [Vector; 3]) -> [Vector; 3] {
    rotate(corners, rotation(&corners))
}

/// Any three things, beginning with number `first`.
#[inline]
pub fn rotate<T: Copy>(three: [T; 3], first: usize) -> [T; 3] {
    match first {
        0 => three,
        1 => [three[1], three[2], three[0]],
        _ => [three[2], three[0], three[1]],
    }
}

/// The normal, twice as long as the area.
#[inline]
pub fn area_normal(t: &[Vector; 3]) -> Vector {
    cross(sub(t[1], t[0]), sub(t[2], t[0]))
}

/// The area in square units; 0 for a degenerate triangle.
#[inline]
pub fn area(t: &[Vector; 3]) -> f64 {
    let normal = area_normal(t);
    let twice_sq = length_sq(normal);
    if twice_sq < NEEDLE_SQ {
        return area_of_needle(normal);
    }
    0.5 * twice_sq.sqrt()
}

/// Squares below this have lost digits, or vanish, though their roots are numbers like others.
const NEEDLE_SQ: f64 = 1e-280;

/// Half the length of a normal whose square is too small for a number.
#[cold]
fn area_of_needle(normal: Vector) -> f64 {
    let largest = normal.iter().fold(0f64, |largest, x| largest.max(x.abs()));
    if largest == 0.0 {
        return 0.0;
    }
    0.5 * largest * length_sq(normal.map(|x| x / largest)).sqrt()
}

/// The point with barycentric coordinates `weights`.
#[inline]
pub fn point_at(t: &[Vector; 3], weights: [f64; 3]) -> Vector {
    // Relative to the first corner: far from the origin this keeps the digits that matter.
    let (u, v) = (sub(t[1], t[0]), sub(t[2], t[0]));
    [0, 1, 2].map(|k| t[0][k] + weights[1] * u[k] + weights[2] * v[k])
}

/// The angle between two directions in radians, 0 to pi; `None` if either has no direction.
pub fn angle(a: Vector, b: Vector) -> Option<f64> {
    // The arc tangent is accurate for small angles, where the arc cosine loses half its digits.
    let (sine, cosine) = (length_sq(cross(a, b)).sqrt(), dot(a, b));
    let known = length_sq(a) > 0.0 && length_sq(b) > 0.0;
    known.then(|| sine.atan2(cosine))
}

/// Squared distance from `point` to the triangle, and the barycentric coordinates of the nearest point.
///
/// Exact to rounding for every triangle, slivers, needles and points included.
///
/// Source: Ericson 2005, section 5.1.5 (docs/references.md), with its own treatment of slivers.
#[inline]
pub fn closest(point: Vector, t: &[Vector; 3]) -> (f64, [f64; 3]) {
    let (ab, ac, ap) = (sub(t[1], t[0]), sub(t[2], t[0]), sub(point, t[0]));
    let normal = cross(ab, ac);
    let (ab_sq, ac_sq, normal_sq) = (length_sq(ab), length_sq(ac), length_sq(normal));
    // Below a height of 1e-10 of the edges the regions are no longer told apart reliably; there the
    // three edges together are the triangle, to that height. Zeros and NaN fail the comparison too.
    let has_inside = normal_sq > 1e-20 * (ab_sq * ac_sq);
    if !has_inside {
        return closest_on_edges(point, t);
    }
    let (d1, d2) = (dot(ab, ap), dot(ac, ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return (length_sq(ap), [1.0, 0.0, 0.0]);
    }
    let bp = sub(point, t[1]);
    let (d3, d4) = (dot(ab, bp), dot(ac, bp));
    if d3 >= 0.0 && d4 <= d3 {
        return (length_sq(bp), [0.0, 1.0, 0.0]);
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        let (distance_sq, s) = closest_on_edge(point, t[0], t[1]);
        return (distance_sq, [1.0 - s, s, 0.0]);
    }
    let cp = sub(point, t[2]);
    let (d5, d6) = (dot(ab, cp), dot(ac, cp));
    if d6 >= 0.0 && d5 <= d6 {
        return (length_sq(cp), [0.0, 0.0, 1.0]);
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        let (distance_sq, s) = closest_on_edge(point, t[0], t[2]);
        return (distance_sq, [1.0 - s, 0.0, s]);
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 >= d3 && d5 >= d6 {
        let (distance_sq, s) = closest_on_edge(point, t[1], t[2]);
        return (distance_sq, [0.0, 1.0 - s, s]);
    }
    let height = dot(normal, ap);
    let scale = 1.0 / (va + vb + vc);
    let (v, w) = (vb * scale, vc * scale);
    (height * height / normal_sq, [1.0 - v - w, v, w])
}

/// Outcome of `closest` for some points, bit for bit, where the nearest point is inside the triangle.
#[derive(Clone, Copy, Debug)]
pub struct Inside<const N: usize> {
    /// Not a number for points whose nearest point is on the border.
    pub distance_sq: [f64; N],
    /// Barycentric coordinates of the second and of the third corner.
    pub weights: [[f64; N]; 2],
}

/// Finds the nearest points inside a triangle for points given axis by axis; to be inlined where registers are wide.
#[inline(always)]
pub fn closest_inside<const N: usize>(points: &[[f64; N]; 3], t: &[Vector; 3]) -> Inside<N> {
    let (ab, ac) = (sub(t[1], t[0]), sub(t[2], t[0]));
    let normal = cross(ab, ac);
    let normal_sq = length_sq(normal);
    let has_inside = normal_sq > 1e-20 * (length_sq(ab) * length_sq(ac));
    let mut out = Inside { distance_sq: [f64::NAN; N], weights: [[0.0; N]; 2] };
    if !has_inside {
        return out;
    }
    for i in 0..N {
        let point = [points[0][i], points[1][i], points[2][i]];
        let [ap, bp, cp] = [0, 1, 2].map(|k| sub(point, t[k]));
        let (d1, d2, d3) = (dot(ab, ap), dot(ac, ap), dot(ab, bp));
        let (d4, d5, d6) = (dot(ac, bp), dot(ab, cp), dot(ac, cp));
        let (va, vb, vc) = (d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2);
        let is_inside = (va > 0.0)
            & (vb > 0.0)
            & (vc > 0.0)
            & ((d1 > 0.0) | (d2 > 0.0))
            & ((d3 < 0.0) | (d4 > d3))
            & ((d6 < 0.0) | (d5 > d6));
        let height = dot(normal, ap);
        let scale = 1.0 / (va + vb + vc);
        out.distance_sq[i] = if is_inside { height * height / normal_sq } else { f64::NAN };
        out.weights[0][i] = vb * scale;
        out.weights[1][i] = vc * scale;
    }
    out
}

/// Squared distance from `point` to the edge between `a` and `b`, and how far along it from `a` the nearest
/// point is, from 0 to 1.
///
/// The edge is followed from its lexicographically smaller end, so all triangles at it find the same bits.
#[inline]
pub fn closest_on_edge(point: Vector, a: Vector, b: Vector) -> (f64, f64) {
    let is_turned = (b[0], b[1], b[2]) < (a[0], a[1], a[2]);
    let (start, end) = if is_turned { (b, a) } else { (a, b) };
    let (edge, from, beyond) = (sub(end, start), sub(point, start), sub(point, end));
    let (before, behind) = (dot(edge, from), dot(edge, beyond));
    // At its ends the distance to the corner is the more accurate one.
    let (off, s) = if before > 0.0 && behind < 0.0 {
        let s = before / (before - behind);
        ([0, 1, 2].map(|k| from[k] - s * edge[k]), s)
    } else if before > 0.0 {
        (beyond, 1.0)
    } else {
        (from, 0.0)
    };
    (length_sq(off), if is_turned { 1.0 - s } else { s })
}

#[cold]
fn closest_on_edges(point: Vector, t: &[Vector; 3]) -> (f64, [f64; 3]) {
    let mut best = (f64::INFINITY, [1.0, 0.0, 0.0]);
    for i in 0..3 {
        let j = (i + 1) % 3;
        let (distance_sq, s) = closest_on_edge(point, t[i], t[j]);
        if distance_sq < best.0 {
            let mut weights = [0.0; 3];
            weights[i] = 1.0 - s;
            weights[j] = s;
            best = (distance_sq, weights);
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The closest point by minimising over a fine net of barycentric coordinates: slow, obvious.
    fn by_search(point: Vector, t: &[Vector; 3]) -> f64 {
        let n = 400;
        let mut best = f64::INFINITY;
        for i in 0..=n {
            for j in 0..=n - i {
                let (v, w) = (i as f64 / n as f64, j as f64 / n as f64);
                let q = point_at(t, [1.0 - v - w, v, w]);
                best = best.min(length_sq(sub(point, q)));
            }
        }
        best.sqrt()
    }

    //  c
    //  |\      every region around the triangle: three corners, three edges, inside, and the same
    //  | \     for an obtuse one and for a sliver
    //  a--b
    #[test]
    fn every_region_agrees_with_a_search() {
        let triangles = [
            [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            [[0.0, 0.0, 0.0], [1.0, 0.0, 0.2], [-0.9, 0.1, 0.0]],
            [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, 1e-13, 0.0]],
            [[0.3, 0.0, 0.0], [0.3, 0.0, 0.0], [0.5, 0.5, 0.5]],
            [[0.1, 0.1, 0.1]; 3],
        ];
        for t in &triangles {
            for i in 0..343 {
                let at = |k: usize| k as f64 * 0.5 - 1.5 + 0.03;
                let p = [at(i % 7), at(i / 7 % 7), at(i / 49)];
                let (found_sq, weights) = closest(p, t);
                let inside = closest_inside(&p.map(|x| [x; 2]), t);
                if !inside.distance_sq[1].is_nan() {
                    assert_eq!(inside.distance_sq[1].to_bits(), found_sq.to_bits(), "{p:?}");
                    assert_eq!(inside.weights.map(|w| w[1]), [weights[1], weights[2]], "{p:?}");
                }
                let (found, searched) = (found_sq.sqrt(), by_search(p, t));
                assert!(found <= searched + 1e-12, "{t:?} {p:?}: {found} > {searched}");
                assert!(searched - found < 1e-2, "{t:?} {p:?}: {found} < {searched}");
                let q = point_at(t, weights);
                assert!((length_sq(sub(p, q)).sqrt() - found).abs() < 1e-9);
                assert!(weights.iter().all(|w| (-1e-12..=1.0 + 1e-12).contains(w)));
            }
        }
    }

    /// The square of its area vanishes, but the area does not.
    #[test]
    fn a_needle_has_its_area() {
        for height in [1e-120, 1e-145, 1e-200, 1e-300] {
            let t = [[0.0; 3], [1.0, 0.0, 0.0], [0.5, height, 0.0]];
            assert!((area(&t) / height - 0.5).abs() < 1e-12, "{height}: {}", area(&t));
        }
        assert_eq!(area(&[[0.0; 3], [1.0, 0.0, 0.0], [0.5, 0.0, 0.0]]), 0.0);
    }

    #[test]
    fn canonical_order_keeps_the_orientation() {
        let t = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        for first in 0..3 {
            let turned = canonical(rotate(t, first));
            assert_eq!(turned, [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
        }
    }

    #[test]
    fn angles_are_accurate_when_small() {
        assert_eq!(angle([1.0, 0.0, 0.0], [0.0; 3]), None);
        let small = angle([1.0, 0.0, 0.0], [1.0, 1e-9, 0.0]).unwrap();
        assert!((small - 1e-9).abs() < 1e-20);
        let turned = angle([1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]).unwrap();
        assert!((turned - std::f64::consts::PI).abs() < 1e-15);
    }
}
