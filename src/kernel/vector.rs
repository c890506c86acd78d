//! Three-component vectors as plain arrays.
//!
//! Used wherever the kernel works in f64. It holds no geometry of meshes.

/// A point or a direction.
pub(crate) type Vec3 = [f64; 3];

pub(crate) fn add(a: Vec3, b: Vec3) -> Vec3 {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

pub(crate) fn sub(a: Vec3, b: Vec3) -> Vec3 {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

pub(crate) fn scale(a: Vec3, s: f64) -> Vec3 {
    [a[0] * s, a[1] * s, a[2] * s]
}

pub(crate) fn dot(a: Vec3, b: Vec3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(crate) fn cross(a: Vec3, b: Vec3) -> Vec3 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

pub(crate) fn length_sq(a: Vec3) -> f64 {
    dot(a, a)
}

/// Twice the area times the unit normal of a triangle.
pub(crate) fn normal(corners: [Vec3; 3]) -> Vec3 {
    cross(sub(corners[1], corners[0]), sub(corners[2], corners[0]))
}

/// Where on the segment from `a` (0) to `b` (1) the point nearest to `p` lies; 0.5 on a point.
pub(crate) fn along(p: Vec3, a: Vec3, b: Vec3) -> f64 {
    let edge = sub(b, a);
    let edge_sq = length_sq(edge);
    if edge_sq > 0.0 { (dot(sub(p, a), edge) / edge_sq).clamp(0.0, 1.0) } else { 0.5 }
}
