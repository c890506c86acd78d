//! Decoded images, as many as the memory for them holds; the longest unused goes first.
//!
//! An image comes with all its halves, so that no look-up skips texels. What cannot be decoded is noted and stays without
//! an image. Does not know materials.

use super::jpeg::possible_halvings;
use super::light_table::{Light, LightTable, LightValues, pixel_of};
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

/// A decoded image: sRGB and opacity, in its size, and in the halves of it that anything was looked up in.
pub struct Decoded {
    /// Halvings of the image before the first of the levels.
    n_left_out: usize,
    levels: Vec<OnceLock<ImageLevel>>,
    /// True if any of its pixels is not opaque; looked at when it is first asked for.
    has_opacity: OnceLock<bool>,
}

/// Pixels in rows of a width.
pub(super) struct ImageLevel {
    pub(super) size: [u32; 2],
    pub(super) pixels: Vec<[u8; 4]>,
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
        let size = first.size;
        let n_levels = 1 + size[0].max(size[1]).max(1).ilog2() as usize;
        let mut levels = vec![OnceLock::from(first)];
        levels.resize_with(n_levels, OnceLock::new);
        Decoded { n_left_out: 0, levels, has_opacity: OnceLock::new() }
    }

    /// The image after some halvings, or as often as it can be halved; made when it is first asked for.
    fn level(&self, halvings: usize, table: &LightTable) -> &ImageLevel {
        self.made(halvings.saturating_sub(self.n_left_out).min(self.levels.len() - 1), table)
    }

    fn made(&self, at: usize, table: &LightTable) -> &ImageLevel {
        self.levels[at].get_or_init(|| self.made(at - 1, table).half(table))
    }

    /// Opacity that it stands for as an image of opacity, of a colour looked up in it: its own if any of its pixels is not
    /// opaque, otherwise the brightness of its values, not of their light.
    pub fn opacity_of(&self, light: Light) -> f32 {
        let [r, g, b, a] = pixel_of(light).map(|x| f32::from(x) / 255.0);
        let is_clear = |level: &ImageLevel| level.pixels.iter().any(|pixel| pixel[3] < 255);
        let has_opacity = || self.levels[0].get().is_some_and(is_clear);
        if *self.has_opacity.get_or_init(has_opacity) { a } else { (r + g + b) / 3.0 }
    }

    /// The colour at coordinates, mixed of four texels, in the size in which a point is about `width` texels of the
    /// whole image apart from the next; `None` where coordinates are not numbers.
    pub fn at(&self, map: &MapUse, uv: [f32; 2], width: f32, table: &LightTable) -> Option<Light> {
        // Up to the root of 2 it is the whole image.
        let halvings = if width > 1.414 { width.log2().round() as usize } else { 0 };
        self.in_level(halvings, map, uv, table)
    }

    /// The same, mixed of the two sizes around `width`: pictures show no step from one to the next.
    pub fn between(
        &self,
        map: &MapUse,
        uv: [f32; 2],
        width: f32,
        table: &LightTable,
    ) -> Option<Light> {
        let halvings = if width > 1.0 { width.log2() } else { 0.0 };
        let (low, share) = (halvings.floor(), halvings.fract());
        let fine = self.in_level(low as usize, map, uv, table)?;
        let share_is_seen = share > 0.0;
        if !share_is_seen {
            return Some(fine);
        }
        let coarse = self.in_level(low as usize + 1, map, uv, table)?;
        Some(std::array::from_fn(|i| fine[i] + share * (coarse[i] - fine[i])))
    }

    /// The colour at coordinates after some halvings, mixed of four texels.
    fn in_level(
        &self,
        halvings: usize,
        map: &MapUse,
        uv: [f32; 2],
        table: &LightTable,
    ) -> Option<Light> {
        let level = self.level(halvings, table);
        let (texels, share) = map.texels(uv, level.size)?;
        let mut sum = [0.0; 4];
        for (y, row_share) in [(0, 1.0 - share[1]), (1, share[1])] {
            for (x, column_share) in [(0, 1.0 - share[0]), (1, share[0])] {
                let at = texels[1][y] * level.size[0] as usize + texels[0][x];
                let light = table.of(level.pixels[at]);
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

/// Texels along a side of `n` that become texel `to` of half the side, and their shares: two, and three of an odd side.
fn merged(n: u32, to: u32) -> impl Iterator<Item = (usize, f32)> {
    let half = n / 2;
    let has_three = n % 2 == 1 && half > 0;
    // Of an odd side each takes 2 + 1 / half: the outer ones of three are shared with the neighbours.
    let shares = match has_three {
        true => [half - to, half, to + 1].map(|share| share as f32 / n as f32),
        false => [0.5, 0.5, 0.0],
    };
    let texel = move |(k, share): (u32, f32)| ((2 * to + k).min(n - 1) as usize, share);
    (0..).zip(shares).take(if has_three { 3 } else { 2 }).map(texel)
}

impl ImageLevel {
    fn of_image(image: image::RgbaImage) -> ImageLevel {
        let size = [image.width(), image.height()];
        ImageLevel { size, pixels: image.into_raw().as_chunks::<4>().0.to_vec() }
    }

    /// The same in half the size, rounded down.
    pub(super) fn half(&self, table: &LightTable) -> ImageLevel {
        let size = self.size.map(|side| (side / 2).max(1));
        let mut pixels = Vec::with_capacity(size[0] as usize * size[1] as usize);
        if self.size.iter().all(|side| side % 2 == 0) {
            // The sums of below, many times as fast.
            let values = LightValues::all();
            let light = |value: u8| table.light[usize::from(value)];
            for rows in self.pixels.chunks_exact(2 * self.size[0] as usize) {
                let (upper, lower) = rows.split_at(self.size[0] as usize);
                let pairs = upper.as_chunks::<2>().0.iter().zip(lower.as_chunks::<2>().0);
                pixels.extend(pairs.map(|(&[a, b], &[c, d])| {
                    let is_opaque = a[3] & b[3] & c[3] & d[3] == 255;
                    if is_opaque && !table.is_plain {
                        let mean = |k: usize| {
                            0.25 * (light(a[k]) + light(b[k]) + light(c[k]) + light(d[k]))
                        };
                        return [values.of(mean(0)), values.of(mean(1)), values.of(mean(2)), 255];
                    }
                    let [a, b, c, d] = [a, b, c, d].map(|pixel| table.of(pixel));
                    let mean = |k: usize| 0.25 * (a[k] + b[k] + c[k] + d[k]);
                    table.pixel([mean(0), mean(1), mean(2), mean(3)])
                }));
            }
            return ImageLevel { size, pixels };
        }
        for y in 0..size[1] {
            for x in 0..size[0] {
                let mut sum = [0.0; 4];
                for (row, row_share) in merged(self.size[1], y) {
                    for (column, column_share) in merged(self.size[0], x) {
                        let light = table.of(self.pixels[row * self.size[0] as usize + column]);
                        for (sum, light) in sum.iter_mut().zip(light) {
                            *sum += row_share * column_share * light;
                        }
                    }
                }
                pixels.push(table.pixel(sum));
            }
        }
        ImageLevel { size, pixels }
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
            assert_eq!(decoded.level(2, &LightTable::new()).pixels, [seen]);
            assert_eq!(decoded.opacity_of([0.0, 0.0, 0.0, 1.0]), f32::from(u8::from(!is_opaque)));
        }
    }
}
