//! Colours in a perceptual space: OKLab, from sRGB values and back.
//!
//! Equal distances in OKLab look about equally different, and mixtures lie where people expect them, so it
//! is where colours are averaged and compared. Only additions, multiplications, divisions and square roots
//! are used: the same bits on every machine. Knows nothing of properties or meshes.
//!
//! Source: Ottosson 2020; IEC 61966-2-1 for sRGB (docs/references.md).

/// Linear light of an sRGB value; both in 0..=1 where the colour is one that screens have.
pub fn linear_of_srgb(value: f64) -> f64 {
    if value <= 0.04045 {
        return value / 12.92;
    }
    // The power 2.4 is that of 2 times the fifth root of that of 2.
    let base = (value + 0.055) / 1.055;
    let square = base * base;
    square * fifth_root(square)
}

/// The sRGB value of linear light.
pub fn srgb_of_linear(light: f64) -> f64 {
    if light <= 0.003_130_8 {
        return light * 12.92;
    }
    // The power 5/12: the fourth root, of that the third root, of that the fifth power.
    let root = cube_root(light.sqrt().sqrt());
    let square = root * root;
    1.055 * (square * square * root) - 0.055
}

/// OKLab (lightness 0..=1, two opponent axes of about -0.4..=0.4) of linear light.
pub fn oklab_of_linear(rgb: [f64; 3]) -> [f64; 3] {
    let row = |m: [f64; 3]| m[0] * rgb[0] + m[1] * rgb[1] + m[2] * rgb[2];
    let l = cube_root(row([0.412_221_470_8, 0.536_332_536_3, 0.051_445_992_9]));
    let m = cube_root(row([0.211_903_498_2, 0.680_699_545_1, 0.107_396_956_6]));
    let s = cube_root(row([0.088_302_461_9, 0.281_718_837_6, 0.629_978_700_5]));
    [
        0.210_454_255_3 * l + 0.793_617_785_0 * m - 0.004_072_046_8 * s,
        1.977_998_495_1 * l - 2.428_592_205_0 * m + 0.450_593_709_9 * s,
        0.025_904_037_1 * l + 0.782_771_766_2 * m - 0.808_675_766_0 * s,
    ]
}

/// Linear light of an OKLab colour; outside of 0..=1 for colours that no screen has.
pub fn linear_of_oklab([lightness, a, b]: [f64; 3]) -> [f64; 3] {
    let cubed = |x: f64| x * x * x;
    let l = cubed(lightness + 0.396_337_777_4 * a + 0.215_803_757_3 * b);
    let m = cubed(lightness - 0.105_561_345_8 * a - 0.063_854_172_8 * b);
    let s = cubed(lightness - 0.089_484_177_5 * a - 1.291_485_548_0 * b);
    [
        4.076_741_662_1 * l - 3.307_711_591_3 * m + 0.230_969_929_2 * s,
        -1.268_438_004_6 * l + 2.609_757_401_1 * m - 0.341_319_396_5 * s,
        -0.004_196_086_3 * l - 0.703_418_614_7 * m + 1.707_614_701_0 * s,
    ]
}

/// The third root, also of negative numbers. Halley's steps from a guess by the exponent.
fn cube_root(x: f64) -> f64 {
    let size = x.abs();
    if !(size > 1e-300 && size.is_finite()) {
        return if size.is_finite() { 0.0 } else { x };
    }
    // A third of the exponent; the constant is two thirds of the bits of 1, minus what halves the error.
    let mut y = f64::from_bits(size.to_bits() / 3 + 0x2A9F_7893_0000_0000);
    for _ in 0..3 {
        let cube = y * y * y;
        y = y * (cube + 2.0 * size) / (2.0 * cube + size);
    }
    if x < 0.0 { -y } else { y }
}

/// The fifth root of a positive number.
fn fifth_root(x: f64) -> f64 {
    if !(x > 1e-300 && x.is_finite()) {
        return if x.is_finite() { 0.0 } else { x };
    }
    let mut y = f64::from_bits(x.to_bits() / 5 + 0x3323_3333_0000_0000);
    for _ in 0..4 {
        let fifth = y * y * y * y * y;
        y = y * (2.0 * fifth + 3.0 * x) / (3.0 * fifth + 2.0 * x);
    }
    y
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn roots_are_roots() {
        for i in 1..2000 {
            let x = f64::from(i) * 0.37e-3;
            assert!((cube_root(x) / x.cbrt() - 1.0).abs() < 1e-14, "{x}");
            assert!((fifth_root(x) / x.powf(0.2) - 1.0).abs() < 1e-14, "{x}");
        }
        assert!((cube_root(-1e-12) + 1e-4).abs() < 1e-17);
        assert_eq!((cube_root(0.0), fifth_root(0.0)), (0.0, 0.0));
        assert!(cube_root(f64::NAN).is_nan() && fifth_root(f64::NAN).is_nan());
    }

    #[test]
    fn known_colours_and_every_grey() {
        let lab = |rgb: [f64; 3]| oklab_of_linear(rgb.map(linear_of_srgb));
        let close = |a: [f64; 3], b: [f64; 3]| (0..3).all(|k| (a[k] - b[k]).abs() < 2e-4);
        assert!(close(lab([1.0; 3]), [1.0, 0.0, 0.0]));
        assert!(close(lab([1.0, 0.0, 0.0]), [0.6280, 0.2249, 0.1258]));
        assert!(close(lab([0.0, 0.0, 1.0]), [0.4520, -0.0325, -0.3115]));
        for value in 0..=255 {
            let srgb = f64::from(value) / 255.0;
            assert!((srgb_of_linear(linear_of_srgb(srgb)) - srgb).abs() < 1e-7, "{value}");
            let back = linear_of_oklab(lab([srgb; 3])).map(srgb_of_linear);
            assert!(back.iter().all(|c| (c * 255.0).round() == f64::from(value)), "{value}");
        }
    }
}
