//! The ways into `certify`: meshes in memory, surfaces in parts, a bound that is to be kept.
//!
//! Chooses the unit, looks at surfaces in cells, counts the work. Proves nothing itself.

use super::certificate::{Certificate, Certify, Verdict};
use super::certify::Pair;
use super::parts::{Means, Parts, Place, Survey};
use super::triangle::Vector;
use super::{Deviation, Options, Unit, measure_in_own_unit};
use stonecut_mesh::Mesh;
use stonecut_mesh::bounds::Bounds;
use stonecut_system::error::{Error, Result};
use stonecut_system::progress::Progress;

/// Begins the stage that encloses the distance, counted in the triangles of both.
pub(super) fn begin_certificate(original: &Parts, simplified: &Parts, progress: &Progress) {
    let count =
        |parts: &Parts| (0..parts.n_parts()).map(|part| parts.n_triangles(part)).sum::<u64>();
    progress.begin("certify", 3, 3, count(original) + count(simplified));
}

/// Measures the deviation of two meshes in memory, and encloses their Hausdorff distance if asked for, by the same trees.
///
/// Coordinates must be of a size that needs no other unit.
pub fn measured_and_enclosed(
    [original, simplified]: [&Mesh; 2],
    options: &Options,
    progress: &Progress,
) -> Result<(Deviation, Option<Certificate>)> {
    let (deviation, trees) = measure_in_own_unit(original, simplified, options, progress)?;
    let Some(certify) = options.certify else { return Ok((deviation, None)) };
    let [original, simplified] = [original, simplified].map(|mesh| Parts::in_memory(mesh, None));
    begin_certificate(&original, &simplified, progress);
    let means =
        Means { threads: options.threads, memory_bytes: u64::MAX, progress, is_counted: true };
    let mut pair = Pair::new([&original, &simplified], [None, None]).with_trees(trees);
    let enclosed = pair.enclose([&deviation.forward, &deviation.backward], certify, means)?;
    Ok((deviation, Some(enclosed)))
}

/// Encloses the two-sided Hausdorff distance of two meshes in memory, as `options.certify` says; `two_sided`
/// tells where to begin.
///
/// Memory and coordinates as there. Fails with a coordinate that is not a finite number.
pub fn enclose(
    original: &Mesh,
    simplified: &Mesh,
    certify: Certify,
    options: &Options,
    progress: &Progress,
) -> Result<Certificate> {
    for (mesh, name) in [(original, "original"), (simplified, "simplified mesh")] {
        let is_finite = |p: &Vector| p.iter().all(|x| x.is_finite());
        if let Some(v) = mesh.positions.iter().position(|p| !is_finite(p)) {
            let place = mesh.positions[v];
            let what = format!(
                "the {name}: vertex {v} is at {place:?}, which is not a place; leave it out"
            );
            return Err(Error::Usage(what));
        }
    }
    let bounds = Bounds::around(&original.positions).joined(&Bounds::around(&simplified.positions));
    let unit = Unit::around(&bounds);
    let [first, second] = [original, simplified].map(|mesh| {
        let mut mesh = mesh.clone();
        unit.turn(&mut mesh);
        mesh
    });
    let options = Options { certify: Some(certify.in_unit(unit)), region: None, ..options.clone() };
    let (_, certificate) = measured_and_enclosed([&first, &second], &options, progress)?;
    Ok(certificate.expect("it was asked for").back(unit))
}

/// Finds out if two surfaces are within `bound` (input units) of each other, both ways, and stops as soon as that is
/// certain.
///
/// Memory: as `two_sided_parts`. The farther of two points beyond the bound is found first by chance.
pub fn within(
    original: &Parts,
    simplified: &Parts,
    bound: f64,
    (threads, memory_bytes): (usize, u64),
    progress: &Progress,
) -> Result<Verdict> {
    let unit = Unit::around(&original.bounds.joined(&simplified.bounds));
    let meshes = match unit.is_own() {
        true => [None, None],
        false => [original, simplified].map(|parts| parts.turned_mesh(unit)),
    };
    let turned = [original.in_unit(unit, &meshes[0]), simplified.in_unit(unit, &meshes[1])];
    let means = Means { threads, memory_bytes, progress, is_counted: true };
    let survey = |parts: &Parts| match parts.place {
        Place::Memory(_) => Ok(None),
        Place::Cells(_) => parts.survey(Means { is_counted: false, ..means }).map(Some),
    };
    let surveys = [survey(&turned[0])?, survey(&turned[1])?];
    let held: u64 = surveys.iter().flatten().map(Survey::bytes).sum();
    let means = Means { memory_bytes: memory_bytes.saturating_sub(held), ..means };
    begin_certificate(&turned[0], &turned[1], progress);
    let mut pair = Pair::new([&turned[0], &turned[1]], [surveys[0].as_ref(), surveys[1].as_ref()]);
    pair.within(unit.of(bound), means).map(|verdict| verdict.back(unit))
}
