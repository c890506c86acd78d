//! `--error-field`: no number is below the distance of its vertex from the input.
//!
//! The kernel keeps how far the points of the input are from the triangles around a vertex of the result, at most. The vertex itself
//! can be farther from the input, so that is measured in the finished file, and the larger number stays.

use crate::error::Result;
use crate::io::ply::rewrite_vertices;
use crate::measure::compare::Request;
use crate::measure::vertex_distances;
use crate::mesh::property::{REACH, Scalar, read_scalar, write_scalar};
use crate::system::disk::Disk;
use crate::system::pending_file::Place;
use crate::system::progress::Progress;

/// Raises the numbers in the file of the simplified mesh, in its place.
pub(super) fn raise(request: &Request, disk: &Disk, progress: &Progress) -> Result<()> {
    let source = request.simplified;
    let schema = source.schema();
    let Some(property) = schema.own_property(REACH) else { return Ok(()) };
    let before: usize = schema.properties[..property].iter().map(|p| p.scalar.bytes()).sum();
    let at = schema.position_bytes() + before;
    let distances = vertex_distances(request, progress)?;
    let place = Place { path: source.path().into(), disk: disk.clone(), replace: true };
    let mut found = Vec::new();
    rewrite_vertices(source, place, |first, records| {
        let records = records.chunks_exact_mut(schema.record_bytes());
        found.resize(8 * records.len(), 0);
        distances.read_exact_at(&mut found, 8 * first)?;
        for (record, bytes) in records.zip(found.chunks_exact(8)) {
            let distance = f64::from_le_bytes(bytes.try_into().expect("8 bytes"));
            if distance > read_scalar(Scalar::F32, record, at) {
                write_scalar(Scalar::F32, record, at, f64::from(float_above(distance)));
            }
        }
        Ok(())
    })
}

/// The nearest `f32` that is not below.
fn float_above(value: f64) -> f32 {
    let near = value as f32;
    if f64::from(near) < value { near.next_up() } else { near }
}
