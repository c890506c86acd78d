//! Parts out of trees of tiles that other programs made.

use super::InputSet;
use std::path::Path;
use stonecut_system::error::{Error, Result};

/// The finest tiles of the tree that a `tileset.json` describes.
pub(super) fn parts_of(path: &Path) -> Result<InputSet> {
    let what = "this describes a tree of tiles; name its meshes, or make one of it with 'stonecut extract'";
    Err(Error::bad_input(path, what))
}
