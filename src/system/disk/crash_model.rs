//! For crash tests: which bytes and names a power loss would leave.
//!
//! Follows every create, write, sync, rename, removal and folder sync of a `Disk`, and afterwards puts the
//! files into a state that the machine could come back with. It holds all contents in memory and is meant
//! for small jobs only.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::fs::File;
use std::os::unix::fs::{FileExt, MetadataExt};
use std::path::{Path, PathBuf};

/// Extent of a power loss.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PowerLoss {
    /// Everything that was not synced: data, lengths, names, renames, removals, punched holes.
    Unsynced,
    /// Only data: names, lengths, removals and holes reached the disk, unsynced bytes read as zeros.
    UnsyncedData,
    /// Nothing: the process was killed, the machine lives on.
    Nothing,
}

/// One file, under whatever name.
#[derive(Debug, Default)]
struct FileContent {
    durable: Vec<u8>,
    /// Byte ranges that were punched since the last sync.
    holes: Vec<(u64, u64)>,
}

/// The durable state beside the living one.
#[derive(Debug, Default)]
pub(super) struct Losses {
    contents: Vec<FileContent>,
    by_inode: HashMap<u64, usize>,
    known: BTreeSet<PathBuf>,
    live: BTreeMap<PathBuf, usize>,
    durable: BTreeMap<PathBuf, usize>,
}

impl Losses {
    /// Takes notice of a path before its first use: what lies there is durable.
    pub fn meet(&mut self, path: &Path) {
        if !self.known.insert(path.into()) {
            return;
        }
        let (Ok(meta), Ok(durable)) = (std::fs::metadata(path), std::fs::read(path)) else {
            return;
        };
        let id = self.new_content(meta.ino());
        self.contents[id].durable = durable;
        self.live.insert(path.into(), id);
        self.durable.insert(path.into(), id);
    }

    fn new_content(&mut self, inode: u64) -> usize {
        self.contents.push(FileContent::default());
        self.by_inode.insert(inode, self.contents.len() - 1);
        self.contents.len() - 1
    }

    pub fn created(&mut self, path: &Path, file: &File) {
        if self.live.contains_key(path) {
            return;
        }
        let Ok(meta) = file.metadata() else { return };
        let id = self.new_content(meta.ino());
        self.live.insert(path.into(), id);
    }

    fn content_of(&mut self, file: &File) -> Option<&mut FileContent> {
        let inode = file.metadata().ok()?.ino();
        let id = *self.by_inode.get(&inode)?;
        self.contents.get_mut(id)
    }

    pub fn synced(&mut self, file: &File) {
        let length = file.metadata().map_or(0, |meta| meta.len());
        if let Some(content) = self.content_of(file) {
            content.durable.resize(length as usize, 0);
            content.holes.clear();
            file.read_exact_at(&mut content.durable, 0).expect("a test file is readable");
        }
    }

    pub fn punched(&mut self, file: &File, offset: u64, length: u64) {
        if let Some(content) = self.content_of(file) {
            content.holes.push((offset, length));
        }
    }

    pub fn renamed(&mut self, from: &Path, to: &Path) {
        if let Some(id) = self.live.remove(from) {
            self.live.insert(to.into(), id);
        }
    }

    pub fn removed(&mut self, path: &Path) {
        self.live.remove(path);
    }

    pub fn folder_synced(&mut self, folder: &Path) {
        for path in self.known.iter().filter(|path| path.parent() == Some(folder)) {
            match self.live.get(path) {
                Some(&id) => self.durable.insert(path.clone(), id),
                None => self.durable.remove(path),
            };
        }
    }

    /// The whole file system was synced.
    pub fn all_synced(&mut self) {
        for (path, &id) in &self.live {
            if let (Ok(durable), Some(content)) = (std::fs::read(path), self.contents.get_mut(id)) {
                content.durable = durable;
                content.holes.clear();
            }
        }
        self.durable = self.live.clone();
    }

    /// A folder got another name; taken as durable at once, since no file in it changes by that.
    pub fn folder_renamed(&mut self, from: &Path, to: &Path) {
        let moved = |path: &Path| path.strip_prefix(from).ok().map(|rest| to.join(rest));
        for names in [&mut self.live, &mut self.durable] {
            let new = |(path, id): (PathBuf, usize)| (moved(&path).unwrap_or(path), id);
            *names = std::mem::take(names).into_iter().map(new).collect();
        }
        self.known = std::mem::take(&mut self.known)
            .into_iter()
            .map(|path| moved(&path).unwrap_or(path))
            .collect();
    }

    /// Puts the files into the state that `loss` leaves.
    pub fn lose(&mut self, loss: PowerLoss) -> std::io::Result<()> {
        match loss {
            PowerLoss::Nothing => {}
            PowerLoss::Unsynced => {
                for path in &self.known {
                    match self.durable.get(path) {
                        Some(&id) => {
                            // The folder itself may have been removed too.
                            path.parent().map_or(Ok(()), std::fs::create_dir_all)?;
                            std::fs::write(path, &self.contents[id].durable)?;
                        }
                        None if path.is_file() => std::fs::remove_file(path)?,
                        None => {}
                    }
                }
            }
            PowerLoss::UnsyncedData => {
                for (path, &id) in &self.live {
                    let content = &mut self.contents[id];
                    content.durable.resize(std::fs::metadata(path)?.len() as usize, 0);
                    for &(offset, length) in &content.holes {
                        let end = ((offset + length) as usize).min(content.durable.len());
                        content.durable[offset as usize..end].fill(0);
                    }
                    std::fs::write(path, &content.durable)?;
                }
            }
        }
        Ok(())
    }
}
