//! Buffers, views and accessors of a glTF file: bytes at places that have been held against lengths.
//!
//! Everything is read from where it lies, a block at a time. Only compressed views are unpacked, into temporary data.

use super::elements::{Elements, Number};
use super::json::{Document, SparsePart};
use super::{meshopt, sparse};
use crate::encodings::unescaped;
use crate::materials::{Part, Search};
use crate::open_options::StageOptions;
use crate::ply::raw::RawFile;
use base64::Engine;
use std::collections::HashMap;
use std::path::PathBuf;
use std::sync::Arc;
use stonecut_system::disk::folder_of;
use stonecut_system::error::{Error, Result};

/// Distance of elements in bytes, at most; glTF allows 252.
const MAX_STRIDE: u64 = 4096;

/// Buffers of a file, opened, and what was unpacked of them.
pub(super) struct Buffers<'a> {
    file: Arc<RawFile>,
    document: &'a Document,
    options: &'a StageOptions,
    list: Vec<Option<Part>>,
    unpacked: HashMap<usize, Part>,
    /// Sparse accessors with their values in place.
    filled_in: HashMap<usize, Part>,
    search: Search,
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
        let mut search = Search::new("buffer", &[folder_of(file.path())]);
        for (i, buffer) in document.buffers.iter().enumerate() {
            let part = match &buffer.uri {
                None if i == 0 => binary.clone(),
                None => None,
                Some(uri) => match inline.buffers.get(&i) {
                    Some(part) => Some(part.clone()),
                    None => Some(open_beside(file, (uri, i), &mut search)?),
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
        let (unpacked, filled_in) = (HashMap::new(), HashMap::new());
        Ok(Buffers { file: file.clone(), document, options, list, unpacked, filled_in, search })
    }

    /// A line on buffers that were found elsewhere than written.
    pub(super) fn note(&self) -> Option<String> {
        self.search.note()
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
        let file = self.file.clone();
        let bad =
            |what: String| Error::bad_input(file.path(), format!("accessor {number}: {what}"));
        let n_numbers = match accessor.kind.as_str() {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC3" => 3,
            "VEC4" => 4,
            "MAT4" => 16,
            other => return Err(bad(format!("type '{other}' is not expected here"))),
        };
        if !n.contains(&n_numbers) {
            return Err(bad(format!("type '{}' is not expected here", accessor.kind)));
        }
        let component = accessor.component_type;
        if !matches!(component, 5120..=5123 | 5125 | 5126) {
            return Err(bad(format!("componentType {component} is none that glTF has")));
        }
        let numbers = (Number::of(accessor), n_numbers);
        let base = match accessor.buffer_view {
            Some(view) => {
                let place = Slot { view, offset: accessor.byte_offset, count: accessor.count };
                self.elements(number, place, numbers)?
            }
            None => self.zeros(accessor.count, numbers),
        };
        let Some(sparse) = &accessor.sparse else { return Ok(base) };
        if !sparse.has_unsigned_indices() || sparse.count > accessor.count {
            return Err(bad(format!(
                "{} sparse values of {} with indices of type {} make no sense; export the file again",
                sparse.count, accessor.count, sparse.indices.component_type
            )));
        }
        if let Some(part) = self.filled_in.get(&number) {
            return Ok(base.at(part.clone()));
        }
        let slot = |part: &SparsePart| Slot {
            view: part.buffer_view,
            offset: part.byte_offset,
            count: sparse.count,
        };
        let places = Number { kind: sparse.indices.component_type, normalized: false };
        let indices = self.elements(number, slot(&sparse.indices), (places, 1))?;
        let values = self.elements(number, slot(&sparse.values), numbers)?;
        let spool = self.options.spool();
        let part = sparse::filled_in((&self.file, number), &base, [indices, values], spool)?;
        self.filled_in.insert(number, part.clone());
        Ok(base.at(part))
    }

    /// Elements of an accessor that are all zero.
    fn zeros(&self, count: u64, (number, n_numbers): (Number, usize)) -> Elements {
        let stride = (n_numbers * number.bytes()) as u64;
        let file = self.file.clone();
        Elements { file, offset: 0, stride, n_numbers, count, number, is_zero: true }
    }

    /// Elements in a view, checked against its length; `accessor` is for messages.
    fn elements(
        &mut self,
        accessor: usize,
        slot: Slot,
        (number, n_numbers): (Number, usize),
    ) -> Result<Elements> {
        let bad = |what: String| {
            Error::bad_input(self.file.path(), format!("accessor {accessor}: {what}"))
        };
        let Slot { view, offset, count } = slot;
        let size = (n_numbers * number.bytes()) as u64;
        let stride = self.document.buffer_views.get(view).and_then(|view| {
            view.extensions.meshopt.as_ref().map(|packed| packed.byte_stride).or(view.byte_stride)
        });
        let stride = stride.filter(|&stride| stride > 0).unwrap_or(size);
        if stride < size || stride > MAX_STRIDE {
            return Err(bad(format!("elements of {size} bytes cannot lie {stride} bytes apart")));
        }
        let part = self.view(view)?;
        let end = count.saturating_sub(1).checked_mul(stride);
        let end = end.and_then(|end| end.checked_add(size)?.checked_add(offset));
        if count > 0 && end.is_none_or(|end| end > part.n_bytes) {
            return Err(Error::bad_input(
                self.file.path(),
                format!(
                    "accessor {accessor}: {count} elements lie beyond its bufferView of {} bytes; the file is damaged or cut off",
                    part.n_bytes
                ),
            ));
        }
        let offset = part.offset + offset;
        Ok(Elements { file: part.file, offset, stride, n_numbers, count, number, is_zero: false })
    }
}

/// A place of elements in a view.
struct Slot {
    view: usize,
    offset: u64,
    count: u64,
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
            let Some(data) = uri.and_then(|uri| inline_data(uri)) else { return Ok(None) };
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

/// Opens the file that the address of a buffer names, beside the document.
fn open_beside(file: &RawFile, (uri, number): (&str, usize), search: &mut Search) -> Result<Part> {
    let mut path = path_of(file, uri).ok_or_else(|| {
        let shown: String = uri.chars().take(60).collect();
        file.bad(format!("buffer {number} lies at '{shown}', which is not a file; fetch it first"))
    })?;
    if !path.exists() {
        path = Some(search.find(uri.as_bytes())).filter(|found| found.is_file()).unwrap_or(path);
    }
    let opened = RawFile::open(&path)?;
    let n_bytes = opened.len();
    Ok(Part { file: Arc::new(opened), offset: 0, n_bytes })
}

/// The rest of an address behind `data:`, in whatever case (RFC 2397).
fn inline_data(uri: &str) -> Option<&str> {
    let (scheme, data) = uri.trim_start().split_once(':')?;
    scheme.eq_ignore_ascii_case("data").then_some(data)
}

/// The data of an address after `data:`; base64 also with the signs of addresses, escaped, wrapped, or without padding.
fn data_of(data: &str) -> Option<Vec<u8>> {
    use base64::engine::general_purpose::{STANDARD, STANDARD_NO_PAD};
    let (kind, text) = data.split_once(',')?;
    if !kind.trim_end().to_ascii_lowercase().ends_with(";base64") {
        return Some(unescaped(text));
    }
    STANDARD.decode(text).ok().or_else(|| {
        let mut plain = unescaped(text);
        plain.retain(|byte| !byte.is_ascii_whitespace() && *byte != b'=');
        for byte in &mut plain {
            *byte = match *byte {
                b'-' => b'+',
                b'_' => b'/',
                other => other,
            };
        }
        STANDARD_NO_PAD.decode(plain).ok()
    })
}

/// The file that an address names, seen from the document; none for addresses of the net.
pub(super) fn path_of(file: &RawFile, uri: &str) -> Option<PathBuf> {
    let is_far = uri.split_once(':').is_some_and(|(scheme, _)| {
        scheme.len() > 1 && scheme.chars().all(|c| c.is_ascii_alphanumeric())
    });
    let path = |uri: &str| {
        let name = String::from_utf8(unescaped(uri)).ok()?;
        Some(file.path().with_file_name("").join(name))
    };
    let path_of = |uri: &str| path(uri).filter(|path| path.is_file());
    // A query behind the name is what a server would be asked.
    let bare = uri.split_once('?').and_then(|(name, _)| path_of(name));
    if is_far { None } else { path_of(uri).or(bare).or_else(|| path(uri)) }
}
