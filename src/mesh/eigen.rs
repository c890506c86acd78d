//! Main directions of symmetric matrices.

use crate::vec3::{Vec3, add, scale, sub};

/// Sweeps of Jacobi's method; a symmetric 3 x 3 matrix takes four or five to machine precision.
const SWEEPS: usize = 8;

/// Eigenvalues and eigenvectors of a symmetric matrix, given as its upper triangle by rows (Jacobi 1846).
pub fn eigen([xx, xy, xz, yy, yz, zz]: [f64; 6]) -> ([f64; 3], [Vec3; 3]) {
    let mut m = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]];
    // Rows are the vectors.
    let mut v = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    for _ in 0..SWEEPS {
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            if m[p][q] == 0.0 {
                continue;
            }
            let theta = (m[q][q] - m[p][p]) / (2.0 * m[p][q]);
            let t = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
            let c = 1.0 / (t * t + 1.0).sqrt();
            let s = t * c;
            for row in &mut m {
                let (x, y) = (row[p], row[q]);
                (row[p], row[q]) = (c * x - s * y, s * x + c * y);
            }
            let (x, y) = (m[p], m[q]);
            m[p] = sub(scale(x, c), scale(y, s));
            m[q] = add(scale(x, s), scale(y, c));
            let (x, y) = (v[p], v[q]);
            v[p] = sub(scale(x, c), scale(y, s));
            v[q] = add(scale(x, s), scale(y, c));
        }
    }
    ([m[0][0], m[1][1], m[2][2]], v)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn eigenvalues_and_vectors_make_the_matrix_again() {
        for m in [
            [2.0, 0.5, -1.0, 3.0, 0.25, 1.0],
            [1.0, 0.0, 0.0, 1.0, 0.0, 1.0],
            [1e-9, 2e-9, 0.0, 5e-9, 0.0, 0.0],
        ] {
            let (values, vectors) = eigen(m);
            let size = m.iter().fold(0.0f64, |a, x| a.max(x.abs()));
            for (i, (row, column)) in
                [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)].into_iter().enumerate()
            {
                let sum: f64 =
                    (0..3).map(|k| values[k] * vectors[k][row] * vectors[k][column]).sum();
                assert!((sum - m[i]).abs() < 1e-12 * size, "{m:?}: {i}");
            }
        }
    }
}
