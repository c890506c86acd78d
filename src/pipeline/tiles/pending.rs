//! The folder that a tree grows in before it has its name, and the mark that binds it to its job.

use crate::error::{Error, Result};
use crate::store::job::{Job, hold};
use crate::system::disk::Disk;
use crate::system::pending_file::{Place, write_whole};
use std::fs::File;
use std::path::Path;
use std::time::{SystemTime, UNIX_EPOCH};
use xxhash_rust::xxh3::xxh3_64;

/// Recorded with the mark before anything is written into the folder.
const BEGUN: &str = "tiles begun";

/// Name of the file that holds the mark.
const MARK: &str = ".stonecut-job";

/// Opens the folder of the job's tree, or begins one, and holds it against other runs while the outcome lives.
///
/// `named`: the tree may have had its last change already. Fails with `StateMismatch` where finished tiles are gone with their
/// folder, or where it is that of another run.
pub(super) fn open(job: &Job, folder: &Path, disk: &Disk, named: bool) -> Result<File> {
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
    match std::fs::read_to_string(folder.join(MARK)) {
        Ok(found) if found == mark => Ok(held),
        Err(_) if named => Ok(held),
        _ => Err(gone("this folder holds the tiles of another run")),
    }
}

fn begin(job: &Job, folder: &Path, disk: &Disk) -> Result<File> {
    if folder.exists() {
        // Of another job, or of one that was thrown away.
        let held = hold(folder)?;
        std::fs::remove_dir_all(folder).map_err(|e| Error::io(folder, "cannot remove", e))?;
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
