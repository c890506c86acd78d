//! Stage 2: simplifies all cells of a store, each by itself, to one common cost threshold.
//!
//! A threshold, not a quota per cell: flat cells must end emptier than detailed ones. It comes from a pilot
//! over a sample of cells (`pilot`, down a `ladder`). Vertices shared between cells are locked; nothing else ties the cells together.
//! For results too large for one finish, `exact` meets a total. `run_cells` is the parallel part of both.
//!
//! docs/algorithm.md, section 11.

mod batch;
mod exact;
mod ladder;
mod memory;
mod pilot;
mod run_cells;

pub use batch::{Levels, batches, simplify_batch};
pub use exact::{ExactLevels, simplify_cells_exactly, trial};
pub use ladder::{Thresholds, descend, ladder, pilot_cells};
pub use memory::{fit_bytes, later_bytes, result_bytes, round_fit_bytes, work_bytes};
pub use pilot::{PilotPart, pilot_part, thresholds_of};
pub use run_cells::{Beside, FREED_AT_A_TIME, Goal, frees_sources};

use ladder::spread_cells;
use pilot::{Begun, sealed_thresholds};
use run_cells::{drain, run_cells, run_cells_beside, survivors};
use stonecut_kernel::{Options, Stop};
use stonecut_mesh::{Mesh, attribute_weights};
use stonecut_store::cell_id::CellId;
use stonecut_store::cells::{CellMesh, CellStore, SurvivorInfo, Survivors};
use stonecut_store::stage_context::StageContext;
use stonecut_system::error::Result;

/// Weights of channels are found from every 32nd cell, at least 16 and at most 48: cells differ more in
/// the size of their triangles than in how they fall.
const LENGTH_CELLS: std::ops::RangeInclusive<usize> = 16..=48;

/// Simplifies every cell of `store` towards `goal` and seals what is left of them.
pub fn simplify_cells(
    store: &CellStore,
    goal: Goal,
    options: &Options,
    run: &StageContext,
) -> Result<SurvivorInfo> {
    let options = &fitted(options, store, goal);
    let (thresholds, begun) = sealed_thresholds(store, goal, options, run, true)?;
    let work = |index, cell| to_threshold((store, index, cell), &thresholds, &begun, options);
    run_cells(store, goal, run, work)
}

/// The same, with work beside.
pub fn simplify_cells_beside(
    store: &CellStore,
    goal: Goal,
    options: &Options,
    beside: Beside,
    run: &StageContext,
) -> Result<SurvivorInfo> {
    let options = &fitted(options, store, goal);
    let (thresholds, begun) = sealed_thresholds(store, goal, options, run, true)?;
    let work = |index, cell| to_threshold((store, index, cell), &thresholds, &begun, options);
    run_cells_beside(store, goal, beside, run, work)
}

/// The options of a round: its cells are fitted where the job ends with a fit, and tell the next round of the original.
fn fitted(options: &Options, store: &CellStore, goal: Goal) -> Options {
    let is_fitted = goal.round > 0 || options.fits_first_round;
    let share = goal.triangles as f64 / store.info().triangles.max(1) as f64;
    let keeps_relief = is_fitted && store.layout().has_relief;
    Options { expected_share: if is_fitted { share } else { 0.0 }, keeps_relief, ..options.clone() }
}

/// Simplifies a cell to the threshold of its round, from where the pilot has left it.
fn to_threshold(
    (store, index, mut cell): (&CellStore, CellId, CellMesh),
    thresholds: &Thresholds,
    begun: &Begun,
    options: &Options,
) -> Survivors {
    let Some(last) = thresholds.last() else {
        return Survivors::all_of(cell, store.layout());
    };
    if let Some(mut stepwise) = begun.take(index, thresholds) {
        cell.mesh = Mesh::default();
        stepwise.level(last);
        return survivors(&cell, stepwise.finish(), store);
    }
    drain(cell, Stop::Costs(thresholds.of(index)), options, store)
}

/// Simplifies every cell of `store` by itself as far as `options.bound` allows, and seals what is left of them.
/// `goal.triangles`: the count to expect, for the memory.
pub fn simplify_cells_within_bound(
    store: &CellStore,
    goal: Goal,
    options: &Options,
    run: &StageContext,
) -> Result<SurvivorInfo> {
    let is_last = options.bound.is_none_or(|bound| bound.patience >= 1.0);
    let stop = match is_last {
        true => Stop::Triangles(0),
        // Sealed: a run that continues this round may find the cell that it comes from done and its bytes given back.
        false => Stop::Costs(
            run.job
                .sealed(&format!("round {} ladder", goal.round), || pilot::whole_ladder(store))?,
        ),
    };
    run_cells(store, goal, run, |_, cell| drain(cell, stop.clone(), options, store))
}

/// For each channel the length that a difference of 1 is worth, from a sample of cells; empty if no channel
/// counts.
pub fn channel_lengths(store: &CellStore, target: u64, run: &StageContext) -> Result<Vec<f32>> {
    let layout = store.layout();
    if layout.n_weighted() == 0 {
        return Ok(Vec::new());
    }
    let channel_kinds = layout.codec.channel_kinds(&layout.schema);
    let mut sample = attribute_weights::ChannelSample::default();
    for place in spread_cells(store.n_cells(), LENGTH_CELLS) {
        run.progress.check()?;
        sample.add(&store.load(CellId::at(place))?.mesh, &channel_kinds);
    }
    Ok(sample.lengths(&layout.weights, &channel_kinds, store.info().triangles, target))
}
