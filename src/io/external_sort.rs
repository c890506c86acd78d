//! Sorting more than fits in memory: sorted runs in a nameless temporary file, then one merge.

use crate::ply::raw::{RawFile, Spool};
use std::cmp::Ordering;
use std::collections::BinaryHeap;
use std::collections::binary_heap::PeekMut;
use std::path::Path;
use stonecut_system::disk::Disk;
use stonecut_system::error::Result;

/// Sorts arrays of `N` numbers, compared from the first on. Equal ones come out next to each other.
///
/// Memory: `memory_bytes` while records come in and again while they go out, whatever their number.
/// Disk: `4 N` bytes a record, only if they do not fit.
pub struct ExternalSort<const N: usize> {
    records: Vec<[u32; N]>,
    max_records: usize,
    spool: Spool,
    /// First place of each run.
    runs: Vec<u64>,
    name: std::path::PathBuf,
}

impl<const N: usize> ExternalSort<N> {
    /// Sorts within `memory_bytes`; runs that do not fit go into `folder`.
    pub fn new(folder: &Path, memory_bytes: usize) -> Self {
        ExternalSort {
            records: Vec::new(),
            max_records: (memory_bytes / (4 * N + place_bytes(N))).clamp(1024, 1 << 31),
            spool: Spool::new(folder),
            runs: Vec::new(),
            name: folder.to_path_buf(),
        }
    }

    /// The same sort, with what it holds of a file in the account of `disk`.
    pub fn counted(self, disk: &Disk) -> Self {
        ExternalSort { spool: self.spool.counted(disk), ..self }
    }

    /// Adds a record. Fails as writing a run does.
    pub fn push(&mut self, record: [u32; N]) -> Result<()> {
        if self.records.len() == self.max_records {
            self.spill()?;
        }
        self.records.push(record);
        Ok(())
    }

    fn spill(&mut self) -> Result<()> {
        // Memory was too small for the records already.
        self.spool.leave_memory()?;
        self.runs.push(self.spool.len());
        let spool = &mut self.spool;
        each_in_order(&mut self.records, |record| spool.write(bytemuck::cast_slice(&record)))?;
        self.records.clear();
        Ok(())
    }

    /// Calls `each` with every record, in order.
    pub fn drain(mut self, mut each: impl FnMut([u32; N]) -> Result<()>) -> Result<()> {
        if self.runs.is_empty() {
            return each_in_order(&mut self.records, each);
        }
        self.spill()?;
        let budget = self.max_records * 4 * N;
        self.records = Vec::new();
        let end = self.spool.len();
        let file = self.spool.finish(&self.name)?;
        // Whole records, and at least a page, however many runs share the memory.
        let buffer = (budget / self.runs.len()).clamp(4096, 1 << 20) / (4 * N) * (4 * N);
        let mut runs: Vec<_> = self
            .runs
            .iter()
            .zip(self.runs[1..].iter().chain([&end]))
            .map(|(&start, &end)| SortedRun::<N> { at: start, end, buffer: Vec::new(), next: 0 })
            .collect();
        let mut heap = BinaryHeap::new();
        for (i, run) in runs.iter_mut().enumerate() {
            if let Some(record) = run.pop(&file, buffer)? {
                heap.push(RunHead { record, run: i });
            }
        }
        while let Some(mut head) = heap.peek_mut() {
            each(head.record)?;
            match runs[head.run].pop(&file, buffer)? {
                Some(record) => head.record = record,
                None => drop(PeekMut::pop(head)),
            }
        }
        Ok(())
    }
}

/// Numbers that come first in the order of a record, and below them its place in 32 bits: compared without a branch.
type SortPlace = u128;

/// Bytes of a place, where records of `n` numbers have one: short ones are moved themselves.
const fn place_bytes(n: usize) -> usize {
    if n <= 4 { 0 } else { size_of::<SortPlace>() }
}

/// Calls `each` with all records in order.
fn each_in_order<const N: usize>(
    records: &mut [[u32; N]],
    mut each: impl FnMut([u32; N]) -> Result<()>,
) -> Result<()> {
    // Four numbers are one of 128 bits, and compared without a branch.
    let number = |words: &[u32]| words.iter().fold(0u128, |all, &x| all << 32 | u128::from(x));
    if place_bytes(N) == 0 {
        records.sort_unstable_by_key(|record| number(record));
        return records.iter().try_for_each(|record| each(*record));
    }
    // The first three numbers that are not the same in all records decide nearly always.
    let mut differ = (0..N).filter(|&k| records.iter().any(|record| record[k] != records[0][k]));
    let [p, q, r] = [0; 3].map(|_| differ.next().unwrap_or(N - 1));
    let place = |(record, i): (&[u32; N], u32)| number(&[record[p], record[q], record[r], i]);
    let mut places: Vec<SortPlace> = records.iter().zip(0..).map(place).collect();
    places.sort_unstable();
    let record = |place: &SortPlace| &records[*place as u32 as usize];
    for equal in places.chunk_by_mut(|a, b| a >> 32 == b >> 32).filter(|equal| equal.len() > 1) {
        equal.sort_unstable_by(|a, b| order(record(a), record(b)));
    }
    places.iter().try_for_each(|place| each(*record(place)))
}

/// The order of two records. Written out, since comparisons of arrays are calls that take a fifth of the time of a sort.
#[inline(always)]
fn order<const N: usize>(a: &[u32; N], b: &[u32; N]) -> Ordering {
    match a.iter().zip(b).find(|(a, b)| a != b) {
        Some((a, b)) => a.cmp(b),
        None => Ordering::Equal,
    }
}

/// The first record of a run; the least one is the greatest in a heap.
struct RunHead<const N: usize> {
    record: [u32; N],
    run: usize,
}

impl<const N: usize> Ord for RunHead<N> {
    #[inline(always)]
    fn cmp(&self, other: &Self) -> Ordering {
        order(&other.record, &self.record).then(other.run.cmp(&self.run))
    }
}

impl<const N: usize> PartialOrd for RunHead<N> {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl<const N: usize> PartialEq for RunHead<N> {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl<const N: usize> Eq for RunHead<N> {}

/// The unread rest of a sorted run.
struct SortedRun<const N: usize> {
    at: u64,
    end: u64,
    buffer: Vec<[u32; N]>,
    next: usize,
}

impl<const N: usize> SortedRun<N> {
    fn pop(&mut self, file: &RawFile, buffer_bytes: usize) -> Result<Option<[u32; N]>> {
        if self.next == self.buffer.len() {
            let n = (self.end - self.at).min(buffer_bytes as u64) as usize;
            self.buffer.resize(n / (4 * N), [0; N]);
            let bytes = bytemuck::cast_slice_mut(self.buffer.as_flattened_mut());
            file.read_exact_at(bytes, self.at)?;
            self.at += n as u64;
            self.next = 0;
        }
        let record = self.buffer.get(self.next).copied();
        self.next += 1;
        Ok(record)
    }
}

/// The high and low half of a 64-bit number, which compare like it.
pub fn halves(value: u64) -> [u32; 2] {
    [(value >> 32) as u32, value as u32]
}

/// The number of its halves.
pub fn whole(high: u32, low: u32) -> u64 {
    u64::from(high) << 32 | u64::from(low)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Short records, and long ones whose first numbers are often the same.
    #[test]
    fn runs_are_merged_in_order() {
        runs::<4>([0, 1, 2, 3]);
        runs::<7>([1, 2, 4, 5]);
    }

    fn runs<const N: usize>(places: [usize; 4]) {
        // 1024 records is the smallest run; 40,000 make 40 of them.
        let mut sort = ExternalSort::<N>::new(&std::env::temp_dir(), 0);
        let mut state = 1u32;
        let mut expected = Vec::new();
        for i in 0..40_000 {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let mut record = [7; N];
            let words = [state >> 28, state & 7, state >> 27 & 1, i];
            places.into_iter().zip(words).for_each(|(k, x)| record[k] = x);
            sort.push(record).unwrap();
            expected.push(record);
        }
        expected.sort_unstable();
        let mut sorted = Vec::new();
        sort.drain(|record| {
            sorted.push(record);
            Ok(())
        })
        .unwrap();
        assert_eq!(sorted, expected);
    }
}
