//! The pilot: finds the cost threshold of a round from how a sample of its cells falls.
//!
//! Its cells go down a ladder of thresholds, with a copy of each kept on the way. Once the threshold of the round is
//! known they go on from there, so that the pilot costs little more than its look ahead. What was not kept, for
//! want of memory or after an interruption, is computed again along the same ladder: the same bytes.

use super::cell_run::{CellRun, Goal};
use super::ladder::{Thresholds, descend, ladder, pilot_sample};
use super::memory::cell_bytes;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};
use stonecut_kernel::{Options, Stepwise};
use stonecut_store::cell_id::CellId;
use stonecut_store::cells::CellStore;
use stonecut_store::stage_context::StageContext;
use stonecut_system::error::{Error, Result};

/// Copies are kept of cells that are at most this many times what they should come to: the threshold will be
/// below that.
const KEPT_MULTIPLE: f64 = 6.0;

/// No copies are kept of cells that have more than this share of what they began with: that is done again as fast.
const KEPT_SHARE: f64 = 0.7;

/// Cells of the pilot as far as they have come, by cell and number of levels.
#[derive(Default)]
pub(super) struct BegunCells(Mutex<BTreeMap<(CellId, usize), Stepwise>>);

impl BegunCells {
    /// The cell on its way, all of its thresholds but the last behind it.
    pub(super) fn take(&self, cell: CellId, thresholds: &Thresholds) -> Option<Stepwise> {
        let n = thresholds.n_taken(cell)?;
        self.0.lock().unwrap_or_else(PoisonError::into_inner).remove(&(cell, n))
    }
}

/// The thresholds of a round, found once and then the same for every run that continues it; and what the pilot has
/// begun, if it ran now and `keeps` it.
pub(super) fn sealed_thresholds(round: &CellRun, keeps: bool) -> Result<(Thresholds, BegunCells)> {
    let begun = BegunCells::default();
    // What is done beside is not done by the pilot.
    let alone = CellRun { beside: None, ..*round };
    let name = format!("round {} levels", round.goal.round);
    let thresholds = round.context.job.sealed(&name, || pilot(&alone, keeps.then_some(&begun)))?;
    let mut copies = begun.0.lock().unwrap_or_else(PoisonError::into_inner);
    copies.retain(|&(cell, n), _| thresholds.n_taken(cell) == Some(n));
    drop(copies);
    Ok((thresholds, begun))
}

/// Thresholds from next to nothing to any cost, for cells that a bound stops on the way.
pub(super) fn whole_ladder(store: &CellStore) -> Result<Vec<f64>> {
    let triangles = |cell: CellId| store.info().cells[cell].triangles;
    match CellId::first(store.n_cells()).max_by_key(|&cell| (triangles(cell), cell)) {
        Some(cell) => Ok(ladder(&store.load_tidy(cell)?.mesh)),
        None => Ok(Vec::new()),
    }
}

/// The counts of some cells of a pilot on their way down: of all, or of the share of one of many processes.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct PilotPart {
    /// The rungs, the same for all cells.
    ladder: Vec<f64>,
    /// Triangles after every rung that a cell took.
    curves: BTreeMap<CellId, Vec<u64>>,
}

/// Finds the thresholds that bring the whole store to `goal`.
fn pilot(round: &CellRun, begun: Option<&BegunCells>) -> Result<Thresholds> {
    let sample = sample(round.store, round.goal);
    let part = send_down(round, (&sample, &sample), begun)?;
    thresholds_of(round.store, round.goal, [part])
}

/// Sends the share of one process down the ladder: every `of`-th cell of the sample from the one of number `index` on.
pub fn pilot_part(round: &CellRun, (index, of): (usize, usize)) -> Result<PilotPart> {
    let sample = sample(round.store, round.goal);
    let share: Vec<CellId> = sample.iter().copied().skip(index).step_by(of).collect();
    send_down(round, (&sample, &share), None)
}

/// The thresholds of a round from all parts of its pilot. The same on every machine.
pub fn thresholds_of(
    store: &CellStore,
    goal: Goal,
    parts: impl IntoIterator<Item = PilotPart>,
) -> Result<Thresholds> {
    let sample = sample(store, goal);
    if sample.is_empty() {
        return Ok(Thresholds::default());
    }
    let mut whole = PilotPart::default();
    for part in parts.into_iter().filter(|part| !part.curves.is_empty()) {
        whole.ladder = part.ladder;
        whole.curves.extend(part.curves);
    }
    if !whole.curves.keys().eq(&sample) {
        return Err(Error::Internal(format!("round {} lacks a part of its pilot", goal.round)));
    }
    let n_triangles = store.info().triangles;
    let start: u64 = sample.iter().map(|&cell| store.info().cells[cell].triangles).sum();
    let ratio = goal.triangles as f64 / n_triangles as f64;
    Ok(Thresholds::choose(whole.ladder, &whole.curves, start, ratio))
}

/// The cells of a pilot, in order; none if nothing is to be done.
fn sample(store: &CellStore, goal: Goal) -> Vec<CellId> {
    if goal.triangles >= store.info().triangles {
        return Vec::new();
    }
    pilot_sample(store.n_cells(), |cell| store.info().cells[cell].triangles)
}

/// Sends some cells of a sample down its ladder.
fn send_down(
    round: &CellRun,
    (sample, share): (&[CellId], &[CellId]),
    begun: Option<&BegunCells>,
) -> Result<PilotPart> {
    let CellRun { store, goal, options, context: run, .. } = *round;
    if share.is_empty() {
        return Ok(PilotPart::default());
    }
    let ratio = goal.triangles as f64 / store.info().triangles as f64;
    let ladder = ladder(&store.load_tidy(sample[0])?.mesh);
    let curves = Mutex::new(BTreeMap::new());
    let free_bytes = AtomicU64::new(bytes_for_copies(store, run));
    let mut options = Options { estimate: begun.is_some(), ..options.clone() };
    if begun.is_none() {
        // Only counts are asked for.
        options.expected_share = 0.0;
    }
    round.for_each(share.iter().copied(), |index| {
        let mut cell = store.load_tidy(index)?;
        let mesh = std::mem::take(&mut cell.mesh);
        let start = mesh.triangles.len() as u64;
        let mut stepwise = Stepwise::new(mesh, &cell.shared, &options);
        drop(cell);
        let wanted = start as f64 * ratio;
        let most_kept = (KEPT_MULTIPLE * wanted).min(KEPT_SHARE * start as f64);
        let counts = descend(&mut stepwise, &ladder, (start, ratio), |stepwise, n| {
            run.progress.check()?;
            if let Some(begun) = begun
                && stepwise.n_triangles() as f64 <= most_kept
                && takes(&free_bytes, stepwise.copy_bytes())
            {
                let mut copies = begun.0.lock().unwrap_or_else(PoisonError::into_inner);
                copies.insert((index, n), stepwise.clone());
            }
            Ok(())
        })?;
        curves.lock().unwrap_or_else(PoisonError::into_inner).insert(index, counts);
        Ok(())
    })?;
    let curves = curves.into_inner().unwrap_or_else(PoisonError::into_inner);
    Ok(PilotPart { ladder, curves })
}

/// Memory that meshes on their way may take beside the cells at work: half of what the largest cells on all threads leave of the budget.
pub(super) fn bytes_for_copies(store: &CellStore, run: &StageContext) -> u64 {
    let cells = CellId::first(store.n_cells());
    let largest = cells.map(|cell| cell_bytes(store, cell, 1.0)).max().unwrap_or(0);
    run.memory_bytes.saturating_sub(largest.saturating_mul(run.threads as u64)) / 2
}

/// Takes `bytes` out of what is free, if there are as many.
pub(super) fn takes(free_bytes: &AtomicU64, bytes: u64) -> bool {
    free_bytes
        .fetch_update(Ordering::Relaxed, Ordering::Relaxed, |free| free.checked_sub(bytes))
        .is_ok()
}
