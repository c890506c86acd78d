//! Pixels of an image, and the same in half the size.

use super::light_table::{LightTable, LightValues};

/// Pixels in rows of a width.
pub(super) struct ImageLevel {
    pub(super) size: [u32; 2],
    pub(super) pixels: Vec<[u8; 4]>,
}

/// Sides of half the size, rounded down.
pub(super) fn half_of(size: [u32; 2]) -> [u32; 2] {
    size.map(|side| (side / 2).max(1))
}

/// Texels along a side of `n` that become texel `to` of half the side, and their shares: two, and three of an odd side.
fn merged(n: u32, to: u32) -> impl Iterator<Item = (usize, f32)> {
    let half = n / 2;
    let has_three = n % 2 == 1 && half > 0;
    // Of an odd side each takes 2 + 1 / half: the outer ones of three are shared with the neighbours.
    let shares = match has_three {
        true => [half - to, half, to + 1].map(|share| share as f32 / n as f32),
        false => [0.5, 0.5, 0.0],
    };
    let texel = move |(k, share): (u32, f32)| ((2 * to + k).min(n - 1) as usize, share);
    (0..).zip(shares).take(if has_three { 3 } else { 2 }).map(texel)
}

impl ImageLevel {
    /// The same in half the size, rounded down.
    pub(super) fn half(&self, table: &LightTable) -> ImageLevel {
        let size = half_of(self.size);
        let mut pixels = Vec::with_capacity(size[0] as usize * size[1] as usize);
        if self.size.iter().all(|side| side % 2 == 0) {
            // The sums of below, many times as fast.
            let values = LightValues::all();
            let light = |value: u8| table.light[usize::from(value)];
            for rows in self.pixels.chunks_exact(2 * self.size[0] as usize) {
                let (upper, lower) = rows.split_at(self.size[0] as usize);
                let pairs = upper.as_chunks::<2>().0.iter().zip(lower.as_chunks::<2>().0);
                pixels.extend(pairs.map(|(&[a, b], &[c, d])| {
                    let is_opaque = a[3] & b[3] & c[3] & d[3] == 255;
                    if is_opaque && !table.is_plain {
                        let mean = |k: usize| {
                            0.25 * (light(a[k]) + light(b[k]) + light(c[k]) + light(d[k]))
                        };
                        return [values.of(mean(0)), values.of(mean(1)), values.of(mean(2)), 255];
                    }
                    let [a, b, c, d] = [a, b, c, d].map(|pixel| table.of(pixel));
                    let mean = |k: usize| 0.25 * (a[k] + b[k] + c[k] + d[k]);
                    table.pixel([mean(0), mean(1), mean(2), mean(3)])
                }));
            }
            return ImageLevel { size, pixels };
        }
        for y in 0..size[1] {
            for x in 0..size[0] {
                let mut sum = [0.0; 4];
                for (row, row_share) in merged(self.size[1], y) {
                    for (column, column_share) in merged(self.size[0], x) {
                        let light = table.of(self.pixels[row * self.size[0] as usize + column]);
                        for (sum, light) in sum.iter_mut().zip(light) {
                            *sum += row_share * column_share * light;
                        }
                    }
                }
                pixels.push(table.pixel(sum));
            }
        }
        ImageLevel { size, pixels }
    }
}
