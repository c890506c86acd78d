//! A tree of boxes over triangles that answers nearest-point queries exactly.
//!
//! Nodes have eight children, whose boxes are kept in `f32`, rounded outwards: eight lower bounds are
//! computed at once. Whatever a bound cannot exclude is settled in `f64` on the triangles themselves, so
//! the boxes decide only how fast an answer is found, never which. Where boxes overlap too much for that,
//! `tilted` has others. Does not know meshes, files or threads. docs/design/measure.md tells why this is
//! not one of the crates.

mod boxes;
mod build;
#[cfg(test)]
mod tests;

use super::tilted::{Inside, Tilted};
use super::triangle::{self, Vector};
use super::wide::{WideJob, run};
use boxes::{Frame, LEAF, Node, TILTED, WIDTH};
use stonecut_mesh::steps::count;

/// Enough for the 11 levels that 2^32 triangles need, with all siblings of the path waiting.
const STACK: usize = 12 * WIDTH;

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
    /// Root of every query: a node or a tilted box.
    root: u32,
    tilted: Tilted,
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

    /// True once a triangle was found.
    pub fn is_found(&self) -> bool {
        self.slot != u32::MAX
    }
}

/// A search for the nearest triangle.
struct TreeSearch<'a, A, L> {
    tree: &'a Tree,
    point: Vector,
    guess: Nearest,
    enough_sq: f64,
    accepts: A,
    look: L,
}

impl<A: Fn(&[Vector; 3]) -> bool, L: FnMut()> WideJob for TreeSearch<'_, A, L> {
    type Output = Nearest;

    #[inline(always)]
    fn run(self) -> Nearest {
        self.tree.search_wide(self)
    }
}

/// A list of the boxes around a point.
struct BoxSearch<'a> {
    tree: &'a Tree,
    point: Vector,
    reach_sq: f64,
    most: usize,
    out: &'a mut Vec<u32>,
}

impl WideJob for BoxSearch<'_> {
    type Output = bool;

    #[inline(always)]
    fn run(self) -> bool {
        let BoxSearch { tree, point, reach_sq, most, out } = self;
        let (query, limit) = (tree.frame.query(point), tree.frame.limit(reach_sq));
        let mut stack = [0u32; STACK];
        stack[0] = tree.root;
        let mut height = 1;
        while height > 0 {
            height -= 1;
            let at = stack[height];
            if at & TILTED != 0 || out.len() > most {
                return false;
            }
            let node = &tree.nodes[at as usize];
            let bounds = node.bounds(&query);
            for (&bound, &child) in bounds.iter().zip(&node.child).take(node.n_children as usize) {
                if bound > limit {
                    continue;
                }
                if child & LEAF != 0 {
                    out.push(child & !LEAF);
                } else {
                    stack[height] = child;
                    height += 1;
                }
            }
        }
        out.len() <= most
    }
}

impl Tree {
    /// Number of triangles.
    pub fn len(&self) -> usize {
        self.corners.len()
    }

    /// True if there are none.
    pub fn is_empty(&self) -> bool {
        self.corners.is_empty()
    }

    /// The number that the triangle at `slot` had in the list given to `build`.
    #[inline]
    pub fn id(&self, slot: u32) -> u32 {
        self.ids[slot as usize]
    }

    /// The canonical corners of the triangle at `slot`.
    #[inline]
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
        self.nearest_where(point, guess, |_| true)
    }

    /// The nearest of the triangles whose canonical corners are accepted; a guess must be one of them, or none.
    pub fn nearest_where(
        &self,
        point: Vector,
        guess: Nearest,
        accepts: impl Fn(&[Vector; 3]) -> bool,
    ) -> Nearest {
        let mut n = 0;
        let found = self.search(point, guess, -1.0, accepts, || n += 1);
        count(n);
        found
    }

    /// Boxes and triangles that `nearest` looks at, for those who count work instead of seconds.
    pub fn looks(&self, point: Vector) -> u64 {
        let mut n = 0;
        self.search(point, Nearest::NONE, -1.0, |_| true, || n += 1);
        n
    }

    /// Like `nearest`, but free to stop at any triangle whose squared distance is at most `enough_sq`.
    pub fn nearest_unless_within(&self, point: Vector, guess: Nearest, enough_sq: f64) -> Nearest {
        let mut n = 0;
        let found = self.search(point, guess, enough_sq, |_| true, || n += 1);
        count(n);
        found
    }

    /// Lists the slots of triangles whose boxes are at most the root of `reach_sq` from `point`.
    ///
    /// Returns false if there are more than `most`, or if the boxes there are tilted: the list is of no use then.
    pub fn boxes_within(
        &self,
        point: Vector,
        reach_sq: f64,
        most: usize,
        out: &mut Vec<u32>,
    ) -> bool {
        self.is_empty() || run(BoxSearch { tree: self, point, reach_sq, most, out })
    }

    fn search(
        &self,
        point: Vector,
        guess: Nearest,
        enough_sq: f64,
        accepts: impl Fn(&[Vector; 3]) -> bool,
        look: impl FnMut(),
    ) -> Nearest {
        run(TreeSearch { tree: self, point, guess, enough_sq, accepts, look })
    }

    #[inline(always)]
    fn search_wide<A: Fn(&[Vector; 3]) -> bool, L: FnMut()>(
        &self,
        search: TreeSearch<A, L>,
    ) -> Nearest {
        let TreeSearch { point, guess, enough_sq, accepts, mut look, .. } = search;
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
                let t = &self.corners[slot as usize];
                let (distance_sq, _) = triangle::closest(point, t);
                if self.is_better(distance_sq, slot, best) && accepts(t) {
                    best = Nearest { distance_sq, slot };
                    if distance_sq <= enough_sq {
                        return best;
                    }
                    limit = self.frame.limit(distance_sq);
                }
                continue;
            }
            if at & TILTED != 0 {
                let root = at & !TILTED;
                best = self.search_tilted(point, (best, enough_sq), root, &accepts, &mut look);
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
        (mut best, enough_sq): (Nearest, f64),
        root: u32,
        accepts: &impl Fn(&[Vector; 3]) -> bool,
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
                    let t = &self.corners[slot as usize];
                    if self.is_better(distance_sq, slot, best) && accepts(t) {
                        best = Nearest { distance_sq, slot };
                    }
                }
                Inside::Triangles(slots) => {
                    for slot in slots {
                        look();
                        let t = &self.corners[slot as usize];
                        let (distance_sq, _) = triangle::closest(point, t);
                        if self.is_better(distance_sq, slot, best) && accepts(t) {
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

    /// True if a triangle is nearer than the best so far, or as near and first by its corners.
    #[inline(always)]
    pub fn is_better(&self, distance_sq: f64, slot: u32, best: Nearest) -> bool {
        distance_sq < best.distance_sq
            || (distance_sq == best.distance_sq && self.comes_first(slot, best.slot))
    }

    #[cold]
    fn comes_first(&self, slot: u32, other: u32) -> bool {
        if other == u32::MAX {
            return true;
        }
        let (a, b) = (slot as usize, other as usize);
        (self.corners[a], self.ids[a]) < (self.corners[b], self.ids[b])
    }
}
