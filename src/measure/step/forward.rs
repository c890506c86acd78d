//! From the mesh to its simplified version: a proven bound for every triangle.

use super::across::across_sq;
use super::around::{Forward, NONE};
use super::covered::{Covered, QUARTERS, Quartered, with_middles};
use super::exact::Exact;
use super::foot::{Doubtful, Feet, Foot};
use super::largest::Largest;
use crate::triangle::{Vector, closest};
use std::cmp::Ordering;
use std::collections::BinaryHeap;
use stonecut_mesh::Mesh;
use stonecut_mesh::steps::{HUB, count};
use stonecut_mesh::vec3::{length_sq, sub};

/// A triangle is quartered so often, at most.
const DEEPEST: u32 = 6;

/// Triangles that a search for the nearest one looks at from vertex to vertex, at most: along needles it would go on for
/// thousands. In scans it ends after some ten.
const MOST_WALKED: usize = HUB / 2;

/// Vertices of the version near those of the mesh, and feet of these.
struct NearFeet<'a> {
    feet: Feet,
    /// The vertices of the version that they went into.
    known: &'a [u32],
    /// The same, and for those that went into none a vertex near them, once it was found.
    hints: Vec<u32>,
    /// The last that was found.
    last: u32,
}

impl NearFeet<'_> {
    /// True if a vertex went into none.
    fn was_none(&self, v: u32) -> bool {
        self.known[v as usize] == NONE
    }
}

impl Forward<'_> {
    /// Bounds the distances of all triangles: looks closer at the farthest ones, and at those over no star.
    pub(super) fn triangles(
        &self,
        hints: &[u32],
        covered: &Covered,
        largest: &mut Largest,
        exact: &mut Exact,
    ) {
        let most = &covered.most;
        let doubtful = |t: usize| Doubtful { distance_sq: most[t] * most[t], item: t as u32 };
        let is_seen = |t: &usize| most[*t].is_finite();
        // The farthest one shows how far at least the two are apart.
        let farthest = (0..most.len()).filter(is_seen).max_by(|&a, &b| most[a].total_cmp(&most[b]));
        let mut feet = Feet::new(hints.len());
        let mut look = |t: usize, largest: &mut Largest, exact: &mut Exact| {
            let own = self.fine.triangles[t];
            self.look(own, self.with_hints(t, hints), &mut feet, largest, exact);
        };
        if let Some(t) = farthest {
            look(t, largest, exact);
        }
        largest.share_pieces(self.fine.triangles.len(), covered.rest.len());
        let (mut far, mut near_sq) = (BinaryHeap::new(), 0.0f64);
        for doubtful in (0..most.len()).filter(is_seen).map(doubtful) {
            match doubtful.distance_sq > largest.enough_sq() {
                true => far.push(doubtful),
                false => near_sq = near_sq.max(doubtful.distance_sq),
            }
        }
        while let Some(Doubtful { distance_sq, item }) = far.pop() {
            if largest.accepts(distance_sq) {
                break;
            }
            look(item as usize, largest, exact);
        }
        largest.bound_sq = largest.bound_sq.max(near_sq);
        let mut near = NearFeet { feet, known: hints, hints: hints.to_vec(), last: NONE };
        // First all of these, which shows how far the two are apart.
        for quartered in &covered.rest {
            self.find_hints(quartered.triangle, &mut near, largest, exact);
        }
        for quartered in &covered.rest {
            self.quarters(quartered, &mut near, largest, exact);
        }
    }

    /// Bounds the distances of the quarters of a triangle that lie over no star.
    fn quarters(
        &self,
        quartered: &Quartered,
        near: &mut NearFeet,
        largest: &mut Largest,
        exact: &mut Exact,
    ) {
        let sq = quartered.most * quartered.most;
        let is_near = quartered.done != 0 && largest.accepts(sq);
        let corners = self.with_hints(quartered.triangle as usize, &near.hints);
        if is_beside(&corners, self.coarse, largest.bound_sq) {
            return;
        }
        let own = self.fine.triangles[quartered.triangle as usize];
        let [a, b, c] = corners;
        let middles = with_middles([a.0, b.0, c.0]);
        let hints = [a.1, b.1, c.1, a.1, b.1, c.1];
        let mut feet: [Option<Foot>; 6] = [None; 6];
        for (quarter, parts) in QUARTERS.iter().enumerate() {
            let is_done = is_near && quartered.done & 1 << quarter != 0;
            let corners = parts.map(|k| (middles[k], hints[k]));
            if is_done || is_beside(&corners, self.coarse, largest.bound_sq) {
                continue;
            }
            let feet = parts.map(|k| {
                let is_rough = near.was_none(own[k % 3]);
                let mut find = || {
                    let foot = Foot { is_rough, ..self.descend(middles[k], hints[k]) };
                    self.certain(foot, largest, exact)
                };
                *feet[k].get_or_insert_with(|| match own.get(k) {
                    Some(&v) => near.feet.of(v, find),
                    None => find(),
                })
            });
            self.bound(feet, largest, exact);
        }
    }

    fn off_sq(&self, place: Vector, vertex: u32) -> f64 {
        length_sq(sub(place, self.coarse.positions[vertex as usize]))
    }

    /// Finds vertices of the version near the corners of a triangle that went into none: those of another corner, or near the last
    /// ones that were found. Whole components went into none.
    fn find_hints(&self, t: u32, near: &mut NearFeet, largest: &mut Largest, exact: &mut Exact) {
        let own = self.fine.triangles[t as usize];
        for v in own.map(|v| v as usize) {
            if near.hints[v] == NONE {
                let known = own.map(|w| near.hints[w as usize]).into_iter().find(|&w| w != NONE);
                let place = self.fine.positions[v];
                let mut hint = known.unwrap_or(near.last);
                if hint == NONE || self.off_sq(place, hint) > largest.bound_sq {
                    let foot = self.descend(place, hint);
                    hint = match foot.triangle == NONE || foot.distance_sq > largest.bound_sq {
                        true => self.found(foot, largest.bound_sq, largest, exact).hint,
                        false => foot.hint,
                    };
                }
                near.hints[v] = hint;
                near.last = near.hints[v];
            }
        }
    }

    /// The corners of a triangle with the vertices of the version near them.
    pub(super) fn with_hints(&self, t: usize, hints: &[u32]) -> [(Vector, u32); 3] {
        self.fine.triangles[t].map(|v| (self.fine.positions[v as usize], hints[v as usize]))
    }

    /// Bounds the distance of a triangle by itself; each corner has a vertex of the version near it.
    pub(super) fn look(
        &self,
        own: [u32; 3],
        corners: [(Vector, u32); 3],
        feet: &mut Feet,
        largest: &mut Largest,
        exact: &mut Exact,
    ) {
        if is_beside(&corners, self.coarse, largest.bound_sq) {
            return;
        }
        let feet = [0, 1, 2].map(|k| {
            let (place, hint) = corners[k];
            feet.of(own[k], || self.certain(self.descend(place, hint), largest, exact))
        });
        self.bound(feet, largest, exact);
    }

    /// Bounds the distance of a triangle by feet near its corners; by the nearest places of these if it would be the largest so
    /// far.
    fn bound(&self, feet: [Foot; 3], largest: &mut Largest, exact: &mut Exact) {
        if !feet.iter().any(|foot| foot.is_rough) {
            return self.cover(feet, largest, exact);
        }
        let bound_sq = largest.bound_sq;
        if self.by_corners_sq(&feet) <= bound_sq
            || across_sq(&feet, self.coarse, self.around) <= bound_sq
            || self.mixed_sq(&feet, bound_sq) <= bound_sq
        {
            return;
        }
        let feet = feet.map(|foot| match foot.is_rough {
            true => self.found(foot, 0.0, largest, exact),
            false => foot,
        });
        self.cover(feet, largest, exact);
    }

    /// The squared distance of a triangle, at most: no point of it is farther from all corners than the longest side over the root
    /// of three.
    fn by_corners_sq(&self, feet: &[Foot; 3]) -> f64 {
        let side_sq = |i: usize, j: usize| length_sq(sub(feet[i].point, feet[j].point));
        let longest = side_sq(0, 1).max(side_sq(1, 2)).max(side_sq(2, 0)).sqrt();
        let own = feet.iter().map(|foot| foot.distance_sq).fold(0.0, f64::max).sqrt();
        let most = own + longest / 3f64.sqrt();
        most * most
    }

    /// Looks for the foot of a point everywhere if it is so far that it would count.
    fn certain(&self, foot: Foot, largest: &mut Largest, exact: &mut Exact) -> Foot {
        match foot.triangle == NONE || foot.distance_sq > largest.enough_sq() {
            // What lies within the bound already need not be the nearest.
            true => self.found(foot, largest.bound_sq, largest, exact),
            false => foot,
        }
    }

    /// Looks for the foot of a point everywhere: the nearest, or any within a squared distance.
    fn found(
        &self,
        mut foot: Foot,
        within_sq: f64,
        largest: &mut Largest,
        exact: &mut Exact,
    ) -> Foot {
        let guess = (foot.distance_sq, foot.triangle);
        (foot.distance_sq, foot.triangle) = exact.nearest(foot.point, guess, within_sq);
        if foot.triangle != guess.1 {
            foot.hint = self.coarse.triangles[foot.triangle as usize][0];
        }
        foot.is_rough = foot.distance_sq <= within_sq;
        if !foot.is_rough {
            largest.add(foot.distance_sq);
        }
        foot
    }

    /// The nearest triangle around a vertex, then around the corner nearest to the foot, as long as that gains. Nothing is looked at
    /// around a hub, nor after a long way: if the foot counts, it is looked for everywhere.
    fn descend(&self, point: Vector, hint: u32) -> Foot {
        let mut best =
            Foot { point, distance_sq: f64::INFINITY, triangle: NONE, hint, is_rough: false };
        let (mut at, mut n) = (hint, 0);
        while at != NONE && n <= MOST_WALKED {
            let mut weights = None;
            let around = self.around.of(at);
            if around.len() > HUB {
                break;
            }
            n += around.len();
            for &t in around {
                let (distance_sq, w) = closest(point, &self.coarse.corners(t as usize));
                if distance_sq < best.distance_sq {
                    (best.distance_sq, best.triangle, weights) = (distance_sq, t, Some(w));
                }
            }
            let Some(w) = weights else { break };
            let corner =
                if w[0] >= w[1] && w[0] >= w[2] { 0 } else { 1 + usize::from(w[2] > w[1]) };
            let next = self.coarse.triangles[best.triangle as usize][corner];
            best.hint = next;
            at = if next == at { NONE } else { next };
        }
        count(n);
        best
    }

    /// The squared distance of a triangle from the nearest of the triangles of its feet, at most.
    ///
    /// The distance to each of these is convex, and so is any mean of them, which is nowhere below the least: at a
    /// corner a mean is largest.
    fn mixed_sq(&self, feet: &[Foot; 3], enough_sq: f64) -> f64 {
        let [a, b, c] = feet.map(|foot| foot.triangle);
        let most = |d: [f64; 3]| d[0].max(d[1]).max(d[2]);
        if a == b && b == c {
            return most(feet.map(|foot| foot.distance_sq));
        }
        let to = |triangle: u32| {
            let t = self.coarse.corners(triangle as usize);
            feet.map(|foot| match foot.triangle == triangle {
                true => foot.distance_sq,
                false => closest(foot.point, &t).0,
            })
        };
        // Two corners with one foot: that triangle first.
        let (a, b, c) = if b == c { (b, a, c) } else { (a, b, c) };
        let to_a = to(a);
        let mut least = most(to_a);
        if least <= enough_sq {
            return least;
        }
        let mean = |a: [f64; 3], b: [f64; 3]| most([0, 1, 2].map(|k| 0.5 * (a[k] + b[k]))).powi(2);
        let to_a = to_a.map(f64::sqrt);
        let to_b = if b == a { to(c) } else { to(b) };
        least = least.min(most(to_b));
        let to_b = to_b.map(f64::sqrt);
        least = least.min(mean(to_a, to_b));
        if least <= enough_sq || a == b || a == c || b == c {
            return least;
        }
        let to_c = to(c);
        least = least.min(most(to_c));
        let to_c = to_c.map(f64::sqrt);
        let all = most([0, 1, 2].map(|k| (to_a[k] + to_b[k] + to_c[k]) / 3.0)).powi(2);
        least.min(mean(to_a, to_c)).min(mean(to_b, to_c)).min(all)
    }

    /// Bounds the distance of a triangle: the piece of it that may be the farthest is quartered first.
    fn cover(&self, feet: [Foot; 3], largest: &mut Largest, exact: &mut Exact) {
        if largest.accepts(self.by_corners_sq(&feet)) {
            return;
        }
        let (mut pieces, mut n) = (BinaryHeap::new(), 1);
        self.add_piece(feet, 0, largest, &mut pieces);
        while let Some(Piece { most_sq, feet, depth }) = pieces.pop() {
            // What is left is no farther.
            let is_known = most_sq <= largest.bound_sq || largest.accepts(most_sq);
            if is_known || depth == DEEPEST || n >= largest.most_pieces {
                largest.bound_sq = largest.bound_sq.max(most_sq);
                break;
            }
            n += QUARTERS.len();
            let [a, b, c] = feet;
            let [ab, bc, ca] = [(a, b), (b, c), (c, a)].map(|(from, to)| {
                let point = [0, 1, 2].map(|k| 0.5 * (from.point[k] + to.point[k]));
                let foot = self.descend(point, from.hint);
                let other = self.descend(point, to.hint);
                let foot = if other.distance_sq < foot.distance_sq { other } else { foot };
                self.certain(foot, largest, exact)
            });
            for part in [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]] {
                self.add_piece(part, depth + 1, largest, &mut pieces);
            }
        }
        count(n);
    }

    /// Adds a piece of a triangle to those that need a second look, if it does.
    fn add_piece(
        &self,
        feet: [Foot; 3],
        depth: u32,
        largest: &mut Largest,
        pieces: &mut BinaryHeap<Piece>,
    ) {
        let enough_sq = largest.enough_sq();
        let mut most_sq = across_sq(&feet, self.coarse, self.around);
        if most_sq > enough_sq {
            most_sq = most_sq.min(self.mixed_sq(&feet, enough_sq));
        }
        if !largest.accepts(most_sq) {
            pieces.push(Piece { most_sq, feet, depth });
        }
    }
}

/// A piece of a triangle with its squared distance, at most; in a heap by that.
struct Piece {
    most_sq: f64,
    feet: [Foot; 3],
    depth: u32,
}

impl PartialEq for Piece {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Piece {}

impl Ord for Piece {
    fn cmp(&self, other: &Self) -> Ordering {
        self.most_sq.total_cmp(&other.most_sq).then(other.depth.cmp(&self.depth))
    }
}

impl PartialOrd for Piece {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

/// True if a triangle is not farther than a squared distance from one of the vertices of a mesh near its corners: it is farthest
/// from that at a corner.
pub(super) fn is_beside(corners: &[(Vector, u32); 3], mesh: &Mesh, distance_sq: f64) -> bool {
    corners.iter().any(|&(_, hint)| {
        hint != NONE && {
            let at = mesh.positions[hint as usize];
            corners.iter().all(|&(corner, _)| length_sq(sub(corner, at)) <= distance_sq)
        }
    })
}
