//! Memory for lists of files and trees of tiles: a share of the command's, counted before anything is opened.

use std::path::Path;
use stonecut_system::error::{Error, Result};
use stonecut_system::units::{memory_word, show_bytes};

/// The share of the memory that lists and trees of tiles may take.
pub(super) const LIST_SHARE: u64 = 4;
/// Bytes of a part of a mesh before it is opened, beside its name.
pub(super) const PART_BYTES: u64 = 512;

/// Refuses a list or a tree that takes more memory than there is for it; names the memory that does.
pub(super) fn hold(path: &Path, what: &str, needed: u64, limit: u64) -> Result<()> {
    if needed <= limit {
        return Ok(());
    }
    Err(Error::NoMemory(format!(
        "{}: {what} takes up to {} of memory, and 1/{LIST_SHARE} of the budget is for it: give --memory {}",
        path.display(),
        show_bytes(needed),
        memory_word(needed.saturating_mul(LIST_SHARE))
    )))
}
