//! Arrays of NumPy in files (`.npy`): little-endian numbers of one or two dimensions, row by row.
//!
//! The format is that of numpy.lib.format. Several arrays may lie in one file, one behind the other, as `numpy.save` leaves
//! them.

use crate::ply::raw::{RawFile, Spool};
use std::path::Path;
use stonecut_system::error::{Error, Result};
use stonecut_system::first_bytes::ARRAY_MAGIC as MAGIC;
use stonecut_system::progress::Progress;

/// Headers are not longer than this: their length has 2 bytes in version 1.
const MOST_HEADER_BYTES: u64 = 1 << 16;

/// Bytes of a column that are read at a time.
const BLOCK_BYTES: usize = 1 << 20;

/// Type of an element: `<f4`, `<i8`, `|u1` and their like.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NpyType {
    /// `f`, `i`, `u` or `b`.
    pub kind: char,
    /// Bytes of an element, at most 8.
    pub bytes: usize,
}

impl NpyType {
    fn parse(text: &str) -> Option<NpyType> {
        let mut letters = text.chars();
        let (order, kind) = (letters.next()?, letters.next()?);
        let bytes = letters.as_str().parse().ok()?;
        let is_known = match kind {
            'f' => [4, 8].contains(&bytes),
            'i' | 'u' => [1, 2, 4, 8].contains(&bytes),
            'b' => bytes == 1,
            _ => false,
        };
        let is_little = order == '<' || (order == '|' && bytes == 1);
        (is_known && is_little).then_some(NpyType { kind, bytes })
    }

    /// The name in a header.
    pub fn name(self) -> String {
        let order = if self.bytes == 1 { '|' } else { '<' };
        format!("{order}{}{}", self.kind, self.bytes)
    }

    /// The number that these bits stand for.
    pub fn value(self, bits: u64) -> f64 {
        let unused = 64 - 8 * self.bytes as u32;
        match (self.kind, self.bytes) {
            ('f', 4) => f64::from(f32::from_bits(bits as u32)),
            ('f', _) => f64::from_bits(bits),
            ('i', _) => ((bits << unused) as i64 >> unused) as f64,
            _ => bits as f64,
        }
    }

    /// The bits of a number, rounded to a whole one where the type has only these.
    pub fn bits(self, value: f64) -> u64 {
        match (self.kind, self.bytes) {
            ('f', 4) => u64::from((value as f32).to_bits()),
            ('f', _) => value.to_bits(),
            ('i', _) => value.round() as i64 as u64,
            _ => value.round() as u64,
        }
    }

    /// Bits of what is not known: not a number, or 0.
    pub fn unknown(self) -> u64 {
        if self.kind == 'f' { self.bits(f64::NAN) } else { 0 }
    }
}

/// Header of an array, which its elements follow.
pub fn header(type_name: &str, shape: &[u64]) -> Vec<u8> {
    let shape: String = shape.iter().map(|n| format!("{n}, ")).collect();
    let shape = shape.trim_end();
    let mut text =
        format!("{{'descr': '{type_name}', 'fortran_order': False, 'shape': ({shape}), }}");
    // Elements begin at a multiple of 64.
    let padding = 63 - (MAGIC.len() + 4 + text.len()) % 64;
    text.extend(std::iter::repeat_n(' ', padding));
    text.push('\n');
    let mut out = MAGIC.to_vec();
    out.extend_from_slice(&[1, 0]);
    out.extend_from_slice(&(text.len() as u16).to_le_bytes());
    out.extend_from_slice(text.as_bytes());
    out
}

/// An array in a file.
pub struct NpyArray {
    file: RawFile,
    start: u64,
    /// Rows that lie together column by column; one as NumPy has them.
    strip_rows: u64,
    /// Type of the elements.
    pub element: NpyType,
    /// Rows, and elements in each.
    pub shape: [u64; 2],
    /// True if the array has one dimension.
    pub is_flat: bool,
}

impl NpyArray {
    /// Opens the array at `offset` of a file; the first lies at 0, the next where the one before ends.
    ///
    /// Errors: `BadInput` for what is not such an array, or has another form than stonecut reads.
    pub fn open(path: &Path, offset: u64) -> Result<NpyArray> {
        let file = RawFile::open(path)?;
        let mut head = vec![0; (file.len().saturating_sub(offset)).min(MOST_HEADER_BYTES) as usize];
        file.read_exact_at(&mut head, offset)?;
        let bad = |what: &str| Error::bad_input(path, format!("byte {offset}: {what}"));
        let rest = head.strip_prefix(MAGIC).ok_or_else(|| bad("not an array of NumPy (.npy)"))?;
        let (length, begin): (usize, usize) = match rest {
            [1, 0, a, b, ..] => (usize::from(u16::from_le_bytes([*a, *b])), 4),
            [2 | 3, 0, a, b, c, d, ..] => (u32::from_le_bytes([*a, *b, *c, *d]) as usize, 6),
            _ => return Err(bad("an array of NumPy of a version that is not known")),
        };
        let text = rest.get(begin..begin.saturating_add(length));
        let text = text.and_then(|text| std::str::from_utf8(text).ok());
        let text = text.ok_or_else(|| bad("the header of the array is cut off"))?;
        let after = |key: &str| {
            let (_, rest) = text.split_once(&format!("'{key}':"))?;
            Some(rest.trim_start())
        };
        let element = after("descr").and_then(|rest| rest.strip_prefix('\'')?.split_once('\''));
        let element = element.and_then(|(name, _)| NpyType::parse(name)).ok_or_else(|| {
            bad("elements must be little-endian f4, f8, or integers of 1 to 8 bytes: convert it with astype()")
        })?;
        let shape = after("shape").and_then(|rest| rest.strip_prefix('(')?.split_once(')'));
        let shape = shape.map(|(inner, _)| {
            let numbers = inner.split(',').map(str::trim).filter(|number| !number.is_empty());
            numbers.map(str::parse).collect::<std::result::Result<Vec<u64>, _>>()
        });
        let (shape, is_flat) = match shape {
            Some(Ok(shape)) if shape.len() == 1 => ([shape[0], 1], true),
            Some(Ok(shape)) if shape.len() == 2 && shape[1] > 0 => ([shape[0], shape[1]], false),
            _ => return Err(bad("the array must have one dimension, or a row for each vertex")),
        };
        if shape[1] > 1 && !after("fortran_order").is_some_and(|rest| rest.starts_with("False")) {
            return Err(bad(
                "the array lies column by column: copy it with numpy.ascontiguousarray()",
            ));
        }
        let start = offset + (MAGIC.len() + begin + length) as u64;
        let bytes =
            shape[0].checked_mul(shape[1]).and_then(|n| n.checked_mul(element.bytes as u64));
        let end = bytes.and_then(|bytes| start.checked_add(bytes));
        if end.is_none_or(|end| end > file.len()) {
            return Err(bad("the file is shorter than the array that its header names"));
        }
        let strip_rows = if shape[1] == 1 { shape[0].max(1) } else { 1 };
        Ok(NpyArray { file, start, strip_rows, element, shape, is_flat })
    }

    /// Length of the file.
    pub fn file_bytes(&self) -> u64 {
        self.file.len()
    }

    /// Bytes of a row.
    pub fn row_bytes(&self) -> u64 {
        self.shape[1] * self.element.bytes as u64
    }

    /// The same array with its elements in strips of many rows, column by column, so that reading one column after the other reads
    /// everything once. A copy in a nameless file of `folder` where there are several columns.
    ///
    /// Memory: three times `memory_bytes`, in which a row must have room.
    pub fn by_columns(
        self,
        folder: &Path,
        memory_bytes: u64,
        progress: &Progress,
    ) -> Result<NpyArray> {
        let [n_rows, n_columns] = self.shape;
        if n_columns == 1 {
            return Ok(self);
        }
        let row_bytes = self.row_bytes();
        let strip_rows = (memory_bytes / row_bytes).clamp(1, n_rows.max(1));
        let mut out = Spool::new(folder).within(memory_bytes);
        let mut columns = Vec::new();
        let range = self.start..self.start + n_rows * row_bytes;
        self.file.each_piece(range, (strip_rows * row_bytes) as usize, |rows| {
            progress.check()?;
            transpose(rows, n_columns as usize, self.element.bytes, &mut columns);
            out.write(&columns)
        })?;
        let file = out.finish(self.file.path())?;
        Ok(NpyArray { file, start: 0, strip_rows, ..self })
    }

    /// Place of an element in the file, and the number of rows from it on whose elements of this column follow.
    fn place(&self, row: u64, column: u64) -> (u64, u64) {
        let first = row / self.strip_rows * self.strip_rows;
        let n = self.strip_rows.min(self.shape[0] - first);
        let number = first * self.shape[1] + column * n + (row - first);
        (self.start + number * self.element.bytes as u64, first + n - row)
    }

    /// The byte behind the last element.
    pub fn end(&self) -> u64 {
        self.start + self.shape[0] * self.shape[1] * self.element.bytes as u64
    }

    /// The elements of a column, read block by block.
    pub fn column(&self, column: u64) -> NpyColumn<'_> {
        NpyColumn { array: self, column, block: Vec::new(), first: 0 }
    }

    /// Calls `each` with every row's number and the bits of its element in this column, in order.
    pub fn each(&self, column: u64, mut each: impl FnMut(u64, u64) -> Result<()>) -> Result<()> {
        let mut column = self.column(column);
        (0..self.shape[0]).try_for_each(|row| each(row, column.get(row)?))
    }
}

/// Turns elements of this size that lie row by row into columns; given the number of rows, columns into rows.
pub fn transpose(rows: &[u8], n_columns: usize, element_bytes: usize, columns: &mut Vec<u8>) {
    columns.resize(rows.len(), 0);
    let n_rows = rows.len() / element_bytes / n_columns.max(1);
    for (row, elements) in rows.chunks_exact(n_columns * element_bytes).enumerate() {
        for (column, element) in elements.chunks_exact(element_bytes).enumerate() {
            let at = (column * n_rows + row) * element_bytes;
            columns[at..at + element_bytes].copy_from_slice(element);
        }
    }
}

/// A column of an array: quick as long as rows come in ascending order, and lie column by column.
pub struct NpyColumn<'a> {
    array: &'a NpyArray,
    column: u64,
    /// Elements at hand, from row `first` on.
    block: Vec<u8>,
    first: u64,
}

impl NpyColumn<'_> {
    /// The bits of the element in a row that exists, of which neighbours will not be asked for.
    pub fn get_alone(&mut self, row: u64) -> Result<u64> {
        let mut bits = [0; 8];
        let (place, _) = self.array.place(row, self.column);
        self.array.file.read_exact_at(&mut bits[..self.array.element.bytes], place)?;
        Ok(u64::from_le_bytes(bits))
    }

    /// The bits of the element in a row that exists.
    pub fn get(&mut self, row: u64) -> Result<u64> {
        let bytes = self.array.element.bytes;
        let n_rows = (self.block.len() / bytes) as u64;
        if row < self.first || row >= self.first + n_rows {
            let (place, n) = self.array.place(row, self.column);
            let n = n.min((BLOCK_BYTES / bytes) as u64);
            self.first = row;
            self.block.resize(n as usize * bytes, 0);
            self.array.file.read_exact_at(&mut self.block, place)?;
        }
        let at = (row - self.first) as usize * bytes;
        let mut bits = [0; 8];
        bits[..bytes].copy_from_slice(&self.block[at..at + bytes]);
        Ok(u64::from_le_bytes(bits))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrays_come_back_one_behind_the_other_and_others_are_refused() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let mut bytes = header("<f4", &[3, 2]);
        assert_eq!(bytes.len() % 64, 0);
        (0..6).for_each(|i| bytes.extend_from_slice(&(i as f32).to_le_bytes()));
        bytes.extend(header("|i1", &[2]));
        bytes.extend([255, 3]);
        std::fs::write(file.path(), &bytes).unwrap();
        let first = NpyArray::open(file.path(), 0).unwrap();
        assert_eq!((first.element.name(), first.shape), ("<f4".to_owned(), [3, 2]));
        let second = NpyArray::open(file.path(), first.end()).unwrap();
        let values = |array: &NpyArray, column| {
            let mut out = Vec::new();
            let each = |_, bits| {
                out.push(array.element.value(bits));
                Ok(())
            };
            array.each(column, each).unwrap();
            out
        };
        assert_eq!(values(&first, 1), [1.0, 3.0, 5.0]);
        // Two rows a strip, and all at once.
        for memory_bytes in [16, 1 << 20] {
            let folder = std::env::temp_dir();
            let first = NpyArray::open(file.path(), 0).unwrap();
            let first = first.by_columns(&folder, memory_bytes, &Progress::default()).unwrap();
            assert_eq!(values(&first, 0), [0.0, 2.0, 4.0]);
            assert_eq!(values(&first, 1), [1.0, 3.0, 5.0]);
            let mut alone = first.column(1);
            assert_eq!(first.element.value(alone.get_alone(2).unwrap()), 5.0);
        }
        assert_eq!(values(&second, 0), [-1.0, 3.0]);
        assert_eq!(second.element.bits(-1.4) as u8, 255);
        for (name, shape) in [(">f4", &[3, 2][..]), ("<c8", &[3]), ("<f4", &[9, 9]), ("<f4", &[])] {
            std::fs::write(file.path(), header(name, shape)).unwrap();
            assert_eq!(NpyArray::open(file.path(), 0).err().unwrap().exit_code(), 4, "{name}");
        }
    }
}
