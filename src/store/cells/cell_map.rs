//! The two ways to say which cell a point belongs to: a kd-tree, or groups of boxes of a lattice.

use super::kd_tree::{CellFinder, CellTree};
use super::lattice::{GroupFinder, GroupGrid};
use crate::cell_id::CellId;
use serde::{Deserialize, Serialize};

/// Maps every point of space to a cell.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum CellMap {
    /// Cells of even count.
    Tree(CellTree),
    /// Groups of boxes that nest.
    Groups(GroupGrid),
}

impl CellMap {
    /// Number of cells.
    pub fn n_cells(&self) -> u32 {
        match self {
            CellMap::Tree(tree) => tree.n_cells(),
            CellMap::Groups(grid) => grid.groups.len() as u32,
        }
    }

    /// The cell of a point.
    pub fn cell_of(&self, point: [f64; 3]) -> CellId {
        self.finder().cell_of(point)
    }

    /// For many points one after the other.
    pub fn finder(&self) -> Finder<'_> {
        match self {
            CellMap::Tree(tree) => Finder::Tree(tree.finder()),
            CellMap::Groups(grid) => Finder::Groups(grid.finder()),
        }
    }
}

/// Finds cells of points.
#[derive(Clone, Debug)]
pub enum Finder<'a> {
    /// In a kd-tree.
    Tree(CellFinder<'a>),
    /// Among groups.
    Groups(GroupFinder<'a>),
}

impl Finder<'_> {
    /// The cell of a point.
    #[inline]
    pub fn cell_of(&mut self, point: [f64; 3]) -> CellId {
        match self {
            Finder::Tree(finder) => finder.cell_of(point),
            Finder::Groups(finder) => finder.cell_of(point),
        }
    }
}
