//! Puts the faces of an output into the order of their materials, out of core.
//!
//! For formats in which a material holds for all faces after it. Within a material the order stays.

use super::external_sort::{ExternalSort, halves};
use crate::materials::TexturePlan;
use crate::ply::{FaceSchema, OutputHeader, TexturedTriangle};
use std::path::Path;
use stonecut_mesh::property::{Scalar, read_scalar};
use stonecut_system::error::Result;

/// Finds the material of a face among its packed values.
#[derive(Clone, Copy, Debug)]
pub(super) struct MaterialOf {
    place: Option<(Scalar, usize)>,
    value_bytes: usize,
    n_materials: u32,
}

impl MaterialOf {
    pub(super) fn new(faces: &FaceSchema, plan: Option<&TexturePlan>) -> MaterialOf {
        let n_materials = plan.map_or(0, |plan| plan.materials.list.len() as u32);
        MaterialOf { place: faces.number_at(), value_bytes: faces.value_bytes(), n_materials }
    }

    /// The material of face `i`; that of all where faces have no number.
    pub(super) fn find(&self, values: &[u8], i: usize) -> Option<u32> {
        let number = match self.place {
            Some((scalar, at)) => read_scalar(scalar, &values[i * self.value_bytes..], at),
            None => 0.0,
        };
        // A number beyond the materials names none.
        (number >= 0.0 && number < f64::from(self.n_materials)).then_some(number as u32)
    }
}

impl MaterialOf {
    /// The material of faces that have no values.
    pub(super) fn find_without_values(&self) -> Option<u32> {
        (self.place.is_none() && self.n_materials > 0).then_some(0)
    }
}

/// Words of a face: material, its place in the order, corners, coordinates.
const WORDS: usize = 12;

/// Sorts faces by material; those without one come first.
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
    pub(super) fn push(&mut self, material: Option<u32>, face: &TexturedTriangle) -> Result<()> {
        let [high, low] = halves(self.n_faces);
        self.n_faces += 1;
        let mut record = [0; WORDS];
        record[0] = material.map_or(0, |material| material + 1);
        (record[1], record[2]) = (high, low);
        for (k, (corner, [u, v])) in face.corners.iter().zip(face.texture).enumerate() {
            record[3 + k] = *corner as u32;
            (record[6 + 2 * k], record[7 + 2 * k]) = (u.to_bits(), v.to_bits());
        }
        self.sort.push(record)
    }

    /// Hands on all faces in order, each with its material.
    pub(super) fn drain(
        self,
        mut each: impl FnMut(Option<u32>, &TexturedTriangle) -> Result<()>,
    ) -> Result<()> {
        self.sort.drain(|record| {
            let number = |i: usize| f32::from_bits(record[i]);
            let face = TexturedTriangle {
                corners: [3, 4, 5].map(|i| u64::from(record[i])),
                texture: [6, 8, 10].map(|i| [number(i), number(i + 1)]),
                ..TexturedTriangle::default()
            };
            each(record[0].checked_sub(1), &face)
        })
    }
}
