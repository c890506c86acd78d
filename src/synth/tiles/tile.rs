//! One tile: its triangles with their vertices, edges split along its border, coordinates rounded by its rule.

use super::boxes::Boxes;
use crate::noise::hash2;
use stonecut_io::ply::TexturedTriangle;
use stonecut_io::ply::raw::RawFile;
use stonecut_io::ply::row_window::RowWindow;
use stonecut_mesh::property::{Scalar, read_scalar, write_scalar};
use stonecut_mesh::record::VertexSchema;
use stonecut_system::error::Result;

/// Rule that rounds coordinates of tiles; each tile counts from another place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rounding {
    /// Digits after the point.
    Digits(u32),
    /// A step in units of the mesh.
    Step(f64),
}

impl std::str::FromStr for Rounding {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if let Some(digits) = text.parse().ok().filter(|&digits: &u32| digits <= 9) {
            return Ok(Rounding::Digits(digits));
        }
        let step = text.parse().ok().filter(|&step: &f64| step > 0.0 && step.is_finite());
        let step = step.filter(|_| text.contains(['.', 'e']));
        step.map(Rounding::Step)
            .ok_or_else(|| "digits after the point, 0 to 9, or a step: 0.005, 1e-4".to_owned())
    }
}

/// Parts of a step that the places differ by which tiles count from.
const PHASES: u64 = 100;

impl Rounding {
    /// Rounds a coordinate by the rule of a tile.
    fn apply(self, x: f64, tile: u32, axis: usize) -> f64 {
        let phase = (hash2(u64::from(tile), axis as u64) % PHASES) as f64;
        let parts = PHASES as f64;
        match self {
            // A whole number over a power of ten, so that it is printed with as few digits as it has.
            Rounding::Digits(digits) => {
                let scale = 10f64.powi(digits as i32);
                ((x * scale - phase / parts).round() * parts + phase) / (parts * scale)
            }
            Rounding::Step(step) => ((x / step - phase / parts).round() + phase / parts) * step,
        }
    }
}

/// The triangles of one tile.
#[derive(Default)]
pub(super) struct Tile {
    pub(super) number: u32,
    pub(super) faces: Vec<TexturedTriangle>,
    /// Number of each face's image, if there are any.
    pub(super) pages: Vec<u32>,
    /// Numbers of its vertices in the whole mesh, in ascending order.
    ids: Vec<u64>,
    /// Their records.
    pub(super) records: Vec<u8>,
}

/// Chooses the edges that are split.
const SEED: u64 = 77;

impl Tile {
    /// Gives the tile its own vertices, numbered in the order of the whole mesh.
    pub(super) fn gather(&mut self, vertices: &RawFile, row_bytes: usize) -> Result<()> {
        self.ids.clear();
        self.ids.extend(self.faces.iter().flat_map(|face| face.corners));
        self.ids.sort_unstable();
        self.ids.dedup();
        for face in &mut self.faces {
            face.corners =
                face.corners.map(|id| self.ids.partition_point(|&other| other < id) as u64);
        }
        self.records.clear();
        let mut rows = RowWindow::new(vertices, row_bytes);
        for id in &self.ids {
            self.records.extend_from_slice(rows.get(*id)?);
        }
        Ok(())
    }

    /// Splits a third of the edges of the border whose middle lies in this tile's box, so that the tile on their other side has
    /// none of the new vertices; returns how many.
    pub(super) fn split_border(&mut self, schema: &VertexSchema, boxes: &Boxes) -> u64 {
        let mut edges: Vec<([u64; 2], usize, usize)> = Vec::with_capacity(3 * self.faces.len());
        for (at, face) in self.faces.iter().enumerate() {
            let [a, b, c] = face.corners;
            for (corner, [a, b]) in [[a, b], [b, c], [c, a]].into_iter().enumerate() {
                edges.push(([a.min(b), a.max(b)], at, corner));
            }
        }
        edges.sort_unstable();
        let n_bytes = schema.record_bytes();
        let mut chosen: Vec<(usize, usize, Vec<u8>)> = Vec::new();
        for run in edges.chunk_by(|a, b| a.0 == b.0) {
            let &[(edge, at, corner)] = run else { continue };
            let [a, b] = edge.map(|v| v as usize);
            if !hash2(self.ids[a] << 32 | self.ids[b], SEED).is_multiple_of(3) {
                continue;
            }
            let ends = [a, b].map(|v| &self.records[v * n_bytes..(v + 1) * n_bytes]);
            let middle = middle_of(schema, ends);
            if boxes.home(schema.position(&middle)) == self.number {
                chosen.push((at, corner, middle));
            }
        }
        // A face is split once.
        chosen.sort_unstable();
        chosen.dedup_by_key(|(at, ..)| *at);
        for (at, corner, middle) in &chosen {
            let new = (self.records.len() / n_bytes) as u64;
            self.records.extend_from_slice(middle);
            let (mut first, mut second) = (self.faces[*at], self.faces[*at]);
            let next = (corner + 1) % 3;
            let [a, b] = [first.texture[*corner], first.texture[next]];
            let uv = [0, 1].map(|k| 0.5 * (a[k] + b[k]));
            (first.corners[next], first.texture[next]) = (new, uv);
            (second.corners[*corner], second.texture[*corner]) = (new, uv);
            self.faces[*at] = first;
            self.faces.push(second);
            if let Some(&page) = self.pages.get(*at) {
                self.pages.push(page);
            }
        }
        chosen.len() as u64
    }

    /// Rounds all coordinates, which become doubles; the records are then those of the schema that is returned.
    pub(super) fn round(&mut self, schema: &VertexSchema, rounding: Rounding) -> VertexSchema {
        let out = VertexSchema { coordinate: Scalar::F64, ..schema.clone() };
        let mut records = Vec::with_capacity(self.records.len() * 2);
        for record in self.records.chunks_exact(schema.record_bytes()) {
            let p = schema.position(record);
            out.encode_position(
                [0, 1, 2].map(|k| rounding.apply(p[k], self.number, k)),
                &mut records,
            );
            records.extend_from_slice(&record[schema.position_bytes()..]);
        }
        self.records = records;
        out
    }
}

/// The record half-way between two others.
fn middle_of(schema: &VertexSchema, [a, b]: [&[u8]; 2]) -> Vec<u8> {
    let [p, q] = [a, b].map(|record| schema.position(record));
    let mut out = Vec::with_capacity(a.len());
    schema.encode_position([0, 1, 2].map(|k| 0.5 * (p[k] + q[k])), &mut out);
    out.extend_from_slice(&a[out.len()..]);
    let mut at = schema.position_bytes();
    for property in &schema.properties {
        let scalar = property.scalar;
        let value = 0.5 * (read_scalar(scalar, a, at) + read_scalar(scalar, b, at));
        write_scalar(scalar, &mut out, at, value);
        at += scalar.bytes();
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_tile_rounds_by_its_own_rule() {
        let digits: Rounding = "3".parse().unwrap();
        let places: Vec<f64> = (0..20).map(|tile| digits.apply(12.345_678_9, tile, 0)).collect();
        assert!(places.iter().all(|x| (x - 12.345_678_9).abs() <= 0.000_500_1));
        assert!(places.iter().any(|x| *x != places[0]));
        assert!(places.iter().all(|x| x.to_string().len() <= 8), "{places:?}");
        let step: Rounding = "0.25".parse().unwrap();
        assert!((0..20).all(|tile| (step.apply(7.1, tile, 2) - 7.1).abs() <= 0.125));
        for text in ["", "10", "-1", "0.0", "x", "inf", "-0.1"] {
            assert!(text.parse::<Rounding>().is_err(), "{text}");
        }
    }
}
