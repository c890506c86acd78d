//! Finds the cost levels of a round from how a sample of its cells behaves.

use super::run_cells::{Goal, for_cells, kernel_run};
use crate::error::Result;
use crate::kernel::{Options, Stop};
use crate::mesh::vec3::{length_sq, normal};
use crate::store::cells::{CellMesh, CellStore};
use crate::store::stage_context::Run;
use serde::{Deserialize, Serialize};
use std::sync::{Mutex, PoisonError};

/// The pilot takes every 32nd cell, at least 4 and at most 48.
const PILOT_SHARE: usize = 32;
const PILOT_CELLS: std::ops::RangeInclusive<usize> = 4..=48;

/// The pilot's first threshold, in mean squared triangle areas, and the step to the next.
const PILOT_START: f64 = 1e-4;
const PILOT_STEP: f64 = 4.0;
const PILOT_LEVELS: i32 = 40;

/// A cell on its way down takes one level for each fall of the count by this factor (KERNEL experiments:
/// levels a factor of about 4 apart cost nothing in error).
const LEVEL_FACTOR: f64 = 4.0;

/// Cost thresholds, ascending; every cell drains them one after the other.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Levels(pub(super) Vec<f64>);

/// The levels of a round, found once and then the same for every run that continues it.
pub(super) fn sealed_levels(
    store: &CellStore,
    goal: Goal,
    options: &Options,
    run: &Run,
) -> Result<Levels> {
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
pub(super) fn spread_cells(n_cells: usize, bounds: std::ops::RangeInclusive<usize>) -> Vec<usize> {
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
