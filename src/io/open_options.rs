//! Settings for opening an input: folder for unpacking, memory, strictness.

use super::external_sort::ExternalSort;
use crate::io::ply::ReadOptions;
use crate::io::ply::raw::Spool;
use crate::system::disk::Disk;
use std::path::PathBuf;

/// Settings for staging an input.
#[derive(Clone, Debug)]
pub struct StageOptions {
    /// The folder for staged data; up to the size of the input, decompressed, and for STL three times
    /// that for a while.
    pub temp_dir: PathBuf,
    /// Memory for sorting the corners of an STL file; at least 3 MiB are sensible.
    pub memory_bytes: u64,
    /// Strictness of reading; its `temp_dir` is set to the one above.
    pub read: ReadOptions,
    /// The disk whose account staged data is part of.
    pub disk: Disk,
}

impl StageOptions {
    /// Strict reading with 256 MiB for sorting.
    pub fn new(temp_dir: impl Into<PathBuf>) -> Self {
        let temp_dir = temp_dir.into();
        let read = ReadOptions::default();
        StageOptions { temp_dir, memory_bytes: 256 << 20, read, disk: Disk::default() }
    }

    /// An empty spool in the folder for staged data.
    pub(crate) fn spool(&self) -> Spool {
        Spool::new(&self.temp_dir).counted(&self.disk)
    }

    /// An empty sort in the folder for staged data.
    pub(crate) fn sort<const N: usize>(&self, memory_bytes: usize) -> ExternalSort<N> {
        ExternalSort::new(&self.temp_dir, memory_bytes).counted(&self.disk)
    }
}
