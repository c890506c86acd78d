//! Two pictures pixel by pixel: squared differences, structural similarity.

use stonecut_render::Picture;

/// Largest value of a channel.
const PEAK: f64 = 255.0;

/// Gauss window of 11 x 11 pixels with a standard deviation of 1.5, and the two constants that keep quotients finite.
///
/// Source: Wang et al. 2004, section III.C.
const REACH: usize = 5;
const DEVIATION: f64 = 1.5;
const C1: f64 = (0.01 * PEAK) * (0.01 * PEAK);
const C2: f64 = (0.03 * PEAK) * (0.03 * PEAK);

/// Likeness in one view, or in all.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Likeness {
    /// Peak signal-to-noise ratio in dB; `None` (JSON: null) where no pixel differs.
    pub psnr: Option<f64>,
    /// Structural similarity, 1 where no pixel differs; `None` where nothing is seen.
    pub ssim: Option<f64>,
}

/// Sums over pixels of silhouettes.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Sums {
    n_pixels: f64,
    /// Squared differences, the mean of three channels.
    square: f64,
    similarity: f64,
}

impl Sums {
    /// The sums of two pictures of one size over the pixels of `silhouette`.
    ///
    /// Memory: 48 bytes a pixel.
    pub(super) fn of([a, b]: [&Picture; 2], silhouette: &[bool]) -> Sums {
        let similarity = similarity([a, b]);
        let mut sums = Sums::default();
        let pixels = a.rgb.as_chunks::<3>().0.iter().zip(b.rgb.as_chunks::<3>().0);
        for (((a, b), similarity), _) in
            pixels.zip(similarity).zip(silhouette).filter(|(_, is_seen)| **is_seen)
        {
            let square = |i: usize| (f64::from(a[i]) - f64::from(b[i])).powi(2);
            sums.n_pixels += 1.0;
            sums.square += (square(0) + square(1) + square(2)) / 3.0;
            sums.similarity += similarity;
        }
        sums
    }

    pub(super) fn add(&mut self, other: &Sums) {
        self.n_pixels += other.n_pixels;
        self.square += other.square;
        self.similarity += other.similarity;
    }

    /// The mean squared difference; 0 where nothing is seen.
    pub(super) fn mean_square(&self) -> f64 {
        self.square / self.n_pixels.max(1.0)
    }

    pub(super) fn likeness(&self) -> Likeness {
        let is_seen = self.n_pixels > 0.0;
        let error = Some(self.mean_square()).filter(|error| *error > 0.0);
        Likeness {
            psnr: error.map(|error| 10.0 * (PEAK * PEAK / error).log10()),
            ssim: is_seen.then(|| self.similarity / self.n_pixels),
        }
    }
}

/// Structural similarity of the brightness around each pixel; beyond the border the last pixel goes on.
fn similarity([a, b]: [&Picture; 2]) -> Vec<f64> {
    let (width, height) = (a.width as usize, a.height as usize);
    let bright = |picture: &Picture| -> Vec<f64> {
        let pixels = picture.rgb.as_chunks::<3>().0.iter();
        let weigh = |[r, g, b]: &[u8; 3]| {
            0.299 * f64::from(*r) + 0.587 * f64::from(*g) + 0.114 * f64::from(*b)
        };
        pixels.map(weigh).collect()
    };
    let (a, b) = (bright(a), bright(b));
    let times =
        |a: &[f64], b: &[f64]| -> Vec<f64> { a.iter().zip(b).map(|(a, b)| a * b).collect() };
    let mean = |values: &[f64]| blurred(values, width, height);
    let (aa, bb, ab) = (mean(&times(&a, &a)), mean(&times(&b, &b)), mean(&times(&a, &b)));
    let (a, b) = (mean(&a), mean(&b));
    let each = |i: usize| {
        let (product, squares) = (a[i] * b[i], a[i] * a[i] + b[i] * b[i]);
        let (shared, spread) = (ab[i] - product, aa[i] + bb[i] - squares);
        (2.0 * product + C1) * (2.0 * shared + C2) / ((squares + C1) * (spread + C2))
    };
    (0..a.len()).map(each).collect()
}

/// Means under the Gauss window, first along rows, then along columns.
fn blurred(values: &[f64], width: usize, height: usize) -> Vec<f64> {
    let weight = |k: usize| {
        let far = k as f64 - REACH as f64;
        (-far * far / (2.0 * DEVIATION * DEVIATION)).exp()
    };
    let mut weights: [f64; 2 * REACH + 1] = std::array::from_fn(weight);
    let sum: f64 = weights.iter().sum();
    weights.iter_mut().for_each(|weight| *weight /= sum);
    let mean = |n: usize, at: usize, value: &dyn Fn(usize) -> f64| -> f64 {
        let place = |k: usize| (at + k).saturating_sub(REACH).min(n - 1);
        weights.iter().enumerate().map(|(k, weight)| weight * value(place(k))).sum()
    };
    let mut rows = Vec::with_capacity(values.len());
    for y in 0..height {
        rows.extend((0..width).map(|x| mean(width, x, &|x| values[y * width + x])));
    }
    let mut out = Vec::with_capacity(values.len());
    for y in 0..height {
        out.extend((0..width).map(|x| mean(height, y, &|y| rows[y * width + x])));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pair(a: [u8; 3], b: [u8; 3]) -> Sums {
        let pictures = [a, b].map(|color| Picture::new(30, 20, color));
        Sums::of([&pictures[0], &pictures[1]], &[true; 600])
    }

    #[test]
    fn flat_pictures_have_the_likeness_of_the_formula() {
        let likeness = pair([100, 100, 100], [110, 110, 110]).likeness();
        let psnr = 20.0 * (255.0f64 / 10.0).log10();
        assert!((likeness.psnr.unwrap() - psnr).abs() < 1e-9, "{likeness:?}");
        // No spread: only the means count.
        let ssim = (2.0 * 100.0 * 110.0 + C1) / (100.0f64.powi(2) + 110.0f64.powi(2) + C1);
        assert!((likeness.ssim.unwrap() - ssim).abs() < 1e-9, "{likeness:?}");
        // One channel of three.
        let likeness = pair([100, 100, 100], [100, 100, 130]).likeness();
        assert!((likeness.psnr.unwrap() - 10.0 * (255.0f64.powi(2) / 300.0).log10()).abs() < 1e-9);
        let same = pair([1, 2, 3], [1, 2, 3]).likeness();
        assert_eq!(same.psnr, None);
        assert!((same.ssim.unwrap() - 1.0).abs() < 1e-12);
    }

    /// A checker board of single pixels against its negative: brightness is right, structure is the opposite.
    #[test]
    fn structure_counts_and_only_the_silhouette() {
        let board = |phase: u32| {
            let mut picture = Picture::new(30, 20, [0; 3]);
            for (i, pixel) in picture.rgb.chunks_exact_mut(3).enumerate() {
                let odd = (i as u32 % 30 + i as u32 / 30 + phase) % 2;
                pixel.fill(if odd == 1 { 160 } else { 96 });
            }
            picture
        };
        let boards = [board(0), board(1)];
        let whole = Sums::of([&boards[0], &boards[1]], &[true; 600]).likeness();
        assert!(whole.ssim.unwrap() < -0.8, "{whole:?}");
        let none = Sums::of([&boards[0], &boards[1]], &[false; 600]).likeness();
        assert_eq!(none, Likeness { psnr: None, ssim: None });
    }
}
