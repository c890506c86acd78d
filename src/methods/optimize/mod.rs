//! Mesh optimisation after a simplification: a mesh and points of the original in, a better mesh of as many triangles out.
//!
//! The energy is the squared distance of the points to the mesh, with springs along edges as long as a sweep moves vertices.
//! Moves: a vertex is relocated, an edge is swapped, an edge collapses where that costs little and another one is split
//! where that gains more. Every move is judged by the points that lie on the triangles that it changes, as they are; a
//! move that gains nothing is not made. Moves are judged in parallel on the mesh as it stands, and those that do not touch
//! each other are made in a fixed order, so threads do not show. Vertices on boundaries, at non-manifold places and of hundreds
//! of triangles stay where they are. Reads and writes no files; `samples` cuts the original into cells.
//!
//! Source: Hoppe, DeRose, Duchamp, McDonald & Stuetzle 1993 (docs/references.md); docs/design/optimize.md says what differs.

mod assign;
mod carry;
mod exchange;
mod patch;
mod relocate;
mod samples;
mod surface;
mod swap;
mod work;

pub use samples::{Drawing, Sample, draw};
use stonecut_measure::tree::Tree;
use stonecut_mesh::Mesh;
use stonecut_mesh::vec3::Vec3;
use stonecut_system::error::Result;
use stonecut_system::progress::Progress;
use surface::Surface;
use work::Work;

/// Share of the squared distances that springs make up in the first sweep, and in the last: they pull vertices apart that
/// crowd, and would smooth the surface.
const SPRING: [f64; 2] = [0.1, 0.01];

/// Bytes of a triangle of the result and its half of a vertex, with the lists around it and what moves need for a time.
const TRIANGLE_BYTES: u64 = 330;

/// Bytes that `optimize` takes for a mesh of `n_triangles` whose vertices carry `vertex_bytes`.
pub fn bytes(n_triangles: u64, vertex_bytes: u64) -> u64 {
    let of_samples = samples::MOST * (size_of::<Sample>() as u64 + surface::SAMPLE_BYTES);
    n_triangles * (of_samples + TRIANGLE_BYTES + vertex_bytes) + Tree::bytes(n_triangles)
}

/// Settings of an optimisation.
#[derive(Clone, Copy)]
pub struct Settings<'a> {
    /// Sweeps over all moves.
    pub sweeps: u32,
    /// Worker threads.
    pub threads: usize,
    /// Counter of sweeps, and its request to stop.
    pub progress: &'a Progress,
}

/// Outcome of an optimisation.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct OptimizeOutcome {
    /// Sweeps.
    pub sweeps: u64,
    /// Points of the original.
    pub samples: u64,
    /// Points without a part of the mesh near them that faces their way; they do not count.
    pub samples_apart: u64,
    /// Root mean square distance of the points before, in input units.
    pub rms_before: f64,
    /// The same afterwards.
    pub rms_after: f64,
    /// Vertices that were moved; one that is moved again counts again.
    pub relocations: u64,
    /// Edges that were swapped.
    pub swaps: u64,
    /// Edges that collapsed.
    pub collapses: u64,
    /// Edges that were split.
    pub splits: u64,
}

/// The place that the samples of a mesh are relative to.
pub fn centre(mesh: &Mesh) -> Vec3 {
    surface::centre(mesh)
}

/// Optimises a mesh for `samples`, which are relative to its `centre`; `records` are of its vertices, or empty.
///
/// The number of triangles stays. What vertices carry is taken from the place of the mesh as it was that is nearest to
/// each; labels from the nearest vertex there. Memory: `bytes`.
pub fn optimize(
    mesh: &mut Mesh,
    records: &mut Vec<u8>,
    samples: Vec<Sample>,
    settings: Settings,
) -> Result<OptimizeOutcome> {
    let Settings { sweeps, threads, progress } = settings;
    let carries = mesh.n_channels > 0 || !records.is_empty();
    let before = carries.then(|| mesh.clone());
    let mut out = OptimizeOutcome { samples: samples.len() as u64, ..OptimizeOutcome::default() };
    let mut surface = Surface::new(mesh, samples);
    out.samples_apart = assign::first(&mut surface, threads, progress)?;
    out.rms_before = surface.rms();
    for sweep in 0..sweeps {
        if surface.n_assigned() == 0 {
            break;
        }
        let share = f64::from(sweep) / f64::from(sweeps.max(2) - 1);
        let weight = SPRING[0] * (SPRING[1] / SPRING[0]).powf(share);
        surface.set_limits();
        let spring = surface.spring(weight);
        let work = Work { spring, threads, progress };
        out.relocations += relocate::all(&mut surface, work)?;
        out.swaps += swap::all(&mut surface, work)?;
        let exchanged = exchange::all(&mut surface, work)?;
        out.collapses += exchanged;
        out.splits += exchanged;
        out.relocations += relocate::all(&mut surface, work)?;
        out.swaps += swap::all(&mut surface, work)?;
        out.relocations += relocate::all(&mut surface, work)?;
        assign::again(&mut surface, threads, progress)?;
        out.sweeps += 1;
        progress.add(1);
    }
    out.rms_after = surface.rms();
    surface.give_back(mesh);
    if let Some(before) = before {
        carry::carry(&before, mesh, records, threads, progress)?;
    }
    Ok(out)
}

#[cfg(test)]
mod tests;
