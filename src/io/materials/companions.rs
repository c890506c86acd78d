//! Writes what stands beside an output: copied images first, then the material library.
//!
//! Each appears whole or not at all; what is there with the same bytes stays, so that a resumed run goes on.

use super::images::copy_bytes;
use super::mtl_text;
use super::plan::TexturePlan;
use stonecut_system::disk::{Disk, folder_of};
use stonecut_system::error::Result;
use stonecut_system::made::Made;
use stonecut_system::pending_file::{PendingFile, Place, Seen, write_whole};

impl TexturePlan {
    /// Writes all files beside the output; the output itself comes after them, and without it they go again.
    pub fn write_sides(&self, disk: &Disk) -> Result<Made> {
        let mut made = Made::new(disk);
        for copy in &self.copies {
            made.folder(folder_of(&copy.target))?;
            let place =
                Place { path: copy.target.clone(), disk: disk.clone(), replace: self.force };
            made.file(&copy.target, || {
                let mut file = PendingFile::create(place)?;
                copy_bytes(&self.materials.images[copy.image].data, |bytes| file.write(bytes))?;
                file.finish().map(drop)
            })?;
        }
        if let (Some(path), false) = (&self.library, self.materials.list.is_empty()) {
            let n_images = self.materials.images.len();
            let names: Vec<Option<String>> =
                (0..n_images).map(|image| self.path_of(image).map(str::to_owned)).collect();
            let text = mtl_text::library(&self.materials, &names);
            // One that was there when the command began was checked.
            let is_known = self.library_seen.as_ref().is_some_and(Seen::is_unchanged);
            let replace = self.force || is_known;
            let place = Place { path: path.clone(), disk: disk.clone(), replace };
            made.file(path, || write_whole(place, text.as_bytes()))?;
        }
        Ok(made)
    }

    /// The library's name as an OBJ file beside it names it.
    pub fn library_name(&self) -> Option<String> {
        let name =
            self.library.as_ref().filter(|_| !self.materials.list.is_empty())?.file_name()?;
        Some(name.to_string_lossy().into_owned())
    }
}
