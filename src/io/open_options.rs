//! Settings for opening an input: folder for unpacking, memory, strictness.

use crate::io::ply::ReadOptions;
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
}

impl StageOptions {
    /// Strict reading with 256 MiB for sorting.
    pub fn new(temp_dir: impl Into<PathBuf>) -> Self {
        let temp_dir = temp_dir.into();
        StageOptions { temp_dir, memory_bytes: 256 << 20, read: ReadOptions::default() }
    }
}
