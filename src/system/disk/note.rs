//! A note on a file of ours beside its bytes: an extended attribute.
//!
//! File systems may keep none, or few bytes, and copies may go without; whoever reads a note does without it too.

use rustix::fs::{XattrFlags, lgetxattr, lsetxattr};
use std::path::Path;

const NAME: &str = "user.stonecut.done";

/// The longest value that Linux keeps.
const MOST_BYTES: usize = 64 << 10;

/// Sets the note of a file, if the file system keeps one of this length.
pub fn set_note(path: &Path, text: &[u8]) {
    let _ = lsetxattr(path, NAME, text, XattrFlags::empty());
}

/// The note of a file, if it has one.
pub fn note_of(path: &Path) -> Option<Vec<u8>> {
    let mut text = vec![0; MOST_BYTES];
    let n = lgetxattr(path, NAME, &mut text[..]).ok()?;
    text.truncate(n);
    Some(text)
}
