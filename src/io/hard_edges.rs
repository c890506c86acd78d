//! Sharp edges of meshes that have several vertices in one place, each with its own normal: those who join such vertices average
//! the normals.
//!
//! glTF is looked at while it is read (`gltf`). Where counts show open edges, a sample by place is looked at here.

use crate::open_options::{HardEdges, StageOptions};
use crate::ply::MeshSource;
use stonecut_mesh::property::read_scalar;
use stonecut_mesh::vec3::{Vec3, dot, place_bits, unit};
use stonecut_system::error::Result;
use stonecut_system::losses::{Loss, LossKind};
use xxhash_rust::xxh3::xxh3_64;

/// Cosine of the angle between normals from which their mean is a loss: 30 degrees.
pub(crate) const HARD: f64 = 0.866;
/// Vertices in the sample, about: 48 bytes each.
const SAMPLE: u64 = 1 << 17;
/// Vertices that open edges explain, as a share of all, below which copies are not looked for.
const FEW_OPEN: f64 = 1e-3;

/// The loss of `n` normals along hard edges.
pub(crate) fn averaged(n: u64, remedy: &str) -> Loss {
    let why = "they differ by more than 30 degrees in one place (hard edges): averaged, which rounds the shading";
    Loss::new(LossKind::Normals, "normals of vertices", why).count(n).remedy(remedy)
}

/// Returns the loss of normals where vertices of one place are to be joined; what seams of textures keep apart is none.
pub(crate) fn survey(source: &MeshSource, options: &StageOptions) -> Result<Option<Loss>> {
    let HardEdges::Averaged(remedy) = options.hard_edges else { return Ok(None) };
    let schema = source.schema();
    let place_of = |name: &str| {
        let i = schema.properties.iter().position(|p| p.name == name)?;
        let before = schema.properties[..i].iter().map(|p| p.scalar.bytes()).sum::<usize>();
        Some((schema.properties[i].scalar, schema.position_bytes() + before))
    };
    let [Some(x), Some(y), Some(z)] = ["nx", "ny", "nz"].map(place_of) else { return Ok(None) };
    let n = source.n_vertices();
    let by_open_edges = n as f64 - 0.5 * source.n_triangles() as f64;
    let has_texture = source.has_corner_texture() || crate::find_texture(schema).is_some();
    // Who takes the mesh as it is joins nothing.
    let joins_all = options.weld.as_ref().is_some_and(|weld| weld.exact_above > 0);
    if !joins_all || has_texture || by_open_edges < FEW_OPEN * n as f64 {
        return Ok(None);
    }
    let one_in = n.div_ceil(SAMPLE).max(1);
    let mut sample: Vec<([u64; 3], Vec3)> = Vec::new();
    source.each_vertex(|_, record| {
        let place = place_bits(schema.position(record));
        if xxh3_64(place.map(u64::to_le_bytes).as_flattened()).is_multiple_of(one_in) {
            let normal = [x, y, z].map(|(scalar, at)| read_scalar(scalar, record, at));
            sample.extend(unit(normal).map(|normal| (place, normal)));
        }
        Ok(())
    })?;
    sample.sort_by_key(|(place, _)| *place);
    let is_hard = |same: &&[([u64; 3], Vec3)]| same.iter().any(|(_, n)| dot(*n, same[0].1) < HARD);
    let n_hard = sample.chunk_by(|a, b| a.0 == b.0).filter(is_hard).count() as u64;
    Ok((n_hard > 0).then(|| averaged(n_hard * one_in, remedy)))
}
