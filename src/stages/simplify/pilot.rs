//! The pilot: finds the cost threshold of a round from how a sample of its cells falls.
//!
//! Its cells go down a ladder of thresholds, with a copy of each kept on the way. Once the threshold of the round is
//! known they go on from there, so that the pilot costs little more than its look ahead. What was not kept, for
//! want of memory or after an interruption, is computed again along the same ladder: the same bytes.

use super::memory::cell_bytes;
use super::run_cells::{Goal, for_cells};
use crate::error::Result;
use crate::kernel::{Options, Stepwise};
use crate::mesh::vec3::{length_sq, normal};
use crate::store::cells::{CellMesh, CellStore};
use crate::store::stage_context::Run;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

/// Samples take every 32nd cell, within bounds.
const SAMPLE_SHARE: usize = 32;
/// The pilot takes at least 4 cells and at most 48.
const PILOT_CELLS: std::ops::RangeInclusive<usize> = 4..=48;

/// The pilot's first threshold, in mean squared triangle areas, and the step to the next.
const PILOT_START: f64 = 1e-4;
const PILOT_STEP: f64 = 4.0;
const PILOT_LEVELS: i32 = 40;

/// A cell on its way down takes one level for each fall of the count by this factor: levels so far apart cost
/// nothing in error (docs/results/kernel.md).
const LEVEL_FACTOR: f64 = 4.0;

/// A cell of which half is gone has come to its end when so many levels one after the other, together a factor
/// of 4096 in cost, leave all but one in 200 triangles each.
const DEAD_LEVELS: usize = 6;
const DEAD_SHARE: u64 = 200;

/// Copies are kept of cells that are at most this many times what they should come to: the threshold will be
/// below that.
const KEPT_MULTIPLE: f64 = 6.0;

/// Cost thresholds of a round, ascending; every cell drains them one after the other.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Thresholds {
    /// Those of all cells but the pilot's; the last one is that of the round. Empty: nothing is to be done.
    levels: Vec<f64>,
    /// Those of the pilot's cells.
    ladder: Vec<f64>,
    /// Number of rungs that each cell of the pilot takes before the threshold of the round.
    n_taken: BTreeMap<usize, usize>,
}

impl Thresholds {
    /// The threshold of the round, if anything is to be done.
    pub(super) fn last(&self) -> Option<f64> {
        self.levels.last().copied()
    }

    /// The thresholds of one cell.
    pub(super) fn of(&self, cell: usize) -> Vec<f64> {
        match self.n_taken.get(&cell) {
            Some(&n) => self.ladder[..n].iter().copied().chain(self.last()).collect(),
            None => self.levels.clone(),
        }
    }
}

/// Cells of the pilot as far as they have come, by cell and number of levels.
#[derive(Default)]
pub(super) struct Begun(Mutex<BTreeMap<(usize, usize), Stepwise>>);

impl Begun {
    /// The cell on its way, all of its thresholds but the last behind it.
    pub(super) fn take(&self, cell: usize, thresholds: &Thresholds) -> Option<Stepwise> {
        let n = *thresholds.n_taken.get(&cell)?;
        self.0.lock().unwrap_or_else(PoisonError::into_inner).remove(&(cell, n))
    }
}

/// The thresholds of a round, found once and then the same for every run that continues it; and what the pilot has
/// begun, if it ran now and `keeps` it.
pub(super) fn sealed_thresholds(
    store: &CellStore,
    goal: Goal,
    options: &Options,
    run: &Run,
    keeps: bool,
) -> Result<(Thresholds, Begun)> {
    let begun = Begun::default();
    let name = format!("round {} levels", goal.round);
    let thresholds =
        run.job.sealed(&name, || pilot(store, goal, options, run, keeps.then_some(&begun)))?;
    let mut copies = begun.0.lock().unwrap_or_else(PoisonError::into_inner);
    copies.retain(|(cell, n), _| thresholds.n_taken.get(cell) == Some(n));
    drop(copies);
    Ok((thresholds, begun))
}

/// Finds the thresholds that bring the whole store to `goal`.
fn pilot(
    store: &CellStore,
    goal: Goal,
    options: &Options,
    run: &Run,
    begun: Option<&Begun>,
) -> Result<Thresholds> {
    let n_triangles = store.info().triangles;
    if goal.triangles >= n_triangles {
        return Ok(Thresholds::default());
    }
    // Nearly empty cells, around a hub whose triangles lie in another, tell nothing.
    let counts = || store.info().cells.iter().map(|cell| cell.triangles);
    let enough = n_triangles / store.n_cells() as u64 / 8;
    let telling: Vec<usize> =
        counts().enumerate().filter(|&(_, n)| n > enough).map(|(cell, _)| cell).collect();
    let sample = spread_cells(telling.len(), PILOT_CELLS);
    let sample: Vec<usize> = sample.into_iter().map(|i| telling[i]).collect();
    let ratio = goal.triangles as f64 / n_triangles as f64;
    let area = mean_area(&store.load_tidy(sample[0])?);
    let ladder: Vec<f64> =
        (0..PILOT_LEVELS).map(|k| PILOT_START * area * area * PILOT_STEP.powi(k)).collect();
    // Counts after each level, by cell.
    let curves = Mutex::new(BTreeMap::new());
    let free_bytes = AtomicU64::new(bytes_for_copies(store, run));
    let options = Options { estimate: begun.is_some(), ..options.clone() };
    for_cells((store, goal), sample.iter().copied(), run, |index| {
        let mut cell = store.load_tidy(index)?;
        let mesh = std::mem::take(&mut cell.mesh);
        let start = mesh.triangles.len() as u64;
        let mut stepwise = Stepwise::new(mesh, &cell.shared, &options);
        drop(cell);
        let wanted = start as f64 * ratio;
        let mut counts: Vec<u64> = Vec::new();
        for &level in &ladder {
            run.progress.check()?;
            counts.push(stepwise.level(level));
            if let Some(begun) = begun
                && stepwise.n_triangles() as f64 <= KEPT_MULTIPLE * wanted
                && takes(&free_bytes, stepwise.copy_bytes())
            {
                let mut copies = begun.0.lock().unwrap_or_else(PoisonError::into_inner);
                copies.insert((index, counts.len()), stepwise.clone());
            }
            // Far enough below its share to see what the others may ask of a flat cell.
            if stepwise.n_triangles() as f64 <= wanted / 4.0 || is_dead(&counts, start) {
                break;
            }
        }
        curves.lock().unwrap_or_else(PoisonError::into_inner).insert(index, counts);
        Ok(())
    })?;
    let curves = curves.into_inner().unwrap_or_else(PoisonError::into_inner);
    let start: u64 = sample.iter().map(|&cell| store.info().cells[cell].triangles).sum();
    let total: Vec<f64> = (0..ladder.len())
        .map(|level| curves.values().map(|curve| count_at(curve, level)).sum::<u64>() as f64)
        .collect();
    let levels = choose_levels(&ladder, &total, start as f64, ratio);
    let last = levels.last().copied().unwrap_or(0.0);
    let n_below = ladder.iter().filter(|&&level| level < last).count();
    let n_taken = curves.iter().map(|(&cell, curve)| (cell, curve.len().min(n_below))).collect();
    Ok(Thresholds { levels, ladder, n_taken })
}

/// Memory that copies may take: half of what the largest cells on all threads leave of the budget.
fn bytes_for_copies(store: &CellStore, run: &Run) -> u64 {
    let largest = (0..store.n_cells()).map(|cell| cell_bytes(store, cell, 1.0)).max().unwrap_or(0);
    run.memory_bytes.saturating_sub(largest.saturating_mul(run.threads as u64)) / 2
}

/// Takes `bytes` out of what is free, if there are as many.
fn takes(free_bytes: &AtomicU64, bytes: u64) -> bool {
    free_bytes
        .fetch_update(Ordering::Relaxed, Ordering::Relaxed, |free| free.checked_sub(bytes))
        .is_ok()
}

/// Tells if a cell that has lost half of its triangles has stopped falling.
fn is_dead(counts: &[u64], start: u64) -> bool {
    let last = counts.last_chunk::<{ DEAD_LEVELS + 1 }>();
    last.is_some_and(|last| {
        last[0] < start / 2 && last.windows(2).all(|pair| pair[0] - pair[1] <= pair[0] / DEAD_SHARE)
    })
}

/// Every 32nd cell within bounds: evenly spaced, starting within the first stretch.
pub(super) fn spread_cells(n_cells: usize, bounds: std::ops::RangeInclusive<usize>) -> Vec<usize> {
    let n = (n_cells / SAMPLE_SHARE).clamp(*bounds.start(), *bounds.end()).min(n_cells);
    (0..n).map(|i| (2 * i + 1) * n_cells / (2 * n)).collect()
}

fn count_at(curve: &[u64], level: usize) -> u64 {
    curve.get(level).or(curve.last()).copied().unwrap_or(0)
}

fn mean_area(cell: &CellMesh) -> f64 {
    let n = cell.mesh.triangles.len();
    let doubled = |t: usize| length_sq(normal(cell.mesh.corners(t))).sqrt();
    let area = 0.5 * (0..n).map(doubled).sum::<f64>() / n.max(1) as f64;
    // All triangles degenerate: any positive scale will do.
    if area > 0.0 && area.is_finite() { area } else { f64::MIN_POSITIVE.sqrt() }
}

/// Levels at which the sample falls by `LEVEL_FACTOR` each, the last where it meets `ratio`.
fn choose_levels(ladder: &[f64], total: &[f64], start: f64, ratio: f64) -> Vec<f64> {
    let mut levels: Vec<f64> = Vec::new();
    let mut wanted = start;
    loop {
        wanted = (wanted / LEVEL_FACTOR).max(start * ratio);
        let cost = interpolate(ladder, total, start, wanted);
        if levels.last().is_none_or(|&last| cost > last) {
            levels.push(cost);
        }
        if wanted <= start * ratio {
            return levels;
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_fall_by_four_and_end_at_the_ratio() {
        // N = 1000 t^-0.5 above t = 1.
        let ladder: Vec<f64> = (0..12).map(|k| 4f64.powi(k)).collect();
        let total: Vec<f64> = ladder.iter().map(|t| 1000.0 / t.sqrt()).collect();
        let levels = choose_levels(&ladder, &total, 1000.0, 0.01);
        let wanted = [16.0, 256.0, 4096.0, 10_000.0];
        assert_eq!(levels.len(), wanted.len());
        for (level, wanted) in levels.iter().zip(wanted) {
            assert!((level / wanted - 1.0).abs() < 0.02, "{levels:?}");
        }
    }

    #[test]
    fn a_cell_is_dead_only_after_it_has_begun_to_fall() {
        assert!(!is_dead(&[1000; 20], 1000));
        assert!(!is_dead(&[400, 400, 400, 400, 400, 400], 1000));
        assert!(is_dead(&[400, 400, 400, 399, 399, 399, 399], 1000));
        assert!(!is_dead(&[400, 400, 400, 390, 390, 390, 390], 1000));
    }

    #[test]
    fn cells_of_the_pilot_go_down_the_ladder() {
        let thresholds = Thresholds {
            levels: vec![5.0, 20.0],
            ladder: vec![1.0, 4.0, 16.0, 64.0],
            n_taken: BTreeMap::from([(3, 3), (4, 0)]),
        };
        assert_eq!(thresholds.of(0), [5.0, 20.0]);
        assert_eq!(thresholds.of(3), [1.0, 4.0, 16.0, 20.0]);
        assert_eq!(thresholds.of(4), [20.0]);
    }
}
