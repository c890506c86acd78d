//! Proves pieces that no single cell of the target proves, with what is nearest in all cells.
//!
//! Works in rounds, since every look at the target loads cells: what is nearest to the middles of all open pieces
//! is found at once, then every piece is cut as far as these triangles and those found before it go.

use super::bound::upper;
use super::cover::{Found, MOST_STEPS, ProofGoal};
use super::piece::{Cut, Limits, Piece};
use crate::nearest_in_cells::settle;
use crate::parts::{Means, Parts, Survey};
use crate::sample::order_along_curve;
use crate::triangle::Vector;
use stonecut_system::error::Result;

/// Pieces taken on in one round.
const ROUND: usize = 100_000;

/// Target triangles that a piece keeps from those it was cut from.
const KEPT: usize = 4;

/// A piece and target triangles near it.
#[derive(Clone, Copy)]
struct Open {
    piece: Piece,
    near: [Option<[Vector; 3]>; KEPT],
}

/// Proves `pieces` near `target`, or finds how far they are.
pub(super) fn prove(
    pieces: Vec<Piece>,
    (target, survey): (&Parts, &Survey),
    goal: &ProofGoal,
    per_cut: f64,
    means: Means,
) -> Result<Found> {
    let mut found = Found { upper: goal.bound, is_apart: !pieces.is_empty(), ..Found::default() };
    let mut open: Vec<Open> =
        pieces.into_iter().map(|piece| Open { piece, near: [None; KEPT] }).collect();
    while !open.is_empty() {
        let first = open.len().saturating_sub(ROUND);
        let round = open.split_off(first);
        let nearest = nearest(&round, (target, survey), means)?;
        for (one, near) in round.iter().zip(&nearest) {
            let limits = Limits { bound: found.upper, per_cut };
            let middle = one.piece.middle();
            let far = (middle, upper(middle, near));
            found.upper = found.raise(goal, limits, far, one.piece.depth);
        }
        if found.is_over(goal) {
            break;
        }
        let limits = Limits { bound: found.upper, per_cut };
        for (one, near) in round.into_iter().zip(nearest) {
            found.n_steps += 1;
            if found.n_steps > MOST_STEPS {
                let off = f64::from(one.piece.depth) * per_cut;
                found.upper = found.upper.max(one.piece.upper(&near) + off);
                found.is_given_up = true;
                continue;
            }
            cut_down(one, near, limits, &mut open);
        }
    }
    Ok(found)
}

/// Nearest target to the middle of each piece.
fn nearest(
    round: &[Open],
    (target, survey): (&Parts, &Survey),
    means: Means,
) -> Result<Vec<[Vector; 3]>> {
    let points: Vec<Vector> = round.iter().map(|open| open.piece.middle()).collect();
    let order = order_along_curve(&points);
    let sorted: Vec<Vector> = order.iter().map(|&i| points[i as usize]).collect();
    let hits = settle(&sorted, target, survey, &vec![-1.0; sorted.len()], means)?;
    let mut nearest = vec![[[0.0; 3]; 3]; points.len()];
    order.iter().zip(&hits).for_each(|(&i, hit)| nearest[i as usize] = hit.corners);
    Ok(nearest)
}

/// Cuts a piece as far as the triangles at hand go; what is left waits for the next round in `open`.
fn cut_down(one: Open, nearest: [Vector; 3], limits: Limits, open: &mut Vec<Open>) {
    let mut near = one.near;
    near.rotate_right(1);
    near[0] = Some(nearest);
    let halve = |piece: Piece, open: &mut Vec<Open>| {
        open.extend(piece.halves().map(|piece| Open { piece, near }));
    };
    let mut stack = Vec::new();
    match one.piece.cut(near.iter().flatten(), limits) {
        Cut::Proven => {}
        Cut::Rest(pieces) => stack.extend(pieces.into_iter().flatten()),
        Cut::TooLittle => halve(one.piece, open),
    }
    while let Some(piece) = stack.pop() {
        match piece.cut(near.iter().flatten(), limits) {
            Cut::Proven => {}
            Cut::Rest(pieces) => stack.extend(pieces.into_iter().flatten()),
            Cut::TooLittle => open.push(Open { piece, near }),
        }
    }
}
