//! Stage 2: simplifies all cells of a store, each by itself, to one common cost threshold.
//!
//! A threshold, not a quota per cell: flat cells must end emptier than detailed ones. It comes from a pilot
//! over a sample of cells. Vertices shared between cells are locked; nothing else ties the cells together.

use crate::error::{Error, Result};
use crate::kernel::{self, Options, Simplified, Stop};
use crate::mesh::attribute_weights;
use crate::mesh::vec3::{length_sq, normal};
use crate::store::cells::{
    CellMesh, CellStore, CellTally, SurvivorInfo, SurvivorWriter, Survivors, VertexLayout,
    load_bytes,
};
use crate::store::stage_context::Run;
use crate::system::parallel::{Weighted, largest_first};
use serde::{Deserialize, Serialize};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

/// The pilot takes every 32nd cell, at least 4 and at most 48.
const PILOT_SHARE: usize = 32;
const PILOT_CELLS: std::ops::RangeInclusive<usize> = 4..=48;

/// What channels count for is found from every 32nd cell, at least 16 and at most 48: cells differ more in
/// the size of their triangles than in how they fall.
const LENGTH_CELLS: std::ops::RangeInclusive<usize> = 16..=48;

/// The pilot's first threshold, in mean squared triangle areas, and the step to the next.
const PILOT_START: f64 = 1e-4;
const PILOT_STEP: f64 = 4.0;
const PILOT_LEVELS: i32 = 40;

/// A cell on its way down takes one level for each fall of the count by this factor (KERNEL experiments:
/// levels a factor of about 4 apart cost nothing in error).
const LEVEL_FACTOR: f64 = 4.0;

/// Where sources are given back, the survivors that are synced at a time make this part of the store, so that both
/// never lie side by side.
pub const FREED_AT_A_TIME: u64 = 16;

/// Sources are kept until the round is over if it leaves less than one triangle in so many.
const KEEP_SOURCES: u64 = 16;

/// What one round of simplification should reach.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Goal {
    /// 0 for the first round.
    pub round: u32,
    /// Triangles wanted in all cells together; met within some percent.
    pub triangles: u64,
}

/// Whether a round gives the source of a cell back to the file system as soon as the cell is done: where the
/// survivors take so much space that store and survivors would not fit side by side into what the job promises.
/// Thousands of holes in a file cost time otherwise well spent.
pub fn frees_sources(triangles_in: u64, goal_triangles: u64) -> bool {
    goal_triangles > triangles_in / KEEP_SOURCES
}

/// Cost thresholds, ascending; every cell drains them one after the other.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Levels(pub Vec<f64>);

/// Memory in bytes that a cell takes while it is loaded, simplified and encoded.
pub fn cell_bytes(store: &CellStore, cell: usize) -> u64 {
    load_bytes(store.rows(cell), store.layout())
        + kernel_bytes(store.info().cells[cell], store.layout())
}

/// Memory in bytes that the kernel takes for a mesh, besides what it is given.
pub fn kernel_bytes(tally: CellTally, layout: &VertexLayout) -> u64 {
    let CellTally { vertices, triangles } = tally;
    let n_channels = layout.codec.n_channels();
    let wedges = match layout.codec.has_seams(&layout.schema) {
        true => kernel::wedge_bytes(vertices, triangles, n_channels),
        false => 0,
    };
    kernel::peak_bytes(vertices, triangles, n_channels)
        + kernel::mend_bytes(vertices, triangles)
        + kernel::attribute_bytes(vertices, layout.n_weighted())
        + wedges
}

/// For each channel the length that a difference of 1 is worth, from a sample of cells; empty if no channel
/// counts.
pub fn channel_lengths(store: &CellStore, target: u64, run: &Run) -> Result<Vec<f32>> {
    let layout = store.layout();
    if layout.n_weighted() == 0 {
        return Ok(Vec::new());
    }
    let meanings = layout.codec.meanings(&layout.schema);
    let mut sample = attribute_weights::Sample::default();
    for cell in spread_cells(store.n_cells(), LENGTH_CELLS) {
        run.progress.check()?;
        sample.add(&store.load(cell)?.mesh, &meanings);
    }
    Ok(sample.lengths(&layout.weights, &meanings, store.info().triangles, target))
}

/// Simplifies every cell of `store` towards `goal` and seals what is left of them.
pub fn simplify_cells(
    store: &CellStore,
    goal: Goal,
    options: &Options,
    run: &Run,
) -> Result<SurvivorInfo> {
    let levels = sealed_levels(store, goal, options, run)?;
    run_cells(store, goal, run, |_, cell| {
        if levels.0.is_empty() {
            return Survivors::all_of(cell, store.layout());
        }
        let stop = Stop::Costs { levels: levels.0.clone(), floor_triangles: 0 };
        drain(cell, stop, options, store)
    })
}

/// Simplifies every cell to an exact total, at most `goal.triangles`: for results too large for one finish.
///
/// Every cell is run twice: once to learn its count after each of many close levels, once to the levels
/// chosen from those counts. The first cells, in order, stop one level later than the others, so that the
/// total meets the target to within one such step of one cell.
pub fn simplify_cells_exactly(
    store: &CellStore,
    goal: Goal,
    options: &Options,
    run: &Run,
) -> Result<SurvivorInfo> {
    let levels = sealed_levels(store, goal, options, run)?;
    let Some(&last) = levels.0.last() else {
        return run_cells(store, goal, run, |_, cell| Survivors::all_of(cell, store.layout()));
    };
    // Sealed with the counts: another machine's exp2 may differ in the last bit.
    let plan: ExactLevels =
        run.job.sealed(&format!("round {} exact levels", goal.round), || {
            let level = |j| last * (f64::from(j) / FINE_STEPS).exp2();
            let levels: Vec<f64> = (-FINE_LEVELS..=FINE_LEVELS).map(level).collect();
            let counts = run_all(store, run, |cell| {
                let stop = Stop::CloseCosts(levels.clone());
                kernel_run(cell, stop, options).1.statistics.level_counts
            })?;
            let (n_levels, n_ahead) = choose_levels(&counts, store, goal.triangles);
            Ok(ExactLevels { levels, n_levels, n_ahead })
        })?;
    let ExactLevels { levels: fine, n_levels, n_ahead } = plan;
    run_cells(store, goal, run, |index, cell| {
        let depth = n_levels + usize::from(index < n_ahead);
        if depth == 0 {
            return Survivors::all_of(cell, store.layout());
        }
        let stop = Stop::CloseCosts(fine[..depth.min(fine.len())].to_vec());
        drain(cell, stop, options, store)
    })
}

/// The levels of an exact round.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
struct ExactLevels {
    /// Close cost thresholds, ascending.
    levels: Vec<f64>,
    /// How many of them every cell drains.
    n_levels: usize,
    /// How many of the first cells drain one more.
    n_ahead: usize,
}

/// Levels of the exact round: an octave and a half to either side, 16 to an octave.
const FINE_LEVELS: i32 = 24;
const FINE_STEPS: f64 = 16.0;

/// How many levels every cell takes, and how many of the first cells take one more, so that the total is
/// the largest that does not exceed `target`.
fn choose_levels(counts: &[Vec<u64>], store: &CellStore, target: u64) -> (usize, usize) {
    let after = |cell: usize, depth: usize| match depth {
        0 => store.info().cells[cell].triangles,
        _ => counts[cell].get(depth - 1).or(counts[cell].last()).copied().unwrap_or(0),
    };
    let total = |depth: usize| (0..counts.len()).map(|cell| after(cell, depth)).sum::<u64>();
    let deepest = counts.iter().map(Vec::len).max().unwrap_or(0);
    let Some(enough) = (0..=deepest).find(|&depth| total(depth) <= target) else {
        return (deepest, 0);
    };
    if enough == 0 {
        return (0, 0);
    }
    let mut sum = total(enough - 1);
    for cell in 0..counts.len() {
        if sum <= target {
            return (enough - 1, cell);
        }
        sum = sum - after(cell, enough - 1) + after(cell, enough);
    }
    (enough - 1, counts.len())
}

/// The kernel on one cell; gives back what identifies its vertices (the cell without its mesh), too.
fn kernel_run(mut cell: CellMesh, stop: Stop, options: &Options) -> (CellMesh, Simplified) {
    let options = Options { stop, ..options.clone() };
    let mesh = std::mem::take(&mut cell.mesh);
    let simplified = kernel::simplify_mesh(mesh, &cell.shared, &options);
    (cell, simplified)
}

fn drain(cell: CellMesh, stop: Stop, options: &Options, store: &CellStore) -> Survivors {
    let options = Options { estimate: true, ..options.clone() };
    let (cell, simplified) = kernel_run(cell, stop, &options);
    let mut left =
        Survivors::new(&cell.ids, &cell.shared, &cell.records, simplified, store.layout());
    left.statistics.dropped = cell.dropped;
    left
}

/// The levels of a round, found once and then the same for every run that continues it.
fn sealed_levels(store: &CellStore, goal: Goal, options: &Options, run: &Run) -> Result<Levels> {
    let name = format!("round {} levels", goal.round);
    run.job.sealed(&name, || pilot(store, goal, options, run))
}

/// Finds the levels that bring the whole store to `goal` from how a sample of its cells behaves.
fn pilot(store: &CellStore, goal: Goal, options: &Options, run: &Run) -> Result<Levels> {
    let n_triangles = store.info().triangles;
    if goal.triangles >= n_triangles {
        return Ok(Levels::default());
    }
    // Nearly empty cells, around a hub whose triangles lie in another, tell nothing.
    let counts = || store.info().cells.iter().map(|cell| cell.triangles);
    let enough = n_triangles / store.n_cells() as u64 / 8;
    let telling: Vec<usize> =
        counts().enumerate().filter(|&(_, n)| n > enough).map(|(cell, _)| cell).collect();
    let sample: Vec<usize> = pilot_cells(telling.len()).into_iter().map(|i| telling[i]).collect();
    let ratio = goal.triangles as f64 / n_triangles as f64;
    let area = mean_area(&store.load_tidy(sample[0])?);
    let ladder: Vec<f64> =
        (0..PILOT_LEVELS).map(|k| PILOT_START * area * area * PILOT_STEP.powi(k)).collect();
    let curves = Mutex::new(Vec::with_capacity(sample.len()));
    for_cells(store, sample.iter().copied(), run, |cell| {
        let cell = store.load_tidy(cell)?;
        // Far enough below its share to see what the others may ask of a flat cell.
        let floor = (cell.mesh.triangles.len() as f64 * ratio / 4.0) as u64;
        let stop = Stop::Costs { levels: ladder.clone(), floor_triangles: floor };
        let counts = kernel_run(cell, stop, options).1.statistics.level_counts;
        // In any order: only sums are taken.
        curves.lock().unwrap_or_else(PoisonError::into_inner).push(counts);
        Ok(())
    })?;
    let curves = curves.into_inner().unwrap_or_else(PoisonError::into_inner);
    let start: u64 = sample.iter().map(|&cell| store.info().cells[cell].triangles).sum();
    let total: Vec<f64> = (0..ladder.len())
        .map(|level| curves.iter().map(|curve| count_at(curve, level)).sum::<u64>() as f64)
        .collect();
    Ok(choose_ladder(&ladder, &total, start as f64, ratio))
}

fn count_at(curve: &[u64], level: usize) -> u64 {
    curve.get(level).or(curve.last()).copied().unwrap_or(0)
}

/// Cells to run the pilot on.
fn pilot_cells(n_cells: usize) -> Vec<usize> {
    spread_cells(n_cells, PILOT_CELLS)
}

/// Every 32nd cell within bounds: evenly spaced, starting within the first stretch.
fn spread_cells(n_cells: usize, bounds: std::ops::RangeInclusive<usize>) -> Vec<usize> {
    let n = (n_cells / PILOT_SHARE).clamp(*bounds.start(), *bounds.end()).min(n_cells);
    (0..n).map(|i| (2 * i + 1) * n_cells / (2 * n)).collect()
}

fn mean_area(cell: &CellMesh) -> f64 {
    let n = cell.mesh.triangles.len();
    let doubled = |t: usize| length_sq(normal(cell.mesh.corners(t))).sqrt();
    let area = 0.5 * (0..n).map(doubled).sum::<f64>() / n.max(1) as f64;
    // All triangles degenerate: any positive scale will do.
    if area > 0.0 && area.is_finite() { area } else { f64::MIN_POSITIVE.sqrt() }
}

/// Levels at which the sample falls by `LEVEL_FACTOR` each, the last where it meets `ratio`.
fn choose_ladder(ladder: &[f64], total: &[f64], start: f64, ratio: f64) -> Levels {
    let mut levels = Vec::new();
    let mut wanted = start;
    loop {
        wanted = (wanted / LEVEL_FACTOR).max(start * ratio);
        let cost = interpolate(ladder, total, start, wanted);
        if levels.last().is_none_or(|&last| cost > last) {
            levels.push(cost);
        }
        if wanted <= start * ratio {
            return Levels(levels);
        }
    }
}

/// The cost at which the count falls to `wanted`, linear in the logarithms between two levels.
fn interpolate(ladder: &[f64], total: &[f64], start: f64, wanted: f64) -> f64 {
    let Some(level) = total.iter().position(|&count| count <= wanted) else {
        return ladder[ladder.len() - 1];
    };
    let before = if level == 0 { start } else { total[level - 1] };
    let (high, low) = (before.max(1.0).ln(), total[level].max(1.0).ln());
    let share = if high > low { (high - wanted.max(1.0).ln()) / (high - low) } else { 1.0 };
    ladder[level] * PILOT_STEP.powf(share.clamp(0.0, 1.0) - 1.0)
}

/// Runs `work` on some cells, largest first, as many at once as the memory holds.
fn for_cells(
    store: &CellStore,
    cells: impl Iterator<Item = usize>,
    run: &Run,
    work: impl Fn(usize) -> Result<()> + Sync,
) -> Result<()> {
    let jobs = cells.map(|item| Weighted { item, bytes: cell_bytes(store, item) }).collect();
    let announce = |cell| store.expect(cell);
    largest_first(jobs, run.threads, run.memory_bytes, run.progress, announce, work)
}

/// Runs `work` on every cell without writing anything; outcomes in cell order.
fn run_all<T: Send + Clone + Default>(
    store: &CellStore,
    run: &Run,
    work: impl Fn(CellMesh) -> T + Sync,
) -> Result<Vec<T>> {
    let outcomes = Mutex::new(vec![T::default(); store.n_cells()]);
    for_cells(store, 0..store.n_cells(), run, |cell| {
        let outcome = work(store.load_tidy(cell)?);
        outcomes.lock().unwrap_or_else(PoisonError::into_inner)[cell] = outcome;
        Ok(())
    })?;
    Ok(outcomes.into_inner().unwrap_or_else(PoisonError::into_inner))
}

struct Output {
    writer: SurvivorWriter,
    /// Whether sources of cells are given back to the file system.
    frees: bool,
    /// Cells appended since the last sync; their sources are still needed.
    unsynced: Vec<usize>,
    /// Length of the pack at the last sync.
    synced_bytes: u64,
    synced_at: Instant,
}

/// Runs `work` on the cells that are not yet in the round's pack of survivors, and seals the pack.
fn run_cells(
    store: &CellStore,
    goal: Goal,
    run: &Run,
    work: impl Fn(usize, CellMesh) -> Survivors + Sync,
) -> Result<SurvivorInfo> {
    let name = format!("round-{}.survivors", goal.round);
    let writer = SurvivorWriter::open(run.disk(), run.job.folder(), &name, store.layout())?;
    let mut is_done = vec![false; store.n_cells()];
    for cell in writer.finished() {
        if let Some(done) = is_done.get_mut(cell as usize) {
            *done = true;
            run.progress.add(store.info().cells[cell as usize].triangles);
        }
    }
    let frees = frees_sources(store.info().triangles, goal.triangles);
    let synced_at = Instant::now();
    let (unsynced, synced_bytes) = (Vec::new(), writer.length());
    let output = Mutex::new(Output { writer, frees, unsynced, synced_bytes, synced_at });
    let freed_bytes = store.info().pack_bytes / FREED_AT_A_TIME;
    let left = (0..store.n_cells()).filter(|&cell| !is_done[cell]);
    let outcome = for_cells(store, left, run, |cell| {
        let survivors = work(cell, store.load_tidy(cell)?);
        let mut output = output.lock().map_err(half_written)?;
        output.writer.append(cell, &survivors)?;
        output.unsynced.push(cell);
        run.progress.add(store.info().cells[cell].triangles);
        let is_much = output.writer.length() - output.synced_bytes >= freed_bytes;
        if output.synced_at.elapsed() >= run.checkpoint_every || (frees && is_much) {
            output.sync(store)?;
        }
        Ok(())
    });
    let mut output = match output.into_inner() {
        Ok(output) => output,
        // The panic that poisoned it is the outcome.
        Err(poisoned) => return Err(outcome.err().unwrap_or_else(|| half_written(poisoned))),
    };
    // Also after a failure or a signal: what is done stays done.
    let synced = output.sync(store);
    outcome.and(synced)?;
    output.writer.finish(run.disk(), run.job.folder(), store.n_cells())
}

/// A panic within `append` may have left half a chunk: nothing may follow it, and no source be freed for it.
fn half_written<T>(_: PoisonError<T>) -> Error {
    Error::Internal("another worker fell while it wrote".to_owned())
}

impl Output {
    /// Makes finished cells durable, then frees what they came from if that is worth it.
    fn sync(&mut self, store: &CellStore) -> Result<()> {
        self.writer.sync()?;
        for cell in self.unsynced.drain(..) {
            if self.frees {
                store.free(cell)?;
            }
        }
        self.synced_bytes = self.writer.length();
        self.synced_at = Instant::now();
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_fall_by_four_and_end_at_the_ratio() {
        // N = 1000 t^-0.5 above t = 1.
        let ladder: Vec<f64> = (0..12).map(|k| 4f64.powi(k)).collect();
        let total: Vec<f64> = ladder.iter().map(|t| 1000.0 / t.sqrt()).collect();
        let Levels(levels) = choose_ladder(&ladder, &total, 1000.0, 0.01);
        let wanted = [16.0, 256.0, 4096.0, 10_000.0];
        assert_eq!(levels.len(), wanted.len());
        for (level, wanted) in levels.iter().zip(wanted) {
            assert!((level / wanted - 1.0).abs() < 0.02, "{levels:?}");
        }
    }
}
