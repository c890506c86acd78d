//! `terrain`: an open height field, mountains as an airborne scanner would see them.
//!
//! A grid of width x height points in row order, metres, z up. The ground is a sum of octaves of
//! gradient noise in which steep places get less of the finer octaves, so that ridges stay sharp and
//! valleys smooth; every point is moved off its lattice place and carries range noise.

use super::noise::{gauss, hash2, noise2_slope, noise3, signed3, smoothstep};
use super::surface::{Indexed, Vertex};

/// Kilometres would be neater, but scans come in metres: the long side of every terrain.
const EXTENT: f64 = 20_000.0;
/// Octaves of the ground: from 6 km down to 3 m.
const OCTAVES: u32 = 11;

/// A height field over a grid.
pub(super) struct Terrain {
    width: u64,
    height: u64,
    /// Grid spacing in metres.
    spacing: f64,
    seed: u64,
    colored: bool,
    has_sea: bool,
    /// Factor of the usual noise.
    noise: f64,
}

impl Terrain {
    /// The height field whose triangle count is the nearest to `n_triangles` from above among grids
    /// whose sides differ by at most a third. With a sea, all ground below 0 is water at exactly 0. `noise` is a factor of
    /// the usual one.
    pub(super) fn new(
        n_triangles: u64,
        seed: u64,
        colored: bool,
        (has_sea, noise): (bool, f64),
    ) -> Self {
        let quads = n_triangles.div_ceil(2).max(1);
        let side = (quads as f64).sqrt() as u64;
        // Among the widths from square to 4:3 (at most 2,000 of them), the one that wastes least.
        let widths = side.max(1)..=(side + (side / 7).min(2000)).max(1);
        let width = widths
            .min_by_key(|width| (quads.div_ceil(*width) * width - quads, *width))
            .expect("a range with both ends has a member");
        let height = quads.div_ceil(width);
        let spacing = EXTENT / width.max(height) as f64;
        Terrain { width: width + 1, height: height + 1, spacing, seed, colored, has_sea, noise }
    }

    /// Height above the sea and steepness (1 = 45 degrees) of the ground.
    fn ground(&self, x: f64, y: f64) -> (f64, f64) {
        let seed = self.seed as u32 ^ (self.seed >> 32) as u32;
        let mut point = [x / 6000.0, y / 6000.0];
        let mut height = 0.0;
        let mut slope = [0.0, 0.0];
        let mut amplitude = 1.0;
        for octave in 0..OCTAVES {
            let [value, dx, dy] = noise2_slope(point, seed.wrapping_add(octave * 0x9E37));
            slope[0] += 0.7 * dx;
            slope[1] += 0.7 * dy;
            height += amplitude * value / (1.0 + slope[0] * slope[0] + slope[1] * slope[1]);
            amplitude *= 0.48;
            // Each octave is turned by 36.87 degrees, or lattice lines of all octaves would coincide.
            point = [1.6 * point[0] - 1.2 * point[1], 1.2 * point[0] + 1.6 * point[1]];
        }
        (2600.0 * height, slope[0] * slope[0] + slope[1] * slope[1])
    }

    fn color(&self, p: [f64; 3], steep: f64) -> [u8; 3] {
        let patch = noise3([p[0] / 300.0, p[1] / 300.0, 0.0], 77);
        let rock = smoothstep(0.5, 2.2, steep + 0.2 * patch);
        let snow = smoothstep(500.0, 850.0, p[2] + 120.0 * patch) * (1.0 - 0.6 * rock);
        let blend =
            |a: [f64; 3], b: [f64; 3], t: f64| std::array::from_fn(|i| a[i] + t * (b[i] - a[i]));
        let meadow = blend([0.42, 0.52, 0.27], [0.66, 0.62, 0.40], 0.5 + 0.5 * patch);
        let ground = blend(meadow, [0.60, 0.56, 0.51], rock);
        let tint: [f64; 3] = blend(ground, [0.95, 0.96, 0.98], snow);
        tint.map(|c| (255.0 * c.clamp(0.0, 1.0)) as u8)
    }
}

impl Indexed for Terrain {
    fn n_vertices(&self) -> u64 {
        self.width * self.height
    }

    fn n_faces(&self) -> u64 {
        2 * (self.width - 1) * (self.height - 1)
    }

    fn vertex(&self, id: u64) -> Vertex {
        let (row, column) = (id / self.width, id % self.width);
        let random = hash2(id, self.seed);
        let aside = signed3(random);
        let x = self.spacing * (column as f64 + 0.25 * aside[0]);
        let y = self.spacing * (row as f64 + 0.25 * aside[1]);
        let (z, steep) = self.ground(x, y);
        let noise = self.noise * (0.04 * self.spacing).min(0.15) * gauss(hash2(random, 1));
        let height = z + noise;
        let height = if self.has_sea { height.max(0.0) } else { height };
        let color = if self.colored { self.color([x, y, z], steep) } else { [0; 3] };
        let uv = [column as f32 / (self.width - 1) as f32, row as f32 / (self.height - 1) as f32];
        Vertex { position: [x as f32, y as f32, height as f32], color, uv }
    }

    fn face(&self, row: u64) -> [u64; 3] {
        let (quad, first) = (row / 2, row.is_multiple_of(2));
        let across = self.width - 1;
        let at = (quad / across) * self.width + quad % across;
        let [a, b, c, d] = [at, at + 1, at + self.width, at + self.width + 1];
        // The diagonal's direction is random, as after a triangulation of scattered points.
        let falling = hash2(quad, self.seed ^ 5) & 1 == 0;
        match (falling, first) {
            (true, true) => [a, b, c],
            (true, false) => [b, d, c],
            (false, true) => [a, b, d],
            (false, false) => [a, d, c],
        }
    }
}
