//! Boxes along the triangles' own directions, for triangles that upright boxes do not tell apart.
//!
//! Needles that meet in one corner, pages along one edge, the strips of a slanted tube: the upright box of
//! each holds a good part of all the others, and a query would have to look at all of them. Boxes of any
//! orientation follow the triangles; where those below a box are alike, the distance to one of them, less
//! what the others are away from it, says more than the box. Where all triangles below a box have a corner (or an
//! edge) in common and turn away from the query, that corner (a point of that edge) is the nearest point of every one
//! of them: the first of them by corners is the answer, and nothing below is looked at. Triangles that repeat
//! another one, corner for corner, are left out. Called by `tree`; decides how fast an answer is found,
//! never which. docs/design/measure.md has the reasons and figures.

// Three axes run through several arrays side by side; an index shows that best.
#![allow(clippy::needless_range_loop)]

use super::triangle::{self, Vector};
use stonecut_mesh::eigen::eigen;
use stonecut_mesh::vec3::{dot, length_sq, sub};

/// Most triangles that are looked at one by one below a box.
const GROUP: usize = 8;

/// Fewer triangles than this are looked at sooner than their common corner.
const ANCHORED: usize = 16;

/// A box is given this much room on each side, in its longest side: the rounding that it makes itself.
const PAD: f64 = 1e-14;

/// Bound on the rounding of a place along an axis, in the distance from the middle.
const SLACK: f64 = 1e-14;

/// Bound on the error of a squared distance by axes that are rounded to `f32`, with room to spare.
const SHRINK: f64 = 1.0 - 1e-6;

/// Triangles are alike that are apart by less than this, in the longest side of their box.
const ALIKE: f64 = 0.25;

/// Cosines and places along an edge are trusted to this.
const MARGIN: f64 = 1e-9;

/// Trees of boxes, and the corners and edges that triangles have in common.
#[derive(Clone, Debug, Default)]
pub(super) struct Tilted {
    boxes: Vec<TiltedBox>,
    anchors: Vec<Anchor>,
}

/// A box of any orientation; about one for every four triangles.
#[derive(Clone, Copy, Debug, Default)]
struct TiltedBox {
    middle: Vector,
    axes: [[f32; 3]; 3],
    low: [f32; 3],
    high: [f32; 3],
    /// The first triangle of a group of `n`; the first of two boxes if `n` is 0.
    first: u32,
    n: u32,
    first_anchor: u32,
    n_anchors: u32,
    /// A triangle that all others are like: no point of theirs is farther from it than `within`. Infinite
    /// where they are not alike.
    like: u32,
    within: f64,
}

/// A corner, or an edge to `end`, of all triangles of a box, and the cone that holds the rest of them.
#[derive(Clone, Copy, Debug)]
struct Anchor {
    at: Vector,
    end: Option<Vector>,
    axis: Vector,
    cosine: f64,
    sine: f64,
    /// The triangle that is first by its corners.
    first: u32,
    /// Of an edge: how far from it, and where along it, the third corner of a triangle is, and how far those
    /// of the others are from there, turned about the edge.
    page: [f64; 2],
    within: f64,
}

/// Result of testing a query against a box.
pub(super) enum Inside {
    /// Every triangle is this far away (squared); the one at the slot is first by its corners.
    AllAt(f64, u32),
    /// Slots to be looked at.
    Triangles(std::ops::Range<u32>),
    /// Two boxes.
    Boxes([u32; 2]),
}

impl Tilted {
    /// Builds boxes over triangles, which are reordered, and returns the box of them all.
    ///
    /// `first_slot` is the place of the first of them in the tree. Gives up early, with boxes that must
    /// not be used, once `stop` says so.
    pub fn add(
        &mut self,
        corners: &mut [[Vector; 3]],
        ids: &mut [u32],
        first_slot: u32,
        stop: &dyn Fn() -> bool,
    ) -> u32 {
        let mut order: Vec<u32> = (0..corners.len() as u32).collect();
        let by_corners = |&a: &u32, &b: &u32| {
            let key = |i: u32| (&corners[i as usize], ids[i as usize]);
            key(a).partial_cmp(&key(b)).unwrap_or(std::cmp::Ordering::Equal)
        };
        order.sort_unstable_by(by_corners);
        // From here on a triangle's place is its rank.
        permute(corners, ids, &mut order);
        order.clear();
        let mut repeats = Vec::new();
        for rank in 0..corners.len() {
            let is_repeat = rank > 0 && corners[rank] == corners[rank - 1];
            (if is_repeat { &mut repeats } else { &mut order }).push(rank as u32);
        }
        let (root, first_anchor) = (self.boxes.len(), self.anchors.len());
        self.boxes.push(TiltedBox::default());
        self.grow(corners, (&mut order, first_slot), root, stop);
        let mut place = vec![0; corners.len()];
        order.append(&mut repeats);
        order.iter().enumerate().for_each(|(i, &rank)| place[rank as usize] = i as u32);
        for anchor in &mut self.anchors[first_anchor..] {
            anchor.first = first_slot + place[anchor.first as usize];
        }
        for tilted in &mut self.boxes[root..] {
            tilted.like = first_slot + place[tilted.like as usize];
        }
        permute(corners, ids, &mut order);
        root as u32
    }

    fn grow(
        &mut self,
        corners: &[[Vector; 3]],
        (order, slot): (&mut [u32], u32),
        at: usize,
        stop: &dyn Fn() -> bool,
    ) {
        let mut tilted = TiltedBox::around(corners, order);
        if order.len() >= ANCHORED {
            tilted.first_anchor = self.anchors.len() as u32;
            self.anchor(corners, order);
            tilted.n_anchors = self.anchors.len() as u32 - tilted.first_anchor;
        }
        if order.len() <= GROUP || stop() {
            (tilted.first, tilted.n) = (slot, order.len() as u32);
            self.boxes[at] = tilted;
            return;
        }
        let half = order.len() / 2;
        split(corners, order, half);
        let first = self.boxes.len();
        tilted.first = first as u32;
        self.boxes[at] = tilted;
        self.boxes.extend([TiltedBox::default(); 2]);
        let (left, right) = order.split_at_mut(half);
        self.grow(corners, (left, slot), first, stop);
        self.grow(corners, (right, slot + half as u32), first + 1, stop);
    }

    /// Notes the corners, and the edge, that all of some triangles have in common.
    fn anchor(&mut self, corners: &[[Vector; 3]], order: &[u32]) {
        let mut shared = corners[order[0] as usize].to_vec();
        for &i in order {
            shared.retain(|v| corners[i as usize].contains(v));
            if shared.is_empty() {
                return;
            }
        }
        shared.dedup();
        let first = order.iter().copied().min().unwrap_or(0);
        let others = |known: [Vector; 2]| {
            let triangles = order.iter().flat_map(|&i| corners[i as usize]);
            triangles.filter(move |c| !known.contains(c))
        };
        for &at in &shared {
            let directions = others([at, at]).map(|c| sub(c, at));
            if let Some((axis, cosine)) = cone(directions) {
                self.anchors.push(Anchor::new(at, None, axis, cosine, first));
            }
        }
        if let [at, end] = shared[..] {
            let edge = sub(end, at);
            let length = length_sq(edge).sqrt();
            let across = others([at, end]).map(|c| square_to(sub(c, at), edge));
            if let Some((axis, cosine)) = cone(across) {
                let page = |c: Vector| {
                    let from = sub(c, at);
                    [length_sq(square_to(from, edge)).sqrt(), dot(from, edge) / length]
                };
                let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
                others([at, end]).map(page).for_each(|page| {
                    for k in 0..2 {
                        (low[k], high[k]) = (low[k].min(page[k]), high[k].max(page[k]));
                    }
                });
                let half = [0, 1].map(|k| 0.5 * (high[k] - low[k]));
                let longest = length + high[0] + low[1].abs().max(high[1].abs());
                self.anchors.push(Anchor {
                    page: [0, 1].map(|k| low[k] + half[k]),
                    within: (half[0] * half[0] + half[1] * half[1]).sqrt() + MARGIN * longest,
                    ..Anchor::new(at, Some(end), axis, cosine, first)
                });
            }
        }
    }

    /// A lower bound of the squared distance that `triangle::closest` finds for anything in a box, computed
    /// no further than to exceed `limit_sq`; `corners` are those of the whole tree.
    #[inline]
    pub fn bound_sq(&self, at: u32, point: Vector, corners: &[[Vector; 3]], limit_sq: f64) -> f64 {
        let tilted = &self.boxes[at as usize];
        let from = sub(point, tilted.middle);
        let slack = SLACK * (from[0].abs() + from[1].abs() + from[2].abs());
        let mut sum = 0.0;
        for k in 0..3 {
            let y = dot(tilted.axes[k].map(f64::from), from);
            let off = (f64::from(tilted.low[k]) - y).max(y - f64::from(tilted.high[k])) - slack;
            let off = if off > 0.0 { off } else { 0.0 };
            sum += off * off;
        }
        let mut bound_sq = sum * SHRINK;
        if bound_sq > limit_sq {
            return bound_sq;
        }
        let anchors = &self.anchors[tilted.first_anchor as usize..];
        for anchor in anchors.iter().take(tilted.n_anchors as usize) {
            bound_sq = bound_sq.max(anchor.bound_sq(point));
        }
        if bound_sq > limit_sq || tilted.within == f64::INFINITY {
            return bound_sq;
        }
        let to_one = triangle::closest(point, &corners[tilted.like as usize]).0.sqrt();
        let least = (to_one - tilted.within - slack).max(0.0);
        bound_sq.max(least * least * SHRINK)
    }

    /// Looks into a box.
    #[inline]
    pub fn open(&self, at: u32, point: Vector) -> Inside {
        let tilted = &self.boxes[at as usize];
        let anchors = tilted.first_anchor as usize..;
        for anchor in self.anchors[anchors].iter().take(tilted.n_anchors as usize) {
            if let Some(distance_sq) = anchor.distance_sq(point) {
                return Inside::AllAt(distance_sq, anchor.first);
            }
        }
        match tilted.n {
            0 => Inside::Boxes([tilted.first, tilted.first + 1]),
            n => Inside::Triangles(tilted.first..tilted.first + n),
        }
    }
}

impl Anchor {
    fn new(at: Vector, end: Option<Vector>, axis: Vector, cosine: f64, first: u32) -> Self {
        let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
        Anchor { at, end, axis, cosine, sine, first, page: [0.0; 2], within: 0.0 }
    }

    /// The squared distance to the corner or edge, where it is seen to be that of all triangles.
    fn distance_sq(&self, point: Vector) -> Option<f64> {
        let from = sub(point, self.at);
        let Some(end) = self.end else {
            let distance_sq = length_sq(from);
            let is_nearest = distance_sq == 0.0 || self.turns_away(from);
            return is_nearest.then_some(distance_sq);
        };
        let edge = sub(end, self.at);
        let along = dot(from, edge) / length_sq(edge);
        let across = square_to(from, edge);
        let is_nearest = (MARGIN..=1.0 - MARGIN).contains(&along)
            && length_sq(across) > MARGIN * MARGIN * length_sq(from)
            && self.turns_away(across);
        is_nearest.then(|| triangle::closest_on_edge(point, self.at, end).0)
    }

    /// A lower bound of the squared distance to the triangles at an edge; 0 for those at a corner.
    ///
    /// Turned about the edge, the query comes no nearer to any of them than to the one at the side of the
    /// cone that faces it, and there all are the same page but for `within`.
    fn bound_sq(&self, point: Vector) -> f64 {
        let Some(end) = self.end else { return 0.0 };
        let (from, edge) = (sub(point, self.at), sub(end, self.at));
        let length = length_sq(edge).sqrt();
        let across = square_to(from, edge);
        let off = length_sq(across).sqrt();
        let mut turned = [off, 0.0];
        if off > 0.0 {
            let cosine = (dot(across, self.axis) / off).clamp(-1.0, 1.0);
            let sine = (1.0 - cosine * cosine).sqrt();
            if cosine < self.cosine {
                // Cosine and sine of the angle to the cone's side.
                turned[0] = off * (cosine * self.cosine + sine * self.sine);
                turned[1] = off * (sine * self.cosine - cosine * self.sine);
            }
        }
        let query = [turned[0], turned[1], dot(from, edge) / length];
        let page = [[0.0; 3], [0.0, 0.0, length], [self.page[0], 0.0, self.page[1]]];
        let distance = triangle::closest(query, &page).0.sqrt();
        let slack = MARGIN * off + SLACK * (length + from.iter().map(|x| x.abs()).sum::<f64>());
        let least = (distance - self.within - slack).max(0.0);
        least * least * SHRINK
    }

    /// Returns whether every direction of the cone makes an angle of more than 90 degrees with `direction`.
    fn turns_away(&self, direction: Vector) -> bool {
        let cosine = dot(direction, self.axis) / length_sq(direction).sqrt();
        let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
        // The cosine of the difference of both angles.
        cosine * self.cosine + sine * self.sine < -MARGIN
    }
}

impl TiltedBox {
    fn around(corners: &[[Vector; 3]], order: &[u32]) -> Self {
        let points = || order.iter().flat_map(|&i| corners[i as usize]);
        let n = 3.0 * order.len() as f64;
        let origin = corners[order[0] as usize][0];
        let mut mean = [0.0; 3];
        points().for_each(|p| (0..3).for_each(|k| mean[k] += (p[k] - origin[k]) / n));
        let middle = [0, 1, 2].map(|k| origin[k] + mean[k]);
        let mut spread = [0.0; 6];
        for p in points() {
            let [x, y, z] = sub(p, middle);
            let squares = [x * x, x * y, x * z, y * y, y * z, z * z];
            spread.iter_mut().zip(squares).for_each(|(sum, square)| *sum += square);
        }
        let axes = eigen(spread).1.map(|axis| axis.map(|x| x as f32));
        let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for p in points() {
            let from = sub(p, middle);
            for k in 0..3 {
                let y = dot(axes[k].map(f64::from), from);
                (low[k], high[k]) = (low[k].min(y), high[k].max(y));
            }
        }
        let longest = (0..3).map(|k| high[k] - low[k]).fold(0.0, f64::max);
        let pad = PAD * longest;
        let low = low.map(|x| ((x - pad) as f32).next_down());
        let high = high.map(|x| ((x + pad) as f32).next_up());
        let (mut like, mut within) = (order[0], f64::INFINITY);
        for one in [order[0], order[order.len() / 2], order[order.len() - 1]] {
            let t = &corners[one as usize];
            // A distance to something convex is largest at a corner.
            let mut farthest_sq = 0f64;
            for p in points() {
                farthest_sq = farthest_sq.max(triangle::closest(p, t).0);
                if farthest_sq >= within * within {
                    break;
                }
            }
            let farthest = farthest_sq.sqrt();
            if farthest < within && farthest < ALIKE * longest {
                (like, within) = (one, farthest + pad);
            }
        }
        TiltedBox { middle, axes, low, high, like, within, ..TiltedBox::default() }
    }
}

/// Moves the half that comes first to the front: by the place or by the direction of the triangles,
/// whichever differ more.
fn split(corners: &[[Vector; 3]], order: &mut [u32], half: usize) {
    let (mut low, mut high) = ([f64::INFINITY; 6], [f64::NEG_INFINITY; 6]);
    for &i in order.iter() {
        let key = key(&corners[i as usize]);
        for k in 0..6 {
            (low[k], high[k]) = (low[k].min(key[k]), high[k].max(key[k]));
        }
    }
    let mut widest = 0;
    for k in 1..6 {
        if high[k] - low[k] > high[widest] - low[widest] {
            widest = k;
        }
    }
    let mut keys: Vec<(f64, u32)> =
        order.iter().map(|&i| (key(&corners[i as usize])[widest], i)).collect();
    keys.select_nth_unstable_by(half, |a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    order.iter_mut().zip(&keys).for_each(|(i, key)| *i = key.1);
}

/// The centroid, and the longest edge, whose largest component counts as positive.
fn key(t: &[Vector; 3]) -> [f64; 6] {
    let edges = [sub(t[1], t[0]), sub(t[2], t[1]), sub(t[0], t[2])];
    let mut longest = edges[0];
    for edge in &edges[1..] {
        if length_sq(*edge) > length_sq(longest) {
            longest = *edge;
        }
    }
    let mut main = longest[0];
    for x in longest {
        if x.abs() > main.abs() {
            main = x;
        }
    }
    let sign = 1f64.copysign(main);
    let third = 1.0 / 3.0;
    let centre = triangle::point_at(t, [third, third, third]);
    [centre[0], centre[1], centre[2], sign * longest[0], sign * longest[1], sign * longest[2]]
}

/// The part of a vector that is square to another one, which has some length.
fn square_to(v: Vector, edge: Vector) -> Vector {
    let along = dot(v, edge) / length_sq(edge);
    [0, 1, 2].map(|k| v[k] - along * edge[k])
}

/// Axis, and cosine of half the angle, of a cone that holds all directions; `None` where one of them is
/// none, or where they point every way.
fn cone(directions: impl Iterator<Item = Vector> + Clone) -> Option<(Vector, f64)> {
    let unit = |v: Vector| {
        let length = length_sq(v).sqrt();
        (length > 0.0).then(|| v.map(|x| x / length))
    };
    let mut sum = [0.0; 3];
    for direction in directions.clone() {
        let direction = unit(direction)?;
        (0..3).for_each(|k| sum[k] += direction[k]);
    }
    let axis = unit(sum)?;
    let mut cosine = 1f64;
    for direction in directions {
        cosine = cosine.min(dot(unit(direction)?, axis));
    }
    (cosine > 0.1).then_some((axis, cosine - MARGIN))
}

/// Puts what `order` names in each place there; leaves `order` without meaning.
fn permute(corners: &mut [[Vector; 3]], ids: &mut [u32], order: &mut [u32]) {
    for start in 0..order.len() {
        let mut at = start;
        loop {
            let from = std::mem::replace(&mut order[at], at as u32) as usize;
            if from == start {
                break;
            }
            if from == at {
                break;
            }
            corners.swap(at, from);
            ids.swap(at, from);
            at = from;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn permuting_moves_everything_to_its_place() {
        let n = 100u32;
        let mut corners: Vec<[Vector; 3]> = (0..n).map(|i| [[f64::from(i); 3]; 3]).collect();
        let mut ids: Vec<u32> = (0..n).collect();
        let wanted: Vec<u32> = (0..n).map(|i| i * 37 % n).collect();
        permute(&mut corners, &mut ids, &mut wanted.clone());
        assert_eq!(ids, wanted);
        assert!(corners.iter().zip(&wanted).all(|(t, &i)| t[0][0] == f64::from(i)));
    }
}
