//! Triangles of a chart that lie over others, found on a grid.
//!
//! A triangle is held against those in the cells that it touches, and against those at the same hub by their sectors
//! (`sectors`).

use super::sectors::{Sectors, sector};
use super::settings::NONE;
use std::collections::HashMap;
use std::ops::Range;
use stonecut_mesh::steps::count;

/// Cells of the grid of a chart along a side, at most.
const MOST_GRID: f64 = 512.0;

/// Triangles may overlap by this share of the chart.
const TOLERANCE: f64 = 1e-6;

/// Part of a cell by which rounding may move a triangle.
const MARGIN: f64 = 1e-6;

/// Triangles of a chart by place.
pub(super) struct Grid {
    low: [f64; 2],
    /// Cells for a unit of length.
    scale: f64,
    size: [usize; 2],
    cells: Vec<Vec<u32>>,
    /// Triangles at hubs by cell, each hub's for itself.
    of_hubs: HashMap<usize, Vec<(u32, Vec<u32>)>>,
    sectors: Sectors,
    /// Length by which triangles may overlap.
    tolerance: f64,
}

impl Grid {
    /// A grid for triangles that lie within the box around these.
    pub(super) fn around(all: &[[[f64; 2]; 3]]) -> Grid {
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for p in all.iter().flatten() {
            low = [low[0].min(p[0]), low[1].min(p[1])];
            high = [high[0].max(p[0]), high[1].max(p[1])];
        }
        let extent = [0, 1].map(|k| high[k] - low[k]);
        let longest = extent[0].max(extent[1]);
        let side = (extent[0] * extent[1] / all.len() as f64).sqrt().max(longest / MOST_GRID);
        let scale = if side > 0.0 && side.is_finite() { 1.0 / side } else { 0.0 };
        let size = extent.map(|extent| 1 + (extent * scale) as usize);
        Grid {
            low,
            scale,
            size,
            cells: vec![Vec::new(); size[0] * size[1]],
            of_hubs: HashMap::new(),
            sectors: Sectors::default(),
            tolerance: TOLERANCE * longest,
        }
    }

    /// Adds the triangle of this number if it does not overlap one that was added before; `hub` is a vertex that thousands
    /// may have in common, and its place among the corners.
    pub(super) fn take(
        &mut self,
        number: u32,
        (hub, corner): (u32, u8),
        all: &[[[f64; 2]; 3]],
    ) -> bool {
        let flat = &all[number as usize];
        let overlaps = |others: &[u32]| {
            others.iter().any(|&other| overlap(flat, &all[other as usize], self.tolerance))
        };
        let own = if hub == NONE { [0.0; 2] } else { sector(flat, corner) };
        if hub != NONE && !self.sectors.is_free(hub, own) {
            return false;
        }
        let at = flat.map(|p| [0, 1].map(|k| (p[k] - self.low[k]) * self.scale));
        let mut n = 0;
        for y in self.rows(&at) {
            for x in self.columns(&at, y) {
                let cell = y * self.size[0] + x;
                n += 1 + self.cells[cell].len();
                let mut of_hubs = self.of_hubs.get(&cell).into_iter().flatten();
                if overlaps(&self.cells[cell])
                    || of_hubs.any(|(other, list)| *other != hub && overlaps(list))
                {
                    count(n);
                    return false;
                }
            }
        }
        count(n);
        for y in self.rows(&at) {
            for x in self.columns(&at, y) {
                let cell = y * self.size[0] + x;
                if hub == NONE {
                    self.cells[cell].push(number);
                    continue;
                }
                let of_hubs = self.of_hubs.entry(cell).or_default();
                match of_hubs.iter_mut().find(|(other, _)| *other == hub) {
                    Some((_, list)) => list.push(number),
                    None => of_hubs.push((hub, vec![number])),
                }
            }
        }
        if hub != NONE {
            self.sectors.take(hub, own);
        }
        true
    }

    /// The rows that a triangle touches, in cells.
    fn rows(&self, at: &[[f64; 2]; 3]) -> Range<usize> {
        let [a, b, c] = at.map(|p| p[1]);
        let row = |y: f64| (y as usize).min(self.size[1] - 1);
        row(a.min(b).min(c) - MARGIN)..row(a.max(b).max(c) + MARGIN) + 1
    }

    /// The columns that a triangle touches in a row: a needle touches few cells of its box.
    fn columns(&self, at: &[[f64; 2]; 3], row: usize) -> Range<usize> {
        let (low, high) = (row as f64 - MARGIN, (row + 1) as f64 + MARGIN);
        let (mut first, mut last) = (f64::INFINITY, f64::NEG_INFINITY);
        for k in 0..3 {
            let (a, b) = (at[k], at[(k + 1) % 3]);
            let (a, b) = if a[1] <= b[1] { (a, b) } else { (b, a) };
            if b[1] < low || a[1] > high {
                continue;
            }
            let down = b[1] - a[1];
            let along = |y: f64| a[0] + ((y - a[1]) / down).clamp(0.0, 1.0) * (b[0] - a[0]);
            let ends = if down > MARGIN { [along(low), along(high)] } else { [a[0], b[0]] };
            (first, last) = (first.min(ends[0]).min(ends[1]), last.max(ends[0]).max(ends[1]));
        }
        let column = |x: f64| (x as usize).min(self.size[0] - 1);
        if first <= last { column(first - MARGIN)..column(last + MARGIN) + 1 } else { 0..0 }
    }
}

/// Twice the area of a triangle in its plane; negative where its corners run the other way.
pub(super) fn twice_area(t: &[[f64; 2]; 3]) -> f64 {
    let [a, b, c] = t;
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

/// True if the insides of two triangles meet by more than `tolerance`: no edge of either has the other one beyond it.
fn overlap(a: &[[f64; 2]; 3], b: &[[f64; 2]; 3], tolerance: f64) -> bool {
    let is_apart = |a: &[[f64; 2]; 3], b: &[[f64; 2]; 3]| {
        let sense = twice_area(a).signum();
        (0..3).any(|k| {
            let (p, q) = (a[k], a[(k + 1) % 3]);
            let edge = [q[0] - p[0], q[1] - p[1]];
            let limit = tolerance * (edge[0] * edge[0] + edge[1] * edge[1]).sqrt();
            let beyond = |r: [f64; 2]| sense * (edge[0] * (r[1] - p[1]) - edge[1] * (r[0] - p[0]));
            b.iter().all(|&r| beyond(r) <= limit)
        })
    };
    !is_apart(a, b) && !is_apart(b, a)
}
