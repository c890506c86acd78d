//! `gyroid`: a closed surface of high genus with the slivers of an isosurface, as from a CT of a foam.
//!
//! The solid is the part of one gyroid labyrinth inside a ball. It is sampled on a cubic grid with a
//! little noise and polygonised by marching tetrahedra: six tetrahedra a cube, all sharing the cube's
//! main diagonal. Since the result is the isosurface of a piecewise linear function that is zero at no
//! grid point, it is a closed manifold for any values whatever.
//!
//! A block is a band of rows of one layer of grid points. Every grid edge belongs to its lower end; a
//! crossed edge is a vertex. The first section of a block are its edges within the layer, the second
//! those towards the layer above, so that faces need to look at two layers only.

use super::noise::{gauss, hash2, noise3};
use super::sliced::{BlockCounts, Sliced};
use super::surface::Vertex;

/// Rows of grid points in a band.
const BAND: usize = 32;
/// Triangles per unit of area of the surface in grid units, measured at 2*10^7 triangles.
const TRIANGLES_PER_AREA: f64 = 8.75;
/// Grid points along one period of a large gyroid; small ones have fewer, to be a gyroid at all.
const SAMPLES_PER_PERIOD: f64 = 20.0;
/// The ball's diameter in millimetres.
const DIAMETER: f64 = 200.0;
/// Vertices keep this distance from the ends of their grid edge, so that two of them never coincide.
const MARGIN: f64 = 0.002;

/// The six tetrahedra of a cube, as corners (bit 0: x, bit 1: y, bit 2: z) from 0 to 7 by one axis at a
/// time; positively oriented but for those marked.
const TETRAHEDRA: [([usize; 4], bool); 6] = [
    ([0, 1, 3, 7], false),
    ([0, 1, 5, 7], true),
    ([0, 2, 6, 7], false),
    ([0, 2, 3, 7], true),
    ([0, 4, 5, 7], false),
    ([0, 4, 6, 7], true),
];

/// For each set of inside corners of a positive tetrahedron (bit n: corner n): the grid edges crossed,
/// as pairs of corners, in an order that is counter-clockwise seen from outside. Three: a triangle, four:
/// a quad.
const CROSSINGS: [&[(usize, usize)]; 16] = [
    &[],
    &[(0, 1), (0, 2), (0, 3)],
    &[(1, 0), (1, 3), (1, 2)],
    &[(0, 2), (0, 3), (1, 3), (1, 2)],
    &[(2, 0), (2, 1), (2, 3)],
    &[(2, 1), (2, 3), (0, 3), (0, 1)],
    &[(1, 0), (1, 3), (2, 3), (2, 0)],
    &[(3, 0), (3, 1), (3, 2)],
    &[(3, 0), (3, 2), (3, 1)],
    &[(0, 1), (0, 2), (3, 2), (3, 1)],
    &[(1, 0), (3, 0), (3, 2), (1, 2)],
    &[(2, 0), (2, 3), (2, 1)],
    &[(2, 0), (2, 1), (3, 1), (3, 0)],
    &[(1, 0), (1, 2), (1, 3)],
    &[(0, 1), (0, 3), (0, 2)],
    &[],
];

/// A gyroid labyrinth in a ball, on a grid.
pub(super) struct Gyroid {
    /// Grid points along each axis.
    points: usize,
    /// Radius of the ball in grid units; its centre is the grid's.
    radius: f64,
    /// Sine and cosine of the gyroid's phase at each grid coordinate.
    waves: Vec<[f64; 2]>,
    seed: u64,
    colored: bool,
}

/// One layer's rows of a band: values and crossed edges.
struct Layer {
    /// Field values, row by row; negative inside.
    values: Vec<f32>,
}

/// Number of the first vertex and set of crossed directions of each grid point.
struct Numbers {
    first: Vec<u32>,
    mask: Vec<u8>,
    count: u64,
}

impl Gyroid {
    /// A gyroid of about `n_triangles` times `scale`^3 triangles.
    pub(super) fn new(n_triangles: u64, scale: f64, seed: u64, colored: bool) -> Self {
        let wanted = n_triangles as f64 / TRIANGLES_PER_AREA;
        // At least three periods across the ball, as long as a period has eight samples.
        let samples = (wanted / 31.0).sqrt().clamp(8.0, SAMPLES_PER_PERIOD);
        let tau = std::f64::consts::TAU;
        // Area: 3.09 / period per volume (the gyroid) and half the ball's. Bisected, being a cubic.
        let area = |r: f64| tau * r * r * (2.0 / 3.0 * r * 3.09 / samples + 1.0);
        let (mut low, mut high) = (1.0, 1e5);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            *(if area(middle) < wanted { &mut low } else { &mut high }) = middle;
        }
        let radius = high.max(samples) * scale;
        let points = 2 * (radius.ceil() as usize) + 5;
        let turn = tau / samples;
        // Sine and cosine of one step by their series, then by addition: the same on every machine.
        let (sin_turn, cos_turn) = series(turn);
        let mut wave = series(tau * (hash2(9, seed) % 1000) as f64 / 1000.0 - 3.0);
        let mut waves = Vec::with_capacity(points);
        for _ in 0..points {
            waves.push([wave.0, wave.1]);
            wave = (wave.0 * cos_turn + wave.1 * sin_turn, wave.1 * cos_turn - wave.0 * sin_turn);
        }
        Gyroid { points, radius, waves, seed, colored }
    }

    fn n_bands(&self) -> u64 {
        self.points.div_ceil(BAND) as u64
    }

    /// The rows a block owns and its layer.
    fn extent(&self, block: u64) -> (usize, usize, usize) {
        let (layer, band) = ((block / self.n_bands()) as usize, (block % self.n_bands()) as usize);
        (layer, band * BAND, ((band + 1) * BAND).min(self.points))
    }

    /// The field at a grid point: negative inside the solid, never 0.
    fn value(&self, i: usize, j: usize, k: usize) -> f32 {
        let centre = 0.5 * (self.points - 1) as f64;
        let square = |n: usize| (n as f64 - centre) * (n as f64 - centre);
        let distance_sq = square(i) + square(j) + square(k);
        let reach = self.radius + 2.0;
        if distance_sq > reach * reach {
            return 1.0;
        }
        let [[sx, cx], [sy, cy], [sz, cz]] = [self.waves[i], self.waves[j], self.waves[k]];
        let at = (k * self.points + j) * self.points + i;
        let noise = 0.015 * gauss(hash2(at as u64, self.seed));
        let gyroid = sx * cy + sy * cz + sz * cx + 0.1 + noise;
        // Both terms in about the same units, or the rim would be ragged.
        let ball = 0.25 * (distance_sq.sqrt() - self.radius);
        let value = gyroid.max(ball) as f32;
        if value == 0.0 { f32::MIN_POSITIVE } else { value }
    }

    /// Rows `from..to` of layer `k`; rows and layers beyond the grid are outside the solid.
    fn layer(&self, k: usize, from: usize, to: usize) -> Layer {
        let mut values = Vec::with_capacity((to - from) * self.points);
        for j in from..to {
            for i in 0..self.points {
                let beyond = j >= self.points || k >= self.points;
                values.push(if beyond { 1.0 } else { self.value(i, j, k) });
            }
        }
        Layer { values }
    }

    /// Numbers the crossed edges of the first `rows` rows of `low` in the directions `from..to`; those
    /// with bit 2 end in `high`.
    fn number(&self, low: &Layer, high: &Layer, rows: usize, from: usize, to: usize) -> Numbers {
        let n = self.points;
        let mut first = Vec::with_capacity(rows * n);
        let mut mask = Vec::with_capacity(rows * n);
        let mut count = 0;
        for j in 0..rows {
            for i in 0..n {
                let inside = low.values[j * n + i] < 0.0;
                let mut crossed = 0u8;
                for d in from..to {
                    let (di, dj) = (d & 1, d >> 1 & 1);
                    let end = if d >> 2 == 0 { low } else { high };
                    // The grid's last column and row are outside, and so is all beyond them.
                    let end_inside = i + di < n && end.values[(j + dj) * n + i + di] < 0.0;
                    crossed |= u8::from(inside != end_inside) << d;
                }
                first.push(count as u32);
                mask.push(crossed);
                count += u64::from(crossed.count_ones());
            }
        }
        Numbers { first, mask, count }
    }

    /// Appends the vertices on the numbered edges.
    fn place(
        &self,
        numbers: &Numbers,
        low: &Layer,
        high: &Layer,
        (k, from): (usize, usize),
        out: &mut Vec<Vertex>,
    ) {
        let n = self.points;
        let unit = 0.5 * DIAMETER / self.radius;
        let centre = 0.5 * (n - 1) as f64;
        for (at, mask) in numbers.mask.iter().enumerate().filter(|(_, mask)| **mask != 0) {
            let (i, j) = (at % n, at / n);
            for d in (1..8usize).filter(|d| mask >> d & 1 == 1) {
                let (di, dj, dk) = (d & 1, d >> 1 & 1, d >> 2);
                let end = if dk == 0 { low } else { high };
                let a = f64::from(low.values[at]);
                let b = f64::from(end.values[(j + dj) * n + i + di]);
                let t = (a / (a - b)).clamp(MARGIN, 1.0 - MARGIN);
                let point = [i as f64 + t * di as f64, (from + j) as f64 + t * dj as f64, {
                    k as f64 + t * dk as f64
                }];
                let point = point.map(|x| unit * (x - centre));
                out.push(self.vertex(point));
            }
        }
    }

    fn vertex(&self, point: [f64; 3]) -> Vertex {
        let position = point.map(|x| x as f32);
        let uv = [0, 1].map(|axis| (0.5 + point[axis] / (1.05 * DIAMETER)) as f32);
        let color = if self.colored {
            let tone = 0.5 + 0.5 * noise3(point.map(|x| 0.03 * x), self.seed as u32);
            [0.85 - 0.25 * tone, 0.62 + 0.1 * tone, 0.4 + 0.4 * tone].map(|c| (255.0 * c) as u8)
        } else {
            [0; 3]
        };
        Vertex { position, color, uv }
    }
}

impl Sliced for Gyroid {
    fn n_blocks(&self) -> u64 {
        self.points as u64 * self.n_bands()
    }

    fn count(&self, block: u64) -> BlockCounts {
        let (k, from, to) = self.extent(block);
        let (low, high) = (self.layer(k, from, to + 1), self.layer(k + 1, from, to + 1));
        let sections = [
            self.number(&low, &high, to - from, 1, 4).count,
            self.number(&low, &high, to - from, 4, 8).count,
        ];
        let mut faces = 0;
        cubes(self.points, to - from, &low, &high, |_, inside| {
            for (corners, _) in &TETRAHEDRA {
                faces += CROSSINGS[set(corners, inside)].len().saturating_sub(2) as u64;
            }
        });
        BlockCounts { vertices: sections, faces }
    }

    fn vertices(&self, block: u64, out: &mut Vec<Vertex>) {
        let (k, from, to) = self.extent(block);
        let (low, high) = (self.layer(k, from, to + 1), self.layer(k + 1, from, to + 1));
        for (d_from, d_to) in [(1, 4), (4, 8)] {
            let numbers = self.number(&low, &high, to - from, d_from, d_to);
            self.place(&numbers, &low, &high, (k, from), out);
        }
    }

    fn faces(&self, block: u64, first: &[[u64; 2]], out: &mut Vec<[u64; 3]>) {
        let (k, from, to) = self.extent(block);
        let rows = to - from;
        // One row more than the cubes' own, for it belongs to the next band, and the one behind it.
        let (low, high) = (self.layer(k, from, to + 2), self.layer(k + 1, from, to + 2));
        let within = [&low, &high].map(|layer| self.number(layer, layer, rows + 1, 1, 4));
        let between = self.number(&low, &high, rows + 1, 4, 8);
        // The next band's rows are numbered from its own first vertex, not on from this band's.
        let split = rows * self.points;
        let own_end = |numbers: &Numbers| u64::from(numbers.first.get(split).copied().unwrap_or(0));
        let ends = [own_end(&within[0]), own_end(&within[1]), own_end(&between)];
        let id = |at: usize, corner: usize, d: usize| {
            let (di, dj, dk) = (corner & 1, corner >> 1 & 1, corner >> 2);
            let at = at + dj * self.points + di;
            let (numbers, end, section) = match (d >> 2, dk) {
                (0, 0) => (&within[0], ends[0], 0),
                (0, _) => (&within[1], ends[1], 0),
                _ => (&between, ends[2], 1),
            };
            let next_band = u64::from(at >= split);
            let owner = block + dk as u64 * self.n_bands() + next_band;
            let before = (numbers.mask[at] & ((1 << d) - 1)).count_ones();
            first[owner as usize][section] + u64::from(numbers.first[at] + before) - next_band * end
        };
        cubes(self.points, rows, &low, &high, |at, inside| {
            for (corners, negative) in &TETRAHEDRA {
                let crossings = CROSSINGS[set(corners, inside)];
                if crossings.is_empty() {
                    continue;
                }
                let mut ids = [0; 4];
                for (slot, (a, b)) in ids.iter_mut().zip(crossings) {
                    let (a, b) = (corners[*a.min(b)], corners[*a.max(b)]);
                    *slot = id(at, a, b - a);
                }
                if *negative {
                    ids[..crossings.len()].reverse();
                }
                out.push([ids[0], ids[1], ids[2]]);
                if crossings.len() == 4 {
                    out.push([ids[0], ids[2], ids[3]]);
                }
            }
        });
    }
}

/// Calls `visit` for each cube that the surface crosses, with the place of its lowest corner in the
/// layer and the set of its inside corners.
fn cubes(n: usize, rows: usize, low: &Layer, high: &Layer, mut visit: impl FnMut(usize, u8)) {
    for j in 0..rows {
        for i in 0..n - 1 {
            let at = j * n + i;
            let mut inside = 0u8;
            for (corner, layer) in [(0, low), (4, high)] {
                for (bit, step) in [(0, 0), (1, 1), (2, n), (3, n + 1)] {
                    inside |= u8::from(layer.values[at + step] < 0.0) << (corner + bit);
                }
            }
            if inside != 0 && inside != 255 {
                visit(at, inside);
            }
        }
    }
}

/// The set of inside corners of a tetrahedron out of that of its cube.
fn set(corners: &[usize; 4], inside: u8) -> usize {
    (0..4).map(|n| usize::from(inside >> corners[n] & 1) << n).sum()
}

/// Sine and cosine by their series; for |x| <= 4 exact to 1e-10.
fn series(x: f64) -> (f64, f64) {
    let (mut sin, mut cos, mut term) = (0.0, 0.0, 1.0);
    for n in 1..40 {
        match n % 4 {
            1 => cos += term,
            2 => sin += term,
            3 => cos -= term,
            _ => sin -= term,
        }
        term *= x / f64::from(n);
    }
    (sin, cos)
}
