//! A tree of boxes over triangles that answers nearest-point queries exactly.
//!
//! Nodes have eight children, whose boxes are kept in `f32`, rounded outwards: eight lower bounds are
//! computed at once. Whatever a bound cannot exclude is settled in `f64` on the triangles themselves, so
//! the boxes decide only how fast an answer is found, never which. Does not know meshes, files or
//! threads. docs/design/measure.md tells why this is not one of the crates.

// Three axes (and eight lanes) run through several arrays side by side; an index shows that best.
#![allow(clippy::needless_range_loop)]

use super::triangle::{self, Vector};

/// Children of a node.
const WIDTH: usize = 8;
/// Enough for the 11 levels that 2^32 triangles need, with all siblings of the path waiting.
const STACK: usize = 12 * WIDTH;
/// What rounding may add to a squared bound in `f32` (a difference, a square, two sums), with room to spare.
const SHRINK: f32 = 1.0 - 1e-6;
/// Distinguishes a reference to a triangle from one to a node on the query's stack.
const LEAF: u32 = 1 << 31;

/// Eight boxes and where they lead.
#[derive(Clone, Debug)]
#[repr(align(64))]
struct Node {
    low: [[f32; WIDTH]; 3],
    high: [[f32; WIDTH]; 3],
    /// Nodes, or places in `Tree::corners` with the `LEAF` bit set.
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
        assert!(n_triangles < LEAF as usize, "a tree holds fewer than 2^31 triangles");
        let mut low = [f64::INFINITY; 3];
        let mut high = [f64::NEG_INFINITY; 3];
        for i in 0..n_triangles {
            for corner in corners_of(i) {
                for k in 0..3 {
                    low[k] = low[k].min(corner[k]);
                    high[k] = high[k].max(corner[k]);
                }
            }
        }
        let frame = Frame::around(low, high);
        let mut items = Vec::with_capacity(n_triangles);
        for i in 0..n_triangles {
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
        };
        if n_triangles > 0 {
            tree.add_node(&mut items, &corners_of);
        }
        tree
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
        self.search(point, guess, -1.0)
    }

    /// Like `nearest`, but free to stop at any triangle whose squared distance is at most `enough_sq`.
    pub fn nearest_unless_within(&self, point: Vector, guess: Nearest, enough_sq: f64) -> Nearest {
        self.search(point, guess, enough_sq)
    }

    fn search(&self, point: Vector, guess: Nearest, enough_sq: f64) -> Nearest {
        let mut best = guess;
        if self.is_empty() || best.distance_sq <= enough_sq {
            return best;
        }
        let query = self.frame.query(point);
        let mut limit = self.frame.limit(best.distance_sq);
        let mut stack = [(0f32, 0u32); STACK];
        let mut height = 1;
        while height > 0 {
            height -= 1;
            let (bound, at) = stack[height];
            if bound > limit {
                continue;
            }
            if at & LEAF != 0 {
                let slot = at & !LEAF;
                let t = &self.corners[slot as usize];
                let (distance_sq, _) = triangle::closest(point, t);
                if distance_sq < best.distance_sq
                    || (distance_sq == best.distance_sq && self.comes_first(slot, best.slot))
                {
                    best = Nearest { distance_sq, slot };
                    if distance_sq <= enough_sq {
                        return best;
                    }
                    limit = self.frame.limit(distance_sq);
                }
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

    #[cold]
    fn comes_first(&self, slot: u32, other: u32) -> bool {
        if other == u32::MAX {
            return true;
        }
        let (a, b) = (slot as usize, other as usize);
        (self.corners[a], self.ids[a]) < (self.corners[b], self.ids[b])
    }

    /// Appends the node of `items` and everything below it; returns its place.
    fn add_node(&mut self, items: &mut [Item], corners_of: &impl Fn(usize) -> [Vector; 3]) -> u32 {
        let at = self.nodes.len();
        self.nodes.push(Node::EMPTY);
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
        self.add_parts(items, around, (capacity, n_parts), (at, &mut lane), corners_of);
        at as u32
    }

    fn add_parts(
        &mut self,
        items: &mut [Item],
        around: Centres,
        (capacity, n_parts): (usize, usize),
        (parent, lane): (usize, &mut usize),
        corners_of: &impl Fn(usize) -> [Vector; 3],
    ) {
        if n_parts == 1 {
            let child = self.add_node(items, corners_of);
            let (low, high) = self.nodes[child as usize].hull();
            self.nodes[parent].set(*lane, low, high, child);
            *lane += 1;
            return;
        }
        let n_left = n_parts / 2 * capacity;
        let halves = around.split(items, n_left);
        let (left, right) = items.split_at_mut(n_left);
        let (few, rest) = (n_parts / 2, n_parts - n_parts / 2);
        self.add_parts(left, halves[0], (capacity, few), (parent, lane), corners_of);
        self.add_parts(right, halves[1], (capacity, rest), (parent, lane), corners_of);
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
}
