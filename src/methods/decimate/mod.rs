//! Decimation: vertices are removed one after the other, the hole is filled with triangles between those that stay
//! (Schroeder, Zarge & Lorensen 1992). In memory.
//!
//! Every vertex of the result is one of the input, in its place with all it carries, and the topology stays as it is. The
//! paper passes over the mesh with a rising threshold; here a queue gives the vertex of least distance, and what a
//! removed vertex was away is handed on to its neighbours, so that distances add up instead of being forgotten.

mod classify;
mod fill;

use super::load::{LoadedMesh, for_records, load, load_bytes};
use super::surface::Surface;
use super::{DecimationReport, Made, MethodReport};
use classify::{Around, Kind};
use fill::{Refusal, fill};
use std::cmp::Reverse;
use std::collections::BinaryHeap;
use stonecut_io::ply::MeshSource;
use stonecut_mesh::Mesh;
use stonecut_mesh::bounds::Bounds;
use stonecut_mesh::codec::VertexCodec;
use stonecut_mesh::outward::closed_volume;
use stonecut_mesh::vec3::triangle_distance_sq;
use stonecut_system::error::{Error, Result};
use stonecut_system::progress::Progress;

/// Vertices removed between two looks at the wish to stop.
const STEPS: u64 = 4096;

/// Memory for each vertex beside its position and its triangles: distance so far, key, and two entries of the queue.
const QUEUE_BYTES: u64 = 4 + 4 + 2 * 12;

/// Memory that a run needs, in bytes.
pub fn need(source: &MeshSource) -> u64 {
    let (n_vertices, n_triangles) = (source.n_vertices(), source.n_triangles());
    let mesh = n_vertices * (24 + QUEUE_BYTES) + Surface::bytes(n_vertices, n_triangles);
    // The result is copied out of the mesh: at most all of it.
    let run = mesh + n_vertices * (4 + 24) + 12 * n_triangles;
    run.max(load_bytes(source))
}

/// Settings of a run.
#[derive(Clone, Copy, Debug)]
pub struct Settings<'a> {
    /// Triangles wanted, at most.
    pub target: u64,
    /// An edge whose triangles differ by more than this is a feature, in degrees.
    pub feature_angle: f64,
    /// The source's `kernel_codec`.
    pub codec: &'a VertexCodec,
}

/// Removes vertices until the target is met or nothing more can be removed.
///
/// Errors: those of reading; `Usage` for more triangles than corners can be numbered for.
pub fn decimate(source: &MeshSource, settings: Settings, progress: &Progress) -> Result<Made> {
    if source.n_triangles() > Surface::MOST_TRIANGLES || source.n_vertices() > u64::from(u32::MAX) {
        return Err(Error::Usage(format!(
            "--method decimate takes at most {} triangles; take --method collapse",
            Surface::MOST_TRIANGLES
        )));
    }
    progress.begin("decimate", 1, 2, source.n_triangles().saturating_sub(settings.target));
    let LoadedMesh { positions, triangles, faults } = load(source, progress)?;
    Bounds::around(&positions)
        .hold("--method decimate", [1e-100, 1e50])
        .map_err(|what| Error::bad_input(source.path(), what))?;
    let given = Mesh::new(positions, triangles);
    let input_volume = closed_volume(&given);
    let surface = Surface::new(given.positions, given.triangles);
    let mut run = Run::new(surface, settings);
    run.drain(false, progress)?;
    let before_corners = run.n_removed();
    if run.surface.n_alive() as u64 > settings.target {
        run.drain(true, progress)?;
    }
    let mut made = made(source, settings.codec, &run, progress)?;
    (made.faults, made.input_volume) = (faults, input_volume);
    let removed_beyond_features = run.n_removed() - before_corners;
    made.bounds = Bounds::around(&run.surface.positions);
    let report = DecimationReport { removed_beyond_features, ..run.report };
    made.report = MethodReport::Decimation(report);
    Ok(made)
}

/// A run: the mesh, and the vertices in the order of what their removal costs.
struct Run<'a> {
    surface: Surface,
    settings: Settings<'a>,
    cosine: f64,
    /// Distance that removed neighbours handed on to each vertex.
    handed: Vec<f32>,
    /// The cost of each vertex as it is in the queue; infinite for one that cannot go.
    cost: Vec<f32>,
    queue: BinaryHeap<Reverse<(u32, u32)>>,
    report: DecimationReport,
}

impl Run<'_> {
    fn new(surface: Surface, settings: Settings<'_>) -> Run<'_> {
        let n = surface.positions.len();
        Run {
            surface,
            settings,
            cosine: settings.feature_angle.to_radians().cos(),
            handed: vec![0.0; n],
            cost: vec![f32::INFINITY; n],
            queue: BinaryHeap::new(),
            report: DecimationReport::default(),
        }
    }

    fn n_removed(&self) -> u64 {
        let DecimationReport { removed_simple, removed_boundary, .. } = self.report;
        let DecimationReport { removed_interior_edge, removed_corner, .. } = self.report;
        removed_simple + removed_boundary + removed_interior_edge + removed_corner
    }

    /// Removes the vertex of least cost again and again; corners only if `takes_corners`.
    fn drain(&mut self, takes_corners: bool, progress: &Progress) -> Result<()> {
        for vertex in 0..self.cost.len() as u32 {
            if u64::from(vertex).is_multiple_of(STEPS) {
                progress.check()?;
            }
            self.enqueue(vertex, takes_corners);
        }
        let (mut n_steps, mut n_before) = (0, self.surface.n_alive() as u64);
        while self.surface.n_alive() as u64 > self.settings.target {
            let Some(Reverse((bits, vertex))) = self.queue.pop() else { break };
            // Entries of before the surroundings changed.
            if self.cost[vertex as usize].to_bits() != bits {
                continue;
            }
            n_steps += 1;
            if u64::is_multiple_of(n_steps, STEPS) {
                progress.check()?;
                let now = self.surface.n_alive() as u64;
                progress.add(n_before - now);
                n_before = now;
            }
            self.remove(vertex, takes_corners);
        }
        Ok(())
    }

    /// Finds what a vertex costs, and puts it into the queue if it can go.
    fn enqueue(&mut self, vertex: u32, takes_corners: bool) {
        let mut cost = f32::INFINITY;
        if self.surface.is_used(vertex) {
            let around = Around::look(&self.surface, vertex, self.cosine);
            let may_go = match around.kind {
                Kind::Complex => false,
                Kind::Corner => takes_corners,
                Kind::Simple | Kind::Boundary | Kind::InteriorEdge => true,
            };
            if may_go && around.distance.is_finite() {
                cost = around.distance as f32 + self.handed[vertex as usize];
            }
        }
        self.cost[vertex as usize] = cost;
        if cost.is_finite() {
            // The bits of floats that are not negative are in the order of the floats.
            self.queue.push(Reverse((cost.to_bits(), vertex)));
        }
    }

    fn remove(&mut self, vertex: u32, takes_corners: bool) {
        let around = Around::look(&self.surface, vertex, self.cosine);
        let cost = std::mem::replace(&mut self.cost[vertex as usize], f32::INFINITY);
        match fill(&self.surface, &around) {
            Ok(filling) => {
                // At a saddle the average plane passes through the vertex, however bent the surface is.
                let away = distance(&self.surface, vertex, &filling).max(around.distance);
                let true_cost = away as f32 + self.handed[vertex as usize];
                if true_cost > cost {
                    self.cost[vertex as usize] = true_cost;
                    self.queue.push(Reverse((true_cost.to_bits(), vertex)));
                    return;
                }
                self.surface.replace(&around.triangles, &filling);
                let report = &mut self.report;
                *match around.kind {
                    Kind::Simple => &mut report.removed_simple,
                    Kind::Boundary => &mut report.removed_boundary,
                    Kind::InteriorEdge => &mut report.removed_interior_edge,
                    Kind::Corner | Kind::Complex => &mut report.removed_corner,
                } += 1;
                report.farthest = report.farthest.max(f64::from(cost));
                for &neighbour in &around.ring {
                    let handed = &mut self.handed[neighbour as usize];
                    *handed = handed.max(cost);
                    self.enqueue(neighbour, takes_corners);
                }
            }
            // It stays until its surroundings change.
            Err(Refusal::Split) => self.report.refused_split += 1,
            Err(Refusal::Topology) => self.report.refused_topology += 1,
        }
    }
}

/// Distance of a vertex from the triangles that are to fill its place.
fn distance(surface: &Surface, vertex: u32, filling: &[[u32; 3]]) -> f64 {
    let at = |v: u32| surface.positions[v as usize];
    let to = |t: &[u32; 3]| triangle_distance_sq(at(vertex), t.map(at));
    filling.iter().map(to).fold(f64::INFINITY, f64::min).sqrt()
}

/// Copies out what is left: vertices in the order of the input, with their records read again.
fn made(source: &MeshSource, codec: &VertexCodec, run: &Run, progress: &Progress) -> Result<Made> {
    let surface = &run.surface;
    let mut numbers = vec![u32::MAX; surface.positions.len()];
    let mut made = Made::default();
    for vertex in 0..surface.positions.len() as u32 {
        if surface.is_used(vertex) {
            numbers[vertex as usize] = made.mesh.positions.len() as u32;
            made.mesh.positions.push(surface.positions[vertex as usize]);
        }
    }
    let number = |v: u32| numbers[v as usize];
    made.mesh.triangles = surface.alive().map(|t| t.map(number)).collect();
    if source.schema().properties.is_empty() {
        return Ok(made);
    }
    made.mesh.n_channels = codec.n_channels();
    let mut channels = vec![0.0; codec.n_channels()];
    for_records(source, progress, |vertex, record| {
        if numbers[vertex as usize] != u32::MAX {
            codec.decode_channels(record, &mut channels);
            made.mesh.channels.extend_from_slice(&channels);
            made.records.extend_from_slice(record);
        }
    })?;
    Ok(made)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Reading takes more than removing vertices where triangles have to be turned over: 84 bytes for each beside the mesh.
    #[test]
    fn the_need_covers_the_reading() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("strip.ply");
        let n = 1000u64;
        let mut text = format!(
            "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
             element face {n}\nproperty list uchar int vertex_indices\nend_header\n",
            n / 2 + 2
        );
        (0..n / 2 + 2).for_each(|v| text += &format!("{v} 0 {}\n", v % 7));
        (0..n).for_each(|t| text += &format!("3 {} {} {}\n", t / 2, t / 2 + 1, t / 2 + 2));
        std::fs::write(&path, text).unwrap();
        let source = MeshSource::open(&path).unwrap();
        let reading = 24 * (n / 2 + 2) + (12 + 84) * n;
        assert!(need(&source) >= reading);
        let codec = source.schema().kernel_codec(&[]);
        assert!(crate::retile::need(&source, &codec, 4, 0.0) >= reading);
    }
}
