//! Puts the faces of an output into the order of their names and materials, out of core.
//!
//! For formats in which a name or a material holds for all faces after it. Within both the order stays.

use super::external_sort::{ExternalSort, halves};
use crate::names::{Name, NameTable, OBJECT};
use crate::ply::{OutputHeader, TexturedTriangle};
use std::path::Path;
use stonecut_mesh::property::{Scalar, read_scalar};
use stonecut_system::error::Result;

/// The names that an output of grouped faces has: those of its comments, if its faces have their numbers, or a single one.
pub(super) fn names_of(header: &OutputHeader) -> NameTable {
    let names = NameTable::of(&header.comments);
    let has_place = header.faces.place_of(OBJECT).is_some() || names.len() == 1;
    // Beyond that, a label would be more than a number of four bytes.
    let n_labels = (names.len() as u64 + 1) * (n_materials(header) as u64 + 1);
    let fits = n_labels <= u64::from(u32::MAX);
    if has_place && fits { names } else { NameTable::default() }
}

fn n_materials(header: &OutputHeader) -> usize {
    header.textures.as_ref().map_or(0, |plan| plan.materials.list.len())
}

/// Name and material of a face, in one number: faces are sorted by it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct FaceLabel {
    /// Place among the names.
    pub(super) name: Option<u32>,
    /// Number of the material.
    pub(super) material: Option<u32>,
}

/// Finds the label of a face among its packed values.
#[derive(Debug)]
pub(super) struct LabelOf {
    material: Option<(Scalar, usize)>,
    name: Option<(Scalar, usize)>,
    value_bytes: usize,
    n_materials: u32,
    /// Place of each name in the order of writing, from 1 on; 0 for none.
    ranks: Vec<u32>,
    /// Names in that order.
    pub(super) names: Vec<Name>,
}

impl LabelOf {
    pub(super) fn new(header: &OutputHeader) -> LabelOf {
        let (names, ranks) = names_of(header).ranked();
        LabelOf {
            material: header.faces.number_at(),
            name: header.faces.place_of(OBJECT),
            value_bytes: header.faces.value_bytes(),
            n_materials: n_materials(header) as u32,
            ranks,
            names,
        }
    }

    /// Returns whether faces differ in their names.
    pub(super) fn has_many_names(&self) -> bool {
        self.name.is_some() && !self.names.is_empty()
    }

    /// The label of face `i`; material and name of all where faces have no number.
    pub(super) fn find(&self, values: &[u8], i: usize) -> u32 {
        let number = |place: Option<(Scalar, usize)>| match place {
            Some((scalar, at)) => read_scalar(scalar, &values[i * self.value_bytes..], at),
            None => 0.0,
        };
        // A number beyond the materials, or the names, names none.
        let within = |number: f64, end: usize| number >= 0.0 && number < end as f64;
        let material =
            Some(number(self.material)).filter(|&number| within(number, self.n_materials as usize));
        let name = Some(number(self.name)).filter(|&number| within(number, self.ranks.len()));
        let rank = name.map_or(0, |number| self.ranks[number as usize]);
        rank * (self.n_materials + 1) + material.map_or(0, |number| number as u32 + 1)
    }

    /// The label of faces that have no values.
    pub(super) fn find_without_values(&self) -> u32 {
        let rank = if self.name.is_none() { self.ranks.first().copied().unwrap_or(0) } else { 0 };
        let material = u32::from(self.material.is_none() && self.n_materials > 0);
        rank * (self.n_materials + 1) + material
    }

    /// Name and material of a label.
    pub(super) fn parts(&self, label: u32) -> FaceLabel {
        let n = self.n_materials + 1;
        FaceLabel { name: (label / n).checked_sub(1), material: (label % n).checked_sub(1) }
    }
}

/// Words of a face: label, its place in the order, corners, coordinates.
const WORDS: usize = 12;

/// Sorts faces by label; those without name or material come first.
///
/// Memory: the header's. Disk: 48 bytes a face beyond that.
pub(super) struct ByMaterial {
    sort: ExternalSort<WORDS>,
    n_faces: u64,
}

impl ByMaterial {
    /// Fails for more vertices than 4 bytes can count.
    pub(super) fn new(folder: &Path, header: &OutputHeader) -> Result<ByMaterial> {
        header.index_type()?;
        Ok(ByMaterial { sort: ExternalSort::new(folder, header.sort_memory_bytes), n_faces: 0 })
    }

    /// Appends a face.
    pub(super) fn push(&mut self, label: u32, face: &TexturedTriangle) -> Result<()> {
        let [high, low] = halves(self.n_faces);
        self.n_faces += 1;
        let mut record = [0; WORDS];
        (record[0], record[1], record[2]) = (label, high, low);
        for (k, (corner, [u, v])) in face.corners.iter().zip(face.texture).enumerate() {
            record[3 + k] = *corner as u32;
            (record[6 + 2 * k], record[7 + 2 * k]) = (u.to_bits(), v.to_bits());
        }
        self.sort.push(record)
    }

    /// Hands on all faces in order, each with its label.
    pub(super) fn drain(
        self,
        mut each: impl FnMut(u32, &TexturedTriangle) -> Result<()>,
    ) -> Result<()> {
        self.sort.drain(|record| {
            let number = |i: usize| f32::from_bits(record[i]);
            let face = TexturedTriangle {
                corners: [3, 4, 5].map(|i| u64::from(record[i])),
                texture: [6, 8, 10].map(|i| [number(i), number(i + 1)]),
                ..TexturedTriangle::default()
            };
            each(record[0], &face)
        })
    }
}
