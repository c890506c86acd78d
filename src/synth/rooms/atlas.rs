//! The texture atlas: a square slot for every chart, on several images.
//!
//! Slots are equal squares, filled in the order of charts, each turned by a random quarter. An image is
//! computed pixel by pixel from the panels its slots show, beyond a chart's own border too, so that filtering finds
//! nothing foreign there.

use crate::noise::hash2;

/// Squares along a chart, before its borders are made ragged.
pub(super) const CHART: usize = 11;
/// Squares by which a border strays at most.
pub(super) const STRAY: usize = 3;
/// Squares along the box around a chart.
pub(super) const REACH: usize = CHART + 2 * STRAY;

/// Pixels along a square of a panel.
const PIXELS_PER_SQUARE: usize = 4;
/// Pixels between a slot's rim and the box around its chart.
const RIM: usize = 2;
/// Pixels along a slot.
pub(super) const SLOT: usize = REACH * PIXELS_PER_SQUARE + 2 * RIM;
/// The widest image that programs and graphics cards take.
const WIDEST: usize = 16_384;

/// Slots of all images.
#[derive(Clone, Copy, Debug)]
pub(in super::super) struct Atlas {
    pub(in super::super) n_pages: u64,
    pub(super) n_charts: u64,
    /// Slots along an image.
    pub(super) across: u64,
}

/// Place of one chart in the atlas.
#[derive(Clone, Copy, Debug)]
pub(super) struct Chart {
    pub(super) page: u64,
    /// The slot's upper left pixel.
    pub(super) corner: [usize; 2],
    /// Quarter turns.
    turn: u64,
    /// Pixels along the image.
    width: usize,
}

impl Atlas {
    /// Slots for `n_charts` charts on at most `n_pages` images.
    pub(super) fn new(n_charts: u64, n_pages: u64) -> Self {
        let on_page = n_charts.div_ceil(n_pages.max(1)).max(1);
        let mut across = on_page.isqrt();
        across += u64::from(across * across < on_page);
        Atlas { n_pages: n_charts.div_ceil(across * across), n_charts, across }
    }

    /// Pixels along an image.
    pub(super) fn width(&self) -> usize {
        self.across as usize * SLOT
    }

    /// The least number of images, if these are too wide.
    pub(in super::super) fn least_pages(&self) -> Option<u64> {
        let most = (WIDEST / SLOT) as u64;
        (self.width() > WIDEST).then(|| self.n_charts.div_ceil(most * most))
    }

    /// The place of a chart.
    pub(super) fn chart(&self, number: u64, seed: u64) -> Chart {
        let on_page = self.across * self.across;
        let slot = number % on_page;
        Chart {
            page: number / on_page,
            corner: [slot % self.across, slot / self.across].map(|n| n as usize * SLOT),
            turn: hash2(number, seed ^ 0x7475_726E) % 4,
            width: self.width(),
        }
    }
}

impl Chart {
    /// Texture coordinates of a place in squares within the box around the chart; the second counts from below.
    pub(super) fn uv(&self, local: [f64; 2]) -> [f32; 2] {
        let [x, y] = turned(local.map(|x| x / REACH as f64), self.turn);
        let pixel = |n: usize, x: f64| {
            (self.corner[n] + RIM) as f64 + x * (REACH * PIXELS_PER_SQUARE) as f64
        };
        let width = self.width as f64;
        [(pixel(0, x) / width) as f32, (1.0 - pixel(1, y) / width) as f32]
    }

    /// The place in squares of the middle of a pixel of the slot.
    pub(super) fn local(&self, pixel: [usize; 2]) -> [f64; 2] {
        let unit =
            pixel.map(|n| (n as f64 + 0.5 - RIM as f64) / (REACH * PIXELS_PER_SQUARE) as f64);
        turned(unit, (4 - self.turn) % 4).map(|x| x * REACH as f64)
    }
}

/// A place in the unit square after some quarter turns about its middle.
fn turned([x, y]: [f64; 2], quarters: u64) -> [f64; 2] {
    match quarters {
        0 => [x, y],
        1 => [1.0 - y, x],
        2 => [1.0 - x, 1.0 - y],
        _ => [y, 1.0 - x],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pixel_of_a_slot_shows_the_place_whose_texture_coordinates_lie_in_it() {
        let atlas = Atlas::new(50, 3);
        for number in 0..50 {
            let chart = atlas.chart(number, 4);
            assert!(chart.page < atlas.n_pages && atlas.n_pages <= 3);
            for pixel in [[5, 9], [40, 3], [70, 71]] {
                let [u, v] = chart.uv(chart.local(pixel)).map(f64::from);
                let width = atlas.width() as f64;
                let found = [u * width, (1.0 - v) * width];
                for n in 0..2 {
                    let wanted = (chart.corner[n] + pixel[n]) as f64 + 0.5;
                    assert!((found[n] - wanted).abs() < 0.01, "{number}: {found:?} for {pixel:?}");
                }
            }
        }
    }
}
