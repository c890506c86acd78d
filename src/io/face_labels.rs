//! The regions that faces belong to, by a property of theirs: one label, or `left` and `right` of a wall.
//!
//! With `left` and `right` a face stands once and parts two regions: `left` is behind it, `right` in front, where its normal
//! points; 0 is the outside. Reads labels beside triangles, block by block. Decides nothing about regions.

use crate::ply::{FaceBlock, FullFace, MeshSource};
use std::collections::HashMap;
use stonecut_mesh::patches::LABEL_NAMES;
use stonecut_mesh::property::{Property, Scalar, read_scalar, write_scalar};
use stonecut_system::error::Result;

/// Names of a wall's two labels.
pub const SIDES: [&str; 2] = ["left", "right"];

/// Place of the labels among the properties of a face.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FaceLabels {
    /// Name of the property, or of two.
    pub names: Vec<String>,
    places: Vec<(Scalar, usize)>,
}

impl FaceLabels {
    /// The labels that faces have: `left` and `right`, or a property of whole numbers with one of the usual names.
    pub fn of(source: &MeshSource) -> Option<FaceLabels> {
        let usual = LABEL_NAMES.iter().find_map(|name| Self::named(source, &[name]));
        Self::named(source, &SIDES).or(usual)
    }

    /// The labels of these names, if faces have them as whole numbers.
    pub fn named(source: &MeshSource, names: &[&str]) -> Option<FaceLabels> {
        let properties = source.face_properties();
        let place = |name: &&str| {
            let i = properties.iter().position(|p| p.name == **name && p.scalar.is_integer())?;
            let before = properties[..i].iter().map(|p: &Property| p.scalar.bytes()).sum();
            Some((properties[i].scalar, before))
        };
        let places = names.iter().map(place).collect::<Option<Vec<_>>>()?;
        Some(FaceLabels { names: names.iter().map(|name| (*name).to_owned()).collect(), places })
    }

    /// Returns whether faces part two regions.
    pub fn are_sides(&self) -> bool {
        self.places.len() == 2
    }

    /// The regions behind and in front of a wall with these values.
    pub(crate) fn sides(&self, values: &[u8]) -> [i64; 2] {
        [0, 1].map(|side| {
            let (scalar, at) = self.places[side];
            read_scalar(scalar, values, at) as i64
        })
    }

    /// Brings the labels of a wall in order: the outside in front, of two regions the lesser behind. True if the face is to be turned over.
    pub(crate) fn put_in_order(&self, values: &mut [u8]) -> bool {
        let [left, right] = self.sides(values);
        let is_turned = right != 0 && (left == 0 || right < left);
        if is_turned {
            for (&(scalar, at), label) in self.places.iter().zip([right, left]) {
                write_scalar(scalar, values, at, label as f64);
            }
        }
        is_turned
    }

    /// The regions behind and in front of a face; `None` for the outside, and in front of a face with one label.
    fn read(&self, face: &FullFace) -> [Option<i64>; 2] {
        let mut labels = [None; 2];
        for (label, &(scalar, at)) in labels.iter_mut().zip(&self.places) {
            let value = read_scalar(scalar, &face.values, at) as i64;
            *label = (value != 0 || !self.are_sides()).then_some(value);
        }
        labels
    }

    /// Calls `each` with every block of triangles, and with the regions behind and in front of each of them.
    ///
    /// Memory: a block of faces and its labels.
    pub fn each_block(
        &self,
        source: &MeshSource,
        mut each: impl FnMut(&FaceBlock, &[[Option<i64>; 2]]) -> Result<()>,
    ) -> Result<()> {
        let (mut block, mut index) = (FaceBlock::default(), 0);
        let (mut rows, mut of_triangles) = (Vec::new(), Vec::new());
        let mut finish = |index: u64, rows: &mut Vec<[Option<i64>; 2]>| {
            source.read_faces_with_rows(index, &mut block)?;
            of_triangles.clear();
            of_triangles.extend(block.rows.iter().map(|&row| rows[row as usize]));
            rows.clear();
            each(&block, &of_triangles)
        };
        source.each_full_face(|row, face| {
            while index + 1 < source.n_face_blocks() && row >= source.first_row(index + 1) {
                finish(index, &mut rows)?;
                index += 1;
            }
            // Rows without a face keep their place.
            rows.resize((row - source.first_row(index)) as usize, [None; 2]);
            rows.push(self.read(face));
            Ok(())
        })?;
        for index in index..source.n_face_blocks() {
            finish(index, &mut rows)?;
        }
        Ok(())
    }
}

/// The order in which walls between the same two regions have their labels, of each two regions by the first wall.
#[derive(Default)]
pub(crate) struct WallOrders {
    is_rising: HashMap<[i64; 2], bool>,
    /// True once there are walls of either order, or more pairs of regions than are remembered.
    pub(crate) are_mixed: bool,
}

impl WallOrders {
    /// Pairs of regions that are remembered.
    const MOST: usize = 1 << 20;

    /// Adds a wall by the regions behind it and in front of it.
    pub(crate) fn add(&mut self, [left, right]: [i64; 2]) {
        if left != right && !self.are_mixed {
            let is_rising = left < right;
            let pair = [left.min(right), left.max(right)];
            let first = *self.is_rising.entry(pair).or_insert(is_rising);
            self.are_mixed = first != is_rising || self.is_rising.len() > Self::MOST;
        }
    }
}
