//! Density of the input's images, by area.

use stonecut_measure::sums::Sum;

/// Density of the texels of a bake.
#[derive(Clone, Copy, Debug)]
pub(super) struct Density {
    /// Texels per unit of length that a bake aims at.
    pub wanted: f64,
    /// Those of the original's images, by area.
    pub of_images: Option<f64>,
}

/// Texels for a pixel of the images at most: an image that repeats a hundred times is not wanted as often.
pub(super) const MOST_TEXELS: f64 = 4.0;

/// Area and texels by the density of the texels: bins of half an octave.
pub(super) struct Densities(Vec<[Sum; 2]>);

impl Densities {
    /// Bins, and the one of a texel a unit.
    const N: usize = 256;
    const MIDDLE: f64 = 128.0;
    /// This share of the area, the densest, does not count: a few triangles with odd coordinates are not the scan.
    const SKIPPED: f64 = 0.01;

    pub fn new(diagonal: f64) -> Densities {
        let most = diagonal * diagonal;
        let densest = |bin: usize| (bin as f64 + 1.0 - Self::MIDDLE).exp2();
        Densities((0..Self::N).map(|bin| [Sum::new(most), Sum::new(most * densest(bin))]).collect())
    }

    pub fn add(&mut self, area: f64, per_unit: f64) {
        let bin = (2.0 * per_unit.log2() + Self::MIDDLE).floor();
        if (0.0..Self::N as f64).contains(&bin) {
            let [areas, texels] = &mut self.0[bin as usize];
            areas.add(area);
            texels.add(area * per_unit * per_unit);
        }
    }

    pub fn merge(&mut self, other: &Densities) {
        let pairs = self.0.iter_mut().flatten().zip(other.0.iter().flatten());
        pairs.for_each(|(all, sum)| all.merge(sum));
    }

    /// Root of texels over area; NaN without any area.
    pub fn mean(&self, n_pixels: u64) -> f64 {
        let all: f64 = self.0.iter().map(|[area, _]| area.value()).sum();
        let (mut skip, mut area, mut texels) = (Self::SKIPPED * all, 0.0, 0.0);
        for [areas, of_bin] in self.0.iter().rev() {
            let counted = (areas.value() - skip).max(0.0);
            skip = (skip - areas.value()).max(0.0);
            if counted > 0.0 {
                area += counted;
                texels += of_bin.value() * (counted / areas.value());
            }
        }
        let most = MOST_TEXELS * n_pixels as f64 / all;
        (texels / area).min(most).sqrt()
    }
}
