//! Finds the local index of a global vertex id within one cell.

const EMPTY: u32 = u32::MAX;

/// Consecutive ids that lie side by side in the table; a power of two.
const GROUP: u64 = 8;

/// Open-addressing table from global ids to their position in a list of distinct ids.
///
/// Memory: 4 bytes x the next power of two above 1.5 times the capacity; the ids themselves stay with
/// the caller.
pub struct IdMap {
    slots: Vec<u32>,
    shift: u32,
}

impl IdMap {
    /// A table for at most `capacity` ids.
    pub fn with_capacity(capacity: usize) -> Self {
        let n_slots = (capacity + capacity / 2 + 8).next_power_of_two();
        IdMap { slots: vec![EMPTY; n_slots], shift: 64 - n_slots.trailing_zeros() }
    }

    /// Bytes that a table of this capacity takes.
    pub fn bytes(capacity: u64) -> u64 {
        4 * (capacity + capacity / 2 + 8).next_power_of_two()
    }

    /// The index of `id` in `ids`, appended if it is new.
    #[inline]
    pub fn insert(&mut self, id: u64, ids: &mut Vec<u64>) -> (u32, bool) {
        let at = self.probe(id, ids);
        if self.slots[at] != EMPTY {
            return (self.slots[at], false);
        }
        let index = ids.len() as u32;
        self.slots[at] = index;
        ids.push(id);
        (index, true)
    }

    /// The index of `id` in `ids`, if it is there.
    #[inline]
    pub fn get(&self, id: u64, ids: &[u64]) -> Option<u32> {
        let found = self.slots[self.probe(id, ids)];
        (found != EMPTY).then_some(found)
    }

    /// The slot that holds `id`, or the empty one where it belongs.
    #[inline]
    fn probe(&self, id: u64, ids: &[u64]) -> usize {
        // Fibonacci hashing spreads runs of ids, the common case, over the whole table; eight neighbours stay
        // together, in one cache line, since whoever asks for one asks for the next.
        let spread = (id / GROUP).wrapping_mul(0x9E37_79B9_7F4A_7C15) >> self.shift;
        let spread = spread & !(GROUP - 1);
        let mask = self.slots.len() - 1;
        let mut at = (spread | (id % GROUP)) as usize & mask;
        while self.slots[at] != EMPTY && ids[self.slots[at] as usize] != id {
            at = (at + 1) & mask;
        }
        at
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_id_is_found_where_it_was_put() {
        let mut ids = Vec::new();
        let mut map = IdMap::with_capacity(1000);
        for i in 0..1000u64 {
            assert_eq!(map.insert(i * i, &mut ids), (i as u32, true));
        }
        for i in 0..1000u64 {
            assert_eq!(map.insert(i * i, &mut ids), (i as u32, false));
            assert_eq!(map.get(i * i, &ids), Some(i as u32));
        }
        assert_eq!(map.get(3, &ids), None);
    }
}
