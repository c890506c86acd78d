//! Voxel values: a closed-form folded body in air, seen by a noisy scanner.
//!
//! The body is an ellipsoid with a bumpy skin, filled with a labyrinth of folds that is open to the air where the
//! skin has gaps. Tissue and air are not uniform: bright and dark regions bring the noise nearer to the level
//! here and there, which is where specks come in swarms. The scanner adds noise to both parts of a complex
//! value and keeps the magnitude (Rician noise), smoothed over a voxel within a slice as by interpolation after the
//! Fourier transform, and independent from slice to slice.
//!
//! Source: Gudbjartsson & Patz 1995 for the noise (docs/references.md).

use super::super::noise::add_noise3_row;
use stonecut_mesh::scatter::hash;

/// Value of tissue; the level is half of it. A scale on which whole numbers make a tenth of all triangles degenerate,
/// as in a real MRI.
const TISSUE: f32 = 60.0;
/// The level whose isosurface is taken: a whole number, so that whole voxel values can meet it.
const LEVEL: f32 = 30.0;
/// Standard deviation of the noise at `--noise 1`.
const NOISE: f32 = 7.7;
/// Thickness of a slice in voxel widths.
const SLICE: f64 = 1.5;
/// The body's semi-axes and the faces of the box around it, in radii: cut off below and behind, free elsewhere.
const BODY: [f64; 3] = [0.80, 1.0, 0.92];
const BOX: [[f64; 2]; 3] = [[-0.92, 0.92], [-0.93, 1.08], [-0.60, 1.0]];

/// A scanned volume.
pub(super) struct Field {
    /// Voxels along each axis.
    pub(super) voxels: [usize; 3],
    /// The body's radius in voxel widths.
    radius: f64,
    seed: u64,
    noise: f32,
    integer: bool,
}

impl Field {
    /// A body with a radius of this many voxel widths.
    pub(super) fn new(radius: f64, seed: u64, noise: f64, integer: bool) -> Self {
        let spacing = [1.0, 1.0, SLICE];
        let voxels = [0, 1, 2].map(|axis| {
            let [low, high] = BOX[axis];
            (((high - low) * radius / spacing[axis]) as usize).max(3)
        });
        Field { voxels, radius, seed, noise: noise as f32 * NOISE, integer }
    }

    /// Place of a (fractional) voxel in voxel widths, the body's centre at 0.
    pub(super) fn place(&self, voxel: [f64; 3]) -> [f64; 3] {
        let low = BOX.map(|[low, _]| low * self.radius);
        [voxel[0] + low[0], voxel[1] + low[1], SLICE * voxel[2] + low[2]]
    }

    /// Values less the level of rows `from..to` of a slice; rows and slices beyond the volume are left out.
    pub(super) fn rows(&self, k: usize, from: usize, to: usize) -> Vec<f32> {
        let width = self.voxels[0];
        let to = to.min(self.voxels[1]);
        if k >= self.voxels[2] {
            return Vec::new();
        }
        let mut values = vec![0.0; width * to.saturating_sub(from)];
        let mut scratch = Scratch::new(width);
        for (row, j) in values.chunks_exact_mut(width).zip(from..) {
            self.signal(k, j, row, &mut scratch);
        }
        if self.noise > 0.0 {
            self.add_noise(k, from, &mut values);
        }
        for value in &mut values {
            let read = if self.integer { (*value + 0.5) as i32 as f32 } else { *value };
            *value = read - LEVEL;
        }
        values
    }

    /// The values of a row as a scanner without noise would read them.
    fn signal(&self, k: usize, j: usize, row: &mut [f32], scratch: &mut Scratch) {
        let start = self.place([0.0, j as f64, k as f64]);
        let seed = self.seed as u32 ^ (self.seed >> 32) as u32;
        // Each at its own offset, so that the lattices' nodes do not coincide.
        let noise = |row: &mut [f32], period: f64, weight: f64, salt: u32| {
            row.fill(0.0);
            add(row, start, period, weight, seed, salt);
        };
        noise(&mut scratch.bumps, 0.45 * self.radius, 0.05 * self.radius, 11);
        noise(&mut scratch.skin, 37.0, 7.0, 12);
        noise(&mut scratch.folds, 23.0, 8.0, 13);
        add(&mut scratch.folds, start, 14.0, 5.0, seed, 14);
        add(&mut scratch.folds, start, 8.3, 2.0, seed, 15);
        noise(&mut scratch.tissue, 61.0, 0.3 * f64::from(TISSUE), 16);
        noise(&mut scratch.air, 47.0, 0.65 * f64::from(LEVEL), 17);
        let [x, y, z] = start;
        let rest = (y / BODY[1]) * (y / BODY[1]) + (z / BODY[2]) * (z / BODY[2]);
        let width = BODY[0] * self.radius;
        for (i, value) in row.iter_mut().enumerate() {
            let x = (x + i as f64) / BODY[0];
            // Depth below the skin, exact at the skin along x.
            let depth = width - 0.8 * (x * x + rest).sqrt();
            let depth = depth as f32 + scratch.bumps[i];
            let folded = (2.5 + scratch.skin[i] - depth).max(scratch.folds[i] + 0.6);
            let inside = (0.5 + 0.55 * depth.min(folded)).clamp(0.0, 1.0);
            let tissue = 0.95 * TISSUE + scratch.tissue[i];
            let air = (0.3 * LEVEL + scratch.air[i]).max(0.0);
            *value = air + (tissue - air) * inside;
        }
    }

    /// Makes each value the magnitude of itself and noise.
    fn add_noise(&self, k: usize, from: usize, values: &mut [f32]) {
        let width = self.voxels[0];
        let padded = width + 2;
        let n_rows = values.len() / width;
        let first = (k * (self.voxels[1] + 2) + from) * padded;
        // One row and one column more on either side, for the smoothing.
        let white: Vec<[f32; 2]> = (0..(n_rows + 2) * padded)
            .map(|at| two_gauss(hash((first + at) as u64 ^ hash(self.seed))))
            .collect();
        let along: Vec<[f32; 2]> = white.windows(3).map(|w| blend([w[0], w[1], w[2]])).collect();
        for (j, row) in values.chunks_exact_mut(width).enumerate() {
            for (i, value) in row.iter_mut().enumerate() {
                let [real, imaginary] =
                    blend([0, 1, 2].map(|dj| along[(j + dj) * padded + i])).map(|n| n * self.noise);
                let real = *value + real;
                *value = (real * real + imaginary * imaginary).sqrt();
            }
        }
    }
}

/// Binomial smoothing that keeps the variance of white noise.
fn blend([a, b, c]: [[f32; 2]; 3]) -> [f32; 2] {
    // 1, 2, 1 over the root of 6.
    [0, 1].map(|n| 0.408_248_3 * (a[n] + 2.0 * b[n] + c[n]))
}

/// Two independent, nearly normal values of variance 1: each the sum of three uniform ones of ten bits.
fn two_gauss(hash: u64) -> [f32; 2] {
    let sum = |shift: u32| {
        let field = |n: u32| (hash >> (shift + 10 * n)) as u32 & 0x3FF;
        (field(0) + field(1) + field(2)) as f32 * (2.0 / 1023.0) - 3.0
    };
    [sum(0), sum(30)]
}

fn add(row: &mut [f32], start: [f64; 3], period: f64, weight: f64, seed: u32, salt: u32) {
    let shift = 0.37 * f64::from(salt);
    let start = start.map(|x| x / period + shift);
    add_noise3_row(row, start, 1.0 / period, seed ^ salt.wrapping_mul(0x9E37_79B9), weight);
}

/// Rows of noise, kept for their memory.
struct Scratch {
    bumps: Vec<f32>,
    skin: Vec<f32>,
    folds: Vec<f32>,
    tissue: Vec<f32>,
    air: Vec<f32>,
}

impl Scratch {
    fn new(width: usize) -> Self {
        let row = || vec![0.0; width];
        Scratch { bumps: row(), skin: row(), folds: row(), tissue: row(), air: row() }
    }
}
