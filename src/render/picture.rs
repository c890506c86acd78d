//! A finished picture: PNG out, side by side with others, captions.

use noto_sans_mono_bitmap::{FontWeight, RasterHeight, get_raster};
use stonecut_system::error::{Error, Result};

/// Pixels between pictures that stand side by side.
const GAP: u32 = 2;

/// An 8-bit sRGB picture.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Picture {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Three bytes a pixel, row by row from the top.
    pub rgb: Vec<u8>,
}

/// The size of a caption's letters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Letters {
    /// 16 pixels high.
    Small,
    /// 24 pixels high.
    Large,
}

impl Picture {
    /// A picture of one colour.
    pub fn new(width: u32, height: u32, color: [u8; 3]) -> Self {
        let n = width as usize * height as usize;
        Picture { width, height, rgb: color.iter().copied().cycle().take(3 * n).collect() }
    }

    /// Encodes the picture as PNG.
    ///
    /// Errors: a picture of no pixels.
    pub fn to_png(&self) -> Result<Vec<u8>> {
        let mut bytes = Vec::new();
        let encode = |bytes: &mut Vec<u8>| {
            let mut encoder = png::Encoder::new(bytes, self.width, self.height);
            encoder.set_color(png::ColorType::Rgb);
            encoder.set_depth(png::BitDepth::Eight);
            encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
            // By this a later run knows an image that it may replace.
            encoder.add_text_chunk("Software".to_owned(), "stonecut".to_owned())?;
            let mut writer = encoder.write_header()?;
            writer.write_image_data(&self.rgb)?;
            writer.finish()
        };
        encode(&mut bytes).map_err(|e| Error::Usage(format!("cannot make a PNG: {e}")))?;
        Ok(bytes)
    }

    /// Pictures from left to right, each under its caption; shorter ones are centred.
    pub fn side_by_side(parts: &[(&Picture, &str)]) -> Picture {
        let caption = if parts.iter().all(|(_, text)| text.is_empty()) { 0 } else { 40 };
        let width: u32 = parts.iter().map(|(p, _)| p.width + GAP).sum::<u32>().saturating_sub(GAP);
        let tallest = parts.iter().map(|(p, _)| p.height).max().unwrap_or(0);
        let mut out = Picture::new(width, tallest + caption, [255; 3]);
        let mut x = 0;
        for (part, text) in parts {
            out.paste(part, x, caption + (tallest - part.height) / 2);
            let letters = [Letters::Large, Letters::Small]
                .into_iter()
                .find(|letters| text_width(text, *letters) <= part.width)
                .unwrap_or(Letters::Small);
            let indent = part.width.saturating_sub(text_width(text, letters)) / 2;
            out.write_text(text, (x + indent, (40 - letters.height()) / 2), letters, [45, 50, 58]);
            x += part.width + GAP;
        }
        out
    }

    /// Copies another picture into this one; what lies outside is left out.
    pub fn paste(&mut self, other: &Picture, x: u32, y: u32) {
        let n = other.width.min(self.width.saturating_sub(x)) as usize * 3;
        for row in 0..other.height.min(self.height.saturating_sub(y)) {
            let from = (row * other.width) as usize * 3;
            let to = ((y + row) * self.width + x) as usize * 3;
            self.rgb[to..to + n].copy_from_slice(&other.rgb[from..from + n]);
        }
    }

    /// Writes one line of text with its upper left corner at `at`; what lies outside is left out, and
    /// letters that the font lacks become question marks.
    pub fn write_text(&mut self, text: &str, at: (u32, u32), letters: Letters, color: [u8; 3]) {
        let mut x = at.0;
        for letter in text.chars() {
            let glyph = get_raster(letter, FontWeight::Regular, letters.raster())
                .or_else(|| get_raster('?', FontWeight::Regular, letters.raster()));
            let Some(glyph) = glyph else { continue };
            for (dy, row) in (at.1..).zip(glyph.rows()) {
                for (dx, cover) in (x..).zip(row) {
                    if dx < self.width && dy < self.height {
                        let to = (dy * self.width + dx) as usize * 3;
                        for (old, new) in self.rgb[to..to + 3].iter_mut().zip(color) {
                            let (a, b, t) = (u32::from(*old), u32::from(new), u32::from(*cover));
                            *old = ((a * (255 - t) + b * t + 127) / 255) as u8;
                        }
                    }
                }
            }
            x += glyph.width() as u32;
        }
    }
}

impl Letters {
    fn raster(self) -> RasterHeight {
        match self {
            Letters::Small => RasterHeight::Size16,
            Letters::Large => RasterHeight::Size24,
        }
    }

    /// Height of a line in pixels.
    pub fn height(self) -> u32 {
        self.raster().val() as u32
    }
}

/// Returns the width of a line of text, in pixels.
pub fn text_width(text: &str, letters: Letters) -> u32 {
    let one = get_raster('?', FontWeight::Regular, letters.raster()).map_or(0, |g| g.width());
    (text.chars().count() * one) as u32
}
