//! Prices the removal of small components: the squared error that it makes, integrated.
//!
//! A component that vanishes leaves its own area at its distance from what stays, however small it was. So its
//! removal costs the integral of the squared distance over its area, in the currency of `price`. Distances
//! are to larger components only, so that of a cloud of crumbs far off the largest stays. A removed component
//! hands its area on to the one it was nearest to: if that goes too, both are as far off as that one was.
//!
//! Found for the surface as it is between two levels, when the first component is about to vanish: meshes
//! without small components pay nothing. Memory: 4 bytes a vertex and 16 a cell, of which there are at most as
//! many as vertices; less than the first level has freed.
//!
//! Candidates are found in a pyramid of grids, from the finest on; each cell knows one vertex of its largest
//! component. The distance is to the triangles around the candidate, an upper bound of the true one.
//!
//! docs/algorithm.md, section 6.

use crate::surface::Surface;
use crate::vertex::GONE;
use stonecut_mesh::bounds::Bounds;
use stonecut_mesh::union_find::Union;
use stonecut_mesh::vec3::{Vec3, length_sq, normal, sub, triangle_distance_sq};

/// Every 16th triangle tells how large they are.
const AREA_STRIDE: usize = 16;
/// Cells along each axis: 2^21, so that three numbers fit into a key.
const AXIS_BITS: u32 = 21;
/// Components of more vertices do not come down to a few triangles within one level.
const MAX_SMALL: u32 = 512;
/// A candidate that was merged is followed over this many mergers.
const LONGEST_WAY: usize = 4096;

/// Cost of the dearest collapse over mean squared error times mean area of a triangle: `COST_PER_ERROR` of
/// `topology` times what the error of all gains by two triangles less, three times its mean for each.
const COST_PER_SQUARE: f64 = 42.0;
/// Length in cells above which triangles are looked at in parts.
const LONG: f64 = 4.0;
/// Components farther from others than this many root mean square errors are held, for the sake of the largest
/// error, ...
const FAR: f64 = 30.0;
/// ... but no more than one triangle in this many.
const HELD_SHARE: u64 = 128;
/// Root mean square errors by which a rim may recede at once.
const FAR_FOR_RIMS: f64 = 8.0;

/// A vertex of the largest component in a cell.
#[derive(Clone, Copy)]
struct Cell {
    key: u64,
    rank: u32,
    vertex: u32,
}

/// The error of a removal, and the component that stays nearest.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Removal {
    /// Rank of the component.
    rank: u32,
    /// Rank of the one that stays nearest to it.
    nearest: u32,
    /// Its own area and that of those whose removal it answers for, scaled.
    area: f64,
    /// Integral of the squared distance over that area, in scaled units^4.
    pub(crate) error: f64,
    /// The same over its own area.
    pub(crate) own_error: f64,
    /// Squared distance of its farthest corner, in scaled units^2.
    pub(crate) farthest_sq: f64,
}

/// Components, and where they lie.
#[derive(Clone)]
pub(crate) struct SmallComponents {
    /// For each vertex the rank of its component: 0 the smallest.
    rank: Vec<u32>,
    /// Area of components that were removed next to it, scaled, by rank.
    ghosts: Vec<f64>,
    /// True if it was removed, by rank.
    is_gone: Vec<bool>,
    /// Effect of its removal, once it is known, by rank.
    known: Vec<Option<Removal>>,
    /// Lower bound of the error of its removal, by rank.
    least_error: Vec<f64>,
    origin: [f64; 3],
    /// Of the finest cells, 1 / side, in input units.
    to_cell: f64,
    /// From the finest grid to one cell, each in the order of the keys.
    grids: Vec<Vec<Cell>>,
    /// Area of the surface when it was looked at, scaled.
    area: f64,
    /// True if it may come down to a few triangles before the surface is looked at again, by rank.
    is_small: Vec<bool>,
    /// True if it is held for its distance, by rank; and the number of triangles of those.
    is_held: Vec<bool>,
    n_held: u64,
}

/// The cost of collapses that make 1 / `FAR` of a distance, in scaled units, where the whole area is this.
pub(crate) fn cost_of_distance(area: f64, surface: &Surface, distance_sq: f64) -> f32 {
    cost_of_square(area, surface, distance_sq / (FAR * FAR))
}

/// The same for the distance by which a rim recedes.
pub(crate) fn cost_of_recession(area: f64, surface: &Surface, distance_sq: f64) -> f32 {
    cost_of_square(area, surface, distance_sq / (FAR_FOR_RIMS * FAR_FOR_RIMS))
}

/// The cost of collapses at this mean squared error.
fn cost_of_square(area: f64, surface: &Surface, error_sq: f64) -> f32 {
    (COST_PER_SQUARE * area / surface.n_alive.max(1) as f64 * error_sq) as f32
}

/// The area of what is left, in scaled units.
pub(crate) fn whole_area(surface: &Surface) -> f64 {
    surface.triangles.iter().filter(|t| t[0] != GONE).map(|t| area_of(surface, t)).sum()
}

impl SmallComponents {
    /// Finds the components of what is left of a surface; larger ones have more vertices.
    pub(crate) fn new(surface: &Surface) -> Self {
        Self::ranked(surface, ranks(surface, None))
    }

    /// The same; larger ones have more area, since a large floor that is flat comes down to a few vertices.
    pub(crate) fn by_area(surface: &Surface) -> Self {
        let mut area = vec![0.0; surface.vertices.len()];
        for t in surface.triangles.iter().filter(|t| t[0] != GONE) {
            area[t[0] as usize] += area_of(surface, t);
        }
        Self::ranked(surface, ranks(surface, Some(&area)))
    }

    fn ranked(surface: &Surface, (rank, sizes): (Vec<u32>, Vec<u32>)) -> Self {
        let n_ranks = sizes.len();
        let mut bounds = Bounds::EMPTY;
        for (vertex, _) in surface.vertices.iter().zip(&rank).filter(|(_, rank)| **rank != GONE) {
            bounds.add(vertex.position);
        }
        let some = surface.triangles.iter().step_by(AREA_STRIDE).filter(|t| t[0] != GONE);
        let (area, n) = some.fold((0.0, 0u32), |(area, n), t| (area + area_of(surface, t), n + 1));
        let mean = area / f64::from(n.max(1));
        let extent = bounds.side();
        // An edge long, if the keys have bits enough.
        let least = extent / f64::from((1u32 << AXIS_BITS) - 2);
        let side = ((2.0 * mean).sqrt() * surface.unscale).max(least).max(f64::MIN_POSITIVE);
        let mut small_components = SmallComponents {
            rank,
            ghosts: vec![0.0; n_ranks],
            is_gone: vec![false; n_ranks],
            known: vec![None; n_ranks],
            least_error: vec![0.0; n_ranks],
            origin: bounds.low,
            to_cell: 1.0 / side,
            grids: Vec::new(),
            area: mean * surface.n_alive as f64,
            is_small: sizes.iter().map(|&n| n <= MAX_SMALL).collect(),
            is_held: vec![false; n_ranks],
            n_held: 0,
        };
        small_components.build(surface);
        small_components
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

    /// Returns whether the component of a vertex may have become small; what a cut has added may be.
    pub(crate) fn is_small(&self, v: u32) -> bool {
        let rank = self.rank.get(v as usize).copied().unwrap_or(GONE);
        self.is_small.get(rank as usize).copied().unwrap_or(true)
    }

    /// Finds what the removal of a component does, given by all of its triangles; `None` if nothing larger would
    /// stay, or if its error is above `limit` for certain.
    pub(crate) fn removal(
        &mut self,
        surface: &Surface,
        triangles: &[u32],
        limit: f64,
    ) -> Option<Removal> {
        let first = surface.triangles[*triangles.first()? as usize][0];
        // What a cut has made since has no rank; `cut` removes it at once or not at all.
        let rank = *self.rank.get(first as usize)?;
        if rank == GONE || rank as usize + 1 >= self.known.len() {
            return None;
        }
        let known = self.known[rank as usize];
        if known.is_some_and(|removal| !self.is_gone[removal.nearest as usize]) {
            return known;
        }
        // Distances grow while others vanish, so what was too far stays so.
        if self.least_error[rank as usize] > limit {
            return None;
        }
        self.least_error[rank as usize] = self.least_error(surface, triangles, rank)?;
        if self.least_error[rank as usize] > limit {
            return None;
        }
        self.known[rank as usize] = self.find(surface, triangles, rank);
        self.known[rank as usize]
    }

    /// A lower bound of the error of a removal from the distance of one corner: the others are nearer by the
    /// extent of the component at most.
    fn least_error(&self, surface: &Surface, triangles: &[u32], rank: u32) -> Option<f64> {
        let first = surface.triangles[triangles[0] as usize][0];
        let (mut area, mut extent_sq) = (self.ghosts[rank as usize], 0.0f32);
        for &t in triangles {
            let t = &surface.triangles[t as usize];
            area += area_of(surface, t);
            for &v in t {
                extent_sq = extent_sq.max(length_sq(surface.edge(first, v)));
            }
        }
        let (distance_sq, _) =
            self.nearest(surface, surface.vertices[first as usize].position, rank)?;
        let left = distance_sq.sqrt() * surface.scale - f64::from(extent_sq).sqrt();
        Some(area * left.max(0.0).powi(2))
    }

    /// Share of the surface's area that a component has.
    pub(crate) fn share(&self, removal: Removal) -> f64 {
        (removal.area - self.ghosts[removal.rank as usize]) / self.area
    }

    /// Notes that a component was removed: the nearest one answers for its area from now on.
    pub(crate) fn removed(&mut self, removal: Removal, n_triangles: usize) {
        self.is_gone[removal.rank as usize] = true;
        if self.is_held[removal.rank as usize] {
            self.n_held = self.n_held.saturating_sub(n_triangles as u64);
        }
        self.ghosts[removal.nearest as usize] += removal.area;
        self.known[removal.nearest as usize] = None;
    }

    /// The least cost at which a component may go for its distance alone, in scaled units: that of collapses
    /// which make 1 / `FAR` of it. 0 for those beyond the few that are held for that.
    pub(crate) fn hold_cost(
        &mut self,
        surface: &Surface,
        removal: Removal,
        n_triangles: usize,
    ) -> f32 {
        let rank = removal.rank as usize;
        let n_held = self.n_held + n_triangles as u64;
        if !self.is_held[rank] && n_held * HELD_SHARE <= surface.n_alive {
            self.is_held[rank] = true;
            self.n_held = n_held;
        }
        let cost = cost_of_distance(self.area, surface, removal.farthest_sq);
        if self.is_held[rank] { cost } else { 0.0 }
    }

    fn find(&self, surface: &Surface, triangles: &[u32], rank: u32) -> Option<Removal> {
        let mut corners: Vec<(u32, f64)> = Vec::new();
        let (mut area, mut error, mut farthest_sq) = (0.0, 0.0, 0.0f64);
        let mut nearest = (f64::INFINITY, GONE);
        for &t in triangles {
            let t = &surface.triangles[t as usize];
            let own = area_of(surface, t);
            let mut at_corners = 0.0;
            for &v in t {
                let known =
                    corners.iter().find(|(w, _)| *w == v).map(|&(_, distance_sq)| distance_sq);
                let distance_sq = match known {
                    Some(distance_sq) => distance_sq,
                    None => {
                        let (distance_sq, other) =
                            self.nearest(surface, surface.vertices[v as usize].position, rank)?;
                        corners.push((v, distance_sq));
                        farthest_sq = farthest_sq.max(distance_sq);
                        if distance_sq < nearest.0 {
                            nearest = (distance_sq, other);
                        }
                        distance_sq
                    }
                };
                at_corners += distance_sq;
            }
            // Corners alone would not see how far off the middle of a large triangle is.
            let places = t.map(|v| surface.vertices[v as usize].position);
            let points = points_of(places, self.to_cell);
            let mut inside = 0.0;
            for &point in &points {
                let (distance_sq, _) = self.nearest(surface, point, rank)?;
                farthest_sq = farthest_sq.max(distance_sq);
                inside += distance_sq;
            }
            error += own
                * match points.len() {
                    // Exact where the squared distance is quadratic, as it is from a plane.
                    1 => at_corners / 12.0 + 0.75 * inside,
                    n => inside / n as f64,
                };
            area += own;
        }
        let to_scaled = surface.scale * surface.scale;
        let ghosts = self.ghosts[rank as usize];
        let mean = if area > 0.0 { error / area } else { 0.0 };
        Some(Removal {
            rank,
            nearest: nearest.1,
            area: area + ghosts,
            error: (error + ghosts * mean) * to_scaled,
            own_error: error * to_scaled,
            farthest_sq: farthest_sq * to_scaled,
        })
    }

    /// Squared distance of a place from a larger component, in input units, and the rank of that; `None` if
    /// there is none.
    fn nearest(&self, surface: &Surface, place: Vec3, rank: u32) -> Option<(f64, u32)> {
        for (level, cells) in self.grids.iter().enumerate() {
            let key = self.key(place, level);
            let mut nearest = (f64::INFINITY, GONE, GONE);
            let larger = |cell: &&Cell| cell.rank > rank && !self.is_gone[cell.rank as usize];
            for cell in neighbours(cells, key).filter(larger) {
                let Some(v) = survivor(surface, cell.vertex) else { continue };
                let off = length_sq(sub(surface.vertices[v as usize].position, place));
                if off < nearest.0 {
                    nearest = (off, cell.rank, v);
                }
            }
            if nearest.1 != GONE {
                let around = surface.ring(nearest.2).iter();
                let to_triangle = |&t: &u32| {
                    let corners = surface.triangles[t as usize];
                    if corners[0] == GONE {
                        return f64::INFINITY;
                    }
                    triangle_distance_sq(
                        place,
                        corners.map(|v| surface.vertices[v as usize].position),
                    )
                };
                return Some((around.map(to_triangle).fold(nearest.0, f64::min), nearest.1));
            }
        }
        None
    }
}

/// Centroids of the parts of a triangle, none of which is much longer than `LONG` cells; 16 parts at most.
fn points_of(corners: [Vec3; 3], to_cell: f64) -> Vec<Vec3> {
    let [a, b, c] = corners;
    let longest_sq = length_sq(sub(b, a)).max(length_sq(sub(c, b))).max(length_sq(sub(a, c)));
    let n = [1u32, 2].into_iter().find(|&n| longest_sq.sqrt() * to_cell <= LONG * f64::from(n));
    let n = n.unwrap_or(4);
    let at = |u: f64, v: f64| -> Vec3 {
        std::array::from_fn(|k| a[k] + u * (b[k] - a[k]) + v * (c[k] - a[k]))
    };
    let mut points = Vec::with_capacity((n * n) as usize);
    for i in 0..n {
        for j in 0..n - i {
            let place = |third: f64| {
                let part = |i: u32| (f64::from(i) + third / 3.0) / f64::from(n);
                at(part(i), part(j))
            };
            points.push(place(1.0));
            if i + j + 1 < n {
                points.push(place(2.0));
            }
        }
    }
    points
}

/// The vertex that a vertex has been merged into, if it still has triangles.
fn survivor(surface: &Surface, mut v: u32) -> Option<u32> {
    for _ in 0..LONGEST_WAY {
        let ring = &surface.rings[v as usize];
        if ring.class.is_some() {
            return (ring.len > 0).then_some(v);
        }
        v = ring.start;
    }
    None
}

/// Area of a triangle, in scaled units.
pub(crate) fn area_of(surface: &Surface, t: &[u32; 3]) -> f64 {
    let edge = |v: u32| surface.edge(t[0], v).map(f64::from);
    0.5 * length_sq(normal([[0.0; 3], edge(t[1]), edge(t[2])])).sqrt()
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

/// For each vertex the rank of its component, `GONE` if it is gone; and the numbers of vertices by rank. The rank is by
/// these numbers, or by the sums of what is given for each vertex, which is not negative.
fn ranks(surface: &Surface, weights: Option<&[f64]>) -> (Vec<u32>, Vec<u32>) {
    let mut rank = components(surface);
    let mut size = vec![0u32; rank.len()];
    let mut weight = vec![0.0; weights.map_or(0, <[f64]>::len)];
    for (v, (root, ring)) in rank.iter_mut().zip(&surface.rings).enumerate() {
        if ring.class.is_some() && ring.len > 0 {
            size[*root as usize] += 1;
            if let Some(weights) = weights {
                weight[*root as usize] += weights[v];
            }
        } else {
            *root = GONE;
        }
    }
    let sizes = size.iter().zip(0..).filter(|(n, _)| **n > 0);
    // The bits of numbers that are not negative are in their order.
    let weight_of = |v: u32| weight.get(v as usize).map_or(0, |weight: &f64| weight.to_bits());
    let mut by_size: Vec<(u64, u32, u32)> = sizes.map(|(&n, v)| (weight_of(v), n, v)).collect();
    by_size.sort_unstable();
    for (&(_, _, v), rank) in by_size.iter().zip(0..) {
        size[v as usize] = rank;
    }
    for rank in rank.iter_mut().filter(|root| **root != GONE) {
        *rank = size[*rank as usize];
    }
    (rank, by_size.into_iter().map(|(_, n, _)| n).collect())
}
