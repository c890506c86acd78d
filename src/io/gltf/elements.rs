//! Elements of an accessor: numbers of a type at equal distances in a file, read a block at a time.

use super::json::Accessor;
use crate::materials::Part;
use crate::ply::raw::RawFile;
use std::sync::Arc;
use stonecut_system::error::Result;

/// Elements that are read at once.
pub(super) const BLOCK: u64 = 16_384;

/// Type of a number, and whether integers stand for shares of 1.
#[derive(Clone, Copy)]
pub(super) struct Number {
    pub(super) kind: u32,
    pub(super) normalized: bool,
}

impl Number {
    pub(super) fn of(accessor: &Accessor) -> Number {
        Number { kind: accessor.component_type, normalized: accessor.normalized }
    }

    pub(super) fn bytes(self) -> usize {
        match self.kind {
            5120 | 5121 => 1,
            5122 | 5123 => 2,
            _ => 4,
        }
    }

    /// Makes numbers of some bytes.
    fn read(self, bytes: &[u8], out: &mut Vec<f64>) {
        fn each<const N: usize>(bytes: &[u8], out: &mut Vec<f64>, of: impl Fn([u8; N]) -> f64) {
            out.extend(bytes.as_chunks::<N>().0.iter().map(|&bytes| of(bytes)));
        }
        match self.kind {
            5120 => each(bytes, out, |b| f64::from(i8::from_le_bytes(b))),
            5121 => each(bytes, out, |b| f64::from(u8::from_le_bytes(b))),
            5122 => each(bytes, out, |b| f64::from(i16::from_le_bytes(b))),
            5123 => each(bytes, out, |b| f64::from(u16::from_le_bytes(b))),
            5125 => each(bytes, out, |b| f64::from(u32::from_le_bytes(b))),
            _ => each(bytes, out, |b| f64::from(f32::from_le_bytes(b))),
        }
        if self.normalized {
            let most = match self.kind {
                5120 => 127.0,
                5121 => 255.0,
                5122 => 32_767.0,
                5123 => 65_535.0,
                _ => 1.0,
            };
            out.iter_mut().for_each(|value| *value = (*value / most).max(-1.0));
        }
    }
}

/// Elements of an accessor.
#[derive(Clone)]
pub(super) struct Elements {
    pub(super) file: Arc<RawFile>,
    pub(super) offset: u64,
    /// Bytes from one to the next.
    pub(super) stride: u64,
    pub(super) number: Number,
    pub(super) n_numbers: usize,
    pub(super) count: u64,
    /// True if there is no data, and every number is 0.
    pub(super) is_zero: bool,
}

impl Elements {
    /// The same as colours: integers are shares of what their type holds, as glTF demands, though the file may not say so.
    pub(super) fn into_colours(self) -> Self {
        let number = Number { normalized: true, ..self.number };
        Elements { number, ..self }
    }

    /// Floats that lie in a file of our own.
    #[cfg(feature = "draco")]
    pub(super) fn of_floats(
        file: &Arc<RawFile>,
        offset: u64,
        n_numbers: usize,
        count: u64,
    ) -> Self {
        let number = Number { kind: 5126, normalized: false };
        Elements {
            file: file.clone(),
            offset,
            stride: 4 * n_numbers as u64,
            number,
            n_numbers,
            count,
            is_zero: false,
        }
    }

    /// Indices of 32 bits that lie in a file of our own.
    #[cfg(feature = "draco")]
    pub(super) fn of_indices(file: &Arc<RawFile>, offset: u64, count: u64) -> Self {
        let number = Number { kind: 5125, normalized: false };
        Elements {
            file: file.clone(),
            offset,
            stride: 4,
            number,
            n_numbers: 1,
            count,
            is_zero: false,
        }
    }

    /// Returns whether these are numbers that can count.
    pub(super) fn is_unsigned(&self) -> bool {
        matches!(self.number.kind, 5121 | 5123 | 5125) && !self.number.normalized
    }

    /// The numbers of up to `BLOCK` elements from `first`.
    pub(super) fn read(&self, first: u64, bytes: &mut Vec<u8>, out: &mut Vec<f64>) -> Result<()> {
        out.clear();
        self.read_bytes(first, bytes)?;
        self.number.read(bytes, out);
        Ok(())
    }

    /// The bytes of up to `BLOCK` elements from `first`, one element behind the other.
    pub(super) fn read_bytes(&self, first: u64, bytes: &mut Vec<u8>) -> Result<()> {
        bytes.clear();
        let n = self.count.saturating_sub(first).min(BLOCK);
        let (size, stride) = (self.element_bytes(), self.stride as usize);
        if n == 0 || self.is_zero {
            bytes.resize(n as usize * size, 0);
            return Ok(());
        }
        bytes.resize((n as usize - 1) * stride + size, 0);
        self.file.read_exact_at(bytes, self.offset + first * self.stride)?;
        if stride > size {
            (1..n as usize)
                .for_each(|i| bytes.copy_within(i * stride..i * stride + size, i * size));
            bytes.truncate(n as usize * size);
        }
        Ok(())
    }

    /// Bytes of an element.
    pub(super) fn element_bytes(&self) -> usize {
        self.n_numbers * self.number.bytes()
    }

    /// The same elements, one behind the other in another place.
    pub(super) fn at(self, part: Part) -> Elements {
        let stride = self.element_bytes() as u64;
        Elements { file: part.file, offset: part.offset, stride, is_zero: false, ..self }
    }
}
