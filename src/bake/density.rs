//! Density of the input's images, by area.

use std::collections::BTreeMap;
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

/// Points for a side of a texel: one where the page is as dense as the original's images, more where these are denser.
/// Beyond, smaller sizes of them are read.
const SIDES: [u32; 2] = [1, 2];

/// Pixels of the original between points at most.
pub(super) const MOST_APART: [f64; 2] = [1.1, 0.75];

/// Points for a side of a texel without images.
const PLAIN_SIDE: u32 = 2;

/// Area that each image covers, by the density of its pixels there.
#[derive(Default)]
pub(super) struct ImageDensities(BTreeMap<(usize, i32), Sum>);

impl ImageDensities {
    /// Bins of a doubling.
    const BINS: f64 = 8.0;
    /// This share of an image's area, the one with the fewest pixels, may be shown by a smaller size of it.
    const SPARSE: f64 = 0.005;

    /// Adds an area, `most` at most, with `per_unit` pixels of an image a unit of length.
    pub fn add(&mut self, image: usize, (area, most): (f64, f64), per_unit: f64) {
        let is_known = per_unit > 0.0 && per_unit.is_finite();
        let bin = if is_known { (Self::BINS * per_unit.log2()).floor() as i32 } else { i32::MIN };
        self.0.entry((image, bin)).or_insert_with(|| Sum::new(most)).add(area);
    }

    pub fn merge(&mut self, other: ImageDensities) {
        for (key, sum) in other.0 {
            self.0.entry(key).and_modify(|all| all.merge(&sum)).or_insert(sum);
        }
    }

    /// Halvings of an image with which nearly all of its area is looked up at least, where `n` points a unit of length look.
    pub fn halvings(&self, image: usize, n: f64) -> u32 {
        let own = || self.0.range((image, i32::MIN)..=(image, i32::MAX));
        let mut left: f64 = Self::SPARSE * own().map(|(_, area)| area.value()).sum::<f64>();
        let is_more = |(_, area): &(&(usize, i32), &Sum)| {
            left -= area.value();
            left < 0.0
        };
        let least = own().find(is_more).map_or(i32::MIN, |((_, bin), _)| *bin);
        (f64::from(least) / Self::BINS - n.log2()).round().max(0.0) as u32
    }
}

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

/// Points for a side of a texel of pages of `texels_per_unit`.
pub(super) fn points_of_side(of_images: Option<f64>, texels_per_unit: f64) -> u32 {
    let Some(of_images) = of_images else { return PLAIN_SIDE };
    let ratio = of_images / texels_per_unit;
    let is_enough = |(side, most): &(u32, f64)| ratio <= most * f64::from(*side);
    let side = SIDES.into_iter().zip(MOST_APART).find(is_enough);
    side.map_or(SIDES[SIDES.len() - 1], |(side, _)| side)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_image_is_halved_as_often_as_nearly_all_of_it_is_looked_up() {
        let mut found = ImageDensities::default();
        for (image, area, per_unit) in [
            (0, 1.0, 801.0),
            (0, 0.004, 3.0),
            (1, 1.0, 801.0),
            (1, 0.01, 201.0),
            (2, 1.0, f64::NAN),
        ] {
            let mut some = ImageDensities::default();
            some.add(image, (area, 1.0), per_unit);
            found.merge(some);
        }
        // 801 pixels for 100 points are three halvings; 201 for as many are one.
        assert_eq!([0, 1, 2, 3].map(|image| found.halvings(image, 100.0)), [3, 1, 0, 0]);
        assert_eq!([300.0, 800.0, 1e4].map(|n| found.halvings(0, n)), [1, 0, 0]);
    }
}
