//! A bucket queue over costs: what is cheapest, to within a fraction of an octave.
//!
//! Buckets are the leading bits of the cost as f32, so there is nothing to configure. Within a bucket the
//! last entry comes out first. The queue never goes back: what is pushed below the bucket that is being
//! emptied goes into that one. It knows nothing of meshes; stale entries are its owner's business.
//!
//! docs/algorithm.md, section 5.

/// An edge waiting to be collapsed, and how often it has failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Entry {
    pub(crate) v0: u32,
    pub(crate) v1: u32,
    /// Failed attempts that were put off, not refused; at most 3.
    pub(crate) failures: u8,
}

/// An entry in the pool: its ends, its failures, the entry below it.
#[derive(Clone, Copy)]
struct QueueSlot {
    v0: u32,
    /// The failures are in the two highest bits.
    v1: u32,
    next: u32,
}

const NONE: u32 = u32::MAX;
/// Finest division of an octave: 32 buckets.
const MOST_OCTAVE_BITS: u32 = 5;
/// Buckets of the finest division.
const MOST_BUCKETS: usize = 1 << (8 + MOST_OCTAVE_BITS);
const FAILURE_SHIFT: u32 = 30;

/// The queue; 12 bytes an entry, 4 a bucket.
pub(crate) struct BucketQueue {
    shift: u32,
    /// The first `2^(31 - shift)` are used.
    heads: Box<[u32; MOST_BUCKETS]>,
    /// One bit a bucket: something may be in it.
    filled: Box<[u64; MOST_BUCKETS / 64]>,
    /// The bucket that is being emptied.
    current: u32,
    /// Nothing comes out of buckets dearer than this one.
    ceiling: u32,
    pool: Vec<QueueSlot>,
    free: u32,
    /// Edges that were put back, to know their doubles by.
    seen: Box<[Seen; 1 << SEEN_BITS]>,
    epoch: u32,
}

/// An edge that was put back into a bucket while the queue was in an epoch.
#[derive(Clone, Copy, Default)]
struct Seen {
    v0: u32,
    v1: u32,
    bucket: u32,
    epoch: u32,
}

/// Bits of the number of edges put back that are remembered; 16 bytes each.
const SEEN_BITS: u32 = 12;

/// Index of a bucket. The mask changes nothing, and spares the check.
#[inline(always)]
fn place_of(bucket: u32) -> usize {
    debug_assert!((bucket as usize) < MOST_BUCKETS);
    bucket as usize & (MOST_BUCKETS - 1)
}

#[inline(always)]
fn seen_slot(v0: u32, v1: u32) -> usize {
    ((v0.wrapping_mul(0x9E37_79B1) ^ v1.wrapping_mul(0x85EB_CA77)) >> (32 - SEEN_BITS)) as usize
}

impl BucketQueue {
    /// A queue of 2^`octave_bits` buckets an octave.
    pub(crate) fn new(octave_bits: u32) -> Self {
        assert!(octave_bits <= MOST_OCTAVE_BITS, "{octave_bits} bits an octave");
        let shift = 23 - octave_bits;
        BucketQueue {
            shift,
            heads: Box::new([NONE; MOST_BUCKETS]),
            filled: Box::new([0; MOST_BUCKETS / 64]),
            current: 0,
            ceiling: u32::MAX,
            pool: Vec::new(),
            free: NONE,
            seen: Box::new([Seen::default(); 1 << SEEN_BITS]),
            epoch: 1,
        }
    }

    /// Memory in bytes.
    pub(crate) fn bytes(&self) -> u64 {
        let fixed =
            size_of_val(&*self.heads) + size_of_val(&*self.filled) + size_of_val(&*self.seen);
        (fixed + self.pool.capacity() * size_of::<QueueSlot>()) as u64
    }

    /// The bucket of a cost; of what is negative or NaN, the first.
    #[inline(always)]
    pub(crate) fn bucket(&self, cost: f32) -> u32 {
        // Not `max`, which may leave -0, whose bits are beyond all buckets.
        if cost > 0.0 { cost.to_bits() >> self.shift } else { 0 }
    }

    /// The least cost of a bucket.
    #[inline(always)]
    pub(crate) fn lowest_cost(&self, bucket: u32) -> f32 {
        f32::from_bits(bucket << self.shift)
    }

    /// Lets out nothing that is dearer than the bucket of `cost`; what waits there stays.
    pub(crate) fn close_above(&mut self, cost: f32) {
        self.ceiling = self.bucket(cost);
    }

    /// The highest cost that is let out.
    pub(crate) fn highest_cost(&self) -> f32 {
        self.lowest_cost(self.ceiling.saturating_add(1)).next_down()
    }

    /// Forgets everything, keeping the memory.
    pub(crate) fn clear(&mut self) {
        for (word, heads) in self.filled.iter_mut().zip(self.heads.chunks_mut(64)) {
            if *word != 0 {
                heads.fill(NONE);
                *word = 0;
            }
        }
        self.current = 0;
        self.ceiling = u32::MAX;
        self.pool.clear();
        self.free = NONE;
        self.epoch += 1;
    }

    /// Puts an entry back that became dearer than its bucket.
    #[inline(always)]
    pub(crate) fn put_back(&mut self, bucket: u32, entry: Entry) {
        let seen = Seen { v0: entry.v0, v1: entry.v1, bucket, epoch: self.epoch };
        self.seen[seen_slot(entry.v0, entry.v1)] = seen;
        self.push(bucket, entry);
    }

    /// Returns whether the same edge waits in a dearer bucket: two edges become one when a triangle vanishes,
    /// and one entry is enough. May miss some.
    #[inline(always)]
    pub(crate) fn is_double(&self, bucket: u32, v0: u32, v1: u32) -> bool {
        let seen = &self.seen[seen_slot(v0, v1)];
        (seen.v0 == v0) & (seen.v1 == v1) & (seen.epoch == self.epoch) & (seen.bucket > bucket)
    }

    #[inline(always)]
    pub(crate) fn push(&mut self, bucket: u32, entry: Entry) {
        debug_assert!(entry.v1 >> FAILURE_SHIFT == 0 && entry.failures < 4);
        let bucket = bucket.max(self.current);
        let v1 = entry.v1 | u32::from(entry.failures) << FAILURE_SHIFT;
        let slot = QueueSlot { v0: entry.v0, v1, next: self.heads[place_of(bucket)] };
        let free = self.free;
        self.heads[place_of(bucket)] = if let Some(place) = self.pool.get_mut(free as usize) {
            self.free = place.next;
            *place = slot;
            free
        } else {
            self.pool.push(slot);
            self.pool.len() as u32 - 1
        };
        self.filled[place_of(bucket) / 64] |= 1 << (bucket % 64);
    }

    /// The cheapest entry with its bucket.
    #[inline(always)]
    pub(crate) fn pop(&mut self) -> Option<(u32, Entry)> {
        if self.heads[place_of(self.current)] == NONE {
            self.advance()?;
        }
        self.pop_current()
    }

    /// The next entry of the bucket that is being emptied.
    #[inline(always)]
    pub(crate) fn pop_current(&mut self) -> Option<(u32, Entry)> {
        let first = self.heads[place_of(self.current)];
        if first == NONE {
            return None;
        }
        let place = &mut self.pool[first as usize];
        let slot = *place;
        place.next = self.free;
        self.free = first;
        self.heads[place_of(self.current)] = slot.next;
        let v1 = slot.v1 & !(3 << FAILURE_SHIFT);
        let failures = (slot.v1 >> FAILURE_SHIFT) as u8;
        Some((self.current, Entry { v0: slot.v0, v1, failures }))
    }

    /// Goes on to the next bucket that holds something.
    #[inline(never)]
    fn advance(&mut self) -> Option<()> {
        let mut word = self.current as usize / 64;
        self.filled[word] &= !(1 << (self.current % 64));
        while self.filled[word] == 0 {
            word += 1;
            if word == self.filled.len() {
                return None;
            }
        }
        let next = word as u32 * 64 + self.filled[word].trailing_zeros();
        if next > self.ceiling {
            return None;
        }
        self.current = next;
        Some(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn entries_come_out_by_bucket_and_last_in_first_out() {
        let mut queue = BucketQueue::new(3);
        for _ in 0..2 {
            let costs = [3.0f32, 0.0, 1e30, 3.1, 1e-30, 7.0];
            for (i, &cost) in costs.iter().enumerate() {
                let entry = Entry { v0: i as u32, v1: 9, failures: i as u8 & 3 };
                queue.push(queue.bucket(cost), entry);
            }
            let order: Vec<u32> = std::iter::from_fn(|| queue.pop().map(|(_, e)| e.v0)).collect();
            assert_eq!(order, [1, 4, 3, 0, 5, 2]);
            assert_eq!(queue.pop(), None);
            queue.clear();
        }
    }

    #[test]
    fn ids_and_costs_at_their_limits_come_out_as_they_went_in() {
        let mut queue = BucketQueue::new(5);
        let costs = [-0.0, 0.0, -1.0, f32::NAN, f32::MIN_POSITIVE, f32::MAX, f32::INFINITY];
        let most = (1 << FAILURE_SHIFT) - 1;
        let entries: Vec<Entry> = (0..costs.len() as u32)
            .map(|i| Entry { v0: u32::MAX - i, v1: most - i, failures: i as u8 & 3 })
            .collect();
        for (&cost, &entry) in costs.iter().zip(&entries) {
            queue.push(queue.bucket(cost), entry);
        }
        let order = [3, 2, 1, 0, 4, 5, 6];
        for i in order {
            assert_eq!(queue.pop(), Some((queue.bucket(costs[i]), entries[i])));
        }
        assert!(u64::from(most) >= crate::MAX_VERTICES);
    }

    #[test]
    fn what_is_dearer_than_the_ceiling_waits() {
        let mut queue = BucketQueue::new(3);
        for cost in [1.0f32, 4.0] {
            queue.push(queue.bucket(cost), Entry { v0: cost as u32, v1: 9, failures: 0 });
        }
        for (ceiling, expected) in [(2.0, Some(1)), (3.0, None), (5.0, Some(4)), (9.0, None)] {
            queue.close_above(ceiling);
            assert_eq!(queue.pop().map(|(_, entry)| entry.v0), expected);
        }
    }

    #[test]
    fn clearing_forgets_what_was_not_taken_out() {
        let mut queue = BucketQueue::new(3);
        queue.push(queue.bucket(2.0), Entry { v0: 1, v1: 2, failures: 0 });
        queue.clear();
        queue.push(queue.bucket(1.0), Entry { v0: 3, v1: 4, failures: 2 });
        assert_eq!(queue.pop(), Some((queue.bucket(1.0), Entry { v0: 3, v1: 4, failures: 2 })));
        assert_eq!(queue.pop(), None);
    }
}
