//! Faces as rows of one fixed size: the fast path for triangles in a binary body.
//!
//! Nearly every scan has them. The layout is guessed from the first row (its list counts) and holds only
//! as long as every row read has the same counts; the caller falls back on an index of rows otherwise.

use super::fields::wire_value;
use super::header::{Element, Encoding, Kind, Wire};

/// A list count that every row must repeat.
#[derive(Clone, Copy, Debug)]
struct Count {
    at: usize,
    wire: Wire,
    value: u64,
}

/// Places of the corners of a triangle in a row of fixed size.
#[derive(Clone, Debug)]
pub struct FixedFaces {
    /// Bytes a row.
    pub stride: usize,
    corners_at: usize,
    index: Wire,
    swap: bool,
    /// Offset of the corner count where it is one byte and the only list; the common case.
    single: Option<usize>,
    counts: Vec<Count>,
}

/// Reason why a block ended early.
#[derive(Debug, PartialEq, Eq)]
pub enum BlockEnd {
    /// A row's lists have other lengths than the first row's.
    OtherLayout,
    /// This row of the block names a vertex that does not exist.
    OutOfRange(usize),
}

impl FixedFaces {
    /// The layout of `first_row` (as many of its bytes as there are), if it is a triangle.
    pub fn guess(element: &Element, encoding: Encoding, first_row: &[u8]) -> Option<Self> {
        let list = element.index_list()?;
        let swap = encoding == Encoding::BinaryBigEndian;
        let (mut at, mut counts, mut corners_at, mut index) = (0usize, Vec::new(), 0, None);
        for (i, property) in element.properties.iter().enumerate() {
            match property.kind {
                Kind::Scalar(wire) => at = at.checked_add(wire.bytes() as usize)?,
                Kind::List { count, item } => {
                    let end = at.checked_add(count.bytes() as usize)?;
                    let value = wire_value(count, first_row.get(at..end)?, swap);
                    // Longer lists than this are not a layout to rely on.
                    if !(0.0..=1024.0).contains(&value) || (i == list && value != 3.0) {
                        return None;
                    }
                    counts.push(Count { at, wire: count, value: value as u64 });
                    if i == list {
                        (corners_at, index) = (end, Some(item));
                    }
                    at = end.checked_add(value as usize * item.bytes() as usize)?;
                }
            }
        }
        let index = index?;
        let single = match counts[..] {
            [Count { at, wire, .. }] if wire.bytes() == 1 => Some(at),
            _ => None,
        };
        Some(FixedFaces { stride: at, corners_at, index, swap, single, counts })
    }

    /// Returns whether the corners are the only list, so that the length of a row tells how many there are.
    pub fn has_one_list(&self) -> bool {
        self.counts.len() == 1
    }

    /// Returns whether rows begin as those of a staged file: a count of one byte, corners of four.
    pub fn is_plain(&self) -> bool {
        use stonecut_mesh::property::Scalar::{I32, U32};
        let is_index = matches!(self.index, Wire::Plain(U32 | I32));
        self.single == Some(0) && is_index && !self.swap
    }

    /// Returns whether the list counts of `row` are those of the layout.
    pub fn matches(&self, row: &[u8]) -> bool {
        if let Some(at) = self.single {
            return row[at] == 3;
        }
        self.counts.iter().all(|c| wire_value(c.wire, &row[c.at..], self.swap) == c.value as f64)
    }

    /// Appends the triangles of `rows`; those with repeated corners are left out and counted.
    ///
    /// With `skip_bad`, faces out of range are left out too, and counted in `n_bad`.
    pub fn decode(&self, rows: &[u8], n_vertices: u64, out: &mut Decoded) -> Result<(), BlockEnd> {
        use stonecut_mesh::property::Scalar::{I32, U32};
        match (self.index, self.swap) {
            (Wire::Plain(U32), false) => self
                .rows(rows, n_vertices, out, |b| corners4(b, |v| u64::from(u32::from_le_bytes(v)))),
            // A negative index becomes a huge one, which is out of range.
            (Wire::Plain(I32), false) => {
                self.rows(rows, n_vertices, out, |b| corners4(b, |v| i32::from_le_bytes(v) as u64))
            }
            (Wire::Plain(U32), true) => self
                .rows(rows, n_vertices, out, |b| corners4(b, |v| u64::from(u32::from_be_bytes(v)))),
            (Wire::Plain(I32), true) => {
                self.rows(rows, n_vertices, out, |b| corners4(b, |v| i32::from_be_bytes(v) as u64))
            }
            _ => self.rows(rows, n_vertices, out, |b| {
                [0, 1, 2].map(|i| {
                    wire_index(self.index, &b[i * self.index.bytes() as usize..], self.swap)
                })
            }),
        }
    }

    #[inline(always)]
    fn rows(
        &self,
        rows: &[u8],
        n_vertices: u64,
        out: &mut Decoded,
        load: impl Fn(&[u8]) -> [u64; 3],
    ) -> Result<(), BlockEnd> {
        for (i, row) in rows.chunks_exact(self.stride).enumerate() {
            if !self.matches(row) {
                return Err(BlockEnd::OtherLayout);
            }
            out.row = i as u32;
            let corners = load(&row[self.corners_at..]);
            if corners[0].max(corners[1]).max(corners[2]) >= n_vertices {
                if !out.skip_bad {
                    return Err(BlockEnd::OutOfRange(i));
                }
                out.n_bad += 1;
                continue;
            }
            out.push(corners);
        }
        Ok(())
    }
}

/// Triangles and what was left out on the way.
#[derive(Debug, Default)]
pub struct Decoded {
    pub triangles: Vec<[u64; 3]>,
    pub n_degenerate: u64,
    pub n_bad: u64,
    /// Polygons whose sides cross.
    pub n_crossing: u64,
    pub skip_bad: bool,
    /// Row in the block that is being read, and that of each triangle if they are `tracked`.
    pub row: u32,
    pub rows: Vec<u32>,
    pub tracked: bool,
}

impl Decoded {
    /// Takes a triangle unless a corner repeats.
    #[inline(always)]
    pub fn push(&mut self, corners: [u64; 3]) {
        if corners[0] == corners[1] || corners[1] == corners[2] || corners[2] == corners[0] {
            self.n_degenerate += 1;
        } else {
            self.triangles.push(corners);
            if self.tracked {
                self.rows.push(self.row);
            }
        }
    }

    /// Takes back all triangles but the first `n`.
    pub fn truncate(&mut self, n: usize) {
        self.triangles.truncate(n);
        self.rows.truncate(n);
    }
}

/// Bytes of a row of a staged file before its properties.
pub const PLAIN_BYTES: usize = 13;

/// Three indices of four bytes.
#[inline(always)]
pub fn corners4(bytes: &[u8], load: impl Fn([u8; 4]) -> u64) -> [u64; 3] {
    let bytes: &[u8; 12] = bytes[..12].try_into().expect("12 bytes");
    [0, 4, 8].map(|at| load(bytes[at..at + 4].try_into().expect("4 bytes")))
}

/// An index of any type; one that is negative or not whole becomes `u64::MAX`, which no vertex has.
pub fn wire_index(wire: Wire, bytes: &[u8], swap: bool) -> u64 {
    if !wire.is_integer() {
        let value = wire_value(wire, bytes, swap);
        let is_index = (0.0..9e15).contains(&value) && value.fract() == 0.0;
        return if is_index { value as u64 } else { u64::MAX };
    }
    let n = wire.bytes() as usize;
    let mut little = [0u8; 8];
    little[..n].copy_from_slice(&bytes[..n]);
    if swap {
        little[..n].reverse();
    }
    let raw = u64::from_le_bytes(little);
    let signed = matches!(
        wire,
        Wire::Plain(
            stonecut_mesh::property::Scalar::I8
                | stonecut_mesh::property::Scalar::I16
                | stonecut_mesh::property::Scalar::I32
                | stonecut_mesh::property::Scalar::I64
        )
    );
    if signed && little[n - 1] & 0x80 != 0 { u64::MAX } else { raw }
}
