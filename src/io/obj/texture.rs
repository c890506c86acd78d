//! Texture of OBJ files: coordinates that corners name by number, and the materials of faces.
//!
//! Coordinates may stand anywhere in the file, so corners find theirs by two sorts on disk: by the number
//! they name, and back by corner. Materials are described by the libraries beside the file (`io::materials`).

use crate::encodings;
use crate::external_sort::{ExternalSort, halves, whole};
use crate::materials::{
    Material, Materials, Search, after_word, folded, library_beside, plain, read_library,
    settle_images,
};
use crate::open_options::StageOptions;
use crate::ply::raw::{RawFile, Spool};
use crate::text_lines::{not_a_number, parse_number, parse_whole};
use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};
use stonecut_system::disk::{folder_of, read_regular};
use stonecut_system::error::{Error, Result};
use stonecut_system::losses::{Loss, LossKind};
use stonecut_system::units::show_bytes;

/// Materials beyond this many are none.
const MAX_MATERIALS: usize = 65_536;

/// Names of materials beyond these bytes are none.
const MAX_NAME_BYTES: usize = 16 << 20;

/// Libraries beyond this many are not looked at.
const MAX_LIBRARIES: usize = 1000;

/// The number of a face without a material.
pub(super) const NO_MATERIAL: i32 = -1;

/// Names of materials and of the libraries that describe them, in the order of the file.
#[derive(Default)]
pub(super) struct Named {
    libraries: Vec<Vec<u8>>,
    known_libraries: HashSet<Vec<u8>>,
    /// Bytes of all names of materials.
    name_bytes: usize,
    names: Vec<String>,
    numbers: HashMap<Vec<u8>, usize>,
    has_too_many: bool,
}

impl Named {
    /// Takes a line `mtllib` or `usemtl`.
    pub(super) fn learn(&mut self, word: &[u8], line: &[u8]) {
        let name = after_word(word.len(), line).to_vec();
        match word {
            b"mtllib"
                if self.libraries.len() < MAX_LIBRARIES
                    && self.known_libraries.insert(name.clone()) =>
            {
                self.libraries.push(name);
            }
            b"usemtl" if !self.numbers.contains_key(&name) => {
                let n_bytes = self.name_bytes + name.len();
                if self.names.len() < MAX_MATERIALS && n_bytes <= MAX_NAME_BYTES {
                    self.name_bytes = n_bytes;
                    self.names.push(encodings::name(&name));
                    self.numbers.insert(name, self.numbers.len());
                } else {
                    self.has_too_many = true;
                }
            }
            _ => {}
        }
    }

    /// The first library.
    pub(super) fn library(&self) -> Option<String> {
        self.libraries.first().map(|name| encodings::name(name))
    }

    /// Returns whether faces have materials.
    pub(super) fn has_any(&self) -> bool {
        !self.names.is_empty()
    }

    /// The number of the material that a line `usemtl` names; -1 for none.
    pub(super) fn number(&self, line: &[u8]) -> i32 {
        self.numbers.get(after_word(6, line)).map_or(NO_MATERIAL, |&number| number as i32)
    }

    /// The materials, as the libraries beside the file describe them.
    ///
    /// Errors: `NoMemory` for a library that `parse_bytes` do not hold as it is and decoded.
    pub(super) fn describe(&self, obj: &Path, parse_bytes: u64) -> Result<Materials> {
        let material = |name: &String| Material { name: plain(name), ..Material::default() };
        let mut out = Materials::default();
        out.list = self.names.iter().map(material).collect();
        let mut known = vec![false; self.names.len()];
        let mut libraries = Libraries {
            search: Search::new("material library", &[folder_of(obj)]),
            images: Search::new("image", &[]),
            obj,
            read: HashSet::new(),
            parse_bytes,
        };
        let exact = |name: &[u8]| self.numbers.get(name).copied();
        let mut looked_at = HashSet::new();
        for name in &self.libraries {
            for path in libraries.search.find_all(name) {
                if looked_at.len() < MAX_LIBRARIES && looked_at.insert(path.clone()) {
                    libraries.read(&path, &exact, &mut known, &mut out)?;
                }
            }
        }
        if known.contains(&false) {
            self.look_further(&mut libraries, &mut known, &mut out)?;
        }
        settle_images(&mut out);
        for note in [libraries.search.note(), libraries.images.note()].into_iter().flatten() {
            out.note(note);
        }
        let n_unknown = known.iter().filter(|known| !**known).count();
        if n_unknown > 0 {
            let loss =
                Loss::new(LossKind::Materials, "materials", "in no library: kept by name, white");
            out.lose(loss.count(n_unknown as u64));
        }
        if self.has_too_many {
            let n = self.names.len();
            let what = format!("materials beyond the first {n}");
            out.lose(Loss::new(LossKind::Materials, what, "not carried: their faces have none"));
        }
        if self.names.is_empty() && !self.libraries.is_empty() {
            let library = self.library().unwrap_or_default();
            out.note(format!("no face names a material of '{library}': left out"));
        }
        out.name_all();
        Ok(out)
    }

    /// Looks for materials that no library has under their very name: in another library beside the file, and
    /// under names that differ in case, encoding, quotes or a comment.
    fn look_further(
        &self,
        libraries: &mut Libraries,
        known: &mut [bool],
        out: &mut Materials,
    ) -> Result<()> {
        let exact = |name: &[u8]| self.numbers.get(name).copied();
        let mut alike: HashMap<String, usize> = HashMap::new();
        for (name, &number) in &self.numbers {
            for name in encodings::names(name) {
                let first = alike.entry(folded(&plain(&name))).or_insert(number);
                *first = number.min(*first);
            }
        }
        let loose = |name: &[u8]| {
            let mut names = encodings::names(name).into_iter();
            names.find_map(|name| alike.get(&folded(&plain(&name))).copied())
        };
        let beside = library_beside(libraries.obj).filter(|path| !libraries.read.contains(path));
        if let Some(path) = beside.filter(|_| out.libraries.is_empty()) {
            libraries.read(&path, &exact, known, out)?;
            let first_known = |known: &[bool]| known.contains(&true);
            if !first_known(known) {
                libraries.read_again(&path, &loose, known, out);
            }
            if first_known(known) {
                out.note(format!(
                    "material library {} is taken: it is beside the mesh, which names {}",
                    path.display(),
                    self.library().map_or_else(|| "none".to_owned(), |name| format!("'{name}'"))
                ));
            } else {
                out.libraries.retain(|other| *other != path);
            }
        }
        let before: Vec<bool> = known.to_vec();
        for path in out.libraries.clone() {
            libraries.read_again(&path, &loose, known, out);
        }
        let found: Vec<usize> = (0..known.len()).filter(|&i| known[i] && !before[i]).collect();
        if let Some(&first) = found.first() {
            out.note(format!(
                "{} materials are found under names that differ in case, encoding, quotes or comments, the first '{}'",
                found.len(),
                self.names[first]
            ));
        }
        Ok(())
    }
}

/// A library of a mebibyte is read whatever the memory.
const MIN_LIBRARY_BYTES: u64 = 1 << 20;

/// Material libraries of a mesh.
struct Libraries<'a> {
    search: Search,
    images: Search,
    obj: &'a Path,
    /// Those that were read or could not be.
    read: HashSet<PathBuf>,
    parse_bytes: u64,
}

impl Libraries<'_> {
    /// Reads a library once.
    fn read(
        &mut self,
        path: &Path,
        wanted: &dyn Fn(&[u8]) -> Option<usize>,
        known: &mut [bool],
        out: &mut Materials,
    ) -> Result<()> {
        // One library may have many spellings.
        if !self.read.insert(path.canonicalize().unwrap_or_else(|_| path.to_path_buf())) {
            return Ok(());
        }
        let shown = path.display();
        match std::fs::metadata(path) {
            Ok(meta) if meta.is_file() => {
                let needed = 2 * meta.len();
                if needed > self.parse_bytes.max(MIN_LIBRARY_BYTES) {
                    return Err(Error::NoMemory(format!(
                        "material library {shown} takes {} of memory, more than the {} at hand; give --memory {}",
                        show_bytes(needed),
                        show_bytes(self.parse_bytes),
                        StageOptions::memory_for(needed)
                    )));
                }
                out.libraries.push(path.to_path_buf());
                self.read_again(path, wanted, known, out);
            }
            Ok(_) => out.note(format!("material library {shown} is not a file")),
            Err(_) => out.note(format!("material library {shown} is not there")),
        }
        Ok(())
    }

    /// Reads a library for what is not known yet.
    fn read_again(
        &mut self,
        path: &Path,
        wanted: &dyn Fn(&[u8]) -> Option<usize>,
        known: &mut [bool],
        out: &mut Materials,
    ) {
        match read_regular(path, self.parse_bytes.max(MIN_LIBRARY_BYTES)) {
            Ok(text) => {
                self.images.set_folders(&[folder_of(path), folder_of(self.obj)]);
                let text = encodings::text_of_file(text);
                read_library(text, &mut self.images, wanted, known, out);
            }
            Err(error) => {
                let shown = path.display();
                out.libraries.retain(|other| other != path);
                out.note(format!("material library {shown} cannot be read: {error}"));
            }
        }
    }
}

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
