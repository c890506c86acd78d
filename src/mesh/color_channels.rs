//! Groups of vertex properties that are one colour, and their channels in the kernel: OKLab, times alpha.
//!
//! Part of `codec::VertexCodec`. A colour is three properties of one type that
//! belong together by name, with or without an alpha. What is transparent counts less: channels hold the
//! colour times its alpha, so that averages are those of what is seen.

use crate::oklab::{linear_of_oklab, linear_of_srgb, oklab_of_linear, srgb_of_linear};
use crate::property::{Origin, Property, Scalar};

/// Names of red, green, blue and alpha, with what stands before them.
const NAMES: [[&str; 4]; 5] = [
    ["red", "green", "blue", "alpha"],
    ["r", "g", "b", "a"],
    ["diffuse_red", "diffuse_green", "diffuse_blue", "diffuse_alpha"],
    ["ambient_red", "ambient_green", "ambient_blue", "ambient_alpha"],
    ["specular_red", "specular_green", "specular_blue", "specular_alpha"],
];

/// Alpha below which a mixture has no colour.
const LEAST_ALPHA: f64 = 1e-4;

/// Properties that are one colour.
#[derive(Clone, Debug)]
pub struct Colour {
    /// Indices of red, green and blue among the properties.
    pub fields: [usize; 3],
    /// Index of alpha.
    pub alpha: Option<usize>,
    white: f64,
    /// Linear light of every value of a byte.
    bytes: Option<Box<[f64; 256]>>,
}

impl Colour {
    /// All colours among the properties, those of faces last.
    pub fn find(properties: &[Property]) -> Vec<Colour> {
        let named = |origin: Origin| {
            NAMES.iter().filter_map(move |names| Colour::named(origin, names, properties))
        };
        named(Origin::Vertex).chain(named(Origin::FaceMean)).collect()
    }

    fn named(origin: Origin, names: &[&str; 4], properties: &[Property]) -> Option<Colour> {
        let is = |p: &Property, name: &str| p.origin == origin && p.name == name;
        let find = |name: &str| properties.iter().position(|p| is(p, name));
        let fields = [find(names[0])?, find(names[1])?, find(names[2])?];
        let scalar = properties[fields[0]].scalar;
        let one_type = fields.iter().all(|&i| properties[i].scalar == scalar);
        if !one_type || !is_averaged(scalar) {
            return None;
        }
        let alpha = find(names[3]).filter(|&i| properties[i].scalar == scalar);
        let light = |i: usize| linear_of_srgb(i as f64 / 255.0);
        let bytes = (scalar == Scalar::U8).then(|| Box::new(std::array::from_fn(light)));
        Some(Colour { fields, alpha, white: properties[fields[0]].full(), bytes })
    }

    /// The value of full intensity.
    pub fn white(&self) -> f64 {
        self.white
    }

    /// Channels of raw property values: OKLab times alpha.
    pub fn channels(&self, rgb: [f64; 3], alpha: f64) -> [f32; 3] {
        let light = match &self.bytes {
            Some(table) => rgb.map(|c| table[usize::from(c as u8)]),
            None => rgb.map(|c| linear_of_srgb(c / self.white())),
        };
        let opacity = (alpha / self.white()).clamp(0.0, 1.0);
        oklab_of_linear(light).map(|x| (x * opacity) as f32)
    }

    /// Property values of channels; `None` where nothing can be seen.
    pub fn values(&self, channels: [f32; 3], alpha: f64) -> Option<[f64; 3]> {
        let opacity = (alpha / self.white()).clamp(0.0, 1.0);
        let visible = opacity >= LEAST_ALPHA;
        visible.then(|| {
            let light = linear_of_oklab(channels.map(|x| f64::from(x) / opacity));
            light.map(|x| srgb_of_linear(x.max(0.0)) * self.white())
        })
    }
}

/// Returns whether colours of a type are averaged at a collapse; integers of 64 bits are labels.
fn is_averaged(scalar: Scalar) -> bool {
    !matches!(scalar, Scalar::I64 | Scalar::U64)
}
