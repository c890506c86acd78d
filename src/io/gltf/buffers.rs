//! Buffers, views and accessors of a glTF file: bytes at places that have been held against lengths.
//!
//! Everything is read from where it lies, a block at a time. Only compressed views are unpacked, into temporary data.

use super::json::{Accessor, Document};
use super::meshopt;
use crate::error::{Error, Result};
use crate::io::materials::Part;
use crate::io::open_options::StageOptions;
use crate::io::ply::raw::RawFile;
use std::collections::HashMap;
use std::path::PathBuf;
use std::sync::Arc;

/// Elements that are read at once.
pub(super) const BLOCK: u64 = 16_384;

/// Distance of elements in bytes, at most; glTF allows 252.
const MAX_STRIDE: u64 = 4096;

/// Buffers of a file, opened, and what was unpacked of them.
pub(super) struct Buffers<'a> {
    file: Arc<RawFile>,
    document: &'a Document,
    options: &'a StageOptions,
    list: Vec<Option<Part>>,
    unpacked: HashMap<usize, Part>,
}

impl<'a> Buffers<'a> {
    /// Opens all buffers; `binary` is the second chunk of a GLB file.
    pub(super) fn open(
        file: &Arc<RawFile>,
        document: &'a Document,
        (binary, inline): (Option<Part>, &Inline),
        options: &'a StageOptions,
    ) -> Result<Self> {
        let mut list = Vec::new();
        for (i, buffer) in document.buffers.iter().enumerate() {
            let part = match &buffer.uri {
                None if i == 0 => binary.clone(),
                None => None,
                Some(uri) => match inline.buffers.get(&i) {
                    Some(part) => Some(part.clone()),
                    None => Some(open_beside(file, uri, &format!("buffer {i}"))?),
                },
            };
            if let Some(part) = &part
                && part.n_bytes < buffer.byte_length
            {
                return Err(file.bad(format!(
                    "buffer {i} has {} bytes, not the {} that the file promises; it was cut off, fetch it again",
                    part.n_bytes, buffer.byte_length
                )));
            }
            list.push(part);
        }
        Ok(Buffers { file: file.clone(), document, options, list, unpacked: HashMap::new() })
    }

    /// Paths of the buffers that lie in other files.
    pub(super) fn beside(&self) -> Vec<PathBuf> {
        let files = self.list.iter().flatten().map(|part| &part.file);
        let own = self.file.path();
        files
            .filter(|file| file.is_original() && file.path() != own)
            .map(|file| file.path().to_path_buf())
            .collect()
    }

    /// The bytes of a view.
    pub(super) fn view(&mut self, number: usize) -> Result<Part> {
        let Some(view) = self.document.buffer_views.get(number) else {
            return Err(self.file.bad(format!("bufferView {number} does not exist")));
        };
        if let Some(part) = self.unpacked.get(&number) {
            return Ok(part.clone());
        }
        let name = format!("bufferView {number}");
        if let Some(packed) = &view.extensions.meshopt {
            let part = self.range(packed.buffer, packed.byte_offset, packed.byte_length, &name)?;
            let unpacked = meshopt::unpack(&self.file, packed, &part, &name, self.options)?;
            self.unpacked.insert(number, unpacked.clone());
            return Ok(unpacked);
        }
        self.range(view.buffer, view.byte_offset, view.byte_length, &name)
    }

    fn range(&self, buffer: usize, offset: u64, n_bytes: u64, name: &str) -> Result<Part> {
        let whole = self.list.get(buffer).cloned().flatten().ok_or_else(|| {
            self.file.bad(format!("{name}: its buffer {buffer} is not in the file"))
        })?;
        let end = offset.checked_add(n_bytes).filter(|&end| end <= whole.n_bytes);
        if end.is_none() {
            return Err(self.file.bad(format!(
                "{name}: {n_bytes} bytes from byte {offset} lie beyond its buffer of {} bytes",
                whole.n_bytes
            )));
        }
        Ok(Part { file: whole.file, offset: whole.offset + offset, n_bytes })
    }

    /// The elements of an accessor of `n` numbers each.
    pub(super) fn accessor(&mut self, number: usize, n: &[usize]) -> Result<Elements> {
        let Some(accessor) = self.document.accessors.get(number) else {
            return Err(self.file.bad(format!("accessor {number} does not exist")));
        };
        let bad =
            |what: String| Error::bad_input(self.file.path(), format!("accessor {number}: {what}"));
        let n_numbers = match accessor.kind.as_str() {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC3" => 3,
            "VEC4" => 4,
            other => return Err(bad(format!("type '{other}' is not expected here"))),
        };
        if !n.contains(&n_numbers) {
            return Err(bad(format!("type '{}' is not expected here", accessor.kind)));
        }
        let number_bytes = match accessor.component_type {
            5120 | 5121 => 1,
            5122 | 5123 => 2,
            5125 | 5126 => 4,
            other => return Err(bad(format!("componentType {other} is none that glTF has"))),
        };
        if accessor.sparse.is_some() || accessor.buffer_view.is_none() {
            let what = "sparse accessors are not read; export the mesh with plain ones";
            return Err(bad(what.to_owned()));
        }
        let view_number = accessor.buffer_view.unwrap_or(0);
        let size = (n_numbers * number_bytes) as u64;
        let stride = self.document.buffer_views.get(view_number).and_then(|view| {
            view.extensions.meshopt.as_ref().map(|packed| packed.byte_stride).or(view.byte_stride)
        });
        let stride = stride.filter(|&stride| stride > 0).unwrap_or(size);
        if stride < size || stride > MAX_STRIDE {
            return Err(bad(format!("elements of {size} bytes cannot lie {stride} bytes apart")));
        }
        let (count, offset) = (accessor.count, accessor.byte_offset);
        let part = self.view(view_number)?;
        let end = count.saturating_sub(1).checked_mul(stride);
        let end = end.and_then(|end| end.checked_add(size)?.checked_add(offset));
        if count > 0 && end.is_none_or(|end| end > part.n_bytes) {
            return Err(Error::bad_input(
                self.file.path(),
                format!(
                    "accessor {number}: {count} elements lie beyond its bufferView of {} bytes; the file is damaged or cut off",
                    part.n_bytes
                ),
            ));
        }
        let offset = part.offset + offset;
        Ok(Elements {
            file: part.file,
            offset,
            stride,
            n_numbers,
            count,
            number: Number::of(accessor),
        })
    }
}

/// Type of a number, and whether integers stand for shares of 1.
#[derive(Clone, Copy)]
struct Number {
    kind: u32,
    normalized: bool,
}

impl Number {
    fn of(accessor: &Accessor) -> Number {
        Number { kind: accessor.component_type, normalized: accessor.normalized }
    }

    fn bytes(self) -> usize {
        match self.kind {
            5120 | 5121 => 1,
            5122 | 5123 => 2,
            _ => 4,
        }
    }

    fn read(self, bytes: &[u8]) -> f64 {
        let (value, most) = match self.kind {
            5120 => (f64::from(bytes[0] as i8), 127.0),
            5121 => (f64::from(bytes[0]), 255.0),
            5122 => (f64::from(i16::from_le_bytes([bytes[0], bytes[1]])), 32_767.0),
            5123 => (f64::from(u16::from_le_bytes([bytes[0], bytes[1]])), 65_535.0),
            5125 => (f64::from(u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])), 1.0),
            _ => (f64::from(f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])), 1.0),
        };
        if self.normalized { (value / most).max(-1.0) } else { value }
    }
}

/// Elements of an accessor.
#[derive(Clone)]
pub(super) struct Elements {
    file: Arc<RawFile>,
    offset: u64,
    stride: u64,
    number: Number,
    pub(super) n_numbers: usize,
    pub(super) count: u64,
}

impl Elements {
    /// Floats that lie in a file of our own.
    #[cfg(feature = "draco")]
    pub(super) fn of_floats(
        file: &Arc<RawFile>,
        offset: u64,
        n_numbers: usize,
        count: u64,
    ) -> Self {
        let number = Number { kind: 5126, normalized: false };
        Elements {
            file: file.clone(),
            offset,
            stride: 4 * n_numbers as u64,
            number,
            n_numbers,
            count,
        }
    }

    /// Indices of 32 bits that lie in a file of our own.
    #[cfg(feature = "draco")]
    pub(super) fn of_indices(file: &Arc<RawFile>, offset: u64, count: u64) -> Self {
        let number = Number { kind: 5125, normalized: false };
        Elements { file: file.clone(), offset, stride: 4, number, n_numbers: 1, count }
    }

    /// Returns whether these are numbers that can count.
    pub(super) fn is_unsigned(&self) -> bool {
        matches!(self.number.kind, 5121 | 5123 | 5125) && !self.number.normalized
    }

    /// The numbers of up to `BLOCK` elements from `first`.
    pub(super) fn read(&self, first: u64, bytes: &mut Vec<u8>, out: &mut Vec<f64>) -> Result<()> {
        out.clear();
        let n = self.count.saturating_sub(first).min(BLOCK);
        if n == 0 {
            return Ok(());
        }
        let size = self.n_numbers * self.number.bytes();
        bytes.resize(((n - 1) * self.stride) as usize + size, 0);
        self.file.read_exact_at(bytes, self.offset + first * self.stride)?;
        for element in bytes.chunks(self.stride as usize) {
            let numbers = element[..size].chunks_exact(self.number.bytes());
            out.extend(numbers.map(|bytes| self.number.read(bytes)));
        }
        Ok(())
    }
}

/// Data that addresses of a document hold themselves, unpacked into one temporary file.
#[derive(Default)]
pub(super) struct Inline {
    buffers: HashMap<usize, Part>,
    images: HashMap<usize, Part>,
}

impl Inline {
    /// Memory: the largest of them.
    pub(super) fn new(
        file: &RawFile,
        document: &Document,
        options: &StageOptions,
    ) -> Result<Inline> {
        let mut spool = options.spool();
        let mut take = |what: &str, number: usize, uri: Option<&String>| {
            let Some(data) = uri.and_then(|uri| uri.strip_prefix("data:")) else { return Ok(None) };
            let bytes = data_of(data)
                .ok_or_else(|| file.bad(format!("{what} {number}: its data is not base64")))?;
            let place = (number, spool.len(), bytes.len() as u64);
            spool.write(&bytes)?;
            Ok(Some(place))
        };
        let mut places = [Vec::new(), Vec::new()];
        for (i, buffer) in document.buffers.iter().enumerate() {
            places[0].extend(take("buffer", i, buffer.uri.as_ref())?);
        }
        for (i, image) in document.images.iter().enumerate() {
            places[1].extend(take("image", i, image.uri.as_ref())?);
        }
        let whole = Arc::new(spool.finish(file.path())?);
        let part =
            |(number, offset, n_bytes)| (number, Part { file: whole.clone(), offset, n_bytes });
        let [buffers, images] = places.map(|list| list.into_iter().map(part).collect());
        Ok(Inline { buffers, images })
    }

    /// The data of an image.
    pub(super) fn image(&self, number: usize) -> Option<Part> {
        self.images.get(&number).cloned()
    }
}

/// Opens the file that an address names, beside the document.
fn open_beside(file: &RawFile, uri: &str, what: &str) -> Result<Part> {
    let path = path_of(file, uri).ok_or_else(|| {
        let shown: String = uri.chars().take(60).collect();
        file.bad(format!("{what} lies at '{shown}', which is not a file; fetch it first"))
    })?;
    let opened = RawFile::open(&path)?;
    let n_bytes = opened.len();
    Ok(Part { file: Arc::new(opened), offset: 0, n_bytes })
}

/// The data of an address after `data:`.
fn data_of(data: &str) -> Option<Vec<u8>> {
    use base64::Engine;
    let (kind, text) = data.split_once(',')?;
    if !kind.ends_with(";base64") {
        return Some(decoded(text));
    }
    base64::engine::general_purpose::STANDARD.decode(text).ok()
}

/// The file that an address names, seen from the document; none for addresses of the net.
pub(super) fn path_of(file: &RawFile, uri: &str) -> Option<PathBuf> {
    let is_far = uri.split_once(':').is_some_and(|(scheme, _)| {
        scheme.len() > 1 && scheme.chars().all(|c| c.is_ascii_alphanumeric())
    });
    let name = String::from_utf8(decoded(uri)).ok()?;
    (!is_far).then(|| file.path().with_file_name("").join(name))
}

/// Text in which `%20` stands for a blank.
fn decoded(text: &str) -> Vec<u8> {
    let (bytes, mut out, mut i) = (text.as_bytes(), Vec::new(), 0);
    while i < bytes.len() {
        let hex = bytes.get(i + 1..i + 3).filter(|_| bytes[i] == b'%');
        let byte = hex.and_then(|hex| u8::from_str_radix(std::str::from_utf8(hex).ok()?, 16).ok());
        out.push(byte.unwrap_or(bytes[i]));
        i += if byte.is_some() { 3 } else { 1 };
    }
    out
}
