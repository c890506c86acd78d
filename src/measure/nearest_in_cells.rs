//! Nearest points on a surface that is on disk in cells.
//!
//! Every query visits just the cells whose boxes are not farther than a bound that a sparse set of surface
//! points gives; each such cell is loaded once for all its queries. The nearest answer of all cells is the
//! exact one: whatever lies in other cells is farther than the bound.

use super::carried::Values;
use super::parts::{Means, Parts, Survey};
use super::side::Look;
use super::tree::{Nearest, Tree};
use super::triangle::{self, Vector};
use super::{STOP_QUERIES, Surface};
use std::sync::{Mutex, PoisonError};
use stonecut_mesh::bounds::Bounds;
use stonecut_system::error::Result;

/// Queries that are held against the boxes together.
const RUN: usize = 256;

/// Bytes a query takes while it is settled: bound, place in lists, answer on the way and at its end.
pub(super) const QUERY_BYTES: u64 = 8 + 12 + size_of::<Hit>() as u64;

/// Answers that a thread keeps before it hands them over.
const FOUND: usize = 1024;

/// The nearest point of a surface: squared distance, canonical corners of its triangle, what it carries.
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
pub(super) struct Hit {
    pub distance_sq: f64,
    pub corners: [Vector; 3],
    pub values: Values,
}

impl Hit {
    const NONE: Hit = Hit {
        distance_sq: f64::INFINITY,
        corners: [[0.0; 3]; 3],
        values: Values { lab: None, texture: None, normal: None },
    };

    /// Normal at the hit and what it carries.
    pub fn look(&self) -> Look {
        (triangle::area_normal(&self.corners), self.values)
    }
}

/// Finds the nearest point of `target` for every point; best given in an order that keeps neighbours together.
///
/// Any hit at a distance of at most the point's entry in `enough_sq` (squared; below 0 for never) may stand for
/// the nearest. An empty target leaves all distances infinite.
pub(super) fn settle(
    points: &[Vector],
    target: &Parts,
    survey: &Survey,
    enough_sq: &[f64],
    means: Means,
) -> Result<Vec<Hit>> {
    let mut bounds = Vec::with_capacity(points.len());
    let mut hint = u32::MAX;
    for (i, &point) in points.iter().enumerate() {
        if i % STOP_QUERIES == 0 {
            means.progress.check()?;
        }
        let (bound_sq, found) = survey.bound_sq(point, hint);
        hint = found;
        bounds.push(bound_sq);
    }
    let lists = lists(points, &bounds, &survey.boxes);
    let hits = Mutex::new(vec![Hit::NONE; points.len()]);
    let hand_over = |found: &mut Vec<(u32, Hit)>| {
        let mut hits = hits.lock().unwrap_or_else(PoisonError::into_inner);
        for (query, hit) in found.drain(..) {
            let best = &mut hits[query as usize];
            // By distance, then by corners: the same choice as within one tree.
            if hit < *best {
                *best = hit;
            }
        }
    };
    let busy = (0..target.n_parts()).filter(|&part| !lists[part].is_empty());
    // Loading counts into the progress only once, in the survey.
    let means = Means { is_counted: false, ..means };
    let answer = |part: usize, surface: Surface| {
        let corners_of = |i| surface.mesh.corners(i);
        let tree = Tree::build_until(surface.mesh.triangles.len(), corners_of, means.progress)?;
        let mut found = Vec::with_capacity(FOUND);
        let mut slot = u32::MAX;
        for (i, &query) in lists[part].iter().enumerate() {
            if i % STOP_QUERIES == 0 {
                means.progress.check()?;
            }
            let (point, bound_sq) = (points[query as usize], bounds[query as usize]);
            let mut guess = tree.guess(point, slot);
            if bound_sq < guess.distance_sq {
                guess = Nearest { distance_sq: bound_sq, ..Nearest::NONE };
            }
            let nearest = tree.nearest_unless_within(point, guess, enough_sq[query as usize]);
            if nearest.is_found() {
                slot = nearest.slot;
                let values = surface.values_next_to(&tree, slot, point);
                let distance_sq = nearest.distance_sq;
                found.push((query, Hit { distance_sq, corners: *tree.corners(slot), values }));
                if found.len() == FOUND {
                    hand_over(&mut found);
                }
            }
        }
        hand_over(&mut found);
        Ok(())
    };
    let mut failed = None;
    target
        .for_each(busy, means, Tree::bytes, answer, |part| failed = part.err().or(failed.take()))?;
    failed.map_or(Ok(()), Err)?;
    Ok(hits.into_inner().unwrap_or_else(PoisonError::into_inner))
}

/// For each part, the queries that may find their nearest point there, in the order of the queries.
fn lists(points: &[Vector], bounds: &[f64], boxes: &[Bounds]) -> Vec<Vec<u32>> {
    let mut lists = vec![Vec::new(); boxes.len()];
    for (number, run) in points.chunks(RUN).enumerate() {
        let first = number * RUN;
        let mut around = Bounds::EMPTY;
        run.iter().for_each(|&point| around.add(point));
        let reach_sq = bounds[first..first + run.len()].iter().copied().fold(0.0, f64::max);
        for (list, part) in lists.iter_mut().zip(boxes) {
            if part.gap_sq(&around) > reach_sq {
                continue;
            }
            for (i, &point) in run.iter().enumerate() {
                if part.distance_sq(point) <= bounds[first + i] {
                    list.push((first + i) as u32);
                }
            }
        }
    }
    lists
}
