//! Folders of ours: made for us alone, told from those of others, and removed name by name.
//!
//! Nothing is removed that its caller does not name, and no link is followed below such a folder. Which names are
//! ours is decided by those who write them.

use super::Effect::Change;
use super::{Disk, folder_of, kind_of, scratch_file};
use crate::error::{Error, Result};
use std::os::unix::fs::{DirBuilderExt, MetadataExt};
use std::path::{Path, PathBuf};

/// Answers whether a path below a folder is ours; the path is relative to it, and true stands for a folder.
pub type IsOurs<'a> = &'a dyn Fn(&Path, bool) -> bool;

/// The order in which files of a folder go: those of rank 0 first.
pub type Rank<'a> = &'a dyn Fn(&Path) -> u8;

impl Disk {
    /// Makes a folder that only we can enter, and its parents; true if it was not there. One that is there must be ours.
    pub fn own_dir(&self, path: &Path) -> Result<bool> {
        let parent = folder_of(path);
        if !parent.is_dir() {
            self.create_dir(parent)?;
        }
        self.operation(path, "cannot create folder", Change)?;
        match std::fs::DirBuilder::new().mode(0o700).create(path) {
            Ok(()) => Ok(true),
            Err(e) if e.kind() == std::io::ErrorKind::AlreadyExists => {
                check_own(path).map(|()| false)
            }
            Err(e) => Err(Error::io(path, "cannot create folder", e)),
        }
    }

    /// Renames a file within one folder unless the new name is taken, and makes the name durable; `false` if it is.
    pub fn rename_new(&self, from: &Path, to: &Path) -> Result<bool> {
        self.operation(to, "cannot rename to", Change)?;
        self.follow(|losses| losses.meet(from));
        if !rename_new(from, to).map_err(|e| Error::io(to, "cannot rename to", e))? {
            return Ok(false);
        }
        self.follow(|losses| losses.renamed(from, to));
        self.sync_folder_of(to)?;
        Ok(true)
    }

    /// Removes a folder and what is ours in it; files of a higher `rank` go after others.
    ///
    /// Errors: `Usage` naming what is not ours; nothing is removed then.
    pub fn remove_own(&self, folder: &Path, is_ours: IsOurs, rank: Rank) -> Result<()> {
        self.clear_own(folder, is_ours, rank)?;
        self.operation(folder, "cannot remove folder", Change)?;
        match std::fs::remove_dir(folder) {
            Err(e) if e.kind() != std::io::ErrorKind::NotFound => {
                Err(Error::io(folder, "cannot remove folder", e))
            }
            _ => Ok(()),
        }
    }

    /// Removes what is ours in a folder, but not the folder.
    pub fn clear_own(&self, folder: &Path, is_ours: IsOurs, rank: Rank) -> Result<()> {
        let (mut files, folders) = match list(folder, is_ours)? {
            Found::Ours(files, folders) => (files, folders),
            Found::Foreign(name) => return Err(foreign(folder, &name)),
        };
        files.sort_by_key(|path| rank(path));
        for path in &files {
            self.remove(&folder.join(path))?;
        }
        // Those below others come first.
        for path in folders.iter().rev() {
            self.remove_dir(&folder.join(path))?;
        }
        Ok(())
    }
}

/// The error for a folder that holds something of others.
fn foreign(folder: &Path, name: &Path) -> Error {
    Error::Usage(format!(
        "{} holds {}, which stonecut has not written; move it elsewhere, or give another name",
        folder.display(),
        name.display()
    ))
}

/// Entries below a folder, relative to it; folders before what they hold.
enum Found {
    Ours(Vec<PathBuf>, Vec<PathBuf>),
    Foreign(PathBuf),
}

fn list(folder: &Path, is_ours: IsOurs) -> Result<Found> {
    let (mut files, mut folders) = (Vec::new(), Vec::new());
    let mut open = vec![PathBuf::new()];
    while let Some(below) = open.pop() {
        let here = folder.join(&below);
        let failed = |e| Error::reading(&here, "cannot list", e);
        for entry in std::fs::read_dir(&here).map_err(failed)? {
            let entry = entry.map_err(failed)?;
            let kind = entry.file_type().map_err(failed)?;
            let path = below.join(entry.file_name());
            if !(kind.is_dir() || kind.is_file()) || !is_ours(&path, kind.is_dir()) {
                return Ok(Found::Foreign(path));
            }
            if kind.is_dir() {
                folders.push(path.clone());
                open.push(path);
            } else {
                files.push(path);
            }
        }
    }
    Ok(Found::Ours(files, folders))
}

/// Refuses a folder that holds anything that is not ours, and names it.
pub fn foreign_below(folder: &Path, is_ours: IsOurs) -> Result<()> {
    match list(folder, is_ours)? {
        Found::Ours(..) => Ok(()),
        Found::Foreign(name) => Err(foreign(folder, &name)),
    }
}

/// True for a folder without entries.
pub fn is_empty(folder: &Path) -> bool {
    std::fs::read_dir(folder).is_ok_and(|mut entries| entries.next().is_none())
}

/// Refuses what is not a folder, what a link leads to, and a folder of another user: what lies there may be a trap.
pub fn check_own(path: &Path) -> Result<()> {
    let refused = |what: String| {
        Err(Error::Usage(format!("{}: {what}; remove it, or give another place", path.display())))
    };
    let meta =
        std::fs::symlink_metadata(path).map_err(|e| Error::reading(path, "cannot stat", e))?;
    if !meta.is_dir() {
        let kind = kind_of(meta.file_type());
        return refused(format!("this is {kind}, where a folder of this run is to be"));
    }
    if meta.uid() == rustix::process::geteuid().as_raw() {
        return Ok(());
    }
    // Some file systems give files another owner than the one who makes them: what we make there has it, too.
    let made = scratch_file(path).and_then(|file| file.metadata());
    match made {
        Ok(made) if made.uid() == meta.uid() => Ok(()),
        _ => refused(format!(
            "this folder belongs to user {}, not to the user of this run",
            meta.uid()
        )),
    }
}

/// Renames unless the new name is taken; `false` if it is.
fn rename_new(from: &Path, to: &Path) -> std::io::Result<bool> {
    use rustix::fs::{CWD, RenameFlags, renameat_with};
    use rustix::io::Errno;
    match renameat_with(CWD, from, CWD, to, RenameFlags::NOREPLACE) {
        Ok(()) => return Ok(true),
        Err(Errno::EXIST) => return Ok(false),
        Err(Errno::INVAL | Errno::NOSYS | Errno::NOTSUP) => {}
        Err(e) => return Err(e.into()),
    }
    // File systems that cannot do that: a link is never made over a file.
    match std::fs::hard_link(from, to) {
        Ok(()) => std::fs::remove_file(from).map(|()| true),
        Err(e) if e.kind() == std::io::ErrorKind::AlreadyExists => Ok(false),
        // Without links either, a moment is left between the look and the rename.
        Err(_) if std::fs::symlink_metadata(to).is_ok() => Ok(false),
        Err(_) => std::fs::rename(from, to).map(|()| true),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_is_named_is_removed() {
        let place = tempfile::tempdir().unwrap();
        let disk = Disk::default();
        let folder = place.path().join("ours");
        assert!(disk.own_dir(&folder).unwrap() && !disk.own_dir(&folder).unwrap());
        assert_eq!(std::fs::metadata(&folder).unwrap().mode() & 0o777, 0o700);
        let is_ours = |path: &Path, is_dir: bool| is_dir || path.ends_with("a");
        std::fs::create_dir(folder.join("sub")).unwrap();
        std::fs::write(folder.join("sub/a"), "a").unwrap();
        std::fs::write(folder.join("b"), "b").unwrap();
        let error = disk.remove_own(&folder, &is_ours, &|_| 0).unwrap_err();
        assert!(error.exit_code() == 2 && error.to_string().contains("holds b"), "{error}");
        assert!(folder.join("sub/a").exists());
        std::fs::remove_file(folder.join("b")).unwrap();
        std::os::unix::fs::symlink("sub", folder.join("link")).unwrap();
        assert!(foreign_below(&folder, &is_ours).is_err(), "links are not ours");
        std::fs::remove_file(folder.join("link")).unwrap();
        disk.remove_own(&folder, &is_ours, &|_| 0).unwrap();
        assert!(!folder.exists());
    }

    #[test]
    fn links_and_files_are_not_folders_of_ours() {
        let place = tempfile::tempdir().unwrap();
        std::fs::create_dir(place.path().join("real")).unwrap();
        std::os::unix::fs::symlink("real", place.path().join("link")).unwrap();
        let error = Disk::default().own_dir(&place.path().join("link")).unwrap_err();
        assert!(error.exit_code() == 2 && error.to_string().contains("symbolic link"), "{error}");
    }

    #[test]
    fn a_name_that_is_taken_stays() {
        let place = tempfile::tempdir().unwrap();
        let path = |name: &str| place.path().join(name);
        std::fs::write(path("a"), "a").unwrap();
        std::fs::write(path("b"), "b").unwrap();
        assert!(!rename_new(&path("a"), &path("b")).unwrap());
        assert!(rename_new(&path("a"), &path("c")).unwrap());
        assert_eq!(std::fs::read(path("b")).unwrap(), b"b");
        assert_eq!(std::fs::read(path("c")).unwrap(), b"a");
    }
}
