//! Vectors of three numbers, as the reference needs them.

/// A point or a direction.
pub type Vec3 = [f64; 3];

pub fn add(a: Vec3, b: Vec3) -> Vec3 {
    std::array::from_fn(|k| a[k] + b[k])
}

pub fn sub(a: Vec3, b: Vec3) -> Vec3 {
    std::array::from_fn(|k| a[k] - b[k])
}

pub fn scale(a: Vec3, s: f64) -> Vec3 {
    a.map(|x| x * s)
}

pub fn dot(a: Vec3, b: Vec3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub fn cross(a: Vec3, b: Vec3) -> Vec3 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

pub fn length_sq(a: Vec3) -> f64 {
    dot(a, a)
}

/// Twice the area times the unit normal of a triangle.
pub fn normal(corners: [Vec3; 3]) -> Vec3 {
    cross(sub(corners[1], corners[0]), sub(corners[2], corners[0]))
}

/// Place of the foot of `p` on the edge from `a` (0) to `b` (1); 0.5 on an edge without length.
pub fn along(p: Vec3, a: Vec3, b: Vec3) -> f64 {
    let edge = sub(b, a);
    let edge_sq = length_sq(edge);
    if edge_sq > 0.0 { (dot(sub(p, a), edge) / edge_sq).clamp(0.0, 1.0) } else { 0.5 }
}
