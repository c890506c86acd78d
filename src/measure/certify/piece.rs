//! A part of a source triangle that is still to be proven near the target, and how it is cut.
//!
//! The points within a distance of one target triangle are a convex set. So a piece is near the target if all its
//! corners are near one target triangle, and where only some are, the part next to these is cut off and done.
//! docs/design/certificate.md, "Cutting".

use super::bound::{on_edge, upper, upper_and_way};
use crate::triangle::{Vector, area_normal};
use stonecut_mesh::vec3::{cross, dot, length_sq, sub, unit};

/// A piece is cut where at least this share of it is done with; otherwise it is halved, which keeps its shape.
const LEAST_SHARE: f64 = 0.15;

/// A piece is a needle if its height is less than this share of its length.
const NEEDLE: f64 = 0.1;

/// The squared share of its length that a cut must leave of a needle at most.
const SHORTER_SQ: f64 = 0.7;

/// Corners that are so near to such a side, in the distance to be proven, count as on it.
const ON_SIDE: f64 = 0.25;

/// A cut is placed to this share of its distance from the corner.
const PLACEMENT: f64 = 0.1;

/// The distance that is to be proven, and what of it each cut costs.
#[derive(Clone, Copy, Debug)]
pub(super) struct Limits {
    pub bound: f64,
    pub per_cut: f64,
}

impl Limits {
    /// The distance that the corners of a piece must keep.
    pub fn at(&self, depth: u32) -> f64 {
        // The subtraction may round up by less than the room that `per_cut` has.
        self.bound - f64::from(depth) * self.per_cut
    }
}

/// A triangle that is part of a source triangle, but for rounding.
#[derive(Clone, Copy, Debug)]
pub(super) struct Piece {
    pub corners: [Vector; 3],
    /// Cuts that led here: each may have moved a corner by one rounding.
    pub depth: u32,
}

/// Next step for a piece.
pub(super) enum Cut {
    /// All of it is near one target triangle.
    Proven,
    /// The share that one target triangle does not prove: one or two pieces.
    Rest([Option<Piece>; 2]),
    /// No target triangle at hand proves enough of it.
    TooLittle,
}

/// Edge of a regular triangle of area 1: 2 / 3^(1/4).
const REGULAR: f64 = 1.519_671_371_303_185;

impl Piece {
    pub fn whole(corners: [Vector; 3]) -> Piece {
        Piece { corners, depth: 0 }
    }

    /// The centroid, rounded.
    pub fn middle(&self) -> Vector {
        let [a, b, c] = self.corners;
        [0, 1, 2].map(|k| a[k] + ((b[k] - a[k]) + (c[k] - a[k])) / 3.0)
    }

    /// The largest distance of a corner from `middle`.
    pub fn radius(&self, middle: Vector) -> f64 {
        self.corners.iter().map(|&p| length_sq(sub(p, middle))).fold(0.0, f64::max).sqrt()
    }

    /// The square of the longest edge, and the corner it begins at.
    pub fn longest_sq(&self) -> (f64, usize) {
        let p = self.corners;
        let mut longest = (-1.0, 0);
        for i in 0..3 {
            let edge_sq = length_sq(sub(p[(i + 1) % 3], p[i]));
            if edge_sq > longest.0 {
                longest = (edge_sq, i);
            }
        }
        longest
    }

    /// The length of its longest edge, but no more than twice the edge of a regular triangle of the same area: a sliver is short.
    pub fn size(&self) -> f64 {
        let [a, b, c] = self.corners;
        let doubled = length_sq(cross(sub(b, a), sub(c, a))).sqrt();
        self.longest_sq().0.sqrt().min(2.0 * REGULAR * (0.5 * doubled).sqrt())
    }

    /// The largest bound of a corner's distance to `t`: a bound for the whole piece.
    pub fn upper(&self, t: &[Vector; 3]) -> f64 {
        self.corners.iter().map(|&corner| upper(corner, t)).fold(0.0, f64::max)
    }

    /// The same if it is at most `limit`.
    pub fn upper_within(&self, t: &[Vector; 3], limit: f64) -> Option<f64> {
        let mut most = 0f64;
        for &corner in &self.corners {
            let upper = upper(corner, t);
            if upper > limit || upper.is_nan() {
                return None;
            }
            most = most.max(upper);
        }
        Some(most)
    }

    /// Both halves, cut across the longest edge.
    pub fn halves(&self) -> [Piece; 2] {
        let (_, i) = self.longest_sq();
        let (a, b, apex) = (self.corners[i], self.corners[(i + 1) % 3], self.corners[(i + 2) % 3]);
        let middle = on_edge(a, b, 0.5);
        let depth = self.depth + 1;
        [Piece { corners: [a, middle, apex], depth }, Piece { corners: [middle, b, apex], depth }]
    }

    /// Cuts off what one of `candidates` proves to be within `limits`, the one that promises most.
    pub fn cut<'a>(
        &self,
        candidates: impl Iterator<Item = &'a [Vector; 3]>,
        limits: Limits,
    ) -> Cut {
        let (whole, limit) = (limits.at(self.depth), limits.at(self.depth + 1));
        let mut best: Option<(f64, &[Vector; 3], [f64; 3])> = None;
        for t in candidates {
            let distances = self.corners.map(|corner| upper(corner, t));
            if distances.iter().all(|&d| d <= whole) {
                return Cut::Proven;
            }
            if distances.iter().any(|&d| d <= limit) {
                // The chord ends before the limit, so this is no more than there is.
                let plan = self.plan(distances, limit, |from, to| {
                    (limit - distances[from]) / (distances[to] - distances[from])
                });
                let share = plan.share();
                if best.is_none_or(|(most, ..)| share > most) {
                    best = Some((share, t, distances));
                }
            }
        }
        let Some((_, t, distances)) = best else { return Cut::TooLittle };
        let plan = self.plan(distances, limit, |from, to| {
            let ends = [self.corners[from], self.corners[to]];
            reach(ends, [distances[from], distances[to]], t, limit)
        });
        if plan.share() < LEAST_SHARE {
            return Cut::TooLittle;
        }
        let rest = self.rest(&plan);
        let longest_sq =
            rest.iter().flatten().map(|piece| piece.longest_sq().0).fold(0.0, f64::max);
        // The area of a needle says nothing: it can shrink for ever while the needle keeps its length.
        match self.is_needle() && longest_sq > SHORTER_SQ * self.longest_sq().0 {
            true => Cut::TooLittle,
            false => Cut::Rest(rest),
        }
    }

    /// Cuts along that side of the prism over `t` which divides this most evenly; corners that are within a part
    /// of `limit` of it count as on it. `None` if no side divides it.
    ///
    /// Halves would not do: if target triangles meet in a corner of a piece, each half looks like the whole.
    pub fn part(&self, t: &[Vector; 3], limit: f64) -> Option<[Option<Piece>; 3]> {
        let normal = area_normal(t);
        let on = ON_SIDE * limit.max(0.0);
        let mut best: Option<(f64, [f64; 3])> = None;
        for i in 0..3 {
            let Some(across) = unit(cross(normal, sub(t[(i + 1) % 3], t[i]))) else { continue };
            let heights = self.corners.map(|corner| {
                let height = dot(across, sub(corner, t[i]));
                if height.abs() <= on { 0.0 } else { height }
            });
            let (low, high) = heights.iter().fold((0f64, 0f64), |(l, h), &x| (l.min(x), h.max(x)));
            let evenness = (-low).min(high);
            if evenness > 0.0 && best.is_none_or(|(most, _)| evenness > most) {
                best = Some((evenness, heights));
            }
        }
        let (_, heights) = best?;
        let depth = self.depth + 1;
        let piece = |corners| Some(Piece { corners, depth });
        let apex = (0..3).find(|&i| {
            heights[i] * heights[(i + 1) % 3] <= 0.0 && heights[i] * heights[(i + 2) % 3] <= 0.0
        })?;
        let (i, j) = ((apex + 1) % 3, (apex + 2) % 3);
        let (v, a, b) = (self.corners[apex], self.corners[i], self.corners[j]);
        let crossing = |from: usize, to: usize| {
            let share = heights[from] / (heights[from] - heights[to]);
            on_edge(self.corners[from], self.corners[to], share)
        };
        if heights[apex] == 0.0 {
            let middle = crossing(i, j);
            return Some([piece([v, a, middle]), piece([v, middle, b]), None]);
        }
        match (heights[i] == 0.0, heights[j] == 0.0) {
            (true, _) => {
                let middle = crossing(apex, j);
                Some([piece([v, a, middle]), piece([middle, a, b]), None])
            }
            (_, true) => {
                let middle = crossing(apex, i);
                Some([piece([v, middle, b]), piece([middle, a, b]), None])
            }
            _ => {
                let (c, d) = (crossing(apex, i), crossing(apex, j));
                let to_b = length_sq(sub(c, b)) <= length_sq(sub(d, a));
                let rest = if to_b { [[c, a, b], [c, b, d]] } else { [[c, a, d], [a, b, d]] };
                Some([piece([v, c, d]), piece(rest[0]), piece(rest[1])])
            }
        }
    }

    fn is_needle(&self) -> bool {
        let [a, b, c] = self.corners;
        let area_sq = length_sq(cross(sub(b, a), sub(c, a)));
        let longest_sq = self.longest_sq().0;
        area_sq <= NEEDLE * NEEDLE * longest_sq * longest_sq
    }

    /// Plans the cut by a target triangle that is near one or two corners.
    fn plan(&self, distances: [f64; 3], limit: f64, reach: impl Fn(usize, usize) -> f64) -> Plan {
        let is_in = distances.map(|d| d <= limit);
        let is_alone = is_in.iter().filter(|&&is_in| is_in).count() == 1;
        let apex = is_in.iter().position(|&is_in| is_in == is_alone).unwrap_or(0);
        let (i, j) = ((apex + 1) % 3, (apex + 2) % 3);
        match is_alone {
            true => Plan::Corner { apex, at: [reach(apex, i), reach(apex, j)] },
            false => Plan::AllBut { apex, at: [reach(i, apex), reach(j, apex)] },
        }
    }

    fn rest(&self, plan: &Plan) -> [Option<Piece>; 2] {
        let depth = self.depth + 1;
        let ends = |apex: usize| {
            (self.corners[apex], self.corners[(apex + 1) % 3], self.corners[(apex + 2) % 3])
        };
        match *plan {
            Plan::AllBut { apex, at } => {
                let (v, i, j) = ends(apex);
                let corners = [v, on_edge(i, v, at[0]), on_edge(j, v, at[1])];
                [Some(Piece { corners, depth }), None]
            }
            Plan::Corner { apex, at } => {
                let (v, i, j) = ends(apex);
                let (a, b) = (on_edge(v, i, at[0]), on_edge(v, j, at[1]));
                // The shorter diagonal of a, i, j, b.
                let to_j = length_sq(sub(a, j)) <= length_sq(sub(b, i));
                let both = if to_j { [[a, i, j], [a, j, b]] } else { [[a, i, b], [i, j, b]] };
                both.map(|corners| Some(Piece { corners, depth }))
            }
        }
    }
}

/// Places at which a piece is cut: shares of the way from a corner that is near to one that is not.
#[derive(Clone, Copy, Debug)]
enum Plan {
    /// All but the part next to corner `apex` is cut off; seen from the corners after it.
    AllBut { apex: usize, at: [f64; 2] },
    /// The part next to corner `apex` is cut off; seen from it.
    Corner { apex: usize, at: [f64; 2] },
}

impl Plan {
    /// The share of the area that is cut off.
    fn share(&self) -> f64 {
        match self {
            Plan::AllBut { at, .. } => 1.0 - (1.0 - at[0]) * (1.0 - at[1]),
            Plan::Corner { at, .. } => at[0] * at[1],
        }
    }
}

/// Returns how far along the edge from a point within `limit` of `t` to one beyond it all is within it: a share.
///
/// The distance is convex along the edge, so a chord ends before the limit and a tangent behind it. Wherever it
/// ends, the distance there was seen to be within the limit.
fn reach(ends: [Vector; 2], distances: [f64; 2], t: &[Vector; 3], limit: f64) -> f64 {
    let edge = sub(ends[1], ends[0]);
    let at = |share: f64| upper_and_way(on_edge(ends[0], ends[1], share), t);
    let (mut low, mut high) = ((0.0, distances[0]), (1.0, distances[1]));
    let mut way = None;
    for _ in 0..4 {
        let chord = low.0 + (high.0 - low.0) * ((limit - low.1) / (high.1 - low.1));
        if chord > low.0 && chord < high.0 {
            let (distance, off) = at(chord);
            if distance <= limit {
                low = (chord, distance);
            } else {
                (high, way) = ((chord, distance), Some(off));
            }
        }
        if high.0 - low.0 <= PLACEMENT * low.0 {
            break;
        }
        let off = way.unwrap_or_else(|| at(high.0).1);
        let slope = dot(off, edge) / length_sq(off).sqrt();
        let tangent = high.0 - (high.1 - limit) / slope;
        if !(tangent > low.0 && tangent < high.0) {
            break;
        }
        let (distance, off) = at(tangent);
        if distance <= limit {
            low = (tangent, distance);
            break;
        }
        (high, way) = ((tangent, distance), Some(off));
    }
    low.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sliver_is_short_and_other_triangles_are_as_large_as_their_longest_edge() {
        let size = |apex: [f64; 2]| {
            Piece::whole([[0.0; 3], [1.0, 0.0, 0.0], [apex[0], apex[1], 0.0]]).size()
        };
        assert!((size([0.5, 0.75f64.sqrt()]) - 1.0).abs() < 1e-12);
        assert!((size([0.0, 1.0]) - 2f64.sqrt()).abs() < 1e-12);
        // Of area 0.0005.
        assert!((size([0.5, 1e-3]) - 2.0 * 1.519_671_371 * 0.0005f64.sqrt()).abs() < 1e-9);
        assert_eq!(size([0.5, 0.0]), 0.0);
    }
}
