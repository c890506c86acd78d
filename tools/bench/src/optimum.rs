//! The least error that any mesh of so many triangles can have on a smooth surface, as their number grows.
//!
//! A surface with principal curvatures of equal sign (Gaussian curvature K > 0) is approximated best, in the mean square,
//! by triangles that are equilateral in its metric of curvatures: a triangle of area a leaves a mean squared distance of
//! K a^2 / 180. Where K < 0 it is |K| a^2 / 225 at least, with one linear function a triangle and no regard to its
//! neighbours. The best sizes make the sum RMS = sqrt(I^3 / A) / N, I the integral of the cube root of (K / 180 or
//! |K| / 225) over the surface, A its area, N the number of triangles.
//!
//! Source: Nadler 1986; D'Azevedo & Simpson 1991 for shapes (docs/references.md).

use crate::bench::Settings;
use crate::{Outcome, judge, meshes};
use std::path::{Path, PathBuf};
use stonecut::Mesh;

/// Mean squared distance over |K| a^2.
const ELLIPTIC: f64 = 1.0 / 180.0;
const HYPERBOLIC: f64 = 1.0 / 225.0;

/// What the curvatures of a dense mesh say.
#[derive(Clone, Copy, Debug, Default)]
pub struct Optimum {
    pub area: f64,
    /// Share of the area where the Gaussian curvature is negative.
    pub saddle_share: f64,
    /// Integral of the cube root of the squared error per squared area.
    integral: f64,
}

impl Optimum {
    /// The asymptotic root mean square of a mesh of so many triangles, in input units.
    pub fn rms(&self, n_triangles: u64) -> f64 {
        (self.integral.powi(3) / self.area).sqrt() / n_triangles as f64
    }
}

/// Prints the optimum of a surface, and of each result its error as `stonecut measure` finds it, from the surface to the
/// result, and how many times the optimum of its count that is.
pub fn compare(surface: &Path, results: &[PathBuf], settings: &Settings) -> Outcome<()> {
    let optimum = of_mesh(&meshes::read_any(surface)?);
    println!(
        "area {:.6e}, {:.0} % of it saddles; RMS of N triangles at least {:.6e} / N, for large N",
        optimum.area,
        100.0 * optimum.saddle_share,
        optimum.rms(1)
    );
    for result in results {
        let options = judge::Options {
            samples: settings.samples,
            memory_bytes: settings.memory_bytes.unwrap_or(4 << 30),
            facing: false,
        };
        let quality = judge::judge(&settings.places, surface, result, options)?;
        let n = quality.after.triangles;
        println!(
            "{}: {n} triangles, RMS {:.4e}, {:.3} times the optimum",
            result.display(),
            quality.rms_forward,
            quality.rms_forward / optimum.rms(n)
        );
    }
    Ok(())
}

fn of_mesh(mesh: &Mesh) -> Optimum {
    let n = mesh.positions.len();
    let mut area = vec![0.0f64; n];
    let mut normal = vec![[0.0f64; 3]; n];
    let mut first = vec![0usize; n + 1];
    for t in &mesh.triangles {
        let [a, b, c] = t.map(|v| mesh.positions[v as usize]);
        let cross = cross(sub(b, a), sub(c, a));
        for &v in t {
            area[v as usize] += dot(cross, cross).sqrt() / 6.0;
            (0..3).for_each(|k| normal[v as usize][k] += cross[k]);
            first[v as usize + 1] += 2;
        }
    }
    for v in 0..n {
        first[v + 1] += first[v];
    }
    let mut place = first.clone();
    let mut neighbours = vec![0u32; first[n]];
    for t in &mesh.triangles {
        for k in 0..3 {
            for other in [t[(k + 1) % 3], t[(k + 2) % 3]] {
                neighbours[place[t[k] as usize]] = other;
                place[t[k] as usize] += 1;
            }
        }
    }
    let ring = |v: u32| &neighbours[first[v as usize]..first[v as usize + 1]];
    let mut found = Optimum::default();
    let mut near = Vec::new();
    for v in 0..n as u32 {
        near.clear();
        for &w in ring(v) {
            near.push(w);
            near.extend(ring(w));
        }
        near.sort_unstable();
        near.dedup();
        let Some(gaussian) = curvature(mesh, v, normal[v as usize], &near) else { continue };
        let own = area[v as usize];
        let square = if gaussian > 0.0 { ELLIPTIC } else { HYPERBOLIC };
        found.area += own;
        found.saddle_share += if gaussian < 0.0 { own } else { 0.0 };
        found.integral += own * (square * gaussian.abs()).cbrt();
    }
    found.saddle_share /= found.area.max(f64::MIN_POSITIVE);
    found
}

/// Gaussian curvature at a vertex by the quadric that fits the vertices near it best; `None` if they are too few.
fn curvature(mesh: &Mesh, v: u32, normal: [f64; 3], near: &[u32]) -> Option<f64> {
    let length = dot(normal, normal).sqrt();
    if near.len() < 7 || length == 0.0 {
        return None;
    }
    let up = normal.map(|x| x / length);
    let aside = if up[0].abs() < 0.8 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
    let x_axis = cross(up, aside);
    let x_axis = x_axis.map(|x| x / dot(x_axis, x_axis).sqrt());
    let y_axis = cross(up, x_axis);
    let origin = mesh.positions[v as usize];
    // Lengths in units of the farthest neighbour keep the equations even.
    let spread = near
        .iter()
        .map(|&w| sub(mesh.positions[w as usize], origin))
        .fold(0.0, |most: f64, off| most.max(dot(off, off)))
        .sqrt();
    let mut rows = [[0.0f64; 7]; 6];
    for &w in near {
        let off = sub(mesh.positions[w as usize], origin).map(|x| x / spread);
        let (x, y, z) = (dot(off, x_axis), dot(off, y_axis), dot(off, up));
        let terms = [1.0, x, y, 0.5 * x * x, x * y, 0.5 * y * y];
        for (row, term) in rows.iter_mut().zip(terms) {
            for (sum, other) in row.iter_mut().zip(terms) {
                *sum += term * other;
            }
            row[6] += term * z;
        }
    }
    let [_, dx, dy, xx, xy, yy] = solve(rows)?;
    let slope = 1.0 + dx * dx + dy * dy;
    Some((xx * yy - xy * xy) / (slope * slope) / (spread * spread))
}

/// Solves six linear equations; `None` if they are not independent.
fn solve(mut rows: [[f64; 7]; 6]) -> Option<[f64; 6]> {
    for k in 0..6 {
        let pivot = (k..6).max_by(|&i, &j| rows[i][k].abs().total_cmp(&rows[j][k].abs()))?;
        rows.swap(k, pivot);
        if rows[k][k].abs() < 1e-12 {
            return None;
        }
        let own = rows[k];
        for (_, row) in rows.iter_mut().enumerate().filter(|(i, _)| *i != k) {
            let factor = row[k] / own[k];
            for (x, y) in row.iter_mut().zip(own).skip(k) {
                *x -= factor * y;
            }
        }
    }
    Some(std::array::from_fn(|k| rows[k][6] / rows[k][k]))
}

fn sub(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|k| a[k] - b[k])
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A height field of n x n squares over [-1, 1]^2.
    fn field(n: usize, height: impl Fn(f64, f64) -> f64) -> Mesh {
        let at = |i: usize| 2.0 * i as f64 / n as f64 - 1.0;
        let mut mesh = Mesh::default();
        for i in 0..=n {
            for j in 0..=n {
                mesh.positions.push([at(i), at(j), height(at(i), at(j))]);
            }
        }
        let id = |i: usize, j: usize| (i * (n + 1) + j) as u32;
        for i in 0..n {
            for j in 0..n {
                mesh.triangles.push([id(i, j), id(i + 1, j), id(i + 1, j + 1)]);
                mesh.triangles.push([id(i, j), id(i + 1, j + 1), id(i, j + 1)]);
            }
        }
        mesh
    }

    #[test]
    fn shallow_bowls_and_saddles_have_their_closed_form() {
        // |K| = 1e-4 everywhere, so the best triangles are all of one size: RMS = sqrt(|K| / 180 or 225) A / N.
        for (sign, square) in [(1.0, ELLIPTIC), (-1.0, HYPERBOLIC)] {
            let found = of_mesh(&field(60, |x, y| 0.005 * (x * x + sign * y * y)));
            let expected = (square * 1e-4).sqrt() * 4.0 / 1000.0;
            let got = found.rms(1000);
            assert!((got / expected - 1.0).abs() < 0.01, "{got} instead of {expected}");
            assert!((found.saddle_share - if sign < 0.0 { 1.0 } else { 0.0 }).abs() < 1e-9);
        }
    }

    #[test]
    fn a_plane_can_be_met_exactly() {
        assert!(of_mesh(&field(20, |x, y| 0.3 * x - 0.7 * y)).rms(2) < 1e-9);
    }
}
