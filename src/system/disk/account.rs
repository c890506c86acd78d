//! The account of the bytes that job files and other temporary data hold, and of the most at one time.
//!
//! A part of an account is a disk whose bytes count in another one's as well, until it is dropped. It is how files without a
//! name are counted: they vanish when they are closed, and no call removes them. Touches no file.

use super::{Disk, Shared};
use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering::Relaxed};

/// Bytes that are held, and the most of them so far.
#[derive(Debug, Default)]
pub(super) struct Account {
    held: AtomicI64,
    peak: AtomicI64,
    /// The account that this one is part of.
    whole: Option<Arc<Account>>,
}

impl Account {
    fn hold(&self, bytes: i64) {
        let now = self.held.fetch_add(bytes, Relaxed) + bytes;
        self.peak.fetch_max(now, Relaxed);
        if let Some(whole) = &self.whole {
            whole.hold(bytes);
        }
    }
}

impl Drop for Account {
    fn drop(&mut self) {
        if let Some(whole) = &self.whole {
            whole.hold(-*self.held.get_mut());
        }
    }
}

impl Disk {
    /// The most bytes that job files have held at one time, as far as this process knows.
    pub fn peak_bytes(&self) -> u64 {
        self.shared.account.peak.load(Relaxed).max(0) as u64
    }

    /// The bytes that are held now.
    pub fn held_bytes(&self) -> u64 {
        self.shared.account.held.load(Relaxed).max(0) as u64
    }

    /// A disk whose bytes are part of this one's account until its last clone is dropped.
    pub fn part(&self) -> Disk {
        let whole = Some(Arc::clone(&self.shared.account));
        let account = Arc::new(Account { held: 0.into(), peak: 0.into(), whole });
        Disk { shared: Arc::new(Shared { account, ..Shared::default() }) }
    }

    /// Accounts for bytes that this disk has not written itself, such as those of a job that is resumed.
    pub fn adopt(&self, bytes: u64) {
        self.hold(bytes as i64);
    }

    /// Takes bytes of the output out of the account of job files.
    pub fn disown(&self, bytes: u64) {
        self.hold(-(bytes as i64));
    }

    pub(super) fn hold(&self, bytes: i64) {
        self.shared.account.hold(bytes);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_part_holds_counts_until_it_is_dropped() {
        let disk = Disk::default();
        disk.adopt(100);
        let part = disk.part();
        part.adopt(50);
        part.part().adopt(7);
        part.disown(20);
        assert_eq!((part.held_bytes(), disk.held_bytes()), (30, 130));
        drop(part);
        assert_eq!((disk.held_bytes(), disk.peak_bytes()), (100, 157));
    }
}
