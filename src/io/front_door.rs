//! The front door for meshes: one file, or several that become one.

use super::join::{InputPaths, stage};
use super::open::open_part;
use super::open_options::StageOptions;
use super::{hard_edges, lock, weld};
use crate::ply::MeshSource;
use std::path::Path;
use stonecut_system::error::Result;

impl MeshSource {
    /// Opens any input: a file of any format, `-` for standard input, several files, a folder, a list.
    ///
    /// A plain PLY file is opened where it is, like `open_with`, unless it is a range grid; everything else is staged first.
    /// So is what `StageOptions::weld` joins. Several files are staged as one mesh whose borders are joined.
    pub fn open_staged(input: impl Into<InputPaths>, options: &StageOptions) -> Result<Self> {
        let input = input.into();
        let source = if input.is_one() {
            let mut source = open_part(&input, None, options)?;
            let found = if *input == *Path::new("-") { None } else { source.locate(&input) };
            found.iter().for_each(|found| source.note_place(found));
            source.place(&options.read.placing)?;
            let loss = hard_edges::survey(&source, options)?;
            loss.into_iter().for_each(|loss| source.note_loss(loss));
            weld::weld(source, options)?
        } else {
            let (mut source, borders) = stage(&input, options)?;
            source.place(&options.read.placing)?;
            weld::join_parts(source, &borders, options)?
        };
        lock::lock(source, options)
    }
}
