//! Materials that faces of an OBJ file name, as the libraries beside it describe them (`io::materials`).

use crate::encodings;
use crate::materials::{
    Material, Materials, Search, after_word, folded, library_beside, names_in_library, plain,
    read_library, settle_images,
};
use crate::open_options::StageOptions;
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

    /// The materials, as the libraries beside the file describe them; `is_textured` if corners have coordinates. Where no face
    /// names one, that of all faces, if there is any.
    ///
    /// Errors: `NoMemory` for a library that `parse_bytes` do not hold as it is and decoded.
    pub(super) fn describe(
        &self,
        obj: &Path,
        (is_textured, parse_bytes): (bool, u64),
    ) -> Result<Materials> {
        let material = |name: &String| Material { name: plain(name), ..Material::default() };
        let mut out = Materials::default();
        out.list = self.names.iter().map(material).collect();
        let mut known = vec![false; self.names.len()];
        let mut libraries = Libraries {
            search: Search::new("material library", &[folder_of(obj)]),
            images: Search::new("image", &[]),
            obj,
            read: HashSet::new(),
            lacks_image: false,
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
        if out.images.is_empty() && (known.is_empty() || known.contains(&false)) {
            self.take_only_one(&mut libraries, is_textured, &mut known, &mut out);
        }
        out.lacks_images = is_textured && libraries.lacks_image && out.images.is_empty();
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
        if out.list.is_empty() && !self.libraries.is_empty() {
            let library = self.library().unwrap_or_default();
            out.note(format!("no face names a material of '{library}': left out"));
        }
        out.name_all();
        Ok(out)
    }

    /// Takes the only material of all libraries for the only one that faces name, or, where none names one, for all faces that
    /// have coordinates in its image.
    fn take_only_one(
        &self,
        libraries: &mut Libraries,
        is_textured: bool,
        known: &mut Vec<bool>,
        out: &mut Materials,
    ) {
        let (mut names, mut has_image) = (Vec::new(), false);
        for path in &out.libraries {
            let text = libraries.text(path).unwrap_or_default();
            let (more, has) = names_in_library(text);
            names.extend(more);
            has_image |= has;
        }
        libraries.lacks_image |= has_image;
        let [only] = &names[..] else { return };
        let name = encodings::name(only);
        let line = match &self.names[..] {
            [named] => format!("'{named}', which no library has"),
            [] if is_textured && has_image => "all faces: none names one".to_owned(),
            _ => return,
        };
        if self.names.is_empty() {
            out.list.push(Material { name: plain(&name), ..Material::default() });
            known.push(false);
        }
        out.note(format!("material '{name}', the only one of the library, is taken for {line}"));
        let wanted = |name: &[u8]| (name == &only[..]).then_some(0);
        for path in out.libraries.clone() {
            libraries.read_again(&path, &wanted, known, out);
        }
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
    /// True if a line that names an image leads to none.
    lacks_image: bool,
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

    fn text(&self, path: &Path) -> std::io::Result<Vec<u8>> {
        let text = read_regular(path, self.parse_bytes.max(MIN_LIBRARY_BYTES))?;
        Ok(encodings::text_of_file(text))
    }

    /// Reads a library for what is not known yet.
    fn read_again(
        &mut self,
        path: &Path,
        wanted: &dyn Fn(&[u8]) -> Option<usize>,
        known: &mut [bool],
        out: &mut Materials,
    ) {
        match self.text(path) {
            Ok(text) => {
                self.images.set_folders(&[folder_of(path), folder_of(self.obj)]);
                self.lacks_image |= read_library(text, &mut self.images, wanted, known, out);
            }
            Err(error) => {
                let shown = path.display();
                out.libraries.retain(|other| other != path);
                out.note(format!("material library {shown} cannot be read: {error}"));
            }
        }
    }
}
