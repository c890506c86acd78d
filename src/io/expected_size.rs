//! The length of an output before there is one, from its counts and a sample of its vertices.
//!
//! Exact for binary files but for comments. Texts depend on their numbers: those of the sample are used, with
//! digits in all places, as positions have them after simplification.

use super::gltf as glb;
use super::obj::find3;
use super::output_format::{OutputFormat, OutputKind};
use crate::ply::Encoding;
use crate::ply::writer::{FaceSchema, Shortest, put_text};
use std::path::Path;
use stonecut_mesh::colours::ColourPlace;
use stonecut_mesh::property::{Scalar, read_scalar};
use stonecut_mesh::record::VertexSchema;
use stonecut_system::units::{show_bytes, show_count};
use stonecut_system::{Error, Result};

/// Bytes of a header beyond its comments; of the description in a GLB file.
const HEADER_BYTES: f64 = 700.0;
const DESCRIPTION_BYTES: f64 = 1600.0;

/// Bytes of a face, and of a corner, while they are sorted by material.
const SORTED_FACE_BYTES: f64 = 48.0;
const SORTED_CORNER_BYTES: f64 = 40.0;

/// Vertices of a file that has one for each pair of coordinates, for each vertex of the mesh.
const SPLIT_VERTICES: f64 = 1.5;

/// Mean length of a component of a unit vector as text, and of a texture coordinate or colour between 0 and 1.
const UNIT_TEXT: f64 = 11.0;
const SHARE_TEXT: f64 = 10.4;

/// Known properties of an output before it is written.
pub struct Expected<'a> {
    /// Its vertices.
    pub schema: &'a VertexSchema,
    /// Properties of its faces.
    pub faces: &'a FaceSchema,
    /// Counts.
    pub n_vertices: u64,
    /// Of faces.
    pub n_faces: u64,
    /// Records after `schema`, some of those that the input has.
    pub sample: &'a [u8],
}

/// Bytes of the file, and of what is kept in its folder beside it while it is written.
pub fn expected_bytes(mesh: &Expected, kind: OutputKind, format: OutputFormat) -> (u64, u64) {
    let (v, f) = (mesh.n_vertices as f64, mesh.n_faces as f64);
    let is_text = format.encoding == Some(Encoding::Ascii);
    let schema = mesh.schema;
    let (bytes, spool) = match kind {
        OutputKind::Ply if is_text => {
            let coordinate = format.coordinate.unwrap_or(schema.coordinate);
            let record = 3.0 * mesh.coordinate_text(coordinate) + 3.0 + mesh.properties_text();
            let texture = if mesh.faces.texture { 2.0 + 6.0 * (SHARE_TEXT + 1.0) } else { 0.0 };
            let values = 3.0 * mesh.faces.properties.len() as f64;
            let face = 1.0 + 3.0 * (mesh.index_text(0) + 1.0) + 1.0 + texture + values;
            (v * record + f * face, 0.0)
        }
        OutputKind::Ply => {
            let coordinate = format.coordinate.unwrap_or(schema.coordinate).bytes();
            let record = schema.record_bytes() - schema.position_bytes() + 3 * coordinate;
            let texture = if mesh.faces.texture { 25 } else { 0 };
            let face = 13 + texture + mesh.faces.value_bytes();
            (v * record as f64 + f * face as f64, 0.0)
        }
        OutputKind::Stl => {
            let corner = 3.0 * mesh.coordinate_text(Scalar::F32) + 12.0;
            let row = if is_text { 54.0 + 3.0 * UNIT_TEXT + 3.0 * corner } else { 50.0 };
            (f * row, 12.0 * v)
        }
        OutputKind::Obj => {
            let has = |names| find3(schema, names).is_some();
            let n_corner = 1.0 + f64::from(u8::from(has(["nx", "ny", "nz"])));
            let has_texture = mesh.faces.texture || super::obj::find_texture(schema).is_some();
            let normal = if n_corner > 1.0 { 3.0 + 3.0 * (UNIT_TEXT + 1.0) } else { 0.0 };
            let colour = match ColourPlace::find(schema) {
                Some(_) => 3.0 * (SHARE_TEXT + 1.0),
                None => 0.0,
            };
            let texture = if has_texture { 3.0 + 2.0 * (SHARE_TEXT + 1.0) } else { 0.0 };
            let coordinates = 3.0 * (mesh.coordinate_text(schema.coordinate) + 1.0);
            let numbers = n_corner + f64::from(u8::from(has_texture));
            let face = 2.0 + 3.0 * (numbers * (mesh.index_text(1) + 1.0));
            // Sorted by name and material.
            let sorted = if mesh.faces.has_labels() { SORTED_FACE_BYTES } else { 0.0 };
            (v * (2.0 + coordinates + colour + normal + texture) + f * face, f * sorted)
        }
        OutputKind::Glb => {
            let (colour, normal) = (ColourPlace::find(schema), find3(schema, ["nx", "ny", "nz"]));
            let extras =
                colour.map_or(0, |_| glb::COLOUR_BYTES) + normal.map_or(0, |_| glb::NORMAL_BYTES);
            let texture = if mesh.faces.texture { glb::TEXTURE_BYTES } else { 0 };
            let position = match format.coordinate {
                Some(_) => glb::FLOAT_BYTES,
                None => glb::POSITION_BYTES,
            };
            let row = position + extras + texture;
            let spooled = glb::SPOOLED_BYTES as u64 + extras;
            // Parted by name and material, and at the seams of the texture, where one vertex becomes several.
            let is_split = mesh.faces.texture || mesh.faces.has_labels();
            let (rows, sorted) = match is_split {
                true => (
                    SPLIT_VERTICES * v,
                    3.0 * SORTED_CORNER_BYTES * f + SPLIT_VERTICES * v * row as f64,
                ),
                false => (v, 0.0),
            };
            (rows * row as f64 + f * 12.0 + DESCRIPTION_BYTES, v * spooled as f64 + sorted)
        }
    };
    ((bytes + HEADER_BYTES) as u64, spool as u64)
}

impl Expected<'_> {
    /// Mean digits of an index, the first being `from`.
    fn index_text(&self, from: u64) -> f64 {
        let (mut sum, mut low, mut digits) = (0.0, 0u64, 1.0);
        let end = self.n_vertices.max(1) + from;
        while low < end {
            let high = (10f64.powf(digits) as u64).min(end);
            sum += digits * (high - low) as f64;
            (low, digits) = (high, digits + 1.0);
        }
        sum / end as f64
    }

    fn records(&self) -> impl Iterator<Item = &[u8]> {
        self.sample.chunks_exact(self.schema.record_bytes())
    }

    fn n_sampled(&self) -> f64 {
        (self.sample.len() / self.schema.record_bytes()).max(1) as f64
    }

    /// Mean length of a coordinate of some type, moved a little so that it has digits in all places.
    fn coordinate_text(&self, scalar: Scalar) -> f64 {
        let mut length = 0;
        for (i, record) in self.records().enumerate() {
            let moved = 1.0 + (i as f64 * 0.618_033_988_749_895).fract() / 1024.0;
            for value in self.schema.position(record).map(|x| x * moved) {
                let stored = match self.schema.coordinate {
                    Scalar::F64 => value,
                    _ => f64::from(value as f32),
                };
                length += match scalar {
                    Scalar::F64 => Shortest(stored).to_string().len(),
                    _ => Shortest(stored as f32).to_string().len(),
                };
            }
        }
        length as f64 / (3.0 * self.n_sampled())
    }

    /// Mean length of all other properties of a vertex, a blank before each.
    fn properties_text(&self) -> f64 {
        let mut rows = Vec::new();
        for record in self.records() {
            let mut at = self.schema.position_bytes();
            for property in &self.schema.properties {
                let end = at + property.scalar.bytes();
                match property.scalar.is_integer() {
                    true => put_text(property.scalar, &record[at..end], &mut rows),
                    // Averaged by then.
                    false => {
                        let moved = read_scalar(property.scalar, record, at) * 1.000_123_4;
                        rows.extend_from_slice(Shortest(moved as f32).to_string().as_bytes());
                    }
                }
                rows.push(b' ');
                at = end;
            }
        }
        rows.len() as f64 / self.n_sampled()
    }
}

/// Refuses a result that its format cannot hold; the writers look at it again, when all counts are known.
pub fn refuse_too_large(
    kind: OutputKind,
    (n_faces, bytes): (u64, u64),
    output: &Path,
) -> Result<()> {
    // Vertices are estimated.
    const MARGIN: f64 = 1.05;
    let holds = match kind {
        OutputKind::Glb if bytes as f64 > MARGIN * u32::MAX as f64 => "4 GiB",
        OutputKind::Stl if n_faces > u64::from(u32::MAX) => "4,294,967,295 triangles",
        _ => return Ok(()),
    };
    Err(Error::Usage(format!(
        "{}: the format holds {holds} at most, this would be {} triangles in about {}; write .ply, or ask for fewer",
        output.display(),
        show_count(n_faces),
        show_bytes(bytes)
    )))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_format_cannot_hold_is_refused_before_the_work() {
        let fits =
            |kind, n: u64, bytes: u64| refuse_too_large(kind, (n, bytes), Path::new("o")).is_ok();
        assert!(fits(OutputKind::Glb, 10, 1 << 32) && !fits(OutputKind::Glb, 400_000_000, 7 << 30));
        assert!(!fits(OutputKind::Stl, 1 << 32, 0) && fits(OutputKind::Stl, (1 << 32) - 1, 0));
        assert!(fits(OutputKind::Ply, 1 << 40, 1 << 50) && fits(OutputKind::Obj, 1 << 40, 1 << 50));
    }
}
