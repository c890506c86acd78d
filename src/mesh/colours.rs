//! Colours of vertices: which properties of a record they are, what full intensity is, sRGB and linear light.
//!
//! All that reads or writes colours goes through here. Components are sRGB whatever their type; `COLOR_0` of glTF alone is
//! linear. Full intensity is that of the type where it is a byte; for every other type a survey of a file's values decides
//! (`ColourSurvey`), and `Property::white` carries what it found. Alpha is a share, never sRGB.

use super::oklab::{linear_of_srgb, srgb_of_linear};
use super::property::{Property, Scalar, read_scalar, write_scalar};
use super::record::VertexSchema;

/// Names of red, green and blue, in the order of preference, and of the alpha beside them.
const NAMES: [[&str; 4]; 3] = [
    ["red", "green", "blue", "alpha"],
    ["diffuse_red", "diffuse_green", "diffuse_blue", "diffuse_alpha"],
    ["r", "g", "b", "a"],
];

/// The value of full intensity of a type, where no survey says otherwise.
pub fn white_of_type(scalar: Scalar) -> f64 {
    match scalar {
        Scalar::F32 | Scalar::F64 => 1.0,
        Scalar::U16 => 65_535.0,
        Scalar::I8 => 127.0,
        _ => 255.0,
    }
}

impl Property {
    /// The value of full intensity, if this is a component of a colour.
    pub fn full(&self) -> f64 {
        self.white.map_or_else(|| white_of_type(self.scalar), f64::from)
    }
}

/// A number in a record, and its value of full intensity.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Component {
    scalar: Scalar,
    at: usize,
    white: f64,
}

impl Component {
    fn share(self, record: &[u8]) -> f64 {
        read_scalar(self.scalar, record, self.at) / self.white
    }
}

/// The colour in the records of a schema.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ColourPlace {
    names: &'static [&'static str; 4],
    components: [Component; 3],
    alpha: Option<Component>,
}

impl ColourPlace {
    /// The properties that are a colour; alpha is one of them where it has their type, or is a byte or a share from 0 to 1.
    pub fn find(schema: &VertexSchema) -> Option<ColourPlace> {
        let place = |name: &str| {
            let i = schema.own_property(name)?;
            let before: usize = schema.properties[..i].iter().map(|p| p.scalar.bytes()).sum();
            let property = &schema.properties[i];
            let at = schema.position_bytes() + before;
            Some(Component { scalar: property.scalar, at, white: property.full() })
        };
        NAMES.iter().find_map(|names| {
            let [r, g, b, a] = names;
            let components = [place(r)?, place(g)?, place(b)?];
            let plain = [components[0].scalar, Scalar::U8, Scalar::F32, Scalar::F64];
            let alpha = place(a).filter(|alpha| plain.contains(&alpha.scalar));
            Some(ColourPlace { names, components, alpha })
        })
    }

    /// The names of red, green and blue.
    pub fn names(&self) -> &'static [&'static str] {
        &self.names[..3]
    }

    /// Types and places of red, green and blue.
    pub fn fields(&self) -> [(Scalar, usize); 3] {
        self.components.map(|component| (component.scalar, component.at))
    }

    /// The name of alpha.
    pub fn alpha_name(&self) -> Option<&'static str> {
        self.alpha.and(self.names.last().copied())
    }

    /// sRGB from 0 to 1; white for what is not a number.
    pub fn shares(&self, record: &[u8]) -> [f64; 3] {
        self.components.map(|component| held(component.share(record)))
    }

    /// sRGB in bytes.
    pub fn bytes(&self, record: &[u8]) -> [u8; 3] {
        self.shares(record).map(|share| (255.0 * share).round() as u8)
    }

    /// Puts sRGB in bytes into a record.
    pub fn put_bytes(&self, bytes: [u8; 3], record: &mut [u8]) {
        for (component, byte) in self.components.iter().zip(bytes) {
            let value = component.white * f64::from(byte) / 255.0;
            write_scalar(component.scalar, record, component.at, value);
        }
    }

    /// Linear light and opacity as glTF has them, in 65,535ths: every byte of sRGB comes back from it.
    pub fn linear_words(&self, record: &[u8]) -> [u16; 4] {
        let [r, g, b] = self.shares(record).map(linear_word);
        let alpha = self.alpha.map_or(1.0, |alpha| held(alpha.share(record)));
        [r, g, b, (65_535.0 * alpha).round() as u16]
    }

    /// Returns whether a component has a value that had to be clamped, by more than rounding.
    pub fn is_clamped(&self, record: &[u8]) -> bool {
        self.components.iter().any(|component| is_outside(component.share(record)))
    }
}

/// Returns whether a share is not a number, or outside of 0 to 1 by more than half a byte's step.
pub fn is_outside(share: f64) -> bool {
    !(-0.5 / 255.0..=1.0 + 0.5 / 255.0).contains(&share)
}

/// A share from 0 to 1; white where there is none.
pub fn held(share: f64) -> f64 {
    if share.is_nan() { 1.0 } else { share.clamp(0.0, 1.0) }
}

/// sRGB in linear light, in 65,535ths.
pub fn linear_word(share: f64) -> u16 {
    // White stays exact.
    let light = if share < 1.0 { linear_of_srgb(share) } else { 1.0 };
    (light * 65_535.0).round() as u16
}

/// The byte of sRGB of linear light.
pub fn srgb_byte(light: f64) -> u8 {
    (255.0 * srgb_of_linear(held(light))).round() as u8
}

/// Values of full intensity that floats have.
const WHITES: [f64; 3] = [1.0, 255.0, 65_535.0];

/// Values of colour components of one file, on the way to their value of full intensity.
#[derive(Clone, Debug, Default)]
pub struct ColourSurvey {
    n_positive: u64,
    n_above_unit: u64,
    n_above_byte: u64,
    /// Values above each of `WHITES`, by more than rounding.
    n_above: [u64; 3],
    /// Negative values, and what is not a number.
    n_below: u64,
    most: f64,
    has_fractions: bool,
}

impl ColourSurvey {
    /// Takes a value in.
    pub fn add(&mut self, value: f64) {
        self.n_below += u64::from(value.is_nan() || value < -0.5 / 255.0);
        for (n, white) in self.n_above.iter_mut().zip(WHITES) {
            *n += u64::from(value / white > 1.0 + 0.5 / 255.0);
        }
        if value > 0.0 && value.is_finite() {
            self.n_positive += 1;
            self.n_above_unit += u64::from(value > 1.0);
            self.n_above_byte += u64::from(value > 255.5);
            self.most = self.most.max(value);
            self.has_fractions |= value.fract() != 0.0;
        }
    }

    /// Values that are not between black and `white`; those above are known for `WHITES` alone.
    pub fn n_outside(&self, white: f64) -> u64 {
        let place = WHITES.iter().position(|known| *known == white);
        self.n_below + place.map_or(0, |place| self.n_above[place])
    }

    /// The value of full intensity of floats or of text: 1, 255 or 65,535.
    ///
    /// A few values above the range do not make another one: it is the smallest that holds half of all that is not black. Values
    /// with fractions below 8 are shares of 1 that were exposed too much, since as bytes they would all be black.
    pub fn white_of_floats(&self) -> u32 {
        let is_more = |n: u64| 2 * n > self.n_positive;
        if !is_more(self.n_above_unit) || (self.has_fractions && self.most < 8.0) {
            return 1;
        }
        if is_more(self.n_above_byte) && self.most >= 512.0 { 65_535 } else { 255 }
    }

    /// The value of full intensity of a type; `None` for that of the type itself.
    pub fn white(&self, scalar: Scalar) -> Option<u32> {
        let white = match scalar {
            Scalar::U8 | Scalar::I8 => return None,
            Scalar::F32 | Scalar::F64 => self.white_of_floats(),
            // Nothing to go by.
            _ if self.n_positive == 0 => return None,
            _ if 2 * self.n_above_byte <= self.n_positive && self.most < 512.0 => 255,
            Scalar::I16 => 32_767,
            _ if self.most <= 65_535.0 => 65_535,
            Scalar::I32 => i32::MAX as u32,
            _ => u32::MAX,
        };
        (f64::from(white) != white_of_type(scalar)).then_some(white)
    }
}

/// Names of the components that a survey looks at, for each colour that a schema may have.
pub fn surveyed(schema: &VertexSchema) -> Option<([usize; 3], Option<usize>)> {
    let find = |name: &str| schema.own_property(name);
    let found =
        NAMES.iter().find_map(|[r, g, b, a]| Some(([find(r)?, find(g)?, find(b)?], find(a))));
    found.filter(|(rgb, _)| {
        let scalar = schema.properties[rgb[0]].scalar;
        let one_type = rgb.iter().all(|&i| schema.properties[i].scalar == scalar);
        one_type && !matches!(scalar, Scalar::U8 | Scalar::I8)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn survey(values: impl IntoIterator<Item = f64>) -> ColourSurvey {
        let mut survey = ColourSurvey::default();
        values.into_iter().for_each(|value| survey.add(value));
        survey
    }

    #[test]
    fn every_byte_comes_back_from_linear_light() {
        for byte in 0..=255u8 {
            let word = linear_word(f64::from(byte) / 255.0);
            assert_eq!(srgb_byte(f64::from(word) / 65_535.0), byte);
        }
        assert_eq!([0.0, 1.0].map(linear_word), [0, 65_535]);
        assert!((f64::from(linear_word(128.0 / 255.0)) / 65_535.0 - 0.2159).abs() < 1e-4);
    }

    #[test]
    fn a_few_bright_values_make_no_other_range() {
        let shares = (0..100).map(|i| f64::from(i) / 100.0);
        assert_eq!(survey(shares.clone()).white_of_floats(), 1);
        assert_eq!(survey(shares.clone().chain([1.02, 255.0])).white_of_floats(), 1);
        assert_eq!(survey(std::iter::repeat_n(1.02, 100)).white_of_floats(), 1);
        let bytes = (0..256).map(f64::from);
        assert_eq!(survey(bytes.clone()).white_of_floats(), 255);
        assert_eq!(survey(bytes.clone().chain([255.4, 300.0])).white_of_floats(), 255);
        assert_eq!(survey(bytes.clone().map(|x| 257.0 * x)).white_of_floats(), 65_535);
        assert_eq!(survey([]).white_of_floats(), 1);
        let white =
            |scalar, values: &dyn Fn(f64) -> f64| survey(bytes.clone().map(values)).white(scalar);
        assert_eq!(white(Scalar::I32, &|x| x), None);
        assert_eq!(white(Scalar::U16, &|x| x), Some(255));
        assert_eq!(white(Scalar::U16, &|x| 257.0 * x), None);
        assert_eq!(white(Scalar::I32, &|x| 257.0 * x), Some(65_535));
        assert_eq!(white(Scalar::F64, &|x| x / 255.0), None);
        assert_eq!(white(Scalar::F32, &|x| x), Some(255));
    }
}
