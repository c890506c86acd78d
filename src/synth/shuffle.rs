//! Puts records into random order through a temporary file without a name, in bounded memory.
//!
//! For surfaces that can only be computed block by block. Where a record goes is a permutation of known
//! size, so every bucket of the result knows beforehand how many records it gets: the temporary file is
//! laid out bucket after bucket, filled in any order, and then read, sorted and written bucket by bucket.

use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use stonecut_system::disk::scratch_file;
use stonecut_system::error::{Error, Result};

/// Bytes of a bucket: what is sorted in memory at once.
const BUCKET_BYTES: u64 = 32 << 20;
/// Bytes of all write buffers together.
const BUFFER_BYTES: u64 = 64 << 20;
/// Each record in the file is preceded by its place within its bucket.
const PLACE_BYTES: usize = 4;

/// Collects records with their places, gives them back in order.
pub(super) struct Shuffler {
    folder: PathBuf,
    file: File,
    n_records: u64,
    record_bytes: usize,
    /// Records in each bucket but the last.
    bucket_records: u64,
    buckets: Vec<Bucket>,
    buffer_bytes: usize,
}

#[derive(Default)]
struct Bucket {
    buffer: Vec<u8>,
    written_bytes: u64,
}

impl Shuffler {
    /// For exactly `n_records` records; the temporary file in `folder` takes `n_records * (record_bytes + 4)` bytes.
    pub(super) fn new(folder: &Path, n_records: u64, record_bytes: usize) -> Result<Self> {
        let file = scratch_file(folder)
            .map_err(|e| Error::io(folder, "cannot create a temporary file in", e))?;
        let bucket_records = (BUCKET_BYTES / record_bytes as u64).max(1);
        let n_buckets = n_records.div_ceil(bucket_records);
        let buffer_bytes = (BUFFER_BYTES / n_buckets.max(1)).clamp(4096, 1 << 20) as usize;
        Ok(Shuffler {
            folder: folder.to_path_buf(),
            file,
            n_records,
            record_bytes,
            bucket_records,
            buckets: (0..n_buckets).map(|_| Bucket::default()).collect(),
            buffer_bytes,
        })
    }

    /// Takes the record whose place in the result is `place`; every place must be given once.
    pub(super) fn put(&mut self, place: u64, record: &[u8]) -> Result<()> {
        assert!(
            place < self.n_records && record.len() == self.record_bytes,
            "a record of this set"
        );
        let bucket = (place / self.bucket_records) as usize;
        let within = (place % self.bucket_records) as u32;
        let buffer = &mut self.buckets[bucket].buffer;
        buffer.extend_from_slice(&within.to_le_bytes());
        buffer.extend_from_slice(record);
        if buffer.len() >= self.buffer_bytes { self.flush(bucket) } else { Ok(()) }
    }

    /// Hands on all records in the order of their places.
    pub(super) fn drain(mut self, mut sink: impl FnMut(&[u8]) -> Result<()>) -> Result<()> {
        let stride = PLACE_BYTES + self.record_bytes;
        let (mut raw, mut sorted) = (Vec::new(), Vec::new());
        for bucket in 0..self.buckets.len() {
            self.flush(bucket)?;
            let at = bucket as u64 * self.bucket_records;
            let n_records = self.bucket_records.min(self.n_records - at) as usize;
            raw.resize(n_records * stride, 0);
            self.file
                .read_exact_at(&mut raw, at * stride as u64)
                .map_err(|e| Error::reading(&self.folder, "cannot read back", e))?;
            sorted.resize(n_records * self.record_bytes, 0);
            for entry in raw.chunks_exact(stride) {
                let (place, record) = entry.split_at(PLACE_BYTES);
                let place = place.iter().rev().fold(0, |sum, byte| sum << 8 | usize::from(*byte));
                let to = place * self.record_bytes;
                sorted[to..to + self.record_bytes].copy_from_slice(record);
            }
            sink(&sorted)?;
        }
        Ok(())
    }

    fn flush(&mut self, number: usize) -> Result<()> {
        let stride = (PLACE_BYTES + self.record_bytes) as u64;
        let bucket = &mut self.buckets[number];
        let at = number as u64 * self.bucket_records * stride + bucket.written_bytes;
        self.file
            .write_all_at(&bucket.buffer, at)
            .map_err(|e| Error::io(&self.folder, "cannot write", e))?;
        bucket.written_bytes += bucket.buffer.len() as u64;
        bucket.buffer.clear();
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::permutation::Permutation;

    #[test]
    fn records_come_back_by_place_over_many_buckets() {
        let folder = tempfile::tempdir().unwrap();
        let n = 40_000u64;
        // Records so large that a bucket holds few: 4 KiB, 8192 a bucket.
        let mut shuffler = Shuffler::new(folder.path(), n, 4096).unwrap();
        assert!(shuffler.buckets.len() > 4);
        let permutation = Permutation::new(n, 3);
        let mut record = [0u8; 4096];
        for element in 0..n {
            let place = permutation.apply(element);
            record[..8].copy_from_slice(&place.to_le_bytes());
            shuffler.put(place, &record).unwrap();
        }
        let mut next = 0u64;
        let collect = |bytes: &[u8]| {
            for record in bytes.chunks_exact(4096) {
                assert_eq!(record[..8], next.to_le_bytes());
                next += 1;
            }
            Ok(())
        };
        shuffler.drain(collect).unwrap();
        assert_eq!(next, n);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}
