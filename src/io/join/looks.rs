//! The union of the materials of several meshes: equal ones are one, and so are images of the same content.

use crate::materials::{Image, ImageData, Materials, Part as FilePart};
use crate::ply::raw::RawFile;
use std::collections::HashMap;
use stonecut_system::error::Result;
use xxhash_rust::xxh3::Xxh3;

/// Materials of several meshes.
#[derive(Default)]
pub(super) struct Looks {
    pub materials: Materials,
    /// Images by length and checksum.
    images: HashMap<(u64, u64), usize>,
    /// Places of materials by their names.
    by_name: HashMap<String, Vec<usize>>,
}

impl Looks {
    /// Takes in the materials of a mesh; gives the new number of each.
    pub fn add(&mut self, own: &Materials) -> Result<Vec<i32>> {
        let mut images = Vec::with_capacity(own.images.len());
        for image in &own.images {
            images.push(self.image(image)?);
        }
        own.losses.entries().iter().for_each(|loss| self.materials.lose(loss.clone()));
        for library in &own.libraries {
            if !self.materials.libraries.contains(library) {
                self.materials.libraries.push(library.clone());
            }
        }
        self.materials.n_tinted += own.n_tinted;
        let mut numbers = Vec::with_capacity(own.list.len());
        for material in &own.list {
            let mut material = material.clone();
            material.maps.iter_mut().for_each(|map| map.image = images[map.image]);
            let list = &mut self.materials.list;
            let alike = self.by_name.entry(material.name.clone()).or_default();
            let known = alike.iter().copied().find(|&i| list[i] == material);
            let number = known.unwrap_or_else(|| {
                list.push(material);
                alike.push(list.len() - 1);
                list.len() - 1
            });
            numbers.push(number as i32);
        }
        Ok(numbers)
    }

    /// The place of an image; one that is not there is known by its path.
    fn image(&mut self, image: &Image) -> Result<usize> {
        let content = match &image.data {
            ImageData::File(path) => match RawFile::open(path) {
                Ok(file) => Some(content(&file, 0, file.len())?),
                Err(_) => None,
            },
            ImageData::Inside(FilePart { file, offset, n_bytes }) => {
                Some(content(file, *offset, *n_bytes)?)
            }
        };
        let Some(content) = content else { return Ok(self.materials.add_image(image.clone())) };
        if let Some(&number) = self.images.get(&content) {
            return Ok(number);
        }
        let number = self.materials.add_image(image.clone());
        self.images.insert(content, number);
        Ok(number)
    }

    /// All materials, each with its own name.
    pub fn finish(mut self) -> Option<Materials> {
        self.materials.name_all();
        (!self.materials.list.is_empty()).then_some(self.materials)
    }

    /// Names of the images.
    pub fn image_names(&self) -> Vec<String> {
        self.materials.images.iter().map(|image| image.name.clone()).collect()
    }
}

/// Length and checksum of a part of a file.
pub(super) fn content(file: &RawFile, offset: u64, n_bytes: u64) -> Result<(u64, u64)> {
    let mut hasher = Xxh3::new();
    file.each_piece(offset..offset + n_bytes, 1 << 18, |bytes| {
        hasher.update(bytes);
        Ok(())
    })?;
    Ok((n_bytes, hasher.digest()))
}
