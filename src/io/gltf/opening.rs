//! The file of a mesh in glTF or GLB: what it begins with, its JSON, and the binary chunk behind that.

use super::json::{Asset, Document};
use super::weigh;
use crate::materials::Part;
use crate::open_options::StageOptions;
use crate::ply::header::BYTE_ORDER_MARK;
use crate::ply::raw::RawFile;
use serde::Deserialize;
use std::sync::Arc;
use stonecut_system::error::{Error, Result};
use stonecut_system::units::show_bytes;

/// Documents that take no more memory than this are read whatever the budget.
const MIN_DOCUMENT_BYTES: u64 = 16 << 20;

/// Returns whether a file begins like GLB, or like the JSON of glTF.
pub(crate) fn looks_like(first: &[u8]) -> bool {
    if first.starts_with(b"glTF") {
        return true;
    }
    let text = first.strip_prefix(BYTE_ORDER_MARK).unwrap_or(first).trim_ascii_start();
    text.starts_with(b"{") && first.iter().all(|&b| b >= b' ' || b.is_ascii_whitespace())
}

/// The part that files of all versions have.
#[derive(Deserialize)]
struct Begun {
    asset: Asset,
}

/// The document of a file, and the binary chunk of a GLB file.
pub(super) fn document(
    file: &Arc<RawFile>,
    options: &StageOptions,
) -> Result<(Document, Option<Part>)> {
    let mut head = [0u8; 20];
    let n = file.read_at_most(&mut head, 0)?;
    let word = |at: usize| {
        u64::from(u32::from_le_bytes([head[at], head[at + 1], head[at + 2], head[at + 3]]))
    };
    let (start, n_bytes) = if head.starts_with(b"glTF") {
        if n < 20 || &head[16..20] != b"JSON" {
            return Err(
                file.bad("this GLB file has no JSON chunk; it was cut off, or is version 1")
            );
        }
        if word(4) != 2 {
            return Err(
                file.bad(format!("GLB version {} is not read, only 2; export it again", word(4)))
            );
        }
        (20, word(12))
    } else {
        (0, file.len())
    };
    if start + n_bytes > file.len() {
        return Err(file.bad(format!(
            "byte offset {}: the JSON chunk should have {n_bytes} bytes, the file ends before; fetch it again",
            file.len()
        )));
    }
    let limit = options.parse_bytes.max(MIN_DOCUMENT_BYTES);
    let too_large = |needed: u64| {
        Error::NoMemory(format!(
            "{}: its JSON of {} takes {} of memory, more than the {} at hand; give --memory {}",
            file.path().display(),
            show_bytes(n_bytes),
            show_bytes(needed),
            show_bytes(limit),
            StageOptions::memory_for(needed)
        ))
    };
    if n_bytes > limit {
        // What its lists come to is not known before it is read.
        return Err(too_large(n_bytes.saturating_mul(16)));
    }
    let mut text = vec![0; n_bytes as usize];
    file.read_exact_at(&mut text, start)?;
    let text = text.strip_prefix(BYTE_ORDER_MARK).unwrap_or(&text);
    let needed = weigh::parsed_bytes(text);
    if needed > limit {
        return Err(too_large(needed));
    }
    let other_version = |asset: &Asset| -> Option<Error> {
        let version: String = asset.version.chars().take(20).collect();
        let is_other = !version.is_empty() && !version.starts_with('2');
        let way = "not read, only 2; export it again, or run 'npx gltf-pipeline -i IN -o OUT.glb'";
        is_other.then(|| file.bad(format!("glTF version '{version}' is {way}")))
    };
    let document: Document = serde_json::from_slice(text).map_err(|error| {
        // Version 1 has objects for lists.
        let begun: Result<Begun, _> = serde_json::from_slice(text);
        let at = format!("line {}, column {}", error.line(), error.column());
        begun
            .ok()
            .and_then(|begun| other_version(&begun.asset))
            .unwrap_or_else(|| file.bad(format!("its JSON is not that of glTF ({at}): {error}")))
    })?;
    if document.geometric_error.is_some() {
        return Err(file.bad(
            "this is a tileset of 3D Tiles, not glTF; give a GLB file that it names, or make one mesh of a tree of \
             stonecut with 'stonecut extract FOLDER OUT'",
        ));
    }
    if let Some(error) = other_version(&document.asset) {
        return Err(error);
    }
    if document.asset.version.is_empty() {
        return Err(file.bad("its JSON is not that of glTF: it names no version of it"));
    }
    Ok((document, binary_chunk(file, start + n_bytes)?.filter(|_| start > 0)))
}

/// The chunk `BIN` at an offset of a GLB file.
fn binary_chunk(file: &Arc<RawFile>, at: u64) -> Result<Option<Part>> {
    let mut head = [0u8; 8];
    if file.read_at_most(&mut head, at)? < 8 || &head[4..8] != b"BIN\0" {
        return Ok(None);
    }
    let n_bytes = u64::from(u32::from_le_bytes([head[0], head[1], head[2], head[3]]));
    let (offset, rest) = (at + 8, file.len() - at - 8);
    if n_bytes > rest {
        return Err(file.bad(format!(
            "byte offset {offset}: the binary chunk should have {n_bytes} bytes, {rest} are there; the file was cut \
             off, fetch it again"
        )));
    }
    Ok(Some(Part { file: file.clone(), offset, n_bytes }))
}
