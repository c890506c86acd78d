//! A mesh coloured by its distance to another: where the error is, in any viewer.
//!
//! The colours are viridis, even in lightness to every kind of eye; the comments of the file give the scale.
//! Measures nothing itself.

use super::tree::Tree;
use super::unit::Unit;
use std::path::Path;
use stonecut_io::ply::raw::{RawFile, Spool};
use stonecut_io::ply::{FaceBlock, MeshSource, OutputHeader, PlyWriter, VertexBlock};
use stonecut_mesh::property::{Property, Scalar};
use stonecut_mesh::record::VertexSchema;
pub use stonecut_mesh::viridis::viridis as colour;
use stonecut_system::disk::Disk;
use stonecut_system::error::Result;
use stonecut_system::parallel::in_order;
use stonecut_system::pending_file::Seen;
use stonecut_system::progress::Progress;

/// The share of vertices that the scale covers; the few beyond it have the colour of its end.
const COVERED: f64 = 0.999;

/// Writes `mesh`'s geometry with the colours of `distances`, one entry a vertex.
pub fn write(
    mesh: &MeshSource,
    distances: &[f64],
    to: &Seen,
    threads: usize,
    progress: &Progress,
) -> Result<()> {
    let bytes = distances.iter().flat_map(|distance| distance.to_le_bytes()).collect();
    paint(mesh, &RawFile::from_bytes("", bytes), to, (threads, progress), |_| ())
}

/// Writes `mesh`, of any size, coloured by the distance of its vertices to the surface in `target`.
///
/// Memory: a few blocks a thread. Distances wait in a nameless file of `temp_dir`, 8 bytes a vertex, until
/// the scale is known. Vertices and faces are read twice.
pub fn write_streamed(
    mesh: &MeshSource,
    (target, unit): (&Tree, Unit),
    (to, temp_dir): (&Seen, &Path),
    threads: usize,
    progress: &Progress,
) -> Result<()> {
    progress.begin("heatmap", 1, 1, 2 * mesh.n_triangles());
    let (schema, n_blocks) = (mesh.schema(), mesh.n_vertex_blocks());
    let record_bytes = schema.record_bytes();
    let mut spool = Spool::new(temp_dir);
    let measure = |index, out: &mut Measured| {
        mesh.read_vertices(index, &mut out.block)?;
        out.distances.clear();
        let mut slot = u32::MAX;
        for record in out.block.records.chunks_exact(record_bytes) {
            let point = unit.place(schema.position(record));
            let found = target.nearest(point, target.guess(point, slot));
            slot = if found.is_found() { found.slot } else { slot };
            out.distances.extend(unit.back(found.distance_sq.sqrt()).to_le_bytes());
        }
        Ok(())
    };
    in_order(n_blocks, threads, progress, measure, |_, found| spool.write(&found.distances))?;
    let spool = spool.finish(mesh.path())?;
    paint(mesh, &spool, to, (threads, progress), |n_faces| progress.add(n_faces))
}

/// Vertices with their distances, or with colours in place of properties.
#[derive(Default)]
struct Measured {
    block: VertexBlock,
    distances: Vec<u8>,
}

/// Writes `mesh` with the colours of the distances of its vertices, 8 bytes each. Calls `add` twice with the number of
/// every block of faces.
fn paint(
    mesh: &MeshSource,
    distances: &RawFile,
    to: &Seen,
    (threads, progress): (usize, &Progress),
    add: impl Fn(u64),
) -> Result<()> {
    let schema = mesh.schema();
    let top = scale_of(distances)?;
    let mut n_faces = 0;
    let read = |index, out: &mut FaceBlock| mesh.read_faces(index, out);
    in_order(mesh.n_face_blocks(), threads, progress, read, |_, block| {
        n_faces += block.triangles.len() as u64;
        add(block.triangles.len() as u64);
        Ok(())
    })?;
    let header = header(mesh, n_faces, top);
    let painted = header.schema.clone();
    let mut writer = PlyWriter::create(to.place(&Disk::default()), header)?;
    let paint = |index, out: &mut Measured| {
        mesh.read_vertices(index, &mut out.block)?;
        let records = out.block.records.chunks_exact(schema.record_bytes());
        out.distances.resize(8 * records.len(), 0);
        distances.read_exact_at(&mut out.distances, 8 * out.block.first)?;
        let mut coloured = Vec::with_capacity(records.len() * painted.record_bytes());
        for (record, distance) in records.zip(out.distances.chunks_exact(8)) {
            painted.encode_position(schema.position(record), &mut coloured);
            coloured.extend(colour(to_f64(distance), top));
        }
        out.block.records = coloured;
        Ok(())
    };
    in_order(mesh.n_vertex_blocks(), threads, progress, paint, |_, out| {
        writer.write_vertices(&out.block.records)
    })?;
    in_order(mesh.n_face_blocks(), threads, progress, read, |_, block| {
        add(block.triangles.len() as u64);
        writer.write_faces(&block.triangles)
    })?;
    writer.finish()?;
    Ok(())
}

fn to_f64(bytes: &[u8]) -> f64 {
    f64::from_le_bytes(bytes.try_into().expect("8 bytes"))
}

/// The distance at the upper end of the scale, in input units; 0 if all distances are 0. None is negative: 16 bits of the answer
/// a pass.
fn scale_of(spool: &RawFile) -> Result<f64> {
    let (mut known, mut rank) = (0u64, 0);
    for pass in 0..4 {
        let shift = 48 - 16 * pass;
        let mut counts = vec![0u64; 1 << 16];
        spool.each_piece(0..spool.len(), 1 << 20, |bytes| {
            for value in bytes.chunks_exact(8).map(to_f64).filter(|value| value.is_finite()) {
                let bits = value.to_bits();
                // In the first pass nothing is known, and all 64 bits are shifted out.
                if bits.checked_shr(shift + 16).unwrap_or(0) == known {
                    counts[(bits >> shift) as usize & 0xffff] += 1;
                }
            }
            Ok(())
        })?;
        if pass == 0 {
            let n: u64 = counts.iter().sum();
            if n == 0 {
                return Ok(0.0);
            }
            rank = ((n as f64 * COVERED) as u64).min(n - 1);
        }
        let bucket = counts.iter().position(|&n| {
            let is_here = rank < n;
            rank -= if is_here { 0 } else { n };
            is_here
        });
        known = known << 16 | bucket.expect("the rank is below the number of values") as u64;
    }
    Ok(f64::from_bits(known))
}

fn header(mesh: &MeshSource, n_faces: u64, top: f64) -> OutputHeader {
    let property = |name: &str| Property::new(name, Scalar::U8);
    let coordinate = mesh.schema().coordinate;
    let properties = vec![property("red"), property("green"), property("blue")];
    let schema = VertexSchema { coordinate, properties };
    let mut header = OutputHeader::new(schema, mesh.n_vertices(), n_faces);
    header.settings = stonecut_system::first_bytes::HEATMAP_SETTINGS.to_owned();
    header.comments = vec![
        "colours: distance to the other surface, in input units, viridis".to_owned(),
        format!(
            "scale: 0 = dark violet 68 1 84, {} = green 33 145 140, {top} = yellow 253 231 37",
            top / 2.0
        ),
    ];
    header
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_scale_runs_from_violet_to_yellow_and_ignores_outliers() {
        assert_eq!(colour(0.0, 2.0), [68, 1, 84]);
        assert_eq!(colour(2.0, 2.0), colour(f64::INFINITY, 2.0));
        assert_eq!(colour(5.0, 0.0), [68, 1, 84]);
    }

    #[test]
    fn a_spool_has_the_scale_of_its_values() {
        let folder = std::env::temp_dir();
        for n in [0usize, 1, 2, 1000, 5000] {
            let mut values: Vec<f64> = (0..n).map(|i| (i * 7919 % n) as f64 * 1.37e-3).collect();
            if n > 10 {
                values[3] = f64::INFINITY;
            }
            let mut spool = Spool::new(&folder);
            values.iter().for_each(|value| spool.write(&value.to_le_bytes()).unwrap());
            let spool = spool.finish(Path::new("spool")).unwrap();
            values.retain(|value| value.is_finite());
            values.sort_by(f64::total_cmp);
            let at = ((values.len() as f64 * COVERED) as usize).min(values.len().saturating_sub(1));
            let expected = values.get(at).copied().unwrap_or(0.0);
            assert_eq!(scale_of(&spool).unwrap(), expected, "{n} values");
        }
    }
}
