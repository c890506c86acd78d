//! Records of whole numbers in temporary files, read one after the other.

use crate::ply::raw::RawFile;
use crate::ply::row_window::RowWindow;
use std::borrow::Borrow;
use stonecut_system::error::Result;

/// The records of a file in turn; `next` is the one at hand.
pub struct NumberRecords<const N: usize, F = RawFile> {
    rows: RowWindow<F>,
    /// The number of `next`.
    place: u64,
    next: Option<[u64; N]>,
}

impl<const N: usize, F: Borrow<RawFile>> NumberRecords<N, F> {
    /// Begins with the first.
    pub fn new(file: F) -> Result<NumberRecords<N, F>> {
        let rows = RowWindow::new(file, 8 * N);
        let mut records = NumberRecords { rows, place: 0, next: None };
        records.restart()?;
        Ok(records)
    }

    /// Their number.
    #[allow(clippy::len_without_is_empty)] // A length, not a count.
    pub fn len(&self) -> u64 {
        self.rows.n_rows()
    }

    /// Begins again.
    pub fn restart(&mut self) -> Result<()> {
        self.place = 0;
        self.load()
    }

    /// The one at hand; none behind the last.
    #[inline]
    pub fn next(&self) -> Option<[u64; N]> {
        self.next
    }

    /// Goes on to the one after it.
    #[inline]
    pub fn pass(&mut self) -> Result<()> {
        self.place += 1;
        self.load()
    }

    /// A record by its number.
    pub fn get(&self, number: u64) -> Result<[u64; N]> {
        let mut record = [0u64; N];
        let bytes = bytemuck::cast_slice_mut(&mut record);
        self.rows.file().read_exact_at(bytes, number * 8 * N as u64)?;
        Ok(record)
    }

    /// Calls `each` with all from the one at hand on.
    pub fn each(mut self, mut each: impl FnMut([u64; N]) -> Result<()>) -> Result<()> {
        while let Some(record) = self.next {
            each(record)?;
            self.pass()?;
        }
        Ok(())
    }

    #[inline]
    fn load(&mut self) -> Result<()> {
        self.next = None;
        if self.place < self.rows.n_rows() {
            let record = self.next.insert([0; N]);
            bytemuck::cast_slice_mut(record).copy_from_slice(self.rows.get(self.place)?);
        }
        Ok(())
    }
}
