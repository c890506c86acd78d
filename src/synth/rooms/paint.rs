//! Surfaces as a camera sees them: bricks, boards, tiles, plaster with paintings, cloth.
//!
//! A colour is a function of the place on its panel, so the images of the atlas and the colours at vertices
//! are the same thing sampled twice.

use super::super::noise::{hash2, noise3, smoothstep};
use stonecut_mesh::scatter::unit;

/// Materials.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Paint {
    Boards,
    Tiles,
    Bricks,
    /// Plaster with paintings in frames.
    Gallery,
    Ceiling,
    /// Upholstery with stripes.
    Cloth,
}

type Rgb = [f64; 3];

fn shade(color: Rgb, factor: f64) -> Rgb {
    color.map(|c| c * factor)
}

fn blend(a: Rgb, b: Rgb, t: f64) -> Rgb {
    [0, 1, 2].map(|n| a[n] + (b[n] - a[n]) * t)
}

/// Number of the cell of length `size` that holds `x`, and the distance to its nearer end.
fn cell(x: f64, size: f64) -> (i64, f64) {
    let n = (x / size).floor();
    let within = x - n * size;
    (n as i64, within.min(size - within))
}

fn tone(a: i64, b: i64, tag: u64) -> f64 {
    unit(hash2((a as u64) << 32 ^ (b as u64 & 0xFFFF_FFFF), tag))
}

impl Paint {
    /// The colour at a place in metres on a panel.
    pub(super) fn color(self, place: [f64; 2], tag: u64) -> [u8; 3] {
        let [x, y] = place;
        let seed = tag as u32;
        let grain = noise3([35.0 * x, 35.0 * y, 0.5], seed);
        let stain = 1.0 + 0.10 * noise3([1.3 * x, 1.3 * y, 7.5], seed);
        let color = match self {
            Paint::Boards => {
                let (row, gap) = cell(y, 0.14);
                let (board, end) = cell(x + 0.9 * tone(row, 0, tag), 1.1);
                let wood = blend([0.50, 0.31, 0.17], [0.68, 0.47, 0.28], tone(row, board, tag));
                let fibre = noise3([3.0 * x, 60.0 * y, tone(row, board, tag)], seed);
                let seam = smoothstep(0.0, 0.008, gap.min(end));
                shade(wood, (1.0 + 0.14 * fibre) * (0.45 + 0.55 * seam))
            }
            Paint::Tiles => {
                let ((i, a), (j, b)) = (cell(x, 0.3), cell(y, 0.3));
                let stone = if (i + j) & 1 == 0 { [0.83, 0.80, 0.74] } else { [0.34, 0.36, 0.40] };
                let seam = smoothstep(0.0, 0.008, a.min(b));
                shade(stone, (0.94 + 0.1 * tone(i, j, tag) + 0.04 * grain) * (0.6 + 0.4 * seam))
            }
            Paint::Bricks => {
                let (row, joint) = cell(y, 0.083);
                let (brick, end) = cell(x + 0.13 * (row & 1) as f64, 0.26);
                let clay = blend([0.55, 0.24, 0.17], [0.72, 0.38, 0.26], tone(row, brick, tag));
                let mortar = 1.0 - smoothstep(0.004, 0.012, joint.min(end));
                blend(shade(clay, 1.0 + 0.1 * grain), [0.74, 0.71, 0.66], mortar)
            }
            Paint::Gallery => gallery(x, y, tag, grain),
            Paint::Ceiling => shade([0.90, 0.89, 0.86], 1.0 + 0.02 * grain),
            Paint::Cloth => {
                let (stripe, edge) = cell(x, 0.11);
                let dye =
                    [tone(1, 0, tag), tone(2, 0, tag), tone(3, 0, tag)].map(|c| 0.25 + 0.6 * c);
                let light =
                    blend(dye, [0.93, 0.89, 0.80], if stripe & 1 == 0 { 0.0 } else { 0.65 });
                let (_, weave) = cell(y, 0.016);
                shade(light, 0.86 + 10.0 * weave + 0.08 * smoothstep(0.0, 0.01, edge))
            }
        };
        shade(color, stain).map(|c| (255.0 * c).clamp(0.0, 255.0) as u8)
    }
}

/// Plaster; every 1.7 metres a painting in a gilded frame at eye level.
fn gallery(x: f64, y: f64, tag: u64, grain: f64) -> Rgb {
    let wall = blend([0.42, 0.52, 0.50], [0.62, 0.50, 0.44], tone(9, 9, tag));
    let wall = if y < 0.12 { [0.88, 0.86, 0.82] } else { shade(wall, 1.0 + 0.03 * grain) };
    let (n, _) = cell(x, 1.7);
    let wide = 0.35 + 0.25 * tone(n, 1, tag);
    let high = 0.30 + 0.22 * tone(n, 2, tag);
    let (u, v) = ((x - (n as f64 + 0.5) * 1.7) / wide, (y - 1.6) / high);
    let rim = u.abs().max(v.abs());
    if rim > 1.0 {
        return wall;
    }
    if rim > 0.86 {
        return shade([0.80, 0.62, 0.26], 0.7 + 0.35 * smoothstep(0.86, 0.93, rim) + 0.08 * grain);
    }
    // A landscape: sky, sun, hills in three rows.
    let key = hash2(n as u64, tag);
    let mut picture = blend([0.95, 0.80, 0.58], [0.30, 0.47, 0.74], 0.5 + 0.6 * v);
    let [sun_x, sun_y] = [0.6 * (2.0 * unit(key) - 1.0), 0.35 + 0.3 * unit(hash2(key, 1))];
    let distance = (u - sun_x) * (u - sun_x) + (v - sun_y) * (v - sun_y);
    picture = blend([1.0, 0.93, 0.70], picture, smoothstep(0.012, 0.02, distance));
    for row in 0..3 {
        let far = f64::from(row);
        let ridge = 0.25 - 0.35 * far + 0.3 * noise3([2.0 * u, 3.0 * far, 0.3], key as u32);
        let hill = blend([0.42, 0.52, 0.55], [0.16, 0.33, 0.13], far / 2.0);
        picture = blend(picture, hill, 1.0 - smoothstep(ridge - 0.02, ridge, v));
    }
    shade(picture, 1.0 + 0.06 * grain)
}
