//! The usual JPEG, decoded straight into the pixels of an image, in its size or in up to an eighth of that.
//!
//! All other kinds and all that is damaged are left to the reader of all images, which says in words what is wrong.

use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

/// First bytes of a JPEG file.
const JPEG_MAGIC: &[u8] = b"\xff\xd8\xff";

/// Halvings of its size that a JPEG can be decoded in.
const MOST_HALVINGS: u32 = 3;

/// As many of the halvings of a size as a JPEG can be decoded in without a pixel that is cut off.
pub(super) fn possible_halvings([width, height]: [u32; 2], halvings: u32) -> u32 {
    halvings.min((width | height).trailing_zeros()).min(MOST_HALVINGS)
}

/// Decodes the usual JPEG, colour of eight bits, without a copy; `None` for all else, and where anything is wrong.
///
/// After `halvings`, of which as many are possible: each block of 8 x 8 pixels is made of its lowest frequencies alone.
pub(super) fn pixels_of(bytes: &[u8], size: [u32; 2], halvings: u32) -> Option<Vec<[u8; 4]>> {
    if !bytes.starts_with(JPEG_MAGIC) {
        return None;
    }
    let options = DecoderOptions::default()
        .set_strict_mode(false)
        .set_max_width(size[0] as usize)
        .set_max_height(size[1] as usize)
        .jpeg_set_out_colorspace(ColorSpace::RGBA);
    let mut decoder = zune_jpeg::JpegDecoder::new_with_options(ZCursor::new(bytes), options);
    decoder.decode_headers().ok()?;
    let found = decoder.info()?;
    let is_usual = decoder.input_colorspace() == Some(ColorSpace::YCbCr);
    if !is_usual || [found.width, found.height].map(u32::from) != size {
        return None;
    }
    if halvings > 0 {
        return small_pixels_of(bytes, size.map(|side| side >> halvings));
    }
    let mut pixels = vec![[0; 4]; size[0] as usize * size[1] as usize];
    decoder.decode_into(pixels.as_flattened_mut()).ok()?;
    Some(pixels)
}

/// The same in a half, a quarter or an eighth of the size: `small`.
fn small_pixels_of(bytes: &[u8], small: [u32; 2]) -> Option<Vec<[u8; 4]>> {
    let mut decoder = jpeg_decoder::Decoder::new(bytes);
    decoder.set_color_transform(jpeg_decoder::ColorTransform::YCbCr);
    let [width, height] = small.map(|side| side as u16);
    if decoder.scale(width, height).ok()? != (width, height) {
        return None;
    }
    let values = decoder.decode().ok()?;
    let pixels = values.as_chunks::<3>().0.iter().map(|&[r, g, b]| [r, g, b, 255]);
    (values.len() == 3 * small[0] as usize * small[1] as usize).then(|| pixels.collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Cursor;

    #[test]
    fn a_jpeg_is_decoded_as_by_its_general_reader() {
        let image = image::RgbImage::from_fn(37, 21, |x, y| {
            image::Rgb([(7 * x) as u8, (9 * y) as u8, (x * y) as u8])
        });
        let mut bytes = Cursor::new(Vec::new());
        image.write_to(&mut bytes, image::ImageFormat::Jpeg).unwrap();
        let bytes = bytes.into_inner();
        let pixels = pixels_of(&bytes, [37, 21], 0).unwrap();
        let general = image::load_from_memory(&bytes).unwrap().into_rgba8();
        assert_eq!(pixels.as_flattened(), general.as_raw());
        assert!(pixels_of(&bytes, [37, 20], 0).is_none());
        assert!(pixels_of(&bytes[..60], [37, 21], 0).is_none());
    }

    #[test]
    fn a_small_one_shows_the_means_of_squares() {
        let size = [48, 32];
        let value = |x: f64, y: f64| (128.0 + 90.0 * (x / 9.0).sin() * (y / 7.0).cos()) as u8;
        let image = image::RgbImage::from_fn(size[0], size[1], |x, y| {
            image::Rgb([value(x.into(), y.into()), value(y.into(), x.into()), 60])
        });
        let mut bytes = Vec::new();
        let encoder = image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, 95);
        image.write_with_encoder(encoder).unwrap();
        let whole = pixels_of(&bytes, size, 0).unwrap();
        for halvings in 1..=3 {
            assert_eq!(possible_halvings(size, halvings), halvings);
            let side = 1 << halvings;
            let small = pixels_of(&bytes, size, halvings).unwrap();
            assert_eq!(small.len() as u32, size[0] * size[1] / (side * side));
            for (i, pixel) in (0..).zip(&small) {
                let (x, y) = (i % (size[0] / side), i / (size[0] / side));
                let square = (0..side * side).map(|k| (x * side + k % side, y * side + k / side));
                let square = square.map(|(x, y)| whole[(y * size[0] + x) as usize]);
                let mean = |k: usize| {
                    square.clone().map(|pixel| u32::from(pixel[k])).sum::<u32>() / (side * side)
                };
                for (k, &value) in pixel.iter().enumerate().take(3) {
                    assert!(mean(k).abs_diff(value.into()) < 12, "{halvings} {x} {y} {k}");
                }
            }
        }
        assert_eq!(
            [[4096, 4094], [4095, 8], [64, 64]].map(|size| possible_halvings(size, 9)),
            [1, 0, 3]
        );
    }
}
