//! Texture of OBJ files: coordinates that corners name by number.
//!
//! Coordinates may stand anywhere in the file, so corners find theirs by two sorts on disk: by the number
//! they name, and back by corner.

use crate::external_sort::{ExternalSort, halves, whole};
use crate::materials::Materials;
use crate::open_options::StageOptions;
use crate::ply::raw::{RawFile, Spool};
use crate::text_lines::{not_a_number, parse_number, parse_whole};
use std::collections::HashMap;
use stonecut_system::error::{Error, Result};

/// Coordinates and corners on their way to each other.
///
/// Memory: a third of the stage's for each sort. Disk: 8 bytes for each pair of coordinates, 16 a corner for
/// each of two sorts.
pub(super) struct TexturedFaces<'a> {
    options: &'a StageOptions,
    coordinates: Spool,
    n_coordinates: u64,
    /// Lines `vt` with a value that is not finite.
    pub(super) n_not_finite: u64,
    /// Corners whose name for their coordinates is 0 or before the first ones.
    n_unknown: u64,
    /// Those with a third value besides 0.
    pub(super) n_thirds: u64,
    /// Faces with a corner that names none, by material.
    n_bare: HashMap<i32, u64>,
    /// Labels of each face: its material, and its name if there are any.
    labels: Spool,
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
            coordinates: options.spool(),
            n_coordinates: 0,
            n_not_finite: 0,
            n_thirds: 0,
            n_unknown: 0,
            n_bare: HashMap::new(),
            labels: options.spool(),
            by_coordinates: options.sort(memory_bytes),
            n_corners: 0,
        }
    }

    /// Takes the numbers of a line `vt`: one, two or three; the outer error is the line's. With `skip_bad`, text that is
    /// not a number is NaN.
    pub(super) fn add_coordinates<'b>(
        &mut self,
        mut words: impl Iterator<Item = &'b [u8]>,
        skip_bad: bool,
    ) -> Result<Result<()>, String> {
        let mut uv = [0.0f32; 2];
        for (place, word) in uv.iter_mut().zip(&mut words) {
            *place = match parse_number(word) {
                Some(value) => value as f32,
                None if skip_bad => f32::NAN,
                None => {
                    let remedy = "repair the file, or use --skip-bad";
                    return Err(not_a_number("a texture coordinate", word, remedy));
                }
            };
        }
        self.n_coordinates += 1;
        self.n_thirds += u64::from(words.next().and_then(parse_number).is_some_and(|w| w != 0.0));
        self.n_not_finite += u64::from(uv.iter().any(|x| !x.is_finite()));
        Ok(self.coordinates.write(uv.map(f32::to_le_bytes).as_flattened()))
    }

    /// Takes the corners of a face that is kept; what names no coordinates so far has none.
    pub(super) fn add_face<'b>(
        &mut self,
        words: impl Iterator<Item = &'b [u8]>,
        labels: &[u8],
    ) -> Result<()> {
        let mut is_bare = false;
        for word in words {
            let number = word.split(|&b| b == b'/').nth(1).and_then(|part| {
                let number = parse_whole(part)?;
                match number {
                    0 => None,
                    1.. => Some(number as u64 - 1),
                    _ => self.n_coordinates.checked_sub(number.unsigned_abs()),
                }
            });
            let is_named = word.split(|&b| b == b'/').nth(1).is_some_and(|part| !part.is_empty());
            self.n_unknown += u64::from(is_named && number.is_none());
            is_bare |= !is_named;
            let ([high, low], [c, d]) = (halves(number.unwrap_or(NONE)), halves(self.n_corners));
            self.by_coordinates.push([high, low, c, d])?;
            self.n_corners += 1;
        }
        if let (true, Some(&material)) = (is_bare, labels.first_chunk()) {
            *self.n_bare.entry(i32::from_le_bytes(material)).or_default() += 1;
        }
        self.labels.write(labels)
    }

    /// Faces without coordinates though their material has an image.
    pub(super) fn n_bare(&self, materials: &Materials) -> u64 {
        let n_faces = self.n_bare.iter().filter(|(material, _)| materials.has_base(**material));
        n_faces.map(|(_, n)| n).sum()
    }

    /// The rows of `faces` (a count in 4 bytes, then indices) with coordinates and labels behind them; and the number of
    /// corners that name coordinates that do not exist.
    pub(super) fn join(
        self,
        faces: &RawFile,
        (index_bytes, label_bytes): (usize, usize),
        n_faces: u64,
    ) -> Result<(RawFile, u64)> {
        let coordinates = self.coordinates.finish(faces.path())?;
        let mut known = Ahead::new(&coordinates);
        let mut by_corner = self.options.sort::<4>((self.options.memory_bytes / 3) as usize);
        let (mut n_read, mut uv, mut n_unknown) = (0, [0u8; 8], self.n_unknown);
        self.by_coordinates.drain(|[high, low, c, d]| {
            let number = whole(high, low);
            let found = number < self.n_coordinates;
            n_unknown += u64::from(!found && number != NONE);
            while found && n_read <= number {
                known.read(&mut uv)?;
                n_read += 1;
            }
            let word = |at: usize| u32::from_le_bytes([uv[at], uv[at + 1], uv[at + 2], uv[at + 3]]);
            let [u, v] = if found { [word(0), word(4)] } else { [0; 2] };
            by_corner.push([c, d, u, v])
        })?;
        let labels = self.labels.finish(faces.path())?;
        let mut rows = Rows {
            faces: Ahead::new(faces),
            labels: Ahead::new(&labels),
            index_bytes,
            label_bytes,
            faces_left: n_faces,
            row: Vec::new(),
            corners_left: 0,
            out: self.options.spool(),
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
        Ok((rows.out.finish(faces.path())?, n_unknown))
    }
}

/// Rows of faces that get coordinates and labels.
struct Rows<'a> {
    faces: Ahead<'a>,
    labels: Ahead<'a>,
    index_bytes: usize,
    label_bytes: usize,
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

    /// Writes the row with its labels.
    fn end(&mut self) -> Result<()> {
        let n = self.row.len();
        self.row.resize(n + self.label_bytes, 0);
        self.labels.read(&mut self.row[n..])?;
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
