//! Meshes as the harness needs them: raw files for the peers, PLY for `stonecut measure`, crops.
//!
//! A raw mesh is two u64 (vertices, triangles), f64 x 3 a vertex, u32 x 3 a triangle, little-endian. Peers
//! read nothing else, so that none is charged for a file format. Whole meshes in memory: the harness does
//! this in processes of their own, or its size would show in what it measures (docs/design/bench.md).

use crate::Outcome;
use std::io::{BufWriter, Read, Write};
use std::path::Path;
use stonecut::Mesh;
use stonecut::io::StageOptions;
use stonecut::io::ply::MeshSource;
use stonecut::measure::load;
use stonecut::system::progress::Progress;

/// Reads any mesh that stonecut reads; bare geometry.
pub fn read_any(path: &Path) -> Outcome<Mesh> {
    let source = MeshSource::open_staged(path, &StageOptions::new("."))?;
    let loaded = load::load(&source, 1, &Progress::default())?;
    Ok(Mesh::new(loaded.mesh.positions, loaded.mesh.triangles))
}

/// Reads a raw mesh.
pub fn read_raw(path: &Path) -> Outcome<Mesh> {
    let mut file = std::fs::File::open(path)?;
    let mut counts = [0u64; 2];
    file.read_exact(bytemuck::cast_slice_mut(&mut counts))?;
    let expected = counts[0]
        .checked_mul(24)
        .and_then(|v| counts[1].checked_mul(12).and_then(|t| v.checked_add(t + 16)));
    if expected != Some(file.metadata()?.len()) {
        return Err(format!("{} is no raw mesh: its length is wrong", path.display()).into());
    }
    let mut mesh = Mesh::new(
        vec![[0.0; 3]; usize::try_from(counts[0])?],
        vec![[0; 3]; usize::try_from(counts[1])?],
    );
    file.read_exact(bytemuck::cast_slice_mut(&mut mesh.positions))?;
    file.read_exact(bytemuck::cast_slice_mut(&mut mesh.triangles))?;
    let n_vertices = mesh.positions.len();
    if mesh.triangles.iter().flatten().any(|&v| v as usize >= n_vertices) {
        return Err(format!("{} uses a vertex that it does not have", path.display()).into());
    }
    Ok(mesh)
}

/// Writes a raw mesh.
pub fn write_raw(path: &Path, mesh: &Mesh) -> Outcome<()> {
    let mut file = std::fs::File::create(path)?;
    let counts = [mesh.positions.len() as u64, mesh.triangles.len() as u64];
    file.write_all(bytemuck::cast_slice(&counts))?;
    file.write_all(bytemuck::cast_slice(&mesh.positions))?;
    file.write_all(bytemuck::cast_slice(&mesh.triangles))?;
    Ok(())
}

/// Writes a PLY file with double coordinates: nothing is rounded before it is measured.
pub fn write_ply(path: &Path, mesh: &Mesh) -> Outcome<()> {
    let mut out = BufWriter::new(std::fs::File::create(path)?);
    write!(
        out,
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty double x\nproperty double y\n\
         property double z\nelement face {}\nproperty list uchar uint vertex_indices\nend_header\n",
        mesh.positions.len(),
        mesh.triangles.len()
    )?;
    out.write_all(bytemuck::cast_slice(&mesh.positions))?;
    for triangle in &mesh.triangles {
        out.write_all(&[3])?;
        out.write_all(bytemuck::cast_slice(triangle))?;
    }
    out.flush()?;
    Ok(())
}

/// The triangles that lie whole within an upright box about the middle of the mesh, about `n_triangles`.
///
/// The box spans the same share of the mesh's extent in x and in y, and all of z.
pub fn crop(mesh: &Mesh, n_triangles: u64) -> Mesh {
    let (low, high) = bounds(mesh);
    let middle = [0, 1].map(|k| (low[k] + high[k]) / 2.0);
    // How far out each triangle reaches, as a share of the half extent; the n-th smallest is the box.
    let reach = |t: &[u32; 3]| {
        let far = |k: usize| {
            let half = ((high[k] - low[k]) / 2.0).max(f64::MIN_POSITIVE);
            t.iter()
                .map(|&v| (mesh.positions[v as usize][k] - middle[k]).abs() / half)
                .fold(0.0, f64::max)
        };
        far(0).max(far(1))
    };
    let mut reaches: Vec<f64> = mesh.triangles.iter().map(reach).collect();
    let limit = match usize::try_from(n_triangles) {
        Ok(n) if n < reaches.len() => *reaches.select_nth_unstable_by(n, f64::total_cmp).1,
        _ => f64::INFINITY,
    };
    let mut place = vec![u32::MAX; mesh.positions.len()];
    let mut out = Mesh::default();
    for triangle in mesh.triangles.iter().filter(|t| reach(t) < limit) {
        out.triangles.push(triangle.map(|v| {
            let place = &mut place[v as usize];
            if *place == u32::MAX {
                *place = out.positions.len() as u32;
                out.positions.push(mesh.positions[v as usize]);
            }
            *place
        }));
    }
    out
}

/// The corners of the bounding box.
pub fn bounds(mesh: &Mesh) -> ([f64; 3], [f64; 3]) {
    let mut low = [f64::INFINITY; 3];
    let mut high = [f64::NEG_INFINITY; 3];
    for p in &mesh.positions {
        for k in 0..3 {
            low[k] = low[k].min(p[k]);
            high[k] = high[k].max(p[k]);
        }
    }
    (low, high)
}
