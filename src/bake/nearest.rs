//! The nearest place of the original for many points, cell by cell.
//!
//! A point looks in the cell whose box it is in, then in every cell whose box is not farther than what was found: the
//! answer is exact, whatever the cells. Where the nearest place faces away from the point's own side, as through a thin
//! wall, the nearest place that faces it is taken instead, if that is not much farther.

use super::original::{Cell, Hit, Original};
use super::side::Side;
use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;
use stonecut_measure::tree::{Nearest, Tree};
use stonecut_measure::triangle::{self, Vector};
use stonecut_mesh::bounds::Bounds;
use stonecut_mesh::vec3::dot;
use stonecut_system::error::Result;
use stonecut_system::parallel::in_order;
use stonecut_system::progress::Progress;

/// Points, or patches, that are held against the boxes together.
const RUN: usize = 256;

/// Points that a thread takes at a time.
const BLOCK: usize = 2048;

/// Points of the result that look for a place.
pub(super) trait Seekers: Sync {
    fn n(&self) -> usize;
    fn point(&self, i: usize) -> Vector;
    /// Number of a small region: of the points of a patch, those with the same one are neighbours.
    fn square(&self, i: usize) -> u64;
    /// Normal of the surface that the point is on, of any length.
    fn normal(&self, i: usize) -> Vector;
    /// A place that faces the point may be this much farther than the nearest one.
    fn grace(&self, i: usize) -> f64;
    /// Ways of a texel along the axes of the point's page, of points that look around; zeros otherwise.
    fn steps(&self, _i: usize) -> [Vector; 2] {
        [[0.0; 3]; 2]
    }
}

/// Some of many points.
pub(super) struct Subset<'a, S> {
    pub of: &'a S,
    pub numbers: &'a [u32],
}

impl<S: Seekers> Seekers for Subset<'_, S> {
    fn n(&self) -> usize {
        self.numbers.len()
    }

    fn point(&self, i: usize) -> Vector {
        self.of.point(self.numbers[i] as usize)
    }

    fn square(&self, i: usize) -> u64 {
        self.of.square(self.numbers[i] as usize)
    }

    fn normal(&self, i: usize) -> Vector {
        self.of.normal(self.numbers[i] as usize)
    }

    fn grace(&self, i: usize) -> f64 {
        self.of.grace(self.numbers[i] as usize)
    }

    fn steps(&self, i: usize) -> [Vector; 2] {
        self.of.steps(self.numbers[i] as usize)
    }
}

impl Original {
    /// Finds a place for each point; best given in an order that keeps neighbours together.
    ///
    /// Memory: 80 bytes a point, and cells within `cell_bytes`, one at least.
    pub(super) fn nearest_any(
        &self,
        seekers: &impl Seekers,
        cells: &mut CellCache,
        (threads, progress): (usize, &Progress),
    ) -> Result<Vec<Hit>> {
        let n = seekers.n();
        let mut hits = vec![Hit::NONE; n];
        let means = (threads, progress);
        let home = self.lists(n, |i| seekers.point(i), Reach::Home);
        self.visit(&home, seekers, Search::Any, &mut hits, cells, means)?;
        let mut others =
            self.lists(n, |i| seekers.point(i), Reach::Within(&|i| hits[i].distance_sq));
        for (list, done) in others.iter_mut().zip(&home) {
            let mut done = done.iter().peekable();
            list.retain(|query| {
                while done.next_if(|&&d| d < *query).is_some() {}
                done.peek() != Some(&query)
            });
        }
        drop(home);
        self.visit(&others, seekers, Search::Any, &mut hits, cells, means)?;
        Ok(hits)
    }

    /// Lets those points look on whose nearest place faces away.
    pub(super) fn turn(
        &self,
        seekers: &impl Seekers,
        hits: &mut [Hit],
        cells: &mut CellCache,
        means: (usize, &Progress),
    ) -> Result<()> {
        let turned: Vec<u32> =
            (0u32..).zip(&*hits).filter(|(_, hit)| !hit.faces).map(|(i, _)| i).collect();
        if turned.is_empty() {
            return Ok(());
        }
        let some = Subset { of: seekers, numbers: &turned };
        let limits: Vec<f64> = (0..turned.len())
            .map(|i| {
                let limit = hits[turned[i] as usize].distance_sq.sqrt() + some.grace(i);
                limit * limit
            })
            .collect();
        let lists = self.lists(some.n(), |i| some.point(i), Reach::Within(&|i| limits[i]));
        let mut facing: Vec<Hit> =
            limits.iter().map(|&distance_sq| Hit { distance_sq, ..Hit::NONE }).collect();
        self.visit(&lists, &some, Search::Facing, &mut facing, cells, means)?;
        for (&i, better) in turned.iter().zip(facing).filter(|(_, better)| better.faces) {
            hits[i as usize] = better;
        }
        Ok(())
    }

    /// Lets the listed points of each cell look into it.
    fn visit(
        &self,
        lists: &[Vec<u32>],
        seekers: &impl Seekers,
        search: Search,
        hits: &mut [Hit],
        cells: &mut CellCache,
        (threads, progress): (usize, &Progress),
    ) -> Result<()> {
        let busy: Vec<usize> = (0..lists.len()).filter(|&cell| !lists[cell].is_empty()).collect();
        let mut from = 0;
        while from < busy.len() {
            let loaded = cells.get(self, &busy[from..], threads, progress)?;
            for (cell, &number) in loaded.iter().zip(&busy[from..]) {
                let list = &lists[number];
                let mut found: Vec<(u32, Hit)> = Vec::new();
                let so_far = &*hits;
                in_order(
                    list.len().div_ceil(BLOCK) as u64,
                    threads,
                    progress,
                    |block, out: &mut Vec<(u32, Hit)>| {
                        out.clear();
                        let first = block as usize * BLOCK;
                        let mut slot = u32::MAX;
                        for &query in &list[first..(first + BLOCK).min(list.len())] {
                            let i = query as usize;
                            let (point, normal) = (seekers.point(i), seekers.normal(i));
                            let most = so_far[i].distance_sq;
                            let nearest = search.run(&cell.tree, point, normal, most, slot);
                            if nearest.is_found() {
                                slot = nearest.slot;
                                let side = Side { normal, steps: seekers.steps(i) };
                                let face = self.face(cell, slot, &side);
                                let found = triangle::closest(point, cell.tree.corners(slot));
                                let found = (nearest.distance_sq, found.1);
                                out.push((query, self.hit(cell, &face, found)));
                            }
                        }
                        Ok(())
                    },
                    |_, block| {
                        found.append(block);
                        Ok(())
                    },
                )?;
                for (query, hit) in found {
                    let best = &mut hits[query as usize];
                    if hit.is_better(best) {
                        *best = hit;
                    }
                }
            }
            from += loaded.len();
        }
        Ok(())
    }

    /// Numbers of the cells whose boxes meet those of patches.
    pub(super) fn cells_around(
        &self,
        seekers: &impl Seekers,
        patches: &[Range<usize>],
    ) -> Vec<usize> {
        let mut is_near = vec![false; self.boxes.len()];
        for run in patches.chunks(RUN) {
            let mut all = Bounds::EMPTY;
            let around = |patch: &Range<usize>| {
                let mut around = Bounds::EMPTY;
                // Every 64th point: the rest is not far, and a cell that is missed is looked into later.
                patch.clone().step_by(64).for_each(|i| around.add(seekers.point(i)));
                all = all.joined(&around);
                around
            };
            let around: Vec<Bounds> = run.iter().map(around).collect();
            for (is_near, own) in is_near.iter_mut().zip(&self.boxes) {
                *is_near = *is_near
                    || own.gap_sq(&all) <= 0.0
                        && around.iter().any(|around| own.gap_sq(around) <= 0.0);
            }
        }
        (0..is_near.len()).filter(|&cell| is_near[cell]).collect()
    }

    /// For each cell the points that may find their place there.
    pub(super) fn lists(
        &self,
        n: usize,
        point: impl Fn(usize) -> Vector,
        reach: Reach,
    ) -> Vec<Vec<u32>> {
        let mut lists = vec![Vec::new(); self.boxes.len()];
        for first in (0..n).step_by(RUN) {
            let run = first..(first + RUN).min(n);
            let mut around = Bounds::EMPTY;
            run.clone().for_each(|i| around.add(point(i)));
            let gap = |cell: usize| self.boxes[cell].gap_sq(&around);
            match reach {
                Reach::Home => {
                    let least = (0..self.boxes.len()).map(gap).fold(f64::INFINITY, f64::min);
                    let near: Vec<usize> =
                        (0..self.boxes.len()).filter(|&cell| gap(cell) <= least).collect();
                    for i in run {
                        let at = point(i);
                        let off = |cell: &&usize| self.boxes[**cell].distance_sq(at);
                        let home = near.iter().min_by(|a, b| off(a).total_cmp(&off(b)));
                        home.iter().for_each(|&&cell| lists[cell].push(i as u32));
                    }
                }
                Reach::Within(reach_sq) => {
                    let most = run.clone().map(reach_sq).fold(0.0, f64::max);
                    for (cell, list) in lists.iter_mut().enumerate() {
                        if gap(cell) <= most {
                            let is_near =
                                |&i: &usize| self.boxes[cell].distance_sq(point(i)) <= reach_sq(i);
                            list.extend(run.clone().filter(is_near).map(|i| i as u32));
                        }
                    }
                }
            }
        }
        lists
    }
}

/// Cells that points look into.
#[derive(Clone, Copy)]
pub(super) enum Reach<'a> {
    /// The one whose box is nearest.
    Home,
    /// All whose boxes are at most so far, squared.
    Within(&'a dyn Fn(usize) -> f64),
}

/// Places that points look for.
#[derive(Clone, Copy)]
enum Search {
    /// The nearest.
    Any,
    /// The nearest that faces the point's side.
    Facing,
}

impl Search {
    /// The nearest triangle at most `most_sq` away; `slot` is a guess.
    fn run(self, tree: &Tree, point: Vector, normal: Vector, most_sq: f64, slot: u32) -> Nearest {
        let within = Nearest { distance_sq: most_sq, ..Nearest::NONE };
        match self {
            Search::Any => {
                let guess = tree.guess(point, slot);
                tree.nearest(point, if guess.distance_sq <= most_sq { guess } else { within })
            }
            Search::Facing => {
                let faces =
                    |corners: &[Vector; 3]| dot(triangle::area_normal(corners), normal) > 0.0;
                let guess = tree.guess(point, slot);
                // The guess of another point may be on a triangle that faces away from this one.
                let is_usable = guess.distance_sq <= most_sq && faces(tree.corners(guess.slot));
                tree.nearest_where(point, if is_usable { guess } else { within }, faces)
            }
        }
    }
}

/// Cells in memory; the longest unused goes first.
pub(super) struct CellCache {
    budget_bytes: u64,
    uses: u64,
    held: BTreeMap<usize, (u64, Arc<Cell>)>,
}

impl CellCache {
    pub fn new(budget_bytes: u64) -> Self {
        CellCache { budget_bytes, uses: 0, held: BTreeMap::new() }
    }

    /// True if all cells stay in memory.
    pub fn holds_all(&self, original: &Original) -> bool {
        original.all_cells_bytes() <= self.budget_bytes
    }

    /// Loads as many of the cells from the first on as the budget holds; returns all that are in memory, by number.
    pub fn held_after(
        &mut self,
        original: &Original,
        wanted: &[usize],
        (threads, progress): (usize, &Progress),
    ) -> Result<Vec<Option<Arc<Cell>>>> {
        if !wanted.is_empty() {
            self.get(original, wanted, threads, progress)?;
        }
        let cell = |number| self.held.get(&number).map(|(_, cell)| cell.clone());
        Ok((0..original.boxes.len()).map(cell).collect())
    }

    /// As many of the cells from the first on as the budget holds together, at least one.
    pub fn get(
        &mut self,
        original: &Original,
        cells: &[usize],
        threads: usize,
        progress: &Progress,
    ) -> Result<Vec<Arc<Cell>>> {
        let mut sum = 0;
        let fits = |&&cell: &&usize| {
            sum += original.bytes(cell);
            sum <= self.budget_bytes
        };
        let n = cells.iter().take_while(fits).count().max(1).min(cells.len());
        let cells = &cells[..n];
        self.uses += 1;
        let mut missing = Vec::new();
        for cell in cells {
            match self.held.get_mut(cell) {
                Some((used, _)) => *used = self.uses,
                None => missing.push(*cell),
            }
        }
        let wanted: u64 = missing.iter().map(|&cell| original.bytes(cell)).sum();
        let mut there: u64 = self.held.keys().map(|&cell| original.bytes(cell)).sum();
        while there + wanted > self.budget_bytes {
            let idle = self.held.iter().filter(|(_, (used, _))| *used < self.uses);
            let Some((&cell, _)) = idle.min_by_key(|(cell, (used, _))| (*used, **cell)) else {
                break;
            };
            self.held.remove(&cell);
            there -= original.bytes(cell);
        }
        in_order(
            missing.len() as u64,
            threads,
            progress,
            |i, out: &mut Option<Cell>| {
                *out = Some(original.load(missing[i as usize], progress)?);
                Ok(())
            },
            |i, cell| {
                if let Some(cell) = cell.take() {
                    self.held.insert(missing[i as usize], (self.uses, Arc::new(cell)));
                }
                Ok(())
            },
        )?;
        Ok(cells.iter().filter_map(|cell| self.held.get(cell)).map(|(_, c)| c.clone()).collect())
    }
}
