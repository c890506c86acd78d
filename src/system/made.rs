//! Files that belong together: those that are new go again unless all of them are whole.
//!
//! For pictures of one command, and for what stands beside an output. A file that was there before is never removed.

use crate::disk::{Disk, folder_of};
use crate::error::Result;
use crate::pending_file::Seen;
use std::path::{Path, PathBuf};

/// New files and folders; removed when dropped before `keep`.
#[derive(Debug)]
pub struct Made {
    disk: Disk,
    files: Vec<Seen>,
    folders: Vec<PathBuf>,
}

impl Made {
    /// Nothing yet.
    pub fn new(disk: &Disk) -> Made {
        Made { disk: disk.clone(), files: Vec::new(), folders: Vec::new() }
    }

    /// Makes a folder and those above it where they are missing.
    pub fn folder(&mut self, path: &Path) -> Result<()> {
        let is_missing = |path: &&Path| std::fs::symlink_metadata(path).is_err();
        let mut missing: Vec<PathBuf> = Vec::new();
        let mut next = Some(path);
        while let Some(path) = next.filter(is_missing) {
            missing.push(path.to_path_buf());
            next = Some(folder_of(path)).filter(|above| *above != path);
        }
        if missing.is_empty() && path.is_dir() {
            return Ok(());
        }
        self.disk.create_dir(path)?;
        // Those below come first when they go.
        self.folders.splice(0..0, missing);
        Ok(())
    }

    /// Writes a file by `write`, and notes it if there was none of its name.
    pub fn file(&mut self, path: &Path, write: impl FnOnce() -> Result<()>) -> Result<()> {
        let is_new = std::fs::symlink_metadata(path).is_err();
        write()?;
        if is_new {
            self.files.push(Seen::new(path));
        }
        Ok(())
    }

    /// All are whole: they stay.
    pub fn keep(mut self) {
        self.files.clear();
        self.folders.clear();
    }
}

impl Drop for Made {
    fn drop(&mut self) {
        // What cannot be removed only wastes space.
        for file in self.files.iter().filter(|file| file.is_unchanged()) {
            let _ = self.disk.remove(file.path());
        }
        self.folders.iter().for_each(|folder| drop(self.disk.remove_dir(folder)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn new_files_go_again_and_others_stay() {
        let place = tempfile::tempdir().unwrap();
        let folder = place.path().join("a/b");
        let write = |made: &mut Made, name: &str| {
            let path = folder.join(name);
            made.file(&path, || {
                std::fs::write(&path, "new").unwrap();
                Ok(())
            })
            .unwrap();
        };
        let mut made = Made::new(&Disk::default());
        made.folder(&folder).unwrap();
        write(&mut made, "x");
        drop(made);
        assert!(!place.path().join("a").exists());
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::write(folder.join("x"), "old").unwrap();
        let mut made = Made::new(&Disk::default());
        made.folder(&folder).unwrap();
        ["x", "y"].iter().for_each(|name| write(&mut made, name));
        drop(made);
        assert!(folder.join("x").exists() && !folder.join("y").exists());
        let mut made = Made::new(&Disk::default());
        write(&mut made, "y");
        made.keep();
        assert!(folder.join("y").exists());
    }
}
