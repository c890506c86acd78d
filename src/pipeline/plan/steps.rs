//! The rounds and finishes that a run will take, from counts alone.

use crate::error::{Error, Result};
use crate::stages::stitch::{self, NextStep};

/// Finish of a level: triangles before and after it.
pub(super) struct FinishPlan {
    pub(super) before: u64,
    pub(super) after: u64,
}

/// Goals of the rounds of a run that only a bound on the error ends, and its finish. A bound tells nothing of counts: a
/// round that leaves half, and as many as a finish may take.
pub(super) fn rounds_within_bound(
    triangles_in: u64,
    cell_triangles: u64,
) -> (Vec<u64>, Vec<Option<FinishPlan>>) {
    let most = cell_triangles.saturating_mul(stitch::FINISH_CELLS);
    let (goals, before) = match triangles_in <= most {
        true => (Vec::new(), triangles_in),
        false => (vec![triangles_in / 2], most),
    };
    (goals, vec![Some(FinishPlan { before, after: triangles_in / 10 })])
}

/// Goals of the rounds of all levels of a chain, and the finish of each, if it has one.
pub(super) fn rounds_of_chain(
    triangles_in: u64,
    targets: &[u64],
    cell_triangles: u64,
) -> (Vec<u64>, Vec<Option<FinishPlan>>) {
    let (mut goals, mut finishes, mut now) = (Vec::new(), Vec::new(), triangles_in);
    for &target in targets {
        let (of_level, finish) = rounds(now, target, cell_triangles);
        goals.extend(of_level);
        now = match (&finish, targets.get(finishes.len() + 1)) {
            (Some(finish), Some(&next)) if !stitch::begins_from_result(target, next) => {
                finish.before
            }
            _ => now.min(target),
        };
        finishes.push(finish);
    }
    (goals, finishes)
}

/// Goals of the rounds from `now` triangles to a target, and the finish, if there is one.
fn rounds(mut now: u64, target: u64, cell_triangles: u64) -> (Vec<u64>, Option<FinishPlan>) {
    let mut goals = Vec::new();
    loop {
        match stitch::next_step(now, target, cell_triangles, goals.len() as u32) {
            NextStep::Finish => return (goals, Some(FinishPlan { before: now, after: target })),
            NextStep::Round(goal) => {
                goals.push(goal.min(now));
                now = goal.min(now);
            }
            NextStep::ExactRound => {
                goals.push(target);
                return (goals, None);
            }
            NextStep::Done => return (goals, None),
        }
    }
}

/// Refuses levels that do not fall.
pub(super) fn check_chain(targets: &[u64]) -> Result<()> {
    match targets.windows(2).find(|pair| pair[0] <= pair[1]) {
        None => Ok(()),
        Some(pair) => Err(Error::Usage(format!(
            "of this input, two levels of the chain have {} and {} triangles; each must have fewer than the one before",
            pair[0], pair[1]
        ))),
    }
}
