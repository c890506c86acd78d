//! Colour difference as people see it: CIELAB, Delta E.
//!
//! Turns colour channels into CIELAB and measures their distance. Which channels are colours is said by
//! the vertex schema; meshes without colours never come here.

use stonecut_mesh::Mesh;
use stonecut_mesh::record::VertexSchema;

/// Channels of a mesh that hold its colours.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ColourChannels {
    /// The channels of red, green and blue.
    pub channels: [usize; 3],
    /// The channel value of full intensity: 255, 65535 or 1.
    pub white: f32,
}

impl ColourChannels {
    /// The colour channels of a schema, if it has red, green and blue of one type.
    pub fn of(schema: &VertexSchema) -> Option<Self> {
        let mut channel = 0;
        let mut found = [None; 3];
        for property in &schema.properties {
            let own =
                VertexSchema { coordinate: schema.coordinate, properties: vec![property.clone()] };
            let n_channels = own.n_channels();
            if let Some(k) = ["red", "green", "blue"].iter().position(|n| *n == property.name)
                && n_channels > 0
            {
                found[k] = Some((channel, property.scalar, property.full() as f32));
            }
            channel += n_channels;
        }
        let [Some(red), Some(green), Some(blue)] = found else { return None };
        let same = red.1 == green.1 && green.1 == blue.1;
        same.then_some(ColourChannels { channels: [red.0, green.0, blue.0], white: red.2 })
    }

    /// CIELAB at a point of a triangle: vertex colours are mixed as sRGB values, as viewers do.
    pub fn lab(&self, mesh: &Mesh, corners: [u32; 3], weights: [f64; 3]) -> [f64; 3] {
        let rgb = self.channels.map(|channel| {
            let mixed: f64 =
                (0..3).map(|i| weights[i] * f64::from(mesh.channels_of(corners[i])[channel])).sum();
            (mixed / f64::from(self.white)).clamp(0.0, 1.0)
        });
        lab_of_srgb(rgb)
    }
}

/// The largest Delta E that two sRGB colours can have, rounded up.
pub const LARGEST_DELTA_E: f64 = 300.0;

/// CIELAB (D65) of an sRGB colour in 0..=1.
///
/// Source: IEC 61966-2-1 for sRGB, ISO/CIE 11664-4 for CIELAB (docs/references.md).
pub fn lab_of_srgb(rgb: [f64; 3]) -> [f64; 3] {
    let linear =
        rgb.map(|c| if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) });
    // Each row divided by its sum, so that white becomes (100, 0, 0) to the last digit.
    let row = |m: [f64; 3]| {
        (m[0] * linear[0] + m[1] * linear[1] + m[2] * linear[2]) / (m[0] + m[1] + m[2])
    };
    let x = row([0.4124564, 0.3575761, 0.1804375]);
    let y = row([0.2126729, 0.7151522, 0.0721750]);
    let z = row([0.0193339, 0.1191920, 0.9503041]);
    let f = |t: f64| {
        if t > 216.0 / 24389.0 { t.cbrt() } else { (24389.0 / 27.0 * t + 16.0) / 116.0 }
    };
    [116.0 * f(y) - 16.0, 500.0 * (f(x) - f(y)), 200.0 * (f(y) - f(z))]
}

/// Delta E (CIE 1976): the distance of two colours in CIELAB; about 2.3 is just noticeable.
pub fn delta_e(a: [f64; 3], b: [f64; 3]) -> f64 {
    stonecut_mesh::vec3::length_sq(stonecut_mesh::vec3::sub(a, b)).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use stonecut_mesh::property::{Property, Scalar};

    #[test]
    fn known_colours() {
        let close = |a: [f64; 3], b: [f64; 3]| (0..3).all(|k| (a[k] - b[k]).abs() < 0.02);
        assert!(close(lab_of_srgb([1.0; 3]), [100.0, 0.0, 0.0]));
        assert!(close(lab_of_srgb([0.0; 3]), [0.0, 0.0, 0.0]));
        assert!(close(lab_of_srgb([1.0, 0.0, 0.0]), [53.24, 80.09, 67.20]));
        assert!(close(lab_of_srgb([0.0, 0.0, 1.0]), [32.30, 79.19, -107.86]));
        assert!((delta_e([50.0, 0.0, 0.0], [50.0, 3.0, 4.0]) - 5.0).abs() < 1e-12);
    }

    #[test]
    fn colour_channels_are_found_behind_other_properties() {
        let property = |name: &str, scalar| Property::new(name, scalar);
        let mut schema = VertexSchema {
            coordinate: Scalar::F32,
            properties: vec![
                property("time", Scalar::F64),
                property("class", Scalar::U8),
                property("red", Scalar::U8),
                property("green", Scalar::U8),
                property("blue", Scalar::U8),
            ],
        };
        let found = ColourChannels::of(&schema);
        assert_eq!(found, Some(ColourChannels { channels: [2, 3, 4], white: 255.0 }));
        schema.properties.pop();
        assert_eq!(ColourChannels::of(&schema), None);
    }
}
