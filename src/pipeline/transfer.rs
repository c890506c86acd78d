//! Values of vertices carried over by a map (`simplify --map`): from the input to the result, or back.
//!
//! Column by column, each by one sort on disk towards the result and two back, so that memory does not grow with the arrays; values
//! of several columns are turned on disk before, and the result afterwards, so that time does not grow with the square of the columns. A
//! vertex of the result that none became takes the value of the nearest vertex that the map names. A map is checked once, before.
//! Sums are taken in the order of the values' bits, which no thread and no budget changes.

use crate::error::{Error, Result};
use crate::io::npy::{self, NpyArray, NpyType};
use crate::io::ply::raw::Spool;
use crate::io::{ExternalSort, halves, whole};
use crate::system::memory::BASE_BYTES;
use crate::system::pending_file::{PendingFile, Place};
use crate::system::progress::Progress;
use crate::system::units::{memory_word, show_bytes};
use std::path::PathBuf;

/// A share of the memory for each of two sorts that live at a time.
const SORT_SHARE: u64 = 4;

/// A share of the memory for each of three buffers of rows.
const ROWS_SHARE: u64 = 8;

/// Memory beside `BASE_BYTES` with which sorts and columns have their smallest buffers.
const LEAST_BYTES: u64 = 8 << 20;

/// More memory than this makes sorting no faster.
const MOST_SORT_BYTES: u64 = 256 << 20;

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
/// Errors: `BadInput` for files that are not arrays or no sound map, `Usage` for values that are not of the mesh that the map is from or
/// to, `NoMemory` for a budget that has no room for a row.
pub fn transfer(transfer: &Transfer, place: Place, progress: &Progress) -> Result<Transferred> {
    let maps = OpenMap::open(transfer)?;
    let values = NpyArray::open(&transfer.values, 0)?;
    let (n_input, n_result) = (maps.there.shape[0], maps.back.shape[0]);
    let (wanted, n_rows, of, other) = match transfer.towards {
        Towards::Result => (n_input, n_result, "input", "--to input"),
        Towards::Input => (n_result, n_input, "result", "--to result"),
    };
    let n_given = values.shape[0];
    if n_given != wanted {
        let remedy = match n_given == n_rows {
            true => format!("give {other} for values of the other mesh"),
            false => format!("give a row for each vertex of the {of}, or the map of this mesh"),
        };
        let what = format!(
            "{} has {n_given} rows, and the {of} of the map {wanted} vertices; {remedy}",
            transfer.values.display()
        );
        return Err(Error::Usage(what));
    }
    let row_bytes = values.row_bytes();
    let least = LEAST_BYTES.max(ROWS_SHARE * row_bytes);
    let memory_bytes = transfer.memory_bytes.saturating_sub(BASE_BYTES);
    if memory_bytes < least {
        return Err(Error::NoMemory(format!(
            "a memory budget of {} is too small for rows of {}; give at least --memory {}",
            show_bytes(transfer.memory_bytes),
            show_bytes(row_bytes),
            memory_word(BASE_BYTES + least)
        )));
    }
    let (element, is_flat, n_columns) = (values.element, values.is_flat, values.shape[1]);
    progress.begin("transfer", 1, 1, (n_columns + 1) * n_input + n_columns * n_rows);
    let rows_bytes = memory_bytes / ROWS_SHARE;
    let means = Means { transfer, memory_bytes, progress };
    maps.check(&means)?;
    let values = values.by_columns(&transfer.temp_dir, rows_bytes, progress)?;
    let by_type = if element.kind == 'f' { Merge::Mean } else { Merge::Majority };
    let merge = transfer.merge.unwrap_or(by_type);
    let columns = TransferredColumns { means, maps: &maps, values: &values, merge, n_rows };
    let mut done = Transferred { rows: n_rows, columns: n_columns, unknown: 0 };
    let mut made = Spool::new(&transfer.temp_dir).within(rows_bytes);
    for column in 0..n_columns {
        done.unknown = match transfer.towards {
            Towards::Result => columns.to_result(column, &mut made)?,
            Towards::Input => columns.to_input(column, &mut made)?,
        };
    }
    let made = made.finish(&transfer.temp_dir)?;
    let mut out = PendingFile::create(place)?;
    let shape = [n_rows, n_columns];
    // An array of one dimension stays one.
    let shape = if is_flat { &shape[..1] } else { &shape[..] };
    out.write(&npy::header(&element.name(), shape))?;
    let at_once = (rows_bytes / row_bytes).clamp(1, 1 << 20);
    let (mut turned, mut rows) = (Vec::new(), Vec::new());
    for first in (0..n_rows).step_by(at_once as usize) {
        progress.check()?;
        let n = (n_rows - first).min(at_once);
        turned.resize((n * row_bytes) as usize, 0);
        let bytes = element.bytes as u64;
        for (column, part) in (0..).zip(turned.chunks_exact_mut((n * bytes) as usize)) {
            made.read_exact_at(part, (n_rows * column + first) * bytes)?;
        }
        npy::transpose(&turned, n as usize, element.bytes, &mut rows);
        out.write(&rows)?;
    }
    out.finish()?;
    Ok(done)
}

/// The means of a transfer.
#[derive(Clone, Copy)]
struct Means<'a> {
    transfer: &'a Transfer,
    /// Without `BASE_BYTES`.
    memory_bytes: u64,
    progress: &'a Progress,
}

impl Means<'_> {
    fn sort(&self) -> ExternalSort<4> {
        let bytes = (self.memory_bytes / SORT_SHARE).min(MOST_SORT_BYTES);
        ExternalSort::new(&self.transfer.temp_dir, bytes as usize)
    }

    fn bad_map(&self, what: String) -> Error {
        let what = format!("{what}; make the map again with 'stonecut simplify --map'");
        Error::bad_input(&self.transfer.map, what)
    }

    /// Rows of the map in pairs with numbers of the result, those that lead somewhere.
    fn targets(
        &self,
        there: &NpyArray,
        mut each: impl FnMut(u64, u64) -> Result<()>,
    ) -> Result<()> {
        there.each(0, |vertex, target| {
            if vertex % (1 << 16) == 0 {
                self.progress.check()?;
            }
            self.progress.add(1);
            if (target as i64) < 0 { Ok(()) } else { each(vertex, target) }
        })
    }
}

/// The two arrays of a map.
struct OpenMap {
    there: NpyArray,
    back: NpyArray,
}

impl OpenMap {
    fn open(transfer: &Transfer) -> Result<OpenMap> {
        let not_a_map = |what: &str| {
            let what =
                format!("not a map of vertices, {what}; 'stonecut simplify --map' writes them");
            Error::bad_input(&transfer.map, what)
        };
        let there = NpyArray::open(&transfer.map, 0)?;
        if there.end() == there.file_bytes() {
            return Err(not_a_map("which has two arrays"));
        }
        let back = NpyArray::open(&transfer.map, there.end())
            .map_err(|_| not_a_map("which has a second array behind the first"))?;
        let numbers = NpyType { kind: 'i', bytes: 8 };
        if [&there, &back].iter().any(|array| array.element != numbers || array.shape[1] != 1) {
            return Err(not_a_map("whose arrays are whole numbers of 8 bytes (<i8)"));
        }
        if back.end() != back.file_bytes() {
            return Err(not_a_map("which ends with its second array"));
        }
        Ok(OpenMap { there, back })
    }

    /// Refuses a number that is not a vertex, and a second array that does not lead to what became a vertex.
    fn check(&self, means: &Means) -> Result<()> {
        let [n_input, n_result] = [&self.there, &self.back].map(|array| array.shape[0]);
        let hold = |row: u64, number: u64, (which, of, n): (&str, &str, u64)| {
            if number as i64 == -1 || number < n {
                return Ok(());
            }
            Err(means.bad_map(format!(
                "row {row} of its {which} array is {}: not -1, and not a vertex of the {of}, which has {n}",
                number as i64
            )))
        };
        self.back.each(0, |row, vertex| hold(row, vertex, ("second", "input", n_input)))?;
        self.there.each(0, |row, number| hold(row, number, ("first", "result", n_result)))?;
        let mut by_target = means.sort();
        means.targets(&self.there, |vertex, target| {
            let ([a, b], [c, d]) = (halves(target), halves(vertex));
            by_target.push([a, b, c, d])
        })?;
        // The row at work, the vertex that it names, and if that was among those that became it.
        let (mut origins, mut group) = (self.back.column(0), None::<(u64, u64, bool)>);
        let settle = |group: Option<(u64, u64, bool)>| {
            match group {
            Some((row, named, false)) => Err(means.bad_map(format!(
                "row {row} of its second array names vertex {}, which did not become vertex {row} of the result by the first array",
                named as i64
            ))),
            _ => Ok(()),
        }
        };
        by_target.drain(|[a, b, c, d]| {
            let target = whole(a, b);
            if group.is_none_or(|(row, ..)| row != target) {
                settle(group)?;
                group = Some((target, origins.get(target)?, false));
            }
            if let Some((_, named, is_found)) = &mut group {
                *is_found |= *named == whole(c, d);
            }
            Ok(())
        })?;
        settle(group)
    }
}

/// One column after the other.
struct TransferredColumns<'a> {
    means: Means<'a>,
    maps: &'a OpenMap,
    /// Column by column.
    values: &'a NpyArray,
    merge: Merge,
    n_rows: u64,
}

impl TransferredColumns<'_> {
    /// Writes the elements of all rows of a column, from some in ascending order of their rows; gives the number of rows without.
    fn rows(
        &self,
        out: &mut Spool,
        fill: impl FnOnce(&mut dyn FnMut(u64, u64) -> Result<()>) -> Result<()>,
    ) -> Result<u64> {
        let (mut next, mut n_unknown) = (0, 0);
        let element = self.values.element;
        let unknown = element.unknown().to_le_bytes();
        let mut skip_to = |row: u64, out: &mut Spool| {
            n_unknown += row - next;
            (next..row).try_for_each(|_| out.write(&unknown[..element.bytes]))?;
            next = row + 1;
            Ok::<(), Error>(())
        };
        fill(&mut |row, bits| {
            skip_to(row, out)?;
            self.means.progress.add(1);
            out.write(&bits.to_le_bytes()[..element.bytes])
        })?;
        skip_to(self.n_rows, out)?;
        Ok(n_unknown)
    }

    fn to_result(&self, column: u64, out: &mut Spool) -> Result<u64> {
        // Both arrays are read block by block, in step.
        let mut values = self.values.column(column);
        let mut by_target = self.means.sort();
        self.means.targets(&self.maps.there, |vertex, target| {
            let ([a, b], [c, d]) = (halves(target), halves(values.get(vertex)?));
            by_target.push([a, b, c, d])
        })?;
        let (mut back, element) = (self.maps.back.column(0), self.values.element);
        self.rows(out, |put| {
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

    fn to_input(&self, column: u64, out: &mut Spool) -> Result<u64> {
        let mut by_target = self.means.sort();
        self.means.targets(&self.maps.there, |vertex, target| {
            let ([a, b], [c, d]) = (halves(target), halves(vertex));
            by_target.push([a, b, c, d])
        })?;
        let (mut values, mut by_vertex) = (self.values.column(column), self.means.sort());
        by_target.drain(|[a, b, c, d]| {
            let [e, f] = halves(values.get(whole(a, b))?);
            by_vertex.push([c, d, e, f])
        })?;
        self.rows(out, |put| by_vertex.drain(|[a, b, c, d]| put(whole(a, b), whole(c, d))))
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
