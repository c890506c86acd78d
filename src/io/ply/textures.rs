//! Materials as PLY files have them: comments that name images, and the number that each face has.
//!
//! `comment TextureFile PATH` in the order of numbers is what MeshLab and others read. Names of materials follow as
//! `comment usemtl NAME`, which only this program reads, where the images' names do not give them; in ASCII, as names of objects
//! are.

use super::header::{Header, texture_file};
use crate::materials::{Materials, Search, TexturePlan};
use crate::names::{escaped, unescaped};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use stonecut_mesh::property::{Scalar, read_scalar, write_scalar};
use stonecut_system::disk::folder_of;

const NAME: &str = "usemtl ";

/// The materials that a header's comments name; images are named from the folder of the file.
pub(super) fn materials_of(header: &Header, path: &Path) -> Option<Arc<Materials>> {
    let names: Vec<String> = (header.comments.iter())
        .filter_map(|line| line.strip_prefix(NAME))
        .map(|name| unescaped(name.trim()))
        .collect();
    let mut search = Search::new("image", &[folder_of(path)]);
    let file = |name: String| {
        let file = search.find_text(&name);
        (name, file)
    };
    let files: Vec<(String, PathBuf)> = header.texture_files().into_iter().map(file).collect();
    let is_none = files.is_empty() && names.is_empty();
    let mut materials = Materials::of_files(&files, &names);
    search.note().into_iter().for_each(|note| materials.note(note));
    (!is_none).then(|| Arc::new(materials))
}

/// Returns whether a comment belongs to the materials, which every writer has in its form.
pub(super) fn is_of_materials(comment: &str) -> bool {
    texture_file(comment).is_some() || comment.starts_with(NAME)
}

/// Materials in the order of a PLY file: those with an image first, since images are counted.
fn order(plan: &TexturePlan) -> Vec<usize> {
    let (mut order, rest): (Vec<usize>, Vec<usize>) =
        (0..plan.materials.list.len()).partition(|&number| plan.base_path(number).is_some());
    if order.is_empty() {
        order = rest;
    }
    order
}

/// The comments of a file with these materials.
pub(super) fn comments(plan: &TexturePlan) -> Vec<String> {
    let order = order(plan);
    let paths: Vec<&str> = order.iter().filter_map(|&number| plan.base_path(number)).collect();
    let files: Vec<(String, PathBuf)> =
        paths.iter().map(|path| ((*path).to_owned(), PathBuf::from(path))).collect();
    let names: Vec<String> =
        order.iter().map(|&number| plan.materials.list[number].name.clone()).collect();
    let plain = Materials::of_files(&files, &vec![String::new(); order.len() - files.len()]);
    let is_plain = plain.list.iter().map(|m| &m.name).eq(&names);
    let named = names.iter().filter(|_| !is_plain).map(|name| format!("{NAME}{}", escaped(name)));
    paths.iter().map(|path| format!("TextureFile {path}")).chain(named).collect()
}

/// Numbers of faces in the output for those of the plan; a material without a number is -1, no image.
pub(super) struct Renumbered {
    numbers: Vec<i32>,
    /// Type and place among the values of a face.
    scalar: Scalar,
    at: usize,
}

impl Renumbered {
    /// `None` if all numbers stay.
    pub(super) fn new(
        plan: &TexturePlan,
        number_at: Option<(Scalar, usize)>,
    ) -> Option<Renumbered> {
        let mut numbers = vec![-1; plan.materials.list.len()];
        for (place, number) in order(plan).into_iter().enumerate() {
            numbers[number] = place as i32;
        }
        if numbers.iter().zip(0..).all(|(a, b)| *a == b) {
            return None;
        }
        let (scalar, at) = number_at?;
        Some(Renumbered { numbers, scalar, at })
    }

    /// Changes the number in a face's values.
    pub(super) fn apply(&self, values: &mut [u8]) {
        let old = read_scalar(self.scalar, values, self.at);
        let new = self.numbers.get(old as usize).filter(|_| old >= 0.0).copied().unwrap_or(-1);
        write_scalar(self.scalar, values, self.at, f64::from(new));
    }
}
