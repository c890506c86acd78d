//! The files of a tree of tiles, as the tree itself lists them: the only ones in its folder that may be removed with it.
//!
//! A path is listed by the JSON of the tree, and the file there has the mark of its kind. Everything else in the folder
//! belongs to somebody else. Removes nothing itself.

use super::borders::{MAGIC, border_path};
use super::read::{Tile, read_tileset, resolve};
use super::write::FILE_NAME;
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::io::Read;
use std::path::{Path, PathBuf};
use stonecut_system::disk::read_own;
use stonecut_system::error::{Error, Result};
use xxhash_rust::xxh3::xxh3_64;

/// No JSON of a tree and no file of its page comes near this.
pub const MOST_FILE_BYTES: u64 = 4 << 20;

/// Memory that a tile of others may take, its file included, where `threads` are reading; those that are written take some
/// MiB, and as much again with a large page.
pub fn most_tile_bytes(memory_bytes: u64, threads: usize) -> u64 {
    (memory_bytes / 4 / threads.max(1) as u64).max(16 << 20)
}

/// Key of the checksums of the page, by name, among the facts of a tree.
pub const OWN_PAGES: &str = "viewer";

/// Length of the beginning of a tile that is searched for its mark.
const HEAD_BYTES: u64 = 64 << 10;

/// Deepest nesting of tiles and files that is followed.
const DEEPEST: usize = 64;

#[derive(Clone, Copy, Debug)]
enum Kind {
    Json,
    Tile,
    Borders,
    /// With the checksum of its bytes.
    Page(u64),
}

/// The files of a tree, by their paths in its folder.
#[derive(Debug)]
pub struct TreeFiles {
    folder: PathBuf,
    files: BTreeMap<String, Kind>,
    /// Folders of these.
    folders: BTreeSet<PathBuf>,
}

impl TreeFiles {
    /// Lists the files of the tree in a folder. `pages` are those of this build, for trees that do not list theirs.
    ///
    /// Errors: `Usage` for a folder that is not a tree of this program.
    pub fn read(folder: &Path, pages: &[(&str, &[u8])]) -> Result<TreeFiles> {
        let foreign = || {
            Error::Usage(format!(
                "{} is not a tree of tiles that stonecut has written; remove it yourself, or give another name",
                folder.display()
            ))
        };
        let text = read_own(&folder.join(FILE_NAME), MOST_FILE_BYTES).map_err(|_| foreign())?;
        let set = read_tileset(&text).map_err(|_| foreign())?;
        if !set.asset.generator.starts_with("stonecut") {
            return Err(foreign());
        }
        let mut found =
            TreeFiles { folder: folder.into(), files: BTreeMap::new(), folders: BTreeSet::new() };
        found.files.insert(FILE_NAME.to_owned(), Kind::Json);
        found.tile(FILE_NAME, &set.root, 0);
        let own = &set.extras["stonecut"][OWN_PAGES];
        for (name, bytes) in pages {
            let listed = own[*name].as_str().and_then(|sum| u64::from_str_radix(sum, 16).ok());
            found.files.insert((*name).to_owned(), Kind::Page(listed.unwrap_or(xxh3_64(bytes))));
        }
        for path in found.files.keys() {
            let above = Path::new(path).ancestors().skip(1);
            found.folders.extend(above.map(Path::to_path_buf));
        }
        Ok(found)
    }

    /// The checksums of a page, as a tree lists them.
    pub fn page_list(pages: &[(&str, &[u8])]) -> Value {
        let sum = |(name, bytes): &(&str, &[u8])| {
            ((*name).to_owned(), format!("{:016x}", xxh3_64(bytes)).into())
        };
        Value::Object(pages.iter().map(sum).collect())
    }

    fn tile(&mut self, file: &str, tile: &Tile, depth: usize) {
        let name = tile.content.as_ref().and_then(|content| resolve(file, &content.uri));
        match name {
            Some(name) if name.ends_with(".json") => {
                // A file that is gone, or that is not of a tree, lists nothing.
                let is_new = self.files.insert(name.clone(), Kind::Json).is_none();
                let text = read_own(&self.folder.join(&name), MOST_FILE_BYTES);
                if let (true, true, Ok(text)) = (is_new, depth < DEEPEST, text)
                    && let Ok(set) = read_tileset(&text)
                {
                    self.tile(&name, &set.root, depth + 1);
                }
            }
            Some(name) => {
                if let Some((borders, _)) = border_path(&name) {
                    self.files.insert(borders, Kind::Borders);
                }
                self.files.insert(name, Kind::Tile);
            }
            None => {}
        }
        if depth < DEEPEST {
            tile.children.iter().for_each(|child| self.tile(file, child, depth + 1));
        }
    }

    /// Returns whether a path in the folder is a file of the tree, or a folder of such files.
    pub fn is_ours(&self, path: &Path, is_folder: bool) -> bool {
        if is_folder {
            return self.folders.contains(path);
        }
        let kind = path.to_str().and_then(|name| self.files.get(name));
        kind.is_some_and(|kind| kind.marks(&self.folder.join(path)).unwrap_or(false))
    }

    /// The order in which files go: those that list others after them, so that a removal that was stopped is taken up.
    pub fn rank(path: &Path) -> u8 {
        match path.to_str() {
            Some(FILE_NAME) => 2,
            Some(name) if name.ends_with(".json") => 1,
            _ => 0,
        }
    }
}

impl Kind {
    /// Returns whether a file has the mark of its kind.
    fn marks(self, path: &Path) -> std::io::Result<bool> {
        let head = |n: u64| -> std::io::Result<Vec<u8>> {
            let mut head = Vec::new();
            std::fs::File::open(path)?.take(n).read_to_end(&mut head)?;
            Ok(head)
        };
        const GENERATOR: &[u8] = b"\"generator\":\"stonecut ";
        Ok(match self {
            Kind::Json => read_tileset(&read_own(path, MOST_FILE_BYTES)?)
                .is_ok_and(|set| set.asset.generator.starts_with("stonecut")),
            Kind::Tile => {
                let head = head(HEAD_BYTES)?;
                head.starts_with(b"glTF")
                    && head.windows(GENERATOR.len()).any(|words| words == GENERATOR)
            }
            Kind::Borders => head(MAGIC.len() as u64)? == MAGIC,
            Kind::Page(checksum) => xxh3_64(&read_own(path, MOST_FILE_BYTES)?) == checksum,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_is_listed_and_marked_belongs_to_a_tree() {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str, bytes: &[u8]| {
            let path = folder.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, bytes).unwrap();
        };
        let tile = |uri: &str| {
            format!(r#"{{"boundingVolume":{{}},"geometricError":1,"content":{{"uri":"{uri}"}}}}"#)
        };
        let set = |root: String| {
            format!(
                r#"{{"asset":{{"version":"1.1","generator":"stonecut 1"}},"geometricError":1,"root":{root}}}"#
            )
        };
        write(FILE_NAME, set(tile("sets/0/0.json")).as_bytes());
        write("sets/0/0.json", set(tile("../../tiles/0/0/0-0.glb")).as_bytes());
        write("tiles/0/0/0-0.glb", b"glTF....{\"asset\":{\"generator\":\"stonecut 1\"}}");
        write("tiles/0/0/0.ids", b"stcids 1...");
        write("index.html", b"page");
        let read = || TreeFiles::read(folder.path(), &[("index.html", b"page")]).unwrap();
        let is_ours = |name: &str| read().is_ours(Path::new(name), name.ends_with("/0"));
        for name in
            [FILE_NAME, "sets/0/0.json", "tiles/0/0/0-0.glb", "tiles/0/0/0.ids", "index.html"]
        {
            assert!(is_ours(name), "{name}");
        }
        assert!(is_ours("tiles/0/0") && !is_ours("other/0"));
        write("index.html", b"mine");
        write("tiles/0/0/0-0.glb", b"mine");
        write("tiles/0/0/0-1.glb", b"glTF....{\"asset\":{\"generator\":\"stonecut 1\"}}");
        for name in ["index.html", "tiles/0/0/0-0.glb", "tiles/0/0/0-1.glb", "notes"] {
            assert!(!is_ours(name), "{name}");
        }
        write(FILE_NAME, b"{}");
        assert_eq!(TreeFiles::read(folder.path(), &[]).unwrap_err().exit_code(), 2);
    }
}
