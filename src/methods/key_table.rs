//! Numbers keys in the order in which they first come: cells of a grid, triangles by their corners.
//!
//! Open addressing over one list of keys; the number of a key is its place in the list, so that it depends on the order
//! of keys and on nothing else.

use stonecut_mesh::scatter::mix;

/// A key of a `KeyTable`.
pub(super) trait Key: Copy + Eq {
    /// Bits that differ between keys in all places.
    fn mixed(self) -> u64;
}

impl Key for u64 {
    #[inline(always)]
    fn mixed(self) -> u64 {
        mix(self)
    }
}

impl Key for [u32; 3] {
    #[inline(always)]
    fn mixed(self) -> u64 {
        let [a, b, c] = self.map(u64::from);
        mix((a | b << 32) ^ mix(c))
    }
}

/// The mark of a free slot.
const FREE: u32 = u32::MAX;

/// Slots of an empty table.
const LEAST_SLOTS: usize = 64;

/// Keys, each with a number.
#[derive(Clone, Debug)]
pub(super) struct KeyTable<K> {
    keys: Vec<K>,
    slots: Vec<u32>,
}

impl<K: Key> Default for KeyTable<K> {
    fn default() -> Self {
        KeyTable { keys: Vec::new(), slots: vec![FREE; LEAST_SLOTS] }
    }
}

impl<K: Key> KeyTable<K> {
    /// A table with room for `n` keys.
    pub(super) fn with_room(n: usize) -> Self {
        let n_slots = (2 * n).next_power_of_two().max(LEAST_SLOTS);
        KeyTable { keys: Vec::with_capacity(n), slots: vec![FREE; n_slots] }
    }

    /// Memory of a table of `n` keys, in bytes: slots up to a quarter full at worst.
    pub(super) fn bytes(n: u64) -> u64 {
        n * size_of::<K>() as u64 + 4 * (2 * n).next_power_of_two()
    }

    /// All keys, by number.
    pub(super) fn keys(&self) -> &[K] {
        &self.keys
    }

    /// Removes all keys and keeps the memory.
    pub(super) fn clear(&mut self) {
        self.keys.clear();
        self.slots.fill(FREE);
    }

    /// The number of a key; a further one if it is not there yet. Numbers end below `u32::MAX`.
    #[inline]
    pub(super) fn number(&mut self, key: K) -> u32 {
        let mut slot = key.mixed() as usize & (self.slots.len() - 1);
        loop {
            match self.slots[slot] {
                FREE => break,
                number if self.keys[number as usize] == key => return number,
                _ => slot = (slot + 1) & (self.slots.len() - 1),
            }
        }
        let number = self.keys.len() as u32;
        self.keys.push(key);
        self.slots[slot] = number;
        if 2 * self.keys.len() > self.slots.len() {
            self.grow();
        }
        number
    }

    /// The number of a key that may not be there.
    #[inline]
    pub(super) fn find(&self, key: K) -> Option<u32> {
        let mut slot = key.mixed() as usize & (self.slots.len() - 1);
        loop {
            match self.slots[slot] {
                FREE => return None,
                number if self.keys[number as usize] == key => return Some(number),
                _ => slot = (slot + 1) & (self.slots.len() - 1),
            }
        }
    }

    #[cold]
    fn grow(&mut self) {
        let n_slots = 2 * self.slots.len();
        // The old slots go before the new ones come.
        self.slots = Vec::new();
        self.slots = vec![FREE; n_slots];
        for (number, key) in self.keys.iter().enumerate() {
            let mut slot = key.mixed() as usize & (n_slots - 1);
            while self.slots[slot] != FREE {
                slot = (slot + 1) & (n_slots - 1);
            }
            self.slots[slot] = number as u32;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::KeyTable;

    #[test]
    fn keys_are_numbered_in_the_order_in_which_they_come() {
        let mut table = KeyTable::<u64>::default();
        for round in 0..2 {
            for i in 0..10_000u64 {
                assert_eq!(table.number(i * i * 1_000_003), i as u32, "round {round}");
            }
        }
        assert_eq!(table.find(4 * 1_000_003), Some(2));
        assert_eq!(table.find(5), None);
        table.clear();
        assert_eq!((table.find(4 * 1_000_003), table.number(7)), (None, 0));
        let mut triangles = KeyTable::<[u32; 3]>::with_room(4);
        let numbers = [[1, 2, 3], [1, 2, 4], [1, 2, 3], [3, 2, 1]].map(|t| triangles.number(t));
        assert_eq!(numbers, [0, 1, 0, 2]);
        assert_eq!(triangles.keys().len(), 3);
    }
}
