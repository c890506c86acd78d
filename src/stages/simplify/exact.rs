//! Simplifies cells to an exact total, by a trial run of every cell.

use super::fitted;
use super::ladder::Thresholds;
use super::pilot::sealed_thresholds;
use super::run_cells::{Goal, drain, kernel_run, run_all, run_cells};
use crate::error::Result;
use crate::kernel::{Options, Stop};
use crate::store::cell_id::CellId;
use crate::store::cells::{CellStore, SurvivorInfo, Survivors};
use crate::store::stage_context::StageContext;
use libm::exp2;
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Simplifies every cell to an exact total, at most `goal.triangles`: for results too large for one finish.
///
/// Every cell is run twice: once to learn its count after each of many close levels, once to the levels
/// chosen from those counts. The first cells, in order, stop one level later than the others, so that the
/// total meets the target to within one such step of one cell.
pub fn simplify_cells_exactly(
    store: &CellStore,
    goal: Goal,
    options: &Options,
    run: &StageContext,
) -> Result<SurvivorInfo> {
    let (thresholds, _) = sealed_thresholds(store, goal, options, run, false)?;
    let levels: ExactLevels =
        run.job.sealed(&format!("round {} exact levels", goal.round), || {
            let near = near_levels(&thresholds);
            let counts = run_to(near, (store, goal), options, run, 0..store.n_cells())?;
            if left_after(&counts) <= goal.triangles {
                return Ok(ExactLevels::choose(&thresholds, &counts, store, goal));
            }
            let counts = trial((store, goal), options, &thresholds, run, 0..store.n_cells())?;
            Ok(ExactLevels::choose(&thresholds, &counts, store, goal))
        })?;
    let options = &Options { keeps_relief: false, ..fitted(options, store, goal) };
    run_cells(store, goal, run, |id, cell| match levels.stop(id) {
        Some(stop) => drain(cell, stop, options, store),
        None => Survivors::all_of(cell, store.layout()),
    })
}

/// The counts of some cells after each of many close levels, in the order of the cells; nothing where nothing is to be done.
pub fn trial(
    round: (&CellStore, Goal),
    options: &Options,
    thresholds: &Thresholds,
    run: &StageContext,
    cells: Range<usize>,
) -> Result<Vec<Vec<u64>>> {
    run_to(close_levels(thresholds), round, options, run, cells)
}

/// The counts of some cells after each of `levels`.
fn run_to(
    levels: Vec<f64>,
    round: (&CellStore, Goal),
    options: &Options,
    run: &StageContext,
    cells: Range<usize>,
) -> Result<Vec<Vec<u64>>> {
    if levels.is_empty() {
        return Ok(Vec::new());
    }
    run_all(round, cells, run, |cell| {
        let stop = Stop::CloseCosts(levels.clone());
        kernel_run(cell, stop, options).1.statistics.level_counts
    })
}

/// Triangles in all cells after the last of their levels.
fn left_after(counts: &[Vec<u64>]) -> u64 {
    counts.iter().filter_map(|counts| counts.last()).sum()
}

/// The close levels that are tried first. Each costs a trial as many collapses as the round itself needs.
fn near_levels(thresholds: &Thresholds) -> Vec<f64> {
    let mut levels = close_levels(thresholds);
    levels.truncate((FINE_LEVELS + NEAR_LEVELS + 1) as usize);
    levels
}

fn close_levels(thresholds: &Thresholds) -> Vec<f64> {
    let level = |last: f64, j| last * exp2(f64::from(j) / FINE_STEPS);
    let levels = |last| (-FINE_LEVELS..=FINE_LEVELS).map(|j| level(last, j)).collect();
    thresholds.last().map_or_else(Vec::new, levels)
}

/// The levels of an exact round.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct ExactLevels {
    /// Close cost thresholds, ascending. Empty: nothing is to be done.
    levels: Vec<f64>,
    /// Number of them that every cell drains.
    n_levels: usize,
    /// Number of first cells that drain one more.
    n_ahead: usize,
}

impl ExactLevels {
    /// The levels that meet the goal, from the counts of all cells in a trial.
    pub fn choose(
        thresholds: &Thresholds,
        counts: &[Vec<u64>],
        store: &CellStore,
        goal: Goal,
    ) -> ExactLevels {
        let (n_levels, n_ahead) = choose_levels(counts, store, goal.triangles);
        ExactLevels { levels: close_levels(thresholds), n_levels, n_ahead }
    }

    /// The end of a cell; `None` if it stays as it is.
    pub fn stop(&self, cell: CellId) -> Option<Stop> {
        let depth = self.n_levels + usize::from(cell.index() < self.n_ahead);
        let levels = &self.levels[..depth.min(self.levels.len())];
        (!levels.is_empty()).then(|| Stop::CloseCosts(levels.to_vec()))
    }
}

/// Levels of the exact round: an octave and a half to either side, 16 to an octave.
const FINE_LEVELS: i32 = 24;
const FINE_STEPS: f64 = 16.0;

/// Levels above the pilot's threshold that a trial takes at first.
const NEAR_LEVELS: i32 = 6;

/// Chooses the number of levels of every cell, and of first cells that take one more, so that the total is
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
