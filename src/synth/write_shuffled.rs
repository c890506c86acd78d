//! Writes a surface in random order, by way of a temporary file beside the output.

use super::shuffle::Shuffler;
use super::surface::Order;
use super::write::{Stream, put_faces};
use std::path::Path;
use stonecut_io::MeshSink;
use stonecut_system::disk::folder_of;
use stonecut_system::error::Result;

/// Writes all vertices and then all faces in random order, by way of a temporary file beside the output.
pub(super) fn write_shuffled(
    file: &mut MeshSink,
    path: &Path,
    stream: &Stream,
    seed: u64,
) -> Result<()> {
    let (n_vertices, n_faces) = (stream.surface.n_vertices(), stream.surface.n_faces());
    let order = Order::new(n_vertices, n_faces, seed);
    shuffle_vertices(file, path, stream, &order)?;
    let has_labels = stream.layout.labels;
    let words = if has_labels { 5 } else { 3 };
    let mut shuffler = Shuffler::new(scratch_folder(path), n_faces, words * size_of::<u32>())?;
    let mut row = 0;
    let renumber = |row, face| order.renumber(row, face);
    stream.faces(renumber, |faces, labels| {
        faces.iter().enumerate().try_for_each(|(i, &[a, b, c])| {
            let [left, right] = labels.get(i).copied().unwrap_or_default();
            let record = [a, b, c, left, right];
            row += 1;
            shuffler.put(order.faces.apply(row - 1), bytemuck::cast_slice(&record[..words]))
        })
    })?;
    assert!(row == n_faces, "the surface gave as many rows as it counted");
    let (mut faces, mut labels) = (Vec::new(), Vec::new());
    shuffler.drain(|bytes| {
        faces.clear();
        labels.clear();
        for record in bytes.chunks_exact(words * size_of::<u32>()) {
            let (corners, label) = record.split_at(size_of::<[u32; 3]>());
            faces.push(bytemuck::pod_read_unaligned::<[u32; 3]>(corners));
            if has_labels {
                labels.push(bytemuck::pod_read_unaligned::<[u32; 2]>(label));
            }
        }
        put_faces(file, &faces, &labels)
    })
}

/// Writes all vertices in random order.
pub(super) fn shuffle_vertices(
    file: &mut MeshSink,
    path: &Path,
    stream: &Stream,
    order: &Order,
) -> Result<()> {
    let record_bytes = stream.layout.schema().record_bytes();
    let n_vertices = stream.surface.n_vertices();
    let mut shuffler = Shuffler::new(scratch_folder(path), n_vertices, record_bytes)?;
    let mut id = 0;
    stream.vertices(|bytes| {
        bytes.chunks_exact(record_bytes).try_for_each(|record| {
            id += 1;
            shuffler.put(order.vertices.apply(id - 1), record)
        })
    })?;
    assert!(id == n_vertices, "the surface gave as many vertices as it counted");
    shuffler.drain(|bytes| file.write_vertices(bytes))
}

/// The folder for temporary files of an output.
pub(super) fn scratch_folder(path: &Path) -> &Path {
    if path == Path::new("-") { Path::new(".") } else { folder_of(path) }
}
