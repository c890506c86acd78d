//! Small files that appear whole, are never replaced, and of which the first one counts: by link(2).
//!
//! A link is made or refused by the server of a network file system, whatever its clients have cached. The reply
//! may be lost, so the number of links tells who has won, not the return value (open(2), O_EXCL).

use super::{Change, Disk};
use crate::error::{Error, Result};
use std::os::unix::fs::MetadataExt;
use std::path::Path;

impl Disk {
    /// Gives `path` the content `bytes` unless there is such a file; `false` if there is. `temporary` is a name in
    /// the same folder that no other process uses.
    pub fn publish(&self, path: &Path, temporary: &Path, bytes: &[u8]) -> Result<bool> {
        let mut file = self.create(temporary)?;
        let written = file.append(bytes).and_then(|()| file.sync());
        drop(file);
        let published = written.and_then(|()| self.link(temporary, path, bytes));
        // A name too many harms nothing, and is removed with those of the attempt.
        let _ = self.remove(temporary);
        let is_first = published?;
        if is_first {
            self.sync_folder_of(path)?;
        }
        Ok(is_first)
    }

    fn link(&self, temporary: &Path, path: &Path, bytes: &[u8]) -> Result<bool> {
        use std::io::ErrorKind::{AlreadyExists, PermissionDenied, Unsupported};
        self.operation(path, "cannot create", Change)?;
        let outcome = std::fs::hard_link(temporary, path);
        if std::fs::metadata(temporary).is_ok_and(|meta| meta.nlink() == 2) {
            return Ok(true);
        }
        match outcome {
            Ok(()) => Ok(true),
            Err(e) if e.kind() == AlreadyExists => Ok(false),
            // File systems without links: whoever reads half a file looks again.
            Err(e) if matches!(e.kind(), Unsupported | PermissionDenied) => {
                let Some(mut file) = self.create_new(path)? else { return Ok(false) };
                file.append(bytes)?;
                file.sync()?;
                Ok(true)
            }
            Err(e) => Err(Error::io(path, "cannot create", e)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_of_many_writers_counts() {
        let folder = tempfile::tempdir().unwrap();
        let (disk, path) = (Disk::default(), folder.path().join("record"));
        let publish = |i: usize| {
            let temporary = folder.path().join(format!("attempt-{i}"));
            disk.publish(&path, &temporary, format!("{i}").as_bytes()).unwrap()
        };
        let wins: Vec<bool> = std::thread::scope(|scope| {
            let publish = &publish;
            let writers: Vec<_> = (0..8).map(|i| scope.spawn(move || publish(i))).collect();
            writers.into_iter().map(|writer| writer.join().unwrap()).collect()
        });
        assert_eq!(wins.iter().filter(|won| **won).count(), 1);
        let winner = wins.iter().position(|won| *won).unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), winner.to_string());
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }
}
