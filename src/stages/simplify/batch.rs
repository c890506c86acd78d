//! One batch of a round's cells into a pack for them alone: the work of one of many processes.
//!
//! Cells lie in the pack in their order, so that two attempts at a batch write equal packs.

use super::cell_run::CellRun;
use super::exact::ExactLevels;
use super::ladder::Thresholds;
use super::memory::{cell_bytes, result_bytes};
use std::ops::Range;
use stonecut_kernel::Stop;
use stonecut_store::cell_id::CellId;
use stonecut_store::cells::{CellTally, SurvivorInfo, SurvivorWriter, Survivors};
use stonecut_system::error::Result;
use stonecut_system::parallel::in_order;

/// The end of every cell of a round.
#[derive(Clone, Debug)]
pub enum Levels {
    /// At one threshold.
    Threshold(Thresholds),
    /// At close levels that meet a total.
    Exact(ExactLevels),
}

impl Levels {
    /// The end of a cell with this many triangles; `None` if it stays as it is.
    fn stop(&self, cell: CellId, n_triangles: u64) -> Option<Stop> {
        match self {
            Levels::Threshold(levels) => levels.last().map(|_| levels.stop(cell, n_triangles)),
            Levels::Exact(levels) => levels.stop(cell, n_triangles),
        }
    }
}

/// Simplifies some cells of `store` as far as `levels` say. The result is that of `simplify_cells`, or of
/// `simplify_cells_exactly`, for these cells.
pub fn simplify_batch(
    round: &CellRun,
    levels: &Levels,
    cells: Range<usize>,
) -> Result<SurvivorInfo> {
    let mut options = round.fitted();
    options.keeps_relief &= matches!(levels, Levels::Threshold(_));
    let round = CellRun { options: &options, ..*round };
    let CellRun { store, goal, context: run, .. } = round;
    let name = run.job.name(&format!("round-{}.survivors", goal.round));
    let mut writer = SurvivorWriter::open(run.disk(), run.job.folder(), &name, store.layout())?;
    let threads = threads(&round, cells.clone());
    in_order(
        cells.len() as u64,
        threads,
        run.progress,
        |index, left: &mut Survivors| {
            let place = cells.start + index as usize;
            // On its way from the disk while this one is at work.
            if cells.contains(&(place + threads)) {
                store.expect(CellId::at(place + threads));
            }
            let number = CellId::at(place);
            let cell = store.load_tidy(number)?;
            *left = match levels.stop(number, cell.mesh.triangles.len() as u64) {
                None => Survivors::all_of(cell, store.layout()),
                Some(stop) => round.drain(cell, stop),
            };
            Ok(())
        },
        |index, left| {
            let number = CellId::at(cells.start + index as usize);
            writer.append(number, left)?;
            *left = Survivors::default();
            run.progress.add(store.info().cells[number].triangles);
            Ok(())
        },
    )?;
    writer.finish(run.disk(), run.job.folder(), cells)
}

/// Threads whose cells fit into memory, each with a result that waits for its turn.
fn threads(round: &CellRun, cells: Range<usize>) -> usize {
    let CellRun { store, context: run, .. } = round;
    let share = round.share();
    let bytes = |cell: CellId| {
        let CellTally { vertices, triangles } = store.info().cells[cell];
        let left = |n: u64| (n as f64 * (2.0 * share).min(1.0)) as u64;
        let left = CellTally { vertices: left(vertices), triangles: left(triangles) };
        cell_bytes(store, cell, share) + result_bytes(left, store.layout())
    };
    let largest = cells.map(CellId::at).map(bytes).max().unwrap_or(0).max(1);
    (run.memory_bytes / largest).clamp(1, run.threads.max(1) as u64) as usize
}

/// The cells of each of `n_batches` batches: consecutive, with about the same number of triangles.
pub fn batches(cells: &[CellTally], n_batches: usize) -> Vec<Range<usize>> {
    let total: u64 = cells.iter().map(|cell| cell.triangles).sum();
    let mut ends = vec![0; n_batches];
    let mut before = 0;
    for (number, cell) in cells.iter().enumerate() {
        // A cell goes where its middle lies.
        let middle = u128::from(2 * before + cell.triangles) * n_batches as u128;
        let batch = (middle / u128::from(2 * total.max(1))) as usize;
        ends[batch.min(n_batches - 1)] = number + 1;
        before += cell.triangles;
    }
    let mut first = 0;
    let range = |end: usize| {
        let cells = first..end.max(first);
        first = cells.end;
        cells
    };
    ends.into_iter().map(range).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_cell_is_in_one_batch_and_batches_are_even() {
        let cells: Vec<CellTally> =
            (0..101).map(|i| CellTally { vertices: 0, triangles: 1000 + i * 7 % 400 }).collect();
        for n_batches in [1, 3, 16, 64, 300] {
            let batches = batches(&cells, n_batches);
            assert_eq!(batches.len(), n_batches);
            let all: Vec<usize> = batches.iter().cloned().flatten().collect();
            assert_eq!(all, (0..101).collect::<Vec<_>>());
            let longest = batches.iter().map(ExactSizeIterator::len).max().unwrap();
            assert!(longest <= 101 / n_batches + 2, "{n_batches}: {longest}");
        }
        assert_eq!(batches(&[], 3), [0..0, 0..0, 0..0]);
    }
}
