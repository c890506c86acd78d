//! Stage 2: simplifies all cells of a store, each by itself, to one common cost threshold.
//!
//! A threshold, not a quota per cell: flat cells must end emptier than detailed ones. It comes from a pilot
//! over a sample of cells (`pilot`, down a `ladder`). Vertices shared between cells are locked; nothing else ties the cells together.
//! For results too large for one finish, `exact` meets a total. `cell_run` is the parallel part of both.
//!
//! docs/algorithm.md, section 11.

mod batch;
mod cell_run;
mod earlier;
mod exact;
mod ladder;
mod memory;
mod pilot;

pub use batch::{Levels, batches, simplify_batch};
pub use cell_run::{Beside, CellRun, FREED_AT_A_TIME, Goal, frees_sources};
pub use exact::{ExactLevels, simplify_cells_exactly, trial};
pub use ladder::{Thresholds, descend, ladder, pilot_cells, pilot_sample};
pub use memory::{fit_bytes, later_bytes, result_bytes, round_fit_bytes, work_bytes};
pub use pilot::{PilotPart, pilot_part, thresholds_of};

use earlier::Earlier;
use ladder::spread_cells;
use pilot::sealed_thresholds;
use stonecut_kernel::{Stop, simplify_mesh};
use stonecut_mesh::attribute_weights;
use stonecut_store::cell_id::CellId;
use stonecut_store::cells::{CellStore, SurvivorInfo, Survivors};
use stonecut_store::stage_context::StageContext;
use stonecut_system::error::Result;

/// Weights of channels are found from every 32nd cell, at least 16 and at most 48: cells differ more in
/// the size of their triangles than in how they fall.
const LENGTH_CELLS: std::ops::RangeInclusive<usize> = 16..=48;

/// Simplifies every cell of a round towards its goal and seals what is left of them.
pub fn simplify_cells(round: &CellRun) -> Result<SurvivorInfo> {
    let round = CellRun { options: &round.fitted(), ..*round };
    let (thresholds, begun) = sealed_thresholds(&round, true)?;
    round.write(|id| {
        let mut cell = round.store.load_tidy(id)?;
        let before = round.beside.map(|beside| (beside, cell.clone()));
        let mut left = match thresholds.last() {
            None => Survivors::all_of(cell, round.store.layout()),
            Some(last) => {
                let n_triangles = cell.mesh.triangles.len() as u64;
                let mesh = std::mem::take(&mut cell.mesh);
                let simplified = match begun.take(id, &thresholds) {
                    // On from where the pilot has left it.
                    Some(mut stepwise) => {
                        drop(mesh);
                        stepwise.level(last);
                        stepwise.finish()
                    }
                    None => {
                        let stop = thresholds.stop(id, n_triangles);
                        simplify_mesh(mesh, &cell.shared, &round.until(stop))
                    }
                };
                round.survivors(&cell, simplified)
            }
        };
        if let Some((beside, before)) = before {
            (beside.look)(id, before, &mut left)?;
        }
        Ok(left)
    })
}

/// Simplifies every cell by itself as far as the bound of the options allows, and seals what is left of them.
/// `goal.triangles`: the count to expect, for the memory. Cells that come out as in the attempt before are taken over from it,
/// but for those of the first round, which all attempts have in common.
pub fn simplify_cells_within_bound(round: &CellRun) -> Result<SurvivorInfo> {
    let CellRun { store, goal, options, context, .. } = round;
    let is_last = options.bound.is_none_or(|bound| bound.patience >= 1.0);
    let stop = match is_last {
        true => Stop::Triangles(0),
        // Sealed: a run that continues this round may find the cell that it comes from done and its bytes given back.
        false => Stop::Costs(
            context
                .job
                .sealed(&format!("round {} ladder", goal.round), || pilot::whole_ladder(store))?,
        ),
    };
    if !is_last {
        return round.write(|id| Ok(round.drain(store.load_tidy(id)?, stop.clone())));
    }
    let earlier = Earlier::open(round);
    round.write(|id| {
        let cell = store.load_tidy(id)?;
        let key = earlier::key(&cell, store.layout(), options);
        if let Some(left) = earlier.take(id, &key) {
            return Ok(left);
        }
        let mut left = round.drain(cell, stop.clone());
        left.statistics.key = key;
        Ok(left)
    })
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
