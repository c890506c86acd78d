//! Texture of OBJ files: coordinates that corners name by number, and the materials of faces.
//!
//! Coordinates may stand anywhere in the file, so corners find theirs by two sorts on disk: by the number
//! they name, and back by corner. A material becomes the number of an image; its name, its library and its
//! image (if the library lies beside the file) become comments, which the writer of OBJ turns back.

use crate::error::{Error, Result};
use crate::io::external_sort::{ExternalSort, halves, whole};
use crate::io::open_options::StageOptions;
use crate::io::ply::raw::{RawFile, Spool};
use crate::io::text_lines::{parse_number, words};
use std::collections::BTreeMap;
use std::path::Path;

/// Materials beyond this many are one.
const MAX_MATERIALS: usize = 65_536;

/// A longer library of materials is none.
const MAX_LIBRARY_BYTES: u64 = 64 << 20;

/// Names of materials and of the libraries that describe them, in the order of the file.
#[derive(Default)]
pub(super) struct Materials {
    libraries: Vec<String>,
    names: Vec<String>,
    numbers: BTreeMap<String, i32>,
}

impl Materials {
    /// Takes a line `mtllib` or `usemtl`.
    pub(super) fn learn(&mut self, word: &[u8], line: &[u8]) {
        let name = after(word.len(), line);
        match word {
            b"mtllib" if self.libraries.len() < MAX_MATERIALS => self.libraries.push(name),
            b"usemtl" if self.names.len() < MAX_MATERIALS && !self.numbers.contains_key(&name) => {
                self.numbers.insert(name.clone(), self.names.len() as i32);
                self.names.push(name);
            }
            _ => {}
        }
    }

    /// The number of the material that a line `usemtl` names.
    pub(super) fn number(&self, line: &[u8]) -> i32 {
        self.numbers.get(&after(6, line)).copied().unwrap_or(0)
    }

    /// The image of each material; the material's name where the library does not say. Without materials,
    /// the libraries.
    pub(super) fn images(&self, obj: &Path) -> Vec<String> {
        if self.names.is_empty() {
            return self.libraries.clone();
        }
        let mut known = BTreeMap::new();
        for library in &self.libraries {
            let path = obj.with_file_name(library);
            let short =
                std::fs::metadata(&path).is_ok_and(|m| m.is_file() && m.len() <= MAX_LIBRARY_BYTES);
            // A library that is not there only leaves the images without names.
            let Some(text) = short.then(|| std::fs::read(&path).ok()).flatten() else { continue };
            let mut material = String::new();
            for line in text.split(|b| matches!(b, b'\n' | b'\r')) {
                match words(line).next() {
                    Some(b"newmtl") => material = after(6, line),
                    // Options stand before the name.
                    Some(b"map_Kd") => {
                        if let Some(name) = words(line).last() {
                            let name = String::from_utf8_lossy(name).into_owned();
                            known.entry(material.clone()).or_insert(name);
                        }
                    }
                    _ => {}
                }
            }
        }
        let image = |name: &String| known.get(name).unwrap_or(name).clone();
        self.names.iter().map(image).collect()
    }

    /// Returns the comments that a header keeps of them.
    pub(super) fn comments(&self, obj: &Path) -> Vec<String> {
        let libraries = self.libraries.iter().map(|name| format!("mtllib {name}"));
        let names = self.names.iter().map(|name| format!("usemtl {name}"));
        let n_images = if self.names.is_empty() { 0 } else { usize::MAX };
        let images = self.images(obj).into_iter().take(n_images);
        libraries.chain(names).chain(images.map(|name| format!("TextureFile {name}"))).collect()
    }
}

/// Returns the text after a line's first word of `n` bytes.
fn after(n: usize, line: &[u8]) -> String {
    let name = line.trim_ascii().get(n..).unwrap_or_default().trim_ascii();
    String::from_utf8_lossy(name).into_owned()
}

/// Coordinates and corners on their way to each other.
///
/// Memory: a third of the stage's for each sort. Disk: 8 bytes for each pair of coordinates, 16 a corner for
/// each of two sorts.
pub(super) struct TexturedFaces<'a> {
    options: &'a StageOptions,
    /// The number of the material of the faces to come.
    pub(super) image: i32,
    coordinates: Spool,
    n_coordinates: u64,
    images: Spool,
    /// Number of the coordinates, and of the corner.
    by_coordinates: ExternalSort<4>,
    n_corners: u64,
}

/// Name of a corner without coordinates.
const NONE: u64 = u64::MAX;

impl<'a> TexturedFaces<'a> {
    pub(super) fn new(options: &'a StageOptions) -> Self {
        let memory_bytes = (options.memory_bytes / 3) as usize;
        TexturedFaces {
            options,
            image: 0,
            coordinates: Spool::new(&options.temp_dir),
            n_coordinates: 0,
            images: Spool::new(&options.temp_dir),
            by_coordinates: ExternalSort::new(&options.temp_dir, memory_bytes),
            n_corners: 0,
        }
    }

    /// Takes the numbers of a line `vt`: one, two or three; the outer error is the line's.
    pub(super) fn add_coordinates<'b>(
        &mut self,
        words: impl Iterator<Item = &'b [u8]>,
    ) -> Result<Result<()>, &'static str> {
        let mut uv = [0.0f32; 2];
        for (place, word) in uv.iter_mut().zip(words) {
            *place = parse_number(word).ok_or("a texture coordinate is not a number")? as f32;
        }
        self.n_coordinates += 1;
        Ok(self.coordinates.write(uv.map(f32::to_le_bytes).as_flattened()))
    }

    /// Takes the corners of a face that is kept; what names no coordinates so far has none.
    pub(super) fn add_face<'b>(&mut self, words: impl Iterator<Item = &'b [u8]>) -> Result<()> {
        for word in words {
            let number = word.split(|&b| b == b'/').nth(1).and_then(|part| {
                let number: i64 = std::str::from_utf8(part).ok()?.parse().ok()?;
                match number {
                    0 => None,
                    1.. => Some(number as u64 - 1),
                    _ => self.n_coordinates.checked_sub(number.unsigned_abs()),
                }
            });
            let ([high, low], [c, d]) = (halves(number.unwrap_or(NONE)), halves(self.n_corners));
            self.by_coordinates.push([high, low, c, d])?;
            self.n_corners += 1;
        }
        self.images.write(&self.image.to_le_bytes())
    }

    /// The rows of `faces` (a count in 4 bytes, then indices) with coordinates and image behind them.
    pub(super) fn join(self, faces: &RawFile, index_bytes: usize, n_faces: u64) -> Result<RawFile> {
        let folder = &self.options.temp_dir;
        let coordinates = self.coordinates.finish(faces.path())?;
        let mut known = Ahead::new(&coordinates);
        let mut by_corner =
            ExternalSort::<4>::new(folder, (self.options.memory_bytes / 3) as usize);
        let (mut n_read, mut uv) = (0, [0u8; 8]);
        self.by_coordinates.drain(|[high, low, c, d]| {
            let number = whole(high, low);
            let found = number < self.n_coordinates;
            while found && n_read <= number {
                known.read(&mut uv)?;
                n_read += 1;
            }
            let word = |at: usize| u32::from_le_bytes([uv[at], uv[at + 1], uv[at + 2], uv[at + 3]]);
            let [u, v] = if found { [word(0), word(4)] } else { [0; 2] };
            by_corner.push([c, d, u, v])
        })?;
        let images = self.images.finish(faces.path())?;
        let mut rows = Rows {
            faces: Ahead::new(faces),
            images: Ahead::new(&images),
            index_bytes,
            faces_left: n_faces,
            row: Vec::new(),
            corners_left: 0,
            out: Spool::new(folder),
        };
        rows.begin()?;
        by_corner.drain(|[_, _, u, v]| {
            rows.row.extend_from_slice([u, v].map(u32::to_le_bytes).as_flattened());
            rows.corners_left -= 1;
            if rows.corners_left == 0 {
                rows.end()?;
                rows.begin()?;
            }
            Ok(())
        })?;
        rows.out.finish(faces.path())
    }
}

/// Rows of faces that get coordinates and image.
struct Rows<'a> {
    faces: Ahead<'a>,
    images: Ahead<'a>,
    index_bytes: usize,
    faces_left: u64,
    row: Vec<u8>,
    /// Corners of the row that have no coordinates yet.
    corners_left: u32,
    out: Spool,
}

impl Rows<'_> {
    /// Goes on to the next row that has corners; those without are passed on.
    fn begin(&mut self) -> Result<()> {
        while self.corners_left == 0 && self.faces_left > 0 {
            self.faces_left -= 1;
            let mut count = [0; 4];
            self.faces.read(&mut count)?;
            let n = u32::from_le_bytes(count);
            self.row.clear();
            self.row.resize(4 + n as usize * self.index_bytes, 0);
            self.row[..4].copy_from_slice(&count);
            self.faces.read(&mut self.row[4..])?;
            self.row.extend_from_slice(&(2 * n).to_le_bytes());
            self.corners_left = n;
            if n == 0 {
                self.end()?;
            }
        }
        Ok(())
    }

    /// Writes the row with its image.
    fn end(&mut self) -> Result<()> {
        let mut image = [0; 4];
        self.images.read(&mut image)?;
        self.row.extend_from_slice(&image);
        self.out.write(&self.row)
    }
}

/// A file read from its beginning on.
struct Ahead<'a> {
    file: &'a RawFile,
    at: u64,
    buffer: Vec<u8>,
    next: usize,
}

impl<'a> Ahead<'a> {
    fn new(file: &'a RawFile) -> Self {
        Ahead { file, at: 0, buffer: Vec::new(), next: 0 }
    }

    fn read(&mut self, out: &mut [u8]) -> Result<()> {
        let mut done = 0;
        while done < out.len() {
            if self.next == self.buffer.len() {
                self.buffer.resize(1 << 16, 0);
                let n = self.file.read_at_most(&mut self.buffer, self.at)?;
                if n == 0 {
                    return Err(cut_off(self.file));
                }
                self.buffer.truncate(n);
                self.at += n as u64;
                self.next = 0;
            }
            let n = (out.len() - done).min(self.buffer.len() - self.next);
            out[done..done + n].copy_from_slice(&self.buffer[self.next..self.next + n]);
            (done, self.next) = (done + n, self.next + n);
        }
        Ok(())
    }
}

fn cut_off(file: &RawFile) -> Error {
    file.bad("temporary data was cut off during the run")
}
