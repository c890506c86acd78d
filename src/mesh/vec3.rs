//! Three-component vectors as plain arrays, in f32 or f64.
//!
//! One order of operations for either, none fused, so that results do not depend on who asks. It holds no
//! geometry of meshes; what works on eight vectors at once is in `lanes`.

use std::ops::{Add, Mul, Sub};

/// A point or a direction.
pub type Vec3 = [f64; 3];

/// f32 or f64.
pub trait Real: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> {}

impl Real for f32 {}
impl Real for f64 {}

/// The sum of two vectors.
#[inline(always)]
pub fn add<T: Real>(a: [T; 3], b: [T; 3]) -> [T; 3] {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

/// The first vector less the second.
#[inline(always)]
pub fn sub<T: Real>(a: [T; 3], b: [T; 3]) -> [T; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// A vector times a number.
#[inline(always)]
pub fn scale<T: Real>(a: [T; 3], s: T) -> [T; 3] {
    [a[0] * s, a[1] * s, a[2] * s]
}

/// The scalar product.
#[inline(always)]
pub fn dot<T: Real>(a: [T; 3], b: [T; 3]) -> T {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// The vector product.
#[inline(always)]
pub fn cross<T: Real>(a: [T; 3], b: [T; 3]) -> [T; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// The square of the length.
#[inline(always)]
pub fn length_sq<T: Real>(a: [T; 3]) -> T {
    dot(a, a)
}

/// Twice the area times the unit normal of a triangle.
#[inline(always)]
pub fn normal<T: Real>(corners: [[T; 3]; 3]) -> [T; 3] {
    cross(sub(corners[1], corners[0]), sub(corners[2], corners[0]))
}

/// The unit vector along `a`; `None` for one without a direction.
pub fn unit(a: Vec3) -> Option<Vec3> {
    let length = length_sq(a).sqrt();
    (length > 0.0 && length.is_finite()).then(|| a.map(|x| x / length))
}

/// Bits by which places are the same: 0 and -0 are.
#[inline]
pub fn place_bits(place: Vec3) -> [u64; 3] {
    place.map(|x| (x + 0.0).to_bits())
}

/// Returns the place of the nearest point to `p` on the segment from `a` (0) to `b` (1); 0.5 on a point.
pub fn along(p: Vec3, a: Vec3, b: Vec3) -> f64 {
    let edge = sub(b, a);
    let edge_sq = length_sq(edge);
    if edge_sq > 0.0 { (dot(sub(p, a), edge) / edge_sq).clamp(0.0, 1.0) } else { 0.5 }
}

/// Squared distance of a point from a triangle.
pub fn triangle_distance_sq(p: Vec3, [a, b, c]: [Vec3; 3]) -> f64 {
    let (ab, ac, ap) = (sub(b, a), sub(c, a), sub(p, a));
    let n = cross(ab, ac);
    let n_sq = length_sq(n);
    if n_sq > 0.0 {
        let v = dot(cross(ap, ac), n) / n_sq;
        let w = dot(cross(ab, ap), n) / n_sq;
        if v >= 0.0 && w >= 0.0 && v + w <= 1.0 {
            let height = dot(ap, n);
            return height * height / n_sq;
        }
    }
    let to_side = |from: Vec3, to: Vec3| {
        let t = along(p, from, to);
        length_sq(sub(p, add(from, scale(sub(to, from), t))))
    };
    to_side(a, b).min(to_side(b, c)).min(to_side(c, a))
}
