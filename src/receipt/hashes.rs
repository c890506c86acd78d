//! SHA-256 of files, by the way that leads to them from the folder of a receipt.
//!
//! SHA-256, for every archive and every machine has a program that checks it (`sha256sum`).

use crate::error::{Error, Result};
use crate::io::materials::relative;
use crate::system::disk::{folder_of, open_input};
use crate::system::progress::Progress;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::io::Read;
use std::path::{Path, PathBuf};

/// Stands for the hash of a file that is named and not there.
pub(crate) const MISSING: &str = "missing";

/// Length and hash of a file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct HashedFile {
    /// Length.
    pub(crate) bytes: u64,
    /// In lower case, or `MISSING`.
    pub(crate) sha256: String,
}

/// Hashes of files near a receipt; each file is read once.
pub(crate) struct Hashes<'a> {
    folder: PathBuf,
    progress: &'a Progress,
    known: BTreeMap<String, HashedFile>,
}

impl<'a> Hashes<'a> {
    /// Hashes of nothing yet, for a receipt at this path.
    pub(crate) fn beside(receipt: &Path, progress: &'a Progress) -> Result<Hashes<'a>> {
        let folder = folder_of(receipt);
        let folder = folder.canonicalize().map_err(|e| Error::reading(folder, "cannot find", e))?;
        Ok(Hashes { folder, progress, known: BTreeMap::new() })
    }

    /// The path of a file that a receipt names.
    pub(crate) fn place(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    /// The name that a receipt has for a path.
    ///
    /// Errors: `Usage` for paths that are not text.
    pub(crate) fn name(&self, path: &Path) -> Result<String> {
        if path.to_str().is_none() {
            let what = format!(
                "{}: the path is not UTF-8, a receipt cannot name it; rename it",
                path.display()
            );
            return Err(Error::Usage(what));
        }
        let real = match (folder_of(path).canonicalize(), path.file_name()) {
            (Ok(folder), Some(name)) => folder.join(name),
            _ => path.canonicalize().unwrap_or_else(|_| path.to_path_buf()),
        };
        let name = relative(&self.folder, &real);
        Ok(if name.is_empty() { ".".to_owned() } else { name })
    }

    /// The name and the hash of a file.
    pub(crate) fn entry(&mut self, path: &Path) -> Result<(String, HashedFile)> {
        let name = self.name(path)?;
        let known = match self.known.get(&name) {
            Some(known) => known.clone(),
            None => self.known.entry(name.clone()).or_insert(of_file(path, self.progress)?).clone(),
        };
        Ok((name, known))
    }
}

/// Length and hash of a file, `MISSING` where there is none.
pub(crate) fn of_file(path: &Path, progress: &Progress) -> Result<HashedFile> {
    if std::fs::metadata(path).is_err_and(|e| e.kind() == std::io::ErrorKind::NotFound) {
        return Ok(HashedFile { bytes: 0, sha256: MISSING.to_owned() });
    }
    let mut file = open_input(path)?;
    let (mut hash, mut bytes, mut block) = (Sha256::new(), 0, vec![0; 1 << 20]);
    loop {
        progress.check()?;
        match file.read(&mut block).map_err(|e| Error::reading(path, "cannot read", e))? {
            0 => break,
            n => {
                hash.update(&block[..n]);
                bytes += n as u64;
            }
        }
    }
    Ok(HashedFile { bytes, sha256: hex(&hash.finalize()) })
}

/// The hash of some bytes.
pub(crate) fn sha256_of(bytes: &[u8]) -> String {
    hex(&Sha256::digest(bytes))
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}
