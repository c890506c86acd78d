//! Keeps two runs out of one job folder.
//!
//! The lock is an advisory lock on a file, which the system drops when its holder dies, so a dead run's
//! lock is free. Host and process of the holder stand in the file for the message only.
//!
//! A program that starts others holds a lock that it has dropped until these have begun: between `fork` and `exec` they
//! have copies of its open files. So a lock that is held is asked for again for a moment before it counts as another run's.

use rustix::fs::{FlockOperation, OFlags, flock};
use std::fs::{File, OpenOptions};
use std::io::{Read, Seek, Write};
use std::os::unix::fs::{DirBuilderExt, MetadataExt, OpenOptionsExt};
use std::path::Path;
use std::time::Duration;
use stonecut_system::disk::check_own;
use stonecut_system::error::{Error, Result};

/// The lock file's name in the job folder.
pub const FILE_NAME: &str = "lock";

/// First bytes of a lock that was taken.
pub const BEGIN: &str = "host ";

/// Times that a held lock is asked for, and the pause between two of them: half a second in all.
const ATTEMPTS: u32 = 25;
const PAUSE: Duration = Duration::from_millis(20);

/// A held lock; dropping it gives the folder free.
#[derive(Debug)]
pub struct JobLock {
    _file: File,
}

impl JobLock {
    /// Takes the lock of a job folder, or says who holds it.
    pub fn take(folder: &Path) -> Result<JobLock> {
        loop {
            if let Some(lock) = Self::take_once(folder)? {
                return Ok(lock);
            }
        }
    }

    /// `None` if the file was removed, with its folder perhaps, between opening and locking it.
    fn take_once(folder: &Path) -> Result<Option<JobLock>> {
        std::fs::DirBuilder::new()
            .recursive(true)
            .mode(0o700)
            .create(folder)
            .map_err(|e| Error::io(folder, "cannot create folder", e))?;
        // Somebody else may have made it in between.
        check_own(folder)?;
        let path = folder.join(FILE_NAME);
        let io = |action| move |e| Error::io(folder.join(FILE_NAME), action, e);
        let mut file = OpenOptions::new()
            .read(true)
            .write(true)
            .create(true)
            .truncate(false)
            .custom_flags(OFlags::NOFOLLOW.union(OFlags::NONBLOCK).bits() as i32)
            .open(&path)
            .map_err(io("cannot open lock"))?;
        if !file.metadata().map_err(io("cannot stat lock"))?.is_file() {
            let what = format!("{} is not a lock of stonecut; remove it", path.display());
            return Err(Error::Usage(what));
        }
        match exclusive(&file) {
            Ok(()) => {}
            Err(rustix::io::Errno::WOULDBLOCK) => {
                let mut holder = String::new();
                // A half-written holder line only makes the message poorer.
                let _ = file.read_to_string(&mut holder);
                return Err(Error::Locked {
                    path: folder.into(),
                    what: format!(
                        "another run works on this job ({}); wait for it, or give a different output or --temp-dir",
                        holder.lines().next().unwrap_or_default()
                    ),
                });
            }
            Err(e) => return Err(Error::io(&path, "cannot lock", e.into())),
        }
        let here = file.metadata().map_err(io("cannot stat lock"))?.ino();
        if std::fs::metadata(&path).map(|meta| meta.ino()).ok() != Some(here) {
            return Ok(None);
        }
        let host = rustix::system::uname().nodename().to_string_lossy().into_owned();
        file.set_len(0)
            .and_then(|()| file.rewind())
            .and_then(|()| writeln!(file, "host {host}, process {}", std::process::id()))
            .map_err(io("cannot write lock"))?;
        Ok(Some(JobLock { _file: file }))
    }
}

/// Locks a file, after some attempts where another holds it.
fn exclusive(file: &File) -> rustix::io::Result<()> {
    let mut outcome = flock(file, FlockOperation::NonBlockingLockExclusive);
    for _ in 1..ATTEMPTS {
        if outcome != Err(rustix::io::Errno::WOULDBLOCK) {
            break;
        }
        std::thread::sleep(PAUSE);
        outcome = flock(file, FlockOperation::NonBlockingLockExclusive);
    }
    outcome
}

/// Holds a folder itself against other runs, without a file in it; dropping the outcome gives it free.
pub fn hold(folder: &Path) -> Result<File> {
    check_own(folder)?;
    let file = File::open(folder).map_err(|e| Error::io(folder, "cannot open", e))?;
    let locked = || Error::Locked {
        path: folder.into(),
        what: "another run writes the same output there; wait for it, or give a different output"
            .to_owned(),
    };
    match exclusive(&file) {
        Ok(()) if is_named(&file, folder) => Ok(file),
        Ok(()) | Err(rustix::io::Errno::WOULDBLOCK) => Err(locked()),
        Err(e) => Err(Error::io(folder, "cannot lock", e.into())),
    }
}

/// True if the path still leads to the open folder: another run may have replaced it before the lock was there.
fn is_named(file: &File, folder: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    let same =
        |a: &std::fs::Metadata, b: &std::fs::Metadata| (a.dev(), a.ino()) == (b.dev(), b.ino());
    matches!((file.metadata(), std::fs::metadata(folder)), (Ok(a), Ok(b)) if same(&a, &b))
}

/// Returns whether a run holds the lock of a job folder, and what the last one has written there: host and process in the first
/// line, its progress in the second. `None` without a lock.
pub fn look(folder: &Path) -> Option<(bool, String)> {
    let is_held = !is_free(folder)?;
    let text = std::fs::read(folder.join(FILE_NAME)).ok()?;
    Some((is_held, String::from_utf8_lossy(&text).into_owned()))
}

/// Returns whether the lock of a job folder is free; `None` without a lock.
pub fn is_free(folder: &Path) -> Option<bool> {
    let path = folder.join(FILE_NAME);
    let flags = OFlags::NOFOLLOW.union(OFlags::NONBLOCK).bits() as i32;
    let file = OpenOptions::new().read(true).custom_flags(flags).open(path).ok()?;
    Some(flock(&file, FlockOperation::NonBlockingLockShared).is_ok())
}
