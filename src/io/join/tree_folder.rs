//! The folder of a tree of tiles: addresses in its files become files in it, and what was found is kept.

use super::InputSet;
use super::contents::{TileFrame, add_content};
use super::limits::{PART_BYTES, hold};
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use stonecut_system::error::{Error, Result};

/// Files besides the meshes that are read, however often each.
const MOST_FILES: usize = 1 << 17;
/// Meshes of a tree at most.
const MOST_PARTS: usize = 1 << 21;

/// Bytes of a mesh of a tree before it is opened, with its place among those that are known.
const TREE_PART_BYTES: u64 = PART_BYTES + 256;

/// A folder that all files of a tree lie in, and what the tree has as far as it was walked.
pub(super) struct TreeFolder {
    home: PathBuf,
    /// Memory for the meshes that are found.
    limit: u64,
    /// Contents with the frames of their tiles, and whether they were meshes: each counts once.
    known: HashMap<(PathBuf, [u64; 16], u8), bool>,
    pub(super) set: InputSet,
}

impl TreeFolder {
    /// The folder of the first file of a tree.
    pub(super) fn of(path: &Path, limit: u64) -> Result<TreeFolder> {
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
        let folder = folder.unwrap_or(Path::new("."));
        let home = folder.canonicalize().map_err(|e| Error::reading(folder, "cannot read", e))?;
        Ok(TreeFolder { home, limit, known: HashMap::new(), set: InputSet::default() })
    }

    /// Adds a mesh; returns whether it was one.
    pub(super) fn content(&mut self, path: &Path, at: &TileFrame) -> Result<bool> {
        if self.set.parts.len() >= MOST_PARTS {
            let what = format!("more than {MOST_PARTS} meshes in a tree; give a part of it");
            return Err(Error::bad_input(path, what));
        }
        let n_known = (self.known.len() + self.set.repeated.len()) as u64;
        let what = "the list of the meshes of this tree of tiles";
        hold(path, what, TREE_PART_BYTES * n_known, self.limit)?;
        let key = (path.to_path_buf(), at.map.map(f64::to_bits), at.up as u8);
        if let Some(&is_mesh) = self.known.get(&key) {
            self.set.repeated.push(key.0);
            return Ok(is_mesh);
        }
        let is_mesh = add_content(path, at, &mut self.set)?;
        self.known.insert(key, is_mesh);
        Ok(is_mesh)
    }

    /// The file that an address in `file` leads to. Refuses what lies outside of the tree's folder or is not there.
    pub(super) fn resolve(&self, file: &Path, address: &str) -> Result<PathBuf> {
        let shown: String = address.chars().take(200).collect();
        let bad =
            |what: &str| Error::bad_input(file, format!("'{}': {what}", shown.escape_default()));
        const FETCH: &str = "lies outside of the folder of the tree, which is not read; fetch the tree whole, with relative names";
        let end = address.find(['?', '#']).unwrap_or(address.len());
        let name = unescaped(&address[..end]).ok_or_else(|| bad("is not a name of a file"))?;
        let is_scheme = name.find(':').is_some_and(|at| at > 1 && !name[..at].contains('/'));
        if is_scheme || name.starts_with(['/', '\\']) || name.contains('\0') {
            return Err(bad(FETCH));
        }
        let folder = file.parent().unwrap_or(Path::new(""));
        let path = folder.join(&name);
        let real = match path.canonicalize() {
            Ok(real) => real,
            // Outside or not there: the words of the first do for an address that climbs.
            Err(_) if name.split('/').any(|step| step == "..") => return Err(bad(FETCH)),
            Err(e) => return Err(bad(&format!("cannot be read ({e}); fetch the tree whole"))),
        };
        if !real.starts_with(&self.home) {
            return Err(bad(FETCH));
        }
        // Names without steps back, so that a file is known by one name.
        let mut plain = PathBuf::new();
        for step in path.components() {
            match step {
                std::path::Component::ParentDir
                    if plain.file_name().is_some_and(|name| name != "..") =>
                {
                    plain.pop();
                }
                std::path::Component::CurDir => {}
                step => plain.push(step),
            }
        }
        Ok(plain)
    }

    /// Counts a file besides the meshes that is read.
    pub(super) fn note_file(&mut self, path: &Path) -> Result<()> {
        if self.set.found_in.len() >= MOST_FILES {
            let what =
                format!("trees of more than {MOST_FILES} files are not read; give a part of it");
            return Err(Error::bad_input(path, what));
        }
        self.set.found_in.push(path.to_path_buf());
        Ok(())
    }
}

/// A name with its escapes (`%20`) resolved.
fn unescaped(text: &str) -> Option<String> {
    let mut out = Vec::with_capacity(text.len());
    let mut bytes = text.bytes();
    while let Some(byte) = bytes.next() {
        if byte != b'%' {
            out.push(byte);
            continue;
        }
        let digits = [bytes.next()?, bytes.next()?];
        let digits = std::str::from_utf8(&digits).ok()?;
        out.push(u8::from_str_radix(digits, 16).ok()?);
    }
    String::from_utf8(out).ok().filter(|name| !name.is_empty())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn escapes_are_resolved() {
        assert_eq!(unescaped("a%20b/c.glb").as_deref(), Some("a b/c.glb"));
        assert_eq!(unescaped("a%2"), None);
        assert_eq!(unescaped("a%zz"), None);
    }
}
