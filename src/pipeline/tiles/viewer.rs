//! The page that shows a tree of tiles, as files beside it; tools/viewer says what they are made from.

use crate::error::Result;
use crate::system::disk::Disk;
use std::path::Path;

/// Names and contents.
pub(super) const FILES: [(&str, &[u8]); 3] = [
    ("index.html", include_bytes!("assets/index.html")),
    ("viewer.js", include_bytes!("assets/viewer.js")),
    ("viewer-licences.txt", include_bytes!("assets/viewer-licences.txt")),
];

/// Writes the page into the folder of a tree; returns its bytes.
pub(super) fn write_viewer(folder: &Path, disk: &Disk) -> Result<u64> {
    let mut n = 0;
    for (name, bytes) in FILES {
        let mut file = disk.create(&folder.join(name))?;
        file.append(bytes)?;
        file.sync()?;
        n += bytes.len() as u64;
    }
    disk.disown(n);
    Ok(n)
}
