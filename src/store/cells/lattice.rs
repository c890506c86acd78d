//! The lattice of a tree of tiles: boxes that nest, and groups of eight boxes around every second corner.
//!
//! A box of level `r` has sides of `2^r` boxes of level 0. A group of round `r` holds the eight boxes of level `r`
//! around a corner that is one of level `r + 1` too: so its border runs through planes that are borders of boxes
//! below that level, and lies inside the groups of all other rounds. Everything is decided on integers.
//!
//! docs/design/tiles.md.

use super::kd_tree::floor;
use crate::cell_id::CellId;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use stonecut_mesh::bounds::Bounds;

/// Binary logarithm of the steps along a side of a box.
const STEPS: u32 = 14;

/// Boxes along the longest side of the bounds, at most, so that coordinates fit into 31 bits.
const MOST_BOXES: f64 = 32_768.0;

/// Sides of boxes that are tried differ by this factor.
const FINER: f64 = 0.917_004_043_204_671_2; // 2^(-1/8)

/// A group with fewer samples than this joins a neighbour that has more: a 64th of a full one.
const FEW_SAMPLES: u64 = 16;

/// Number of a box of some level, or of a group of some round, along each axis.
pub type BoxKey = [i32; 3];

/// Integer coordinates around the middle of a mesh.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Lattice {
    /// Place of coordinate 0 of all axes: a corner of boxes of every level.
    pub origin: [f64; 3],
    /// Length of a step of level 0, in input units.
    pub step: f64,
}

impl Lattice {
    /// The lattice whose boxes of level 0 hold about `tile_triangles`, by a sample of the vertices: the mean over
    /// triangles of how many are in the same box.
    pub fn choose(
        bounds: Bounds,
        samples: &[[f64; 3]],
        n_triangles: u64,
        tile_triangles: u64,
    ) -> Lattice {
        let origin = bounds.middle();
        let extent = (0..3).map(|k| bounds.high[k] - bounds.low[k]).fold(0.0, f64::max);
        let widest = if extent > 0.0 && extent.is_finite() { extent } else { 1.0 };
        let with = |side: f64| Lattice { origin, step: side / f64::from(1u32 << STEPS) };
        let wanted = tile_triangles as f64 / n_triangles.max(1) as f64 * samples.len() as f64;
        let mut side = widest;
        while side > widest / MOST_BOXES {
            let lattice = with(side);
            let mut counts: BTreeMap<BoxKey, u64> = BTreeMap::new();
            for &point in samples {
                *counts.entry(lattice.box_of(0, point)).or_default() += 1;
            }
            let squares: u64 = counts.values().map(|n| n * n).sum();
            if squares as f64 <= wanted * samples.len() as f64 {
                break;
            }
            side *= FINER;
        }
        with(side)
    }

    /// Length of a step of a level.
    pub fn step_of(&self, level: u32) -> f64 {
        self.step * (1u64 << level) as f64
    }

    /// Integer coordinates of a point, in steps of level 0.
    #[inline]
    pub fn key(&self, point: [f64; 3]) -> [i32; 3] {
        [0, 1, 2].map(|k| floor((point[k] - self.origin[k]) / self.step))
    }

    /// The box of a level that a point lies in.
    #[inline]
    pub fn box_of(&self, level: u32, point: [f64; 3]) -> BoxKey {
        self.key(point).map(|x| x >> (STEPS + level))
    }

    /// The box of the level below that the middle of a triangle lies in, given its corners in steps of a level.
    pub fn box_below(corners: [[i32; 3]; 3]) -> BoxKey {
        let [a, b, c] = corners.map(|p| p.map(i64::from));
        [0, 1, 2].map(|k| ((a[k] + b[k] + c[k]).div_euclid(3) >> (STEPS - 1)) as i32)
    }

    /// The nearest point of the lattice of a level, in its steps.
    pub fn nearest(&self, level: u32, point: [f64; 3]) -> [i32; 3] {
        let step = self.step_of(level);
        [0, 1, 2].map(|k| floor((point[k] - self.origin[k]) / step + 0.5))
    }
}

/// The box of the next level that a box lies in.
pub fn parent_of(key: BoxKey) -> BoxKey {
    key.map(|x| x >> 1)
}

/// The group of round `r` that a box of level `r` belongs to.
pub fn group_of(key: BoxKey) -> BoxKey {
    key.map(|x| (x + 1) >> 1)
}

/// Brings a box of level `r` into a group of round `r`.
pub fn clamp_to(group: BoxKey, key: BoxKey) -> BoxKey {
    [0, 1, 2].map(|k| key[k].clamp(2 * group[k] - 1, 2 * group[k]))
}

/// Brings a box of level `r - 1` into a group of round `r`.
pub fn clamp_below(group: BoxKey, key: BoxKey) -> BoxKey {
    [0, 1, 2].map(|k| key[k].clamp(4 * group[k] - 2, 4 * group[k] + 1))
}

/// The groups of the first round as cells, in the order of their numbers.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct GroupGrid {
    /// The lattice they belong to.
    pub lattice: Lattice,
    /// The groups, sorted; a cell for each.
    pub groups: Vec<BoxKey>,
}

impl GroupGrid {
    /// The groups of round 1 that hold samples. Those with few join a neighbour.
    pub fn new(lattice: Lattice, samples: &[[f64; 3]]) -> GroupGrid {
        let mut counts: BTreeMap<BoxKey, u64> = BTreeMap::new();
        for &point in samples {
            *counts.entry(group_of(lattice.box_of(1, point))).or_default() += 1;
        }
        let is_full = |key: &BoxKey| counts.get(key).is_some_and(|&n| n >= FEW_SAMPLES);
        let near = |key: &BoxKey| {
            (0..27).any(|i| {
                let off = [i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1];
                is_full(&[0, 1, 2].map(|k| key[k] + off[k]))
            })
        };
        let mut groups: Vec<BoxKey> =
            counts.keys().filter(|key| is_full(key) || !near(key)).copied().collect();
        if groups.is_empty() {
            groups.push([0; 3]);
        }
        GroupGrid { lattice, groups }
    }

    /// For many points one after the other.
    pub fn finder(&self) -> GroupFinder<'_> {
        GroupFinder { grid: self, last: None, strays: BTreeMap::new() }
    }

    /// The group nearest to one that has no cell; of equally near ones the first.
    fn nearest(&self, key: BoxKey) -> CellId {
        let off_sq = |group: &BoxKey| -> i64 {
            (0..3).map(|k| (i64::from(group[k]) - i64::from(key[k])).pow(2)).sum()
        };
        let cells = CellId::first(self.groups.len());
        let nearest = cells.zip(&self.groups).min_by_key(|(_, group)| off_sq(group));
        nearest.map_or(CellId(0), |(cell, _)| cell)
    }
}

/// Finds cells of points; fast where a point lies in the group of the one before.
#[derive(Clone, Debug)]
pub struct GroupFinder<'a> {
    grid: &'a GroupGrid,
    last: Option<(BoxKey, CellId)>,
    /// Cells of groups that have none.
    strays: BTreeMap<BoxKey, CellId>,
}

impl GroupFinder<'_> {
    /// The cell of a point.
    #[inline]
    pub fn cell_of(&mut self, point: [f64; 3]) -> CellId {
        let key = group_of(self.grid.lattice.box_of(1, point));
        match self.last {
            Some((known, cell)) if known == key => cell,
            _ => self.find(key),
        }
    }

    fn find(&mut self, key: BoxKey) -> CellId {
        let grid = self.grid;
        let cell = match grid.groups.binary_search(&key) {
            Ok(place) => CellId::at(place),
            Err(_) => *self.strays.entry(key).or_insert_with(|| grid.nearest(key)),
        };
        self.last = Some((key, cell));
        cell
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lattice() -> Lattice {
        Lattice { origin: [0.0; 3], step: 1.0 / f64::from(1u32 << STEPS) }
    }

    #[test]
    fn a_plane_is_the_border_of_groups_in_one_round_only() {
        // Along one axis, boxes of level 0 have sides of 1. Planes lie at whole numbers.
        for plane in -40..40 {
            let sides = [f64::from(plane) - 0.5, f64::from(plane) + 0.5];
            let parts = |round: u32| {
                let of = |x: f64| group_of(lattice().box_of(round, [x, 0.0, 0.0]))[0];
                of(sides[0]) != of(sides[1])
            };
            let n = (0..12).filter(|&round| parts(round)).count();
            assert!(n == usize::from(plane != 0), "plane {plane}: {n} rounds");
        }
    }

    #[test]
    fn boxes_nest_and_a_group_holds_eight() {
        for x in -20..20 {
            let point = [f64::from(x) + 0.5, 0.25, -3.5];
            for level in 0..5 {
                let key = lattice().box_of(level, point);
                assert_eq!(parent_of(key), lattice().box_of(level + 1, point));
                assert_eq!(clamp_to(group_of(key), key), key);
                let below = lattice().box_of(level, point);
                assert_eq!(clamp_below(group_of(parent_of(below)), below), below);
            }
        }
    }

    #[test]
    fn boxes_hold_about_the_wanted_number() {
        // A sheet of 200 x 200 samples.
        let points: Vec<[f64; 3]> =
            (0..40_000).map(|i| [f64::from(i % 200), f64::from(i / 200), 0.5]).collect();
        let bounds = Bounds::around(&points);
        let lattice = Lattice::choose(bounds, &points, 4_000_000, 16_000);
        let grid = GroupGrid::new(lattice, &points);
        let mut finder = grid.finder();
        let mut counts = vec![0u64; grid.groups.len()];
        points.iter().for_each(|&p| counts[finder.cell_of(p)] += 100);
        let most = counts.iter().max().copied().unwrap_or(0);
        assert!((150_000..=300_000).contains(&most), "{counts:?}");
        // What was not sampled has a cell all the same.
        assert!(finder.cell_of([-900.0, 4000.0, 9.0]).index() < grid.groups.len());
    }
}
