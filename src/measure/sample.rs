//! Area-uniform samples of a surface, the same whatever the order of its triangles.
//!
//! Number and places of the samples of a triangle follow from a hash of its corners, the seed and the
//! density. So a shuffled file, or a surface cut into cells, yields the same set of samples. Knows
//! nothing of what is measured at them.

// Three axes (and eight lanes) run through several arrays side by side; an index shows that best.
#![allow(clippy::needless_range_loop)]

use super::triangle::{self, Vector};
use std::ops::Range;
use stonecut_mesh::bounds::Bounds;
use stonecut_mesh::morton::spread;
use stonecut_mesh::scatter;
use stonecut_system::error::Result;

/// A point on a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Position of the sample.
    pub point: Vector,
    /// Its barycentric coordinates in the canonical corners of its triangle; they sum to 1.
    pub weights: [f32; 2],
    /// The number of its triangle in the block that is being sampled.
    pub triangle: u32,
}

/// Density of the samples of a surface.
#[derive(Clone, Copy, Debug)]
pub struct Density {
    per_area: f64,
    seed: u64,
}

impl Density {
    /// About `samples` samples on a surface of `total_area`; none if it has no area.
    ///
    /// A triangle of area A gets floor(A * density + u), u uniform in [0, 1): the expected number is
    /// exactly in proportion to the area, and the total deviates from `samples` by less than its root.
    pub fn new(samples: u64, total_area: f64, seed: u64) -> Self {
        let usable = total_area > 0.0 && total_area.is_finite();
        Density { per_area: if usable { samples as f64 / total_area } else { 0.0 }, seed }
    }

    /// Hands the samples of `triangles` to `work` in runs of at most `most` (at least 1), which it may keep
    /// or reorder; `corners_of` gives canonical corners. A run does not end with its triangle: one large
    /// triangle may have more samples than memory holds. Samples number their triangles from the first.
    pub fn in_runs(
        &self,
        triangles: Range<usize>,
        corners_of: impl Fn(usize) -> [Vector; 3],
        most: usize,
        mut work: impl FnMut(&mut Vec<Sample>) -> Result<()>,
    ) -> Result<()> {
        let mut run = Vec::new();
        let first = triangles.start;
        for i in triangles {
            let corners = corners_of(i);
            let spread = self.spread(&corners);
            let mut done = 0;
            while done < spread.count {
                let end = spread.count.min(done + most.saturating_sub(run.len()).max(1) as u64);
                spread.sample(&corners, (i - first) as u32, done..end, &mut run);
                done = end;
                if run.len() >= most {
                    work(&mut run)?;
                    run.clear();
                }
            }
        }
        if run.is_empty() { Ok(()) } else { work(&mut run) }
    }

    /// Returns the number of samples of a triangle and the first of them.
    ///
    /// Several samples of one triangle are spread by the R2 sequence, which covers it more evenly than
    /// independent points would, from a start that differs from triangle to triangle.
    ///
    /// Source: Roberts 2018 for the sequence (docs/references.md).
    fn spread(&self, corners: &[Vector; 3]) -> Spread {
        let expected = triangle::area(corners) * self.per_area;
        // A sliver of the float kind, never a sample: also keeps NaN out.
        if !(expected > 0.0 && expected < 1e15) {
            return Spread::default();
        }
        let hash = self.hash(corners);
        let count = (expected + scatter::unit(hash)) as u64;
        if count == 0 {
            return Spread::default();
        }
        let start = [scatter::hash(hash ^ 0x9e37_79b9), scatter::hash(hash ^ 0x7f4a_7c15)]
            .map(scatter::unit);
        Spread { count, start }
    }

    fn hash(&self, corners: &[Vector; 3]) -> u64 {
        // Adding 0 makes both zeros one.
        let bits = corners.map(|c| c.map(|x| (x + 0.0).to_bits()));
        xxhash_rust::xxh3::xxh3_64_with_seed(bytemuck::bytes_of(&bits), self.seed)
    }
}

/// The samples of one triangle.
#[derive(Clone, Copy, Debug, Default)]
struct Spread {
    count: u64,
    start: [f64; 2],
}

impl Spread {
    /// Appends some of the samples.
    fn sample(
        &self,
        corners: &[Vector; 3],
        triangle: u32,
        some: Range<u64>,
        out: &mut Vec<Sample>,
    ) {
        for i in some {
            // 1/g and 1/g^2, g the root of g^3 = g + 1.
            let u = (self.start[0] + i as f64 * 0.754_877_666_246_692_7).fract();
            let v = (self.start[1] + i as f64 * 0.569_840_290_998_053_2).fract();
            let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
            let point = triangle::point_at(corners, [1.0 - u - v, u, v]);
            out.push(Sample { point, weights: [u as f32, v as f32], triangle });
        }
    }
}

/// Sorts samples along a space-filling curve through their box, so that neighbours follow each other.
///
/// Speed only: every sample's own result is independent of the order.
pub fn sort_along_curve(samples: &mut Vec<Sample>) {
    let points: Vec<Vector> = samples.iter().map(|sample| sample.point).collect();
    *samples = order_along_curve(&points).iter().map(|&i| samples[i as usize]).collect();
}

/// The order of points along a space-filling curve through their box.
pub fn order_along_curve(points: &[Vector]) -> Vec<u32> {
    let bounds = Bounds::around(points);
    let (low, reach) = (bounds.low, bounds.side());
    let scale = if reach > 0.0 { 1023.0 / reach } else { 0.0 };
    let key = |point: &Vector| {
        let cell = [0, 1, 2].map(|k| spread(((point[k] - low[k]) * scale) as u32));
        cell[0] << 2 | cell[1] << 1 | cell[2]
    };
    let mut order: Vec<(u32, u32)> =
        points.iter().enumerate().map(|(i, point)| (key(point), i as u32)).collect();
    order.sort_unstable();
    order.into_iter().map(|(_, i)| i).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    impl Density {
        /// All samples of one triangle.
        fn sample(&self, corners: &[Vector; 3], triangle: u32, out: &mut Vec<Sample>) {
            let spread = self.spread(corners);
            spread.sample(corners, triangle, 0..spread.count, out);
        }
    }

    #[test]
    fn runs_are_bounded_and_miss_nothing() {
        let large = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let corners = |i: usize| if i == 5 { large } else { large.map(|c| c.map(|x| x * 0.1)) };
        let density = Density::new(5000, 0.6, 3);
        let mut wanted = Vec::new();
        (3..9).for_each(|i| density.sample(&corners(i), i as u32 - 3, &mut wanted));
        for most in [1, 7, 1000, 100_000] {
            let (mut all, mut longest) = (Vec::new(), 0);
            let gather = |run: &mut Vec<Sample>| {
                longest = longest.max(run.len());
                all.append(run);
                Ok(())
            };
            density.in_runs(3..9, corners, most, gather).unwrap();
            assert_eq!(all, wanted);
            assert!(longest <= most);
        }
    }

    #[test]
    fn samples_are_uniform_in_area() {
        // A large and a small triangle, and a fan of tiny ones that seldom get any.
        let large = [[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [0.0, 2.0, 0.0]];
        let density = Density::new(1_000_000, 3.0, 5);
        let mut samples = Vec::new();
        density.sample(&large, 0, &mut samples);
        assert!(samples.len().abs_diff(1_000_000) <= 1);
        let mean = [0, 1].map(|k| samples.iter().map(|s| s.point[k]).sum::<f64>() / 1e6);
        assert!((mean[0] - 1.0).abs() < 1e-4 && (mean[1] - 2.0 / 3.0).abs() < 1e-4, "{mean:?}");
        let mut tiny = Vec::new();
        for i in 0..100_000 {
            let x = f64::from(i) * 1e-3;
            let t = [[x, 0.0, 0.0], [x + 1e-3, 0.0, 0.0], [x, 1e-4, 0.0]];
            density.sample(&t, i, &mut tiny);
        }
        // 1e5 triangles of 5e-8: 5e-3 in all, hence 1667 expected; the spread is 41.
        assert!((1500..1830).contains(&tiny.len()), "{}", tiny.len());
    }

    #[test]
    fn no_area_no_samples() {
        let mut samples = Vec::new();
        Density::new(1000, 0.0, 1).sample(&[[0.0; 3]; 3], 0, &mut samples);
        let line = [[0.0; 3], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]];
        Density::new(1000, 1.0, 1).sample(&line, 0, &mut samples);
        assert!(samples.is_empty());
    }

    #[test]
    fn sorting_keeps_every_sample() {
        let mut samples = Vec::new();
        let t = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        Density::new(1000, 0.5, 1).sample(&t, 3, &mut samples);
        let before = samples.clone();
        sort_along_curve(&mut samples);
        assert_eq!(samples.len(), before.len());
        assert!(before.iter().all(|s| samples.contains(s)));
        let mut none = Vec::new();
        sort_along_curve(&mut none);
    }
}
