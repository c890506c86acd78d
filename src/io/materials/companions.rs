//! Writes what stands beside an output: copied images first, then the material library.
//!
//! Each appears whole or not at all; what is there with the same bytes stays, so that a resumed run goes on.

use super::images::copy_bytes;
use super::mtl_text;
use super::plan::TexturePlan;
use crate::error::Result;
use crate::system::disk::{Disk, folder_of};
use crate::system::pending_file::{PendingFile, Place, write_whole};

impl TexturePlan {
    /// Writes all files beside the output; the output itself comes after them.
    pub(crate) fn write_sides(&self, disk: &Disk) -> Result<()> {
        for copy in &self.copies {
            disk.create_dir(folder_of(&copy.target))?;
            let place =
                Place { path: copy.target.clone(), disk: disk.clone(), replace: self.force };
            let mut file = PendingFile::create(place)?;
            copy_bytes(&self.materials.images[copy.image].data, |bytes| file.write(bytes))?;
            file.finish()?;
        }
        if let (Some(path), false) = (&self.library, self.materials.list.is_empty()) {
            let n_images = self.materials.images.len();
            let names: Vec<Option<String>> =
                (0..n_images).map(|image| self.path_of(image).map(str::to_owned)).collect();
            let text = mtl_text::library(&self.materials, &names);
            let place = Place { path: path.clone(), disk: disk.clone(), replace: true };
            write_whole(place, text.as_bytes())?;
        }
        Ok(())
    }

    /// The library's name as an OBJ file beside it names it.
    pub(crate) fn library_name(&self) -> Option<String> {
        let name =
            self.library.as_ref().filter(|_| !self.materials.list.is_empty())?.file_name()?;
        Some(name.to_string_lossy().into_owned())
    }
}
