//! A mesh coloured by its distance to another: where the error is, in any viewer.
//!
//! The colours are viridis, even in lightness to every kind of eye; the comments of the file give the scale.
//! Measures nothing itself.

use super::load;
use crate::error::Result;
use crate::mesh::Mesh;
use crate::ply::{MeshSource, OutputHeader, PlyWriter};
use crate::progress::Progress;
use crate::schema::{Property, Scalar, VertexSchema};
use std::path::Path;

/// The share of vertices that the scale covers; the few beyond it have the colour of its end.
const COVERED: f64 = 0.999;

/// The distance at the upper end of the scale, in input units; 0 if all distances are 0.
pub fn scale(distances: &[f64]) -> f64 {
    let mut finite: Vec<f64> = distances.iter().copied().filter(|d| d.is_finite()).collect();
    if finite.is_empty() {
        return 0.0;
    }
    let at = ((finite.len() as f64 * COVERED) as usize).min(finite.len() - 1);
    *finite.select_nth_unstable_by(at, f64::total_cmp).1
}

/// The colour of a distance on a scale from 0 to `top`.
pub fn colour(distance: f64, top: f64) -> [u8; 3] {
    let share = if top > 0.0 { (distance / top).clamp(0.0, 1.0) } else { 0.0 };
    let share = if share.is_finite() { share } else { 1.0 };
    let colour = colorous::VIRIDIS.eval_continuous(share);
    [colour.r, colour.g, colour.b]
}

/// Gives a mesh the colours as its only channels, 0 to 255 each; `distances` has one entry a vertex.
pub fn paint(mesh: &mut Mesh, distances: &[f64], top: f64) {
    assert_eq!(mesh.positions.len(), distances.len(), "each vertex has a distance");
    mesh.n_channels = 3;
    mesh.channels = distances.iter().flat_map(|&d| colour(d, top).map(f32::from)).collect();
}

/// Writes `mesh`'s geometry with the colours of `distances`, one entry a vertex.
pub fn write(
    mesh: &MeshSource,
    distances: &[f64],
    path: &Path,
    threads: usize,
    progress: &Progress,
) -> Result<()> {
    let top = scale(distances);
    let geometry = load::load(mesh, threads, progress)?.mesh;
    let property = |name: &str| Property { name: name.to_owned(), scalar: Scalar::U8 };
    let coordinate = mesh.schema().coordinate;
    let properties = vec![property("red"), property("green"), property("blue")];
    let schema = VertexSchema { coordinate, properties };
    let (n_vertices, n_faces) = (geometry.positions.len() as u64, geometry.triangles.len() as u64);
    let mut header = OutputHeader::new(schema.clone(), n_vertices, n_faces);
    header.settings = "measure --heatmap".to_owned();
    header.comments = vec![
        "colours: distance to the other surface, in input units, viridis".to_owned(),
        format!(
            "scale: 0 = dark violet 68 1 84, {} = green 33 145 140, {top} = yellow 253 231 37",
            top / 2.0
        ),
    ];
    let mut writer = PlyWriter::create(path, header)?;
    let mut records = Vec::new();
    for (positions, distances) in geometry.positions.chunks(65_536).zip(distances.chunks(65_536)) {
        records.clear();
        for (&position, &distance) in positions.iter().zip(distances) {
            schema.encode_position(position, &mut records);
            records.extend(colour(distance, top));
        }
        writer.write_vertices(&records)?;
    }
    writer.write_faces_u32(&geometry.triangles)?;
    writer.finish()?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_scale_runs_from_violet_to_yellow_and_ignores_outliers() {
        assert_eq!(colour(0.0, 2.0), [68, 1, 84]);
        assert_eq!(colour(2.0, 2.0), colour(f64::INFINITY, 2.0));
        assert_eq!(colour(5.0, 0.0), [68, 1, 84]);
        let mut distances = vec![1.0; 10_000];
        distances[77] = 1e6;
        assert_eq!(scale(&distances), 1.0);
        assert_eq!(scale(&[]), 0.0);
    }
}
