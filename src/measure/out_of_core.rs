//! The two-sided measurement of surfaces of any size, in bounded memory.
//!
//! Samples, nearest points and sums are those of `two_sided`; only their order differs, which does not
//! show. A surface in memory answers through one tree; one in cells through `nearest_in_cells`.

use super::certificate::Certificate;
use super::certify;
use super::enclose::begin_certificate;
use super::nearest_in_cells::{QUERY_BYTES, settle};
use super::parts::{Means, Parts, Place, Survey};
use super::sample::{self, Density};
use super::side::{Look, Side, SideSums};
use super::tree::Tree;
use super::triangle::Vector;
use super::{BLOCK_SAMPLES, Direction, Options, Surface, Unit, used_vertices};
use crate::deviation::Deviation;
use std::sync::atomic::AtomicU64;
use stonecut_mesh::topology_counts::Topology;
use stonecut_system::error::{Error, Result};
use stonecut_system::progress::Progress;

/// Bytes a gathered sample takes besides its query: what was seen there; point, place and bound in order.
const SAMPLE_BYTES: u64 = size_of::<Seen>() as u64 + 24 + 4 + 24 + 8;

/// Queries under way may take at least one in this many bytes of the budget.
const QUERY_SHARE: u64 = 3;

/// Findings of an out-of-core measurement.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct Measured {
    /// The deviation.
    pub deviation: Deviation,
    /// Connectivity of the original.
    pub original: Topology,
    /// Connectivity of the simplified mesh.
    pub simplified: Topology,
    /// True if the triangles of the original, of the simplified mesh, have no area, so that nothing can be
    /// sampled; false for a mesh without triangles.
    #[serde(skip)]
    pub is_flat: [bool; 2],
    /// The Hausdorff distance enclosed, if asked for.
    #[serde(skip)]
    pub certificate: Option<Certificate>,
}

/// Measures the deviation of `simplified` from `original`, wherever they are.
///
/// Memory: at most `memory_bytes` besides what is in memory already, as long as that holds the largest
/// cell once; 8 bytes a sample of it are not negotiable. Coordinates beyond 1e18 and below 1e-18 take a copy
/// of a mesh in memory.
pub fn two_sided_parts(
    original: &Parts,
    simplified: &Parts,
    options: &Options,
    memory_bytes: u64,
    progress: &Progress,
) -> Result<Measured> {
    let unit = Unit::around(&original.bounds.joined(&simplified.bounds));
    if !unit.is_own() {
        let meshes = [original, simplified].map(|parts| parts.turned_mesh(unit));
        let turned = [original.in_unit(unit, &meshes[0]), simplified.in_unit(unit, &meshes[1])];
        let options = Options {
            region: options.region.as_ref().map(|region| region.in_unit(unit)),
            certify: options.certify.map(|certify| certify.in_unit(unit)),
            ..options.clone()
        };
        let measured = in_own_unit(&turned[0], &turned[1], &options, memory_bytes, progress)?;
        let deviation = unit.deviation(measured.deviation);
        let certificate = measured.certificate.map(|certificate| certificate.back(unit));
        return Ok(Measured { deviation, certificate, ..measured });
    }
    in_own_unit(original, simplified, options, memory_bytes, progress)
}

fn in_own_unit(
    original: &Parts,
    simplified: &Parts,
    options: &Options,
    memory_bytes: u64,
    progress: &Progress,
) -> Result<Measured> {
    let values_bytes = 2 * 8 * options.samples;
    let free_bytes = memory_bytes.checked_sub(values_bytes).ok_or_else(|| {
        Error::NoMemory(format!(
            "{} samples a side need {values_bytes} bytes: give more --memory or fewer --samples",
            options.samples
        ))
    })?;
    let threads = options.threads;
    let means = Means { threads, memory_bytes: free_bytes, progress, is_counted: true };
    let first = original.survey(means)?;
    let means = Means { memory_bytes: free_bytes - first.bytes().min(free_bytes), ..means };
    let second = simplified.survey(means)?;
    let left_bytes = means.memory_bytes - second.bytes().min(means.memory_bytes);
    let means = Means { memory_bytes: left_bytes, ..means };
    let surveys = [first, second];
    let reach = surveys[0].bounds.joined(&surveys[1].bounds).diagonal() * (1.0 + 1e-12);
    let [first, second] = &surveys;
    let forward = Way { source: (original, first), target: (simplified, second), reach, options };
    let backward = Way { source: (simplified, second), target: (original, first), reach, options };
    let (forward, backward) = (forward.measure(means)?, backward.measure(means)?);
    let certificate = match options.certify {
        Some(certify) => {
            begin_certificate(original, simplified, progress);
            let mut pair = certify::Pair::new([original, simplified], [Some(first), Some(second)]);
            Some(pair.enclose([&forward, &backward], certify, means)?)
        }
        None => None,
    };
    Ok(Measured {
        deviation: Deviation::new(forward, backward, first.bounds.diagonal()),
        certificate,
        original: first.topology,
        simplified: second.topology,
        is_flat: [first, second].map(|survey| !survey.is_empty() && survey.area == 0.0),
    })
}

/// Exact distances from points to a surface, in the order of the points.
///
/// Memory: 300 bytes a point besides the budget for cells.
pub fn distances(
    points: &[Vector],
    target: &Parts,
    threads: usize,
    memory_bytes: u64,
    progress: &Progress,
) -> Result<Vec<f64>> {
    let means = Means { threads, memory_bytes, progress, is_counted: true };
    let mut around = target.bounds;
    points.iter().for_each(|&point| around.add(point));
    let unit = Unit::around(&around);
    let never = vec![-1.0; points.len()];
    if unit.is_own() {
        let hits = settle(points, target, &target.survey(means)?, &never, means)?;
        return Ok(hits.iter().map(|hit| hit.distance_sq.sqrt()).collect());
    }
    let mesh = target.turned_mesh(unit);
    let target = target.in_unit(unit, &mesh);
    let points: Vec<Vector> = points.iter().map(|&point| unit.place(point)).collect();
    let hits = settle(&points, &target, &target.survey(means)?, &never, means)?;
    Ok(hits.iter().map(|hit| unit.back(hit.distance_sq.sqrt())).collect())
}

/// One direction.
struct Way<'a> {
    source: (&'a Parts<'a>, &'a Survey),
    target: (&'a Parts<'a>, &'a Survey),
    reach: f64,
    options: &'a Options,
}

/// A sample and the attributes of its surface there, or a vertex, which has none.
struct Seen {
    point: Vector,
    look: Option<Look>,
}

/// Triangles whose samples are followed by the vertices that they are the first to use.
const GATHERED_TRIANGLES: usize = 4096;

/// The triangles of a mesh in an order that keeps neighbours together.
fn along_curve(mesh: &stonecut_mesh::Mesh) -> Vec<u32> {
    let first_corner = |t: &[u32; 3]| mesh.positions[t[0] as usize];
    let points: Vec<Vector> = mesh.triangles.iter().map(first_corner).collect();
    sample::order_along_curve(&points)
}

impl Way<'_> {
    fn measure(&self, means: Means) -> Result<Side> {
        let mut sums = match self.target.0.place {
            Place::Memory(mesh) => self.against_memory(mesh, means)?,
            Place::Cells(_) => self.against_cells(means)?,
        };
        // Vertices that several cells hold were looked at in each.
        sums.n_vertices = self.source.1.n_used();
        Ok(sums.finish(self.target.1.is_empty()))
    }

    fn density(&self) -> Density {
        Density::new(self.options.samples, self.source.1.area, self.options.seed)
    }

    fn new_sums(&self) -> SideSums {
        SideSums::new(self.reach, self.options.region.is_some())
    }

    /// The target is one tree; the source passes by, part by part.
    fn against_memory(&self, mesh: &stonecut_mesh::Mesh, means: Means) -> Result<SideSums> {
        let corners_of = |i| mesh.corners(i);
        let tree = Tree::build_until(mesh.triangles.len(), corners_of, means.progress)?;
        let target = Surface { mesh, colour: self.target.0.colours };
        let worst_sq = AtomicU64::new(0);
        let (mut sums, mut failed) = (self.new_sums(), None);
        let more = |n: u64| SAMPLE_BYTES * BLOCK_SAMPLES + 2 * n;
        self.source.0.for_each(
            0..self.source.0.n_parts(),
            means,
            more,
            |_, source| {
                let direction = Direction {
                    source,
                    target,
                    tree: &tree,
                    density: self.density(),
                    region: self.options.region.as_ref(),
                    reach: self.reach,
                    worst_sq: &worst_sq,
                    progress: means.progress,
                    // Triangles are counted as they are loaded.
                    units: (0, 1),
                };
                let mut sums = self.new_sums();
                direction.measure_samples(0..source.mesh.triangles.len(), &mut sums)?;
                let used = used_vertices(source.mesh);
                direction.measure_vertices(&used, 0..used.len(), &mut sums)?;
                Ok(sums)
            },
            |part| failed = part.map(|part| sums.merge(&part)).err().or(failed.take()),
        )?;
        failed.map_or(Ok(sums), Err)
    }

    /// The target is in cells: samples and vertices of the source are gathered, then settled together.
    ///
    /// Together, because every cell that they may be near to is loaded and gets its tree for each batch.
    fn against_cells(&self, means: Means) -> Result<SideSums> {
        let (source, density) = (self.source.0, self.density());
        let cells = (means.threads as u64 + 1).saturating_mul(self.largest_cell_bytes());
        let share =
            (means.memory_bytes / QUERY_SHARE).max(means.memory_bytes.saturating_sub(cells));
        let means = Means { memory_bytes: means.memory_bytes - share, ..means };
        let batch = (share / (QUERY_BYTES + SAMPLE_BYTES)).max(4096) as usize;
        let run = (batch / 2).min(BLOCK_SAMPLES as usize);
        let mut sums = self.new_sums();
        let mut waiting: Vec<Seen> = Vec::new();
        for part in 0..source.n_parts() {
            means.progress.check()?;
            let mesh = source.load(part)?;
            let surface = Surface { mesh: &mesh, colour: source.colours };
            // A batch of neighbours has few cells to visit; cells are neighbours anyway.
            let order = match source.place {
                Place::Memory(mesh) => along_curve(mesh),
                Place::Cells(_) => (0..mesh.triangles.len() as u32).collect(),
            };
            let corners_of = |i: usize| surface.canonical(order[i] as usize).0;
            let mut is_known = vec![false; mesh.positions.len()];
            let n = mesh.triangles.len();
            for first in (0..n).step_by(GATHERED_TRIANGLES) {
                let triangles = first..(first + GATHERED_TRIANGLES).min(n);
                density.in_runs(triangles.clone(), corners_of, run, |samples| {
                    self.make_room(samples.len(), batch, &mut waiting, &mut sums, means)?;
                    waiting.extend(samples.iter().map(|sample| Seen {
                        point: sample.point,
                        look: Some(
                            surface.look(order[first + sample.triangle as usize] as usize, sample),
                        ),
                    }));
                    Ok(())
                })?;
                self.make_room(3 * GATHERED_TRIANGLES, batch, &mut waiting, &mut sums, means)?;
                let corners = order[triangles].iter().flat_map(|&t| mesh.triangles[t as usize]);
                for v in corners {
                    if !std::mem::replace(&mut is_known[v as usize], true) {
                        waiting.push(Seen { point: mesh.positions[v as usize], look: None });
                    }
                }
            }
        }
        self.settle_waiting(&mut waiting, &mut sums, means)?;
        Ok(sums)
    }

    /// Returns the memory of the largest cell of the target with its tree.
    fn largest_cell_bytes(&self) -> u64 {
        let target = self.target.0;
        let bytes = |part| target.bytes(part) + Tree::bytes(target.n_triangles(part));
        (0..target.n_parts()).map(bytes).max().unwrap_or(0)
    }

    /// Settles what is waiting unless `more` fit into the batch besides.
    fn make_room(
        &self,
        more: usize,
        batch: usize,
        waiting: &mut Vec<Seen>,
        sums: &mut SideSums,
        means: Means,
    ) -> Result<()> {
        if waiting.len() + more <= batch {
            return Ok(());
        }
        self.settle_waiting(waiting, sums, means)
    }

    fn settle_waiting(
        &self,
        waiting: &mut Vec<Seen>,
        sums: &mut SideSums,
        means: Means,
    ) -> Result<()> {
        let points: Vec<Vector> = waiting.iter().map(|seen| seen.point).collect();
        let order = sample::order_along_curve(&points);
        let sorted: Vec<Vector> = order.iter().map(|&i| points[i as usize]).collect();
        drop(points);
        // A vertex that is seen to be nearer than the worst so far is not looked at further.
        let enough_sq = sums.worst_sq().next_down();
        let is_sample = |i: u32| waiting[i as usize].look.is_some();
        let enough_sq: Vec<f64> =
            order.iter().map(|&i| if is_sample(i) { -1.0 } else { enough_sq }).collect();
        let hits = settle(&sorted, self.target.0, self.target.1, &enough_sq, means)?;
        for ((&i, &point), hit) in order.iter().zip(&sorted).zip(&hits) {
            let is_hit = hit.distance_sq.is_finite();
            let Some(look) = waiting[i as usize].look else {
                if is_hit {
                    sums.offer_worst(point, hit.distance_sq);
                }
                continue;
            };
            let near = self.options.region.as_ref().map(|region| region.contains(point));
            if is_hit {
                sums.add_sample(point, hit.distance_sq, near);
                sums.add_looks(look, hit.look());
            } else {
                sums.add_sample(point, 0.0, near);
            }
        }
        waiting.clear();
        Ok(())
    }
}
