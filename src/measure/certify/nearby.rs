//! Proves pieces that lie between cells of the target: with all target triangles near them, of whatever cell.
//!
//! Pieces that no cell proves alone lie in narrow strips where cells meet, so the triangles near all of it are few. They
//! are gathered in one pass over the cells and get one tree. If they exceed the memory, one half of the pieces
//! follows the other.

use super::cover::{Cover, Final, Found, ProofGoal};
use super::piece::Piece;
use super::sheet::Neighbours;
use crate::Surface;
use crate::parts::{Means, Parts, Survey};
use crate::sample::order_along_curve;
use crate::tree::{Nearest, Tree};
use crate::triangle::{Vector, point_at};
use std::collections::HashMap;
use std::sync::atomic::{AtomicUsize, Ordering};
use stonecut_mesh::Mesh;
use stonecut_mesh::bounds::Bounds;
use stonecut_mesh::vec3::{length_sq, sub};
use stonecut_system::error::Result;

/// Triangles are gathered from so far, in the distance to be proven: it may grow a little on the way.
const REACH: f64 = 1.05;

/// Pieces that are held against the boxes of the cells together.
const RUN: usize = 64;

/// Bytes of a gathered triangle where vertices are told apart, beside the list of all.
const WELDING_BYTES: u64 = 160;

/// Bytes of a gathered triangle: in the list of its cell, in that of all, in the tree; or while vertices are told apart.
fn gathered_bytes() -> u64 {
    let list = size_of::<[Vector; 3]>() as u64;
    2 * list + WELDING_BYTES.max(Tree::bytes(1000) / 1000 + 1)
}

/// Input of a proof besides the pieces.
#[derive(Clone, Copy)]
pub(super) struct Nearby<'a> {
    pub target: (&'a Parts<'a>, &'a Survey),
    pub goal: &'a ProofGoal,
    pub per_cut: f64,
    /// Memory for gathered triangles.
    pub bytes: u64,
    pub means: Means<'a>,
}

impl Nearby<'_> {
    /// Proves pieces within the bound or raises it; gives back those that are farther than triangles were gathered.
    pub fn prove(&self, pieces: &[Piece], found: &mut Found) -> Result<Vec<Piece>> {
        let middles: Vec<Vector> = pieces.iter().map(Piece::middle).collect();
        let sorted: Vec<Piece> =
            order_along_curve(&middles).iter().map(|&i| pieces[i as usize]).collect();
        drop(middles);
        let mut left = Vec::new();
        let mut waiting = vec![&sorted[..]];
        while let Some(some) = waiting.pop() {
            match self.gather(some)? {
                Some(triangles) => self.cover(some, &triangles, found, &mut left)?,
                // One piece is left to what needs no memory.
                None if some.len() == 1 => left.extend(some),
                None => {
                    let (first, second) = some.split_at(some.len() / 2);
                    waiting.extend([second, first]);
                }
            }
            if found.is_over(self.goal) {
                break;
            }
        }
        Ok(left)
    }

    fn reach(&self) -> f64 {
        REACH * self.goal.bound + self.goal.floor
    }

    fn cover(
        &self,
        pieces: &[Piece],
        triangles: &[[Vector; 3]],
        found: &mut Found,
        left: &mut Vec<Piece>,
    ) -> Result<()> {
        let progress = self.means.progress;
        let tree = Tree::build_until(triangles.len(), |i| triangles[i], progress)?;
        let neighbours = Neighbours::new(&tree, &welded(triangles));
        let is_final = Final::Within(self.reach());
        let mut cover = Cover::new(&tree, is_final, *self.goal, self.per_cut, progress)
            .with_sheets(&neighbours);
        for piece in pieces {
            cover.cover(*piece)?;
            if cover.found.is_over(self.goal) {
                break;
            }
        }
        left.append(&mut cover.left);
        found.merge(&cover.found);
        Ok(())
    }

    /// All target triangles near some pieces; `None` if memory does not hold them.
    fn gather(&self, pieces: &[Piece]) -> Result<Option<Vec<[Vector; 3]>>> {
        let (target, survey) = self.target;
        let reach = self.reach();
        let boxes: Vec<Bounds> = pieces
            .chunks(RUN)
            .map(|run| {
                let mut around = Bounds::EMPTY;
                run.iter().flat_map(|piece| piece.corners).for_each(|p| around.add(p));
                around
            })
            .collect();
        let is_near = |part: &usize| {
            boxes.iter().any(|around| survey.boxes[*part].gap_sq(around) <= reach * reach)
        };
        let parts: Vec<usize> = (0..target.n_parts()).filter(is_near).collect();
        let of_pieces =
            Tree::build_until(pieces.len(), |i| pieces[i].corners, self.means.progress)?;
        let most = (self.bytes / gathered_bytes()) as usize;
        let n_gathered = AtomicUsize::new(0);
        let work = |part: usize, surface: Surface| {
            let mut near = Vec::new();
            let mut slot = u32::MAX;
            for i in 0..surface.mesh.triangles.len() {
                if n_gathered.load(Ordering::Relaxed) > most {
                    break;
                }
                let corners = surface.mesh.corners(i);
                let third = 1.0 / 3.0;
                let middle = point_at(&corners, [third; 3]);
                let radius_sq =
                    corners.iter().map(|&p| length_sq(sub(p, middle))).fold(0.0, f64::max);
                let limit = reach + radius_sq.sqrt() * (1.0 + 1e-9);
                let limit_sq = limit * limit * (1.0 + 1e-9);
                let far = Nearest { distance_sq: limit_sq, ..Nearest::NONE };
                let guess = of_pieces.guess(middle, slot);
                let guess = if guess.distance_sq <= limit_sq { guess } else { far };
                let enough_sq = if guess.is_found() { limit_sq } else { limit_sq.next_down() };
                let found = of_pieces.nearest_unless_within(middle, guess, enough_sq);
                if found.is_found() {
                    slot = found.slot;
                    near.push(corners);
                    n_gathered.fetch_add(1, Ordering::Relaxed);
                }
            }
            (part, near)
        };
        let means = Means { is_counted: false, ..self.means };
        let mut all = Vec::new();
        target.for_each(parts.into_iter(), means, |_| 0, work, |found| all.push(found))?;
        if n_gathered.into_inner() > most {
            return Ok(None);
        }
        // Cells end in any order.
        all.sort_unstable_by_key(|(part, _)| *part);
        let mut triangles = Vec::with_capacity(all.iter().map(|(_, near)| near.len()).sum());
        all.into_iter().for_each(|(_, mut near)| triangles.append(&mut near));
        Ok(Some(triangles))
    }
}

/// Triangles as a mesh, in which corners at the same place are one vertex.
fn welded(triangles: &[[Vector; 3]]) -> Mesh {
    let mut numbers: HashMap<[u64; 3], u32> = HashMap::new();
    let mut mesh = Mesh::default();
    for corners in triangles {
        mesh.triangles.push(corners.map(|corner| {
            // Adding 0 makes both zeros one.
            *numbers.entry(corner.map(|x| (x + 0.0).to_bits())).or_insert_with(|| {
                mesh.positions.push(corner);
                mesh.positions.len() as u32 - 1
            })
        }));
    }
    mesh
}
