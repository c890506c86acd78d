//! The usual JPEG, decoded straight into the pixels of an image.
//!
//! All other kinds and all that is damaged are left to the reader of all images, which says in words what is wrong.

use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

/// First bytes of a JPEG file.
const JPEG_MAGIC: &[u8] = b"\xff\xd8\xff";

/// Decodes the usual JPEG, colour of eight bits, without a copy; `None` for all else, and where anything is wrong.
pub(super) fn pixels_of(bytes: &[u8], size: [u32; 2]) -> Option<Vec<[u8; 4]>> {
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
    let mut pixels = vec![[0, 0, 0, 255]; size[0] as usize * size[1] as usize];
    decoder.decode_into(pixels.as_flattened_mut()).ok()?;
    Some(pixels)
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
        let pixels = pixels_of(&bytes, [37, 21]).unwrap();
        let general = image::load_from_memory(&bytes).unwrap().into_rgba8();
        assert_eq!(pixels.as_flattened(), general.as_raw());
        assert!(pixels_of(&bytes, [37, 20]).is_none());
        assert!(pixels_of(&bytes[..60], [37, 21]).is_none());
    }
}
