//! The bytes of a mesh file, readable at any offset from any thread.
//!
//! The lowest layer of `ply`: it knows the file's length and nothing of its format. Everything above it
//! holds sizes against `len` before it allocates.

use std::fs::File;
use std::ops::Range;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use stonecut_system::disk::{Disk, open_input, scratch_file};
use stonecut_system::error::{Error, Result};

/// A file, or bytes in memory that stand for one (tests, fuzzing).
pub struct RawFile {
    path: PathBuf,
    data: Data,
    len: u64,
    /// First byte of what is read; the whole file begins at 0.
    start: u64,
    /// True if it ends where the mesh in it does; a whole file may grow.
    is_part: bool,
    /// True if it is the file of this name itself, and not something made from it.
    is_original: bool,
    /// Holds the bytes of temporary data on disk.
    _account: Option<Disk>,
}

enum Data {
    File(File),
    /// A file that is opened whenever it is read.
    Closed,
    Memory(Vec<u8>),
    /// Files one behind the other, each with its first byte.
    Chain(Vec<(u64, RawFile)>),
}

impl std::fmt::Debug for RawFile {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} ({} bytes)", self.path.display(), self.len)
    }
}

impl RawFile {
    /// Several files one behind the other as if they were one, under a name for messages.
    pub fn chain(name: &Path, files: Vec<RawFile>) -> Self {
        let mut len = 0;
        let mut placed = Vec::with_capacity(files.len());
        for file in files {
            let n_bytes = file.len();
            placed.push((len, file));
            len += n_bytes;
        }
        let path = name.to_path_buf();
        RawFile { path, data: Data::Chain(placed), len, ..RawFile::from_bytes("", Vec::new()) }
    }

    /// Opens a regular file; pipes and folders are refused by name.
    pub fn open(path: &Path) -> Result<Self> {
        let file = open_input(path)?;
        let meta = file.metadata().map_err(|e| Error::reading(path, "cannot stat", e))?;
        let path = path.to_path_buf();
        Ok(RawFile {
            path,
            data: Data::File(file),
            len: meta.len(),
            start: 0,
            is_part: false,
            is_original: true,
            _account: None,
        })
    }

    /// A file of `len` bytes that is opened whenever it is read: one of thousands.
    pub fn closed(path: &Path, len: u64) -> Self {
        let path = path.to_path_buf();
        RawFile { path, data: Data::Closed, len, ..RawFile::from_bytes("", Vec::new()) }
    }

    /// The same file from a byte on, as if it was all there is: a mesh inside of another file.
    pub fn part(self, bytes: Range<u64>) -> Result<Self> {
        if bytes.start > bytes.end || bytes.end > self.len {
            let (from, to, len) = (bytes.start, bytes.end, self.len);
            return Err(
                self.bad(format!("its mesh from byte {from} to {to} ends behind byte {len}"))
            );
        }
        let start = self.start + bytes.start;
        let len = bytes.end - bytes.start;
        Ok(RawFile { start, len, is_part: true, is_original: false, ..self })
    }

    /// Takes bytes as if they were the file `name`.
    pub fn from_bytes(name: &str, bytes: Vec<u8>) -> Self {
        let len = bytes.len() as u64;
        RawFile {
            path: name.into(),
            data: Data::Memory(bytes),
            len,
            start: 0,
            is_part: false,
            is_original: false,
            _account: None,
        }
    }

    /// The file's name, for messages.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Names a file in a folder from what the folder is known by.
    pub(crate) fn leave_folder(&mut self, folder: &Path, name: &Path) {
        if let Ok(rest) = self.path.strip_prefix(folder) {
            self.path = name.join(rest);
        }
    }

    /// Returns whether this is the file of its name itself.
    pub fn is_original(&self) -> bool {
        self.is_original
    }

    /// The file's length in bytes when it was opened.
    #[allow(clippy::len_without_is_empty)] // A length, not a count.
    pub fn len(&self) -> u64 {
        self.len
    }

    /// An error about the contents of this file.
    pub fn bad(&self, what: impl Into<String>) -> Error {
        Error::bad_input(&self.path, what)
    }

    /// Fills `buffer` from `offset`; the caller has held the range against `len`.
    pub fn read_exact_at(&self, buffer: &mut [u8], offset: u64) -> Result<()> {
        let n = self.read_at_most(buffer, offset)?;
        if n < buffer.len() {
            return Err(self.bad(format!(
                "byte offset {}: the file ends here although it was longer when it was opened; it \
                 was changed during the run",
                offset.saturating_add(n as u64)
            )));
        }
        Ok(())
    }

    /// Calls `each` with the bytes of a range in turn, `n_bytes` at a time, fewer at the end.
    pub fn each_piece(
        &self,
        Range { start, end }: Range<u64>,
        n_bytes: usize,
        mut each: impl FnMut(&[u8]) -> Result<()>,
    ) -> Result<()> {
        let mut buffer = vec![0; (end - start).min(n_bytes as u64) as usize];
        for at in (start..end).step_by(n_bytes) {
            let piece = &mut buffer[..(end - at).min(n_bytes as u64) as usize];
            self.read_exact_at(piece, at)?;
            each(piece)?;
        }
        Ok(())
    }

    /// Reads up to `buffer.len()` bytes from `offset`; less only at the end of the file.
    pub fn read_at_most(&self, buffer: &mut [u8], offset: u64) -> Result<usize> {
        // Nothing behind the end of a part is its own.
        let room = usize::try_from(self.len.saturating_sub(offset)).unwrap_or(usize::MAX);
        let buffer = match self.is_part {
            true => {
                let n = room.min(buffer.len());
                &mut buffer[..n]
            }
            false => buffer,
        };
        let offset = self.start.saturating_add(offset);
        match &self.data {
            Data::Memory(bytes) => {
                let start = usize::try_from(offset).unwrap_or(usize::MAX).min(bytes.len());
                let n = buffer.len().min(bytes.len() - start);
                buffer[..n].copy_from_slice(&bytes[start..start + n]);
                Ok(n)
            }
            Data::Closed => RawFile::open(&self.path)?.read_at_most(buffer, offset),
            Data::Chain(files) => {
                let mut filled = 0;
                let mut i = files.partition_point(|(first, _)| *first <= offset).saturating_sub(1);
                while let Some((first, file)) = files.get(i).filter(|_| filled < buffer.len()) {
                    let at = offset + filled as u64 - first;
                    let n = file.len().saturating_sub(at).min((buffer.len() - filled) as u64);
                    filled += file.read_at_most(&mut buffer[filled..filled + n as usize], at)?;
                    i += 1;
                }
                Ok(filled)
            }
            Data::File(file) => {
                let mut filled = 0;
                while filled < buffer.len() {
                    match file.read_at(&mut buffer[filled..], offset + filled as u64) {
                        Ok(0) => break,
                        Ok(n) => filled += n,
                        Err(e) if e.kind() == std::io::ErrorKind::Interrupted => {}
                        Err(e) => return Err(Error::reading(&self.path, "cannot read", e)),
                    }
                }
                Ok(filled)
            }
        }
    }
}

/// Bytes of a spool that stay in memory; further ones go to a file.
const SPOOL_MEMORY_BYTES: usize = 16 << 20;

/// Bytes gathered before they go to the spool's file.
const SPOOL_WRITE_BYTES: usize = 1 << 20;

/// Bytes written once and read at random afterwards; in memory, or in a nameless file of a folder.
pub struct Spool {
    folder: PathBuf,
    memory: Vec<u8>,
    most_in_memory: usize,
    file: Option<File>,
    len: u64,
    /// Holds the bytes of the file.
    account: Disk,
}

impl Spool {
    /// An empty spool; nothing is created in `folder` before it is needed.
    pub fn new(folder: &Path) -> Self {
        Spool {
            folder: folder.to_path_buf(),
            memory: Vec::new(),
            most_in_memory: SPOOL_MEMORY_BYTES,
            file: None,
            len: 0,
            account: Disk::default(),
        }
    }

    /// The same spool while it is empty, with the bytes of its file in the account of `disk` as long as there is a file.
    pub fn counted(self, disk: &Disk) -> Self {
        Spool { account: disk.part(), ..self }
    }

    /// The same spool while it is empty, with at most this much of it in memory where that is less than otherwise.
    pub fn within(self, bytes: u64) -> Self {
        let most_in_memory = (bytes as usize).clamp(SPOOL_WRITE_BYTES, SPOOL_MEMORY_BYTES);
        Spool { most_in_memory, ..self }
    }

    /// Bytes written so far.
    #[allow(clippy::len_without_is_empty)] // A length, not a count.
    pub fn len(&self) -> u64 {
        self.len
    }

    /// Keeps no more in memory than one write of the file.
    pub fn leave_memory(&mut self) -> Result<()> {
        if self.file.is_none() { self.spill() } else { Ok(()) }
    }

    /// Appends bytes.
    pub fn write(&mut self, bytes: &[u8]) -> Result<()> {
        self.len += bytes.len() as u64;
        let room = if self.file.is_some() { SPOOL_WRITE_BYTES } else { self.most_in_memory };
        if self.memory.len() + bytes.len() > room {
            self.spill()?;
            if bytes.len() > SPOOL_WRITE_BYTES {
                return self.put_in_file(bytes);
            }
        }
        self.memory.extend_from_slice(bytes);
        Ok(())
    }

    /// Appends a whole file of temporary data.
    pub fn append_file(&mut self, from: &RawFile) -> Result<()> {
        if let Data::Memory(bytes) = &from.data {
            return self.write(bytes);
        }
        from.each_piece(0..from.len(), 1 << 20, |bytes| self.write(bytes))
    }

    fn spill(&mut self) -> Result<()> {
        let memory = std::mem::take(&mut self.memory);
        self.put_in_file(&memory)?;
        self.memory = memory;
        self.memory.clear();
        self.memory.shrink_to(SPOOL_WRITE_BYTES);
        Ok(())
    }

    fn put_in_file(&mut self, bytes: &[u8]) -> Result<()> {
        let fail = |e| Error::io(&self.folder, "cannot write temporary data", e);
        let mut file = match self.file.take() {
            Some(file) => file,
            None => scratch_file(&self.folder).map_err(fail)?,
        };
        std::io::Write::write_all(&mut file, bytes).map_err(fail)?;
        self.account.adopt(bytes.len() as u64);
        self.file = Some(file);
        Ok(())
    }

    /// The bytes, readable at random, under a name for messages.
    pub fn finish(mut self, name: &Path) -> Result<RawFile> {
        if self.file.is_some() {
            self.spill()?;
        }
        let data = match self.file {
            Some(file) => Data::File(file),
            None => Data::Memory(self.memory),
        };
        let (path, _account) = (name.to_path_buf(), Some(self.account));
        Ok(RawFile {
            path,
            data,
            len: self.len,
            start: 0,
            is_part: false,
            is_original: false,
            _account,
        })
    }
}
