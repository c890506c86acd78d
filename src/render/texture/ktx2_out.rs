//! Images as KTX2 files with all smaller sizes, as `KHR_texture_basisu` wants them: UASTC packed by Zstandard, or ETC1S.
//!
//! The encoder of Basis Universal writes `.basis` files; their parts are put into KTX2 here. UASTC has blocks that do not
//! depend on each other, so it is coded in bands.

use super::basis_coding::BasisCoding;
use super::image_level::ImageLevel;
use super::ktx2_image::SLICE_BYTES;
use super::light_table::LightTable;
use basis_universal::{BasisTextureFormat, ColorSpace, Compressor, CompressorParams, sys};

/// Rows of UASTC that are coded at a time.
const BAND_ROWS: usize = 64;

/// Quality of ETC1S, of 255: the encoder's own middle.
const ETC1S_QUALITY: u32 = 128;

/// Level of Zstandard: higher ones take less than a hundredth off UASTC.
const ZSTD_LEVEL: i32 = 3;

/// Makes a file of an image whose rows are `width` long.
///
/// Colours are mixed as light in smaller sizes, and coded as eyes see them; other images are numbers. ETC1S is for colours.
pub fn ktx2_file(
    pixels: Vec<[u8; 4]>,
    width: u32,
    coding: BasisCoding,
    is_colour: bool,
) -> Result<Vec<u8>, String> {
    let table = if is_colour { LightTable::new() } else { LightTable::plain() };
    let size = [width, (pixels.len() / width.max(1) as usize) as u32];
    let mut levels = vec![ImageLevel { size, pixels }];
    while let Some(last) = levels.last().filter(|last| last.size != [1, 1]) {
        levels.push(last.half(&table));
    }
    let has_alpha = levels[0].pixels.iter().any(|pixel| pixel[3] < 255);
    let parts = match coding {
        BasisCoding::Uastc => uastc(levels, is_colour, has_alpha)?,
        BasisCoding::Etc1s => etc1s(levels, is_colour)?,
    };
    Ok(parts.file(size, is_colour))
}

/// Parts of a KTX2 file.
struct Parts {
    scheme: u32,
    model: u8,
    /// Meaning of each sample of a block, and its first bit and its last bit.
    samples: Vec<[u8; 3]>,
    global: Vec<u8>,
    /// Largest first, each with its bytes before they were packed.
    levels: Vec<(Vec<u8>, u64)>,
}

fn uastc(levels: Vec<ImageLevel>, is_colour: bool, has_alpha: bool) -> Result<Parts, String> {
    let mut packed = Vec::with_capacity(levels.len());
    for level in levels {
        let width = level.size[0];
        let mut blocks = Vec::new();
        for band in level.pixels.chunks(BAND_ROWS * width as usize) {
            let height = band.len() as u32 / width;
            let file = basis_file(&[([width, height], band)], BasisCoding::Uastc, is_colour)?;
            blocks.extend_from_slice(Slices(&file).of(0));
        }
        let bytes = zstd::bulk::compress(&blocks, ZSTD_LEVEL).map_err(|error| error.to_string())?;
        packed.push((bytes, blocks.len() as u64));
    }
    let meaning = if has_alpha { 3 } else { 0 };
    Ok(Parts {
        scheme: 2,
        model: 166,
        samples: vec![[meaning, 0, 127]],
        global: Vec::new(),
        levels: packed,
    })
}

fn etc1s(levels: Vec<ImageLevel>, is_colour: bool) -> Result<Parts, String> {
    let n_levels = levels.len();
    let images: Vec<_> = levels.iter().map(|level| (level.size, &level.pixels[..])).collect();
    let file = basis_file(&images, BasisCoding::Etc1s, is_colour)?;
    drop(levels);
    let slices = Slices(&file);
    // A level has a slice, or two, of which the second is opacity.
    let has_alpha = slices.n() == 2 * n_levels;
    let each = 1 + usize::from(has_alpha);
    let part = |at: usize, n: usize| &file[at..at + n];
    let endpoints = part(slices.number(41, 4), slices.number(45, 3));
    let selectors = part(slices.number(50, 4), slices.number(54, 3));
    let tables = part(slices.number(57, 4), slices.number(61, 4));
    let mut global = [part(39, 2), part(48, 2)].concat();
    let mut word = |n: usize| global.extend_from_slice(&(n as u32).to_le_bytes());
    [endpoints.len(), selectors.len(), tables.len(), 0].into_iter().for_each(&mut word);
    let mut out = Vec::with_capacity(n_levels);
    for level in 0..n_levels {
        let colours = slices.of(each * level);
        let opacity = if has_alpha { slices.of(each * level + 1) } else { &[] };
        let opacity_at = if has_alpha { colours.len() } else { 0 };
        [0, 0, colours.len(), opacity_at, opacity.len()].into_iter().for_each(&mut word);
        out.push(([colours, opacity].concat(), 0));
    }
    global.extend([endpoints, selectors, tables].concat());
    let mut samples = vec![[0, 0, 63]];
    samples.extend(has_alpha.then_some([15, 64, 63]));
    Ok(Parts { scheme: 1, model: 163, samples, global, levels: out })
}

/// The `.basis` file of an image in several sizes.
fn basis_file(
    levels: &[([u32; 2], &[[u8; 4]])],
    coding: BasisCoding,
    is_colour: bool,
) -> Result<Vec<u8>, String> {
    let mut parameters = CompressorParams::new();
    parameters.set_generate_mipmaps(false);
    parameters.set_color_space(if is_colour { ColorSpace::Srgb } else { ColorSpace::Linear });
    match coding {
        BasisCoding::Uastc => {
            parameters.set_basis_format(BasisTextureFormat::UASTC4x4);
            let fastest = sys::UastcPackFlags_PackUASTCLevelFastest;
            // SAFETY: the parameters live as long as `parameters`. The crate's own setter adds to the flags of the default.
            unsafe { sys::compressor_params_set_pack_uastc_flags(parameters.0, fastest as _) };
        }
        BasisCoding::Etc1s => {
            parameters.set_basis_format(BasisTextureFormat::ETC1S);
            parameters.set_etc1s_quality_level(ETC1S_QUALITY);
        }
    }
    for (number, (size, pixels)) in (0u32..).zip(levels) {
        let mut image = match number {
            0 => parameters.source_image_mut(0),
            _ => parameters.source_mipmap_image_mut(0, number - 1),
        };
        image.init(pixels.as_flattened(), size[0], size[1], 4);
    }
    // One thread: bytes do not depend on their number, and images are coded side by side.
    let mut compressor = Compressor::new(1);
    // SAFETY: the parameters are whole, with an image in every size; they are copied here.
    let is_ready = unsafe { compressor.init(&parameters) };
    drop(parameters);
    if !is_ready {
        return Err("Basis Universal refuses the image".to_owned());
    }
    // SAFETY: the compressor was given its parameters.
    unsafe { compressor.process() }.map_err(|code| format!("Basis Universal: {code:?}"))?;
    Ok(compressor.basis_file().to_vec())
}

/// The slices of a `.basis` file that the encoder has written (basisu_file_headers.h).
struct Slices<'a>(&'a [u8]);

impl<'a> Slices<'a> {
    fn number(&self, at: usize, n_bytes: usize) -> usize {
        self.0[at..at + n_bytes].iter().rev().fold(0, |sum, &byte| sum << 8 | usize::from(byte))
    }

    fn n(&self) -> usize {
        self.number(14, 3)
    }

    fn of(&self, slice: usize) -> &'a [u8] {
        let description = self.number(65, 4) + SLICE_BYTES * slice;
        let begin = self.number(description + 13, 4);
        &self.0[begin..begin + self.number(description + 17, 4)]
    }
}

impl Parts {
    /// The file (KTX 2.0, sections 3 and 5; Khronos Data Format 1.3, section 5).
    fn file(self, size: [u32; 2], is_colour: bool) -> Vec<u8> {
        const WRITER: &[u8] = b"KTXwriter\0stonecut\0";
        let format_at = 80 + 24 * self.levels.len();
        let block_bytes = 24 + 16 * self.samples.len();
        let values_at = format_at + 4 + block_bytes;
        let value_bytes = (4 + WRITER.len()).next_multiple_of(4);
        let global_at = (values_at + value_bytes).next_multiple_of(8);
        let global_place = if self.global.is_empty() { 0 } else { global_at };
        let mut out = b"\xabKTX 20\xbb\r\n\x1a\n".to_vec();
        let word = |out: &mut Vec<u8>, word: usize| out.extend((word as u32).to_le_bytes());
        let long = |out: &mut Vec<u8>, word: u64| out.extend(word.to_le_bytes());
        let [width, height] = size.map(|side| side as usize);
        for n in [0, 1, width, height, 0, 0, 1, self.levels.len(), self.scheme as usize] {
            word(&mut out, n);
        }
        for n in [format_at, 4 + block_bytes, values_at, value_bytes] {
            word(&mut out, n);
        }
        for n in [global_place, self.global.len()] {
            long(&mut out, n as u64);
        }
        // The smallest size comes first in the file, the largest in the index.
        let mut end = global_at + self.global.len();
        let mut index: Vec<[u64; 3]> = Vec::new();
        for (bytes, unpacked) in self.levels.iter().rev() {
            index.push([end as u64, bytes.len() as u64, *unpacked]);
            end += bytes.len();
        }
        index.iter().rev().flatten().for_each(|&n| long(&mut out, n));
        word(&mut out, 4 + block_bytes);
        word(&mut out, 0);
        word(&mut out, 2 | block_bytes << 16);
        // Colours are BT.709 and sRGB, numbers unspecified and linear; blocks of 4 x 4 texels.
        out.extend([self.model, u8::from(is_colour), 1 + u8::from(is_colour), 0, 3, 3, 0, 0]);
        // Bytes of planes are those of packed data, which have no fixed number.
        out.extend([0; 8]);
        for [meaning, first, n_bits] in self.samples {
            out.extend([first, 0, n_bits, meaning, 0, 0, 0, 0, 0, 0, 0, 0, 255, 255, 255, 255]);
        }
        word(&mut out, WRITER.len());
        out.extend_from_slice(WRITER);
        out.resize(global_at, 0);
        out.extend(self.global);
        self.levels.iter().rev().for_each(|(bytes, _)| out.extend_from_slice(bytes));
        out
    }
}
