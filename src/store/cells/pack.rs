//! Packs: few large files of checksummed chunks, appended by one writer, read by many.
//!
//! A sealed pack ends with an index of its chunks, so that opening it is one read instead of one for every
//! chunk. The headers serve before the index is written: after a crash.

use crate::cell_id::CellId;
use crate::pack_format::{
    self, CHUNK_HEADER_BYTES, Chunk, ChunkKind, PACK_END_BYTES, PACK_HEADER_BYTES,
};
use serde::{Deserialize, Serialize};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use stonecut_system::background::Worker;
use stonecut_system::disk::{Disk, DiskFile};
use stonecut_system::error::{Error, Result};
use xxhash_rust::xxh3::xxh3_64;

/// Chunks collect here before they go to the file in one write.
const WRITE_BYTES: usize = 1 << 20;

/// Memory of buffers that wait while another thread writes: one that is written, one that waits, of chunks up to a quarter
/// of what makes one full.
pub const BEHIND_BYTES: u64 = 5 * WRITE_BYTES as u64 / 2;

/// The sealed description of a pack: enough to open it again.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct PackFile {
    /// Its file name in the job folder.
    pub pack: String,
    /// Its sealed length.
    pub pack_bytes: u64,
}

/// Appends chunks to a new pack.
#[derive(Debug)]
pub struct PackWriter {
    file: Arc<Mutex<DiskFile>>,
    path: PathBuf,
    /// Bytes that the file has once all that was handed over is written.
    handed_over: u64,
    pending: Vec<u8>,
    /// The thread that writes, and buffers that it is done with.
    behind: Option<Worker<Vec<u8>>>,
    spare: Arc<Mutex<Vec<Vec<u8>>>>,
    chunks: Vec<Chunk>,
    /// A write or sync has failed: what the file holds is unknown, so that nothing may be sealed on it.
    is_broken: bool,
}

impl PackWriter {
    /// Begins a pack at `path`, replacing whatever an interrupted run left there.
    pub fn create(disk: &Disk, path: &Path) -> Result<PackWriter> {
        let mut file = disk.create(path)?;
        file.append(&pack_format::pack_header())?;
        Ok(PackWriter::at_end_of(file, Vec::new()))
    }

    /// Continues a pack behind its last whole chunk. Chunks whose payload is damaged do not count.
    ///
    /// Reads the pack whole: nothing vouches for it until it is sealed.
    pub fn reopen(disk: &Disk, path: &Path) -> Result<PackWriter> {
        let file = disk.open(path)?;
        let (mut chunks, end) = match scan(&file) {
            // Not even its first bytes reached the disk before the crash.
            Err(Error::Corrupt { .. }) => return Self::create(disk, path),
            found => found?,
        };
        let mut payload = Vec::new();
        let mut unreadable = None;
        chunks.retain(|chunk| match read_payload(&file, chunk, &mut payload) {
            Ok(is_whole) => is_whole,
            Err(error) => {
                unreadable.get_or_insert(error);
                false
            }
        });
        if let Some(error) = unreadable {
            return Err(error);
        }
        let file = disk.open_append(path, end)?;
        disk.adopt(end);
        Ok(PackWriter::at_end_of(file, chunks))
    }

    /// Continues a pack of which `bytes` were synced by a checkpoint; what lies behind them is cut off.
    ///
    /// Payloads are not read again here: whoever reads a chunk checks it. Errors: `Corrupt` if the chunks do
    /// not end at `bytes`.
    pub fn continue_at(disk: &Disk, path: &Path, bytes: u64) -> Result<PackWriter> {
        let (mut chunks, _) = scan(&disk.open(path)?)?;
        chunks.retain(|chunk| chunk.offset + chunk.bytes <= bytes);
        let end = chunks.last().map_or(PACK_HEADER_BYTES, |chunk| chunk.offset + chunk.bytes);
        if end != bytes {
            return Err(Error::corrupt(path, format!("has no chunk that ends at byte {bytes}")));
        }
        let file = disk.open_append(path, bytes)?;
        disk.adopt(bytes);
        Ok(PackWriter::at_end_of(file, chunks))
    }

    fn at_end_of(file: DiskFile, chunks: Vec<Chunk>) -> PackWriter {
        PackWriter {
            path: file.path().to_path_buf(),
            handed_over: file.length(),
            file: Arc::new(Mutex::new(file)),
            pending: Vec::with_capacity(WRITE_BYTES * 2),
            behind: None,
            spare: Arc::default(),
            chunks,
            is_broken: false,
        }
    }

    /// Lets another thread write from now on, so that who appends does not wait for the system. Memory: `BEHIND_BYTES`.
    #[must_use]
    pub fn behind(mut self) -> PackWriter {
        let (file, spare) = (self.file.clone(), self.spare.clone());
        self.behind = Worker::start(move |mut bytes: Vec<u8>| {
            locked(&file).append(&bytes)?;
            bytes.clear();
            spare.lock().unwrap_or_else(PoisonError::into_inner).push(bytes);
            Ok(())
        });
        self
    }

    /// Appends one chunk.
    pub fn append(&mut self, cell: CellId, kind: ChunkKind, payload: &[u8]) -> Result<()> {
        let header = pack_format::chunk_header(cell, kind, payload);
        let at = self.length();
        self.chunks.push(pack_format::parse_chunk_header(&header, at).expect("just made"));
        self.pending.extend_from_slice(&header);
        if payload.len() >= WRITE_BYTES {
            self.flush()?;
            let outcome = locked(&self.file).append(payload);
            self.is_broken |= outcome.is_err();
            self.handed_over += payload.len() as u64;
            return outcome;
        }
        self.pending.extend_from_slice(payload);
        if self.pending.len() >= WRITE_BYTES { self.hand_over() } else { Ok(()) }
    }

    /// Hands everything pending to the system: a death of the process no longer loses it, one of the machine
    /// may.
    pub fn flush(&mut self) -> Result<()> {
        self.hand_over()?;
        let outcome = self.behind.as_ref().map_or(Ok(()), Worker::wait);
        self.is_broken |= outcome.is_err();
        outcome
    }

    /// The same, or hands it to the thread that writes.
    fn hand_over(&mut self) -> Result<()> {
        if self.is_broken {
            let what = "an earlier write failed; run the same command to continue";
            let cause = std::io::Error::other(what);
            return Err(Error::io(&self.path, "cannot write", cause));
        }
        self.handed_over += self.pending.len() as u64;
        let outcome = match &self.behind {
            None => {
                let outcome = locked(&self.file).append(&self.pending);
                self.pending.clear();
                outcome
            }
            Some(behind) => {
                let spare = self.spare.lock().unwrap_or_else(PoisonError::into_inner).pop();
                let next = spare.unwrap_or_else(|| Vec::with_capacity(WRITE_BYTES * 2));
                behind.give(std::mem::replace(&mut self.pending, next))
            }
        };
        self.is_broken = outcome.is_err();
        outcome
    }

    /// The chunks appended so far.
    pub fn chunks(&self) -> &[Chunk] {
        &self.chunks
    }

    /// Makes everything appended so far durable.
    pub fn sync(&mut self) -> Result<()> {
        self.flush()?;
        let outcome = locked(&self.file).sync();
        // The system may report a lost write only once; a second sync would falsely succeed.
        self.is_broken = outcome.is_err();
        outcome
    }

    /// Ends the pack with an index of its chunks and makes it durable; nothing may be appended any more.
    pub fn seal(&mut self) -> Result<()> {
        let index = pack_format::encode_index(&self.chunks, self.length());
        self.append(CellId(0), ChunkKind::Index, &index)?;
        self.sync()
    }

    /// Seals the pack, and makes its name durable.
    pub fn close(mut self, disk: &Disk) -> Result<PackFile> {
        self.seal()?;
        disk.sync_folder_of(&self.path)?;
        let pack = self.path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        Ok(PackFile { pack, pack_bytes: self.length() })
    }

    /// Opens what was appended so far for reading.
    pub fn reader(&mut self, disk: &Disk, n_cells: usize) -> Result<Pack> {
        self.reader_behind(disk, &[], n_cells)
    }

    /// The same behind sealed packs in the same folder.
    pub fn reader_behind(
        &mut self,
        disk: &Disk,
        earlier: &[PackFile],
        n_cells: usize,
    ) -> Result<Pack> {
        self.flush()?;
        let path = self.path.as_path();
        let folder = path.parent().unwrap_or(Path::new(""));
        let (mut files, mut chunks) = read_indices(disk, in_folder(folder, earlier))?;
        chunks.retain(|chunk| chunk.kind != ChunkKind::Foreign);
        let number = files.len() as u16;
        chunks.extend(self.chunks.iter().map(|&chunk| Chunk { file: number, ..chunk }));
        files.push(disk.open(path)?);
        Pack::from_chunks(files, chunks, CellId(0)..CellId::at(n_cells))
    }

    /// Bytes in the pack, once everything pending is written.
    pub fn length(&self) -> u64 {
        self.handed_over + self.pending.len() as u64
    }
}

/// The file, for whoever writes to it. After a panic nothing more is written: the writer is broken.
fn locked(file: &Mutex<DiskFile>) -> MutexGuard<'_, DiskFile> {
    file.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The error of a lock around a pack that is poisoned: a panic within `append` may have left half a chunk. Nothing may follow it,
/// and no source be freed for it.
pub fn half_written<T>(_: PoisonError<T>) -> Error {
    Error::Internal("another worker failed while it wrote".to_owned())
}

/// A pack opened for reading, or several as if one were appended to the other; safe to share between threads.
#[derive(Debug)]
pub struct Pack {
    files: Vec<DiskFile>,
    /// All chunks, by cell, within a cell in the order of the files, then in that in which they were appended.
    chunks: Vec<Chunk>,
    /// The cells that it may hold.
    cells: Range<CellId>,
    /// `first[c]..first[c + 1]` are the chunks of the cell that is number `c` of these.
    first: Vec<u32>,
}

impl Pack {
    /// Opens packs of `n_cells` cells as one, without notes of the partition. The chunks of a cell come in the order of the
    /// packs. Memory: 40 bytes a chunk, twice for a moment.
    pub fn open_all(
        disk: &Disk,
        folder: &Path,
        packs: &[PackFile],
        n_cells: usize,
    ) -> Result<Pack> {
        let (files, mut chunks) = read_indices(disk, in_folder(folder, packs))?;
        chunks.retain(|chunk| chunk.kind != ChunkKind::Foreign);
        Self::from_chunks(files, chunks, CellId(0)..CellId::at(n_cells))
    }

    /// Opens the notes alone that packs hold under numbers below `n`.
    pub fn open_notes(disk: &Disk, folder: &Path, packs: &[PackFile], n: u32) -> Result<Pack> {
        let (files, mut chunks) = read_indices(disk, in_folder(folder, packs))?;
        chunks.retain(|chunk| chunk.kind == ChunkKind::Foreign);
        Self::from_chunks(files, chunks, CellId(0)..CellId(n))
    }

    /// Opens a pack of some cells; memory grows with these alone.
    pub fn open_some(disk: &Disk, path: &Path, cells: Range<CellId>, bytes: u64) -> Result<Pack> {
        let (files, chunks) = read_indices(disk, std::iter::once((path.to_path_buf(), bytes)))?;
        Self::from_chunks(files, chunks, cells)
    }

    fn from_chunks(
        files: Vec<DiskFile>,
        mut chunks: Vec<Chunk>,
        cells: Range<CellId>,
    ) -> Result<Pack> {
        if cells.end < cells.start {
            let path = files.first().map_or(Path::new("a pack"), DiskFile::path);
            let what = format!(
                "its record has cells {} to {}; run again with --restart",
                cells.start, cells.end
            );
            return Err(Error::corrupt(path, what));
        }
        if let Some(bad) = chunks.iter().find(|chunk| !cells.contains(&chunk.cell)) {
            let what = format!(
                "byte {}: cell {} is not in {}..{}; run again with --restart",
                bad.offset, bad.cell, cells.start, cells.end
            );
            return Err(Error::corrupt(files[usize::from(bad.file)].path(), what));
        }
        chunks.sort_by_key(|chunk| (chunk.cell, chunk.file, chunk.offset));
        let first = Self::index(&chunks, &cells);
        Ok(Pack { files, chunks, cells, first })
    }

    /// Leaves out the chunks of some cells (ascending) that lie before a place in the last of the packs.
    pub fn forget(mut self, cells: &[CellId], before: u64) -> Pack {
        if let (false, Some(last)) = (cells.is_empty(), self.files.len().checked_sub(1)) {
            self.chunks.retain(|chunk| {
                (usize::from(chunk.file), chunk.offset) >= (last, before)
                    || cells.binary_search(&chunk.cell).is_err()
            });
            self.first = Self::index(&self.chunks, &self.cells);
        }
        self
    }

    /// Path of the file that a chunk lies in.
    pub fn path_of(&self, chunk: &Chunk) -> &Path {
        self.file_of(chunk).path()
    }

    fn file_of(&self, chunk: &Chunk) -> &DiskFile {
        &self.files[usize::from(chunk.file)]
    }

    fn index(chunks: &[Chunk], cells: &Range<CellId>) -> Vec<u32> {
        let n_cells = cells.end.index() - cells.start.index();
        let mut first = vec![0u32; n_cells + 1];
        for chunk in chunks {
            first[chunk.cell.index() - cells.start.index() + 1] += 1;
        }
        for place in 0..n_cells {
            first[place + 1] += first[place];
        }
        first
    }

    /// All chunks, by cell.
    pub fn chunks(&self) -> &[Chunk] {
        &self.chunks
    }

    /// The chunks of one cell, in the order they were written.
    pub fn chunks_of(&self, cell: CellId) -> &[Chunk] {
        let place = cell.index() - self.cells.start.index();
        &self.chunks[self.first[place] as usize..self.first[place + 1] as usize]
    }

    /// Reads a chunk's payload into `payload` and checks it.
    pub fn read(&self, chunk: &Chunk, payload: &mut Vec<u8>) -> Result<()> {
        if !read_payload(self.file_of(chunk), chunk, payload)? {
            let what = format!(
                "the chunk at byte {} (cell {}) is damaged; run again with --restart",
                chunk.offset, chunk.cell
            );
            return Err(Error::corrupt(self.path_of(chunk), what));
        }
        Ok(())
    }

    /// Lets the system begin to read a cell that will soon be wanted.
    pub fn expect(&self, cell: CellId) {
        let expect = |chunk: &Chunk| self.file_of(chunk).expect(chunk.offset, chunk.bytes);
        self.chunks_of(cell).iter().for_each(expect);
    }

    /// Gives the payload bytes of a cell back to the file system; its chunk headers stay readable.
    pub fn free(&self, cell: CellId) -> Result<()> {
        for chunk in self.chunks_of(cell) {
            self.file_of(chunk).punch(chunk.offset, chunk.bytes)?;
        }
        Ok(())
    }
}

/// Paths and sealed lengths of packs.
fn in_folder<'a>(
    folder: &'a Path,
    packs: &'a [PackFile],
) -> impl Iterator<Item = (PathBuf, u64)> + 'a {
    packs.iter().map(|file| (folder.join(&file.pack), file.pack_bytes))
}

/// Opens packs that were sealed at these lengths; their chunks bear the number of their file.
fn read_indices(
    disk: &Disk,
    packs: impl Iterator<Item = (PathBuf, u64)>,
) -> Result<(Vec<DiskFile>, Vec<Chunk>)> {
    let (mut files, mut chunks) = (Vec::new(), Vec::new());
    for (path, bytes) in packs {
        let file = disk.open(&path)?;
        if file.length() < bytes {
            let what =
                format!("has {} of its {bytes} bytes; run again with --restart", file.length());
            return Err(Error::corrupt(&path, what));
        }
        let found = read_index(&file, bytes)?.ok_or_else(|| {
            let what = "the index of its chunks is damaged; run again with --restart";
            Error::corrupt(&path, what)
        })?;
        let number = files.len() as u16;
        chunks.extend(found.into_iter().map(|chunk| Chunk { file: number, ..chunk }));
        files.push(file);
    }
    Ok((files, chunks))
}

/// Reads a pack that was sealed at `bytes` and checks every chunk. The error names the first that is damaged.
pub fn check_pack(disk: &Disk, path: &Path, bytes: u64) -> Result<()> {
    let file = disk.open(path)?;
    let damaged = |at: u64| Error::corrupt(path, format!("the chunk at byte {at} is damaged"));
    let chunks = read_index(&file, bytes)?.ok_or_else(|| damaged(bytes))?;
    let mut payload = Vec::new();
    for chunk in &chunks {
        if !read_payload(&file, chunk, &mut payload)? {
            return Err(damaged(chunk.offset));
        }
    }
    Ok(())
}

/// Reads a chunk's payload; tells whether its checksum holds.
fn read_payload(file: &DiskFile, chunk: &Chunk, payload: &mut Vec<u8>) -> Result<bool> {
    payload.clear();
    payload.resize(chunk.bytes as usize, 0);
    file.read_at(payload, chunk.offset)?;
    Ok(xxh3_64(payload) == chunk.checksum)
}

/// The chunks of a pack sealed at `bytes`; `None` if its index is damaged.
fn read_index(file: &DiskFile, bytes: u64) -> Result<Option<Vec<Chunk>>> {
    let mut magic = [0; PACK_HEADER_BYTES as usize];
    file.read_at(&mut magic, 0)?;
    pack_format::check_pack_header(file.path(), &magic)?;
    let Some(end_at) = bytes.checked_sub(PACK_END_BYTES) else { return Ok(None) };
    let mut end = [0; PACK_END_BYTES as usize];
    file.read_at(&mut end, end_at)?;
    let at = u64::from_le_bytes(end);
    if at.checked_add(CHUNK_HEADER_BYTES).is_none_or(|payload_at| payload_at > bytes) {
        return Ok(None);
    }
    let mut header = [0; CHUNK_HEADER_BYTES as usize];
    file.read_at(&mut header, at)?;
    let index = pack_format::parse_chunk_header(&header, at)
        .filter(|chunk| chunk.kind == ChunkKind::Index)
        .filter(|chunk| chunk.offset.checked_add(chunk.bytes) == Some(bytes));
    let Some(index) = index else { return Ok(None) };
    let mut payload = Vec::new();
    let is_whole = read_payload(file, &index, &mut payload)?;
    Ok(pack_format::decode_index(&payload, at).filter(|_| is_whole))
}

/// Walks over the chunk headers of a pack: its whole chunks but an index, and where the last of them ends.
fn scan(file: &DiskFile) -> Result<(Vec<Chunk>, u64)> {
    let mut magic = [0; PACK_HEADER_BYTES as usize];
    file.read_at(&mut magic, 0)?;
    pack_format::check_pack_header(file.path(), &magic)?;
    let mut chunks = Vec::new();
    let mut at = PACK_HEADER_BYTES;
    let mut header = [0; CHUNK_HEADER_BYTES as usize];
    while at + CHUNK_HEADER_BYTES <= file.length() {
        file.read_at(&mut header, at)?;
        let chunk = pack_format::parse_chunk_header(&header, at);
        let Some(chunk) = chunk.filter(|chunk| chunk.kind != ChunkKind::Index) else { break };
        match chunk.offset.checked_add(chunk.bytes) {
            Some(end) if end <= file.length() => at = end,
            _ => break,
        }
        chunks.push(chunk);
    }
    Ok((chunks, at))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chunks_come_back_by_cell_and_damage_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.cells");
        let disk = Disk::default();
        let mut writer = PackWriter::create(&disk, &path).unwrap();
        for i in 0..100u32 {
            writer
                .append(CellId(i % 7), ChunkKind::Vertices, &vec![i as u8; i as usize * 31])
                .unwrap();
        }
        writer.seal().unwrap();
        let bytes = writer.length();
        drop(writer);
        let pack = Pack::open_some(&disk, &path, CellId(0)..CellId(7), bytes).unwrap();
        let mut payload = Vec::new();
        let lengths: Vec<u64> = pack.chunks_of(CellId(3)).iter().map(|c| c.bytes / 31).collect();
        assert_eq!(lengths, (0..100).filter(|i| i % 7 == 3).collect::<Vec<_>>());
        for chunk in pack.chunks_of(CellId(3)) {
            pack.read(chunk, &mut payload).unwrap();
        }
        let mut raw = std::fs::read(&path).unwrap();
        let victim = pack.chunks_of(CellId(3))[1];
        raw[victim.offset as usize] ^= 1;
        std::fs::write(&path, &raw).unwrap();
        let error = pack.read(&victim, &mut payload).unwrap_err();
        assert!(error.to_string().contains(&format!("byte {}", victim.offset)), "{error}");
        // When the pack is continued, the index and a torn chunk are cut off and the damaged one is forgotten.
        let index_at = bytes as usize - 100 * 32 - 8 - CHUNK_HEADER_BYTES as usize;
        assert_eq!(PackWriter::reopen(&disk, &path).unwrap().chunks().len(), 99);
        assert_eq!(std::fs::metadata(&path).unwrap().len(), index_at as u64);
        std::fs::write(&path, &raw[..index_at - 5]).unwrap();
        assert_eq!(PackWriter::reopen(&disk, &path).unwrap().chunks().len(), 98);
        assert!(Pack::open_some(&disk, &path, CellId(0)..CellId(7), bytes).is_err());
        // Any damage to the index is found when the pack is opened.
        raw[victim.offset as usize] ^= 1;
        for at in (index_at..raw.len()).step_by(13) {
            raw[at] ^= 0x10;
            std::fs::write(&path, &raw).unwrap();
            assert!(
                Pack::open_some(&disk, &path, CellId(0)..CellId(7), bytes).is_err(),
                "byte {at}"
            );
            raw[at] ^= 0x10;
        }
    }
}
