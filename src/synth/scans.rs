//! `scans`: overlapping, noisy range scans of the statue, coloured, not yet merged.
//!
//! Each patch is a range image: a square of pixels seen from one side, with a ragged border, holes,
//! lost pixels and specks (outliers floating above the surface), slightly misplaced and differently
//! exposed. A block is a band of rows of one patch; vertices are its valid pixels in row order.

use super::noise::{gauss, hash2, noise3, signed3};
use super::sculpture::Sculpture;
use super::sliced::{BlockCounts, Sliced};
use super::surface::{Vertex, unit_vector};
use stonecut_mesh::scatter::unit;
use stonecut_mesh::vec3::{cross, dot};

/// Triangles of one patch of a large set: about what a structured-light scanner takes at once.
const PATCH_TRIANGLES: u64 = 800_000;
/// Patches of a small set; fewer could not cover the statue.
const LEAST_PATCHES: u64 = 14;
/// Pixels in a block, about.
const BLOCK_PIXELS: usize = 32_768;
/// Triangles per pixel: two, times the share of the square that is valid.
const TRIANGLES_PER_PIXEL: f64 = 1.53;
/// Mean number of patches over a point of the statue.
const COVERAGE: f64 = 2.5;
/// Side of the squares of pixels that have at most one speck each.
const SPECK_SQUARE: usize = 16;

/// A set of range scans.
pub(super) struct Scans {
    patches: Vec<Patch>,
    /// Pixels along each side of a patch.
    side: usize,
    /// Rows of a block.
    rows: usize,
    /// Half the width of a patch, in radii.
    reach: f64,
    seed: u64,
    sculpture: Sculpture,
    /// Standard deviation of the range noise in millimetres.
    noise: f64,
}

/// Position and shape of one patch.
struct Patch {
    /// View direction and the image's two axes.
    axes: [[f64; 3]; 3],
    /// Misplacement in millimetres and, as a rotation vector, in radians.
    shift: [f64; 3],
    turn: [f64; 3],
    /// Brightness of each colour channel.
    exposure: [f64; 3],
}

/// State of a pixel.
#[derive(Clone, Copy, PartialEq)]
enum Pixel {
    Lost,
    Surface,
    /// Part of a floating speck, this many millimetres above the surface.
    Speck(u16),
}

impl Scans {
    /// Scans of about `n_triangles` times `scale`^2 triangles together.
    pub(super) fn new(n_triangles: u64, scale: f64, seed: u64) -> Self {
        let n_patches = n_triangles.div_ceil(PATCH_TRIANGLES).max(LEAST_PATCHES);
        let pixels = n_triangles as f64 / n_patches as f64 / TRIANGLES_PER_PIXEL;
        let side = ((pixels.sqrt() * scale) as usize).max(6) + 1;
        let reach = (std::f64::consts::PI * COVERAGE / n_patches as f64).sqrt().min(0.9);
        let spacing = 2000.0 * reach / side as f64;
        Scans {
            patches: (0..n_patches).map(|k| Patch::new(k, n_patches, seed)).collect(),
            side,
            rows: (BLOCK_PIXELS / side).clamp(1, side),
            reach,
            seed,
            sculpture: Sculpture::new(seed, spacing),
            noise: (0.1 * spacing).min(0.15),
        }
    }

    fn bands(&self) -> u64 {
        self.side.div_ceil(self.rows) as u64
    }

    /// The patch, its number, and the rows of a block.
    fn extent(&self, block: u64) -> (&Patch, usize, usize, usize) {
        let (patch, band) = ((block / self.bands()) as usize, (block % self.bands()) as usize);
        let from = band * self.rows;
        (&self.patches[patch], patch, from, (from + self.rows).min(self.side))
    }

    /// Image coordinates in [-1, 1].
    fn image(&self, pixel: usize) -> f64 {
        2.0 * pixel as f64 / (self.side - 1) as f64 - 1.0
    }

    /// A different number for each pixel of each patch.
    fn random(&self, patch: usize, row: usize, column: usize) -> u64 {
        hash2(((patch * self.side + row) * self.side + column) as u64, self.seed)
    }

    fn pixel(&self, patch: usize, row: usize, column: usize) -> Pixel {
        let (s, t) = (self.image(column), self.image(row));
        let place = [s, t, 10.0 * patch as f64];
        let seed = self.seed as u32;
        let ragged = 0.12 * noise3([5.0 * s, 5.0 * t, place[2]], seed ^ 31);
        if s * s + t * t > 1.0 + ragged {
            return Pixel::Lost;
        }
        let square = (row / SPECK_SQUARE * self.side + column / SPECK_SQUARE) * 2;
        let speck = hash2((patch * self.side * self.side * 2 + square) as u64, self.seed ^ 77);
        if speck.is_multiple_of(12) {
            let [x, y, size] = signed3(hash2(speck, 5));
            let centre = |square: usize, offset: f64| {
                (square * SPECK_SQUARE) as f64 + SPECK_SQUARE as f64 * (0.5 + 0.3 * offset)
            };
            let dx = column as f64 - centre(column / SPECK_SQUARE, x);
            let dy = row as f64 - centre(row / SPECK_SQUARE, y);
            let radius = 2.7 + 1.7 * size;
            if dx * dx + dy * dy < radius * radius {
                return Pixel::Speck(5 + (speck >> 32) as u16 % 40);
            }
        }
        let holes = noise3([9.0 * s, 9.0 * t, place[2]], seed ^ 32)
            + 0.5 * noise3([31.0 * s, 31.0 * t, place[2]], seed ^ 33);
        let lost = holes > 0.72 || self.random(patch, row, column).is_multiple_of(700);
        if lost { Pixel::Lost } else { Pixel::Surface }
    }

    fn rows_of(&self, patch: usize, from: usize, to: usize) -> Vec<Pixel> {
        let to = to.min(self.side);
        let row = |row| (0..self.side).map(move |column| self.pixel(patch, row, column));
        (from..to).flat_map(row).collect()
    }

    fn vertex(
        &self,
        patch: &Patch,
        random: u64,
        (row, column): (usize, usize),
        lift: u16,
    ) -> Vertex {
        let aside = signed3(random);
        let pitch = 2.0 / (self.side - 1) as f64;
        let s = self.reach * (self.image(column) + 0.2 * pitch * aside[0]);
        let t = self.reach * (self.image(row) + 0.2 * pitch * aside[1]);
        let [view, right, up] = patch.axes;
        let ray: [f64; 3] = std::array::from_fn(|i| view[i] + s * right[i] + t * up[i]);
        let length = dot(ray, ray).sqrt();
        let ray = ray.map(|x| x / length);
        let surface = self.sculpture.point(ray);
        let depth = f64::from(lift) + self.noise * gauss(hash2(random, 2));
        let turned = cross(patch.turn, surface);
        let point: [f64; 3] =
            std::array::from_fn(|i| surface[i] + turned[i] + patch.shift[i] + depth * ray[i]);
        let flash = 1.0 - 0.25 * (s * s + t * t) / (self.reach * self.reach);
        let grain = 1.0 + 0.03 * gauss(hash2(random, 3));
        let stone = self.sculpture.color(surface);
        let color = std::array::from_fn(|i| {
            (f64::from(stone[i]) * flash * grain * patch.exposure[i]).clamp(0.0, 255.0) as u8
        });
        let uv = [self.image(column), self.image(row)].map(|x| (0.5 + 0.5 * x) as f32);
        Vertex { position: point.map(|x| x as f32), color, uv }
    }
}

impl Patch {
    /// Patch `k` of `n`: views spread over the sphere on a spiral of equal areas.
    fn new(k: u64, n: u64, seed: u64) -> Self {
        let height = 1.0 - (2.0 * k as f64 + 1.0) / n as f64;
        let radius = (1.0 - height * height).sqrt();
        // Steps of the golden angle, by repeated rotation without the library's trigonometry.
        let (mut x, mut y) = (1.0f64, 0.0f64);
        let (cos, sin) = (-0.737_368_878_078_320_1, 0.675_490_294_261_523_8);
        for _ in 0..k {
            (x, y) = (x * cos - y * sin, x * sin + y * cos);
        }
        let view = [radius * x, radius * y, height];
        let random = hash2(k, seed ^ 11);
        let helper = signed3(random);
        let right = unit_vector(cross(view, helper));
        let up = cross(view, right);
        let brightness = 0.85 + 0.25 * unit(hash2(random, 1));
        let tint = signed3(hash2(random, 2)).map(|x| brightness * (1.0 + 0.05 * x));
        Patch {
            axes: [view, right, up],
            shift: signed3(hash2(random, 3)).map(|x| 0.4 * x),
            turn: signed3(hash2(random, 4)).map(|x| 0.0004 * x),
            exposure: tint,
        }
    }
}

impl Sliced for Scans {
    fn n_blocks(&self) -> u64 {
        self.patches.len() as u64 * self.bands()
    }

    fn count(&self, block: u64) -> BlockCounts {
        let (_, patch, from, to) = self.extent(block);
        let pixels = self.rows_of(patch, from, to + 1);
        let own = (to - from) * self.side;
        let vertices = pixels[..own].iter().filter(|p| **p != Pixel::Lost).count() as u64;
        let mut faces = 0;
        triangles(&pixels, self.side, |_| faces += 1);
        BlockCounts { vertices: [vertices, 0], faces }
    }

    fn vertices(&self, block: u64, out: &mut Vec<Vertex>) {
        let (patch, number, from, to) = self.extent(block);
        let pixels = self.rows_of(number, from, to);
        for (at, pixel) in pixels.into_iter().enumerate() {
            let (row, column) = (from + at / self.side, at % self.side);
            let lift = match pixel {
                Pixel::Lost => continue,
                Pixel::Surface => 0,
                Pixel::Speck(lift) => lift,
            };
            out.push(self.vertex(patch, self.random(number, row, column), (row, column), lift));
        }
    }

    fn faces(&self, block: u64, first: &[[u64; 2]], out: &mut Vec<[u64; 3]>) {
        let (_, patch, from, to) = self.extent(block);
        let pixels = self.rows_of(patch, from, to + 1);
        let mut next = first[block as usize][0];
        let ids: Vec<u64> = pixels
            .iter()
            .map(|pixel| {
                let id = next;
                next += u64::from(*pixel != Pixel::Lost);
                id
            })
            .collect();
        triangles(&pixels, self.side, |corners| out.push(corners.map(|at| ids[at])));
    }
}

/// Calls `emit` with the pixels of each triangle, counter-clockwise seen from outside. A square of four
/// pixels of one kind is two triangles, one of three is one.
fn triangles(pixels: &[Pixel], side: usize, mut emit: impl FnMut([usize; 3])) {
    for at in 0..pixels.len().saturating_sub(side) {
        if at % side == side - 1 {
            continue;
        }
        let square = [at, at + 1, at + side + 1, at + side];
        let joined = |triangle: [usize; 3]| {
            let [a, b, c] = triangle.map(|n| pixels[square[n]]);
            a != Pixel::Lost && a == b && b == c
        };
        let choices = [[[0, 1, 2], [0, 2, 3]], [[1, 2, 3], [1, 3, 0]]];
        // Both diagonals are tried: with one corner missing, only one of them has a triangle left.
        let kept = choices.map(|pair| pair.into_iter().filter(|t| joined(*t)).count());
        let pair = choices[usize::from(kept[1] > kept[0])];
        for triangle in pair.into_iter().filter(|t| joined(*t)) {
            emit(triangle.map(|n| square[n]));
        }
    }
}
