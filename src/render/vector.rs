//! Smooth steps, and main directions of symmetric matrices.

use stonecut_mesh::vec3::Vec3;

/// A smooth step from 0 at `from` to 1 at `to`.
pub(super) fn smoothstep(from: f32, to: f32, x: f32) -> f32 {
    let t = ((x - from) / (to - from)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Eigenvalues and unit eigenvectors of a symmetric 3 x 3 matrix, in no particular order.
///
/// Cyclic Jacobi rotations: unconditionally stable, and eight sweeps reach the last bit (quadratic
/// convergence). Source: Golub & Van Loan 2013, section 8.5 (docs/references.md).
pub(super) fn symmetric_eigen(mut matrix: [Vec3; 3]) -> [(f64, Vec3); 3] {
    let mut vectors = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    for _ in 0..8 {
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            if matrix[p][q] == 0.0 {
                continue;
            }
            // The smaller root of t^2 + 2 theta t - 1 = 0: the tangent of a rotation below 45 degrees.
            let theta = (matrix[q][q] - matrix[p][p]) / (2.0 * matrix[p][q]);
            let tangent = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
            let cosine = 1.0 / (tangent * tangent + 1.0).sqrt();
            let sine = tangent * cosine;
            let rotate = |a: f64, b: f64| (cosine * a - sine * b, sine * a + cosine * b);
            for row in &mut matrix {
                (row[p], row[q]) = rotate(row[p], row[q]);
            }
            let rows = matrix;
            let rotated: [(f64, f64); 3] = std::array::from_fn(|k| rotate(rows[p][k], rows[q][k]));
            (matrix[p], matrix[q]) = (rotated.map(|x| x.0), rotated.map(|x| x.1));
            (matrix[p][q], matrix[q][p]) = (0.0, 0.0);
            for vector in &mut vectors {
                (vector[p], vector[q]) = rotate(vector[p], vector[q]);
            }
        }
    }
    std::array::from_fn(|i| (matrix[i][i], vectors.map(|row| row[i])))
}

#[cfg(test)]
mod tests {
    use super::*;
    use stonecut_mesh::vec3::dot;

    #[test]
    fn eigenvectors_rebuild_the_matrix() {
        let flat = [[1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 0.0]];
        let general = [[4.0, -2.0, 0.5], [-2.0, 3.0, 1e-9], [0.5, 1e-9, -7.0]];
        let uneven = [[1e12, 3e5, -2.0], [3e5, 1.0, 1e-3], [-2.0, 1e-3, 1e-12]];
        let diagonal = [[2.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 5.0]];
        for matrix in [flat, general, uneven, diagonal, [[0.0; 3]; 3]] {
            let eigen = symmetric_eigen(matrix);
            let largest = matrix.as_flattened().iter().fold(0.0f64, |m, x| m.max(x.abs()));
            for i in 0..3 {
                for j in 0..3 {
                    let rebuilt: f64 = eigen.iter().map(|(value, v)| value * v[i] * v[j]).sum();
                    assert!(
                        (rebuilt - matrix[i][j]).abs() <= 1e-14 * largest,
                        "{matrix:?}: {eigen:?}"
                    );
                    let product = dot(eigen[i].1, eigen[j].1);
                    assert!((product - f64::from(i == j)).abs() < 1e-14, "{matrix:?}: {eigen:?}");
                }
            }
        }
    }
}
