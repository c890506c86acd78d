//! Triangles of the result that are the original's own: their points need no search.
//!
//! The finest tiles hold the triangles of the input, with corners rounded. One search for the middle of a triangle finds
//! the one that it was; if their corners agree, every point is at the place with the same shares of the corners.

use super::nearest::{CellCache, Reach, Seekers};
use super::original::{Cell, Hit, Original};
use super::side::Side;
use std::ops::Range;
use stonecut_measure::tree::Nearest;
use stonecut_measure::triangle::{self, Vector};
use stonecut_mesh::vec3::{length_sq, sub};
use stonecut_system::error::Result;
use stonecut_system::parallel::in_order;
use stonecut_system::progress::Progress;

/// Patches that a thread takes at a time.
const BLOCK: usize = 512;

/// Points of triangles that may be the original's.
pub(super) trait Own: Seekers {
    /// Corners of the triangle that a point is on.
    fn corners(&self, i: usize) -> [Vector; 3];
    /// Shares of these in the point.
    fn weights(&self, i: usize) -> [f64; 3];
}

/// Places of the points of some patches, and the squared distances of their middles from the triangles.
#[derive(Default)]
struct Found {
    patches: Vec<(u32, f64)>,
    hits: Vec<Hit>,
}

impl Original {
    /// Finds the places of the points of those patches whose triangles are the original's own, with corners at most `within`
    /// away; returns the other patches. The answer does not depend on which cells are in memory.
    pub(super) fn same(
        &self,
        (seekers, within): (&impl Own, f64),
        patches: &[Range<usize>],
        cells: &mut CellCache,
        (threads, progress): (usize, &Progress),
        hits: &mut [Hit],
    ) -> Result<Vec<Range<usize>>> {
        let within_sq = within * within;
        let at = |i: usize| middle(&seekers.corners(patches[i].start));
        let lists = self.lists(patches.len(), at, Reach::Within(&|_| within_sq));
        let mut nearest_sq = vec![f64::INFINITY; patches.len()];
        let busy: Vec<usize> = (0..lists.len()).filter(|&cell| !lists[cell].is_empty()).collect();
        let mut from = 0;
        while from < busy.len() {
            let loaded = cells.get(self, &busy[from..], threads, progress)?;
            for (cell, &number) in loaded.iter().zip(&busy[from..]) {
                let blocks: Vec<&[u32]> = lists[number].chunks(BLOCK).collect();
                in_order(
                    blocks.len() as u64,
                    threads,
                    progress,
                    |block, found: &mut Found| {
                        found.patches.clear();
                        found.hits.clear();
                        let mut slot = u32::MAX;
                        for &patch in blocks[block as usize] {
                            let own = patches[patch as usize].clone();
                            let of = (seekers, within);
                            let nearest = self.find_same(cell, of, own, &mut slot, &mut found.hits);
                            found.patches.extend(nearest.map(|nearest_sq| (patch, nearest_sq)));
                        }
                        Ok(())
                    },
                    |_, found| {
                        let mut from = 0;
                        for &(patch, distance_sq) in &found.patches {
                            let own = patches[patch as usize].clone();
                            let to = from + own.len();
                            // Cells come in the order of their numbers, so of equal ones the first counts.
                            if distance_sq < nearest_sq[patch as usize] {
                                nearest_sq[patch as usize] = distance_sq;
                                hits[own].copy_from_slice(&found.hits[from..to]);
                            }
                            from = to;
                        }
                        Ok(())
                    },
                )?;
            }
            from += loaded.len();
        }
        let left = patches.iter().zip(nearest_sq).filter(|(_, nearest)| nearest.is_infinite());
        Ok(left.map(|(patch, _)| patch.clone()).collect())
    }

    /// Looks for the triangle of a patch in a cell; `slot` is a guess, and then the one that was nearest.
    fn find_same(
        &self,
        cell: &Cell,
        (seekers, within): (&impl Own, f64),
        patch: Range<usize>,
        slot: &mut u32,
        hits: &mut Vec<Hit>,
    ) -> Option<f64> {
        let i = patch.start;
        let corners = seekers.corners(i);
        let middle = middle(&corners);
        let most = Nearest { distance_sq: within * within, ..Nearest::NONE };
        let guess = cell.tree.guess(middle, *slot);
        let is_near = guess.distance_sq <= most.distance_sq;
        let nearest = cell.tree.nearest(middle, if is_near { guess } else { most });
        if !nearest.is_found() {
            return None;
        }
        *slot = nearest.slot;
        let t = cell.tree.corners(nearest.slot);
        let agrees = |(a, b): (&Vector, &Vector)| length_sq(sub(*a, *b)) <= within * within;
        let turned = |&first: &usize| triangle::rotate(corners, first).iter().zip(t).all(agrees);
        let first = (0..3).find(turned)?;
        let side = Side { normal: seekers.normal(i), steps: seekers.steps(i) };
        let face = self.face(cell, nearest.slot, &side);
        hits.extend(patch.map(|i| {
            let weights = triangle::rotate(seekers.weights(i), first);
            self.hit(cell, &face, (0.0, weights))
        }));
        Some(nearest.distance_sq)
    }
}

fn middle(corners: &[Vector; 3]) -> Vector {
    triangle::point_at(corners, [1.0 / 3.0; 3])
}
