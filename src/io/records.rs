//! NumberRecords of whole numbers in temporary files, read one after the other.

use crate::ply::raw::RawFile;
use stonecut_system::error::Result;

/// Bytes that are read at once.
const WINDOW: usize = 1 << 16;

/// The records of a file in turn; `next` is the one at hand.
pub(crate) struct NumberRecords<const N: usize> {
    file: RawFile,
    window: Vec<[u64; N]>,
    /// The record behind those of the window, and the place in it.
    read: u64,
    place: usize,
}

impl<const N: usize> NumberRecords<N> {
    pub fn new(file: RawFile) -> Result<NumberRecords<N>> {
        let mut records = NumberRecords { file, window: Vec::new(), read: 0, place: 0 };
        records.fill()?;
        Ok(records)
    }

    pub fn len(&self) -> u64 {
        self.file.len() / (8 * N as u64)
    }

    /// Begins again.
    pub fn restart(&mut self) -> Result<()> {
        self.read = 0;
        self.fill()
    }

    pub fn next(&self) -> Option<[u64; N]> {
        self.window.get(self.place).copied()
    }

    pub fn pass(&mut self) -> Result<()> {
        self.place += 1;
        if self.place < self.window.len() { Ok(()) } else { self.fill() }
    }

    /// A record by its number.
    pub fn get(&self, number: u64) -> Result<[u64; N]> {
        let mut record = [0u64; N];
        let bytes = bytemuck::cast_slice_mut(&mut record);
        self.file.read_exact_at(bytes, number * 8 * N as u64)?;
        Ok(record)
    }

    fn fill(&mut self) -> Result<()> {
        let n = (self.len() - self.read).min((WINDOW / (8 * N)) as u64);
        self.window.resize(n as usize, [0; N]);
        let bytes = bytemuck::cast_slice_mut(self.window.as_flattened_mut());
        self.file.read_exact_at(bytes, self.read * 8 * N as u64)?;
        (self.read, self.place) = (self.read + n, 0);
        Ok(())
    }
}
