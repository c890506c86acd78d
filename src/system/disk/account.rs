//! The account of the bytes that job files and other temporary data hold, and of the most at one time.
//!
//! The bytes of a part of an account count in the whole as well, until the part is dropped. This is how files without a
//! name are counted: they vanish when they are closed, and no call removes them. Touches no file.

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
    /// An account whose bytes are part of `whole`.
    pub(super) fn part_of(whole: &Arc<Account>) -> Arc<Account> {
        let whole = Some(Arc::clone(whole));
        Arc::new(Account { whole, held: 0.into(), peak: 0.into() })
    }

    /// The bytes that are held now.
    pub(super) fn held(&self) -> u64 {
        self.held.load(Relaxed).max(0) as u64
    }

    /// The most bytes that were held at one time.
    pub(super) fn peak(&self) -> u64 {
        self.peak.load(Relaxed).max(0) as u64
    }

    /// Adds bytes, or takes them away.
    pub(super) fn hold(&self, bytes: i64) {
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
