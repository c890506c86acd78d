//! Light: from a frame of samples to a picture.
//!
//! A warm key light from the upper left, a cool fill from the right, sky and ground light dimmed where
//! the surface is enclosed (ambient occlusion, estimated from the depths around each pixel at several
//! scales), a faint gloss. Every sample is lit on its own; a pixel is the mean of its samples.

use super::camera::Camera;
use super::picture::Picture;
use super::raster::Frame;
use super::sample::Sample;
use super::vector::smoothstep;
use stonecut_mesh::oklab::{linear_of_srgb, srgb_of_linear};
use stonecut_mesh::vec3::unit;
use stonecut_mesh::vec3::{dot, scale, sub};
use stonecut_system::error::Result;
use stonecut_system::parallel::in_order;
use stonecut_system::progress::Progress;

/// Rows of pixels that are shaded together.
const BAND: usize = 16;
/// Directions and steps of the occlusion estimate: 12 x 7 looks a pixel.
const DIRECTIONS: usize = 12;
const STEPS: usize = 7;
/// Strength of full occlusion on sky light.
const OCCLUSION: f32 = 1.45;
/// Directions of the key and fill light in camera space, normalised on use.
const KEY: [f64; 3] = [-0.64, 0.56, 0.46];
const FILL: [f64; 3] = [0.75, 0.05, 0.55];
/// Linear colours of the lights.
const KEY_LIGHT: [f32; 3] = [0.98, 0.92, 0.83];
const FILL_LIGHT: [f32; 3] = [0.10, 0.13, 0.17];
const SKY: [f32; 3] = [0.34, 0.37, 0.42];
const GROUND: [f32; 3] = [0.15, 0.125, 0.10];
/// Colour that backs of surfaces are mixed with, linear.
const BACK: [f32; 3] = [0.13, 0.20, 0.33];
/// Edge lines, linear.
const INK: [f32; 3] = [0.018, 0.028, 0.05];
/// The background, sRGB, from top to bottom.
const BACKGROUND: [[f32; 3]; 2] = [[0.985, 0.985, 0.99], [0.86, 0.875, 0.895]];

/// Unlit surfaces are seen before this, linear: 128 of 255.
const PLAIN_BACKGROUND: f32 = 0.215_860_5;

/// A frame whose surfaces show their own colours; pixels are squares of `per_pixel` x `per_pixel` samples.
pub(super) fn plain(
    frame: &Frame,
    per_pixel: usize,
    threads: usize,
    progress: &Progress,
) -> Result<Picture> {
    let (width, height) = (frame.width / per_pixel, frame.height / per_pixel);
    let mut picture = Picture::new(width as u32, height as u32, [255; 3]);
    let mut bytes = Vec::with_capacity(width * height * 3);
    let row = |y: u64, out: &mut Vec<u8>| {
        out.clear();
        for x in 0..width {
            let mut sum = [0.0f32; 3];
            for sy in 0..per_pixel {
                let start = (y as usize * per_pixel + sy) * frame.width + x * per_pixel;
                for sample in &frame.samples[start..start + per_pixel] {
                    let color =
                        if sample.nearness > 0.0 { own(sample) } else { [PLAIN_BACKGROUND; 3] };
                    (0..3).for_each(|i| sum[i] += color[i]);
                }
            }
            let share = 1.0 / (per_pixel * per_pixel) as f32;
            let value = |light: f32| 255.0 * srgb_of_linear(f64::from(light * share));
            out.extend(sum.map(|x| value(x).round().clamp(0.0, 255.0) as u8));
        }
        Ok(())
    };
    in_order(height as u64, threads, progress, row, |_, row| {
        bytes.append(row);
        Ok(())
    })?;
    picture.rgb = bytes;
    Ok(picture)
}

/// The linear colour of a surface without any light.
fn own(sample: &Sample) -> [f32; 3] {
    let mean = sample.color.map(|x| x / sample.weight.max(1e-20));
    match sample.material {
        Sample::LIGHT => mean,
        _ => mean.map(|x| linear_of_srgb(f64::from(x)) as f32),
    }
}

/// Lights a frame whose pixels are squares of `per_pixel` x `per_pixel` samples.
pub(super) fn shade(
    frame: &Frame,
    camera: &Camera,
    per_pixel: usize,
    threads: usize,
    progress: &Progress,
) -> Result<Picture> {
    let (width, height) = (frame.width / per_pixel, frame.height / per_pixel);
    let n_bands = height.div_ceil(BAND) as u64;
    let rows = |band: u64| band as usize * BAND..((band as usize + 1) * BAND).min(height);

    let surface = Surface::new(frame, camera, per_pixel, width, height);
    let mut open = Vec::with_capacity(width * height);
    let look = |band: u64, out: &mut Vec<f32>| {
        out.clear();
        out.extend(
            rows(band)
                .flat_map(|y| (0..width).map(move |x| (x, y)))
                .map(|(x, y)| surface.openness(x, y)),
        );
        Ok(())
    };
    in_order(n_bands, threads, progress, look, |_, band| {
        open.append(band);
        Ok(())
    })?;
    let open = surface.smooth(&open);

    let lights = Lights::new(camera);
    let mut picture = Picture::new(width as u32, height as u32, [255; 3]);
    let mut bytes = Vec::with_capacity(width * height * 3);
    let light = |band: u64, out: &mut Vec<u8>| {
        out.clear();
        for y in rows(band) {
            let t = y as f32 / height.max(2) as f32;
            let behind = [0, 1, 2]
                .map(|i| linear(BACKGROUND[0][i] + t * (BACKGROUND[1][i] - BACKGROUND[0][i])));
            for x in 0..width {
                let mut sum = [0.0f32; 3];
                for sy in 0..per_pixel {
                    let start = (y * per_pixel + sy) * frame.width + x * per_pixel;
                    for sample in &frame.samples[start..start + per_pixel] {
                        let color = if sample.nearness > 0.0 {
                            lights.light(sample, open[y * width + x])
                        } else {
                            behind
                        };
                        (0..3).for_each(|i| sum[i] += color[i]);
                    }
                }
                let share = 1.0 / (per_pixel * per_pixel) as f32;
                out.extend(sum.map(|x| to_byte(x * share)));
            }
        }
        Ok(())
    };
    in_order(n_bands, threads, progress, light, |_, band| {
        bytes.append(band);
        Ok(())
    })?;
    picture.rgb = bytes;
    Ok(picture)
}

/// The lights, in camera space.
struct Lights {
    key: [f32; 3],
    fill: [f32; 3],
    half: [f32; 3],
    up: [f32; 3],
    key_strength: f32,
}

impl Lights {
    fn new(camera: &Camera) -> Self {
        let single = |v: [f64; 3]| v.map(|x| x as f32);
        let direction = |v| unit(v).unwrap_or([0.0, 0.0, 1.0]);
        let up = camera.axes.map(|axis| dot(axis, camera.world_up));
        // Seen from above, ground lit by a high sun would show no relief: the sun is lowered.
        let lowered = 0.6 * f64::from(smoothstep(0.3, 0.6, up[2] as f32));
        let key = direction(sub(KEY, scale(up, lowered)));
        let half = direction([key[0], key[1], key[2] + 1.0]);
        Lights {
            key: single(key),
            fill: single(direction(FILL)),
            key_strength: 1.0 + 0.9 * lowered as f32,
            half: single(half),
            up: single(up),
        }
    }

    /// The linear colour of a sample where a share `open` of the surroundings is free.
    fn light(&self, sample: &Sample, open: f32) -> [f32; 3] {
        let n = sample.normal;
        let length = (n[0] * n[0] + n[1] * n[1] + n[2] * n[2]).sqrt();
        let n = if length > 0.0 { n.map(|x| x / length) } else { [0.0, 0.0, 1.0] };
        let along = |v: &[f32; 3]| n[0] * v[0] + n[1] * v[1] + n[2] * v[2];
        let key = along(&self.key);
        // Light wraps a little around the edge of the shade, as under a large soft box.
        let key = self.key_strength * ((key + 0.12) / 1.12).max(0.0) * (0.35 + 0.65 * open);
        let fill = along(&self.fill).max(0.0);
        let sky = 0.5 + 0.5 * along(&self.up);
        let gloss = 0.10 * along(&self.half).max(0.0).powi(36) * open;
        let edge_on = (1.0 - n[2].max(0.0)).powi(4);
        // Backs of photographed surfaces are seen often, and are recognised anyway.
        let is_image = sample.material == Sample::LIGHT;
        std::array::from_fn(|i| {
            let mean = sample.color[i] / sample.weight.max(1e-20);
            let mut own = if is_image { mean } else { linear(mean) };
            if sample.flags & Sample::BACK != 0 && !is_image {
                own = 0.25 * own + 0.75 * BACK[i];
            }
            let ambient = (GROUND[i] + sky * (SKY[i] - GROUND[i])) * open;
            let lit = own * (ambient + KEY_LIGHT[i] * key + FILL_LIGHT[i] * fill)
                + gloss
                + 0.06 * edge_on * open * SKY[i];
            let lit = if sample.flags & Sample::UNLIT != 0 { own } else { lit };
            let ink = 0.88 * f32::from(sample.ink) / 255.0;
            lit + ink * (INK[i] - lit)
        })
    }
}

/// One depth and normal a pixel, for looking around.
struct Surface {
    width: usize,
    height: usize,
    /// Camera-space position of each pixel's middle sample; z is NaN where there is none.
    places: Vec<[f32; 3]>,
    normals: Vec<[f32; 3]>,
    /// Pixels to units of length at distance 1.
    pixel: f32,
    distance: f32,
    /// Pixels of the largest look.
    reach: f32,
}

impl Surface {
    fn new(frame: &Frame, camera: &Camera, per_pixel: usize, width: usize, height: usize) -> Self {
        let mut places = Vec::with_capacity(width * height);
        let mut normals = Vec::with_capacity(width * height);
        let focal = camera.focal as f32;
        let [cx, cy] = camera.centre.map(|x| x as f32);
        let middle = per_pixel / 2;
        for y in 0..height {
            for x in 0..width {
                let (sx, sy) = (x * per_pixel + middle, y * per_pixel + middle);
                let sample = &frame.samples[sy * frame.width + sx];
                if sample.nearness > 0.0 {
                    let depth = 1.0 / sample.nearness;
                    let (u, v) = (sx as f32 + 0.5 - cx, cy - sy as f32 - 0.5);
                    places.push([u * depth / focal, v * depth / focal, -depth]);
                    let n = sample.normal.map(f64::from);
                    normals.push(unit(n).unwrap_or([0.0, 0.0, 1.0]).map(|x| x as f32));
                } else {
                    places.push([f32::NAN; 3]);
                    normals.push([0.0, 0.0, 1.0]);
                }
            }
        }
        let pixel = per_pixel as f32 / focal;
        let reach = 0.11 * width.min(height) as f32;
        let distance = camera.distance as f32;
        Surface { width, height, places, normals, pixel, distance, reach }
    }

    /// The share of free sky over a pixel: horizon angles along some directions, averaged.
    fn openness(&self, x: usize, y: usize) -> f32 {
        let at = y * self.width + x;
        let p = self.places[at];
        if p[2].is_nan() {
            return 1.0;
        }
        let n = self.normals[at];
        // A fixed scramble of the pixel turns its directions, so that few directions show no pattern.
        let mut h = (x as u32).wrapping_mul(0x9E37_79B1) ^ (y as u32).wrapping_mul(0x85EB_CA77);
        h = (h ^ (h >> 15)).wrapping_mul(0x2C1B_3C6D);
        h ^= h >> 13;
        let turn = (h & 0xFFFF) as f32 / 65_536.0;
        let jitter = 0.6 + 0.8 * ((h >> 16) & 0xFF) as f32 / 255.0;
        let mut blocked = 0.0;
        for d in 0..DIRECTIONS {
            let angle = std::f32::consts::TAU * (d as f32 + turn) / DIRECTIONS as f32;
            let (sin, cos) = angle.sin_cos();
            let mut horizon = 0.0f32;
            for step in 0..STEPS {
                // Steps grow geometrically: near folds and far hollows both count.
                let far = (step as f32 + jitter) / (STEPS as f32 + 0.4);
                let radius = 1.5 + self.reach * far * far * far;
                let (qx, qy) = (x as f32 + cos * radius, y as f32 + sin * radius);
                if qx < 0.0 || qy < 0.0 || qx >= self.width as f32 || qy >= self.height as f32 {
                    break;
                }
                let q = self.places[qy as usize * self.width + qx as usize];
                if q[2].is_nan() {
                    continue;
                }
                let v = [q[0] - p[0], q[1] - p[1], q[2] - p[2]];
                let length = (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
                let rise = (v[0] * n[0] + v[1] * n[1] + v[2] * n[2]) / length.max(1e-30) - 0.06;
                // Things far in front of the surface are not part of its hollow.
                let span = self.reach * self.pixel * self.distance;
                let near = 1.0 / (1.0 + (length / (0.8 * span)).powi(2));
                horizon = horizon.max(rise * near);
            }
            blocked += horizon.clamp(0.0, 1.0);
        }
        (1.0 - OCCLUSION * blocked / DIRECTIONS as f32).clamp(0.0, 1.0)
    }

    /// Averages openness over 5 x 5 pixels of the same surface; takes the grain of few directions away.
    fn smooth(&self, open: &[f32]) -> Vec<f32> {
        let mut out = Vec::with_capacity(open.len());
        for y in 0..self.height {
            for x in 0..self.width {
                let at = y * self.width + x;
                let (z, n) = (self.places[at][2], self.normals[at]);
                if z.is_nan() {
                    out.push(1.0);
                    continue;
                }
                let (mut sum, mut weight) = (0.0, 0.0);
                for v in y.saturating_sub(2)..(y + 3).min(self.height) {
                    for u in x.saturating_sub(2)..(x + 3).min(self.width) {
                        let near = v * self.width + u;
                        let away = (self.places[near][2] - z).abs() / (8.0 * self.pixel * -z);
                        let m = self.normals[near];
                        let alike = (n[0] * m[0] + n[1] * m[1] + n[2] * m[2]).max(0.0);
                        let w = alike * alike / (1.0 + away * away);
                        if w > 0.0 {
                            sum += w * open[near];
                            weight += w;
                        }
                    }
                }
                out.push(if weight > 0.0 { sum / weight } else { open[at] });
            }
        }
        out
    }
}

/// sRGB to linear, by a cubic that is off by at most 0.003.
fn linear(x: f32) -> f32 {
    x * (x * (x * 0.305_306 + 0.682_171_1) + 0.012_522_88)
}

/// A linear value as an sRGB byte, highlights rolled off softly.
fn to_byte(x: f32) -> u8 {
    let x = if x > 0.8 { 0.8 + 0.2 * (1.0 - (-(x - 0.8) / 0.2).exp()) } else { x.max(0.0) };
    let srgb = if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 };
    (255.0 * srgb + 0.5).clamp(0.0, 255.0) as u8
}

/// Scales a colour in [0, 1]; for what is drawn over a mesh.
pub(super) fn tone(color: [f64; 3], brightness: f64) -> [f32; 3] {
    scale(color, brightness).map(|x| x as f32)
}
