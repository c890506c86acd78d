//! Lays all samples on the nearest triangles of the whole surface.

use super::surface::Surface;
use stonecut_measure::tree::{Nearest, Tree};
use stonecut_measure::triangle;
use stonecut_mesh::vec3::{dot, length_sq, sub};
use stonecut_system::error::Result;
use stonecut_system::parallel::in_blocks;
use stonecut_system::progress::Progress;

/// A triangle whose normal is farther from that of a sample than this cosine shows it its back.
const BACK: f64 = -0.5;

/// A sample that is farther from its triangle than this share of the longest edge belongs to something that is gone.
const APART: f64 = 0.5;

/// Samples that go to a thread together.
const BLOCK: usize = 16_384;

/// Lays all samples on the surface for the first time; gives the number of those that do not count.
pub(super) fn first(surface: &mut Surface, threads: usize, progress: &Progress) -> Result<u64> {
    lay(surface, true, threads, progress)
}

/// The same for those that count.
pub(super) fn again(surface: &mut Surface, threads: usize, progress: &Progress) -> Result<()> {
    lay(surface, false, threads, progress).map(|_| ())
}

fn lay(surface: &mut Surface, is_first: bool, threads: usize, progress: &Progress) -> Result<u64> {
    let tree = Tree::build_until(surface.triangles.len(), |t| surface.corners(t as u32), progress)?;
    let n = surface.samples.len();
    let mut found: Vec<(u32, f32)> = Vec::with_capacity(n);
    in_blocks((n, BLOCK), (threads, progress), &mut found, |some, out| {
        out.extend(some.map(|s| {
            let counts = is_first || surface.distance_sq[s].is_finite();
            let point = surface.samples[s].at();
            let nearest = counts.then(|| tree.nearest(point, Nearest::NONE));
            match nearest.filter(|found| !is_first || belongs(surface, &tree, s, found)) {
                Some(nearest) => (tree.id(nearest.slot), nearest.distance_sq as f32),
                None => (u32::MAX, f32::INFINITY),
            }
        }));
        Ok(())
    })?;
    surface.clear();
    let mut n_apart = 0;
    for (sample, (triangle, distance_sq)) in found.into_iter().enumerate() {
        match triangle {
            u32::MAX => {
                surface.distance_sq[sample] = f32::INFINITY;
                n_apart += 1;
            }
            _ => surface.put_on(sample as u32, triangle, distance_sq),
        }
    }
    Ok(n_apart)
}

/// True if a sample belongs to the triangle that is nearest to it.
fn belongs(surface: &Surface, tree: &Tree, sample: usize, nearest: &Nearest) -> bool {
    let corners = tree.corners(nearest.slot);
    let [a, b, c] = *corners;
    let longest = length_sq(sub(b, a)).max(length_sq(sub(c, b))).max(length_sq(sub(a, c)));
    let (own, other) = (surface.samples[sample].normal(), triangle::area_normal(corners));
    nearest.distance_sq <= APART * APART * longest
        && dot(other, own) >= BACK * length_sq(other).sqrt()
}
