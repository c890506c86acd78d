//! The folder that a tree grows in before it has its name, and the mark that binds it to its job.

use super::viewer;
use crate::error::{Error, Result};
use crate::io::tileset::{FILE_NAME, MOST_FILE_BYTES, TreeFiles};
use crate::store::job::{Job, hold};
use crate::system::disk::{Disk, check_own, foreign_below, read_own};
use crate::system::pending_file::{Place, write_whole};
use std::fs::{DirEntry, File};
use std::path::Path;
use std::time::{SystemTime, UNIX_EPOCH};
use xxhash_rust::xxh3::xxh3_64;

/// Folder of the shapes of tiles that get pages, in that of the tree.
pub(super) const SHAPES: &str = "shapes";

/// Recorded with the mark before anything is written into the folder.
const BEGUN: &str = "tiles begun";

/// Name of the file that holds the mark.
const MARK: &str = ".stonecut-job";

/// Length of the mark, with room for doubt.
const MOST_MARK_BYTES: u64 = 64;

/// Opens the folder of the job's tree, or begins one, and holds it against other runs while the outcome lives.
///
/// `named`: the checksum of the tree if it may have had its last change already. Fails with `StateMismatch` where finished tiles are gone with their
/// folder, or where it is that of another run.
pub(super) fn open(job: &Job, folder: &Path, disk: &Disk, named: Option<u64>) -> Result<File> {
    let Some(mark) = job.outcome::<String>(BEGUN)? else { return begin(job, folder, disk) };
    let gone = |what: &str| Error::StateMismatch {
        path: folder.into(),
        what: format!(
            "{what}; run again with --restart, or bring back the folder that this job has written"
        ),
    };
    if !folder.exists() {
        return Err(gone("the folder of the tiles that are done is gone"));
    }
    let held = hold(folder)?;
    match read_own(&folder.join(MARK), MOST_MARK_BYTES) {
        Ok(found) if found == mark.as_bytes() => Ok(held),
        // The tree is whole, and has lost its mark already.
        Err(_) if named.is_some() && checksum(folder) == named => Ok(held),
        _ => Err(gone("this folder holds the tiles of another run")),
    }
}

fn begin(job: &Job, folder: &Path, disk: &Disk) -> Result<File> {
    if std::fs::symlink_metadata(folder).is_ok() {
        check_own(folder)?;
        // Of another job, or of one that was thrown away.
        let held = hold(folder)?;
        remove(folder, disk)?;
        drop(held);
    }
    disk.create_dir(folder)?;
    let held = hold(folder)?;
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    let seed = format!("{} {} {}", job.folder().display(), std::process::id(), since.as_nanos());
    let mark = format!("{:016x}", xxh3_64(seed.as_bytes()));
    let path = folder.join(MARK);
    write_whole(Place { path, disk: disk.clone(), replace: true }, mark.as_bytes())?;
    disk.sync_folder_of(folder)?;
    job.record(BEGUN, &mark)?;
    Ok(held)
}

/// Takes the mark out of a tree that is whole.
pub(super) fn finish(folder: &Path, disk: &Disk) -> Result<()> {
    disk.remove(&folder.join(MARK))
}

/// Removes a folder that a tree has grown in, or an earlier tree that took its name; nothing happens if there is none.
///
/// Errors: `Usage` for a folder that holds anything else; nothing is removed then.
pub(super) fn remove(folder: &Path, disk: &Disk) -> Result<()> {
    if std::fs::symlink_metadata(folder).is_err() {
        return Ok(());
    }
    check_own(folder)?;
    let is_mark = |bytes: Vec<u8>| bytes.len() == 16 && bytes.iter().all(u8::is_ascii_hexdigit);
    if has_marks_alone(folder) || read_own(&folder.join(MARK), MOST_MARK_BYTES).is_ok_and(is_mark) {
        // The mark goes last: without it nothing here would be ours.
        return disk.remove_own(folder, &is_name, &|path| u8::from(path == Path::new(MARK)));
    }
    remove_tree(folder, disk)
}

/// Returns whether a folder has nothing but a mark under a hidden name, if that: a run that ended as it began leaves it.
fn has_marks_alone(folder: &Path) -> bool {
    let is_hidden = |entry: std::io::Result<DirEntry>| {
        entry.is_ok_and(|entry| entry.file_name().to_str().is_some_and(is_hidden_mark))
    };
    std::fs::read_dir(folder).is_ok_and(|mut entries| entries.all(is_hidden))
}

/// The mark has a hidden name for a moment where files cannot be without one.
fn is_hidden_mark(name: &str) -> bool {
    name.starts_with("..stonecut-job.") && name.ends_with(".tmp")
}

/// Removes the part of the folder that a step which is over has left.
pub(super) fn remove_shapes(folder: &Path, disk: &Disk) -> Result<()> {
    let is_shape = |path: &Path, is_folder: bool| is_name(&Path::new(SHAPES).join(path), is_folder);
    disk.remove_own(&folder.join(SHAPES), &is_shape, &|_| 0)
}

/// The checksum of the first file of a tree.
pub(super) fn checksum(folder: &Path) -> Option<u64> {
    read_own(&folder.join(FILE_NAME), MOST_FILE_BYTES).ok().map(|text| xxh3_64(&text))
}

/// Refuses a folder that is not a whole tree of this program and nothing else.
pub(super) fn check_tree(folder: &Path) -> Result<()> {
    let files = TreeFiles::read(folder, &viewer::FILES)?;
    foreign_below(folder, &|path, is_folder| files.is_ours(path, is_folder))
}

/// Removes a tree, its lists last.
pub(super) fn remove_tree(folder: &Path, disk: &Disk) -> Result<()> {
    let files = TreeFiles::read(folder, &viewer::FILES)?;
    disk.remove_own(folder, &|path, is_folder| files.is_ours(path, is_folder), &TreeFiles::rank)
}

/// Returns whether a path below the folder is one that a run writes there.
fn is_name(path: &Path, is_folder: bool) -> bool {
    let Some(parts) = path.iter().map(|part| part.to_str()).collect::<Option<Vec<&str>>>() else {
        return false;
    };
    let parts = parts.strip_prefix(&[SHAPES]).unwrap_or(&parts);
    let is_number = |text: &str| !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit());
    let is_numbers = |text: &str, ending: &str, n: usize| {
        let stem = text.strip_suffix(ending);
        stem.is_some_and(|stem| stem.split('-').all(is_number) && stem.split('-').count() == n)
    };
    match parts {
        [] => is_folder,
        ["tiles" | "sets"] => is_folder,
        ["tiles", level] => is_folder && is_number(level),
        ["tiles", level, part] => is_folder && is_number(level) && is_number(part),
        ["tiles", level, part, name] => {
            let is_tile = is_numbers(name, ".glb", 2) || is_numbers(name, ".ids", 1);
            !is_folder && is_number(level) && is_number(part) && is_tile
        }
        ["sets", part] => is_folder && is_number(part),
        ["sets", part, name] => !is_folder && is_number(part) && is_numbers(name, ".json", 1),
        [name] => {
            let is_page = viewer::FILES.iter().any(|(page, _)| page == name);
            let is_mark = *name == MARK || is_hidden_mark(name);
            !is_folder && (is_page || *name == FILE_NAME || is_mark)
        }
        _ => false,
    }
}
