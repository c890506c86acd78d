//! Whole folders: made durable, renamed, replaced, removed.

use super::Disk;
use super::Effect::Change;
use crate::error::{Error, Result};
use std::fs::File;
use std::path::Path;

impl Disk {
    /// Makes everything in a folder and below durable, and with it all that its file system holds.
    pub fn sync_all_below(&self, folder: &Path) -> Result<()> {
        self.operation(folder, "cannot sync", Change)?;
        let outcome = File::open(folder).and_then(|folder| Ok(rustix::fs::syncfs(&folder)?));
        outcome.map_err(|e| Error::io(folder, "cannot sync", e))?;
        self.follow(|losses| losses.all_synced());
        Ok(())
    }

    /// Gives a folder the name of another one, which is removed if it is there.
    pub fn replace_folder(&self, from: &Path, to: &Path) -> Result<()> {
        use rustix::fs::{CWD, RenameFlags, renameat_with};
        self.operation(to, "cannot rename to", Change)?;
        // Where folders cannot be exchanged there is a moment without either.
        if to.exists() && renameat_with(CWD, from, CWD, to, RenameFlags::EXCHANGE).is_err() {
            std::fs::remove_dir_all(to).map_err(|e| Error::io(to, "cannot replace", e))?;
        }
        if to.exists() {
            std::fs::remove_dir_all(from).map_err(|e| Error::io(from, "cannot remove", e))?;
        } else {
            std::fs::rename(from, to).map_err(|e| Error::io(to, "cannot rename to", e))?;
        }
        self.follow(|losses| losses.folder_renamed(from, to));
        self.sync_folder_of(to)
    }

    /// Removes an empty folder; one that is not empty (any more) stays.
    pub fn remove_dir(&self, path: &Path) -> Result<()> {
        self.operation(path, "cannot remove folder", Change)?;
        match std::fs::remove_dir(path) {
            Err(e) if e.kind() == std::io::ErrorKind::DirectoryNotEmpty => Ok(()),
            outcome => outcome.map_err(|e| Error::io(path, "cannot remove folder", e)),
        }
    }
}
