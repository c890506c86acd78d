//! Inputs that cannot be read at random are turned into PLY first: compressed files, archives with one mesh, text in
//! UTF-16, standard input, STL, OBJ, glTF and range grids.
//!
//! What an input is, its first bytes say, not its name. Staged data goes to nameless files in the given
//! folder, so that nothing is left behind however a run ends; a resumed run stages again.

use super::open_options::StageOptions;
use super::{containers, encodings, gltf, obj, stl};
use crate::ply::header::BYTE_ORDER_MARK;
use crate::ply::raw::{RawFile, Spool};
use crate::ply::source::Staged;
use crate::ply::{Faults, MeshSource};
use std::io::{BufReader, Read};
use std::ops::Range;
use std::path::Path;
use stonecut_system::disk::open_input;
use stonecut_system::error::{Error, Result};
use stonecut_system::first_bytes::PROGRESSIVE_MAGIC;
use stonecut_system::units::show_bytes;

/// Compression of an input.
#[derive(Clone, Copy, PartialEq)]
enum Packing {
    Plain,
    Gzip,
    Zstd,
}

impl Packing {
    fn of(first: &[u8]) -> Self {
        match first {
            [0x1f, 0x8b, ..] => Packing::Gzip,
            [0x28, 0xb5, 0x2f, 0xfd, ..] => Packing::Zstd,
            _ => Packing::Plain,
        }
    }
}

/// Opens one file of any format: PLY, STL, OBJ, GLB or glTF, gzip or zstd compressed or not, `-` for standard input; or the
/// mesh that lies somewhere in it.
///
/// A plain PLY file is opened where it is, like `open_with`, unless it is a range grid; everything else is staged first. It is not
/// placed yet.
pub(crate) fn open_part(
    path: &Path,
    bytes: Option<Range<u64>>,
    options: &StageOptions,
) -> Result<MeshSource> {
    let (mut given_bytes, mut stream_checksum) = (None, None);
    let file = if path == Path::new("-") {
        let name = Path::new("standard input");
        let (file, checksum) = unpack(name, std::io::stdin().lock(), options)?;
        stream_checksum = Some(checksum);
        file
    } else {
        let mut file = RawFile::open(path)?;
        let is_part = bytes.is_some();
        if let Some(bytes) = bytes {
            file = file.part(bytes)?;
        }
        given_bytes = Some(file.len());
        let mut first = [0u8; 4];
        let n = file.read_at_most(&mut first, 0)?;
        if is_part || Packing::of(&first[..n]) == Packing::Plain {
            file
        } else {
            unpack(path, open_input(path)?, options)?.0
        }
    };
    let mut source = open_raw(file, options)?;
    if let Some(bytes) = given_bytes {
        source.set_given_bytes(bytes);
    }
    if let Some(checksum) = stream_checksum {
        source.set_stream_checksum(checksum);
    }
    Ok(source)
}

impl MeshSource {
    /// Reads bytes in memory as if they were a file of any format.
    pub fn staged_from_bytes(name: &str, bytes: Vec<u8>, options: &StageOptions) -> Result<Self> {
        let file = match Packing::of(&bytes) {
            Packing::Plain => RawFile::from_bytes(name, bytes),
            _ => unpack(Path::new(name), &bytes[..], options)?.0,
        };
        open_raw(file, options)
    }
}

/// Opens what is readable at random, whatever its format.
fn open_raw(file: RawFile, options: &StageOptions) -> Result<MeshSource> {
    let mut read = options.read.clone();
    read.temp_dir = Some(options.temp_dir.clone());
    let mut first = [0u8; 4096];
    let n = file.read_at_most(&mut first, 0)?;
    let first = &first[..n];
    let is_stl = stl::has_fitting_length(&file)?;
    if !is_stl && containers::is_zip(first) {
        let (inside, folder) = containers::unzip(&file, options)?;
        if containers::is_zip(&start_of(&inside)?) {
            return Err(file.bad("this is an archive in an archive: unpack it first"));
        }
        let source = open_raw(inside, options);
        let Some(folder) = folder else { return source };
        let (inner, name) = (folder.path(), file.path());
        let mut source = source.map_err(|error| error.moved(inner, name))?;
        source.leave_folder(inner, name, options.spool())?;
        return Ok(source);
    }
    if let (false, Some(encoding)) = (is_stl, encodings::utf16(first)) {
        return open_raw(encodings::to_utf8(&file, encoding, options.spool())?, options);
    }
    let extension = file.path().file_name().map(|n| n.to_string_lossy().to_ascii_lowercase());
    let named = |format: &str| {
        extension.as_deref().is_some_and(|name| {
            [format!(".{format}"), format!(".{format}.gz"), format!(".{format}.zst")]
                .iter()
                .any(|end| name.ends_with(end))
        })
    };
    let text = first.strip_prefix(BYTE_ORDER_MARK).unwrap_or(first);
    if text.starts_with(b"ply") && text.get(3).is_none_or(u8::is_ascii_whitespace) {
        let source = MeshSource::new(file, read.clone())?;
        return match source.range_grid() {
            None => Ok(source),
            Some(grid) => {
                let (file, bad_faces) =
                    source.mesh_of_grid(grid, options.spool(), options.spool())?;
                let faults = Faults { bad_faces, ..source.faults() };
                MeshSource::from_staged(file, read, Staged { faults, ..Staged::default() })
            }
        };
    }
    let (format, (file, staged)) = if gltf::looks_like(first) {
        ("glTF", gltf::read(file, options)?)
    } else if let (false, Some(refusal)) = (is_stl, containers::refusal(&file, first)) {
        return Err(refusal);
    } else if named("obj") || (!named("stl") && obj::looks_like(first)) {
        ("OBJ", obj::read(&file, options)?)
    } else if stl::is_ascii(first) && !stl::is_binary(first, file.len()) {
        ("STL, ASCII", stl::read_ascii(&file, options)?)
    } else if named("stl") || is_stl {
        ("STL, binary", stl::read_binary(&file, options)?)
    } else if first.starts_with(PROGRESSIVE_MAGIC) {
        let what = "this is a progressive mesh of stonecut; 'stonecut refine' makes a mesh of any number of triangles of it";
        return Err(file.bad(what));
    } else {
        return Err(file.bad(
            "this is neither PLY, STL, OBJ nor glTF (also gzip or zstd compressed); convert it to one \
             of them first",
        ));
    };
    let staged = Staged { format: Some(format), ..staged };
    MeshSource::from_staged(file, read, staged)
}

/// The first bytes of a file.
fn start_of(file: &RawFile) -> Result<[u8; 4]> {
    let mut first = [0; 4];
    file.read_at_most(&mut first, 0)?;
    Ok(first)
}

/// Copies a stream, decompressed, to a nameless file. Returns its checksum (xxh3) too.
fn unpack(path: &Path, reader: impl Read, options: &StageOptions) -> Result<(RawFile, u64)> {
    use std::io::BufRead;
    let mut reader = BufReader::with_capacity(1 << 20, reader);
    let first = reader.fill_buf().map_err(|e| Error::reading(path, "cannot read", e))?;
    let packing = Packing::of(first);
    let window = zstd_window(first);
    let mut spool = options.spool();
    let checksum = match packing {
        Packing::Plain => copy(path, reader, &mut spool)?,
        // Several members or frames one after another are one stream (`cat a.gz b.gz`, pigz).
        Packing::Gzip => copy(path, flate2::bufread::MultiGzDecoder::new(reader), &mut spool)?,
        Packing::Zstd => {
            let starting = |e| Error::reading(path, "cannot start decompressing", e);
            let most = window_log(options.parse_bytes);
            let mut decoder = zstd::stream::read::Decoder::with_buffer(reader).map_err(starting)?;
            decoder.window_log_max(most).map_err(starting)?;
            copy(path, decoder, &mut spool).map_err(|error| match error {
                Error::BadInput { what, .. } if what.contains(WINDOW_TOO_LARGE) => {
                    Error::NoMemory(too_large_a_window(path, window, most))
                }
                other => other,
            })?
        }
    };
    Ok((spool.finish(path)?, checksum))
}

/// The words of zstd for a window above the limit.
const WINDOW_TOO_LARGE: &str = "too much memory";

/// Binary logarithm of the largest window that some memory holds, within what zstd has.
fn window_log(memory_bytes: u64) -> u32 {
    memory_bytes.max(1).ilog2().clamp(10, 31)
}

/// Bytes of the window of a zstd frame that begins like this (RFC 8878, section 3.1.1.1).
fn zstd_window(first: &[u8]) -> Option<u64> {
    let (&descriptor, &window) = (first.get(4)?, first.get(5)?);
    if descriptor & 0x20 != 0 {
        // One segment: its window is its content, whose length stands in the header.
        let at = 5 + [0, 1, 2, 4][usize::from(descriptor & 3)];
        let n = [1, 2, 4, 8][usize::from(descriptor >> 6)];
        let mut bytes = [0; 8];
        bytes[..n].copy_from_slice(first.get(at..at + n)?);
        return Some(u64::from_le_bytes(bytes));
    }
    let base = 1u64 << (10 + (window >> 3));
    Some(base + base / 8 * u64::from(window & 7))
}

fn too_large_a_window(path: &Path, window: Option<u64>, most: u32) -> String {
    let limit = 1u64 << most;
    let path = path.display();
    let Some(window) = window.filter(|&window| window > limit) else {
        let limit = show_bytes(limit);
        return format!(
            "{path}: a zstd frame in it needs a window of more than {limit}; give more --memory, or unpack it first (zstd -d --long=31)"
        );
    };
    let memory = StageOptions::memory_for(window.next_power_of_two());
    format!(
        "{path}: unpacking it takes a window of {}, more than the {} at hand; give --memory {memory}, or unpack it \
         first (zstd -d --long=31)",
        show_bytes(window),
        show_bytes(limit)
    )
}

fn copy(path: &Path, mut reader: impl Read, spool: &mut Spool) -> Result<u64> {
    let mut buffer = vec![0; 1 << 20];
    let mut hasher = xxhash_rust::xxh3::Xxh3::new();
    loop {
        match reader.read(&mut buffer) {
            Ok(0) => return Ok(hasher.digest()),
            Ok(n) => {
                hasher.update(&buffer[..n]);
                spool.write(&buffer[..n])?;
            }
            Err(e) if e.kind() == std::io::ErrorKind::Interrupted => {}
            Err(e) if e.raw_os_error().is_some() => {
                return Err(Error::reading(path, "cannot read", e));
            }
            Err(e) => {
                return Err(Error::bad_input(
                    path,
                    format!(
                        "byte offset {} of the decompressed data: {e}; the compressed file is damaged \
                         or cut off, fetch it again",
                        spool.len()
                    ),
                ));
            }
        }
    }
}
