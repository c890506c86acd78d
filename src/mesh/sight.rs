//! Triangles as they are seen from a point: boxes on the faces of a cube around it.
//!
//! Two triangles that have a point in common besides the one that looks have one in the same direction from it. So where a corner
//! of thousands of triangles looks at these, boxes on its cube tell apart what boxes in space cannot: all of those
//! have the corner in common. On a face of the cube the image of a triangle is that of its corners, and lines stay
//! lines. Boxes are a little larger than the images, by more than what is rounded.

use super::bounds::Bounds;
use super::vec3::{Vec3, sub};

/// Boxes by the faces of the cube, which are at -1 and 1; empty where nothing is seen.
pub type Faces = [Bounds; 6];

/// Parts nearer than this share of the farthest coordinate may be seen anywhere.
const NEAREST: f64 = 1e-6;

/// Boxes are larger than images by this much, and faces than those of a cube: a few roundings, over `NEAREST`.
const MARGIN: f64 = 1e-8;

/// Most corners of a triangle that four planes have cut, or of one without area whose corners count twice.
const MOST: usize = 16;

/// The box of everything on a face.
const WHOLE: Bounds = Bounds { low: [-2.0; 3], high: [2.0; 3] };

/// Projects a triangle, or a segment, onto the faces around `eye`.
pub fn seen(eye: Vec3, corners: &[Vec3]) -> Faces {
    let mut from = [[0.0; 3]; 3];
    let n = corners.len().min(3);
    from.iter_mut().zip(corners).for_each(|(from, corner)| *from = sub(*corner, eye));
    let size = from[..n].iter().flatten().fold(0.0f64, |size, x| size.max(x.abs()));
    // Not a number, or nothing to see.
    if !(size > 0.0 && size.is_finite()) {
        return [WHOLE; 6];
    }
    let mut faces = [Bounds::EMPTY; 6];
    for (face, bounds) in faces.iter_mut().enumerate() {
        let (k, sense) = (face / 2, if face % 2 == 0 { 1.0 } else { -1.0 });
        let (mut part, mut n) = ([[0.0; 3]; MOST], n);
        part[..3].copy_from_slice(&from);
        for side in 0..4 {
            let (j, other) = ((k + 1 + side / 2) % 3, if side % 2 == 0 { 1.0 } else { -1.0 });
            let over = |p: &Vec3| sense * p[k] * (1.0 + MARGIN) - other * p[j];
            let (old, n_old) = (part, n);
            n = 0;
            for i in 0..n_old {
                let (p, q) = (old[i], old[(i + 1) % n_old]);
                let (a, b) = (over(&p), over(&q));
                if a >= 0.0 {
                    part[n] = p;
                    n += 1;
                }
                if (a < 0.0) != (b < 0.0) {
                    let share = a / (a - b);
                    part[n] = [0, 1, 2].map(|k| p[k] + share * (q[k] - p[k]));
                    n += 1;
                }
            }
        }
        for point in &part[..n] {
            let far = sense * point[k];
            // Written so that what is not a number may be seen anywhere.
            let is_far = far > NEAREST * size;
            if !is_far {
                return [WHOLE; 6];
            }
            bounds.add(point.map(|x| x / far));
        }
        if n > 0 {
            bounds.low = bounds.low.map(|x| x - MARGIN);
            bounds.high = bounds.high.map(|x| x + MARGIN);
        }
    }
    faces
}

/// Projects a triangle onto the faces around a place that may be a corner of it: then the edge opposite of that.
pub fn seen_of(eye: Vec3, corners: &[Vec3; 3]) -> Faces {
    let [a, b, c] = *corners;
    match corners.iter().position(|corner| *corner == eye) {
        Some(0) => seen(eye, &[b, c]),
        Some(1) => seen(eye, &[c, a]),
        Some(_) => seen(eye, &[a, b]),
        None => seen(eye, corners),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::meeting::{Meeting, is_flat, meet};

    /// Few values, so that corners, edges and planes are common at times.
    #[test]
    fn triangles_that_meet_are_seen_in_one_direction() {
        let mut state = 5u64;
        let mut next = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            ((state >> 40) % 5) as f64 - 2.0
        };
        let touch =
            |a: &Bounds, b: &Bounds| (0..3).all(|k| a.low[k] <= b.high[k] && b.low[k] <= a.high[k]);
        let (mut n_meet, mut n_apart) = (0, 0);
        for _ in 0..20_000 {
            let mut draw = || [next(), 0.3 * next(), 7.0 * next()];
            let eye = draw();
            let (a, b) = ([eye, draw(), draw()], [draw(), eye, draw()]);
            let c = [draw(), draw(), draw()];
            for (a, b) in [(a, b), (a, c)] {
                if is_flat(&a) || is_flat(&b) {
                    continue;
                }
                let faces = [a, b].map(|t| seen_of(eye, &t));
                let is_seen = (0..6).any(|f| touch(&faces[0][f], &faces[1][f]));
                let meets = meet(&a, &b) != Meeting::None;
                assert!(is_seen || !meets, "{a:?} {b:?}");
                n_meet += u32::from(meets);
                n_apart += u32::from(!is_seen);
            }
        }
        assert!(n_meet > 1000 && n_apart > 5000, "{n_meet} {n_apart}");
    }
}
