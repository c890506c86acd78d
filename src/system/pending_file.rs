//! Files that appear whole or not at all: every file that a user named and a command writes.
//!
//! Until it is finished an output has no name at all where the file system knows such files (`O_TMPFILE`), so
//! that no death of the process leaves anything; elsewhere it has its own hidden name, locked by its
//! writer, and what dead writers have left is removed by the next one. Only a regular file is ever replaced.
//! `paths` decides before which paths a command may write at all.

use crate::disk::{Disk, DiskFile, folder_of, kind_of};
use crate::error::{Error, Result};
use serde::{Deserialize, Serialize};
use std::ffi::{OsStr, OsString};
use std::fs::File;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

/// Bytes gathered before they go to the system; 1 MiB writes run at disk speed.
const BUFFER_BYTES: usize = 1 << 20;

/// Path of an output, and the disk that it is written through.
#[derive(Clone, Debug)]
pub struct Place {
    /// The name of the finished file; `-` is standard output.
    pub path: PathBuf,
    /// The disk that it is written through.
    pub disk: Disk,
    /// True if another file of that name is replaced; otherwise only one with the same bytes is.
    pub replace: bool,
}

impl From<&Path> for Place {
    /// A file that replaces what is there.
    fn from(path: &Path) -> Self {
        Place { path: path.to_path_buf(), disk: Disk::default(), replace: true }
    }
}

impl From<&PathBuf> for Place {
    fn from(path: &PathBuf) -> Self {
        Place::from(path.as_path())
    }
}

/// Writes a file of few bytes whole.
pub fn write_whole(place: impl Into<Place>, bytes: &[u8]) -> Result<()> {
    let mut file = PendingFile::create(place)?;
    file.write(bytes)?;
    file.finish().map(drop)
}

/// Gives a finished file of our own the name of an output; to another file system, or a stream, it is copied.
pub fn adopt(file: &Path, place: Place) -> Result<()> {
    use std::os::unix::fs::MetadataExt;
    let target = place.path.as_path();
    let is_stream = target == Path::new("-");
    if !is_stream {
        refuse_irregular(target)?;
    }
    let device = |path: &Path| {
        std::fs::metadata(path).map(|m| m.dev()).map_err(|e| Error::reading(path, "cannot stat", e))
    };
    if !is_stream && device(file)? == device(folder_of(target))? {
        return take_name(&place, file);
    }
    let disk = place.disk.clone();
    let mut source = File::open(file).map_err(|e| Error::reading(file, "cannot open", e))?;
    let mut copy = PendingFile::create(place)?;
    let mut buffer = vec![0; BUFFER_BYTES];
    loop {
        match source.read(&mut buffer).map_err(|e| Error::reading(file, "cannot read", e))? {
            0 => break,
            n => copy.write(&buffer[..n])?,
        }
    }
    copy.finish()?;
    disk.remove(file)
}

/// Gives a whole file its name. What has that name is replaced only where that was asked for; a file of the same bytes stays.
fn take_name(place: &Place, file: &Path) -> Result<()> {
    let target = place.path.as_path();
    if place.replace {
        return place.disk.rename(file, target);
    }
    if place.disk.rename_new(file, target)? {
        return Ok(());
    }
    refuse_irregular(target)?;
    if !same_bytes(file, target)? {
        return Err(appeared(target));
    }
    place.disk.remove(file)?;
    place.disk.sync_folder_of(target)
}

/// A file as it was found before the work, so that only this one is replaced afterwards.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Seen {
    path: PathBuf,
    mark: Option<Mark>,
}

/// Inode, length, and the times of the last changes.
type Mark = (u64, u64, [i64; 4]);

fn mark(path: &Path) -> Option<Mark> {
    use std::os::unix::fs::MetadataExt;
    let meta = std::fs::symlink_metadata(path).ok()?;
    let times = [meta.mtime(), meta.mtime_nsec(), meta.ctime(), meta.ctime_nsec()];
    Some((meta.ino(), meta.len(), times))
}

impl Seen {
    /// Looks at a path that was checked.
    pub fn new(path: &Path) -> Seen {
        Seen { path: path.to_path_buf(), mark: mark(path) }
    }

    /// A path at which nothing may be replaced.
    pub fn absent(path: &Path) -> Seen {
        Seen { path: path.to_path_buf(), mark: None }
    }

    /// The path.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns whether the file is still there as it was.
    pub fn is_unchanged(&self) -> bool {
        self.mark.is_some() && mark(&self.path) == self.mark
    }

    /// The place, to be written now: what has appeared there since is not replaced.
    pub fn place(&self, disk: &Disk) -> Place {
        let replace = self.is_unchanged();
        Place { path: self.path.clone(), disk: disk.clone(), replace }
    }
}

fn appeared(path: &Path) -> Error {
    let path = path.display();
    Error::Usage(format!(
        "{path} has appeared during the run and is not replaced; move it elsewhere, or give --force"
    ))
}

/// Refuses a name whose file must not be replaced by a new one: folders, devices, FIFOs, symbolic links.
pub fn refuse_irregular(path: &Path) -> Result<()> {
    match std::fs::symlink_metadata(path) {
        Ok(meta) if !meta.is_file() => Err(Error::Usage(format!(
            "{}: this is {}; an output is a new file or replaces a regular one",
            path.display(),
            kind_of(meta.file_type())
        ))),
        // Whatever else is wrong shows when the file is created.
        _ => Ok(()),
    }
}

/// Refuses a folder for files that go with an output where it is a link: they would come to lie elsewhere.
pub fn refuse_linked(folder: &Path) -> Result<()> {
    match std::fs::symlink_metadata(folder) {
        Ok(meta) if !meta.is_dir() => Err(Error::Usage(format!(
            "{}: this is {}; files that go with OUTPUT are written into a folder of this name: move it, or give OUTPUT \
             another name",
            folder.display(),
            kind_of(meta.file_type())
        ))),
        _ => Ok(()),
    }
}

enum Destination {
    File(DiskFile),
    Stdout(File),
}

impl Destination {
    fn append(&mut self, bytes: &[u8]) -> Result<()> {
        match self {
            Destination::File(file) => file.append(bytes),
            Destination::Stdout(file) => file.write_all(bytes).map_err(Error::stdout),
        }
    }
}

/// A file that gets its name in `finish`; dropped before, nothing of it stays.
pub struct PendingFile {
    place: Place,
    /// The hidden name that the file has now, if it has one.
    temporary: Option<PathBuf>,
    out: Destination,
    buffer: Vec<u8>,
    n_bytes: u64,
}

impl PendingFile {
    /// Creates the file in the target's folder; `-` is standard output, where nothing can be taken back.
    pub fn create(place: impl Into<Place>) -> Result<Self> {
        let place = place.into();
        let target = place.path.as_path();
        let mut temporary = None;
        let out = if target == Path::new("-") {
            let stdout = std::io::stdout();
            let fd = std::os::fd::AsFd::as_fd(&stdout).try_clone_to_owned();
            Destination::Stdout(File::from(fd.map_err(Error::stdout)?))
        } else {
            let name = target.file_name().ok_or_else(|| {
                Error::Usage(format!("'{}' names no file to write", target.display()))
            })?;
            refuse_irregular(target)?;
            let nameless = place.disk.create_nameless(target)?;
            Destination::File(match nameless.filter(|_| can_link()) {
                Some(file) => file,
                None => {
                    sweep(&place.disk, target, name);
                    let (file, path) = create_hidden(&place.disk, target, name)?;
                    temporary = Some(path);
                    file
                }
            })
        };
        let buffer = Vec::with_capacity(BUFFER_BYTES);
        Ok(PendingFile { place, temporary, out, buffer, n_bytes: 0 })
    }

    /// Appends bytes.
    pub fn write(&mut self, bytes: &[u8]) -> Result<()> {
        self.n_bytes += bytes.len() as u64;
        if self.buffer.len() + bytes.len() > BUFFER_BYTES {
            self.flush()?;
        }
        if bytes.len() >= BUFFER_BYTES {
            return self.out.append(bytes);
        }
        self.buffer.extend_from_slice(bytes);
        Ok(())
    }

    /// The name that the file will have.
    pub fn target(&self) -> &Path {
        &self.place.path
    }

    /// Hands what is buffered to the system.
    pub fn flush(&mut self) -> Result<()> {
        self.out.append(&self.buffer)?;
        self.buffer.clear();
        Ok(())
    }

    /// The bytes written, instead of a file.
    pub fn into_bytes(mut self) -> Result<Vec<u8>> {
        self.flush()?;
        let mut bytes = vec![0; self.n_bytes as usize];
        match &self.out {
            Destination::File(file) => file.read_at(&mut bytes, 0)?,
            Destination::Stdout(_) => bytes.clear(),
        }
        Ok(bytes)
    }

    /// Syncs, gives the file its name and syncs the folder; returns the file's length.
    pub fn finish(mut self) -> Result<u64> {
        self.flush()?;
        let Destination::File(file) = &mut self.out else { return Ok(self.n_bytes) };
        file.sync()?;
        let target = self.place.path.clone();
        let disk = self.place.disk.clone();
        refuse_irregular(&target)?;
        if self.temporary.is_none() {
            // A name that is free is taken at once: whatever appears meanwhile is never replaced.
            if !self.place.replace && file.link(&target)? {
                disk.sync_folder_of(&target)?;
                return Ok(self.n_bytes);
            }
            let name = target.file_name().unwrap_or_default();
            // Not swept while it has that name.
            file.lock();
            self.temporary = Some(loop {
                let hidden = hidden_name(&target, name);
                if file.link(&hidden)? {
                    break hidden;
                }
            });
        }
        let Some(temporary) = self.temporary.clone() else { return Ok(self.n_bytes) };
        take_name(&self.place, &temporary)?;
        self.temporary = None;
        Ok(self.n_bytes)
    }
}

impl Drop for PendingFile {
    fn drop(&mut self) {
        if let Some(temporary) = &self.temporary {
            // Nothing can be done about a failure here, and the name tells what the file is.
            let _ = self.place.disk.remove(temporary);
        }
    }
}

/// Returns whether a nameless file can be given a name here, which takes /proc.
fn can_link() -> bool {
    Path::new("/proc/self/fd").is_dir()
}

/// `.NAME.PROCESS-NUMBER.tmp` beside the target: another name at every call.
fn hidden_name(target: &Path, name: &OsStr) -> PathBuf {
    static NUMBER: AtomicU64 = AtomicU64::new(0);
    let number = NUMBER.fetch_add(1, Ordering::Relaxed);
    let mut hidden = OsString::from(".");
    hidden.push(name);
    hidden.push(format!(".{}-{number}.tmp", std::process::id()));
    target.with_file_name(hidden)
}

/// Creates a file under a hidden name that no file had, and locks it.
fn create_hidden(disk: &Disk, target: &Path, name: &OsStr) -> Result<(DiskFile, PathBuf)> {
    loop {
        let hidden = hidden_name(target, name);
        if let Some(file) = disk.create_new(&hidden)? {
            file.lock();
            return Ok((file, hidden));
        }
    }
}

/// Removes what dead writers of the same target have left: hidden names whose lock is free.
fn sweep(disk: &Disk, target: &Path, name: &OsStr) {
    let (name, folder) = (name.as_encoded_bytes(), folder_of(target));
    let is_tag = |tag: &[u8]| {
        let mut parts = tag.split(|&b| b == b'-');
        let is_number = |part: Option<&[u8]>| {
            part.is_some_and(|part| !part.is_empty() && part.iter().all(u8::is_ascii_digit))
        };
        is_number(parts.next()) && is_number(parts.next()) && parts.next().is_none()
    };
    // What cannot be read, opened or removed is left: it harms nothing.
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let found = entry.file_name();
        let tag = found.as_encoded_bytes().strip_prefix(b".");
        let tag = tag.and_then(|rest| rest.strip_prefix(name)?.strip_prefix(b"."));
        let is_ours = tag.and_then(|rest| rest.strip_suffix(b".tmp")).is_some_and(is_tag);
        if is_ours && entry.file_type().is_ok_and(|kind| kind.is_file()) {
            let path = folder.join(&found);
            if disk.open(&path).is_ok_and(|file| file.lock()) {
                let _ = disk.remove(&path);
            }
        }
    }
}

fn same_bytes(a: &Path, b: &Path) -> Result<bool> {
    let open = |path: &Path| File::open(path).map_err(|e| Error::reading(path, "cannot open", e));
    let (mut left, mut right) = (open(a)?, open(b)?);
    let length = |file: &File| file.metadata().map(|meta| meta.len()).unwrap_or(0);
    if length(&left) != length(&right) {
        return Ok(false);
    }
    let (mut x, mut y) = (vec![0; BUFFER_BYTES], vec![0; BUFFER_BYTES]);
    let mut rest = length(&left) as usize;
    while rest > 0 {
        let n = rest.min(BUFFER_BYTES);
        left.read_exact(&mut x[..n]).map_err(|e| Error::reading(a, "cannot read", e))?;
        right.read_exact(&mut y[..n]).map_err(|e| Error::reading(b, "cannot read", e))?;
        if x[..n] != y[..n] {
            return Ok(false);
        }
        rest -= n;
    }
    Ok(true)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let entries = std::fs::read_dir(folder).unwrap();
        let mut names: Vec<String> =
            entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    /// With and without names for unfinished files.
    fn disks() -> [Disk; 2] {
        [Disk::default(), Disk::for_crash_tests()]
    }

    #[test]
    fn an_output_appears_whole_and_nothing_else_stays() {
        for disk in disks() {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("o.ply");
            let place = |replace| Place { path: path.clone(), disk: disk.clone(), replace };
            let mut file = PendingFile::create(place(false)).unwrap();
            file.write(b"one").unwrap();
            assert!(!path.exists());
            drop(file);
            assert!(names(folder.path()).is_empty());
            write_whole(place(false), b"two").unwrap();
            // The same bytes again are not a conflict, others are.
            write_whole(place(false), b"two").unwrap();
            assert_eq!(write_whole(place(false), b"three").unwrap_err().exit_code(), 2);
            assert_eq!(std::fs::read(&path).unwrap(), b"two");
            write_whole(place(true), b"three").unwrap();
            assert_eq!(std::fs::read(&path).unwrap(), b"three");
            assert_eq!(names(folder.path()), ["o.ply"]);
        }
    }

    #[test]
    fn only_the_file_that_was_seen_is_replaced() {
        for disk in disks() {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("r.json");
            let nothing = Seen::new(&path);
            std::fs::write(&path, b"appeared").unwrap();
            let error = write_whole(nothing.place(&disk), b"report").unwrap_err();
            assert!(error.to_string().contains("appeared during the run"), "{error}");
            let seen = Seen::new(&path);
            std::fs::write(folder.path().join("other"), b"others").unwrap();
            std::fs::rename(folder.path().join("other"), &path).unwrap();
            assert_eq!(write_whole(seen.place(&disk), b"report").unwrap_err().exit_code(), 2);
            assert_eq!(std::fs::read(&path).unwrap(), b"others");
            write_whole(Seen::new(&path).place(&disk), b"report").unwrap();
            assert_eq!(std::fs::read(&path).unwrap(), b"report");
            assert_eq!(names(folder.path()), ["r.json"]);
        }
    }

    #[test]
    fn what_is_not_a_regular_file_is_never_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        std::fs::write(path("file"), b"kept").unwrap();
        std::fs::create_dir(path("folder")).unwrap();
        std::os::unix::fs::symlink("file", path("link")).unwrap();
        std::os::unix::fs::symlink("nowhere", path("dangling")).unwrap();
        for name in ["folder", "link", "dangling", "/dev/null"] {
            let error = write_whole(&path(name), b"x").unwrap_err();
            assert_eq!(error.exit_code(), 2, "{name}: {error}");
        }
        assert_eq!(std::fs::read(path("file")).unwrap(), b"kept");
        assert_eq!(names(folder.path()), ["dangling", "file", "folder", "link"]);
    }

    #[test]
    fn what_dead_writers_left_is_swept_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let others = [".o.ply.tmp", ".o.ply.12.tmp", ".o.ply.x-1.tmp", ".p.ply.1-2.tmp", "o.part"];
        for name in others.iter().chain(&[".o.ply.1-2.tmp", ".o.ply.99999999-0.tmp"]) {
            std::fs::write(folder.path().join(name), b"left").unwrap();
        }
        let place = || Place {
            path: folder.path().join("o.ply"),
            disk: Disk::for_crash_tests(),
            replace: true,
        };
        // A living writer keeps its file.
        let mut living = PendingFile::create(place()).unwrap();
        living.write(b"living").unwrap();
        write_whole(place(), b"new").unwrap();
        living.finish().unwrap();
        assert_eq!(std::fs::read(folder.path().join("o.ply")).unwrap(), b"living");
        let mut expected: Vec<&str> = others.to_vec();
        expected.push("o.ply");
        expected.sort_unstable();
        assert_eq!(names(folder.path()), expected);
    }
}
