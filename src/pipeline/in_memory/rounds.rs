//! One round over cells in memory: a pilot finds the threshold, then all cells are simplified in parallel.
//!
//! docs/algorithm.md, section 11.

use super::whole::{Left, WholeMesh};
use crate::error::Result;
use crate::kernel::{self, Options, Simplified, Stepwise, Stop};
use crate::mesh::global_vertex::GlobalVertex;
use crate::stages::partition::CutMesh;
use crate::stages::simplify::{Thresholds, descend, ladder, pilot_sample};
use crate::store::cell_id::CellId;
use crate::store::cells::CellMesh;
use crate::system::parallel::{Weighted, largest_first};
use crate::system::progress::Progress;
use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

/// Copies of pilot cells are kept that are at most this many times what they should come to, and at least a share of
/// one over this; and the last few of them only. The others are simplified again.
const KEPT_MULTIPLE: f64 = 3.0;
const MOST_COPIES: usize = 2;

/// The surroundings of a round; none of it reaches a result.
#[derive(Clone, Copy)]
pub(super) struct Means<'a> {
    pub(super) threads: usize,
    /// Memory for cells at work, in bytes.
    pub(super) memory_bytes: u64,
    pub(super) progress: &'a Progress,
}

/// Simplifies every cell of `cut` until about `goal` triangles are left in all of them.
pub(super) fn round(
    whole: &WholeMesh,
    cut: &CutMesh,
    goal: u64,
    (options, tidies): (&Options, bool),
    means: Means,
) -> Result<Vec<Left>> {
    let n_triangles = whole.mesh.triangles.len() as u64;
    let load = |cell| cut.load(&whole.mesh, &whole.ids, cell, tidies);
    let thresholds = Pilot { cut, load: &load, options, means };
    let (thresholds, begun) = thresholds.run(goal as f64 / n_triangles as f64)?;
    let results: Mutex<BTreeMap<CellId, Left>> = Mutex::default();
    let begun = Mutex::new(begun);
    for_cells(cut, CellId::first(cut.n_cells()), (options, means), |cell| {
        let ready = begun.lock().unwrap_or_else(PoisonError::into_inner).remove(&cell);
        let left = match (ready, thresholds.last()) {
            (Some((ids, mut stepwise)), Some(last)) => {
                stepwise.level(last);
                Left { ids, simplified: stepwise.finish() }
            }
            _ => simplify(load(cell), thresholds.stop(cell, cut.n_triangles(cell)), options),
        };
        results.lock().unwrap_or_else(PoisonError::into_inner).insert(cell, left);
        means.progress.add(cut.n_triangles(cell));
        means.progress.check()
    })?;
    let results = results.into_inner().unwrap_or_else(PoisonError::into_inner);
    Ok(results.into_values().collect())
}

/// Runs the kernel on one cell.
pub(super) fn simplify(mut cell: CellMesh, stop: Stop, options: &Options) -> Left {
    let options = Options { stop, estimate: true, ..options.clone() };
    let mesh = std::mem::take(&mut cell.mesh);
    let simplified: Simplified = kernel::simplify_mesh(mesh, &cell.shared, &options);
    Left { ids: cell.ids, simplified }
}

/// Runs `work` on some cells, largest first, as many at once as the memory holds.
fn for_cells(
    cut: &CutMesh,
    cells: impl Iterator<Item = CellId>,
    (options, means): (&Options, Means),
    work: impl Fn(CellId) -> Result<()> + Sync,
) -> Result<()> {
    let n_channels = options.confined.len();
    let n_weighted = options.weights.iter().filter(|weight| **weight > 0.0).count();
    let weighted = |cell: CellId| {
        let n = cut.n_triangles(cell);
        let wedges = match options.confined.contains(&true) {
            true => kernel::wedge_bytes(n / 2, n, n_channels),
            false => 0,
        };
        let attributes = kernel::attribute_bytes(n / 2, n_weighted) + wedges;
        let bytes = kernel::peak_bytes(n / 2, n, n_channels) + attributes;
        Weighted { item: cell.index(), bytes }
    };
    let jobs = cells.map(weighted).collect();
    let work = |item| work(CellId::at(item));
    let Means { threads, memory_bytes, progress } = means;
    largest_first(jobs, threads, memory_bytes, progress, |_| (), work)
}

/// Sampled cells on their way, by cell: the ids of their vertices, and the cell below all rungs it is to take.
type Begun = BTreeMap<CellId, (Vec<GlobalVertex>, Stepwise)>;

struct Pilot<'a> {
    cut: &'a CutMesh,
    load: &'a (dyn Fn(CellId) -> CellMesh + Sync),
    options: &'a Options,
    means: Means<'a>,
}

/// One sampled cell: the ids of its vertices, its counts after each rung, and copies by number of rungs taken.
struct Sampled {
    ids: Vec<GlobalVertex>,
    counts: Vec<u64>,
    copies: BTreeMap<usize, Stepwise>,
}

impl Pilot<'_> {
    /// Finds the thresholds that leave a share `ratio` of the triangles.
    fn run(&self, ratio: f64) -> Result<(Thresholds, Begun)> {
        let cut = self.cut;
        if ratio >= 1.0 {
            return Ok((Thresholds::default(), Begun::new()));
        }
        let sample = pilot_sample(cut.n_cells(), |cell| cut.n_triangles(cell));
        let rungs = ladder(&(self.load)(sample[0]).mesh);
        let options = Options { estimate: true, ..self.options.clone() };
        let sampled: Mutex<BTreeMap<CellId, Sampled>> = Mutex::default();
        for_cells(cut, sample.iter().copied(), (self.options, self.means), |index| {
            let mut cell = (self.load)(index);
            let mesh = std::mem::take(&mut cell.mesh);
            let start = mesh.triangles.len() as u64;
            let mut stepwise = Stepwise::new(mesh, &cell.shared, &options);
            let mut copies = BTreeMap::new();
            let counts = descend(&mut stepwise, &rungs, (start, ratio), |stepwise, n| {
                self.means.progress.check()?;
                let of_wanted = stepwise.n_triangles() as f64 / (start as f64 * ratio);
                if (1.0 / KEPT_MULTIPLE..=KEPT_MULTIPLE).contains(&of_wanted) {
                    if copies.len() == MOST_COPIES {
                        copies.pop_first();
                    }
                    copies.insert(n, stepwise.clone());
                }
                Ok(())
            })?;
            let found = Sampled { ids: cell.ids, counts, copies };
            sampled.lock().unwrap_or_else(PoisonError::into_inner).insert(index, found);
            Ok(())
        })?;
        let sampled = sampled.into_inner().unwrap_or_else(PoisonError::into_inner);
        let curves = sampled.iter().map(|(&cell, found)| (cell, found.counts.clone())).collect();
        let start = sample.iter().map(|&cell| cut.n_triangles(cell)).sum();
        let thresholds = Thresholds::choose(rungs, &curves, start, ratio);
        let mut begun = Begun::new();
        for (cell, mut found) in sampled {
            let copy = thresholds.n_taken(cell).and_then(|n| found.copies.remove(&n));
            if let Some(copy) = copy {
                begun.insert(cell, (found.ids, copy));
            }
        }
        Ok((thresholds, begun))
    }
}
