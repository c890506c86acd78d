//! Values of pixels and linear light, one into the other.

use std::sync::OnceLock;
use stonecut_mesh::oklab::{linear_of_srgb, srgb_of_linear};

/// Colour in linear light, and opacity.
pub type Light = [f32; 4];

/// Light of the 256 values of a pixel.
pub struct LightTable {
    pub(super) light: [f32; 256],
    pub(super) is_plain: bool,
}

impl LightTable {
    /// Linear light of sRGB.
    pub fn new() -> LightTable {
        let light = std::array::from_fn(|i| linear_of_srgb(i as f64 / 255.0) as f32);
        LightTable { light, is_plain: false }
    }

    /// The values themselves, from 0 to 1: of images that do not hold colours.
    pub fn plain() -> LightTable {
        LightTable { light: std::array::from_fn(|i| i as f32 / 255.0), is_plain: true }
    }

    /// The pixel of what `of` gives.
    pub(super) fn pixel(&self, light: Light) -> [u8; 4] {
        if !self.is_plain {
            return pixel_of(light);
        }
        let [r, g, b, opacity] = light;
        let value = |x: f32| (255.0 * (x / opacity).clamp(0.0, 1.0)).round() as u8;
        match opacity > 0.0 {
            true => [value(r), value(g), value(b), (255.0 * opacity.min(1.0)).round() as u8],
            false => [0; 4],
        }
    }

    /// Colour of a pixel, multiplied by its opacity.
    pub fn of(&self, [r, g, b, a]: [u8; 4]) -> Light {
        let opacity = f32::from(a) / 255.0;
        let light = |x: u8| self.light[usize::from(x)] * opacity;
        [light(r), light(g), light(b), opacity]
    }
}

/// The pixel of a colour that is multiplied by its opacity.
pub fn pixel_of([r, g, b, opacity]: Light) -> [u8; 4] {
    if opacity.is_nan() || opacity <= 0.0 {
        return [0; 4];
    }
    let values = LightValues::all();
    let value = |light: f32| values.of(light / opacity);
    // Nearly all are opaque; rounding is a call where processors of all ages are built for.
    let opacity_value = if opacity > 0.9999 { 255 } else { (255.0 * opacity).round() as u8 };
    [value(r), value(g), value(b), opacity_value]
}

/// The 256 values of light, found without roots.
pub(super) struct LightValues {
    /// For each value the least light that has it, and one more that nothing has.
    least: [f32; 257],
    /// The value of every step of light.
    of_step: [u8; LightValues::STEPS as usize + 1],
}

impl LightValues {
    /// Steps of light; hardly any has more than two values.
    const STEPS: f32 = 4096.0;

    /// The values, made when they are first asked for.
    pub(super) fn all() -> &'static LightValues {
        static VALUES: OnceLock<LightValues> = OnceLock::new();
        VALUES.get_or_init(LightValues::new)
    }

    fn new() -> LightValues {
        let (mut least, mut first) = ([f32::INFINITY; 257], 0f32.to_bits());
        for (value, least) in least.iter_mut().take(256).enumerate() {
            // Positive numbers are in the order of their bits.
            let mut end = 1f32.to_bits();
            while first < end {
                let middle = first.midpoint(end);
                let is_less = usize::from(LightValues::by_formula(f32::from_bits(middle))) < value;
                (first, end) = if is_less { (middle + 1, end) } else { (first, middle) };
            }
            *least = f32::from_bits(first);
        }
        let of_step =
            std::array::from_fn(|i| LightValues::by_formula(i as f32 / LightValues::STEPS));
        LightValues { least, of_step }
    }

    fn by_formula(light: f32) -> u8 {
        (255.0 * srgb_of_linear(f64::from(light))).round() as u8
    }

    /// The value of light.
    pub(super) fn of(&self, light: f32) -> u8 {
        let light = light.clamp(0.0, 1.0);
        let mut value = self.of_step[(light * LightValues::STEPS) as usize];
        while light >= self.least[usize::from(value) + 1] {
            value += 1;
        }
        value
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_those_of_the_formula() {
        let values = LightValues::new();
        for bits in (0..=1f32.to_bits()).step_by(9973).chain(
            values.least[..256]
                .iter()
                .flat_map(|least| [least.to_bits().saturating_sub(1), least.to_bits()]),
        ) {
            let light = f32::from_bits(bits);
            assert_eq!(values.of(light), LightValues::by_formula(light), "{light}");
        }
        assert_eq!([f32::NAN, -1.0, 1.0, f32::INFINITY].map(|x| values.of(x)), [0, 0, 255, 255]);
    }
}
