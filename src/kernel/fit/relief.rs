//! The relief of the original over the triangles of a fitted surface, from the terms of the last sweep.
//!
//! Over each triangle the linear function that is nearest to the heights of its samples. What it leaves out is orthogonal
//! to all linear functions there, so the next fit, over triangles that are larger, hardly misses it. It moves nothing.

use super::normal_equations::{FaceTerm, V};
use stonecut_mesh::relief::Relief;
use stonecut_mesh::vec3::{dot, normal, sub};

/// Weight of a constant height against the samples of a triangle: with few of them the slope is held back. The mass
/// of an evenly sampled triangle resists a slope by a twelfth of its weight.
const LEVEL: f64 = 0.01;

/// The relief over the triangles of `terms`, whose vertices lay at `from` when the samples were held against them and
/// have gone to `to`.
pub(super) fn relief(terms: &[FaceTerm], from: &[V], to: &[V]) -> Vec<Relief> {
    let mut out = Vec::with_capacity(terms.len());
    for term in terms {
        let heights = heights(term);
        let after = term.corners.map(|v| to[v as usize]);
        let doubled = normal(after);
        let unit = dot(doubled, doubled).sqrt().sqrt();
        let risen = term.corners.map(|v| dot(term.normal, sub(to[v as usize], from[v as usize])));
        out.push(match heights {
            Some(heights) if unit > 0.0 => {
                Relief::new(std::array::from_fn(|k| (heights[k] as f32 - risen[k]) / unit))
            }
            // Without samples the surface itself is what is known.
            _ => Relief::default(),
        });
    }
    out
}

/// Heights of the samples above the corners, by the least squares; `None` without samples.
fn heights(term: &FaceTerm) -> Option<[f64; 3]> {
    let (mut m, q) = term.element.moments();
    let weight: f64 = m.iter().flatten().sum();
    let is_sampled = weight > 0.0 && weight.is_finite();
    if !is_sampled {
        return None;
    }
    for (i, row) in m.iter_mut().enumerate() {
        for (j, x) in row.iter_mut().enumerate() {
            *x += LEVEL * weight * if i == j { 2.0 / 3.0 } else { -1.0 / 3.0 };
        }
    }
    let minor = |i: usize, j: usize| {
        let (a, b) = ((i + 1) % 3, (i + 2) % 3);
        let (c, d) = ((j + 1) % 3, (j + 2) % 3);
        m[a][c] * m[b][d] - m[a][d] * m[b][c]
    };
    let determinant: f64 = (0..3).map(|j| m[0][j] * minor(0, j)).sum();
    let share = 1.0 / determinant;
    let solved = std::array::from_fn(|k| (0..3).map(|i| minor(i, k) * q[i]).sum::<f64>() * share);
    Some(solved)
}
