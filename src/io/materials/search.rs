//! Finds the files that a mesh names, though it was made on another machine.
//!
//! As written first, also with slashes for backslashes, without quotes or a comment behind. Then what the name ends in is
//! looked for beside the mesh and its library, without regard to case and to how accents are encoded, then in the folders
//! below, and at last with the endings of other kinds of images. Says what was taken instead.

use crate::encodings;
use std::collections::HashMap;
use std::ffi::{OsStr, OsString};
use std::os::unix::ffi::OsStrExt;
use std::path::{Component, Path, PathBuf};
use unicode_normalization::UnicodeNormalization;

/// Folders in a name that are looked at, from its end.
const MAX_PARTS: usize = 16;

/// Files of a folder that are remembered; names in fuller folders are found as they are written only.
const MAX_LISTED: usize = 100_000;

/// Levels of folders below that of a mesh, and the number of these folders, that are looked through.
const MAX_DEPTH: usize = 3;
const MAX_FOLDERS: usize = 1000;

/// Folders that hold images by their name: of several files of one name, the one there is meant. They may lie beside the
/// folder of the mesh, too.
const IMAGE_FOLDERS: [&str; 8] =
    ["textures", "texture", "images", "image", "tex", "maps", "materials", "img"];

/// Endings of images, the likeliest first.
const ENDINGS: [&str; 10] =
    ["png", "jpg", "jpeg", "tif", "tiff", "webp", "bmp", "tga", "ktx2", "exr"];

/// Words in a name that stand for the number of a tile, and the form of that: a digit for every 9.
const UDIM: [(&str, &str); 3] = [("<udim>", "9999"), ("%(udim)d", "9999"), ("<uvtile>", "u9_v9")];

/// Files of one name in folders below: the first of the likeliest, and their number.
struct Below {
    path: PathBuf,
    is_likely: bool,
    n: usize,
}

/// A search in the folders of a mesh and its material libraries.
pub struct Search {
    /// The kind of file, in messages.
    what: &'static str,
    folders: Vec<PathBuf>,
    /// Names in lower case and as they are, by folder.
    listings: HashMap<PathBuf, HashMap<String, OsString>>,
    /// Files below each folder.
    below: HashMap<PathBuf, HashMap<String, Below>>,
    /// Number of files found elsewhere than written, and the first of them.
    n_elsewhere: usize,
    first: Option<(String, PathBuf)>,
}

impl Search {
    /// Looks in these folders, in order.
    pub fn new(what: &'static str, folders: &[&Path]) -> Search {
        let mut list: Vec<PathBuf> = Vec::new();
        for folder in folders {
            if !list.iter().any(|known| known == folder) {
                list.push(folder.to_path_buf());
            }
        }
        let (listings, below) = (HashMap::new(), HashMap::new());
        Search { what, folders: list, listings, below, n_elsewhere: 0, first: None }
    }

    /// The same search beside another library.
    pub fn set_folders(&mut self, folders: &[&Path]) {
        self.folders = Search::new(self.what, folders).folders;
    }

    /// The file of a name in a text; where there is none, the place where it would be.
    pub fn find(&mut self, written: &[u8]) -> PathBuf {
        let written = written.trim_ascii();
        let texts = encodings::names(written);
        if let Some(path) = self.as_written(written, &texts) {
            return path;
        }
        let names: Vec<String> = (texts.iter().map(|text| plain(text)))
            .flat_map(|name| {
                let unescaped = String::from_utf8(encodings::unescaped(&name)).ok();
                let unescaped = unescaped.filter(|other| *other != name);
                [Some(name), unescaped].into_iter().flatten()
            })
            .collect();
        let likely = |name: &String| self.elsewhere(name).or_else(|| self.below(name));
        let found = names.iter().find_map(likely).or_else(|| {
            let others = names.iter().flat_map(|name| self.other_endings(name));
            let others: Vec<String> = others.collect();
            let likely = |name: &String| self.elsewhere(name).or_else(|| self.below(name));
            others.iter().find_map(likely)
        });
        if let Some(path) = found {
            self.n_elsewhere += 1;
            self.first.get_or_insert_with(|| (texts[0].clone(), path.clone()));
            return path;
        }
        let name = plain(&texts[0]).replace('\\', "/");
        let is_foreign = is_drive(&name) || name.starts_with("//");
        let name = if is_foreign { name.rsplit('/').next().unwrap_or_default() } else { &name };
        self.folders.first().map_or_else(|| PathBuf::from(name), |folder| folder.join(name))
    }

    /// The files of a line that is one name with blanks, or several names; what is there under its name comes first.
    pub fn find_all(&mut self, line: &[u8]) -> Vec<PathBuf> {
        let words = || line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty());
        let there = |name: &[u8]| {
            let name = name.trim_ascii();
            self.as_written(name, &encodings::names(name))
        };
        let exact = there(line).map(|whole| vec![whole]);
        if let Some(paths) = exact.or_else(|| words().map(there).collect()) {
            return paths;
        }
        let whole = self.find(line);
        if whole.is_file() { vec![whole] } else { words().map(|word| self.find(word)).collect() }
    }

    /// A name that a PLY header has, whose bytes may have been taken for Latin-1.
    pub fn find_text(&mut self, written: &str) -> PathBuf {
        let found = self.find(written.as_bytes());
        if written.is_ascii() || found.is_file() {
            return found;
        }
        let latin: Option<Vec<u8>> = written.chars().map(|c| u8::try_from(c).ok()).collect();
        latin.map(|bytes| self.find(&bytes)).filter(|path| path.is_file()).unwrap_or(found)
    }

    /// A line on what was taken, if that was not what is written.
    pub fn note(&self) -> Option<String> {
        let (name, path) = self.first.as_ref()?;
        let (what, path) = (self.what, path.display());
        let more = match self.n_elsewhere {
            1 => String::new(),
            n => format!(", and {} more likewise", n - 1),
        };
        Some(format!("{what} '{name}' is not there under this name: {path} is taken{more}"))
    }

    fn as_written(&self, written: &[u8], texts: &[String]) -> Option<PathBuf> {
        let exact = [OsStr::from_bytes(written).to_owned()].into_iter();
        let spelled = texts.iter().flat_map(|text| {
            let bare = plain(text);
            [text.replace('\\', "/"), text.clone(), bare.replace('\\', "/"), bare]
        });
        let names: Vec<OsString> = exact.chain(spelled.map(OsString::from)).collect();
        let is_name = |name: &&OsString| !name.is_empty() && !name.as_bytes().contains(&0);
        let mut places = names
            .iter()
            .filter(is_name)
            .flat_map(|name| self.folders.iter().map(move |folder| folder.join(name)));
        places.find(|path| path.is_file())
    }

    /// Looks for the end of a name, the longest first, exactly and then without regard to case.
    fn elsewhere(&mut self, name: &str) -> Option<PathBuf> {
        let forward = name.replace('\\', "/");
        let parts: Vec<&str> = forward
            .split('/')
            .filter(|part| !matches!(*part, "" | "." | "..") && !is_drive(part))
            .collect();
        let first = parts.len().saturating_sub(MAX_PARTS);
        let folders = self.folders.clone();
        for start in first..parts.len() {
            let end: PathBuf = parts[start..].iter().collect();
            let found = folders.iter().map(|folder| folder.join(&end)).find(|path| path.is_file());
            if found.is_some() {
                return found;
            }
        }
        for start in first..parts.len() {
            for folder in &folders {
                let mut place = Some(folder.clone());
                for part in &parts[start..] {
                    place = place.and_then(|folder| self.any_case(&folder, part));
                }
                if let Some(path) = place.filter(|path| path.is_file()) {
                    return Some(path);
                }
            }
        }
        None
    }

    /// The names that an image has as a file of another kind; none for libraries.
    fn other_endings(&self, name: &str) -> Vec<String> {
        let (stem, ending) = match name.rsplit_once('.') {
            Some((stem, ending)) if !stem.is_empty() && ending.len() <= 4 => (stem, ending),
            _ => (name, ""),
        };
        let others = ENDINGS.iter().filter(|other| !other.eq_ignore_ascii_case(ending));
        let is_image = self.what == "image" && !name.is_empty();
        others.filter(|_| is_image).map(|other| format!("{stem}.{other}")).collect()
    }

    /// The only file of this name in the folders below those of the search, and in folders of images beside them.
    fn below(&mut self, name: &str) -> Option<PathBuf> {
        let name = folded(name.rsplit(['/', '\\']).next()?);
        for folder in &self.folders {
            let files = self.below.entry(folder.clone()).or_insert_with(|| list_below(folder));
            let only = files.get(&name).filter(|found| found.n == 1 && found.path.is_file());
            if let Some(found) = only {
                return Some(found.path.clone());
            }
        }
        None
    }

    /// A file or folder of this name, in whatever case; the only tile of a set of tiles.
    fn any_case(&mut self, folder: &Path, name: &str) -> Option<PathBuf> {
        let listing = self.listings.entry(folder.to_path_buf()).or_insert_with(|| list(folder));
        let lower = folded(name);
        if let Some(own) = listing.get(&lower) {
            return Some(folder.join(own));
        }
        let parts = |(word, form): &(&str, &'static str)| Some((lower.split_once(word)?, *form));
        let ((before, behind), form) = UDIM.iter().find_map(parts)?;
        let is_tile = |name: &&String| {
            let number = name.strip_prefix(before).and_then(|rest| rest.strip_suffix(behind));
            let digits = |n: &str| n.replace(|c: char| c.is_ascii_digit(), "9");
            number.is_some_and(|n| digits(n) == form)
        };
        let mut tiles = listing.keys().filter(is_tile);
        match (tiles.next(), tiles.next()) {
            (Some(only), None) => Some(folder.join(&listing[only])),
            _ => None,
        }
    }
}

/// Returns whether a name stands for a set of tiles.
pub(super) fn is_set_of_tiles(path: &Path) -> bool {
    let name = path.to_string_lossy().to_lowercase();
    UDIM.iter().any(|(word, _)| name.contains(word))
}

/// Material libraries in a folder: that of the mesh's own name, or else the only one.
pub fn library_beside(mesh: &Path) -> Option<PathBuf> {
    let folder = stonecut_system::disk::folder_of(mesh);
    let names = list(folder);
    let stem = mesh.file_stem().unwrap_or_default().to_string_lossy().to_lowercase();
    if let Some(own) = names.get(&format!("{stem}.mtl")) {
        return Some(folder.join(own));
    }
    let mut libraries = names.iter().filter(|(lower, _)| lower.ends_with(".mtl"));
    match (libraries.next(), libraries.next()) {
        (Some((_, only)), None) => Some(folder.join(only)),
        _ => None,
    }
}

/// A name without quotes around it, or without the comment behind it.
pub fn plain(name: &str) -> String {
    let name = name.trim();
    for quote in ['"', '\''] {
        if let Some((inside, _)) = name.strip_prefix(quote).and_then(|rest| rest.split_once(quote))
        {
            return inside.trim().to_owned();
        }
    }
    let mut comment = name.match_indices('#').map(|(at, _)| at);
    let is_comment = |at: &usize| name[..*at].ends_with(char::is_whitespace);
    let end = comment.find(|at| is_comment(at)).unwrap_or(name.len());
    name[..end].trim().to_owned()
}

/// Returns whether a path begins with a drive of Windows.
fn is_drive(path: &str) -> bool {
    let bytes = path.as_bytes();
    bytes.len() >= 2
        && bytes[0].is_ascii_alphabetic()
        && bytes[1] == b':'
        && (bytes.len() == 2 || bytes[2] == b'/')
}

/// A name in lower case with every accent in one form: macOS parts letters from them.
pub fn folded(name: &str) -> String {
    name.to_lowercase().nfc().collect()
}

/// Files in the folders below, by their names as `folded` has them. Links to folders are not followed.
fn list_below(top: &Path) -> HashMap<String, Below> {
    let is_for_images = |name: &OsStr| {
        name.to_str().is_some_and(|name| IMAGE_FOLDERS.contains(&name.to_lowercase().as_str()))
    };
    let top = if top.as_os_str().is_empty() { Path::new(".") } else { top };
    let folders = |folder: &Path| -> Vec<PathBuf> {
        let entries = std::fs::read_dir(folder).into_iter().flatten().flatten().take(MAX_LISTED);
        let folders = entries.filter(|entry| entry.file_type().is_ok_and(|kind| kind.is_dir()));
        let names = folders.map(|entry| entry.file_name());
        let mut names: Vec<OsString> =
            names.filter(|name| !name.as_bytes().starts_with(b".")).collect();
        names.sort_unstable();
        names.iter().map(|name| folder.join(name)).collect()
    };
    let is_image_folder = |folder: &PathBuf| folder.file_name().is_some_and(is_for_images);
    let beside = folders(&top.join("..")).into_iter().filter(is_image_folder);
    let mut open: Vec<(PathBuf, usize)> =
        folders(top).into_iter().chain(beside).map(|folder| (folder, 1)).collect();
    let (mut out, mut at, mut n_files) = (HashMap::<String, Below>::new(), 0, 0);
    while at < open.len().min(MAX_FOLDERS) && n_files < MAX_LISTED {
        let (folder, depth) = open[at].clone();
        at += 1;
        let is_likely = is_image_folder(&folder);
        for (name, own) in list(&folder) {
            n_files += 1;
            let new = Below { path: folder.join(own), is_likely, n: 1 };
            match out.get_mut(&name) {
                Some(known) if known.is_likely && !is_likely => {}
                Some(known) if known.is_likely == is_likely => known.n += 1,
                _ => drop(out.insert(name, new)),
            }
        }
        if depth < MAX_DEPTH {
            open.extend(folders(&folder).into_iter().map(|folder| (folder, depth + 1)));
        }
    }
    out
}

/// Names in a folder as `folded` has them; the first of several in the order of their bytes.
fn list(folder: &Path) -> HashMap<String, OsString> {
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let Ok(entries) = std::fs::read_dir(folder) else { return HashMap::new() };
    let mut names: Vec<OsString> =
        entries.flatten().take(MAX_LISTED).map(|entry| entry.file_name()).collect();
    names.sort_unstable();
    let mut out = HashMap::new();
    for name in names {
        out.entry(folded(&encodings::name(name.as_bytes()))).or_insert(name);
    }
    out
}

/// The way from a folder to a file, both without links, with slashes.
pub fn relative(folder: &Path, file: &Path) -> String {
    let parts = |path: &Path| -> Vec<String> {
        let names = path.components().filter(|part| matches!(part, Component::Normal(_)));
        names.map(|part| part.as_os_str().to_string_lossy().into_owned()).collect()
    };
    let (from, to) = (parts(folder), parts(file));
    let same = from.iter().zip(&to).take_while(|(a, b)| a == b).count();
    let up = std::iter::repeat_n("..".to_owned(), from.len() - same);
    up.chain(to[same..].iter().cloned()).collect::<Vec<_>>().join("/")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_stripped_of_what_is_not_theirs() {
        for (written, name) in [
            ("a b.png", "a b.png"),
            ("\"a b.png\"", "a b.png"),
            ("'a.png' # the wall", "a.png"),
            ("a.png # the wall", "a.png"),
            ("wall#1.png", "wall#1.png"),
        ] {
            assert_eq!(plain(written), name);
        }
    }

    #[test]
    fn files_of_other_machines_are_found_by_their_names() {
        let dir = tempfile::tempdir().unwrap();
        let folder = dir.path();
        for name in ["Maps", "Textures", "a/b", "c"] {
            std::fs::create_dir_all(folder.join(name)).unwrap();
        }
        for name in [
            "cafe\u{301}.png",
            "Textures/roof.jpg",
            "c/roof.jpg",
            "a/b/floor.png",
            "c/door.png",
            "a/door.png",
            "stone.PNG",
            "tex.png",
            "a b.png",
            "\u{6728}.png",
            "Maps/Wall.JPG",
            "stra\u{df}e.png",
            "\u{7eb9}\u{7406}.png",
            "u.1001.png",
            "w_u1_v1.png",
        ] {
            std::fs::write(folder.join(name), "x").unwrap();
        }
        let mut search = Search::new("image", &[folder]);
        for (written, name) in [
            (&b"tex.png"[..], "tex.png"),
            (b"C:\\Users\\me\\scan\\tex.png", "tex.png"),
            (b"/home/me/tex.png", "tex.png"),
            (b"TEX.PNG", "tex.png"),
            (b"\"tex.png\"", "tex.png"),
            (b"tex.png # the wall", "tex.png"),
            (b"D:\\x\\maps\\wall.jpg", "Maps/Wall.JPG"),
            (b"stra\xdfe.png", "stra\u{df}e.png"),
            (b"\xce\xc6\xc0\xed.png", "\u{7eb9}\u{7406}.png"),
            (b"a%20b.png", "a b.png"),
            (b"\x96\xd8.png", "\u{6728}.png"),
            (b"u.<UDIM>.png", "u.1001.png"),
            (b"u.%(UDIM)d.png", "u.1001.png"),
            (b"w_<UVTILE>.png", "w_u1_v1.png"),
            ("caf\u{e9}.png".as_bytes(), "cafe\u{301}.png"),
            (b"roof.jpg", "Textures/roof.jpg"),
            (b"D:\\x\\floor.png", "a/b/floor.png"),
            (b"stone.jpg", "stone.PNG"),
            (b"floor.tif", "a/b/floor.png"),
            // Which of two is meant is not known.
            (b"door.png", "door.png"),
        ] {
            assert_eq!(search.find(written), folder.join(name), "{}", written.escape_ascii());
        }
        assert_eq!(search.find(b"C:\\a\\none.png"), folder.join("none.png"));
        let note = search.note().unwrap();
        assert!(note.contains("scan\\tex.png") && note.contains("more likewise"), "{note}");
        assert_eq!(search.find_text("stra\u{df}e.png"), folder.join("stra\u{df}e.png"));
        assert_eq!(
            search.find_text("\u{ce}\u{c6}\u{c0}\u{ed}.png"),
            folder.join("\u{7eb9}\u{7406}.png")
        );
    }
}
