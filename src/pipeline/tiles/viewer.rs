//! The page that shows a tree of tiles, as files beside it; web/README.md says what they are made from.

use crate::error::Result;
use crate::system::disk::Disk;
use std::path::Path;

/// Names and contents.
pub(super) const FILES: [(&str, &[u8]); 4] = [
    ("index.html", include_bytes!("../../../web/tiles.html")),
    ("three.js", include_bytes!("../../../web/built/three.js")),
    ("viewer.js", include_bytes!("../../../web/built/tiles.js")),
    ("viewer-licences.txt", include_bytes!("../../../web/licences.txt")),
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
