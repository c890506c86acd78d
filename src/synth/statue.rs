//! `statue`: a closed surface of genus 0, a stone head as a scanner would see it.
//!
//! The topology is that of a subdivided icosahedron: ten diamonds of n x n quads, each owning n x n
//! vertices, and the two poles, so 10 n^2 + 2 vertices and 20 n^2 triangles with closed-form numbers.
//! `sculpture` places the vertices.

use super::noise::{gauss, hash2, signed3};
use super::sculpture::Sculpture;
use super::surface::{Indexed, Vertex};

/// A triangulated sculpture.
pub(super) struct Statue {
    /// Quads along each side of a diamond.
    n: u64,
    seed: u64,
    /// The twelve icosahedron corners: north, five of the upper ring, five of the lower, south.
    corners: [[f64; 3]; 12],
    sculpture: Sculpture,
    /// Standard deviation of the scan noise along the surface normal, in millimetres.
    noise: f64,
    colored: bool,
}

impl Statue {
    /// The coarsest statue of at least `n_triangles`: the next 20 n^2. `noise` is a factor of the usual one.
    pub(super) fn new(n_triangles: u64, seed: u64, colored: bool, noise: f64) -> Self {
        let mut n = ((n_triangles as f64 / 20.0).sqrt() as u64).max(1);
        while 20 * n * n < n_triangles {
            n += 1;
        }
        // An icosahedron edge spans about 1.1 of a radius of about 0.8 m.
        let spacing = 880.0 / n as f64;
        Statue {
            n,
            seed,
            corners: icosahedron(),
            sculpture: Sculpture::new(seed, spacing),
            noise: noise * (0.06 * spacing).min(0.05),
            colored,
        }
    }

    /// The corner numbers (as in `corners`) of diamond `d` at (0,0), (n,0), (0,n), (n,n).
    fn diamond(d: u64) -> [usize; 4] {
        let k = (d % 5) as usize;
        let next = (k + 1) % 5;
        if d < 5 { [0, 1 + k, 1 + next, 6 + k] } else { [1 + next, 6 + k, 6 + next, 11] }
    }

    /// The number of the grid point (i, j) of diamond `d`, 0 <= i, j <= n.
    ///
    /// A diamond owns 1 <= i <= n, 0 <= j < n; its other two sides belong to its neighbours.
    fn id(&self, d: u64, i: u64, j: u64) -> u64 {
        let n = self.n;
        let upper = d < 5;
        let k = d % 5;
        let next = (k + 1) % 5;
        let (d, i, j) = match (upper, i, j) {
            (true, 0, 0) => return 10 * n * n,
            (false, i, j) if i == n && j == n => return 10 * n * n + 1,
            (true, 0, j) => (next, j, 0),
            (true, i, j) if j == n => (5 + k, i, 0),
            (false, i, j) if j == n => (5 + next, n, i),
            (false, 0, j) => (next, n, j),
            _ => (d, i, j),
        };
        d * n * n + (i - 1) * n + j
    }

    /// The direction from the centre in which the vertex lies, not normalised, without jitter.
    fn direction(&self, id: u64) -> [f64; 3] {
        let n = self.n;
        match id.checked_sub(10 * n * n) {
            Some(0) => return self.corners[0],
            Some(_) => return self.corners[11],
            None => {}
        }
        let (d, rest) = (id / (n * n), id % (n * n));
        let (i, j) = ((rest / n + 1) as f64 / n as f64, (rest % n) as f64 / n as f64);
        let [a, b, c, d] = Self::diamond(d).map(|corner| self.corners[corner]);
        let plane = |at: [f64; 3], p: [f64; 3], s: f64, q: [f64; 3], t: f64| {
            std::array::from_fn(|x| at[x] + s * (p[x] - at[x]) + t * (q[x] - at[x]))
        };
        if i + j <= 1.0 { plane(a, b, i, c, j) } else { plane(d, c, 1.0 - i, b, 1.0 - j) }
    }
}

impl Indexed for Statue {
    fn n_vertices(&self) -> u64 {
        10 * self.n * self.n + 2
    }

    fn n_faces(&self) -> u64 {
        20 * self.n * self.n
    }

    fn vertex(&self, id: u64) -> Vertex {
        let random = hash2(id, self.seed);
        // A scanner's samples sit on no lattice: up to a fifth of the grid spacing aside.
        let aside = signed3(random).map(|x| 0.2 * x / self.n as f64);
        let direction = self.direction(id);
        let direction = normalize(std::array::from_fn(|x| direction[x] + aside[x]));
        let depth = self.noise * gauss(hash2(random, 1));
        let point = self.sculpture.point(direction);
        let position = std::array::from_fn(|x| (point[x] + depth * direction[x]) as f32);
        let color = if self.colored { self.sculpture.color(point) } else { [0; 3] };
        Vertex { position, color, uv: octahedral(direction) }
    }

    fn face(&self, row: u64) -> [u64; 3] {
        let n = self.n;
        let (quad, upper) = (row / 2, row.is_multiple_of(2));
        let (d, rest) = (quad / (n * n), quad % (n * n));
        let (i, j) = (rest / n, rest % n);
        if upper {
            [self.id(d, i, j), self.id(d, i + 1, j), self.id(d, i, j + 1)]
        } else {
            [self.id(d, i + 1, j), self.id(d, i + 1, j + 1), self.id(d, i, j + 1)]
        }
    }
}

/// The corners of the unit icosahedron with a corner up, rings counter-clockwise seen from above.
fn icosahedron() -> [[f64; 3]; 12] {
    // cos and sin of 36 degrees, and of the rings' latitude atan(1/2); written out because the library's
    // trigonometry may differ between machines in the last bit.
    let (cos36, sin36) = (0.809_016_994_374_947_4, 0.587_785_252_292_473_1);
    let height = 0.2_f64.sqrt();
    let radius = 0.8_f64.sqrt();
    let mut corners = [[0.0, 0.0, 1.0]; 12];
    let (mut x, mut y) = (1.0, 0.0);
    for step in 0..10 {
        let ring = step % 2;
        let z = if ring == 0 { height } else { -height };
        corners[1 + 5 * ring + step / 2] = [radius * x, radius * y, z];
        (x, y) = (x * cos36 - y * sin36, x * sin36 + y * cos36);
    }
    corners[11] = [0.0, 0.0, -1.0];
    corners
}

/// The octahedral map of a direction to the unit square; continuous but for its folded lower half.
fn octahedral(direction: [f64; 3]) -> [f32; 2] {
    let sum: f64 = direction.iter().map(|x| x.abs()).sum();
    let [x, y, z] = direction.map(|x| x / sum);
    let fold = |a: f64, b: f64| if z < 0.0 { (1.0 - b.abs()).copysign(a) } else { a };
    [(0.5 + 0.5 * fold(x, y)) as f32, (0.5 + 0.5 * fold(y, x)) as f32]
}

fn normalize(v: [f64; 3]) -> [f64; 3] {
    let length = (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
    v.map(|x| x / length)
}
