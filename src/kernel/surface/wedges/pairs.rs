//! Pairs of wedges that become one in a collapse at a seam.

use super::Wedges;
use crate::surface::Surface;
use crate::surface::junction::MOST_SHEETS;
use stonecut_mesh::corners::others;

/// Pairs of wedges of `v0` and `v1` that become one: those of the triangles over the edge.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Pairs {
    list: [(u32, u32); MOST_SHEETS],
    pub(crate) n: usize,
    /// One wedge would have to become two, or two would become one.
    pub(crate) splits: bool,
    pub(crate) joins: bool,
}

impl Pairs {
    pub(crate) fn of(wedges: &Wedges, surface: &Surface, v0: u32, v1: u32) -> Pairs {
        let mut pairs = Pairs::default();
        for &t in surface.ring(v0) {
            let (b, c) = others(surface.triangles[t as usize], v0);
            if b == v1 || c == v1 {
                let pair = (wedges.at(surface, t, v0), wedges.at(surface, t, v1));
                pairs.add(pair);
            }
        }
        pairs
    }

    pub(crate) fn add(&mut self, pair: (u32, u32)) {
        for known in &self.list[..self.n] {
            self.splits |= known.0 == pair.0 && known.1 != pair.1;
            self.joins |= known.0 != pair.0 && known.1 == pair.1;
            if *known == pair {
                return;
            }
        }
        if self.n < MOST_SHEETS {
            self.list[self.n] = pair;
            self.n += 1;
        }
    }

    pub(crate) fn of_v0(&self, wedge: u32) -> Option<(u32, u32)> {
        self.list[..self.n].iter().copied().find(|pair| pair.0 == wedge)
    }

    pub(crate) fn of_v1(&self, wedge: u32) -> Option<(u32, u32)> {
        self.list[..self.n].iter().copied().find(|pair| pair.1 == wedge)
    }
}
