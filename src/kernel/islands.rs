//! How far each component lies from the nearest one that is larger.
//!
//! A component that vanishes leaves an error as large as its distance from what stays, however small it was
//! itself. So it costs what moving surface that far does, and `drain` lets it go when collapses cost as
//! much. Larger ones count only, so that of a cloud of crumbs far off the largest stays, not none.
//!
//! Found for the surface as it is between two levels, when the first component is about to vanish: meshes
//! without specks pay nothing. Memory: 4 bytes a vertex and 16 a cell, of which there are at most as many
//! as vertices; less than the first level has freed.
//!
//! Cells of a pyramid of grids are looked through from the finest on; each knows one vertex of its largest
//! component. Distances come out too large by a side of such a cell at most.

use super::surface::{GONE, Surface};
use super::vector::{length_sq, normal, sub};
use crate::union::Union;

/// A component may go once the error that collapses make is this share of its distance.
const NEAR_SHARE: f64 = 0.3;
/// One in so many triangles tells how large they are.
const AREA_STRIDE: usize = 16;
/// Cells along each axis: 2^21, so that three numbers fit into a key.
const AXIS_BITS: u32 = 21;

/// A vertex of the largest component in a cell.
#[derive(Clone, Copy)]
struct Cell {
    key: u64,
    rank: u32,
    vertex: u32,
}

/// Components, and where they lie.
pub(crate) struct Islands {
    /// For each vertex the rank of its component: 0 the smallest.
    rank: Vec<u32>,
    n_ranks: u32,
    /// What it costs that a component vanishes, by rank, in scaled units; NaN if nobody has asked yet.
    due: Vec<f32>,
    origin: [f64; 3],
    /// Of the finest cells, 1 / side, in input units.
    to_cell: f64,
    /// From the finest grid to one cell, each in the order of the keys.
    grids: Vec<Vec<Cell>>,
    /// Mean area around a vertex, scaled.
    ring_area: f64,
}

impl Islands {
    /// Finds the components of what is left of a surface.
    pub(crate) fn new(surface: &Surface) -> Self {
        let (rank, n_ranks) = ranks(surface);
        let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for (vertex, _) in surface.vertices.iter().zip(&rank).filter(|(_, rank)| **rank != GONE) {
            for axis in 0..3 {
                low[axis] = low[axis].min(vertex.position[axis]);
                high[axis] = high[axis].max(vertex.position[axis]);
            }
        }
        let (mut area, mut n) = (0.0, 0u32);
        let some = surface.triangles.iter().step_by(AREA_STRIDE).filter(|t| t[0] != GONE);
        for t in some {
            let edge = |v: u32| surface.edge(t[0], v).map(f64::from);
            area += 0.5 * length_sq(normal([[0.0; 3], edge(t[1]), edge(t[2])])).sqrt();
            n += 1;
        }
        let mean = area / f64::from(n.max(1));
        let extent = (0..3).map(|axis| high[axis] - low[axis]).fold(0.0, f64::max);
        // An edge long, if the keys can tell so many cells apart.
        let least = extent / f64::from((1u32 << AXIS_BITS) - 2);
        let side = ((2.0 * mean).sqrt() * surface.unscale).max(least).max(f64::MIN_POSITIVE);
        let mut islands = Islands {
            rank,
            n_ranks,
            due: vec![f32::NAN; n_ranks as usize],
            origin: low,
            to_cell: 1.0 / side,
            grids: Vec::new(),
            ring_area: 6.0 * mean,
        };
        islands.build(surface);
        islands
    }

    fn build(&mut self, surface: &Surface) {
        let mut cells: Vec<Cell> = Vec::new();
        for (v, &rank) in self.rank.iter().enumerate().filter(|(_, rank)| **rank != GONE) {
            let key = self.key(surface.vertices[v].position, 0);
            match cells.last_mut() {
                // Most vertices lie in the cell of the one before.
                Some(last) if last.key == key && last.rank >= rank => {}
                _ => cells.push(Cell { key, rank, vertex: v as u32 }),
            }
        }
        while cells.len() > 1 {
            cells.sort_unstable_by_key(|cell| (cell.key, u32::MAX - cell.rank, cell.vertex));
            cells.dedup_by_key(|cell| cell.key);
            let coarser = cells.iter().map(|cell| Cell { key: halved(cell.key), ..*cell });
            let coarser = coarser.collect();
            self.grids.push(std::mem::replace(&mut cells, coarser));
            if self.grids.len() as u32 > AXIS_BITS {
                break;
            }
        }
    }

    fn key(&self, place: [f64; 3], level: usize) -> u64 {
        let at = |axis: usize| {
            (((place[axis] - self.origin[axis]) * self.to_cell) as u64).min((1 << AXIS_BITS) - 1)
                >> level
        };
        at(0) | at(1) << AXIS_BITS | at(2) << (2 * AXIS_BITS)
    }

    /// What it costs that a component vanishes, given by all of its triangles, in scaled units.
    pub(crate) fn due(&mut self, surface: &Surface, triangles: &[u32]) -> f32 {
        let corners = || triangles.iter().flat_map(|&t| surface.triangles[t as usize]);
        let Some(first) = corners().next() else { return 0.0 };
        // What was cut off since belongs to the rest, as far as is known, and lies near it.
        let Some(&rank) = self.rank.get(first as usize) else { return 0.0 };
        if rank >= self.n_ranks - 1 {
            return 0.0;
        }
        if self.due[rank as usize].is_nan() {
            // One end of a long one may touch what the other is far from.
            let off = |v: u32| length_sq(surface.edge(first, v));
            let last = corners().max_by(|&a, &b| off(a).total_cmp(&off(b))).unwrap_or(first);
            let [near, far] = [first, last].map(|v| self.distance(surface, v, rank));
            let error = near.max(far) * surface.scale * NEAR_SHARE;
            self.due[rank as usize] = (self.ring_area * error * error) as f32;
        }
        self.due[rank as usize]
    }

    /// Distance of a vertex from a larger component, in input units.
    fn distance(&self, surface: &Surface, v: u32, rank: u32) -> f64 {
        let place = surface.vertices[v as usize].position;
        for (level, cells) in self.grids.iter().enumerate() {
            let key = self.key(place, level);
            let mut nearest = f64::INFINITY;
            for cell in neighbours(cells, key).filter(|cell| cell.rank > rank) {
                let other = surface.vertices[cell.vertex as usize].position;
                nearest = nearest.min(length_sq(sub(other, place)));
            }
            if nearest < f64::INFINITY {
                return nearest.sqrt();
            }
        }
        0.0
    }
}

/// The cells around and at a key.
fn neighbours(cells: &[Cell], key: u64) -> impl Iterator<Item = &Cell> {
    const TOP: u64 = (1 << AXIS_BITS) - 1;
    let [x, y, z] = [0, 1, 2].map(|axis| key >> (axis * AXIS_BITS) & TOP);
    let around = |at: u64| at.saturating_sub(1)..=(at + 1).min(TOP);
    around(z).flat_map(move |z| {
        around(y).flat_map(move |y| {
            let row = y << AXIS_BITS | z << (2 * AXIS_BITS);
            let (first, last) = (*around(x).start() | row, *around(x).end() | row);
            let start = cells.partition_point(|cell| cell.key < first);
            cells[start..].iter().take_while(move |cell| cell.key <= last)
        })
    })
}

/// The key of the cell of twice the side.
fn halved(key: u64) -> u64 {
    const TOP: u64 = (1 << AXIS_BITS) - 1;
    let at = |axis: u32| (key >> (axis * AXIS_BITS) & TOP) >> 1;
    at(0) | at(1) << AXIS_BITS | at(2) << (2 * AXIS_BITS)
}

/// The least vertex of the component of each vertex.
pub(crate) fn components(surface: &Surface) -> Vec<u32> {
    let mut union = Union::new(surface.vertices.len());
    for t in surface.triangles.iter().filter(|t| t[0] != GONE) {
        union.join(t[0], t[1]);
        union.join(t[1], t[2]);
    }
    union.into_roots()
}

/// For each vertex the rank of its component by number of vertices, `GONE` if it is gone, and how many
/// components there are.
fn ranks(surface: &Surface) -> (Vec<u32>, u32) {
    let mut rank = components(surface);
    let mut size = vec![0u32; rank.len()];
    for (root, ring) in rank.iter_mut().zip(&surface.rings) {
        if ring.class.is_some() && ring.len > 0 {
            size[*root as usize] += 1;
        } else {
            *root = GONE;
        }
    }
    let sizes = size.iter().zip(0..).filter(|(n, _)| **n > 0);
    let mut by_size: Vec<(u32, u32)> = sizes.map(|(&n, v)| (n, v)).collect();
    by_size.sort_unstable();
    for (&(_, v), rank) in by_size.iter().zip(0..) {
        size[v as usize] = rank;
    }
    for rank in rank.iter_mut().filter(|root| **root != GONE) {
        *rank = size[*rank as usize];
    }
    (rank, by_size.len() as u32)
}
