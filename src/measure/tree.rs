//! A tree of boxes over triangles that answers nearest-point queries exactly.
//!
//! Nodes have eight children, whose boxes are kept in `f32`, rounded outwards: eight lower bounds are
//! computed at once. Whatever a bound cannot exclude is settled in `f64` on the triangles themselves, so
//! the boxes decide only how fast an answer is found, never which. Where boxes overlap too much for that,
//! `tilted` has others. Does not know meshes, files or threads. docs/design/measure.md tells why this is
//! not one of the crates.

// Three axes (and eight lanes) run through several arrays side by side; an index shows that best.
#![allow(clippy::needless_range_loop)]

use super::tilted::{Inside, Tilted};
use super::triangle::{self, Vector};
use crate::error::Result;
use crate::mesh::bounds::Bounds;
use crate::system::progress::Progress;

/// Children of a node.
const WIDTH: usize = 8;
/// Enough for the 11 levels that 2^32 triangles need, with all siblings of the path waiting.
const STACK: usize = 12 * WIDTH;
/// What rounding may add to a squared bound in `f32` (a difference, a square, two sums), with room to spare.
const SHRINK: f32 = 1.0 - 1e-6;
/// Distinguishes a reference to a triangle from one to a node on the query's stack.
const LEAF: u32 = 1 << 31;
/// Distinguishes a reference to a tilted box from one to a node.
const TILTED: u32 = 1 << 30;

/// Boxes overlap too much where a point of a node is in more than this many of its triangles' boxes on
/// average: surfaces come to 2 at most, needles around one corner to a tenth of their number.
const OVERLAP: f64 = 16.0;
/// Fewer triangles than this are looked at, however their boxes overlap.
const FEW: u32 = 64;
/// Triangles between two looks at the wish to stop.
const STOP_ROWS: usize = 1 << 16;

/// Eight boxes and where they lead.
#[derive(Clone, Debug)]
#[repr(align(64))]
struct Node {
    low: [[f32; WIDTH]; 3],
    high: [[f32; WIDTH]; 3],
    /// Nodes, places in `Tree::corners` with the `LEAF` bit set, or tilted boxes with the `TILTED` bit.
    child: [u32; WIDTH],
    n_children: u32,
}

/// Triangles ready for nearest-point queries; at most 2^31 of them.
///
/// Memory: about 110 bytes a triangle, 150 while it is built.
#[derive(Clone, Debug, Default)]
pub struct Tree {
    nodes: Vec<Node>,
    /// Canonical corners, in tree order.
    corners: Vec<[Vector; 3]>,
    /// For each of `corners`, its number in the list given to `build`.
    ids: Vec<u32>,
    frame: Frame,
    /// Where every query begins: a node or a tilted box.
    root: u32,
    tilted: Tilted,
}

/// From input units to the units of the boxes: shifted and scaled by a power of two into [-1, 1].
#[derive(Clone, Copy, Debug, Default)]
struct Frame {
    origin: Vector,
    scale: f64,
}

/// The nearest triangle found so far by one query.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nearest {
    /// Squared distance to it.
    pub distance_sq: f64,
    /// Its place in the tree; meaningless as long as nothing was found.
    pub slot: u32,
}

impl Nearest {
    /// No triangle yet.
    pub const NONE: Nearest = Nearest { distance_sq: f64::INFINITY, slot: u32::MAX };

    /// Whether a triangle was found.
    pub fn is_found(&self) -> bool {
        self.slot != u32::MAX
    }
}

/// A query point in the units of the boxes: the `f32` below and above it on each axis.
struct Query {
    low: [f32; 3],
    high: [f32; 3],
}

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

    /// How many triangles there are.
    pub fn len(&self) -> usize {
        self.corners.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.corners.is_empty()
    }

    /// The number that the triangle at `slot` had in the list given to `build`.
    pub fn id(&self, slot: u32) -> u32 {
        self.ids[slot as usize]
    }

    /// The canonical corners of the triangle at `slot`.
    pub fn corners(&self, slot: u32) -> &[Vector; 3] {
        &self.corners[slot as usize]
    }

    /// Bytes that a tree over `n_triangles` takes at most, while it is built.
    pub fn bytes(n_triangles: u64) -> u64 {
        let node = size_of::<Node>() as u64;
        n_triangles * (72 + 4 + 16) + (n_triangles / 6 + 1) * node
    }

    /// A sound guess for `point` at the cost of one distance: the triangle at `slot`.
    pub fn guess(&self, point: Vector, slot: u32) -> Nearest {
        match self.corners.get(slot as usize) {
            Some(t) => Nearest { distance_sq: triangle::closest(point, t).0, slot },
            None => Nearest::NONE,
        }
    }

    /// The nearest triangle to `point`, starting from a guess (`Nearest::NONE` if there is none).
    ///
    /// Of equally near triangles the one whose corners come first in lexicographic order is taken, so the
    /// answer depends neither on the guess nor on the tree.
    pub fn nearest(&self, point: Vector, guess: Nearest) -> Nearest {
        self.search(point, guess, -1.0, || ())
    }

    /// Boxes and triangles that `nearest` looks at, for those who count work instead of seconds.
    pub fn looks(&self, point: Vector) -> u64 {
        let mut n = 0;
        self.search(point, Nearest::NONE, -1.0, || n += 1);
        n
    }

    /// Like `nearest`, but free to stop at any triangle whose squared distance is at most `enough_sq`.
    pub fn nearest_unless_within(&self, point: Vector, guess: Nearest, enough_sq: f64) -> Nearest {
        self.search(point, guess, enough_sq, || ())
    }

    #[inline(always)]
    fn search(
        &self,
        point: Vector,
        guess: Nearest,
        enough_sq: f64,
        mut look: impl FnMut(),
    ) -> Nearest {
        let mut best = guess;
        if self.is_empty() || best.distance_sq <= enough_sq {
            return best;
        }
        let query = self.frame.query(point);
        let mut limit = self.frame.limit(best.distance_sq);
        let mut stack = [(0f32, 0u32); STACK];
        stack[0].1 = self.root;
        let mut height = 1;
        while height > 0 {
            height -= 1;
            let (bound, at) = stack[height];
            if bound > limit {
                continue;
            }
            look();
            if at & LEAF != 0 {
                let slot = at & !LEAF;
                let (distance_sq, _) = triangle::closest(point, &self.corners[slot as usize]);
                if self.is_better(distance_sq, slot, best) {
                    best = Nearest { distance_sq, slot };
                    if distance_sq <= enough_sq {
                        return best;
                    }
                    limit = self.frame.limit(distance_sq);
                }
                continue;
            }
            if at & TILTED != 0 {
                best = self.search_tilted(point, best, enough_sq, at & !TILTED, &mut look);
                if best.distance_sq <= enough_sq {
                    return best;
                }
                limit = self.frame.limit(best.distance_sq);
                continue;
            }
            let node = &self.nodes[at as usize];
            let bounds = node.bounds(&query);
            let bottom = height;
            for (&bound, &child) in bounds.iter().zip(&node.child).take(node.n_children as usize) {
                if bound > limit {
                    continue;
                }
                // Kept in descending order, so that the nearest box is opened next.
                let mut place = height;
                while place > bottom && stack[place - 1].0 < bound {
                    stack[place] = stack[place - 1];
                    place -= 1;
                }
                stack[place] = (bound, child);
                height += 1;
            }
        }
        best
    }

    /// Searches below a tilted box.
    #[cold]
    fn search_tilted(
        &self,
        point: Vector,
        mut best: Nearest,
        enough_sq: f64,
        root: u32,
        look: &mut impl FnMut(),
    ) -> Nearest {
        // Halving goes down to groups from at most 2^31 triangles.
        let mut stack = [(0f64, 0u32); 2 * 32];
        stack[0].1 = root;
        let mut height = 1;
        while height > 0 {
            height -= 1;
            let (bound_sq, at) = stack[height];
            if bound_sq > best.distance_sq {
                continue;
            }
            look();
            match self.tilted.open(at, point) {
                Inside::AllAt(distance_sq, slot) => {
                    if self.is_better(distance_sq, slot, best) {
                        best = Nearest { distance_sq, slot };
                    }
                }
                Inside::Triangles(slots) => {
                    for slot in slots {
                        look();
                        let t = &self.corners[slot as usize];
                        let (distance_sq, _) = triangle::closest(point, t);
                        if self.is_better(distance_sq, slot, best) {
                            best = Nearest { distance_sq, slot };
                        }
                    }
                }
                Inside::Boxes(boxes) => {
                    let bound_sq =
                        |at| self.tilted.bound_sq(at, point, &self.corners, best.distance_sq);
                    let [near, far] = boxes.map(|at| (bound_sq(at), at));
                    let (near, far) = if near.0 <= far.0 { (near, far) } else { (far, near) };
                    (stack[height], stack[height + 1]) = (far, near);
                    height += 2;
                }
            }
            if best.distance_sq <= enough_sq {
                return best;
            }
        }
        best
    }

    /// Whether a triangle is nearer than the best so far, or as near and first by its corners.
    #[inline(always)]
    fn is_better(&self, distance_sq: f64, slot: u32, best: Nearest) -> bool {
        distance_sq < best.distance_sq
            || (distance_sq == best.distance_sq && self.comes_first(slot, best.slot))
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
            self.root = TILTED | self.tilt_below(below[0], stop);
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
                    self.nodes[at as usize].child[lane] = TILTED | self.tilt_below(sum, stop);
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
    fn tilt_below(&mut self, (_, n, first): (f64, u32, u32), stop: &dyn Fn() -> bool) -> u32 {
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

    #[cold]
    fn comes_first(&self, slot: u32, other: u32) -> bool {
        if other == u32::MAX {
            return true;
        }
        let (a, b) = (slot as usize, other as usize);
        (self.corners[a], self.ids[a]) < (self.corners[b], self.ids[b])
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

impl Frame {
    fn around(low: Vector, high: Vector) -> Self {
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

    fn query(&self, point: Vector) -> Query {
        let local = [0, 1, 2].map(|k| (point[k] - self.origin[k]) * self.scale);
        Query { low: local.map(below), high: local.map(above) }
    }

    /// A squared distance in the units of the boxes, rounded up.
    fn limit(&self, distance_sq: f64) -> f32 {
        above(distance_sq * self.scale * self.scale)
    }

    fn bounds(&self, t: &[Vector; 3]) -> ([f32; 3], [f32; 3]) {
        let side = |k: usize, pick: fn(f64, f64) -> f64| {
            (pick(pick(t[0][k], t[1][k]), t[2][k]) - self.origin[k]) * self.scale
        };
        ([0, 1, 2].map(|k| below(side(k, f64::min))), [0, 1, 2].map(|k| above(side(k, f64::max))))
    }
}

/// A float below `value`, by at least the rounding of the subtraction that made it.
fn below(value: f64) -> f32 {
    (value as f32).next_down()
}

/// A float above `value`, by at least the rounding of the subtraction that made it.
fn above(value: f64) -> f32 {
    (value as f32).next_up()
}

impl Node {
    const EMPTY: Node = Node {
        low: [[f32::INFINITY; WIDTH]; 3],
        high: [[f32::NEG_INFINITY; WIDTH]; 3],
        child: [0; WIDTH],
        n_children: 0,
    };

    fn set(&mut self, lane: usize, low: [f32; 3], high: [f32; 3], child: u32) {
        for k in 0..3 {
            self.low[k][lane] = low[k];
            self.high[k][lane] = high[k];
        }
        self.child[lane] = child;
        self.n_children = lane as u32 + 1;
    }

    fn hull(&self) -> ([f32; 3], [f32; 3]) {
        (
            self.low.map(|axis| axis.into_iter().fold(f32::INFINITY, f32::min)),
            self.high.map(|axis| axis.into_iter().fold(f32::NEG_INFINITY, f32::max)),
        )
    }

    /// Lower bounds of the squared distances to the eight boxes.
    #[inline]
    fn bounds(&self, query: &Query) -> [f32; WIDTH] {
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

#[cfg(test)]
mod tests {
    #![allow(clippy::print_stdout)] // Figures for whoever asks with --nocapture.

    use super::*;

    fn random(state: &mut u64) -> f64 {
        *state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (*state >> 11) as f64 / (1u64 << 53) as f64
    }

    fn soup(n: usize, size: f64, far: f64, seed: u64) -> Vec<[Vector; 3]> {
        let mut state = seed;
        (0..n)
            .map(|_| {
                let at = [0; 3].map(|_| random(&mut state) + far);
                [0; 3].map(|_| at.map(|x| x + size * (random(&mut state) - 0.5)))
            })
            .collect()
    }

    fn brute(point: Vector, soup: &[[Vector; 3]]) -> f64 {
        let distance = |t: &[Vector; 3]| triangle::closest(point, &triangle::canonical(*t)).0;
        soup.iter().map(distance).fold(f64::INFINITY, f64::min)
    }

    #[test]
    fn answers_equal_a_plain_search_bit_for_bit() {
        for (n, size, far) in [
            (0, 0.1, 0.0),
            (1, 0.1, 0.0),
            (8, 1.0, 0.0),
            (9, 0.1, 1e7),
            (700, 0.05, 0.0),
            (700, 0.0, 5.0),
            (3000, 0.5, 1e6),
        ] {
            let soup = soup(n, size, far, 42);
            let tree = Tree::build(n, |i| soup[i]);
            assert_eq!(tree.len(), n);
            let mut state = 7;
            let mut hint = 0;
            for i in 0..300 {
                let reach = if i % 3 == 0 { 1e12 } else { 1.2 };
                let p = [0; 3].map(|_| far + reach * (random(&mut state) - 0.1));
                let plain = brute(p, &soup);
                let found = tree.nearest(p, Nearest::NONE);
                assert_eq!(found.distance_sq, plain, "{n} {size} {far}");
                assert_eq!(found.is_found(), n > 0);
                assert_eq!(tree.nearest(p, tree.guess(p, hint)), found, "a guess changes nothing");
                hint = found.slot;
                let within = tree.nearest_unless_within(p, Nearest::NONE, plain * 1.5);
                assert!(within.distance_sq <= plain * 1.5);
                let enough = plain * 0.5;
                assert_eq!(tree.nearest_unless_within(p, Nearest::NONE, enough), found);
            }
        }
    }

    #[test]
    fn of_equally_near_triangles_the_first_by_corners_wins() {
        // Four triangles around a common corner; the query stands on it.
        let ring = [[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]];
        let fan: Vec<[Vector; 3]> = (0..4)
            .map(|i| {
                let (a, b): ([f64; 2], [f64; 2]) = (ring[i], ring[(i + 1) % 4]);
                [[0.0; 3], [a[0], a[1], 0.0], [b[0], b[1], 0.0]]
            })
            .collect();
        for first in 0..4 {
            let tree = Tree::build(4, |i| triangle::rotate(fan[(i + first) % 4], i % 3));
            let found = tree.nearest([0.0, 0.0, 0.0], Nearest::NONE);
            let least = fan
                .iter()
                .map(|t| triangle::canonical(*t))
                .fold([[f64::INFINITY; 3]; 3], |least, t| if t < least { t } else { least });
            assert_eq!(*tree.corners(found.slot), least);
        }
    }

    /// Families of triangles whose upright boxes hold each other, `n` of each.
    fn overlapping(n: usize) -> Vec<(&'static str, Vec<[Vector; 3]>)> {
        let turn = |i: usize| std::f64::consts::TAU * i as f64 / n as f64;
        let rim = |i: usize| [turn(i).cos(), turn(i).sin(), 0.0];
        let over = |p: Vector, z: f64| [p[0], p[1], z];
        let slanted = |p: Vector| {
            let d = [0.48, 0.6, 0.64];
            [0, 1, 2].map(|k| 1e-2 * p[k] + d[k] * p[2])
        };
        let all = |f: &dyn Fn(usize) -> [Vector; 3]| (0..n).map(f).collect::<Vec<_>>();
        let one = [[0.1, 0.2, 0.3], [1.0, 0.0, 0.1], [0.0, 1.0, 0.4]];
        vec![
            ("flat fan", all(&|i| [[0.0; 3], rim(i), rim(i + 1)])),
            ("cone", all(&|i| [[0.0, 0.0, 1.5], rim(i), rim(i + 1)])),
            ("pages", all(&|i| [[0.0; 3], [0.0, 0.0, 1.0], rim(i)])),
            (
                "half a book",
                all(&|i| {
                    let a = 0.5 * turn(i) + 0.1;
                    [[0.0; 3], [0.0, 0.0, 1.0], [a.cos(), a.sin(), 0.3]]
                }),
            ),
            (
                "slanted tube",
                all(&|i| {
                    [over(rim(i), 0.0), over(rim(i + 1), 0.0), over(rim(i), 1.0)].map(slanted)
                }),
            ),
            (
                "star",
                all(&|i| {
                    let p = [0.5 * turn(i).cos(), 0.5 * turn(i).sin(), 0.0];
                    let w = [-1e-6 * p[1], 1e-6 * p[0], 0.0];
                    [0, 1, 2].map(|j| [0, 1, 2].map(|k| [p[k] + w[k], p[k] - w[k], -2.0 * p[k]][j]))
                }),
            ),
            ("one many times", all(&|_| one)),
            (
                "one both ways round",
                all(&|i| if i % 2 == 0 { one } else { [one[0], one[2], one[1]] }),
            ),
        ]
    }

    fn queries(soup: &[[Vector; 3]], n: usize) -> Vec<Vector> {
        let mut state = 11;
        let on = |i: usize, state: &mut u64| {
            let t = &soup[i * 7919 % soup.len()];
            let (u, v) = (random(state), random(state));
            let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
            triangle::point_at(t, [1.0 - u - v, u, v])
        };
        (0..n)
            .map(|i| match i % 4 {
                0 | 1 => on(i, &mut state),
                2 => on(i, &mut state).map(|x| x + 1e-4 * (random(&mut state) - 0.5)),
                _ => [0; 3].map(|_| 6.0 * random(&mut state) - 3.0),
            })
            .collect()
    }

    #[test]
    fn triangles_that_overlap_are_found_as_by_a_plain_search() {
        for (name, soup) in overlapping(700) {
            let tree = Tree::build(soup.len(), |i| soup[i]);
            let mut corners = soup.iter().flatten().copied().collect::<Vec<_>>();
            corners.truncate(30);
            let mut hint = 0;
            for p in queries(&soup, 300).into_iter().chain(corners) {
                let found = tree.nearest(p, Nearest::NONE);
                assert_eq!(found.distance_sq, brute(p, &soup), "{name} at {p:?}");
                assert_eq!(tree.nearest(p, tree.guess(p, hint)), found, "{name} at {p:?}");
                let t = triangle::canonical(soup[tree.id(found.slot) as usize]);
                assert_eq!(t, *tree.corners(found.slot), "{name}");
                hint = found.slot;
            }
        }
    }

    /// Looks at boxes and triangles, not seconds: a query takes about as many at four times the triangles.
    #[test]
    fn the_work_of_a_query_hardly_grows() {
        let mean = |soup: &[[Vector; 3]]| {
            let tree = Tree::build(soup.len(), |i| soup[i]);
            let queries = queries(soup, 400);
            queries.iter().map(|&p| tree.looks(p)).sum::<u64>() as f64 / 400.0
        };
        for (few, many) in overlapping(4000).iter().zip(&overlapping(16_000)) {
            let (a, b) = (mean(&few.1), mean(&many.1));
            println!("{}: {a:.0} -> {b:.0} looks a query", few.0);
            // Needles that cross in one point and share no corner: nothing but the root is promised.
            let growth = if few.0 == "star" { 2.5 } else { 1.5 };
            // Fewer than 64 are what a query takes among triangles that do not overlap.
            assert!(b < growth * a.max(64.0), "{}: {a} looks a query become {b}", few.0);
            assert!(b < 1000.0, "{}: {b} looks a query", few.0);
        }
    }
}
