//! Images in KTX2 files, as `KHR_texture_basisu` has them: Basis Universal (ETC1S or UASTC), and plain bytes.
//!
//! The transcoder reads `.basis` files only, so the parts of a KTX2 file are put together as one.
//! Only the largest level is read; smaller ones are made of it as of every other image. Of the description of the format only
//! the colour model counts; the crate's reader, which parses all of it, panics where its sizes of blocks overflow.

use super::palette::image_bytes;
use basis_universal::{TranscodeParameters, Transcoder, TranscoderTextureFormat, transcoder_init};
use ktx2::{ColorModel, Format, Header, LevelIndex, SupercompressionScheme};

/// Bytes of the header of a `.basis` file, and of the description of a slice.
const HEADER_BYTES: usize = 77;
pub(super) const SLICE_BYTES: usize = 23;

/// Bytes of the global data of ETC1S before its descriptions of images, and of such a description.
const GLOBAL_BYTES: usize = 20;
const IMAGE_BYTES: usize = 20;

/// Pixels of a KTX2 file, whose header says `size`; the error says in words why there are none.
pub(super) fn pixels_of(bytes: &[u8], size: [u32; 2]) -> Result<image::RgbaImage, String> {
    let damaged = || "its KTX2 data is damaged".to_owned();
    let part = |offset: u64, n: u64| {
        let begin = usize::try_from(offset).ok()?;
        bytes.get(begin..begin.checked_add(usize::try_from(n).ok()?)?)
    };
    let first = bytes.first_chunk().and_then(|first| Header::from_bytes(first).ok());
    let header = first.ok_or_else(damaged)?;
    let level = bytes.get(Header::LENGTH..).and_then(<[u8]>::first_chunk);
    let level = level.map(LevelIndex::from_bytes).ok_or_else(damaged)?;
    let level = part(level.byte_offset, level.byte_length).ok_or_else(damaged)?;
    let global = part(header.index.sgd_byte_offset, header.index.sgd_byte_length);
    // A basic block has zeros for vendor and type, behind the length of all blocks; its third word begins with the model.
    let description = part(header.index.dfd_byte_offset.into(), 13).ok_or_else(damaged)?;
    let is_basic = description[4..8] == [0; 4];
    let model = if is_basic { ColorModel::new(description[12]) } else { None };
    if [header.pixel_width, header.pixel_height] != size {
        return Err("its size is not that of its header".to_owned());
    }
    if header.pixel_depth > 1 || header.layer_count > 1 || header.face_count > 1 {
        return Err("it is more than one picture (layers, faces or depth)".to_owned());
    }
    let blocks = size.map(|side| u64::from(side.div_ceil(4)));
    let expected = match (header.format, model) {
        (Some(Format::R8G8B8_SRGB | Format::R8G8B8_UNORM), _) => 3 * pixels(size),
        (Some(Format::R8G8B8A8_SRGB | Format::R8G8B8A8_UNORM), _) => 4 * pixels(size),
        (None, Some(ColorModel::UASTC)) => 16 * blocks[0] * blocks[1],
        (None, Some(ColorModel::ETC1S)) => 0,
        (Some(format), _) => {
            return Err(format!(
                "KTX2 of format {}, of which only Basis Universal and plain bytes are read",
                format.value()
            ));
        }
        (None, _) => return Err("KTX2 of an unknown colour model".to_owned()),
    };
    let unpacked;
    let data = match header.supercompression_scheme {
        None | Some(SupercompressionScheme::BasisLZ) => level,
        Some(SupercompressionScheme::Zstandard) => {
            unpacked = zstd::bulk::decompress(level, expected as usize).map_err(|_| damaged())?;
            &unpacked[..]
        }
        Some(_) => {
            return Err("KTX2 with another compression than BasisLZ and Zstandard".to_owned());
        }
    };
    if (data.len() as u64) < expected {
        return Err("its KTX2 data was cut off".to_owned());
    }
    let raw = match (header.format, model) {
        (Some(Format::R8G8B8_SRGB | Format::R8G8B8_UNORM), _) => data[..expected as usize]
            .as_chunks::<3>()
            .0
            .iter()
            .flat_map(|&[r, g, b]| [r, g, b, 255])
            .collect(),
        (Some(_), _) => data[..expected as usize].to_vec(),
        (None, Some(ColorModel::ETC1S)) => {
            transcoded(&etc1s_file(&header, global.ok_or_else(damaged)?, data)?, size)?
        }
        (None, _) => transcoded(&uastc_file(&header, &data[..expected as usize]), size)?,
    };
    image::RgbaImage::from_raw(size[0], size[1], raw)
        .ok_or_else(|| "its pixels are not all there".to_owned())
}

fn pixels([width, height]: [u32; 2]) -> u64 {
    u64::from(width) * u64::from(height)
}

/// The pixels of the first image of a `.basis` file.
fn transcoded(file: &[u8], size: [u32; 2]) -> Result<Vec<u8>, String> {
    let damaged = || "its Basis Universal data is damaged".to_owned();
    transcoder_init();
    let mut transcoder = Transcoder::new();
    if !transcoder.validate_header(file) {
        return Err(damaged());
    }
    transcoder.prepare_transcoding(file).map_err(|()| damaged())?;
    let parameters =
        TranscodeParameters { image_index: 0, level_index: 0, ..TranscodeParameters::default() };
    let pixels =
        transcoder.transcode_image_level(file, TranscoderTextureFormat::RGBA32, parameters);
    transcoder.end_transcoding();
    let pixels = pixels.map_err(|_| damaged())?;
    if pixels.len() as u64 > image_bytes(size) {
        return Err(damaged());
    }
    Ok(pixels)
}

/// A slice of a `.basis` file: its data, and whether it is opacity.
struct Slice<'a> {
    data: &'a [u8],
    is_opacity: bool,
}

/// Codebooks of ETC1S; empty for UASTC.
#[derive(Default)]
struct Codebooks<'a> {
    n_endpoints: u16,
    endpoints: &'a [u8],
    n_selectors: u16,
    selectors: &'a [u8],
    tables: &'a [u8],
}

fn uastc_file(header: &Header, data: &[u8]) -> Vec<u8> {
    basis_file(header, &Codebooks::default(), &[Slice { data, is_opacity: true }])
}

/// Puts the global data of BasisLZ and the slices of the first level together (KTX 2.0, section 5).
fn etc1s_file(header: &Header, global: &[u8], level: &[u8]) -> Result<Vec<u8>, String> {
    let damaged = || "its BasisLZ data is damaged".to_owned();
    let word = |at: usize| {
        let bytes = global.get(at..at + 4)?;
        Some(u32::from_le_bytes(bytes.try_into().ok()?) as usize)
    };
    let half = |at: usize| Some(u16::from_le_bytes([*global.get(at)?, *global.get(at + 1)?]));
    let read = || {
        let n_images = header.level_count.max(1) as usize;
        let mut at = GLOBAL_BYTES.checked_add(n_images.checked_mul(IMAGE_BYTES)?)?;
        let mut part = |n: usize| {
            let bytes = global.get(at..at.checked_add(n)?)?;
            at += n;
            Some(bytes)
        };
        let codebooks = Codebooks {
            n_endpoints: half(0)?,
            n_selectors: half(2)?,
            endpoints: part(word(4)?)?,
            selectors: part(word(8)?)?,
            tables: part(word(12)?)?,
        };
        let slice = |first: usize, is_opacity: bool| {
            let (offset, n) = (word(first)?, word(first + 4)?);
            Some(Slice { data: level.get(offset..offset.checked_add(n)?)?, is_opacity })
        };
        let mut slices = vec![slice(GLOBAL_BYTES + 4, false)?];
        if word(GLOBAL_BYTES + 16)? > 0 {
            slices.push(slice(GLOBAL_BYTES + 12, true)?);
        }
        // Sizes of codebooks have 24 bits there.
        let fits = codebooks.endpoints.len().max(codebooks.selectors.len()) < 1 << 24;
        fits.then(|| basis_file(header, &codebooks, &slices))
    };
    read().ok_or_else(damaged)
}

/// A `.basis` file of one image (basisu_file_headers.h of Basis Universal 1.16).
fn basis_file(header: &Header, codebooks: &Codebooks, slices: &[Slice]) -> Vec<u8> {
    let is_etc1s = !codebooks.tables.is_empty();
    let has_opacity = slices.iter().any(|slice| slice.is_opacity);
    let descriptions_at = HEADER_BYTES;
    let endpoints_at = descriptions_at + SLICE_BYTES * slices.len();
    let selectors_at = endpoints_at + codebooks.endpoints.len();
    let tables_at = selectors_at + codebooks.selectors.len();
    let mut slice_at = tables_at + codebooks.tables.len();
    let end = slice_at + slices.iter().map(|slice| slice.data.len()).sum::<usize>();
    let mut out = Vec::with_capacity(end);
    let mut put = |value: usize, n_bytes: usize| {
        out.extend_from_slice(&(value as u64).to_le_bytes()[..n_bytes]);
    };
    let flags = usize::from(is_etc1s) + if has_opacity { 4 } else { 0 };
    for (value, n_bytes) in [
        (0x4273, 2), // Signature,
        (0x13, 2),   // version,
        (HEADER_BYTES, 2),
        (0, 2), // checksum of the header, which is not looked at,
        (end - HEADER_BYTES, 4),
        (0, 2), // checksum of the rest,
        (slices.len(), 3),
        (1, 3), // images,
        (usize::from(!is_etc1s), 1),
        (flags, 2),
        (0, 1), // a plain picture,
        (0, 3), // time of a frame,
        (0, 4),
        (0, 4),
        (0, 4),
        (usize::from(codebooks.n_endpoints), 2),
        (endpoints_at, 4),
        (codebooks.endpoints.len(), 3),
        (usize::from(codebooks.n_selectors), 2),
        (selectors_at, 4),
        (codebooks.selectors.len(), 3),
        (tables_at, 4),
        (codebooks.tables.len(), 4),
        (descriptions_at, 4),
        (0, 4), // nothing further.
        (0, 4),
    ] {
        put(value, n_bytes);
    }
    let size = [header.pixel_width, header.pixel_height].map(|side| side as usize);
    for slice in slices {
        for (value, n_bytes) in [
            (0, 3),
            (0, 1),
            (usize::from(slice.is_opacity), 1),
            (size[0], 2),
            (size[1], 2),
            (size[0].div_ceil(4), 2),
            (size[1].div_ceil(4), 2),
            (slice_at, 4),
            (slice.data.len(), 4),
            (0, 2),
        ] {
            put(value, n_bytes);
        }
        slice_at += slice.data.len();
    }
    for part in [codebooks.endpoints, codebooks.selectors, codebooks.tables] {
        out.extend_from_slice(part);
    }
    slices.iter().for_each(|slice| out.extend_from_slice(slice.data));
    out
}
