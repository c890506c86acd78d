//! Finds the number within one cell of a vertex of the whole mesh.
//!
//! Vertices of a cell come first in ascending order, those it borrows from others after them. For such a run
//! of ids a bitmap that counts is smaller and nearer than a hash table; what follows the run is hashed.

use stonecut_mesh::global_vertex::GlobalVertex;

const EMPTY: u32 = u32::MAX;

/// Consecutive ids that lie side by side in the table; a power of two.
const GROUP: u64 = 8;

/// A run is mapped bit by bit while it has at least one id among this many; below that it is hashed.
const IDS_PER_WORD: u64 = 64;

/// Presence of 64 consecutive ids, and the number of ids before them.
#[derive(Clone, Copy, Default)]
struct Word {
    bits: u64,
    before: u32,
}

/// A table from distinct global ids to their position in the caller's list of them.
pub struct IdMap {
    capacity: usize,
    /// True if all ids so far were ascending; then nothing but the list itself exists yet.
    is_run: bool,
    /// Lowest id of the run; its bits, if it is dense enough.
    first: u64,
    words: Vec<Word>,
    /// Open addressing for all other ids.
    slots: Vec<u32>,
    shift: u32,
}

impl IdMap {
    /// A table for at most `capacity` ids.
    pub fn with_capacity(capacity: usize) -> Self {
        let (words, slots) = (Vec::new(), Vec::new());
        IdMap { capacity, is_run: true, first: 0, words, slots, shift: 0 }
    }

    /// Bytes that a table of this capacity takes at most: a word for each id of a run, or 6 to 12 bytes for
    /// each hashed one. The ids themselves stay with the caller.
    pub fn bytes(capacity: u64) -> u64 {
        16 * capacity + 64
    }

    /// The index of `id` in `ids`, appended if it is new.
    #[inline]
    pub fn insert(&mut self, id: GlobalVertex, ids: &mut Vec<GlobalVertex>) -> (u32, bool) {
        let index = ids.len() as u32;
        if self.is_run {
            if ids.last().is_none_or(|&last| last < id) {
                ids.push(id);
                return (index, true);
            }
            self.end_run(ids);
        }
        if let Some(found) = self.in_run(id) {
            return (found, false);
        }
        let at = self.probe(id, ids);
        if self.slots[at] != EMPTY {
            return (self.slots[at], false);
        }
        self.slots[at] = index;
        ids.push(id);
        (index, true)
    }

    /// The index of `id` in `ids`, if it is there.
    #[inline]
    pub fn get(&mut self, id: GlobalVertex, ids: &[GlobalVertex]) -> Option<u32> {
        if self.is_run {
            self.end_run(ids);
        }
        self.in_run(id).or_else(|| {
            let found = self.slots[self.probe(id, ids)];
            (found != EMPTY).then_some(found)
        })
    }

    #[cold]
    fn end_run(&mut self, ids: &[GlobalVertex]) {
        self.is_run = false;
        let (first, last) = match (ids.first(), ids.last()) {
            (Some(first), Some(last)) => (first.0, last.0),
            _ => (0, 0),
        };
        let is_dense = (last - first) / IDS_PER_WORD < ids.len() as u64;
        let hashed = self.capacity - if is_dense { ids.len() } else { 0 };
        let n_slots = (hashed + hashed / 2 + 8).next_power_of_two();
        self.slots = vec![EMPTY; n_slots];
        self.shift = 64 - n_slots.trailing_zeros();
        if is_dense {
            self.first = first;
            self.words = vec![Word::default(); ((last - first) / 64 + 1) as usize];
            for &id in ids {
                let place = id.0 - first;
                self.words[(place / 64) as usize].bits |= 1 << (place % 64);
            }
            let mut before = 0;
            for word in &mut self.words {
                word.before = before;
                before += word.bits.count_ones();
            }
        } else {
            for (index, &id) in ids.iter().enumerate() {
                let at = self.probe(id, ids);
                self.slots[at] = index as u32;
            }
        }
    }

    /// The index of `id` if it is one of a run that is mapped bit by bit.
    #[inline]
    fn in_run(&self, id: GlobalVertex) -> Option<u32> {
        let place = id.0.wrapping_sub(self.first);
        let word = self.words.get((place / 64) as usize)?;
        let bit = 1u64 << (place % 64);
        (word.bits & bit != 0).then(|| word.before + (word.bits & (bit - 1)).count_ones())
    }

    /// The slot that holds `id`, or the empty one where it belongs.
    #[inline]
    fn probe(&self, id: GlobalVertex, ids: &[GlobalVertex]) -> usize {
        // Fibonacci hashing spreads runs of ids, the common case, over the whole table; eight neighbours stay
        // together, in one cache line, since whoever asks for one asks for the next.
        let spread = (id.0 / GROUP).wrapping_mul(0x9E37_79B9_7F4A_7C15) >> self.shift;
        let spread = spread & !(GROUP - 1);
        let mask = self.slots.len() - 1;
        let mut at = (spread | (id.0 % GROUP)) as usize & mask;
        while self.slots[at] != EMPTY && ids[self.slots[at] as usize] != id {
            at = (at + 1) & mask;
        }
        at
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Puts ids in, some of them twice, and asks for all of them and for others.
    fn check(given: &[u64], absent: &[u64]) {
        let of = |numbers: &[u64]| numbers.iter().copied().map(GlobalVertex).collect::<Vec<_>>();
        let (given, absent) = (of(given), of(absent));
        let mut ids = Vec::new();
        let mut map = IdMap::with_capacity(given.len());
        for (i, &id) in given.iter().enumerate() {
            assert_eq!(map.insert(id, &mut ids), (i as u32, true));
            if i % 7 == 3 && i > given.len() / 2 {
                assert_eq!(map.insert(given[i / 2], &mut ids), ((i / 2) as u32, false));
            }
        }
        assert_eq!(ids, given);
        for (i, &id) in given.iter().enumerate() {
            assert_eq!(map.get(id, &ids), Some(i as u32));
            assert_eq!(map.insert(id, &mut ids), (i as u32, false));
        }
        absent.iter().for_each(|&id| assert_eq!(map.get(id, &ids), None));
        let bytes = 16 * map.words.len() + 4 * map.slots.len();
        assert!(bytes as u64 <= IdMap::bytes(given.len() as u64), "{bytes}");
    }

    #[test]
    fn every_id_is_found_where_it_was_put() {
        let squares: Vec<u64> = (0..1000).map(|i| i * i).collect();
        check(&squares, &[3, 999 * 999 + 1, u64::MAX]);
        let dense: Vec<u64> = (0..1000).map(|i| 7_000_000_000 + i * 3 + i / 10).collect();
        check(&dense, &[0, 7_000_000_001, 6_999_999_999, u64::MAX]);
        let borrowed = [5u64, 1, 7_000_000_002, u64::MAX - 1, 7_000_900_000];
        check(&[&dense[..], &borrowed].concat(), &[2, u64::MAX]);
        let falling: Vec<u64> = (0..1000).map(|i| (1 << 40) - i * i).collect();
        check(&falling, &[0, 1 << 41]);
        // Across the bounds of 30 and 32 bits, dense, sparse, and borrowed from beyond them.
        for bound in [1u64 << 30, 1 << 32] {
            let dense: Vec<u64> = (bound - 500..bound + 500).collect();
            check(&dense, &[0, bound - 501, bound + 500, bound * 2, bound / 2]);
            let sparse: Vec<u64> = (0..1000).map(|i| bound - 500_000 + i * 997).collect();
            check(&sparse, &[bound - 500_001, 1000, u64::MAX]);
            let borrowed = [bound * 2, bound * 2 - 1, 3, bound + 501, bound - 7_000_000];
            check(&[&dense[..], &borrowed].concat(), &[bound + 500, bound * 2 + 1, 2]);
            // Ids that are the same in their lower bits.
            let alike: Vec<u64> = (1..1000).map(|i| i * bound + 5).collect();
            check(&alike, &[5, bound, bound + 4]);
        }
        check(&[], &[0, 5]);
        check(&[9], &[0, 8, 10]);
    }
}
