//! Room on the file system of a folder.

use std::path::Path;

/// Bytes that may still be written to the file system of a folder; none where the system does not tell.
pub fn free_bytes(folder: &Path) -> Option<u64> {
    let stat = rustix::fs::statvfs(folder).ok()?;
    Some(stat.f_bavail.saturating_mul(stat.f_frsize))
}
