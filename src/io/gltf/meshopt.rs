//! Unpacks views that are compressed with EXT_meshopt_compression or KHR_meshopt_compression.
//!
//! A view has to be unpacked as a whole. So its size is held against the memory of the stage first; the result is
//! temporary data.

use super::json::Meshopt;
use super::meshopt_vertices::decode_vertices;
use crate::materials::Part;
use crate::open_options::StageOptions;
use crate::ply::raw::RawFile;
use meshopt_rs::index::buffer::decode_index_buffer;
use meshopt_rs::index::sequence::decode_index_sequence;
use meshopt_rs::vertex::filter;
use std::sync::Arc;
use stonecut_system::error::Result;
use stonecut_system::parallel::guarded;
use stonecut_system::units::show_bytes;

/// The unpacked bytes of a view.
pub(super) fn unpack(
    file: &RawFile,
    view: &Meshopt,
    packed: &Part,
    name: &str,
    options: &StageOptions,
) -> Result<Part> {
    let bad = |what: &str| file.bad(format!("{name} (EXT_meshopt_compression): {what}"));
    let n_bytes = view.count.checked_mul(view.byte_stride);
    let Some(n_bytes) = n_bytes.filter(|_| view.byte_stride > 0) else {
        return Err(bad("its size cannot be counted"));
    };
    // Packed and unpacked bytes at once, and for indices a copy of 4 bytes each.
    let needed = n_bytes.saturating_mul(3).saturating_add(packed.n_bytes);
    if needed > options.parse_bytes {
        return Err(bad(&format!(
            "unpacking takes {}, more than the {} at hand; give --memory {}, or unpack the file first \
             (gltfpack without -c)",
            show_bytes(needed),
            show_bytes(options.parse_bytes),
            StageOptions::memory_for(needed)
        )));
    }
    let mut bytes = vec![0; packed.n_bytes as usize];
    packed.file.read_exact_at(&mut bytes, packed.offset)?;
    let decoded = guarded(|| Ok(decode(view, &bytes)));
    let out = match decoded {
        Ok(Ok(out)) => out,
        Ok(Err(what)) => return Err(bad(&what)),
        // The decoder checks by panicking in places.
        Err(_) => return Err(bad("its data is damaged; fetch the file again")),
    };
    let mut spool = options.spool();
    spool.write(&out)?;
    Ok(Part { file: Arc::new(spool.finish(file.path())?), offset: 0, n_bytes })
}

/// Decodes a view that has been checked for its size.
pub(super) fn decode(view: &Meshopt, bytes: &[u8]) -> Result<Vec<u8>, String> {
    let (count, stride) = (view.count as usize, view.byte_stride as usize);
    let damaged = "its data is damaged; fetch the file again";
    let mut out = match (view.mode.as_str(), stride) {
        ("ATTRIBUTES", 4..=256) if stride.is_multiple_of(4) => match bytes.first() {
            Some(version @ 0xa2..=0xaf) => {
                return Err(format!(
                    "version {} of its vertices is not read; pack it with gltfpack -c",
                    version & 15
                ));
            }
            _ => decode_vertices(count, stride, bytes).ok_or(damaged)?,
        },
        ("TRIANGLES", 2 | 4) if count.is_multiple_of(3) => {
            let mut indices = vec![0u32; count];
            decode_index_buffer(&mut indices, bytes).map_err(|_| damaged.to_owned())?;
            narrow(&indices, stride)
        }
        ("INDICES", 2 | 4) => {
            let mut indices = vec![0u32; count];
            decode_index_sequence(&mut indices, bytes).map_err(|_| damaged.to_owned())?;
            narrow(&indices, stride)
        }
        (mode, stride) => return Err(format!("mode '{mode}' with {stride} bytes is not known")),
    };
    match (view.filter.as_deref(), stride) {
        (None | Some("NONE"), _) => {}
        (Some("OCTAHEDRAL"), 4) => filter::decode_filter_oct_8(out.as_chunks_mut::<4>().0),
        (Some("OCTAHEDRAL"), 8) => as_words(&mut out, filter::decode_filter_oct_16),
        (Some("QUATERNION"), 8) => as_words(&mut out, filter::decode_filter_quat),
        (Some("COLOR"), 4) => {
            for bytes in out.as_chunks_mut::<4>().0 {
                let mut words = bytes.map(u16::from);
                colours::<8>(&mut words);
                *bytes = words.map(|word| word as u8);
            }
        }
        (Some("COLOR"), 8) => as_words(&mut out, |all| all.iter_mut().for_each(colours::<16>)),
        (Some("EXPONENTIAL"), n) if n.is_multiple_of(4) => {
            let mut words: Vec<u32> =
                out.as_chunks::<4>().0.iter().map(|&b| u32::from_le_bytes(b)).collect();
            filter::decode_filter_exp(&mut words);
            out = words.iter().flat_map(|word| word.to_le_bytes()).collect();
        }
        (Some(filter), stride) => {
            return Err(format!("filter '{filter}' with {stride} bytes is not known"));
        }
    }
    Ok(out)
}

/// Applies a filter to elements of four words.
fn as_words(bytes: &mut Vec<u8>, filter: impl Fn(&mut [[u16; 4]])) {
    let word = |b: &[u8; 8], i: usize| u16::from_le_bytes([b[2 * i], b[2 * i + 1]]);
    let mut words: Vec<[u16; 4]> =
        bytes.as_chunks::<8>().0.iter().map(|b| [0, 1, 2, 3].map(|i| word(b, i))).collect();
    filter(&mut words);
    *bytes = words.iter().flatten().flat_map(|word| word.to_le_bytes()).collect();
}

fn narrow(indices: &[u32], stride: usize) -> Vec<u8> {
    indices.iter().flat_map(|index| index.to_le_bytes()[..stride].to_vec()).collect()
}

/// Colours of an opacity whose highest bit gives the scale: brightness and two differences, in `BITS`.
fn colours<const BITS: u32>(values: &mut [u16; 4]) {
    let signed = |value: u16| (i32::from(value) << (32 - BITS)) >> (32 - BITS);
    let [y, orange, green, opacity] = *values;
    let (y, orange, green) = (i32::from(y), signed(orange), signed(green));
    let scale = (1i32 << (u16::BITS - opacity.leading_zeros())) - 1;
    let opacity = i32::from(opacity) & (scale >> 1);
    let all = [y + orange - green, y + green, y - orange - green, (opacity << 1) | (opacity & 1)];
    let most = (1i32 << BITS) - 1;
    let factor = most as f32 / scale.max(1) as f32;
    *values = all.map(|value| (value as f32 * factor + 0.5) as u16);
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Bytes out of hexadecimal digits.
    fn bytes(digits: &str) -> Vec<u8> {
        let digit = |i: usize| u8::from_str_radix(&digits[i..i + 2], 16).unwrap();
        (0..digits.len()).step_by(2).map(digit).collect()
    }

    fn view(count: u64, byte_stride: u64, filter: Option<&str>) -> Meshopt {
        let filter = filter.map(str::to_owned);
        Meshopt { count, byte_stride, mode: "ATTRIBUTES".to_owned(), filter, ..Meshopt::default() }
    }

    /// Bytes that meshoptimizer 1.3 packs as version 1, at its levels 0 and 3: every mode, and differences of 8, 16 and 32 bits.
    #[test]
    fn vertices_of_version_1_are_unpacked() {
        let packed = [
            "a15a5a5a5595030000ff808040404040202020202020200f00201010100012007c020100020300ffff80804040404020202020202020\
             0f00201010100006017c0202000003007fffa06060403030303028181818180f00181818180046007c02020000030058585858585858\
             58585858585858580f0058585858052aaeaaea0404ae00000004051555555555000000051555555555000000008001100f000003004a\
             4a4a4a4a4a4a4a4a4a4a4a4a4a4a0f004a4a4a4a0515555555550000000000000000000000000000000000e8fd0100ffff0000000000",
            "a169683a579c0002000701000f020ff8f4c4f262e262c010381c0f00fe010301010201070f020ff8f4c4f262e262d03018fc0f001e01\
             0301008000a0606040303030302818181818181818180106007d010058585858585858585858585858585858585858052aaaaaaaaa00\
             0000051555555555000000052aaaaaaaaa000000018001100f004a4a4a4a4a4a4a4a4a4a4a4a4a4a4a4a4a4a4a051555555555000000\
             0000000000000000000000000000e8fd0100ffff5252010100",
        ]
        .map(bytes);
        let mut wanted = Vec::new();
        for i in 0..20u16 {
            for k in 1..=3u16 {
                wanted.extend((f32::from(i * k) / 8.0).to_le_bytes());
            }
            wanted.extend([i * 300, 65000 - i * 257].map(u16::to_le_bytes).as_flattened());
            wanted.extend([if i == 7 { 9 } else { 1 }, (i * 37) as u8, 255 - i as u8, 255]);
        }
        for packed in &packed {
            assert_eq!(decode(&view(20, 20, None), packed).unwrap(), wanted);
            // Data that is cut off, or too long.
            for n in 0..packed.len() {
                assert!(decode(&view(20, 20, None), &packed[..n]).is_err(), "{n}");
            }
            assert!(decode(&view(20, 20, None), &[packed.as_slice(), &[0]].concat()).is_err());
        }
        let newer = [&[0xa2], &packed[0][1..]].concat();
        assert!(decode(&view(20, 20, None), &newer).unwrap_err().contains("version 2"));
    }

    #[test]
    fn colours_are_brought_back_from_brightness_and_differences() {
        let narrow = bytes("a1ff000500ef00d0007d00000000000000000000000000000000000000905ff1ff00");
        let found = decode(&view(2, 4, Some("COLOR")), &narrow).unwrap();
        assert_eq!(found, [254, 129, 64, 255, 27, 230, 77, 128]);
        let wide = bytes(
            "a1fbff0065002f000f00cf000c0002000500000000000000000000000000000009ff0501ffff0f0100",
        );
        let found = decode(&view(2, 8, Some("COLOR")), &wide).unwrap();
        let wanted: [u16; 8] = [65519, 32792, 16388, 65535, 6578, 58990, 19668, 32776];
        // One lies halfway between two numbers.
        for (bytes, wanted) in found.as_chunks::<2>().0.iter().zip(wanted) {
            assert!(u16::from_le_bytes(*bytes).abs_diff(wanted) <= 1, "{found:?}");
        }
    }
}
