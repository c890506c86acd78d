//! Values of vertices carried over by a map (`simplify --map`): from the input to the result, or back.
//!
//! Column by column, each by one sort on disk towards the result and two back, so that memory does not grow with the arrays. A
//! vertex of the result that none became takes the value of the nearest vertex that the map names.
//! Sums are taken in the order of the values' bits, which no thread and no budget changes.

use crate::error::{Error, Result};
use crate::io::npy::{self, NpyArray, NpyType};
use crate::io::ply::raw::{RawFile, Spool};
use crate::io::{ExternalSort, halves, whole};
use crate::system::pending_file::{PendingFile, Place};
use crate::system::progress::Progress;
use std::path::{Path, PathBuf};

/// A share of the memory for each of two sorts that live at a time.
const SORT_SHARE: u64 = 4;

/// More memory than this makes sorting no faster.
const MOST_SORT_BYTES: u64 = 256 << 20;

/// Bytes of an element on its way.
const ELEMENT: usize = 8;

/// Direction of a transfer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Towards {
    /// Each vertex of the result gets one value of all that became it.
    Result,
    /// Each vertex of the input gets the value of the vertex that it became.
    Input,
}

/// The value of several.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Merge {
    /// The mean.
    Mean,
    /// The most frequent one; of equally frequent ones that of the least bits.
    Majority,
}

/// Files and options of a transfer.
#[derive(Clone, Debug)]
pub struct Transfer {
    /// A map of `simplify --map`.
    pub map: PathBuf,
    /// An array with a row for each vertex.
    pub values: PathBuf,
    /// Direction.
    pub towards: Towards,
    /// The value of several; by the type of the values if `None`: the mean of floats, the majority of others.
    pub merge: Option<Merge>,
    /// Memory for sorting, in bytes.
    pub memory_bytes: u64,
    /// Folder of nameless temporary files.
    pub temp_dir: PathBuf,
}

/// Counts of a transfer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Transferred {
    /// Rows that were written.
    pub rows: u64,
    /// Columns of each.
    pub columns: u64,
    /// Rows without a value: NaN, or 0 where the type has none.
    pub unknown: u64,
}

/// Carries values over.
///
/// Errors: `BadInput` for files that are not arrays, `Usage` for values that are not of the mesh that the map is from or to.
pub fn transfer(transfer: &Transfer, place: Place, progress: &Progress) -> Result<Transferred> {
    let map = NpyArray::open(&transfer.map, 0)?;
    let back = NpyArray::open(&transfer.map, map.end()).map_err(|_| not_a_map(&transfer.map))?;
    let numbers = NpyType { kind: 'i', bytes: 8 };
    if [&map, &back].iter().any(|array| array.element != numbers || array.shape[1] != 1) {
        return Err(not_a_map(&transfer.map));
    }
    let values = NpyArray::open(&transfer.values, 0)?;
    let (n_input, n_result) = (map.shape[0], back.shape[0]);
    let (wanted, n_rows, of) = match transfer.towards {
        Towards::Result => (n_input, n_result, "input"),
        Towards::Input => (n_result, n_input, "result"),
    };
    let n_given = values.shape[0];
    if n_given != wanted {
        let what = format!(
            "{} has {n_given} rows, and the {of} of the map {wanted} vertices; give a row for each vertex of the {of}",
            transfer.values.display()
        );
        return Err(Error::Usage(what));
    }
    let is_float = values.element.kind == 'f';
    let merge = transfer.merge.unwrap_or(if is_float { Merge::Mean } else { Merge::Majority });
    let columns = TransferredColumns {
        transfer,
        map: &map,
        back: &back,
        values: &values,
        merge,
        progress,
        n_rows,
    };
    let n_columns = values.shape[1];
    progress.begin("transfer", 1, 1, n_columns * (n_input + n_rows));
    let mut done = Transferred { rows: n_rows, columns: n_columns, unknown: 0 };
    let mut made = Vec::new();
    for column in 0..n_columns {
        let (file, unknown) = match transfer.towards {
            Towards::Result => columns.to_result(column)?,
            Towards::Input => columns.to_input(column)?,
        };
        done.unknown = unknown;
        made.push(file);
    }
    let mut out = PendingFile::create(place)?;
    let shape = [n_rows, n_columns];
    // An array of one dimension stays one.
    let shape = if values.is_flat { &shape[..1] } else { &shape[..] };
    out.write(&npy::header(&values.element.name(), shape))?;
    let at_once = 1 << 12;
    let mut buffers = vec![vec![0; at_once * ELEMENT]; made.len()];
    for start in (0..n_rows).step_by(at_once) {
        let n = ((n_rows - start) as usize).min(at_once);
        for (file, buffer) in made.iter().zip(&mut buffers) {
            file.read_exact_at(&mut buffer[..n * ELEMENT], start * ELEMENT as u64)?;
        }
        for row in 0..n {
            for buffer in &buffers {
                out.write(&buffer[row * ELEMENT..][..values.element.bytes])?;
            }
        }
    }
    out.finish()?;
    Ok(done)
}

fn not_a_map(path: &Path) -> Error {
    Error::bad_input(path, "not a map of vertices; 'stonecut simplify --map' writes them")
}

/// One column after the other.
struct TransferredColumns<'a> {
    transfer: &'a Transfer,
    map: &'a NpyArray,
    back: &'a NpyArray,
    values: &'a NpyArray,
    merge: Merge,
    progress: &'a Progress,
    n_rows: u64,
}

impl TransferredColumns<'_> {
    fn sort(&self) -> ExternalSort<4> {
        let bytes = (self.transfer.memory_bytes / SORT_SHARE).clamp(1 << 20, MOST_SORT_BYTES);
        ExternalSort::new(&self.transfer.temp_dir, bytes as usize)
    }

    /// The elements of all rows of the output, from some in ascending order of their rows; and the number of rows without.
    fn rows(
        &self,
        fill: impl FnOnce(&mut dyn FnMut(u64, u64) -> Result<()>) -> Result<()>,
    ) -> Result<(RawFile, u64)> {
        let (mut out, mut next, mut n_unknown) = (Spool::new(&self.transfer.temp_dir), 0, 0);
        let unknown = self.values.element.unknown().to_le_bytes();
        let mut skip_to = |row: u64, out: &mut Spool| {
            n_unknown += row - next;
            (next..row).try_for_each(|_| out.write(&unknown))?;
            next = row + 1;
            Ok::<(), Error>(())
        };
        fill(&mut |row, bits| {
            skip_to(row, &mut out)?;
            self.progress.add(1);
            out.write(&bits.to_le_bytes())
        })?;
        skip_to(self.n_rows, &mut out)?;
        Ok((out.finish(&self.transfer.temp_dir)?, n_unknown))
    }

    /// Rows of the map in pairs with `values`, those that lead somewhere.
    fn targets(&self, mut each: impl FnMut(u64, u64) -> Result<()>) -> Result<()> {
        let limit = match self.transfer.towards {
            Towards::Result => self.n_rows,
            Towards::Input => self.values.shape[0],
        };
        self.map.each(0, |vertex, target| {
            if vertex % (1 << 16) == 0 {
                self.progress.check()?;
            }
            self.progress.add(1);
            match target {
                _ if (target as i64) < 0 => Ok(()),
                _ if target < limit => each(vertex, target),
                _ => Err(not_a_map(&self.transfer.map)),
            }
        })
    }

    fn to_result(&self, column: u64) -> Result<(RawFile, u64)> {
        // Both arrays are read block by block, in step.
        let mut values = self.values.column(column);
        let mut by_target = self.sort();
        self.targets(|vertex, target| {
            let ([a, b], [c, d]) = (halves(target), halves(values.get(vertex)?));
            by_target.push([a, b, c, d])
        })?;
        let (mut back, element) = (self.back.column(0), self.values.element);
        self.rows(|put| {
            let mut next = 0;
            let mut put = |row: u64, bits: Option<u64>| {
                for new in next..row {
                    let nearest = back.get(new)?;
                    if nearest < self.values.shape[0] {
                        put(new, values.get_alone(nearest)?)?;
                    }
                }
                next = row + 1;
                bits.map_or(Ok(()), |bits| put(row, bits))
            };
            let (mut group, mut target) = (ValueGroup::default(), None);
            by_target.drain(|[a, b, c, d]| {
                let row = whole(a, b);
                if let Some(done) = target.replace(row).filter(|done| *done != row) {
                    put(done, Some(group.take(self.merge, element)))?;
                }
                group.add(whole(c, d), element);
                Ok(())
            })?;
            if let Some(done) = target {
                put(done, Some(group.take(self.merge, element)))?;
            }
            put(self.n_rows, None)
        })
    }

    fn to_input(&self, column: u64) -> Result<(RawFile, u64)> {
        let mut by_target = self.sort();
        self.targets(|vertex, target| {
            let ([a, b], [c, d]) = (halves(target), halves(vertex));
            by_target.push([a, b, c, d])
        })?;
        let (mut values, mut by_vertex) = (self.values.column(column), self.sort());
        by_target.drain(|[a, b, c, d]| {
            let [e, f] = halves(values.get(whole(a, b))?);
            by_vertex.push([c, d, e, f])
        })?;
        self.rows(|put| by_vertex.drain(|[a, b, c, d]| put(whole(a, b), whole(c, d))))
    }
}

/// The values of one vertex, in the order of their bits.
#[derive(Default)]
struct ValueGroup {
    sum: f64,
    n: u64,
    /// Bits of the last value and how often it came; the most frequent one before.
    last: (u64, u64),
    most: (u64, u64),
}

impl ValueGroup {
    fn add(&mut self, bits: u64, element: NpyType) {
        self.sum += element.value(bits);
        self.n += 1;
        if self.n == 1 || self.last.0 != bits {
            self.last = (bits, 0);
        }
        self.last.1 += 1;
        if self.last.1 > self.most.1 {
            self.most = self.last;
        }
    }

    /// The value of all, and an empty group again.
    fn take(&mut self, merge: Merge, element: NpyType) -> u64 {
        let ValueGroup { sum, n, most, .. } = std::mem::take(self);
        match merge {
            Merge::Mean => element.bits(sum / n as f64),
            Merge::Majority => most.0,
        }
    }
}
