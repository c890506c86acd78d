//! Scratch files that are written here and there.

use super::scratch_file;
use rustix::fs::{FallocateFlags, fallocate};
use rustix::io::Errno;
use std::fs::File;
use std::ops::Deref;
use std::path::Path;

/// A scratch file that is written in no order.
///
/// Its blocks are taken at once where the file system can do that, and given back at once: what was written here and there
/// lies in thousands of extents, which a file system that discards each on the device takes minutes to free.
#[derive(Debug)]
pub struct ScatteredFile {
    file: File,
    n_bytes: u64,
}

impl ScatteredFile {
    /// `n_bytes` zeros in `folder`.
    pub fn new(folder: &Path, n_bytes: u64) -> std::io::Result<ScatteredFile> {
        let file = scratch_file(folder)?;
        match fallocate(&file, FallocateFlags::empty(), 0, n_bytes) {
            Err(Errno::NOSPC) => return Err(Errno::NOSPC.into()),
            Ok(()) | Err(_) => file.set_len(n_bytes)?,
        }
        Ok(ScatteredFile { file, n_bytes })
    }

    /// Makes all of it zeros again, so that written and unwritten extents become few.
    fn even(&self) -> std::io::Result<()> {
        Ok(fallocate(&self.file, FallocateFlags::ZERO_RANGE, 0, self.n_bytes)?)
    }
}

impl Deref for ScatteredFile {
    type Target = File;

    fn deref(&self) -> &File {
        &self.file
    }
}

impl Drop for ScatteredFile {
    fn drop(&mut self) {
        // A file system that cannot do it frees the extents as they are.
        let _ = self.even();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::{FileExt, MetadataExt};

    /// Every other block of 4096 bytes is written.
    #[test]
    fn a_file_written_here_and_there_is_even_before_it_is_freed() {
        let folder = tempfile::tempdir().unwrap();
        let n_bytes = 16 * 4096;
        let file = ScatteredFile::new(folder.path(), n_bytes).unwrap();
        (0..16).step_by(2).for_each(|block| file.write_all_at(&[1; 4096], block * 4096).unwrap());
        file.sync_all().unwrap();
        if file.even().is_err() {
            return;
        }
        let mut bytes = vec![1; n_bytes as usize];
        file.read_exact_at(&mut bytes, 0).unwrap();
        assert!(bytes.iter().all(|&byte| byte == 0));
        assert_eq!(file.metadata().unwrap().len(), n_bytes);
        assert!(file.metadata().unwrap().blocks() >= n_bytes / 512);
    }
}
