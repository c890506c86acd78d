//! Simplifies cells to an exact total, by a trial run of every cell.

use super::fitted;
use super::pilot::sealed_thresholds;
use super::run_cells::{Goal, drain, kernel_run, run_all, run_cells};
use crate::error::Result;
use crate::kernel::{Options, Stop};
use crate::store::cells::{CellStore, SurvivorInfo, Survivors};
use crate::store::stage_context::StageContext;
use serde::{Deserialize, Serialize};

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
    let Some(last) = thresholds.last() else {
        return run_cells(store, goal, run, |_, cell| Survivors::all_of(cell, store.layout()));
    };
    // Sealed with the counts: another machine's exp2 may differ in the last bit.
    let plan: ExactLevels =
        run.job.sealed(&format!("round {} exact levels", goal.round), || {
            let level = |j| last * (f64::from(j) / FINE_STEPS).exp2();
            let levels: Vec<f64> = (-FINE_LEVELS..=FINE_LEVELS).map(level).collect();
            let counts = run_all((store, goal), run, |cell| {
                let stop = Stop::CloseCosts(levels.clone());
                kernel_run(cell, stop, options).1.statistics.level_counts
            })?;
            let (n_levels, n_ahead) = choose_levels(&counts, store, goal.triangles);
            Ok(ExactLevels { levels, n_levels, n_ahead })
        })?;
    let ExactLevels { levels: fine, n_levels, n_ahead } = plan;
    let options = &Options { keeps_relief: false, ..fitted(options, store, goal) };
    run_cells(store, goal, run, |id, cell| {
        let depth = n_levels + usize::from(id.index() < n_ahead);
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
    /// Number of them that every cell drains.
    n_levels: usize,
    /// Number of first cells that drain one more.
    n_ahead: usize,
}

/// Levels of the exact round: an octave and a half to either side, 16 to an octave.
const FINE_LEVELS: i32 = 24;
const FINE_STEPS: f64 = 16.0;

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
