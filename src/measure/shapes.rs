//! Shapes of the triangles of a mesh: smallest angles, slivers, edges.

use stonecut_mesh::Mesh;
use stonecut_mesh::vec3::{dot, length_sq, sub};

/// Bins of smallest angles, 0 to 60 degrees.
const ANGLE_BINS: usize = 60;

/// A triangle with a smaller angle is a sliver, in degrees.
const SLIVER: f64 = 10.0;

/// Shapes of the triangles of a mesh.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ShapeCounts {
    /// Triangles by their smallest angle, in bins of one degree.
    pub counts: Vec<f64>,
    /// Median of the smallest angles, in degrees.
    pub median: f64,
    /// Share of slivers.
    pub slivers: f64,
    /// Mean length of an edge, in input units.
    pub mean_edge: f64,
}

impl ShapeCounts {
    /// Looks at all of them.
    pub fn of(mesh: &Mesh) -> ShapeCounts {
        let mut all: Vec<f64> =
            (0..mesh.triangles.len()).map(|t| smallest(mesh.corners(t))).collect();
        all.sort_by(f64::total_cmp);
        let mut counts = vec![0.0; ANGLE_BINS];
        all.iter().for_each(|angle| counts[(*angle as usize).min(ANGLE_BINS - 1)] += 1.0);
        let slivers = all.partition_point(|&angle| angle < SLIVER) as f64;
        let median = all.get(all.len() / 2).copied().unwrap_or(0.0);
        let n = all.len().max(1) as f64;
        let around = |[p, q, r]: [[f64; 3]; 3]| {
            [sub(q, p), sub(r, q), sub(p, r)].map(|edge| length_sq(edge).sqrt()).iter().sum::<f64>()
        };
        let lengths: f64 = (0..mesh.triangles.len()).map(|t| around(mesh.corners(t))).sum();
        ShapeCounts { counts, median, slivers: slivers / n, mean_edge: lengths / (3.0 * n) }
    }

    /// The share of all triangles in each bin.
    pub fn shares(&self) -> impl Iterator<Item = f64> {
        let all = self.counts.iter().sum::<f64>().max(1.0);
        self.counts.iter().map(move |n| n / all)
    }
}

/// The smallest angle of a triangle, in degrees; 0 where an edge has no length.
fn smallest(corners: [[f64; 3]; 3]) -> f64 {
    let at = |i: usize| {
        let (p, q, r) = (corners[i], corners[(i + 1) % 3], corners[(i + 2) % 3]);
        let (u, v) = (sub(q, p), sub(r, p));
        let cosine = dot(u, v) / (length_sq(u) * length_sq(v)).sqrt();
        if cosine.is_finite() { cosine.clamp(-1.0, 1.0).acos().to_degrees() } else { 0.0 }
    };
    at(0).min(at(1)).min(at(2))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_are_those_of_the_triangles() {
        let positions = vec![
            [0.0; 3],
            [1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [0.5, 0.75f64.sqrt(), 0.0],
            [2.0, 0.0, 0.0],
        ];
        let mesh = Mesh::new(positions, vec![[0, 1, 2], [0, 1, 3], [0, 1, 4]]);
        let shapes = ShapeCounts::of(&mesh);
        assert!((shapes.median - 45.0).abs() < 1e-9 && (shapes.slivers - 1.0 / 3.0).abs() < 1e-9);
        assert_eq!((shapes.counts[0], shapes.counts.iter().sum::<f64>()), (1.0, 3.0));
        assert!((shapes.mean_edge - (9.0 + 2.0f64.sqrt()) / 9.0).abs() < 1e-9, "{shapes:?}");
        assert_eq!(smallest([[0.0; 3]; 3]), 0.0);
    }
}
