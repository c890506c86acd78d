//! Writes the mesh of a method: vertices with what they carry and with the normals that were asked for, then faces.

use crate::config::{Config, Normals};
use crate::error::Result;
use crate::io::MeshSink;
use crate::io::ply::{MeshSource, OutputHeader, Place};
use crate::mesh::Mesh;
use crate::mesh::codec::VertexCodec;
use crate::mesh::vec3::{Vec3, add, normal, unit};
use crate::methods::Made;
use crate::stages::write::Shape;
use crate::system::disk::Disk;
use crate::system::progress::Progress;

/// Vertices or triangles that go to the file together.
const CHUNK: usize = 65_536;

/// Writes the output; returns its length in bytes.
pub(in crate::pipeline) fn write(
    source: &MeshSource,
    made: &Made,
    codec: &VertexCodec,
    config: &Config,
    disk: &Disk,
    progress: &Progress,
) -> Result<u64> {
    let mesh = &made.mesh;
    let schema = source.schema();
    let normals = config.attributes.normals;
    let shape = Shape::new(schema, 0, normals, false);
    let (n_vertices, n_faces) = (mesh.positions.len() as u64, mesh.triangles.len() as u64);
    let header = OutputHeader {
        settings: OutputHeader::line_of(&config.settings()),
        ..source.kept_header(shape.schema.clone(), n_vertices, n_faces)
    };
    let place =
        Place { path: config.output.clone(), disk: disk.clone(), replace: config.job.force };
    let mut sink = MeshSink::create(place, header, config.format)?;
    let directions = (normals == Normals::Recompute).then(|| new_normals(mesh));
    let record_bytes = schema.record_bytes();
    let bare = vec![0; record_bytes];
    let (mut record, mut out) = (Vec::new(), Vec::new());
    for first in (0..mesh.positions.len()).step_by(CHUNK) {
        progress.check()?;
        out.clear();
        for vertex in first..(first + CHUNK).min(mesh.positions.len()) {
            let own = match made.records.is_empty() {
                true => &bare,
                false => &made.records[vertex * record_bytes..(vertex + 1) * record_bytes],
            };
            record.clear();
            let channels = mesh.channels_of(vertex as u32);
            codec.encode(mesh.positions[vertex], channels, own, &mut record);
            shape.put(&record, directions.as_ref().map(|all| all[vertex]), 0.0, &mut out);
        }
        sink.write_vertices(&out)?;
    }
    for chunk in mesh.triangles.chunks(CHUNK) {
        progress.check()?;
        sink.write_faces_u32(chunk)?;
        progress.add(chunk.len() as u64);
    }
    progress.lose_all(&sink.losses());
    sink.finish()
}

/// Normals of vertices from the triangles around them, weighted by area.
fn new_normals(mesh: &Mesh) -> Vec<Vec3> {
    let mut sums = vec![[0.0; 3]; mesh.positions.len()];
    for (t, triangle) in mesh.triangles.iter().enumerate() {
        let weighted = normal(mesh.corners(t));
        for &vertex in triangle {
            let sum = &mut sums[vertex as usize];
            *sum = add(*sum, weighted);
        }
    }
    sums.into_iter().map(|sum| unit(sum).unwrap_or_default()).collect()
}
