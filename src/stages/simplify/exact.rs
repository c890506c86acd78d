//! Simplifies cells to an exact total.
//!
//! All cells go down the same close levels, one level at a time, until their total is met. A cell stands where it is until
//! then, if the memory holds it; else its counts after all levels are noted, and it is simplified once more when its
//! level is known. The result is the same.

use super::cell_run::{CellRun, Goal};
use super::ladder::{Thresholds, kept};
use super::pilot::{bytes_for_copies, sealed_thresholds, takes};
use libm::exp2;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::atomic::AtomicU64;
use std::sync::{Mutex, PoisonError};
use stonecut_kernel::{CloseLevels, Options, Stop, simplify_mesh};
use stonecut_store::cell_id::CellId;
use stonecut_store::cells::{CellMesh, CellStore, SurvivorInfo, Survivors};
use stonecut_system::error::Result;

/// Simplifies every cell to an exact total, at most `goal.triangles`: for results too large for one finish.
///
/// The first cells, in order, stop one level later than the others, so that the total meets the target to within one such
/// step of one cell.
pub fn simplify_cells_exactly(round: &CellRun) -> Result<SurvivorInfo> {
    let (thresholds, _) = sealed_thresholds(round, false)?;
    let round = CellRun { options: &Options { keeps_relief: false, ..round.fitted() }, ..*round };
    let standing = StandingCells::default();
    let name = format!("round {} exact levels", round.goal.round);
    let levels: ExactLevels =
        round.context.job.sealed(&name, || descend(&round, &thresholds, &standing))?;
    round.write(|id| {
        if let Some((cell, way)) = standing.take(id, levels.depth(id)) {
            return Ok(round.survivors(&cell, way.finish()));
        }
        let cell = round.store.load_tidy(id)?;
        Ok(match levels.stop(id, cell.mesh.triangles.len() as u64) {
            Some(stop) => round.drain(cell, stop),
            None => Survivors::all_of(cell, round.store.layout()),
        })
    })
}

/// Cells that stand on their way down close levels; their meshes are on the way.
#[derive(Default)]
struct StandingCells(Mutex<BTreeMap<CellId, (CellMesh, CloseLevels)>>);

impl StandingCells {
    fn put(&self, cell: CellId, standing: (CellMesh, CloseLevels)) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).insert(cell, standing);
    }

    fn remove(&self, cell: CellId) -> Option<(CellMesh, CloseLevels)> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).remove(&cell)
    }

    /// A cell, if it stands after just as many levels.
    fn take(&self, cell: CellId, n_levels: usize) -> Option<(CellMesh, CloseLevels)> {
        self.remove(cell).filter(|(_, way)| way.counts().len() == n_levels)
    }

    fn cells(&self) -> Vec<CellId> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).keys().copied().collect()
    }
}

/// Finds the levels that meet the goal. Cells that the memory holds are left `standing`.
fn descend(
    round: &CellRun,
    thresholds: &Thresholds,
    standing: &StandingCells,
) -> Result<ExactLevels> {
    let CellRun { store, goal, options, context: run, .. } = *round;
    let levels = close_levels(thresholds);
    if levels.is_empty() {
        return Ok(ExactLevels::choose(thresholds, &[], store, goal));
    }
    let free_bytes = AtomicU64::new(bytes_for_copies(store, run));
    let options = &Options { estimate: true, ..options.clone() };
    let mut counts = round.outcomes(0..store.n_cells(), |id, mut cell| {
        let mesh = std::mem::take(&mut cell.mesh);
        let mut way = CloseLevels::new(mesh, &cell.shared, options, levels.clone());
        way.take(FIRST_LOOK);
        let stands = takes(&free_bytes, way.bytes() + cell.bytes());
        if !stands {
            way.take(SECOND_LOOK);
        }
        let counts = way.counts().to_vec();
        if stands {
            standing.put(id, (cell, way));
        }
        run.progress.add(store.info().cells[id].triangles);
        counts
    })?;
    let all_standing = standing.cells();
    for depth in FIRST_LOOK.. {
        if depth >= levels.len() || meets(&counts, store, (depth, goal.triangles)) {
            break;
        }
        let is_short = |id: &CellId| counts[id.index()].len() <= depth;
        let short: Vec<CellId> = CellId::first(store.n_cells()).filter(is_short).collect();
        let lack = short.iter().filter(|id| all_standing.binary_search(id).is_err());
        let lack: Vec<CellId> = lack.copied().collect();
        // Their meshes are of no use, so nothing is fitted.
        let counting = Options { expected_share: 0.0, ..options.clone() };
        note(&mut counts, round, &lack, |id| {
            Ok(counts_of(store.load_tidy(id)?, &levels, &counting))
        })?;
        // In order, and no farther than the goal asks for.
        for few in all_standing.chunks(run.threads.max(1)) {
            if meets(&counts, store, (depth + 1, goal.triangles)) {
                break;
            }
            note(&mut counts, round, few, |id| {
                let Some((cell, mut way)) = standing.remove(id) else { return Ok(Vec::new()) };
                way.take(depth + 1);
                let counts = way.counts().to_vec();
                standing.put(id, (cell, way));
                Ok(counts)
            })?;
        }
    }
    // From here on cells are counted again, as they are written.
    run.progress.count_from_zero(store.info().triangles);
    Ok(ExactLevels::choose(thresholds, &counts, store, goal))
}

/// Runs `work` on some cells and notes the counts that it finds for each.
fn note(
    counts: &mut [Vec<u64>],
    round: &CellRun,
    cells: &[CellId],
    work: impl Fn(CellId) -> Result<Vec<u64>> + Sync,
) -> Result<()> {
    let found = Mutex::new(Vec::new());
    round.for_each(cells.iter().copied(), |id| {
        let counts = work(id)?;
        found.lock().unwrap_or_else(PoisonError::into_inner).push((id, counts));
        Ok(())
    })?;
    for (id, found) in found.into_inner().unwrap_or_else(PoisonError::into_inner) {
        counts[id.index()] = found;
    }
    Ok(())
}

/// The counts of some cells after each of many close levels, in the order of the cells; nothing where nothing is to be done.
pub fn trial(
    round: &CellRun,
    thresholds: &Thresholds,
    cells: Range<usize>,
) -> Result<Vec<Vec<u64>>> {
    let levels = close_levels(thresholds);
    if levels.is_empty() {
        return Ok(Vec::new());
    }
    round.outcomes(cells, |_, cell| counts_of(cell, &levels, round.options))
}

/// Triangles of a cell after each of the levels.
fn counts_of(cell: CellMesh, levels: &[f64], options: &Options) -> Vec<u64> {
    let options = Options { stop: Stop::CloseCosts(levels.to_vec()), ..options.clone() };
    simplify_mesh(cell.mesh, &cell.shared, &options).statistics.level_counts
}

fn close_levels(thresholds: &Thresholds) -> Vec<f64> {
    let level = |last: f64, j| last * exp2(f64::from(j) / FINE_STEPS);
    let levels = |last| (-FINE_LEVELS..=FINE_LEVELS).map(|j| level(last, j)).collect();
    let last = thresholds.last().filter(|_| thresholds.kept_share().is_none());
    last.map_or_else(Vec::new, levels)
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
    /// Without levels: the share of its triangles that every cell keeps.
    #[serde(default)]
    kept_share: Option<f64>,
}

impl ExactLevels {
    /// The levels that meet the goal, from the counts of all cells in a trial.
    pub fn choose(
        thresholds: &Thresholds,
        counts: &[Vec<u64>],
        store: &CellStore,
        goal: Goal,
    ) -> ExactLevels {
        let kept_share = thresholds.kept_share();
        if kept_share.is_some() || thresholds.last().is_none() {
            return ExactLevels { kept_share, ..ExactLevels::default() };
        }
        let (n_levels, n_ahead) = choose_levels(counts, store, goal.triangles);
        ExactLevels { levels: close_levels(thresholds), n_levels, n_ahead, kept_share }
    }

    /// Number of levels that a cell drains.
    fn depth(&self, cell: CellId) -> usize {
        (self.n_levels + usize::from(cell.index() < self.n_ahead)).min(self.levels.len())
    }

    /// The end of a cell with this many triangles; `None` if it stays as it is.
    pub fn stop(&self, cell: CellId, n_triangles: u64) -> Option<Stop> {
        if let Some(share) = self.kept_share {
            return Some(Stop::Free { cost: f64::MAX, triangles: kept(share, n_triangles) });
        }
        let levels = &self.levels[..self.depth(cell)];
        (!levels.is_empty()).then(|| Stop::CloseCosts(levels.to_vec()))
    }
}

/// Levels of the exact round: an octave and a half to either side, 16 to an octave.
const FINE_LEVELS: i32 = 24;
const FINE_STEPS: f64 = 16.0;

/// Levels after which all cells are looked at first: a quarter of an octave before the pilot's threshold, at which they stand.
const FIRST_LOOK: usize = FINE_LEVELS as usize - 3;

/// Levels that a cell takes at once if the memory does not hold it: six more than the pilot's threshold. Each costs it as
/// many collapses as the round itself needs.
const SECOND_LOOK: usize = FINE_LEVELS as usize + 7;

/// Triangles of a cell after `depth` levels.
fn after(counts: &[Vec<u64>], store: &CellStore, cell: usize, depth: usize) -> u64 {
    match depth {
        0 => store.info().cells[cell].triangles,
        _ => counts[cell].get(depth - 1).or(counts[cell].last()).copied().unwrap_or(0),
    }
}

/// True if the first cells, or all, with `depth` levels behind them and the others with one less come to at most `target`
/// triangles, as far as counts are known.
fn meets(counts: &[Vec<u64>], store: &CellStore, (depth, target): (usize, u64)) -> bool {
    let mut sum: u64 = (0..counts.len()).map(|cell| after(counts, store, cell, depth - 1)).sum();
    for (cell, known) in counts.iter().enumerate() {
        if sum <= target || known.len() < depth {
            break;
        }
        sum = sum - after(counts, store, cell, depth - 1) + known[depth - 1];
    }
    sum <= target
}

/// Chooses the number of levels of every cell, and of first cells that take one more, so that the total is
/// the largest that does not exceed `target`.
fn choose_levels(counts: &[Vec<u64>], store: &CellStore, target: u64) -> (usize, usize) {
    let after = |cell: usize, depth: usize| after(counts, store, cell, depth);
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
