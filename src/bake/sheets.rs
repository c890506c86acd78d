//! Values of pages besides colours: emitted light; shade, roughness and metal; directions that the original's own normal
//! maps bend.
//!
//! Knows places of the original and their materials, no texels.

use super::original::Hit;
use super::pages::Canvas;
use stonecut_io::materials::MapKind;
use stonecut_render::texture::{ImageCache, Light, Paint, Palette, Spot, look_up, outward};
use stonecut_system::error::Result;
use stonecut_system::progress::Progress;

/// Places on the original, and their materials.
pub(super) struct Places<'a> {
    pub spots: &'a [Spot],
    pub palette: &'a Palette,
    pub images: &'a ImageCache<'a>,
    pub threads: usize,
    pub progress: &'a Progress,
}

impl Places<'_> {
    /// Begins with what each material has without images.
    fn begin(&self, out: &mut Vec<Light>, plain: impl Fn(&Paint) -> Light, none: Light) {
        let paint = |spot: &Spot| self.palette.paints.get(spot.material as usize);
        out.clear();
        out.extend(self.spots.iter().map(|spot| paint(spot).map_or(none, &plain)));
    }

    /// Strength of the image of a kind at a place.
    fn strength(&self, place: usize, kind: MapKind) -> f32 {
        let paint = self.palette.paints.get(self.spots[place].material as usize);
        paint.and_then(|paint| paint.map(kind)).map_or(1.0, |map| map.strength)
    }

    fn look_up(&self, kind: MapKind, put: impl FnMut(usize, Light)) -> Result<()> {
        let looks = (self.palette, self.images);
        look_up((kind, self.spots), looks, self.threads, self.progress, put)
    }

    /// Emitted light of each place.
    pub fn emission(&self, out: &mut Vec<Light>) -> Result<()> {
        let plain = |paint: &Paint| {
            let [r, g, b] = paint.emitted;
            [r, g, b, 1.0]
        };
        self.begin(out, plain, [0.0, 0.0, 0.0, 1.0]);
        self.look_up(MapKind::Emissive, |i, [r, g, b, _]| {
            let own = out[i];
            out[i] = [own[0] * r, own[1] * g, own[2] * b, 1.0];
        })
    }

    /// Shade, roughness and share of metal of each place, as glTF has them in red, green and blue.
    pub fn surface(&self, out: &mut Vec<Light>) -> Result<()> {
        let plain = |paint: &Paint| [1.0, paint.surface[0], paint.surface[1], 1.0];
        self.begin(out, plain, [1.0, 1.0, 0.0, 1.0]);
        self.look_up(MapKind::Occlusion, |i, [shade, ..]| {
            out[i][0] *= match self.strength(i, MapKind::Occlusion) {
                1.0 => shade,
                strength => 1.0 + strength * (shade - 1.0),
            }
        })?;
        self.look_up(MapKind::MetallicRoughness, |i, light| {
            out[i][1] *= light[1];
            out[i][2] *= light[2];
        })?;
        self.look_up(MapKind::Roughness, |i, light| out[i][1] *= light[0])?;
        self.look_up(MapKind::Metallic, |i, light| out[i][2] *= light[0])
    }

    /// Turns the normals of places with a normal map into the directions that it gives them.
    pub fn bend(&self, hits: &mut [Hit]) -> Result<()> {
        self.look_up(MapKind::Normal, |i, [r, g, b, _]| {
            let Hit { normal, tangent: [x, y, z, side], .. } = hits[i];
            let slope = self.strength(i, MapKind::Normal);
            let [u, v, up] = [r, g, b].map(|value| 2.0 * value - 1.0);
            let direction = [slope * u, slope * v, up];
            let bent = outward(normal, [x, y, z], side, direction);
            hits[i].normal = bent.unwrap_or(normal);
        })
    }
}

/// Pages that are filled.
#[derive(Default)]
pub(super) struct Canvases {
    pub colours: Option<Canvas>,
    pub normals: Option<Canvas>,
    /// Of emitted light.
    pub emission: Option<Canvas>,
    /// Of shade, roughness and metal.
    pub surface: Option<Canvas>,
}

impl Canvases {
    /// Accounts for the disk that the pages take, once they are filled.
    pub fn count(&self) {
        let all = [&self.colours, &self.normals, &self.emission, &self.surface];
        all.into_iter().flatten().for_each(Canvas::count);
    }
}

/// The mean of the values of a texel's points.
pub(super) fn mean(values: impl Iterator<Item = Light>) -> Light {
    let (mut sum, mut n) = ([0f32; 4], 0.0);
    for value in values {
        n += 1.0;
        sum.iter_mut().zip(value).for_each(|(sum, value)| *sum += value);
    }
    sum.map(|sum| sum / n)
}

/// The pixel of numbers from 0 to 1.
pub(super) fn plain_pixel(values: Light) -> [u8; 4] {
    values.map(|value| (255.0 * value.clamp(0.0, 1.0)).round() as u8)
}
