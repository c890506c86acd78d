//! Rounding of coordinates by formats that hold less than the mesh: floats for doubles, steps of 16 bits.
//!
//! Says so where it could be seen; refuses, before the work, what a format cannot hold at all.

#![allow(clippy::neg_cmp_op_on_partial_ord)] // What is not a number fails every comparison.

use super::output_format::{OutputFormat, OutputKind};
use crate::ply::MeshSource;
use std::path::Path;
use stonecut_mesh::bounds::Bounds;
use stonecut_mesh::property::Scalar;
use stonecut_mesh::record::VertexSchema;
use stonecut_mesh::vec3::{cross, length_sq, sub};
use stonecut_system::error::{Error, Result};

/// Rounding by less than this share of the mean edge is not worth a line.
const SHARE: f64 = 1e-3;

/// Share of the triangles that may be thinner than a step without a line.
const THIN_SHARE: f64 = 0.01;

/// Vertices at the beginning whose edges are measured, and triangles of them.
const SAMPLED_VERTICES: usize = 65_536;
const SAMPLED_TRIANGLES: usize = 2 * SAMPLED_VERTICES;

/// Rounding of coordinates by a format.
#[derive(Clone, Copy, PartialEq)]
enum Grain {
    /// Floats of the coordinates themselves.
    Floats,
    /// 65,535 steps along the longest side of the box.
    Steps,
}

/// Watches what is written, to tell how coarse its coordinates become.
pub(super) struct Rounding {
    grain: Grain,
    least: [f64; 3],
    most: [f64; 3],
    /// Places of the first vertices.
    sample: Vec<[f64; 3]>,
    edges: f64,
    n_edges: usize,
    /// Triangles less high than a step.
    n_thin: usize,
}

impl Rounding {
    /// `None` if the output has the coordinates as they are.
    pub(super) fn of(
        schema: &VertexSchema,
        kind: OutputKind,
        format: OutputFormat,
    ) -> Option<Rounding> {
        let is_double = schema.coordinate == Scalar::F64;
        let grain = match kind {
            OutputKind::Stl if is_double => Grain::Floats,
            OutputKind::Ply if is_double && format.coordinate == Some(Scalar::F32) => Grain::Floats,
            OutputKind::Glb if format.coordinate.is_none() => Grain::Steps,
            _ => return None,
        };
        let (least, most) = ([f64::MAX; 3], [f64::MIN; 3]);
        Some(Rounding { grain, least, most, sample: Vec::new(), edges: 0.0, n_edges: 0, n_thin: 0 })
    }

    /// Takes packed records.
    pub(super) fn add_vertices(&mut self, schema: &VertexSchema, records: &[u8]) {
        for record in records.chunks_exact(schema.record_bytes()) {
            let position = schema.position(record);
            for (axis, x) in position.into_iter().enumerate() {
                self.least[axis] = self.least[axis].min(x);
                self.most[axis] = self.most[axis].max(x);
            }
            if self.sample.len() < SAMPLED_VERTICES {
                self.sample.push(position);
            }
        }
    }

    /// Takes triangles, which come after all vertices.
    pub(super) fn add_faces(&mut self, triangles: impl IntoIterator<Item = [u64; 3]>) {
        let step = self.step();
        for triangle in triangles {
            if self.n_edges >= 3 * SAMPLED_TRIANGLES {
                return;
            }
            let corners = triangle.map(|v| self.sample.get(v as usize).copied());
            let [Some(a), Some(b), Some(c)] = corners else { continue };
            let lengths = [(a, b), (b, c), (c, a)].map(|(p, q)| length_sq(sub(p, q)).sqrt());
            self.edges += lengths.iter().sum::<f64>();
            self.n_edges += 3;
            let longest = lengths.into_iter().fold(0.0, f64::max);
            let height = length_sq(cross(sub(b, a), sub(c, a))).sqrt() / longest;
            self.n_thin += usize::from(height > 0.0 && height < step);
        }
    }

    /// Distance of a coordinate from the next, where it is largest.
    fn step(&self) -> f64 {
        let far = (0..3).map(|i| self.least[i].abs().max(self.most[i].abs())).fold(0.0, f64::max);
        let extent = (0..3).map(|i| self.most[i] - self.least[i]).fold(0.0, f64::max);
        match self.grain {
            Grain::Floats => float_step(far),
            Grain::Steps => extent / 65_535.0,
        }
    }

    /// True if the surface becomes stairs: a step is half as long as the mean edge, or most triangles are thinner than one.
    pub(super) fn is_ruinous(&self) -> bool {
        let is_long = 2.0 * self.step() < self.edges / self.n_edges as f64;
        self.n_edges > 0 && !(is_long && 6 * self.n_thin <= self.n_edges)
    }

    /// A line on the rounding, if it is more than a thousandth of the mean edge, or many triangles are thinner than it.
    pub(super) fn note(&self) -> Option<String> {
        let (mean, step) = (self.edges / self.n_edges as f64, self.step());
        let is_thin = self.n_thin as f64 > THIN_SHARE * (self.n_edges / 3) as f64;
        // Half a step is the most that a coordinate moves.
        if !(step / 2.0 > SHARE * mean || is_thin) {
            return None;
        }
        let thin = match is_thin {
            true => {
                let percent = 300.0 * self.n_thin as f64 / self.n_edges as f64;
                let fate = if self.is_ruinous() { ": they lose their shape" } else { "" };
                format!(" ({percent:.0} % of the triangles are thinner{fate})")
            }
            false => String::new(),
        };
        let share = 100.0 * step / mean;
        let (what, way) = match self.grain {
            Grain::Floats => (
                "floats so far from the origin have",
                "--recentre moves the mesh there; PLY (double) and OBJ keep the coordinates",
            ),
            Grain::Steps => ("GLB has 16 bits an axis, here", "--format float has more"),
        };
        Some(format!(
            "coordinates are rounded: {what} steps of {step:.2e}, {share:.2} % of the mean edge{thin}; {way}"
        ))
    }
}

/// The distance of a float from the next, at a distance from the origin.
fn float_step(far: f64) -> f64 {
    let float = far as f32;
    f64::from(f32::from_bits(float.to_bits() + 1)) - f64::from(float)
}

/// Refuses a mesh whose coordinates an output of floats cannot hold. A pass over the vertices if they are doubles.
pub fn check_range(source: &MeshSource, output: &Path, format: OutputFormat) -> Result<()> {
    let kind = format.kind.map_or_else(|| OutputKind::of(output), Ok)?;
    let is_float = match kind {
        OutputKind::Stl | OutputKind::Glb => true,
        OutputKind::Ply => format.coordinate == Some(Scalar::F32),
        OutputKind::Obj => false,
    };
    let schema = source.schema();
    if !is_float || schema.coordinate != Scalar::F64 {
        return Ok(());
    }
    let mut bounds = Bounds::EMPTY;
    source.each_vertex(|vertex, record| {
        bounds.add(schema.position(record));
        let far = schema.position(record).map(f64::abs).into_iter().fold(0.0, f64::max);
        if far <= f64::from(f32::MAX) {
            return Ok(());
        }
        let what = format!(
            "element vertex, row {vertex}: a coordinate of {far:e} is beyond what the output's floats hold \
             (3.4e38); write PLY with double, or OBJ"
        );
        Err(Error::bad_input(source.path(), what))
    })?;
    let size = bounds.diagonal();
    if kind == OutputKind::Glb && size > 0.0 && size < 65_536.0 * f64::from(f32::MIN_POSITIVE) {
        let what = format!(
            "it is {size:e} large, less than the output's floats tell from 0 (1.2e-38); make it larger with --scale, or \
             write PLY with double, or OBJ"
        );
        return Err(Error::bad_input(source.path(), what));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_of_floats_grow_with_the_distance() {
        assert_eq!(float_step(1.0), 2f64.powi(-23));
        assert_eq!(float_step(5_712_345.0), 0.5);
        let schema = VertexSchema { coordinate: Scalar::F64, properties: Vec::new() };
        let note = |shift: f64| {
            let format = OutputFormat::default();
            let mut rounding = Rounding::of(&schema, OutputKind::Stl, format).unwrap();
            let mut records = Vec::new();
            for [x, y] in [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]] {
                schema.encode_position([x + shift, y, 0.0], &mut records);
            }
            rounding.add_vertices(&schema, &records);
            rounding.add_faces([[0, 1, 2]]);
            rounding.note()
        };
        assert_eq!(note(0.0), None);
        assert!(note(500_000.0).unwrap().contains("3.12e-2"));
    }
}
