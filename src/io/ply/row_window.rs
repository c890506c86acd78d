//! Rows of files, a window of them in memory.

use super::raw::RawFile;
use std::borrow::Borrow;
use stonecut_system::error::Result;

/// Bytes that are read at once, or one row.
const WINDOW: usize = 1 << 16;

/// Rows of one size, mostly asked for in order.
pub struct RowWindow<F = RawFile> {
    file: F,
    row_bytes: usize,
    /// The rows at hand.
    first: u64,
    end: u64,
    bytes: Vec<u8>,
}

impl<F: Borrow<RawFile>> RowWindow<F> {
    /// The file is whole rows of `row_bytes`.
    pub fn new(file: F, row_bytes: usize) -> RowWindow<F> {
        RowWindow { file, row_bytes, first: 0, end: 0, bytes: Vec::new() }
    }

    /// The file.
    pub fn file(&self) -> &RawFile {
        self.file.borrow()
    }

    /// The number of rows.
    pub fn n_rows(&self) -> u64 {
        self.file().len() / self.row_bytes as u64
    }

    /// A row that is there.
    #[inline]
    pub fn get(&mut self, row: u64) -> Result<&[u8]> {
        if !(self.first..self.end).contains(&row) {
            self.load(row)?;
        }
        let at = (row - self.first) as usize * self.row_bytes;
        Ok(&self.bytes[at..at + self.row_bytes])
    }

    #[cold]
    fn load(&mut self, row: u64) -> Result<()> {
        // Rows that failed to load must not be taken for loaded ones.
        (self.first, self.end) = (row, row);
        let most = (WINDOW / self.row_bytes).max(1) as u64;
        let n = self.n_rows().saturating_sub(row).clamp(1, most);
        self.bytes.resize(n as usize * self.row_bytes, 0);
        self.file.borrow().read_exact_at(&mut self.bytes, row * self.row_bytes as u64)?;
        self.end = row + n;
        Ok(())
    }
}
