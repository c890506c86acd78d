//! A binary STL behind an ASCII one, or the other way round: its facets would be missing without a word.

use crate::open_options::StageOptions;
use crate::ply::raw::RawFile;
use stonecut_system::error::Result;
use stonecut_system::losses::{Loss, LossKind};

/// Bytes of the header of a binary STL, with the count, and of a facet.
pub(super) const HEADER_BYTES: u64 = 84;
pub(super) const FACET_BYTES: u64 = 50;

/// Refuses a file of the other kind at byte `at`, behind the last facet, which would be a part of the surface; with `skip_bad`
/// its loss.
pub(super) fn refuse_other(
    file: &RawFile,
    (at, [what, behind]): (u64, [&str; 2]),
    options: &StageOptions,
) -> Result<Loss> {
    let remedy = "part them into two files and name both, or leave the second out with --skip-bad";
    if !options.read.skip_bad {
        return Err(file.bad(format!("byte offset {at}: {what} lies behind {behind}; {remedy}")));
    }
    let why = format!("behind {behind}, from byte offset {at} on: left out");
    Ok(Loss::new(LossKind::Geometry, what, why).whole())
}

/// Returns whether a binary STL that begins at byte `at` is all that is left of a file.
pub(super) fn is_rest(file: &RawFile, at: u64) -> Result<bool> {
    let mut count = [0; 4];
    let n_read = file.read_at_most(&mut count, at + 80)?;
    let n = u64::from(u32::from_le_bytes(count));
    Ok(n_read == count.len() && n > 0 && at + HEADER_BYTES + n * FACET_BYTES == file.len())
}
