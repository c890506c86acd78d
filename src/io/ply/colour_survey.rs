//! Surveys values whose type does not say what they need: places in text far from 0 (doubles), colours as floats or integers of
//! more than a byte (full intensity), doubles far from 0 (the middle that they are averaged about).

use super::fields::FieldPlan;
use super::header::{Encoding, Kind, Wire};
use super::source::MeshSource;
use super::{BLOCK_ROWS, VertexBlock};
use crate::extent::Extent;
use stonecut_mesh::colours::{ColourSurvey, surveyed};
use stonecut_mesh::property::{MIDDLE_SAMPLE, Origin, Property, Scalar, middle_of, read_scalar};

/// Blocks that are looked at; of a larger file as many, evenly spaced.
const MOST_BLOCKS: u64 = 256;

/// Blocks that tell whether text may lie far from 0.
const FEW_BLOCKS: u64 = 2;

impl MeshSource {
    /// Takes places in text as doubles where floats do not hold them: the header calls them `float`, whatever their digits.
    ///
    /// Reads some of the vertices; all of them where those lie far from 0.
    pub(super) fn survey_places(&mut self) {
        let is_far = |found: &Extent| found.coordinate() == Scalar::F64;
        let is_float = self.plan.schema.coordinate == Scalar::F32;
        if self.header.encoding != Encoding::Ascii
            || !is_float
            || !is_far(&self.places(FEW_BLOCKS).0)
        {
            return;
        }
        let mut vertex = self.header.elements[self.layout.vertex_element].clone();
        for property in &mut vertex.properties {
            if matches!(property.name.as_str(), "x" | "y" | "z") {
                property.kind = Kind::Scalar(Wire::Plain(Scalar::F64));
            }
        }
        let Ok(doubles) = FieldPlan::new(&vertex, Encoding::Ascii) else { return };
        let floats = std::mem::replace(&mut self.plan, doubles);
        let (all, is_held) = self.places(u64::MAX);
        if is_held || !is_far(&all) {
            self.plan = floats;
        }
    }

    /// The extent of at most some blocks of vertices, and whether floats hold what they say: exactly, or to all digits of a float.
    fn places(&self, most: u64) -> (Extent, bool) {
        let (mut extent, mut is_held, mut block) =
            (Extent::default(), true, VertexBlock::default());
        let n_blocks = self.n_vertex_blocks();
        let schema = &self.plan.schema;
        for index in (0..n_blocks).step_by(n_blocks.div_ceil(most).max(1) as usize) {
            if self.read_unchecked(index, &mut block).is_err() {
                break;
            }
            for record in block.records.chunks_exact(schema.record_bytes()) {
                let place = schema.position(record);
                extent.add(place);
                is_held = is_held && place.into_iter().all(is_of_a_float);
            }
        }
        (extent, is_held)
    }

    /// Notes the middle of doubles that lie far from 0, by the first block of vertices.
    pub(super) fn survey_doubles(&mut self) {
        let is_double = |p: &Property| p.scalar == Scalar::F64 && p.origin == Origin::Vertex;
        if !self.plan.schema.properties.iter().any(is_double) {
            return;
        }
        let mut block = VertexBlock::default();
        if self.n_vertex_blocks() == 0 || self.read_unchecked(0, &mut block).is_err() {
            return;
        }
        let schema = &mut self.plan.schema;
        let (n_bytes, mut at) = (schema.record_bytes(), schema.position_bytes());
        for property in &mut schema.properties {
            if is_double(property) {
                let records = block.records.chunks_exact(n_bytes).take(MIDDLE_SAMPLE);
                let values = records.map(|record| read_scalar(property.scalar, record, at));
                property.middle = middle_of(values.collect());
            }
            at += property.scalar.bytes();
        }
    }

    /// Notes the value of full intensity at the components of a colour, where it is not that of their type.
    ///
    /// Reads at most 16.8 million vertices. Rows that cannot be read are left to those who read all of them.
    pub(super) fn survey_colours(&mut self) {
        let schema = self.plan.schema.clone();
        let Some((components, alpha)) = surveyed(&schema) else { return };
        let place = |i: usize| {
            let before: usize = schema.properties[..i].iter().map(|p| p.scalar.bytes()).sum();
            (schema.properties[i].scalar, schema.position_bytes() + before)
        };
        let places = components.map(place);
        let n_blocks = self.n_vertex_blocks();
        let step = n_blocks.div_ceil(MOST_BLOCKS).max(1);
        let (mut survey, mut block) = (ColourSurvey::default(), VertexBlock::default());
        for index in (0..n_blocks).step_by(step as usize) {
            if self.read_unchecked(index, &mut block).is_err() {
                break;
            }
            debug_assert!(block.records.len() <= BLOCK_ROWS as usize * schema.record_bytes());
            for record in block.records.chunks_exact(schema.record_bytes()) {
                places.iter().for_each(|&(scalar, at)| survey.add(read_scalar(scalar, record, at)));
            }
        }
        let scalar = schema.properties[components[0]].scalar;
        let white = survey.white(scalar);
        let alpha = alpha.filter(|&i| schema.properties[i].scalar == scalar);
        for i in components.into_iter().chain(alpha) {
            self.plan.schema.properties[i].white = white;
        }
        self.n_outside = survey.n_outside(self.plan.schema.properties[components[0]].full());
    }
}

/// Looks whether a number is a float, or one as it is written with as few digits as it needs.
fn is_of_a_float(value: f64) -> bool {
    let float = value as f32;
    f64::from(float) == value || float.to_string().parse() == Ok(value)
}
