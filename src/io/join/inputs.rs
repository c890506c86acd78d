//! The inputs of a command as they are typed: a file, several, a folder, a list (`@list.txt`), a tree of tiles.
//!
//! The set of parts does not depend on the order in which they are typed: each file once, by its full path, numbers in it
//! as numbers. Nothing is opened here but folders and lists.

use super::contents::{TileFrame, UpAxis, add_content};
use super::limits::LIST_SHARE;
use super::lists::{by_name, list_of, paths_of};
use super::trees::{self, is_tree};
use super::{InputSet, MeshPart, affine};
use std::collections::{BTreeMap, HashSet};
use std::ops::Deref;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};
use stonecut_system::error::{Error, Result};
use stonecut_system::losses::{Loss, LossKind};
use stonecut_system::memory::{budget_bytes, limit_bytes};
use stonecut_system::paths::{NOT_UTF8, Paths, Role, is_utf8};

/// Endings of mesh files, as they are looked for in folders.
const ENDINGS: [&str; 6] = ["ply", "stl", "obj", "glb", "gltf", "b3dm"];
/// Folders in folders that are looked into.
const MOST_DEPTH: usize = 8;

/// Paths that were typed for one mesh. As a `Path` it is what people are shown.
#[derive(Clone, Debug)]
pub struct InputPaths {
    given: Vec<PathBuf>,
    shown: PathBuf,
    /// Memory of the command, if it was said.
    memory: Option<u64>,
    /// True if files that are not there are left out and named.
    skips_missing: bool,
    found: Found,
}

/// The set of some paths once it was looked up: a run has one, whatever happens to folders meanwhile.
#[derive(Clone, Debug, Default)]
struct Found(Arc<OnceLock<InputSet>>);

impl InputPaths {
    /// Several paths; at least one.
    pub fn new(mut given: Vec<PathBuf>) -> InputPaths {
        // A resumed job knows its input, whatever the order.
        given.sort_by(|a, b| by_name(a, b));
        let shown = match given.as_slice() {
            [] => PathBuf::new(),
            [one] => one.clone(),
            [first, rest @ ..] => {
                let mut shown = first.clone().into_os_string();
                let others = if rest.len() == 1 { "other" } else { "others" };
                shown.push(format!(" and {} {others}", rest.len()));
                shown.into()
            }
        };
        let (memory, skips_missing) = (None, false);
        InputPaths { given, shown, memory, skips_missing, found: Found::default() }
    }

    /// The same paths in a command of this memory: lists and trees of tiles take a share of it.
    pub fn within(mut self, memory: Option<u64>) -> InputPaths {
        self.memory = memory;
        self
    }

    /// The same paths, of which those that are not there are left out and named if `skips` and others are there.
    pub fn skipping_missing(mut self, skips: bool) -> InputPaths {
        self.skips_missing = skips;
        self
    }

    /// The paths that were typed, sorted.
    pub fn given(&self) -> &[PathBuf] {
        &self.given
    }

    /// The folders among them.
    pub fn folders(&self) -> impl Iterator<Item = &PathBuf> {
        self.given.iter().filter(|path| path.is_dir())
    }

    /// The same paths as typed in another folder; standard input stays what it is.
    pub fn typed_in(&self, folder: &Path) -> InputPaths {
        let place = |path: &PathBuf| match list_of(path) {
            _ if path == Path::new("-") => path.clone(),
            Some(list) => {
                let mut place = std::ffi::OsString::from("@");
                place.push(folder.join(&*list));
                place.into()
            }
            None => folder.join(path),
        };
        let placed = InputPaths::new(self.given.iter().map(place).collect());
        placed.within(self.memory).skipping_missing(self.skips_missing)
    }

    /// Returns whether this is one mesh file, or standard input.
    pub fn is_one(&self) -> bool {
        let is_one = |path: &PathBuf| {
            list_of(path).is_none() && !path.is_dir() && !is_tree(path) && !is_tile(path)
        };
        self.given.len() < 2 && self.given.iter().all(is_one)
    }

    /// The parts, each once.
    ///
    /// Errors: folders and lists that cannot be read or hold no mesh, or meshes of several formats; `NoMemory` for lists and
    /// trees beyond a share of the memory.
    pub fn set(&self) -> Result<&InputSet> {
        match self.found.0.get() {
            Some(set) => Ok(set),
            None => {
                let set = self.look_up()?;
                Ok(self.found.0.get_or_init(|| set))
            }
        }
    }

    fn look_up(&self) -> Result<InputSet> {
        let mut set = InputSet::default();
        let limit = budget_bytes(self.memory, limit_bytes()) / LIST_SHARE;
        for path in &self.given {
            if path == Path::new("-") && self.given.len() > 1 {
                let what = "'-' among several inputs: standard input is one mesh by itself";
                return Err(Error::Usage(what.to_owned()));
            }
            add(path, (limit, self.skips_missing), &mut set)?;
        }
        if self.skips_missing && set.parts.iter().any(|part| part.path.exists()) {
            let InputSet { parts, losses, .. } = &mut set;
            parts.retain(|part| {
                let is_there = part.path.exists();
                if !is_there {
                    losses.lose(left_out(&format!("{}: not there", part.path.display())));
                }
                is_there
            });
        }
        let mut keyed: Vec<(PathBuf, MeshPart)> =
            set.parts.into_iter().map(|part| (full(&part.path), part)).collect();
        keyed.sort_by(|(a, p), (b, q)| {
            let start = |part: &MeshPart| part.bytes.as_ref().map_or(0, |bytes| bytes.start);
            let places = || p.placing.setting().cmp(&q.placing.setting());
            by_name(a, b).then_with(|| start(p).cmp(&start(q))).then_with(places)
        });
        let mut parts: Vec<(PathBuf, MeshPart)> = Vec::with_capacity(keyed.len());
        for (path, part) in keyed {
            let same = |(other, known): &(PathBuf, MeshPart)| {
                let is_same = (&known.placing, &known.bytes) == (&part.placing, &part.bytes);
                *other == path && is_same
            };
            match parts.last().is_some_and(same) {
                true => set.repeated.push(part.path),
                false => parts.push((path, part)),
            }
        }
        set.parts = parts.into_iter().map(|(_, part)| part).collect();
        Ok(set)
    }

    /// Adds all files and folders to the paths of a command, under the name that people know them by.
    pub fn add_to(&self, paths: Paths, name: &'static str) -> Result<Paths> {
        let files = self.files()?.into_iter();
        let paths = files.fold(paths, |paths, file| paths.with(Role::Input, name, file));
        let add = |paths, folder: &PathBuf| Paths::with(paths, Role::InputParts, name, folder);
        Ok(self.folders().fold(paths, add))
    }

    /// The first mesh file: one that files beside it may say the place of. As shown where none is found.
    pub fn first(&self) -> PathBuf {
        let part = || self.set().ok()?.parts.first();
        let first = if self.is_one() { None } else { part() };
        first.map_or_else(|| self.shown.clone(), |part| part.path.clone())
    }

    /// All files that are read, each once.
    pub fn files(&self) -> Result<Vec<PathBuf>> {
        if self.is_one() {
            return Ok(self.given.clone());
        }
        let set = self.set()?;
        let mut seen = HashSet::new();
        let parts = set.parts.iter().map(|part| &part.path);
        Ok(parts.chain(&set.found_in).filter(|path| seen.insert(*path)).cloned().collect())
    }
}

/// The loss of a file among several: a part of the surface is not there, so the command ends with 3 as with dropped faces.
pub(super) fn left_out(error: &str) -> Loss {
    Loss::new(LossKind::Geometry, "files", "left out: cannot be read").example(error).whole()
}

/// Returns whether a file is a tile with a mesh in it, by its name.
fn is_tile(path: &Path) -> bool {
    path.extension().is_some_and(|end| end.eq_ignore_ascii_case("b3dm"))
}

/// The full path where links are followed; as typed where nothing is there.
fn full(path: &Path) -> PathBuf {
    std::fs::canonicalize(path).unwrap_or_else(|_| path.to_path_buf())
}

/// Adds what a path names; `limit` is the memory for lists and trees, and folders that a list names and that hold no mesh are
/// left out if `skips`.
fn add(path: &Path, (limit, skips): (u64, bool), set: &mut InputSet) -> Result<()> {
    if let Some(list) = list_of(path) {
        let before = set.parts.len();
        for path in paths_of(&list, limit)? {
            match add(&path, (limit, skips), set) {
                Err(error @ Error::BadInput { .. }) if skips && path.is_dir() => {
                    set.losses.lose(left_out(&error.to_string()));
                }
                added => added?,
            }
        }
        if set.parts.len() == before {
            return Err(Error::bad_input(&*list, "this list names no mesh; give one path a line"));
        }
        set.found_in.push(list.into_owned());
        return Ok(());
    }
    if path.is_dir() {
        return add_folder(path, limit, set);
    }
    if is_tree(path) {
        let InputSet { parts, found_in, repeated, losses } = trees::parts_of(path, limit)?;
        set.repeated.extend(repeated);
        set.parts.extend(parts);
        set.found_in.extend(found_in);
        set.losses.merge(&losses);
        return Ok(());
    }
    add_file(path, set)
}

/// Adds a mesh; a tile lies as it does in a tree.
fn add_file(path: &Path, set: &mut InputSet) -> Result<()> {
    if !is_tile(path) {
        set.parts.push(MeshPart::of(path));
        return Ok(());
    }
    let frame = TileFrame { map: affine::NONE, replaces: true, up: UpAxis::Y };
    match add_content(path, &frame, set)? {
        true => Ok(()),
        false => Err(Error::bad_input(path, "this tile holds no mesh")),
    }
}

/// Meshes of a folder by format (a folder with the root of a tree is that tree), and folders beside them.
#[derive(Default)]
struct Looked {
    by_format: BTreeMap<&'static str, Vec<PathBuf>>,
    beside: Vec<PathBuf>,
}

/// Stands for the format of files that describe trees of tiles.
const TREE: &str = "json";

/// Adds all meshes of a folder; where it has none itself, those of the folders in it. Where there are trees of tiles, these.
fn add_folder(folder: &Path, limit: u64, set: &mut InputSet) -> Result<()> {
    let mut looked = Looked::default();
    look(folder, MOST_DEPTH, &mut looked)?;
    let Looked { mut by_format, beside } = looked;
    for folder in beside {
        let mut passed = Looked::default();
        let n = match look(&folder, MOST_DEPTH, &mut passed) {
            Ok(()) => passed.by_format.values().map(Vec::len).sum(),
            Err(_) => 0,
        };
        if n > 0 {
            let path = folder.display();
            let what = format!(
                "{path}: meshes in it are not read ({n}), since there are some beside it; name it too"
            );
            set.losses.lose(Loss::remark(what));
        }
    }
    if let Some(trees) = by_format.remove(TREE) {
        trees.iter().try_for_each(|tree| add(tree, (limit, false), set))?;
        let read: HashSet<PathBuf> = set.parts.iter().map(|part| full(&part.path)).collect();
        let mut others = by_format.values().flatten().filter(|path| !read.contains(&full(path)));
        if let Some(path) = others.next() {
            let (n, path) = (others.count() + 1, path.display());
            let what = format!(
                "{path}: not read ({n} such in all), since there are trees of tiles in the folder; name it too"
            );
            set.losses.lose(Loss::remark(what));
        }
        return Ok(());
    }
    match by_format.len() {
        0 => {
            let what =
                "no mesh in this folder (looked for .ply, .stl, .obj, .glb, .gltf and .b3dm)";
            Err(Error::bad_input(folder, what))
        }
        1 => {
            let (files, coarser) = finest_levels(by_format.into_values().flatten().collect());
            if let Some(path) = coarser.first() {
                let (n, path) = (coarser.len(), path.display());
                let what = format!(
                    "{path}: a coarser level of detail, left out ({n} such in all); name files to have them"
                );
                set.losses.lose(Loss::remark(what));
            }
            files.iter().try_for_each(|path| add_file(path, set))
        }
        _ => {
            let counts: Vec<String> = by_format
                .iter()
                .map(|(format, files)| format!("{} .{format}", files.len()))
                .collect();
            let (path, first) = (folder.display(), by_format.keys().next().copied().unwrap_or(""));
            let what = format!(
                "meshes of several formats in this folder ({}); name those of one, as in {path}/*.{first}",
                counts.join(", ")
            );
            Err(Error::bad_input(folder, what))
        }
    }
}

/// Files without those that finer ones take the place of, by names as ContextCapture gives them, and these: in
/// `Tile_+000_+001_L15_0.obj` a level and a place in the tree, to which each finer level appends.
fn finest_levels(files: Vec<PathBuf>) -> (Vec<PathBuf>, Vec<PathBuf>) {
    let place = |path: &PathBuf| -> Option<(PathBuf, String, u32)> {
        let stem = path.file_stem()?.to_str().filter(|stem| stem.starts_with("Tile_"))?;
        let (tile, node) = stem.rsplit_once("_L").unwrap_or((stem, "0_"));
        let (level, node) = node.split_once('_')?;
        Some((path.with_file_name(tile), node.to_owned(), level.parse().ok()?))
    };
    let mut known: Vec<_> = files.iter().filter_map(place).collect();
    known.sort();
    // Behind a place stand those within it.
    let is_coarser = |path: &PathBuf| {
        let Some(own) = place(path) else { return false };
        let next = known.get(known.partition_point(|other| *other <= own));
        next.is_some_and(|(tile, node, level)| {
            *tile == own.0 && node.starts_with(&own.1) && *level > own.2
        })
    };
    let (coarser, finest) = files.into_iter().partition(is_coarser);
    (finest, coarser)
}

fn look(folder: &Path, depth: usize, looked: &mut Looked) -> Result<()> {
    let fail = |e| Error::reading(folder, "cannot read the folder", e);
    let (mut folders, mut trees, mut meshes) = (Vec::new(), Vec::new(), Vec::new());
    for entry in std::fs::read_dir(folder).map_err(fail)? {
        let entry = entry.map_err(fail)?;
        let (path, name) = (entry.path(), entry.file_name().to_string_lossy().to_lowercase());
        if name.starts_with('.') || name.ends_with(".stonecut-job") {
            continue;
        }
        if path.is_dir() {
            folders.push(path);
        } else if let Some(format) = format_of(&name) {
            if !is_utf8(&path) {
                return Err(Error::bad_input(path, NOT_UTF8));
            }
            meshes.push((format, path));
        } else if is_tree(&path) {
            trees.push(path);
        }
    }
    // Of several that may name each other only the usual name tells the root.
    let is_root = |path: &PathBuf| path.file_name().is_some_and(|name| name == "tileset.json");
    trees.sort_by_key(|path| !is_root(path));
    match trees.first() {
        Some(tree) if trees.len() == 1 || is_root(tree) => meshes = vec![(TREE, tree.clone())],
        _ if !meshes.is_empty() => looked.beside.extend(folders),
        _ if depth > 0 => folders.iter().try_for_each(|inner| look(inner, depth - 1, looked))?,
        _ => {}
    }
    for (format, path) in meshes {
        looked.by_format.entry(format).or_default().push(path);
    }
    Ok(())
}

/// The format of a mesh file, by its name in small letters.
fn format_of(name: &str) -> Option<&'static str> {
    let name = name.strip_suffix(".gz").or(name.strip_suffix(".zst")).unwrap_or(name);
    let (_, ending) = name.rsplit_once('.')?;
    ENDINGS.into_iter().find(|known| *known == ending)
}

impl Deref for InputPaths {
    type Target = Path;

    fn deref(&self) -> &Path {
        &self.shown
    }
}

impl AsRef<Path> for InputPaths {
    fn as_ref(&self) -> &Path {
        self
    }
}

impl From<Vec<PathBuf>> for InputPaths {
    fn from(given: Vec<PathBuf>) -> InputPaths {
        InputPaths::new(given)
    }
}

impl From<PathBuf> for InputPaths {
    fn from(path: PathBuf) -> InputPaths {
        InputPaths::new(vec![path])
    }
}

impl From<&InputPaths> for InputPaths {
    fn from(paths: &InputPaths) -> InputPaths {
        paths.clone()
    }
}

impl<T: AsRef<std::ffi::OsStr> + ?Sized> From<&T> for InputPaths {
    fn from(path: &T) -> InputPaths {
        InputPaths::new(vec![PathBuf::from(path.as_ref())])
    }
}

/// Paths are equal by what was typed.
impl PartialEq for InputPaths {
    fn eq(&self, other: &InputPaths) -> bool {
        self.given == other.given
    }
}

impl Eq for InputPaths {}

impl PartialEq<&Path> for InputPaths {
    fn eq(&self, other: &&Path) -> bool {
        self.given.len() == 1 && self.shown == **other
    }
}

impl serde::Serialize for InputPaths {
    fn serialize<S: serde::Serializer>(
        &self,
        serializer: S,
    ) -> std::result::Result<S::Ok, S::Error> {
        self.shown.serialize(serializer)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_order_is_that_of_names_with_their_numbers() {
        let mut names = ["t/b_2", "t/b_10", "t/b_010", "t/a", "t/b_02", "t"].map(Path::new);
        names.sort_by(|a, b| by_name(a, b));
        let sorted = ["t", "t/a", "t/b_02", "t/b_2", "t/b_010", "t/b_10"].map(Path::new);
        assert_eq!(names, sorted);
    }

    #[test]
    fn folders_and_lists_name_parts_and_each_file_counts_once() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        for name in ["b.obj", "a10.obj", "a9.obj", "a.mtl"] {
            std::fs::write(at(name), "").unwrap();
        }
        std::fs::write(at("list.txt"), "b.obj\n# none\n\na9.obj\n").unwrap();
        let mut list = std::ffi::OsString::from("@");
        list.push(at("list.txt"));
        let inputs = InputPaths::new(vec![at("b.obj"), list.into(), folder.path().into()]);
        let turned = InputPaths::new(inputs.given().iter().rev().cloned().collect());
        assert_eq!(inputs, turned);
        let set = inputs.set().unwrap();
        let names: Vec<_> = set.parts.iter().map(|p| p.path.file_name().unwrap()).collect();
        assert_eq!(names, ["a9.obj", "a10.obj", "b.obj"]);
        assert_eq!((set.repeated.len(), &set.found_in), (3, &vec![at("list.txt")]));
        assert!(inputs.display().to_string().ends_with(" and 2 others"));
        std::fs::write(at("c.ply"), "").unwrap();
        let error = InputPaths::from(folder.path()).set().unwrap_err().to_string();
        assert!(error.contains("3 .obj, 1 .ply"), "{error}");
    }
}
