//! Boxes in `f32`, eight side by side, rounded outwards from the input's numbers.

// Three axes (and eight lanes) run through several arrays side by side; an index shows that best.
#![allow(clippy::needless_range_loop)]

use crate::triangle::Vector;

/// Children of a node.
pub(super) const WIDTH: usize = 8;
/// Relative rounding error of a squared bound in `f32` (a difference, a square, two sums), with a margin.
const SHRINK: f32 = 1.0 - 1e-6;
/// Distinguishes a reference to a triangle from one to a node on the query's stack.
pub(super) const LEAF: u32 = 1 << 31;
/// Distinguishes a reference to a tilted box from one to a node.
pub(super) const TILTED: u32 = 1 << 30;

/// Eight boxes and where they lead.
#[derive(Clone, Debug)]
#[repr(align(64))]
pub(super) struct Node {
    pub(super) low: [[f32; WIDTH]; 3],
    pub(super) high: [[f32; WIDTH]; 3],
    /// Nodes, places in `Tree::corners` with the `LEAF` bit set, or tilted boxes with the `TILTED` bit.
    pub(super) child: [u32; WIDTH],
    pub(super) n_children: u32,
}

/// From input units to the units of the boxes: shifted and scaled by a power of two into [-1, 1].
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Frame {
    pub(super) origin: Vector,
    pub(super) scale: f64,
}

/// A query point in the units of the boxes: the `f32` below and above it on each axis.
pub(super) struct Query {
    low: [f32; 3],
    high: [f32; 3],
}

impl Frame {
    pub(super) fn around(low: Vector, high: Vector) -> Self {
        let origin = [0, 1, 2].map(|k| {
            let middle = low[k] + 0.5 * (high[k] - low[k]);
            if middle.is_finite() { middle } else { 0.0 }
        });
        let reach = (0..3).map(|k| high[k] - low[k]).fold(0.0, f64::max);
        let usable = reach > f64::MIN_POSITIVE && reach.is_finite();
        // A power of two: scaling never rounds.
        let scale = if usable { 2f64.powi((-reach.log2().ceil()) as i32) } else { 1.0 };
        Frame { origin, scale }
    }

    #[inline]
    pub(super) fn query(&self, point: Vector) -> Query {
        let local = [0, 1, 2].map(|k| (point[k] - self.origin[k]) * self.scale);
        Query { low: local.map(below), high: local.map(above) }
    }

    /// A squared distance in the units of the boxes, rounded up.
    #[inline]
    pub(super) fn limit(&self, distance_sq: f64) -> f32 {
        above(distance_sq * self.scale * self.scale)
    }

    #[inline]
    pub(super) fn bounds(&self, t: &[Vector; 3]) -> ([f32; 3], [f32; 3]) {
        let side = |k: usize, pick: fn(f64, f64) -> f64| {
            (pick(pick(t[0][k], t[1][k]), t[2][k]) - self.origin[k]) * self.scale
        };
        ([0, 1, 2].map(|k| below(side(k, f64::min))), [0, 1, 2].map(|k| above(side(k, f64::max))))
    }
}

/// A float below `value`, by at least the rounding of the subtraction that made it.
#[inline]
fn below(value: f64) -> f32 {
    (value as f32).next_down()
}

/// A float above `value`, by at least the rounding of the subtraction that made it.
#[inline]
fn above(value: f64) -> f32 {
    (value as f32).next_up()
}

impl Node {
    /// Without children.
    pub(super) const EMPTY: Node = Node {
        low: [[f32::INFINITY; WIDTH]; 3],
        high: [[f32::NEG_INFINITY; WIDTH]; 3],
        child: [0; WIDTH],
        n_children: 0,
    };

    pub(super) fn set(&mut self, lane: usize, low: [f32; 3], high: [f32; 3], child: u32) {
        for k in 0..3 {
            self.low[k][lane] = low[k];
            self.high[k][lane] = high[k];
        }
        self.child[lane] = child;
        self.n_children = lane as u32 + 1;
    }

    pub(super) fn hull(&self) -> ([f32; 3], [f32; 3]) {
        (
            self.low.map(|axis| axis.into_iter().fold(f32::INFINITY, f32::min)),
            self.high.map(|axis| axis.into_iter().fold(f32::NEG_INFINITY, f32::max)),
        )
    }

    /// Lower bounds of the squared distances to the eight boxes.
    #[inline(always)]
    pub(super) fn bounds(&self, query: &Query) -> [f32; WIDTH] {
        let mut sum = [0f32; WIDTH];
        for k in 0..3 {
            for lane in 0..WIDTH {
                // Plain comparisons become single instructions; `f32::max` would also care for NaN.
                let under = self.low[k][lane] - query.high[k];
                let over = query.low[k] - self.high[k][lane];
                let off = if under > over { under } else { over };
                let off = if off > 0.0 { off } else { 0.0 };
                sum[lane] += off * off;
            }
        }
        // Beyond the range of f32 the bound stays finite, hence below the true distance.
        sum.map(|s| {
            let s = s * SHRINK;
            if s < f32::MAX { s } else { f32::MAX }
        })
    }
}
