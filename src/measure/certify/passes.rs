//! One direction of a certificate: every triangle of the source past the target, wherever both are.
//!
//! A target in memory is one tree. A target in cells is visited cell by cell: each piece of the source goes to the
//! cell nearest to its middle. What that does not prove lies where cells meet (`nearby`), or far from all (`exact`).

use super::bound::off_edge;
use super::cover::{Cover, Final, Found, ProofGoal};
use super::exact;
use super::nearby::Nearby;
use super::piece::Piece;
use super::sheet::Neighbours;
use crate::Surface;
use crate::parts::{Means, Parts, Place, Survey};
use crate::sample::order_along_curve;
use crate::tree::Tree;
use crate::triangle::Vector;
use std::sync::atomic::{AtomicBool, Ordering};
use stonecut_mesh::Mesh;
use stonecut_mesh::bounds::Bounds;
use stonecut_system::error::Result;
use stonecut_system::parallel;

/// Triangles that one thread proves at a time.
const BLOCK: usize = 4096;

/// Pieces that are held against the boxes of the cells together.
const RUN: usize = 256;

/// A piece is halved until it is shorter than this share of the cell it goes to.
const SHARE_OF_CELL: f64 = 0.25;

/// Most times that a piece is halved for that.
const MOST_HALVED: u32 = 40;

/// Pieces waiting may take at least one in this many bytes of the budget, with what becomes of them.
const PIECE_SHARE: u64 = 3;

/// Waiting pieces that may become of one, on average.
const GROWTH: u64 = 3;

/// One direction.
pub(super) struct Way<'a> {
    pub source: &'a Parts<'a>,
    pub target: &'a Parts<'a>,
    /// Of the target, if that is in cells.
    pub survey: Option<&'a Survey>,
    pub goal: ProofGoal,
}

impl Way<'_> {
    /// Proves every triangle of the source within the bound, or raises it. `tree` is that over a target in memory, if it is
    /// there already.
    pub fn prove(&self, tree: Option<Tree>, means: Means) -> Result<Found> {
        let mut found = match (self.target.place, self.survey) {
            (Place::Cells(_), Some(survey)) => self.against_cells(survey, means)?,
            _ => self.against_memory(tree, means)?,
        };
        found.upper = found.upper.max(self.goal.bound);
        Ok(found)
    }

    fn per_cut(&self) -> f64 {
        let Bounds { low, high } = self.source.bounds.or_origin();
        off_edge(low.iter().chain(&high).fold(0.0, |most, x| x.abs().max(most)))
    }

    /// The target is one tree; the source passes by.
    fn against_memory(&self, tree: Option<Tree>, means: Means) -> Result<Found> {
        let none = Mesh::default();
        let target = if let Place::Memory(mesh) = self.target.place { mesh } else { &none };
        let corners_of = |i| target.corners(i);
        let build = || Tree::build_until(target.triangles.len(), corners_of, means.progress);
        let tree = tree.map_or_else(build, Ok)?;
        let neighbours = Neighbours::new(&tree, target);
        let prove = |mesh: &Mesh, triangles: std::ops::Range<usize>| {
            let mut cover =
                Cover::new(&tree, Final::Always, self.goal, self.per_cut(), means.progress)
                    .with_sheets(&neighbours);
            for i in triangles {
                cover.cover_triangle(mesh, i)?;
                if cover.found.is_over(&self.goal) {
                    break;
                }
            }
            Ok(cover.found)
        };
        let mut found = Found::default();
        let is_over = AtomicBool::new(false);
        if let Place::Memory(mesh) = self.source.place {
            let n = mesh.triangles.len();
            parallel::in_order(
                n.div_ceil(BLOCK) as u64,
                means.threads,
                means.progress,
                |block, out: &mut Found| {
                    let first = block as usize * BLOCK;
                    let triangles = first..(first + BLOCK).min(n);
                    if !is_over.load(Ordering::Relaxed) {
                        means.progress.add(triangles.len() as u64);
                        *out = prove(mesh, triangles)?;
                    }
                    Ok(())
                },
                |_, block| {
                    // Blocks behind the one that ends the search do not count, looked at or not.
                    if !found.is_over(&self.goal) {
                        found.merge(block);
                        is_over.store(found.is_over(&self.goal), Ordering::Relaxed);
                    }
                    Ok(())
                },
            )?;
            return Ok(found);
        }
        let mut failed = None;
        let all = 0..self.source.n_parts();
        let work = |_, source: Surface| prove(source.mesh, 0..source.mesh.triangles.len());
        self.source.for_each(
            all,
            means,
            |_| 0,
            work,
            |part| match part {
                Ok(part) => found.merge(&part),
                Err(error) => failed = Some(error),
            },
        )?;
        failed.map_or(Ok(found), Err)
    }

    /// The target is in cells: the source is gathered in batches, which visit the cells together.
    fn against_cells(&self, survey: &Survey, means: Means) -> Result<Found> {
        let bytes = |part| self.target.bytes(part) + Tree::bytes(self.target.n_triangles(part));
        let largest = (0..self.target.n_parts()).map(bytes).max().unwrap_or(0);
        let cells = (means.threads as u64 + 1).saturating_mul(largest);
        let share =
            (means.memory_bytes / PIECE_SHARE).max(means.memory_bytes.saturating_sub(cells));
        let batch = (share / (GROWTH * size_of::<Piece>() as u64)).max(4096) as usize;
        let means = Means { memory_bytes: means.memory_bytes - share, ..means };
        let mut found = Found::default();
        let mut waiting = Vec::new();
        for part in 0..self.source.n_parts() {
            let mesh = self.source.load(part)?;
            for i in order(&mesh, self.source.place) {
                waiting.push(Piece::whole(mesh.corners(i as usize)));
                if waiting.len() >= batch {
                    self.show(std::mem::take(&mut waiting), survey, (share, means), &mut found)?;
                    if found.is_over(&self.goal) {
                        return Ok(found);
                    }
                }
            }
        }
        self.show(waiting, survey, (share, means), &mut found)?;
        Ok(found)
    }

    /// Shows pieces to cells, and what these leave to all cells together.
    fn show(
        &self,
        waiting: Vec<Piece>,
        survey: &Survey,
        (bytes, means): (u64, Means),
        found: &mut Found,
    ) -> Result<()> {
        let mut rest = Vec::new();
        let lists = self.lists(waiting, &survey.boxes, &mut rest);
        let mut left = self.visit(&lists, &survey.boxes, means, found)?;
        drop(lists);
        if found.is_over(&self.goal) {
            return Ok(());
        }
        // Cells end in any order.
        left.sort_unstable_by_key(|(part, _)| *part);
        left.into_iter().for_each(|(_, mut left)| rest.append(&mut left));
        if rest.is_empty() {
            return Ok(());
        }
        let (target, per_cut) = ((self.target, survey), self.per_cut());
        let nearby = Nearby { target, goal: &self.goal, per_cut, bytes: bytes / 2, means };
        let far = nearby.prove(&rest, found)?;
        if !far.is_empty() && !found.is_over(&self.goal) {
            found.merge(&exact::prove(far, target, &self.goal, per_cut, means)?);
        }
        Ok(())
    }

    /// For each cell the pieces that it is to be shown; those that no cell is near to go to `rest`.
    fn lists(
        &self,
        waiting: Vec<Piece>,
        boxes: &[Bounds],
        rest: &mut Vec<Piece>,
    ) -> Vec<Vec<Piece>> {
        let mut lists = vec![Vec::new(); boxes.len()];
        let bound_sq = self.goal.bound * self.goal.bound;
        for run in waiting.chunks(RUN) {
            let mut around = Bounds::EMPTY;
            run.iter().flat_map(|piece| piece.corners).for_each(|p| around.add(p));
            let is_near = |part: &usize| boxes[*part].gap_sq(&around) <= bound_sq;
            let near: Vec<usize> = (0..boxes.len()).filter(is_near).collect();
            let mut stack: Vec<Piece> = run.iter().rev().copied().collect();
            while let Some(piece) = stack.pop() {
                let around = Bounds::around(&piece.corners);
                let middle = piece.middle();
                let mut is_alone = true;
                let mut best: Option<(f64, usize)> = None;
                for &part in &near {
                    if boxes[part].gap_sq(&around) > bound_sq {
                        continue;
                    }
                    is_alone &= best.is_none();
                    let distance_sq = boxes[part].distance_sq(middle);
                    if best.is_none_or(|(least_sq, _)| distance_sq < least_sq) {
                        best = Some((distance_sq, part));
                    }
                }
                let Some((_, part)) = best else {
                    rest.push(piece);
                    continue;
                };
                let most = (SHARE_OF_CELL * boxes[part].side()).max(self.goal.bound);
                match !is_alone && piece.depth < MOST_HALVED && piece.longest_sq().0 > most * most {
                    true => stack.extend(piece.halves()),
                    false => lists[part].push(piece),
                }
            }
        }
        lists
    }

    /// Shows every cell its pieces; what it leaves of them, by cell.
    fn visit(
        &self,
        lists: &[Vec<Piece>],
        boxes: &[Bounds],
        means: Means,
        found: &mut Found,
    ) -> Result<Vec<(usize, Vec<Piece>)>> {
        let busy = (0..lists.len()).filter(|&part| !lists[part].is_empty());
        let means = Means { is_counted: false, ..means };
        let work = |part: usize, surface: Surface| {
            let corners_of = |i| surface.mesh.corners(i);
            let tree = Tree::build_until(surface.mesh.triangles.len(), corners_of, means.progress)?;
            let neighbours = Neighbours::new(&tree, surface.mesh);
            let others = Final::Outside(others(part, &lists[part], boxes));
            let mut cover = Cover::new(&tree, others, self.goal, self.per_cut(), means.progress)
                .with_sheets(&neighbours);
            for piece in &lists[part] {
                cover.cover(*piece)?;
                if cover.found.is_over(&self.goal) {
                    break;
                }
            }
            // Whole triangles and parts of them alike: an estimate for people.
            means.progress.add(lists[part].len() as u64);
            Ok((part, cover.found, cover.left))
        };
        let (mut all, mut failed) = (Vec::new(), None);
        self.target.for_each(busy, means, Tree::bytes, work, |part| match part {
            Ok((part, one, left)) => {
                found.merge(&one);
                all.push((part, left));
            }
            Err(error) => failed = Some(error),
        })?;
        failed.map_or(Ok(all), Err)
    }
}

/// The boxes of other cells, the nearest to the pieces first.
fn others(part: usize, pieces: &[Piece], boxes: &[Bounds]) -> Vec<Bounds> {
    let mut around = Bounds::EMPTY;
    pieces.iter().flat_map(|piece| piece.corners).for_each(|p| around.add(p));
    let mut others: Vec<(f64, usize)> = (0..boxes.len())
        .filter(|&other| other != part)
        .map(|other| (boxes[other].gap_sq(&around), other))
        .collect();
    others.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    others.into_iter().map(|(_, other)| boxes[other]).collect()
}

/// An order that keeps neighbours together; triangles of a cell are neighbours anyway.
fn order(mesh: &Mesh, place: Place) -> Vec<u32> {
    if let Place::Cells(_) = place {
        return (0..mesh.triangles.len() as u32).collect();
    }
    let first = |t: &[u32; 3]| mesh.positions[t[0] as usize];
    let points: Vec<Vector> = mesh.triangles.iter().map(first).collect();
    order_along_curve(&points)
}
