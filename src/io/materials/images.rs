//! Looks at images without decoding them: kind, size, and whether their end is there.
//!
//! Reads the first MiB and the last KiB of an image, whatever its size says: memory is bounded for any file.

use super::description::{Image, ImageData, MapKind, Material, Materials};
use super::search::is_set_of_tiles;
use crate::ply::raw::RawFile;
use std::ops::Range;
use std::path::Path;
use stonecut_system::error::{Error, Result};

/// Bytes at the beginning that hold the size of any real image.
const HEAD_BYTES: u64 = 1 << 20;

/// Bytes at the end that hold the end mark; some programs append a few more.
const TAIL_BYTES: u64 = 1 << 10;

/// Longer sides than these are drawn by no graphics card.
const MAX_SIDE: usize = 32_768;

/// Bytes that are copied at once.
const COPY_BYTES: usize = 1 << 20;

/// Kinds of images that are not read: place and bytes of their mark, and name.
const OTHERS: [(usize, &[u8], &str); 11] = [
    (4, b"ftypavi", "AVIF"),
    (4, b"ftyphe", "HEIC"),
    (4, b"ftypmif1", "HEIF or AVIF"),
    (4, b"JXL ", "JPEG XL"),
    (0, b"\xff\x0a", "JPEG XL"),
    (4, b"jP  ", "JPEG 2000"),
    (0, b"\xff\x4f\xff\x51", "JPEG 2000"),
    (0, b"8BPS", "PSD"),
    (0, b"#?RADIANCE", "Radiance HDR"),
    (0, b"qoif", "QOI"),
    (0, b"<svg", "SVG"),
];

/// Findings of a look at an image.
#[derive(Clone, Debug, PartialEq)]
pub struct ImageFacts {
    pub n_bytes: u64,
    /// The type as glTF names it, for the two that every reader of glTF knows, WebP and KTX2.
    pub mime: Option<&'static str>,
    /// The ending of a file of this type.
    pub ending: &'static str,
    /// Width and height that the header says.
    pub size: Option<[u32; 2]>,
    /// Bytes of a pixel while it is decoded, at most, beside those of the finished one.
    pub decoder_pixel_bytes: u64,
    /// True if its pixels have opacity, as far as the header of a PNG, WebP or TGA tells.
    pub has_opacity: bool,
    /// True if a side is longer than programs can show.
    pub is_too_large: bool,
    /// Reason why other programs may refuse it.
    pub fault: Option<String>,
}

/// Looks at an image; an error only says in words why it cannot be used at all.
pub fn look(data: &ImageData) -> Result<ImageFacts, String> {
    let opened;
    let (file, offset, n_bytes) = match data {
        ImageData::Inside(part) => (&*part.file, part.offset, part.n_bytes),
        ImageData::File(path) => {
            if !path.exists() && is_set_of_tiles(path) {
                return Err(
                    "is a set of tiles (UDIM), which is not read: make one image of them first"
                        .to_owned(),
                );
            }
            if !path.exists() {
                return Err("is not there".to_owned());
            }
            opened = RawFile::open(path).map_err(|error| error.to_string())?;
            (&opened, 0, opened.len())
        }
    };
    let part = |from: u64, n: u64| {
        let mut bytes = vec![0; n as usize];
        file.read_exact_at(&mut bytes, offset + from).map_err(|error| error.to_string())?;
        Ok::<_, String>(bytes)
    };
    let head = part(0, n_bytes.min(HEAD_BYTES))?;
    let n_tail = n_bytes.min(TAIL_BYTES);
    let tail = part(n_bytes - n_tail, n_tail)?;
    let (mime, ending, end_mark): (_, _, &[u8]) = match imagesize::image_type(&head) {
        Ok(imagesize::ImageType::Png) => (Some("image/png"), "png", b"IEND"),
        Ok(imagesize::ImageType::Jpeg) => (Some("image/jpeg"), "jpg", b"\xff\xd9"),
        Ok(imagesize::ImageType::Webp) => (Some("image/webp"), "webp", b""),
        Ok(imagesize::ImageType::Bmp) => (None, "bmp", b""),
        Ok(imagesize::ImageType::Gif) => (None, "gif", b""),
        Ok(imagesize::ImageType::Tga) => (None, "tga", b""),
        Ok(imagesize::ImageType::Tiff) => (None, "tif", b""),
        Ok(imagesize::ImageType::Exr) => (None, "exr", b""),
        Ok(imagesize::ImageType::Dds(_)) => (None, "dds", b""),
        Ok(imagesize::ImageType::Ktx2) => (Some("image/ktx2"), "ktx2", b""),
        _ if n_bytes == 0 => return Err("is empty".to_owned()),
        _ => {
            let other = OTHERS
                .iter()
                .find(|(at, mark, _)| head.get(*at..).is_some_and(|h| h.starts_with(mark)));
            return Err(other.map_or_else(
                || "is not an image of a known type".to_owned(),
                |(_, _, name)| format!("is {name}, which is not read: make it a PNG or JPEG first"),
            ));
        }
    };
    let found = imagesize::blob_size(&head);
    let fault = match &found {
        Err(_) => Some("its size cannot be read from its header".to_owned()),
        Ok(size) if size.width == 0 || size.height == 0 => Some("it has no pixels".to_owned()),
        Ok(size) if size.width > MAX_SIDE || size.height > MAX_SIDE => Some(format!(
            "its header says {} x {} pixels, more than the {MAX_SIDE} a side that programs can show",
            size.width, size.height
        )),
        Ok(_) if end_mark.is_empty() || tail.windows(end_mark.len()).any(|w| w == end_mark) => None,
        // Cameras and phones append films and further pictures.
        Ok(_) if ending == "jpg" && ends_within(&head, file, offset..offset + n_bytes)? => None,
        Ok(_) => Some("its end is missing; it was cut off".to_owned()),
    };
    let side = |n: usize| u32::try_from(n).ok().filter(|&n| n > 0);
    let size = found.ok().and_then(|size| Some([side(size.width)?, side(size.height)?]));
    let is_too_large = size.is_some_and(|size| size.iter().any(|&n| n as usize > MAX_SIDE));
    Ok(ImageFacts {
        n_bytes,
        mime,
        ending,
        size,
        decoder_pixel_bytes: decoder_pixel_bytes(&head, ending),
        has_opacity: has_opacity(&head, ending),
        is_too_large,
        fault,
    })
}

/// Returns whether the end mark of a JPEG follows somewhere behind the beginning of its pixels, in which no mark can be.
fn ends_within(head: &[u8], file: &RawFile, bytes: Range<u64>) -> Result<bool, String> {
    const PIXELS: u8 = 0xda;
    let mut at = 2;
    while let Some(&[0xff, marker, high, low, ..]) = head.get(at..) {
        at += 2 + usize::from(u16::from_be_bytes([high, low]));
        if marker == PIXELS {
            let (mut found, mut last) = (false, 0);
            let each = |piece: &[u8]| {
                found |= last == 0xff && piece.first() == Some(&0xd9);
                found |= piece.windows(2).any(|pair| pair == b"\xff\xd9");
                last = piece.last().copied().unwrap_or(last);
                Ok(())
            };
            let pixels = (bytes.start + at as u64).min(bytes.end)..bytes.end;
            file.each_piece(pixels, COPY_BYTES, each).map_err(|error| error.to_string())?;
            return Ok(found);
        }
    }
    Ok(false)
}

/// Returns whether the pixels of an image have opacity, by the head of its file.
fn has_opacity(head: &[u8], ending: &str) -> bool {
    let byte = |at: usize| head.get(at).copied().unwrap_or(0);
    match ending {
        "png" => {
            let pixels = head.windows(4).position(|name| name == b"IDAT").unwrap_or(head.len());
            matches!(byte(25), 4 | 6) || head[..pixels].windows(4).any(|name| name == b"tRNS")
        }
        "webp" => match head.get(12..16) {
            Some(b"VP8X") => byte(20) & 0x10 != 0,
            Some(b"VP8L") => byte(24) & 0x10 != 0,
            _ => false,
        },
        "tga" => byte(16) == 32,
        _ => false,
    }
}

/// Bytes of a pixel that a decoder holds beside the four of the finished one, as far as the head of the file tells.
fn decoder_pixel_bytes(head: &[u8], ending: &str) -> u64 {
    let bytes = match ending {
        // Depth and channels; those of a palette are looked up.
        "png" => match (head.get(24), head.get(25)) {
            (Some(16), Some(0)) => 2,
            (Some(16), Some(4)) => 4,
            (Some(16), Some(2)) => 6,
            (Some(16), _) => 8,
            _ => 4,
        },
        "jpg" => jpeg_pixel_bytes(head),
        "webp" | "gif" | "ktx2" => 8,
        "tif" => 16,
        // Three halves or floats become four floats.
        "exr" => 32,
        _ => 4,
    };
    // The finished pixels are copied once.
    bytes.max(4)
}

/// The same of a JPEG: its components and, where it is progressive, their coefficients.
fn jpeg_pixel_bytes(head: &[u8]) -> u64 {
    const MOST: u64 = 12;
    let mut at = 2;
    while let Some(&[0xff, marker, high, low, ..]) = head.get(at..) {
        let is_frame = (0xc0..=0xcf).contains(&marker) && ![0xc4, 0xc8, 0xcc].contains(&marker);
        if is_frame {
            let n = head.get(at + 9).map_or(4, |&n| u64::from(n.clamp(3, 4)));
            return if marker == 0xc0 || marker == 0xc1 { n } else { 3 * n };
        }
        at += 2 + usize::from(u16::from_be_bytes([high, low]));
    }
    MOST
}

impl Materials {
    /// Returns whether the colour image of a material has opacity, which no other image says.
    pub fn has_clear_base(&self, material: &Material) -> bool {
        let map = |kind: MapKind| material.map(kind).map(|map| (map.image, &map.options));
        let base = map(MapKind::Base);
        let opacity = map(MapKind::Opacity);
        (opacity.is_none() || opacity == base)
            && base.is_some_and(|(image, _)| {
                look(&self.images[image].data).is_ok_and(|facts| facts.has_opacity)
            })
    }

    /// Names of the images; with `missing` only of those that cannot be read.
    pub fn image_names(&self, missing: bool) -> Vec<String> {
        let is_wanted = |image: &&Image| !missing || look(&image.data).is_err();
        self.images.iter().filter(is_wanted).map(|image| image.name.clone()).collect()
    }

    /// Width and height of the images that can be read, as their headers have them, in the order of the names.
    pub fn image_pixels(&self) -> Vec<Option<[u32; 2]>> {
        self.images.iter().map(|image| look(&image.data).ok()?.size).collect()
    }
}

/// Width and height of the file of a JPEG, PNG or KTX2 image, which is whole; the error says in words what is wrong with it.
pub fn image_size(bytes: &[u8]) -> Result<[u32; 2], String> {
    let end_mark: &[u8] = match imagesize::image_type(bytes) {
        Ok(imagesize::ImageType::Png) => b"IEND",
        Ok(imagesize::ImageType::Jpeg) => b"\xff\xd9",
        // Decoders find out where the data of a level ends.
        Ok(imagesize::ImageType::Ktx2) => b"",
        _ => return Err("is neither JPEG nor PNG nor KTX2".to_owned()),
    };
    let tail = &bytes[bytes.len().saturating_sub(TAIL_BYTES as usize)..];
    if !end_mark.is_empty() && !tail.windows(end_mark.len()).any(|window| window == end_mark) {
        return Err("was cut off".to_owned());
    }
    let size = imagesize::blob_size(bytes).map_err(|_| "has no size".to_owned())?;
    match (u32::try_from(size.width), u32::try_from(size.height)) {
        (Ok(width), Ok(height)) if width > 0 && height > 0 => Ok([width, height]),
        _ => Err("has no pixels".to_owned()),
    }
}

/// Hands the bytes of an image to `each`, a MiB at a time; returns their number.
pub fn copy_bytes(data: &ImageData, each: impl FnMut(&[u8]) -> Result<()>) -> Result<u64> {
    let opened;
    let (file, offset, n_bytes) = match data {
        ImageData::Inside(part) => (&*part.file, part.offset, part.n_bytes),
        ImageData::File(path) => {
            opened = RawFile::open(path)?;
            (&opened, 0, opened.len())
        }
    };
    file.each_piece(offset..offset + n_bytes, COPY_BYTES, each)?;
    Ok(n_bytes)
}

/// Returns whether a file has the very bytes of an image.
pub(super) fn is_same(data: &ImageData, path: &Path) -> Result<bool> {
    let other = RawFile::open(path)?;
    let (mut at, mut same) = (0, true);
    let mut theirs = Vec::new();
    let n_bytes = copy_bytes(data, |ours| {
        theirs.resize(ours.len(), 0);
        let n = other.read_at_most(&mut theirs, at)?;
        same &= n == ours.len() && theirs == ours;
        at += ours.len() as u64;
        Ok(())
    });
    match n_bytes {
        Ok(n) => Ok(same && n == other.len()),
        Err(Error::BadInput { .. }) => Ok(false),
        Err(error) => Err(error),
    }
}

#[cfg(test)]
mod tests {
    use super::super::description::Part;
    use super::*;
    use std::sync::Arc;

    fn inside(bytes: Vec<u8>) -> ImageData {
        let n_bytes = bytes.len() as u64;
        let file = Arc::new(RawFile::from_bytes("image", bytes));
        ImageData::Inside(Part { file, offset: 0, n_bytes })
    }

    /// The beginning of a PNG of a size, and its end mark.
    fn png(width: u32, height: u32) -> Vec<u8> {
        let mut out = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR".to_vec();
        out.extend(width.to_be_bytes());
        out.extend(height.to_be_bytes());
        out.extend(b"\x08\x02\0\0\0\0\0\0\0\0\0\0\0IEND\xaeB`\x82");
        out
    }

    #[test]
    fn faults_of_images_are_named_without_decoding_them() {
        let fault = |bytes: Vec<u8>| look(&inside(bytes)).map(|facts| facts.fault);
        assert_eq!(fault(png(64, 64)), Ok(None));
        let huge = fault(png(100_000, 100_000)).unwrap().unwrap();
        assert!(huge.contains("100000 x 100000"), "{huge}");
        let mut cut = png(64, 64);
        cut.truncate(cut.len() - 8);
        assert!(fault(cut).unwrap().unwrap().contains("cut off"));
        assert_eq!(
            fault(b"newmtl a\nKd 1 1 1\n".to_vec()),
            Err("is not an image of a known type".into())
        );
        assert_eq!(fault(Vec::new()), Err("is empty".into()));
        let missing = ImageData::File("/nowhere/at/all.png".into());
        assert_eq!(look(&missing), Err("is not there".into()));
        // No prefix of an image makes a panic.
        let jpeg = b"\xff\xd8\xff\xe0\0\x10JFIF\0\x01\x01\0\0\x01\0\x01\0\0\xff\xc0\0\x11\x08\0\x10\0\x10\x03\x01\x22\0\x02\x11\x01\x03\x11\x01\xff\xd9";
        for bytes in [png(9, 9), jpeg.to_vec()] {
            for n in 0..bytes.len() {
                let _ = look(&inside(bytes[..n].to_vec()));
            }
        }
    }
}
