//! A bucket queue over costs: what is cheapest, to within a fraction of an octave.
//!
//! Buckets are the leading bits of the cost as f32, so there is nothing to configure. Within a bucket the
//! last entry comes out first. The queue knows nothing of meshes; stale entries are its owner's business.

/// An edge waiting to be collapsed, and how often it has failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Entry {
    pub(crate) v0: u32,
    pub(crate) v1: u32,
    /// Failed attempts that were put off, not refused.
    pub(crate) failures: u8,
}

/// Where an entry lies in the pool: its ends, its failures, the entry below it.
#[derive(Clone, Copy)]
struct Slot {
    v0: u32,
    /// The failures are in the two highest bits.
    v1: u32,
    next: u32,
}

const NONE: u32 = u32::MAX;
const FAILURE_SHIFT: u32 = 30;

/// The queue; 12 bytes an entry, 4 a bucket.
pub(crate) struct BucketQueue {
    shift: u32,
    heads: Vec<u32>,
    /// One bit a bucket, then one bit for each 64 of those.
    filled: Vec<u64>,
    summary: Vec<u64>,
    pool: Vec<Slot>,
    free: u32,
    len: usize,
    /// Edges that were put back, to know their doubles by.
    seen: Vec<Seen>,
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

/// Slots that remember edges put back; 64 KiB.
const N_SEEN: usize = 4096;

fn seen_slot(v0: u32, v1: u32) -> usize {
    (v0.wrapping_mul(0x9E37_79B1) ^ v1.wrapping_mul(0x85EB_CA77)) as usize >> 20
}

impl BucketQueue {
    /// A queue of 2^`octave_bits` buckets an octave.
    pub(crate) fn new(octave_bits: u32) -> Self {
        let shift = 23 - octave_bits;
        let n_buckets = 1usize << (31 - shift);
        BucketQueue {
            shift,
            heads: vec![NONE; n_buckets],
            filled: vec![0; n_buckets.div_ceil(64)],
            summary: vec![0; n_buckets.div_ceil(64 * 64)],
            pool: Vec::new(),
            free: NONE,
            len: 0,
            seen: vec![Seen::default(); N_SEEN],
            epoch: 1,
        }
    }

    /// The bucket of a cost, which is not negative and not NaN.
    pub(crate) fn bucket(&self, cost: f32) -> u32 {
        cost.max(0.0).to_bits() >> self.shift
    }

    /// The least cost of a bucket.
    pub(crate) fn lowest_cost(&self, bucket: u32) -> f32 {
        f32::from_bits(bucket << self.shift)
    }

    #[cfg(test)]
    pub(crate) fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Forgets everything, keeping the memory.
    pub(crate) fn clear(&mut self) {
        if self.len > 0 {
            self.heads.fill(NONE);
            self.filled.fill(0);
            self.summary.fill(0);
        }
        self.pool.clear();
        self.free = NONE;
        self.len = 0;
        self.epoch += 1;
    }

    /// Puts an entry back that became dearer than its bucket.
    pub(crate) fn put_back(&mut self, bucket: u32, entry: Entry) {
        let seen = Seen { v0: entry.v0, v1: entry.v1, bucket, epoch: self.epoch };
        self.seen[seen_slot(entry.v0, entry.v1)] = seen;
        self.push(bucket, entry);
    }

    /// Whether the same edge waits in a dearer bucket: two edges become one when a triangle vanishes,
    /// and one entry is enough. May miss some.
    pub(crate) fn is_double(&self, bucket: u32, v0: u32, v1: u32) -> bool {
        let seen = &self.seen[seen_slot(v0, v1)];
        seen.v0 == v0 && seen.v1 == v1 && seen.epoch == self.epoch && seen.bucket > bucket
    }

    pub(crate) fn push(&mut self, bucket: u32, entry: Entry) {
        let v1 = entry.v1 | u32::from(entry.failures) << FAILURE_SHIFT;
        let next = self.heads[bucket as usize];
        let slot = Slot { v0: entry.v0, v1, next };
        let at = self.free;
        if at == NONE {
            self.heads[bucket as usize] = self.pool.len() as u32;
            self.pool.push(slot);
        } else {
            self.free = self.pool[at as usize].next;
            self.pool[at as usize] = slot;
            self.heads[bucket as usize] = at;
        }
        self.filled[bucket as usize / 64] |= 1 << (bucket % 64);
        self.summary[bucket as usize / 4096] |= 1 << (bucket / 64 % 64);
        self.len += 1;
    }

    /// The cheapest entry with its bucket.
    pub(crate) fn pop(&mut self) -> Option<(u32, Entry)> {
        let high = self.summary.iter().position(|&word| word != 0)?;
        let middle = high * 64 + self.summary[high].trailing_zeros() as usize;
        let bucket = middle * 64 + self.filled[middle].trailing_zeros() as usize;
        let at = self.heads[bucket];
        let slot = self.pool[at as usize];
        self.heads[bucket] = slot.next;
        if slot.next == NONE {
            self.filled[middle] &= !(1 << (bucket % 64));
            if self.filled[middle] == 0 {
                self.summary[high] &= !(1 << (middle % 64));
            }
        }
        self.pool[at as usize].next = self.free;
        self.free = at;
        self.len -= 1;
        let v1 = slot.v1 & !(3 << FAILURE_SHIFT);
        let failures = (slot.v1 >> FAILURE_SHIFT) as u8;
        Some((bucket as u32, Entry { v0: slot.v0, v1, failures }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn entries_come_out_by_bucket_and_last_in_first_out() {
        let mut queue = BucketQueue::new(3);
        let costs = [3.0f32, 0.0, 1e30, 3.1, 1e-30, 7.0];
        for (i, &cost) in costs.iter().enumerate() {
            queue.push(queue.bucket(cost), Entry { v0: i as u32, v1: 9, failures: i as u8 & 3 });
        }
        let order: Vec<u32> = std::iter::from_fn(|| queue.pop().map(|(_, e)| e.v0)).collect();
        assert_eq!(order, [1, 4, 3, 0, 5, 2]);
        assert!(queue.is_empty());
    }
}
