//! Unpacks views that are compressed with EXT_meshopt_compression.
//!
//! A view has to be unpacked as a whole. So its size is held against the memory of the stage first; the result is
//! temporary data.

use super::json::Meshopt;
use crate::materials::Part;
use crate::open_options::StageOptions;
use crate::ply::raw::RawFile;
use meshopt_rs::index::buffer::decode_index_buffer;
use meshopt_rs::index::sequence::decode_index_sequence;
use meshopt_rs::vertex::buffer::decode_vertex_buffer;
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
        ("ATTRIBUTES", _) => vertices(count, stride, bytes)?,
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

/// Decodes vertices; the decoder takes their size as a type.
fn vertices(count: usize, stride: usize, bytes: &[u8]) -> Result<Vec<u8>, String> {
    fn of<const N: usize>(count: usize, bytes: &[u8]) -> Result<Vec<u8>, String> {
        let mut out = vec![[0u8; N]; count];
        decode_vertex_buffer(&mut out, bytes)
            .map_err(|_| "its data is damaged; fetch the file again".to_owned())?;
        Ok(out.into_flattened())
    }
    match stride {
        4 => of::<4>(count, bytes),
        8 => of::<8>(count, bytes),
        12 => of::<12>(count, bytes),
        16 => of::<16>(count, bytes),
        20 => of::<20>(count, bytes),
        24 => of::<24>(count, bytes),
        28 => of::<28>(count, bytes),
        32 => of::<32>(count, bytes),
        36 => of::<36>(count, bytes),
        40 => of::<40>(count, bytes),
        48 => of::<48>(count, bytes),
        64 => of::<64>(count, bytes),
        other => Err(format!("vertices of {other} bytes are not read")),
    }
}
