//! A file of our own that is written once and then read at random, through the page cache of the system.

use super::disk::scratch_file;
use memmap2::{Mmap, UncheckedAdvice};
use std::fs::File;
use std::io::{BufWriter, Result, Write};
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// Bytes that one access may make resident: the system maps what it has cached around a page, 64 KiB by default.
const UNIT: usize = 1 << 16;

/// Bytes of a writer's buffer.
const BUFFER: usize = 1 << 20;

/// A file without a name while it is written.
///
/// It is written in full, not made by its length, so there are no holes, and a full disk is an error of `write`.
pub struct MappedWriter {
    file: BufWriter<File>,
    length: u64,
}

impl MappedWriter {
    /// An empty file in `folder`.
    pub fn create(folder: &Path) -> Result<MappedWriter> {
        let file = BufWriter::with_capacity(BUFFER, scratch_file(folder)?);
        Ok(MappedWriter { file, length: 0 })
    }

    /// Appends `bytes`; returns the offset at which they begin.
    pub fn append(&mut self, bytes: &[u8]) -> Result<u64> {
        self.file.write_all(bytes)?;
        let at = self.length;
        self.length += bytes.len() as u64;
        Ok(at)
    }

    /// Bytes so far.
    pub fn length(&self) -> u64 {
        self.length
    }

    /// Maps the file, of which at most about `resident_bytes` stay in memory.
    ///
    /// It is synced before: an error of the disk comes here, and clean pages are given back whenever others need
    /// memory.
    pub fn finish(self, resident_bytes: u64) -> Result<MappedFile> {
        let file = self.file.into_inner().map_err(std::io::IntoInnerError::into_error)?;
        file.sync_data()?;
        // SAFETY: the file has no name and was made by this process, which neither writes to it nor shortens it from
        // here on, so the bytes behind the map never change.
        let map = unsafe { Mmap::map(&file)? };
        let n_units = map.len().div_ceil(UNIT);
        let touched = (0..n_units.div_ceil(64)).map(|_| AtomicU64::new(0)).collect();
        Ok(MappedFile { map, touched, n_touched: AtomicU64::new(0), resident_bytes })
    }
}

/// A file without a name, mapped to be read. Threads may share it.
pub struct MappedFile {
    map: Mmap,
    /// A bit for each unit that may be resident.
    touched: Vec<AtomicU64>,
    n_touched: AtomicU64,
    resident_bytes: u64,
}

impl MappedFile {
    /// `n` bytes from `at` on, which count as resident from now on.
    ///
    /// # Panics
    /// If they lie outside of the file.
    #[inline]
    pub fn at(&self, at: u64, n: usize) -> &[u8] {
        let at = at as usize;
        for unit in at / UNIT..=(at + n.saturating_sub(1)) / UNIT {
            let bit = 1 << (unit % 64);
            if self.touched[unit / 64].load(Relaxed) & bit == 0
                && self.touched[unit / 64].fetch_or(bit, Relaxed) & bit == 0
            {
                self.n_touched.fetch_add(1, Relaxed);
            }
        }
        &self.map[at..at + n]
    }

    /// Gives memory back if more than what was allowed may be resident. Call it between pieces of work.
    pub fn trim(&self) {
        if self.n_touched.load(Relaxed) * UNIT as u64 <= self.resident_bytes {
            return;
        }
        self.n_touched.store(0, Relaxed);
        self.touched.iter().for_each(|units| units.store(0, Relaxed));
        // SAFETY: the map is shared with a file that holds every byte; what is read again comes back from there, the
        // same. A system that refuses only keeps the memory.
        let _ = unsafe { self.map.unchecked_advise(UncheckedAdvice::DontNeed) };
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)] // A test fails by panicking.
    use super::*;

    /// Bytes are the same before and after memory is given back.
    #[test]
    fn bytes_stay_when_memory_is_given_back() {
        let folder = tempfile::tempdir().unwrap();
        let mut writer = MappedWriter::create(folder.path()).unwrap();
        let piece = |i: u32| -> Vec<u8> { (0..10_007u32).map(|k| (i * 31 + k) as u8).collect() };
        let places: Vec<u64> = (0..100).map(|i| writer.append(&piece(i)).unwrap()).collect();
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
        let file = writer.finish(3 * UNIT as u64).unwrap();
        for round in 0..3 {
            for (i, &at) in (0..).zip(&places) {
                assert_eq!(file.at(at, 10_007), piece(i), "round {round}");
                file.trim();
                assert!(file.n_touched.load(Relaxed) <= 3, "resident beyond what is allowed");
            }
        }
    }
}
