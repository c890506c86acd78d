//! Whole folders: made durable, renamed, replaced, removed; and the account of what lies in them.

use super::Effect::Change;
use super::account::Account;
use super::{Disk, Shared, is_empty};
use crate::error::{Error, Result};
use std::fs::File;
use std::path::Path;
use std::sync::Arc;

impl Disk {
    /// Makes everything in a folder and below durable, and with it all that its file system holds.
    pub fn sync_all_below(&self, folder: &Path) -> Result<()> {
        self.operation(folder, "cannot sync", Change)?;
        let outcome = File::open(folder).and_then(|folder| Ok(rustix::fs::syncfs(&folder)?));
        outcome.map_err(|e| Error::io(folder, "cannot sync", e))?;
        self.follow(|losses| losses.all_synced());
        Ok(())
    }

    /// Gives a folder the name of another one, which goes if it is there: `check` refuses one that must stay, before and
    /// after the exchange, and `remove` takes away what was checked.
    pub fn replace_folder(
        &self,
        from: &Path,
        to: &Path,
        check: &dyn Fn(&Path) -> Result<()>,
        remove: &dyn Fn(&Path) -> Result<()>,
    ) -> Result<()> {
        use rustix::fs::{CWD, RenameFlags, renameat_with};
        self.operation(to, "cannot rename to", Change)?;
        let exchange = || renameat_with(CWD, from, CWD, to, RenameFlags::EXCHANGE);
        let is_taken = std::fs::symlink_metadata(to).is_ok() && !is_empty(to);
        let mut is_exchanged = false;
        if is_taken {
            check(to)?;
            is_exchanged = exchange().is_ok();
            if is_exchanged {
                // What was put there between the look and the exchange goes back to its place.
                if let Err(error) = check(from) {
                    exchange().map_err(|e| Error::io(to, "cannot rename to", e.into()))?;
                    return Err(error);
                }
            } else {
                // Where folders cannot be exchanged there is a moment without either.
                remove(to)?;
            }
        }
        if !is_exchanged {
            // Takes the place of an empty folder, and of nothing else.
            std::fs::rename(from, to).map_err(|e| match e.kind() {
                std::io::ErrorKind::DirectoryNotEmpty | std::io::ErrorKind::NotADirectory => {
                    let to = to.display();
                    let what = format!("{to} has appeared during the run; move it elsewhere");
                    Error::Usage(what)
                }
                _ => Error::io(to, "cannot rename to", e),
            })?;
        }
        self.follow(|losses| losses.folder_renamed(from, to));
        self.sync_folder_of(to)?;
        if is_exchanged { remove(from) } else { Ok(()) }
    }

    /// Removes an empty folder; one that is not empty (any more) stays.
    pub fn remove_dir(&self, path: &Path) -> Result<()> {
        self.operation(path, "cannot remove folder", Change)?;
        match std::fs::remove_dir(path) {
            Err(e) if e.kind() == std::io::ErrorKind::DirectoryNotEmpty => Ok(()),
            outcome => outcome.map_err(|e| Error::io(path, "cannot remove folder", e)),
        }
    }
}

impl Disk {
    /// The most bytes that job files have held at one time, as far as this process knows.
    pub fn peak_bytes(&self) -> u64 {
        self.shared.account.peak()
    }

    /// The bytes that are held now.
    pub fn held_bytes(&self) -> u64 {
        self.shared.account.held()
    }

    /// A disk whose bytes are part of this one's account until its last clone is dropped.
    pub fn part(&self) -> Disk {
        let account = Account::part_of(&self.shared.account);
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
