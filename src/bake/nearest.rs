//! The nearest place of the original for many points, cell by cell.
//!
//! A point looks in the cell whose box it is in, then in every cell whose box is not farther than what was found: the
//! answer is exact, whatever the cells. Where the nearest place faces away from the point's own side, as through a thin
//! wall, the nearest place that faces it is taken instead, if that is not much farther.

use super::original::{Cell, Hit, Original};
use crate::error::Result;
use crate::measure::tree::{Nearest, Tree};
use crate::measure::triangle::{self, Vector};
use crate::mesh::bounds::Bounds;
use crate::mesh::vec3::dot;
use crate::system::parallel::in_order;
use crate::system::progress::Progress;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Points that are held against the boxes together.
const RUN: usize = 256;

/// Points that a thread takes at a time.
const BLOCK: usize = 2048;

/// Points of the result that look for a place.
pub(super) trait Seekers: Sync {
    fn n(&self) -> usize;
    fn point(&self, i: usize) -> Vector;
    /// Normal of the surface that the point is on, of any length.
    fn normal(&self, i: usize) -> Vector;
    /// A place that faces the point may be this much farther than the nearest one.
    fn grace(&self, i: usize) -> f64;
}

impl Original {
    /// Finds a place for each point; best given in an order that keeps neighbours together.
    ///
    /// Memory: 80 bytes a point, and cells within `cell_bytes`, one at least.
    pub fn nearest(
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
        drop(others);
        // Only those whose nearest place faces away look on.
        let turned: Vec<u32> = (0..n as u32).filter(|&i| !hits[i as usize].faces).collect();
        if turned.is_empty() {
            return Ok(hits);
        }
        let limit_sq = |i: usize| {
            let limit = hits[i].distance_sq.sqrt() + seekers.grace(i);
            limit * limit
        };
        let limits: Vec<f64> = turned.iter().map(|&i| limit_sq(i as usize)).collect();
        let point = |i: usize| seekers.point(turned[i] as usize);
        let mut lists = self.lists(turned.len(), point, Reach::Within(&|i| limits[i]));
        lists.iter_mut().flatten().for_each(|query| *query = turned[*query as usize]);
        let mut facing = vec![Hit::NONE; n];
        for (&i, &limit_sq) in turned.iter().zip(&limits) {
            facing[i as usize].distance_sq = limit_sq;
        }
        self.visit(&lists, seekers, Search::Facing, &mut facing, cells, means)?;
        for &i in &turned {
            let better = facing[i as usize];
            if better.faces {
                hits[i as usize] = better;
            }
        }
        Ok(hits)
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
                                out.push((query, self.hit(cell, nearest, point, normal)));
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

    /// For each cell the points that may find their place there.
    fn lists(&self, n: usize, point: impl Fn(usize) -> Vector, reach: Reach) -> Vec<Vec<u32>> {
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
enum Reach<'a> {
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
            Search::Facing => tree.nearest_where(point, within, |corners| {
                dot(triangle::area_normal(corners), normal) > 0.0
            }),
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

    /// As many of the cells from the first on as the budget holds together, at least one.
    fn get(
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
