//! Writes what stands beside an output: copied images first, then the material library.
//!
//! Nothing of the input is replaced. Each appears whole or not at all; what is there with the same bytes stays, so that a resumed run goes on.

use super::description::Materials;
use super::images::copy_bytes;
use super::mtl_text;
use super::plan::{TexturePlan, stem};
use crate::output_format::OutputKind;
use std::path::Path;
use stonecut_system::disk::{Disk, folder_of};
use stonecut_system::error::Result;
use stonecut_system::made::Made;
use stonecut_system::paths::real;
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

impl Materials {
    /// Refuses an output beside which a new texture, or its library, would replace an image or a library of the input, `--force` or
    /// not.
    pub fn refuse_new_texture(&self, output: &Path, kind: OutputKind) -> Result<()> {
        let stem = stem(output);
        if kind == OutputKind::Obj {
            self.refuse_output(&output.with_file_name(format!("{stem}.mtl")))?;
        }
        let folder = real(&folder_of(output).join(format!("{stem}_textures")));
        let is_page = |path: &&Path| {
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            let number = name.strip_prefix(&stem).and_then(|rest| rest.strip_prefix('_'));
            number.is_some_and(|rest| rest.starts_with(|c: char| c.is_ascii_digit()))
                && real(path).parent() == Some(&folder)
        };
        // GLB holds its images.
        let mut files = self.files().filter(|_| kind != OutputKind::Glb);
        files.find(is_page).map_or(Ok(()), |path| self.refuse_output(path))
    }
}
