//! The ladder of cost thresholds that sampled cells go down, and the thresholds of a round that follow from it.
//!
//! Mathematics only: counts in, costs out. The pilot of cells on disk (`pilot`) and that of cells in memory
//! (`pipeline/in_memory`) go down the same ladder.
//!
//! docs/algorithm.md, section 11.

use stonecut_kernel::{Stepwise, Stop};
use stonecut_mesh::Mesh;
use stonecut_system::error::Result;
// Those of a C library may differ in the last bit from machine to machine; each unit finds the thresholds by itself.
use libm::{exp2, log2};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use stonecut_mesh::vec3::{length_sq, normal};
use stonecut_store::cell_id::CellId;

/// Samples take every 32nd cell, within bounds.
const SAMPLE_SHARE: usize = 32;
/// The pilot takes at least 4 cells and at most 48.
const PILOT_CELLS: std::ops::RangeInclusive<usize> = 4..=48;

/// The pilot's first threshold, in mean squared triangle areas, and the step to the next. What a round has left does not fall
/// at all below the round's threshold and steeply above it: between rungs a factor of 4 apart a goal was missed
/// by 7 to 18 % there, and the round repeated.
const PILOT_START: f64 = 1e-4;
const PILOT_STEP: f64 = 2.0;
const PILOT_LEVELS: i32 = 80;

/// A rung that leaves less than this share of what was there before is too steep to meet a goal on it. No scan that was tried has one at its goal.
const STEEP_SHARE: f64 = 0.6;

/// A cell on its way down takes one level for each fall of the count by this factor: levels so far apart cost
/// nothing in error (docs/design/kernel.md).
const LEVEL_FACTOR: f64 = 4.0;

/// A cell of which half is gone has come to its end when this many levels one after the other, together a factor
/// of 4096 in cost, leave all but one in 400 triangles each.
const DEAD_LEVELS: usize = 12;
const DEAD_SHARE: u64 = 400;

/// Cost thresholds of a round, ascending; every cell drains them one after the other.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Thresholds {
    /// Those of all cells but the pilot's; the last one is that of the round. Empty: nothing is to be done.
    levels: Vec<f64>,
    /// Those of the pilot's cells.
    ladder: Vec<f64>,
    /// Number of rungs that each cell of the pilot takes before the threshold of the round.
    n_taken: BTreeMap<CellId, usize>,
    /// If nearly all collapses cost the same, or next to nothing, as on smooth and flat surfaces: the share of its triangles that every
    /// cell keeps.
    #[serde(default)]
    kept_share: Option<f64>,
}

impl Thresholds {
    /// The threshold of the round, if anything is to be done.
    pub fn last(&self) -> Option<f64> {
        self.levels.last().copied()
    }

    /// The share of its triangles that every cell keeps, if no threshold meets the goal.
    pub fn kept_share(&self) -> Option<f64> {
        self.kept_share
    }

    /// The end of a cell with this many triangles.
    pub fn stop(&self, cell: CellId, n_triangles: u64) -> Stop {
        match (self.kept_share, self.last()) {
            (Some(share), Some(cost)) => Stop::Free { cost, triangles: kept(share, n_triangles) },
            _ => Stop::Costs(self.of(cell)),
        }
    }

    /// The thresholds of one cell.
    fn of(&self, cell: CellId) -> Vec<f64> {
        match self.n_taken.get(&cell) {
            Some(&n) => self.ladder[..n].iter().copied().chain(self.last()).collect(),
            None => self.levels.clone(),
        }
    }

    /// The rungs that a cell of the pilot takes before the threshold of the round; `None` for the other cells.
    pub fn n_taken(&self, cell: CellId) -> Option<usize> {
        self.n_taken.get(&cell).copied()
    }

    /// The thresholds at which the whole falls to a share `ratio`, from how the sampled cells fell: the count
    /// of each after every rung that it took, and their triangles at the `start`.
    pub fn choose(
        ladder: Vec<f64>,
        curves: &BTreeMap<CellId, Vec<u64>>,
        start: u64,
        ratio: f64,
    ) -> Thresholds {
        let total: Vec<f64> = (0..ladder.len())
            .map(|level| curves.values().map(|curve| count_at(curve, level)).sum::<u64>() as f64)
            .collect();
        if let Some(rung) = steep_rung(&total, start as f64, ratio) {
            let levels = ladder[rung..=rung].to_vec();
            return Thresholds { levels, ladder, kept_share: Some(ratio), ..Thresholds::default() };
        }
        let levels = choose_levels(&ladder, &total, start as f64, ratio);
        let last = levels.last().copied().unwrap_or(0.0);
        let n_below = ladder.iter().filter(|&&level| level < last).count();
        let n_taken =
            curves.iter().map(|(&cell, curve)| (cell, curve.len().min(n_below))).collect();
        Thresholds { levels, ladder, n_taken, kept_share: None }
    }
}

/// Triangles that are left of a cell that keeps a share of them.
pub(super) fn kept(share: f64, n_triangles: u64) -> u64 {
    (share * n_triangles as f64) as u64
}

/// The cells that a pilot samples, by the triangles of each. Nearly empty ones, around a hub whose triangles lie in another,
/// tell nothing.
pub fn pilot_sample(n_cells: usize, triangles: impl Fn(CellId) -> u64) -> Vec<CellId> {
    let enough = CellId::first(n_cells).map(&triangles).sum::<u64>() / n_cells as u64 / 8;
    let telling: Vec<CellId> =
        CellId::first(n_cells).filter(|&cell| triangles(cell) > enough).collect();
    pilot_cells(telling.len()).into_iter().map(|i| telling[i]).collect()
}

/// The cells that a pilot samples, as places in a list of `n_cells`.
pub fn pilot_cells(n_cells: usize) -> Vec<usize> {
    spread_cells(n_cells, PILOT_CELLS)
}

/// The rungs for a mesh like this one: thresholds from far below its mean squared triangle area upwards.
pub fn ladder(mesh: &Mesh) -> Vec<f64> {
    let area = mean_area(mesh);
    (0..PILOT_LEVELS).map(|k| PILOT_START * area * area * PILOT_STEP.powi(k)).collect()
}

/// Takes a cell of `start` triangles down the ladder until well below a share `ratio` of them is left or it stops
/// falling; calls `each` with the cell and the number of rungs taken after every one. Returns the count after every
/// rung.
///
/// Errors: those of `each`.
pub fn descend(
    stepwise: &mut Stepwise,
    ladder: &[f64],
    (start, ratio): (u64, f64),
    mut each: impl FnMut(&Stepwise, usize) -> Result<()>,
) -> Result<Vec<u64>> {
    let wanted = start as f64 * ratio;
    let mut counts: Vec<u64> = Vec::new();
    for &level in ladder {
        counts.push(stepwise.level(level));
        each(stepwise, counts.len())?;
        // Far enough below its share to see what the others may ask of a flat cell.
        if stepwise.n_triangles() as f64 <= wanted / 4.0 || is_dead(&counts, start) {
            break;
        }
    }
    Ok(counts)
}

/// True if a cell that has lost half of its triangles has stopped falling.
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

fn mean_area(mesh: &Mesh) -> f64 {
    let n = mesh.triangles.len();
    let doubled = |t: usize| length_sq(normal(mesh.corners(t))).sqrt();
    let area = 0.5 * (0..n).map(doubled).sum::<f64>() / n.max(1) as f64;
    // All triangles degenerate: any positive scale will do.
    if area > 0.0 && area.is_finite() { area } else { f64::MIN_POSITIVE.sqrt() }
}

/// The rung at which the count falls to a share `ratio`, if it falls too steeply for a threshold there to meet a count.
fn steep_rung(total: &[f64], start: f64, ratio: f64) -> Option<usize> {
    let rung = total.iter().position(|&count| count <= start * ratio)?;
    let is_steep = rung == 0 || total[rung] < STEEP_SHARE * total[rung - 1];
    is_steep.then_some(rung)
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
    let (high, low) = (log2(before.max(1.0)), log2(total[level].max(1.0)));
    let share = if high > low { (high - log2(wanted.max(1.0))) / (high - low) } else { 1.0 };
    ladder[level] * exp2((share.clamp(0.0, 1.0) - 1.0) * log2(PILOT_STEP))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_fall_by_four_and_end_at_the_ratio() {
        // N = 1000 t^-0.5 above t = 1.
        let ladder: Vec<f64> = (0..24).map(|k| PILOT_STEP.powi(k)).collect();
        let total: Vec<f64> = ladder.iter().map(|t| 1000.0 / t.sqrt()).collect();
        let levels = choose_levels(&ladder, &total, 1000.0, 0.01);
        let wanted = [16.0, 256.0, 4096.0, 10_000.0];
        assert_eq!(levels.len(), wanted.len());
        for (level, wanted) in levels.iter().zip(wanted) {
            assert!((level / wanted - 1.0).abs() < 0.02, "{levels:?}");
        }
    }

    #[test]
    fn a_goal_is_met_from_what_a_round_has_left() {
        let ladder: Vec<f64> = (0..24).map(|k| PILOT_STEP.powi(k)).collect();
        for kink in [16.0, 18.0, 23.0, 30.0, 31.0] {
            let left = |t: f64| if t < kink { 1000.0 } else { 1000.0 * (kink / t).sqrt() };
            let total: Vec<f64> = ladder.iter().map(|&t| left(t)).collect();
            for ratio in [0.9, 0.7, 0.5, 0.25] {
                let last = choose_levels(&ladder, &total, 1000.0, ratio).last().copied();
                let missed_by = left(last.unwrap()) / (1000.0 * ratio) - 1.0;
                assert!((-0.01..0.08).contains(&missed_by), "{kink}, {ratio}: {missed_by}");
            }
        }
    }

    #[test]
    fn a_cell_is_dead_only_after_it_has_begun_to_fall() {
        assert!(!is_dead(&[1000; 20], 1000));
        assert!(!is_dead(&[400; DEAD_LEVELS], 1000));
        let falls_by = |n: u64| -> Vec<u64> {
            (0..=DEAD_LEVELS).map(|level| if level < 3 { 400 } else { 400 - n }).collect()
        };
        assert!(is_dead(&falls_by(1), 1000));
        assert!(!is_dead(&falls_by(10), 1000));
    }

    #[test]
    fn cells_of_the_pilot_go_down_the_ladder() {
        let thresholds = Thresholds {
            levels: vec![5.0, 20.0],
            ladder: vec![1.0, 4.0, 16.0, 64.0],
            n_taken: BTreeMap::from([(CellId(3), 3), (CellId(4), 0)]),
            kept_share: None,
        };
        assert_eq!(thresholds.of(CellId(0)), [5.0, 20.0]);
        assert_eq!(thresholds.of(CellId(3)), [1.0, 4.0, 16.0, 20.0]);
        assert_eq!(thresholds.of(CellId(4)), [20.0]);
    }
}
