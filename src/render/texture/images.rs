//! Decoded images, as many as the memory for them holds; the longest unused goes first.
//!
//! An image comes with all its halves, so that no look-up skips texels. What cannot be decoded is noted and stays without
//! an image. Does not know materials.

use super::image_level::{ImageLevel, half_of};
use super::jpeg::possible_halvings;
use super::light_table::{Light, LightTable, pixel_of};
use super::map_use::MapUse;
use super::palette::{Palette, Picture, image_bytes};
use image::ImageEncoder;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::io::Cursor;
use std::sync::Arc;
use std::sync::{Mutex, OnceLock, PoisonError};
use stonecut_io::materials::{ImageData, all_missing, copy_bytes};
use stonecut_mesh::oklab::srgb_of_linear;
use stonecut_system::error::{Error, Result};
use stonecut_system::losses::{Ledger, Loss, LossKind};
use stonecut_system::parallel::{guarded, in_order};
use stonecut_system::progress::Progress;

/// Rows of a half that are made together, as a power of two.
const BAND_SHIFT: u32 = 6;

/// Shift of an image that is one band, whatever its rows.
const WHOLE_SHIFT: u32 = 30;

/// A decoded image: sRGB and opacity, in its size, and those rows of its halves that anything was looked up in.
pub struct Decoded {
    /// Halvings of the image before the first of the levels.
    n_left_out: usize,
    levels: Vec<Banded>,
    /// True if any of its pixels is not opaque; looked at when it is first asked for.
    has_opacity: OnceLock<bool>,
}

/// An image in one of its sizes, in bands of rows that are made when they are first looked up in.
struct Banded {
    size: [u32; 2],
    shift: u32,
    bands: Vec<OnceLock<Vec<[u8; 4]>>>,
}

/// First bytes of a KTX2 file.
const KTX2_MAGIC: &[u8] = b"\xabKTX 20\xbb\r\n\x1a\n";

impl Decoded {
    /// Decodes a picture, after as many halvings as cost no time; the error says in words why that is not possible.
    fn new(picture: &Picture, halvings: u32) -> Result<Decoded, String> {
        let bytes = bytes_of(&picture.data).map_err(|error| error.to_string())?;
        let small = (halvings > 0)
            .then(|| super::jpeg::pixels_of(&bytes, picture.size, halvings))
            .flatten();
        let mut level = match small {
            Some(pixels) => ImageLevel { size: picture.size.map(|side| side >> halvings), pixels },
            None => {
                let table = if picture.is_plain { LightTable::plain() } else { LightTable::new() };
                let whole = pixels_of(&bytes, picture.size)?;
                (0..halvings).fold(whole, |level, _| level.half(&table))
            }
        };
        if picture.is_opaque {
            level.pixels.iter_mut().for_each(|pixel| pixel[3] = 255);
        }
        Ok(Decoded { n_left_out: halvings as usize, ..Decoded::of_level(level) })
    }

    /// Decodes the file of an image whose head names `size`; the error says in words why that is not possible.
    pub(super) fn of_bytes(bytes: &[u8], size: [u32; 2]) -> Result<Decoded, String> {
        Ok(Decoded::of_level(pixels_of(bytes, size)?))
    }

    fn of_level(first: ImageLevel) -> Decoded {
        let mut size = first.size;
        let whole = vec![OnceLock::from(first.pixels)];
        let mut levels = vec![Banded { size, shift: WHOLE_SHIFT, bands: whole }];
        while size.iter().any(|&side| side > 1) {
            // Texels of an odd side are shared by neighbours.
            let is_even = size.iter().all(|side| side % 2 == 0);
            let shift = if is_even { BAND_SHIFT } else { WHOLE_SHIFT };
            size = half_of(size);
            let bands = (0..size[1].div_ceil(1 << shift)).map(|_| OnceLock::new()).collect();
            levels.push(Banded { size, shift, bands });
        }
        Decoded { n_left_out: 0, levels, has_opacity: OnceLock::new() }
    }

    /// A row of a level.
    fn row(&self, level: usize, y: usize, table: &LightTable) -> &[[u8; 4]] {
        let Banded { size, shift, .. } = &self.levels[level];
        let (band, width) = (y >> shift, size[0] as usize);
        &self.band(level, band, table)[(y - (band << shift)) * width..][..width]
    }

    /// The pixels of a band of a level.
    #[inline(always)]
    fn band(&self, level: usize, band: usize, table: &LightTable) -> &Vec<[u8; 4]> {
        let made = self.levels[level].bands[band].get();
        made.unwrap_or_else(|| self.make_band(level, band, table))
    }

    #[cold]
    fn make_band(&self, level: usize, band: usize, table: &LightTable) -> &Vec<[u8; 4]> {
        let Banded { shift, bands, .. } = &self.levels[level];
        bands[band].get_or_init(|| {
            let [width, height] = self.levels[level - 1].size;
            let from = |band: usize| ((2 * band) << shift).min(height as usize);
            let rows = from(band)..from(band + 1);
            let size = [width, rows.len() as u32];
            let rows: Vec<&[[u8; 4]]> = rows.map(|y| self.row(level - 1, y, table)).collect();
            ImageLevel { size, pixels: rows.concat() }.half(table).pixels
        })
    }

    /// Opacity that it stands for as an image of opacity, of a colour looked up in it: its own if any of its pixels is not
    /// opaque, otherwise the brightness of its values, not of their light.
    pub fn opacity_of(&self, light: Light) -> f32 {
        let [r, g, b, a] = pixel_of(light).map(|x| f32::from(x) / 255.0);
        let is_clear = |pixels: &Vec<[u8; 4]>| pixels.iter().any(|pixel| pixel[3] < 255);
        let has_opacity = || self.levels[0].bands[0].get().is_some_and(is_clear);
        if *self.has_opacity.get_or_init(has_opacity) { a } else { (r + g + b) / 3.0 }
    }

    /// The colour at coordinates (`MapUse::texels`), mixed of four texels, in the size in which a point is about `width` texels of the
    /// whole image apart from the next; `None` where coordinates are not numbers.
    pub fn at(
        &self,
        map: &MapUse,
        at: ([f32; 2], [bool; 2]),
        width: f32,
        table: &LightTable,
    ) -> Option<Light> {
        // Up to the root of 2 it is the whole image.
        let halvings = if width > 1.414 { width.log2().round() as usize } else { 0 };
        self.in_level(halvings, map, at, table)
    }

    /// The same, mixed of the two sizes around `width`: pictures show no step from one to the next.
    pub fn between(
        &self,
        map: &MapUse,
        at: ([f32; 2], [bool; 2]),
        width: f32,
        table: &LightTable,
    ) -> Option<Light> {
        let halvings = if width > 1.0 { width.log2() } else { 0.0 };
        let (low, share) = (halvings.floor(), halvings.fract());
        let fine = self.in_level(low as usize, map, at, table)?;
        let share_is_seen = share > 0.0;
        if !share_is_seen {
            return Some(fine);
        }
        let coarse = self.in_level(low as usize + 1, map, at, table)?;
        Some(std::array::from_fn(|i| fine[i] + share * (coarse[i] - fine[i])))
    }

    /// The colour at coordinates after some halvings, mixed of four texels.
    fn in_level(
        &self,
        halvings: usize,
        map: &MapUse,
        at: ([f32; 2], [bool; 2]),
        table: &LightTable,
    ) -> Option<Light> {
        let level = halvings.saturating_sub(self.n_left_out).min(self.levels.len() - 1);
        let Banded { size, shift, .. } = &self.levels[level];
        let (texels, share) = map.texels(at, *size)?;
        let bands = [texels[1][0] >> shift, texels[1][1] >> shift];
        let above = self.band(level, bands[0], table);
        let below = if bands[1] == bands[0] { above } else { self.band(level, bands[1], table) };
        let mut sum = [0.0; 4];
        for (y, pixels, row_share) in [(0, above, 1.0 - share[1]), (1, below, share[1])] {
            let start = (texels[1][y] - (bands[y] << shift)) * size[0] as usize;
            for (x, column_share) in [(0, 1.0 - share[0]), (1, share[0])] {
                let light = table.of(pixels[start + texels[0][x]]);
                for (sum, light) in sum.iter_mut().zip(light) {
                    *sum += row_share * column_share * light;
                }
            }
        }
        Some(sum)
    }
}

fn bytes_of(data: &ImageData) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    copy_bytes(data, |part| {
        bytes.reserve_exact(part.len());
        bytes.extend_from_slice(part);
        Ok(())
    })?;
    Ok(bytes)
}

/// Returns whether an image has pixels of opacity 0, in between, and 1.
pub(super) fn opacities(data: &ImageData, size: [u32; 2]) -> Result<[bool; 3]> {
    let bytes = bytes_of(data)?;
    let pixels = guarded(|| pixels_of(&bytes, size).map_err(Error::Usage))?.pixels;
    let mut found = [false; 3];
    for [_, _, _, opacity] in pixels {
        found[match opacity {
            0 => 0,
            255 => 2,
            _ => 1,
        }] = true;
    }
    Ok(found)
}

/// An image as PNG, with opacity if any of its pixels lets light through.
pub(super) fn as_png(data: &ImageData, size: [u32; 2]) -> Result<Vec<u8>> {
    let bytes = bytes_of(data)?;
    let pixels = guarded(|| pixels_of(&bytes, size).map_err(Error::Usage))?.pixels;
    let (values, kind) = match pixels.iter().any(|pixel| pixel[3] < 255) {
        true => (pixels.into_flattened(), image::ExtendedColorType::Rgba8),
        false => {
            let rgb = pixels.iter().flat_map(|pixel| [pixel[0], pixel[1], pixel[2]]);
            (rgb.collect(), image::ExtendedColorType::Rgb8)
        }
    };
    let mut png = Vec::new();
    let encoder = image::codecs::png::PngEncoder::new(&mut png);
    let written = encoder.write_image(&values, size[0], size[1], kind);
    written.map_err(|error| Error::Usage(format!("cannot make a PNG: {error}")))?;
    Ok(png)
}

/// Decodes the file of an image whose head names `size`; the error says in words why that is not possible.
fn pixels_of(bytes: &[u8], size: [u32; 2]) -> Result<ImageLevel, String> {
    if let Some(pixels) = super::jpeg::pixels_of(bytes, size, 0) {
        return Ok(ImageLevel { size, pixels });
    }
    if bytes.starts_with(KTX2_MAGIC) {
        #[cfg(feature = "ktx2")]
        return super::ktx2_image::pixels_of(bytes, size).map(ImageLevel::of_image);
        #[cfg(not(feature = "ktx2"))]
        return Err(
            "KTX2, which this build does not read; turn it into JPEG or PNG first (gltf-transform), or build with the \
             feature 'ktx2'"
                .to_owned(),
        );
    }
    let mut reader = image::ImageReader::new(Cursor::new(bytes))
        .with_guessed_format()
        .map_err(|error| error.to_string())?;
    // A TGA file has nothing at its beginning that tells it.
    if reader.format().is_none() {
        reader.set_format(image::ImageFormat::Tga);
    }
    let mut limits = image::Limits::default();
    // The header was looked at before; a decoder that finds another size is stopped.
    limits.max_image_width = Some(size[0]);
    limits.max_image_height = Some(size[1]);
    limits.max_alloc = Some(16 * image_bytes(size) + (16 << 20));
    reader.limits(limits);
    let is_linear = reader.format() == Some(image::ImageFormat::OpenExr);
    let decoded = reader.decode().map_err(|error| error.to_string())?;
    if !is_linear {
        return Ok(ImageLevel::of_image(decoded.into_rgba8()));
    }
    // OpenEXR holds light; brighter than white is white.
    let mut pixels = image::RgbaImage::new(decoded.width(), decoded.height());
    for (to, from) in pixels.pixels_mut().zip(decoded.into_rgba32f().pixels()) {
        let value = |x: f32| (255.0 * srgb_of_linear(f64::from(x).clamp(0.0, 1.0))).round() as u8;
        let [r, g, b, opacity] = from.0;
        to.0 = [value(r), value(g), value(b), (255.0 * opacity.clamp(0.0, 1.0)).round() as u8];
    }
    Ok(ImageLevel::of_image(pixels))
}

impl ImageLevel {
    fn of_image(image: image::RgbaImage) -> ImageLevel {
        let size = [image.width(), image.height()];
        ImageLevel { size, pixels: image.into_raw().as_chunks::<4>().0.to_vec() }
    }
}

/// Decoded images within a budget.
pub struct ImageCache<'a> {
    palette: &'a Palette,
    /// For decoded images.
    budget_bytes: u64,
    /// For a decoder at work, beside these.
    decoder_bytes: u64,
    /// Halvings with which each image is decoded.
    halvings: Vec<u32>,
    /// Of colours.
    pub table: LightTable,
    /// Of normal maps.
    pub plain: LightTable,
    held: Mutex<Held>,
}

#[derive(Default)]
struct Held {
    /// `None` for images that cannot be decoded.
    images: BTreeMap<usize, (u64, Option<Arc<Decoded>>)>,
    uses: u64,
    faults: ImageFaults,
}

/// Outcome of all decoding.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct ImageFaults {
    /// In words, by the number of the image.
    faults: BTreeMap<usize, String>,
    /// True if any image could be decoded.
    any_decoded: bool,
}

impl<'a> ImageCache<'a> {
    /// An empty cache; decoded pixels and decoders at work take at most `budget_bytes`, or one image and its decoder if they are
    /// more.
    pub fn new(palette: &'a Palette, budget_bytes: u64) -> Self {
        let (table, plain) = (LightTable::new(), LightTable::plain());
        let decoder_bytes = palette.decoder_bytes();
        let budget_bytes = budget_bytes.saturating_sub(decoder_bytes);
        let (halvings, held) = (vec![0; palette.images.len()], Mutex::default());
        ImageCache { palette, budget_bytes, decoder_bytes, halvings, table, plain, held }
    }

    /// Has each image decoded after its number of halvings from now on, as far as that takes no longer: those of JPEG.
    pub fn halve(&mut self, halvings: impl Fn(usize) -> u32) {
        let images = &mut self.held.get_mut().unwrap_or_else(PoisonError::into_inner).images;
        for (number, own) in self.halvings.iter_mut().enumerate() {
            let picture = self.palette.images[number].as_ref().filter(|picture| picture.is_jpeg);
            let wanted = picture.map_or(0, |p| possible_halvings(p.size, halvings(number)));
            let is_held = |(_, image): &(u64, Option<Arc<Decoded>>)| image.is_some();
            if wanted != *own && images.get(&number).is_some_and(is_held) {
                images.remove(&number);
            }
            *own = wanted;
        }
    }

    /// Gives up all decoded images.
    pub fn clear(&self) {
        self.held().images.clear();
    }

    /// Outcome of all decoding up to now.
    pub fn faults(&self) -> ImageFaults {
        self.held().faults.clone()
    }

    /// Goes on where another cache of the same images has stopped.
    pub fn resume(&self, faults: ImageFaults) {
        self.held().faults = faults;
    }

    /// Images that could not be decoded.
    pub fn losses(&self) -> Ledger {
        let (ImageFaults { faults, any_decoded }, mut losses) = (self.faults(), Ledger::default());
        // An image may be there twice, with its opacity and without.
        let mut named = BTreeSet::new();
        for (&number, fault) in &faults {
            let name = self.picture(number).map_or("", |picture| &picture.name);
            let reason =
                format!("cannot be decoded ({fault}): its material's colour stands for it");
            if named.insert(name) {
                let loss = Loss::new(LossKind::Images, "image", reason);
                losses.lose(loss.example(name));
            }
        }
        if !faults.is_empty() && !any_decoded {
            losses.lose(all_missing(named.len()));
        }
        losses
    }

    /// True if all images stay in memory.
    pub fn holds_all(&self) -> bool {
        let all = (0..self.palette.images.len()).map(|number| self.bytes(number));
        all.sum::<u64>() <= self.budget_bytes
    }

    /// As many of the images from the first on as the budget holds together, at least one.
    pub fn fitting(&self, numbers: &[usize]) -> usize {
        let mut sum = 0;
        let fits = |&&number: &&usize| {
            sum += self.bytes(number);
            sum <= self.budget_bytes
        };
        numbers.iter().take_while(fits).count().max(1).min(numbers.len())
    }

    /// Some images, decoded; `fitting` says how many can be had at a time.
    pub fn get(
        &self,
        numbers: &[usize],
        threads: usize,
        progress: &Progress,
    ) -> Result<Vec<Option<Arc<Decoded>>>> {
        let (missing, free) = self.make_room(numbers);
        let n_decoders = 1 + free / self.decoder_bytes.max(1);
        let threads = threads.min(usize::try_from(n_decoders).unwrap_or(threads));
        let decode = |i: u64, out: &mut Option<Result<Decoded, String>>| {
            let number = missing[i as usize];
            let picture = self.picture(number);
            let decoded = picture.map(|picture| {
                // A decoder that panics is a damaged image, not a fault of the run.
                guarded(|| Ok(Decoded::new(picture, self.halvings[number])))
                    .unwrap_or_else(|error| Err(error.to_string()))
            });
            *out = decoded;
            Ok(())
        };
        in_order(missing.len() as u64, threads, progress, decode, |i, decoded| {
            let number = missing[i as usize];
            let mut held = self.held();
            let image = match decoded.take() {
                Some(Ok(image)) => {
                    held.faults.any_decoded = true;
                    Some(Arc::new(image))
                }
                Some(Err(fault)) => {
                    held.faults.faults.insert(number, fault);
                    None
                }
                None => None,
            };
            let uses = held.uses;
            held.images.insert(number, (uses, image));
            Ok(())
        })?;
        let held = self.held();
        let image = |number: &usize| held.images.get(number).and_then(|(_, image)| image.clone());
        Ok(numbers.iter().map(image).collect())
    }

    /// Notes a use of all, and gives up others until those that are missing fit; returns the latter, and the bytes that are still
    /// free then.
    fn make_room(&self, numbers: &[usize]) -> (Vec<usize>, u64) {
        let mut held = self.held();
        held.uses += 1;
        let now = held.uses;
        let mut missing = Vec::new();
        for &number in numbers {
            match held.images.get_mut(&number) {
                Some((used, _)) => *used = now,
                None => missing.push(number),
            }
        }
        let wanted: u64 = missing.iter().map(|&number| self.bytes(number)).sum();
        let size = |(&number, (_, image)): (&usize, &(u64, Option<Arc<Decoded>>))| {
            if image.is_some() { self.bytes(number) } else { 0 }
        };
        let mut there: u64 = held.images.iter().map(size).sum();
        while there + wanted > self.budget_bytes {
            let idle =
                held.images.iter().filter(|(_, (used, image))| *used < now && image.is_some());
            let oldest = idle.min_by_key(|(number, (used, _))| (*used, **number));
            let Some((&number, _)) = oldest else { break };
            held.images.remove(&number);
            there -= self.bytes(number);
        }
        (missing, self.budget_bytes.saturating_sub(there + wanted))
    }

    fn bytes(&self, number: usize) -> u64 {
        let halved = |picture: &Picture| picture.size.map(|side| side >> self.halvings[number]);
        self.picture(number).map_or(0, |picture| image_bytes(halved(picture)))
    }

    fn picture(&self, number: usize) -> Option<&Picture> {
        self.palette.images.get(number)?.as_ref()
    }

    fn held(&self) -> std::sync::MutexGuard<'_, Held> {
        self.held.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use stonecut_io::materials::{ImageData, Part};

    #[test]
    fn light_is_mixed_not_its_values() {
        let table = LightTable::new();
        let level = |pixels: Vec<[u8; 4]>| ImageLevel { size: [2, 1], pixels };
        let half = level(vec![[0, 0, 0, 255], [255, 255, 255, 255]]).half(&table);
        assert_eq!(half.pixels, [[188, 188, 188, 255]]);
        // The colour of what cannot be seen does not count.
        let half = level(vec![[255, 0, 0, 0], [0, 0, 255, 255]]).half(&table);
        assert_eq!(half.pixels, [[0, 0, 255, 128]]);
        for value in 0..=255 {
            let pixel = [value, 255 - value, 7, 255];
            assert_eq!(pixel_of(table.of(pixel)), pixel);
        }
    }

    /// Pixels that have nothing to do with each other.
    fn noise(size: [u32; 2]) -> ImageLevel {
        let value = |i: u32| (i.wrapping_mul(2_654_435_761) >> 13).to_le_bytes();
        ImageLevel { size, pixels: (1..=size[0] * size[1]).map(value).collect() }
    }

    #[test]
    fn every_row_and_column_of_odd_sides_counts() {
        let table = LightTable::plain();
        let row = |values: &[u8]| {
            let pixels = values.iter().map(|&value| [value, value, value, 255]).collect();
            ImageLevel { size: [values.len() as u32, 1], pixels }
        };
        let half = |level: ImageLevel| level.half(&table);
        // A strip of three colours.
        assert_eq!(half(row(&[0, 0, 240])).pixels, [[80, 80, 80, 255]]);
        // Five columns become two of 2.5 each.
        let two = half(row(&[100, 50, 200, 50, 250])).pixels;
        assert_eq!(two, [[100, 100, 100, 255], [160, 160, 160, 255]]);
        // The same along the other side.
        let column = ImageLevel { size: [1, 3], ..row(&[0, 0, 240]) };
        assert_eq!(half(column).pixels, [[80, 80, 80, 255]]);
        // One colour stays what it is, whatever the size.
        for size in [[3, 5], [7, 2], [9, 1], [255, 3]] {
            let pixels = vec![[9, 130, 255, 255]; (size[0] * size[1]) as usize];
            let half = half(ImageLevel { size, pixels });
            assert_eq!(half.size, size.map(|side| (side / 2).max(1)));
            assert!(half.pixels.iter().all(|pixel| *pixel == [9, 130, 255, 255]), "{size:?}");
        }
    }

    #[test]
    fn a_pixel_of_even_sides_is_the_mean_of_four() {
        let table = LightTable::new();
        for size in [[6, 4], [2, 2], [8, 1], [1, 6]] {
            let level = noise(size);
            let half = level.half(&table);
            for (i, pixel) in (0..).zip(&half.pixels) {
                let (x, y) = (i % half.size[0], i / half.size[0]);
                let mut sum = [0.0; 4];
                for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                    let column = (2 * x + dx).min(size[0] - 1);
                    let row = (2 * y + dy).min(size[1] - 1);
                    let light = table.of(level.pixels[(row * size[0] + column) as usize]);
                    sum = std::array::from_fn(|k| sum[k] + 0.25 * light[k]);
                }
                assert_eq!(*pixel, table.pixel(sum), "{size:?}");
            }
        }
    }

    #[test]
    fn bands_of_halves_are_those_of_whole_halves() {
        let table = LightTable::new();
        for size in [[6, 1000], [512, 260], [12, 520], [7, 300]] {
            let (image, mut level) = (Decoded::of_level(noise(size)), noise(size));
            // From below: nothing but the rows that are asked for is there.
            for at in 1..image.levels.len() {
                level = level.half(&table);
                assert_eq!(image.levels[at].size, level.size);
                let rows = level.pixels.chunks_exact(level.size[0] as usize);
                for (y, row) in rows.enumerate().collect::<Vec<_>>().into_iter().rev() {
                    assert_eq!(image.row(at, y, &table), row, "{size:?} {at} {y}");
                }
            }
            assert_eq!(level.size, [1, 1]);
        }
        let image = Decoded::of_level(noise([512, 512]));
        image.row(1, 200, &table);
        let made = image.levels[1].bands.iter().filter(|band| band.get().is_some());
        assert_eq!((image.levels[1].bands.len(), made.count()), (4, 1));
    }

    fn decoded(pixels: &[[u8; 4]]) -> Decoded {
        let bytes = pixels.as_flattened().to_vec();
        let image = image::RgbaImage::from_raw(pixels.len() as u32, 1, bytes).unwrap();
        Decoded::of_level(ImageLevel::of_image(image))
    }

    #[test]
    fn an_image_has_opacity_or_brightness_for_all_its_pixels() {
        let table = LightTable::new();
        let (dark, clear) = ([20, 40, 30, 255], [250, 250, 250, 0]);
        // A leaf: what is dark is no less opaque for that.
        let leaf = decoded(&[dark, clear]);
        assert_eq!(leaf.opacity_of(table.of(dark)), 1.0);
        assert_eq!(leaf.opacity_of(table.of(clear)), 0.0);
        let grey = decoded(&[dark, [255; 4]]);
        let share = grey.opacity_of(table.of(dark));
        assert!((share - 30.0 / 255.0).abs() < 1e-6, "{share}");
        assert_eq!(grey.opacity_of(table.of([255; 4])), 1.0);
    }

    /// Colours stay where opacity does not count, in all sizes.
    #[test]
    fn an_opaque_picture_shows_the_colours_below_its_opacity() {
        let mut bytes = Cursor::new(Vec::new());
        let image = image::RgbaImage::from_pixel(4, 4, image::Rgba([200, 40, 0, 0]));
        image.write_to(&mut bytes, image::ImageFormat::Png).unwrap();
        let n_bytes = bytes.get_ref().len() as u64;
        let file =
            Arc::new(stonecut_io::ply::raw::RawFile::from_bytes("image", bytes.into_inner()));
        let data = ImageData::Inside(Part { file, offset: 0, n_bytes });
        let picture = |is_opaque: bool| Picture {
            data: data.clone(),
            name: String::new(),
            size: [4, 4],
            is_jpeg: false,
            decoder_bytes: 0,
            is_opaque,
            is_plain: false,
        };
        for (is_opaque, seen) in [(true, [200, 40, 0, 255]), (false, [0; 4])] {
            let decoded = Decoded::new(&picture(is_opaque), 0).unwrap();
            assert_eq!(decoded.levels.len(), 3);
            assert_eq!(decoded.row(2, 0, &LightTable::new()), [seen]);
            assert_eq!(decoded.opacity_of([0.0, 0.0, 0.0, 1.0]), f32::from(u8::from(!is_opaque)));
        }
    }
}
