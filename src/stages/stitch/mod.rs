//! Stage 3: merges the simplified cells and removes every trace of their borders.
//!
//! While the survivors are too many for one finish they are cut into new cells whose seams run elsewhere
//! (`repartition`), so that former seams are interior and simplified like any other place; then one in-core
//! `finish` meets the target exactly. `next_step` decides which, from counts alone.
//!
//! Source: cells with locked borders after Cignoni et al. 2003, cut elsewhere in each round after Cignoni et al. 2005
//! (docs/references.md; docs/algorithm.md, section 11).

mod finish;
mod repartition;

pub use finish::{PROGRESSIVE, Parts, Recording, finish};
pub use repartition::{NewCells, is_tree_record, recut, regroup};
use stonecut_kernel as kernel;

/// The finish takes at most this many cells' worth of triangles.
pub const FINISH_CELLS: u64 = 4;

/// Larger cells would give the finish more than the kernel can hold: three vertices a triangle at worst.
pub const MAX_CELL_TRIANGLES: u64 = kernel::MAX_TRIANGLES / (2 * FINISH_CELLS);
const _: () = assert!(3 * FINISH_CELLS * MAX_CELL_TRIANGLES <= kernel::MAX_VERTICES);

/// Cells stop at this multiple of the final count in the round after which their seams first vanish; nearer,
/// seams show (KERNEL experiments: 4x no trace, 1.2x 1.08-1.29 times the error at the seams).
///
/// The second number says how much above its goal a round may end before it is repeated: the pilot misses by some
/// percent, and only the last multiple has to be near, since the exact round begins from it.
const COARSE: (f64, f64) = (4.0, 1.3);
/// Further multiples for results too large for one finish, each with seams elsewhere.
const MEDIUM: (f64, f64) = (2.0, 1.3);
const FINE: (f64, f64) = (1.08, 1.1);

/// A round leaves at least this many triangles for each vertex that cells share, so that what is locked stays well
/// below half of a cell. Where less was left, the costs that the goal asked for flattened the inside of the
/// cells: 11 times the error on the dragon to 1 % through cells of 12k (1.7 triangles a shared vertex), 4.9
/// times on the chest CT through cells of 40k (1.9).
const LEFT_PER_SHARED: f64 = 4.0;

/// The same before the cells are cut: times the square root of a cell's triangles in a cell (of
/// 256k: 4,000). A sheet has about two shared vertices for that root.
const LEFT_PER_ROOT: f64 = 8.0;

/// No run needs more rounds than this; a mesh that does has stopped giving way.
const MOST_ROUNDS: u32 = 12;

/// Next step after a round.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NextStep {
    /// All cells join in memory and are simplified to the exact target.
    Finish,
    /// New cells, simplified until about this many triangles are left.
    Round(u64),
    /// New cells, simplified until at most the target is left, within a fraction of a percent.
    ExactRound,
    /// The last round has met the target.
    Done,
}

/// Decides the next step from the count of triangles now, the target, the cell size, and what was done.
pub fn next_step(now: u64, target: u64, cell_triangles: u64, rounds_done: u32) -> NextStep {
    let limit = cell_triangles.saturating_mul(FINISH_CELLS);
    if now <= limit && (now > target || rounds_done == 0) {
        return NextStep::Finish;
    }
    if now <= target {
        return if rounds_done == 0 { NextStep::Round(target) } else { NextStep::Done };
    }
    if rounds_done >= MOST_ROUNDS {
        return NextStep::Done;
    }
    let floor = (now as f64 * (LEFT_PER_ROOT / (cell_triangles as f64).sqrt()).min(0.5)) as u64;
    for (multiple, near) in [COARSE, MEDIUM, FINE] {
        let goal = ((target as f64 * multiple) as u64).max(floor);
        if now as f64 > goal as f64 * near {
            return NextStep::Round(goal);
        }
    }
    NextStep::ExactRound
}

/// The next step of a run that goes as far as a bound on the error allows; `before` is the count before the last
/// round.
pub fn next_step_within_bound(
    now: u64,
    before: u64,
    cell_triangles: u64,
    rounds_done: u32,
) -> NextStep {
    if now <= cell_triangles.saturating_mul(FINISH_CELLS) {
        return NextStep::Finish;
    }
    // The whole bound: once for the cells, once more for what were their seams.
    let is_at_an_end =
        rounds_done > 1 && (rounds_done >= MOST_ROUNDS || now as f64 > 0.97 * before as f64);
    if is_at_an_end {
        NextStep::Done
    } else {
        NextStep::Round((now as f64 * EXPECTED_SHARE) as u64)
    }
}

/// Of the bound, what the first round may use; later ones and the finish: all.
///
/// Errors grow about as the area of a triangle, so that it leaves about four times the triangles of the result, as towards
/// a count. Neither twice and four times as much, nor a second share between, gains anything (docs/design/bound.md).
const FIRST_SHARE: f64 = 0.12;

/// A round before the last ones ends where the bound refuses more collapses, at one level, than this share of the
/// triangles.
pub const PATIENCE: f64 = 0.03;

/// Share that a round is expected to leave, for its memory: nothing is known of the scan.
const EXPECTED_SHARE: f64 = 0.5;

/// Share of the bound that a round may use.
pub fn bound_share(round: u32) -> f64 {
    if round == 0 { FIRST_SHARE } else { 1.0 }
}

/// True if the next level of a chain begins from a result of this many triangles, or else from what the finish took in:
/// errors of both steps add up, and nearer than `COARSE` that shows.
pub fn begins_from_result(result: u64, next_target: u64) -> bool {
    result as f64 >= COARSE.0 * next_target as f64
}

/// Returns the attainable goal of a round towards `goal`, once the number of shared vertices is known. It halves
/// the mesh at least, unless the goal is nearer.
pub fn within_reach(goal: u64, now: u64, shared_vertices: u64) -> u64 {
    goal.max(((LEFT_PER_SHARED * shared_vertices as f64) as u64).min(now / 2))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rounds(mut now: u64, target: u64, cell: u64) -> Vec<NextStep> {
        let mut steps = Vec::new();
        loop {
            let step = next_step(now, target, cell, steps.len() as u32);
            steps.push(step);
            match step {
                NextStep::Round(goal) => now = goal.min(now),
                _ => return steps,
            }
        }
    }

    #[test]
    fn small_results_end_in_a_finish_large_ones_in_an_exact_round() {
        assert_eq!(rounds(900_000, 100_000, 256_000), [NextStep::Finish]);
        assert_eq!(
            rounds(34_000_000, 340_000, 500_000),
            [NextStep::Round(1_360_000), NextStep::Finish]
        );
        let billion = rounds(1_000_000_000, 1_000_000, 256_000);
        assert_eq!(billion[0], NextStep::Round(15_811_388));
        assert_eq!(billion.last(), Some(&NextStep::ExactRound));
        let large = rounds(1_000_000_000, 10_000_000, 256_000);
        assert_eq!(
            large,
            [
                NextStep::Round(40_000_000),
                NextStep::Round(20_000_000),
                NextStep::Round(10_800_000),
                NextStep::ExactRound
            ]
        );
        assert_eq!(
            rounds(5_000_000, 6_000_000, 100_000),
            [NextStep::Round(6_000_000), NextStep::Done]
        );
        assert_eq!(rounds(500, 6_000, 100_000), [NextStep::Finish]);
        // Cells too small to go to four times the target at once.
        let small = [NextStep::Round(63_608), NextStep::Round(34_856), NextStep::Finish];
        assert_eq!(rounds(871_000, 8_714, 12_000), small);
    }

    #[test]
    fn ragged_cells_are_not_pressed_below_their_seams() {
        assert_eq!(within_reach(100_000, 2_600_000, 20_000), 100_000);
        assert_eq!(within_reach(100_000, 2_600_000, 60_000), 240_000);
        // However ragged, the mesh is halved; a goal that is nearer stays.
        assert_eq!(within_reach(100_000, 400_000, 300_000), 200_000);
        assert_eq!(within_reach(108_000, 130_000, 300_000), 108_000);
    }
}
