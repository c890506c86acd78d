//! Builds the tree: halves along the longest axis, full subtrees, tilted boxes where upright ones overlap.

// Three axes (and eight lanes) run through several arrays side by side; an index shows that best.
#![allow(clippy::needless_range_loop)]

use super::Tree;
use super::boxes::{Frame, LEAF, Node, TILTED, WIDTH};
use crate::tilted::Tilted;
use crate::triangle::{self, Vector};
use stonecut_mesh::bounds::Bounds;
use stonecut_system::error::Result;
use stonecut_system::progress::Progress;

/// Boxes overlap too much where a point of a node is in more than this many of its triangles' boxes on
/// average: surfaces come to 2 at most, needles around one corner to a tenth of their number.
const OVERLAP: f64 = 16.0;
/// Fewer triangles than this are looked at, however their boxes overlap.
const FEW: u32 = 64;
/// Triangles between two looks at the wish to stop.
const STOP_ROWS: usize = 1 << 16;

#[derive(Clone, Copy)]
struct Item {
    centre: [f32; 3],
    id: u32,
}

impl Tree {
    /// Builds the tree over triangles given by their corners. Degenerate triangles are welcome.
    pub fn build(n_triangles: usize, corners_of: impl Fn(usize) -> [Vector; 3]) -> Self {
        Self::build_until(n_triangles, corners_of, &Progress::default()).unwrap_or_default()
    }

    /// The same; fails once `progress` asks to stop.
    pub fn build_until(
        n_triangles: usize,
        corners_of: impl Fn(usize) -> [Vector; 3],
        progress: &Progress,
    ) -> Result<Self> {
        assert!(n_triangles < LEAF as usize, "a tree holds fewer than 2^31 triangles");
        let mut bounds = Bounds::EMPTY;
        for i in 0..n_triangles {
            if i % STOP_ROWS == 0 {
                progress.check()?;
            }
            corners_of(i).into_iter().for_each(|corner| bounds.add(corner));
        }
        let frame = Frame::around(bounds.low, bounds.high);
        let mut items = Vec::with_capacity(n_triangles);
        for i in 0..n_triangles {
            if i % STOP_ROWS == 0 {
                progress.check()?;
            }
            let t = corners_of(i);
            let centre = [0, 1, 2].map(|k| {
                let middle = (t[0][k] - frame.origin[k])
                    + (t[1][k] - frame.origin[k])
                    + (t[2][k] - frame.origin[k]);
                (middle * frame.scale) as f32
            });
            items.push(Item { centre, id: i as u32 });
        }
        let mut tree = Tree {
            nodes: Vec::with_capacity(n_triangles / (WIDTH - 1) + 1),
            corners: Vec::with_capacity(n_triangles),
            ids: Vec::with_capacity(n_triangles),
            frame,
            root: 0,
            tilted: Tilted::default(),
        };
        let stop = || progress.check().is_err();
        if n_triangles > 0 {
            tree.add_node(&mut items, &corners_of, &stop);
            drop(items);
            progress.check()?;
            tree.tilt(&stop);
        }
        progress.check()?;
        Ok(tree)
    }

    /// Puts tilted boxes wherever the boxes of triangles overlap too much.
    fn tilt(&mut self, stop: &dyn Fn() -> bool) {
        /// Sum of the volumes of the triangles' boxes, their number, the least of their slots.
        type Below = (f64, u32, u32);
        let volume = |low: [f32; 3], high: [f32; 3]| -> f64 {
            (0..3).map(|k| f64::from(high[k]) - f64::from(low[k])).product()
        };
        let mut below: Vec<Below> = vec![(0.0, 0, u32::MAX); self.nodes.len()];
        // Children come after their parents.
        for at in (0..self.nodes.len()).rev() {
            let node = &self.nodes[at];
            let mut sum = (0.0, 0, u32::MAX);
            for lane in 0..node.n_children as usize {
                let child = node.child[lane];
                let (low, high) = (node.low.map(|x| x[lane]), node.high.map(|x| x[lane]));
                let one = match child & LEAF {
                    0 => below[child as usize],
                    _ => (volume(low, high), 1, child & !LEAF),
                };
                sum = (sum.0 + one.0, sum.1 + one.1, sum.2.min(one.2));
            }
            below[at] = sum;
        }
        let overlaps = |node: &Node, (sum, n, _): Below| {
            let (low, high) = node.hull();
            n >= FEW && sum > OVERLAP * volume(low, high)
        };
        if overlaps(&self.nodes[0], below[0]) {
            self.nodes = Vec::new();
            self.root = TILTED | self.tilt_below((below[0].1, below[0].2), stop);
            return;
        }
        let (mut waiting, mut is_any) = (vec![0u32], false);
        while let Some(at) = waiting.pop() {
            for lane in 0..self.nodes[at as usize].n_children as usize {
                let child = self.nodes[at as usize].child[lane];
                if child & LEAF != 0 {
                    continue;
                }
                let sum = below[child as usize];
                if overlaps(&self.nodes[child as usize], sum) {
                    self.nodes[at as usize].child[lane] =
                        TILTED | self.tilt_below((sum.1, sum.2), stop);
                    is_any = true;
                } else if sum.1 >= FEW {
                    waiting.push(child);
                }
            }
        }
        if is_any {
            drop(below);
            self.forget_unused();
        }
    }

    /// Builds tilted boxes over the triangles of a node; their slots follow each other.
    fn tilt_below(&mut self, (n, first): (u32, u32), stop: &dyn Fn() -> bool) -> u32 {
        let slots = first as usize..(first + n) as usize;
        let (corners, ids) = (&mut self.corners[slots.clone()], &mut self.ids[slots]);
        self.tilted.add(corners, ids, first, stop)
    }

    /// Moves the nodes that are still reached together.
    fn forget_unused(&mut self) {
        let old = std::mem::take(&mut self.nodes);
        let mut waiting = vec![(0u32, None)];
        while let Some((at, parent)) = waiting.pop() {
            let new = self.nodes.len() as u32;
            if let Some((parent, lane)) = parent {
                let parent: &mut Node = &mut self.nodes[parent as usize];
                parent.child[lane] = new;
            }
            let node = &old[at as usize];
            self.nodes.push(node.clone());
            for lane in 0..node.n_children as usize {
                if node.child[lane] & (LEAF | TILTED) == 0 {
                    waiting.push((node.child[lane], Some((new, lane))));
                }
            }
        }
        self.nodes.shrink_to_fit();
    }

    /// Appends the node of `items` and everything below it; returns its place.
    ///
    /// Gives up early, with a node that must not be used, once `stop` says so.
    fn add_node(
        &mut self,
        items: &mut [Item],
        corners_of: &impl Fn(usize) -> [Vector; 3],
        stop: &dyn Fn() -> bool,
    ) -> u32 {
        let at = self.nodes.len();
        self.nodes.push(Node::EMPTY);
        if items.len() > STOP_ROWS / WIDTH && stop() {
            return at as u32;
        }
        if items.len() <= WIDTH {
            for (lane, item) in items.iter().enumerate() {
                let t = triangle::canonical(corners_of(item.id as usize));
                let slot = self.corners.len() as u32;
                let (low, high) = self.frame.bounds(&t);
                self.corners.push(t);
                self.ids.push(item.id);
                self.nodes[at].set(lane, low, high, slot | LEAF);
            }
            return at as u32;
        }
        // Full subtrees of 8^k triangles, the rest in the last ones: the fewest nodes, every box tight.
        let mut capacity = WIDTH;
        while capacity * WIDTH < items.len() {
            capacity *= WIDTH;
        }
        let n_parts = items.len().div_ceil(capacity);
        let mut lane = 0;
        let around = Centres::of(items);
        self.add_parts(items, around, (capacity, n_parts), (at, &mut lane), (corners_of, stop));
        at as u32
    }

    fn add_parts(
        &mut self,
        items: &mut [Item],
        around: Centres,
        (capacity, n_parts): (usize, usize),
        (parent, lane): (usize, &mut usize),
        means: (&impl Fn(usize) -> [Vector; 3], &dyn Fn() -> bool),
    ) {
        if n_parts == 1 {
            let child = self.add_node(items, means.0, means.1);
            let (low, high) = self.nodes[child as usize].hull();
            self.nodes[parent].set(*lane, low, high, child);
            *lane += 1;
            return;
        }
        let n_left = n_parts / 2 * capacity;
        let halves = around.split(items, n_left);
        let (left, right) = items.split_at_mut(n_left);
        let (few, rest) = (n_parts / 2, n_parts - n_parts / 2);
        self.add_parts(left, halves[0], (capacity, few), (parent, lane), means);
        self.add_parts(right, halves[1], (capacity, rest), (parent, lane), means);
    }
}

/// A box around the centres of items, to choose the axis to split along: tight at each node, and within a
/// node as its splits leave it, which spares two of three looks at all items.
#[derive(Clone, Copy)]
struct Centres {
    low: [f32; 3],
    high: [f32; 3],
}

impl Centres {
    fn of(items: &[Item]) -> Centres {
        let mut around = Centres { low: [f32::INFINITY; 3], high: [f32::NEG_INFINITY; 3] };
        for item in items {
            for k in 0..3 {
                around.low[k] = around.low[k].min(item.centre[k]);
                around.high[k] = around.high[k].max(item.centre[k]);
            }
        }
        around
    }

    /// Moves the `n_left` items that come first along the longest axis to the front; the boxes of both sides.
    fn split(self, items: &mut [Item], n_left: usize) -> [Centres; 2] {
        let extent = [0, 1, 2].map(|k| self.high[k] - self.low[k]);
        let axis = if extent[0] >= extent[1] && extent[0] >= extent[2] {
            0
        } else if extent[1] >= extent[2] {
            1
        } else {
            2
        };
        let (_, cut, _) =
            items.select_nth_unstable_by(n_left, |a, b| a.centre[axis].total_cmp(&b.centre[axis]));
        let (mut left, mut right) = (self, self);
        (left.high[axis], right.low[axis]) = (cut.centre[axis], cut.centre[axis]);
        [left, right]
    }
}
