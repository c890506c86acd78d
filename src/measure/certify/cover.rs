//! Proves source triangles near one tree of target triangles, piece by piece.
//!
//! Most triangles are done with at once: one target triangle is near all three corners. The others are cut and
//! halved until every piece is near some target triangle, depth first. What a cell of the target cannot prove
//! alone is left for other cells. Knows nothing of cells but their boxes.

use super::bound::upper;
use super::piece::{Cut, Limits, Piece};
use super::sheet::{Neighbours, Sheets};
use crate::certificate::{Beyond, MOST_BEYOND};
use crate::tree::Tree;
use crate::triangle::Vector;
use stonecut_mesh::bounds::Bounds;
use stonecut_system::error::Result;
use stonecut_system::progress::Progress;

/// Pieces of one source triangle that are looked at; beyond that it counts as it stands.
pub(super) const MOST_STEPS: u64 = 4_000_000;

/// Cuts that a middle is nearer than the bound where its nearest triangle is not looked for.
const CLEARLY: u32 = 64;

/// Target triangles that a piece is held against besides the one nearest to its middle.
const KEPT: usize = 2;

/// Pieces between two looks at the wish to stop.
const STOP_STEPS: u64 = 256;

/// Distance of the middle of a piece below which halving it gains something, in the distance to be proven.
const COVERABLE: f64 = 0.9;

/// Target triangles over a piece below which halves of it are not tried with sheets.
const FEW: usize = 6;

/// Most halvings of a source triangle for sheets.
const MOST_HALVED: u32 = 16;

/// Question that is put.
#[derive(Clone, Copy, Debug)]
pub(super) struct Goal {
    /// The distance to be proven where no point is found to be farther.
    pub bound: f64,
    /// Largest excess of the bound over the farthest point, relative to it.
    pub tolerance: f64,
    /// The same in units of length: what rounding hides.
    pub floor: f64,
    /// Ends the search at a point that is farther than the bound.
    pub stops_beyond: bool,
    /// Lists the triangles that are farther than this; infinite for none.
    pub listed_above: f64,
}

impl Goal {
    /// The bound to be proven once a point was found at a distance beyond `bound`.
    pub fn raised(&self, bound: f64, distance: f64) -> f64 {
        let raised = bound.max(distance * (1.0 + self.tolerance)).max(distance + self.floor);
        // A bound that was asked for is not passed without need.
        if distance + self.floor <= self.listed_above {
            raised.min(self.listed_above)
        } else {
            raised
        }
    }
}

/// A point of the source that is far from the target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Far {
    pub point: Vector,
    pub distance: f64,
}

impl Far {
    /// True if this is farther than another one, or as far and first by its coordinates.
    pub fn beats(&self, other: &Option<Far>) -> bool {
        other.is_none_or(|other| {
            self.distance > other.distance
                || (self.distance == other.distance && self.point < other.point)
        })
    }
}

/// Findings about some source triangles.
#[derive(Clone, Debug, Default)]
pub(super) struct Found {
    /// All that was not left is at most so far from the target.
    pub upper: f64,
    /// Everything lies in one target triangle with its corners; `upper` is then 0 whatever it says.
    pub is_apart: bool,
    /// The farthest point that was come upon, where that is farther than the bound.
    pub far: Option<Far>,
    /// Triangles farther than `Goal::listed_above`.
    pub beyond: Vec<Beyond>,
    /// There were more than `MOST_BEYOND` of them; none is kept then.
    pub has_too_many: bool,
    /// Something is not proven within the bound that was asked for.
    pub is_given_up: bool,
    /// Pieces looked at.
    pub n_steps: u64,
}

impl Found {
    /// Takes in what was found out about others.
    pub fn merge(&mut self, other: &Found) {
        self.upper = self.upper.max(other.upper);
        self.is_apart |= other.is_apart;
        if other.far.is_some_and(|far| far.beats(&self.far)) {
            self.far = other.far;
        }
        self.beyond.extend_from_slice(&other.beyond);
        self.has_too_many |= other.has_too_many || self.beyond.len() > MOST_BEYOND;
        if self.has_too_many {
            self.beyond.clear();
        }
        self.is_given_up |= other.is_given_up;
        self.n_steps += other.n_steps;
    }

    /// The bound that holds a point too, which is exactly so far from the target; notes the point if it is far.
    pub fn raise(
        &mut self,
        goal: &Goal,
        limits: Limits,
        (point, distance): (Vector, f64),
        depth: u32,
    ) -> f64 {
        let bound = limits.bound;
        // One more cut at the point must fit below the bound, or it would never be proven.
        let off = f64::from(depth + 1) * limits.per_cut;
        if distance + off <= bound {
            return bound;
        }
        if distance > bound || !goal.stops_beyond {
            let far = Far { point, distance };
            if far.beats(&self.far) {
                self.far = Some(far);
            }
        }
        if distance > bound {
            return goal.raised(bound, distance).max(distance + 2.0 * off);
        }
        distance + goal.floor.max(2.0 * off)
    }

    /// True if the search has come to its end before everything was looked at.
    pub fn is_over(&self, goal: &Goal) -> bool {
        goal.stops_beyond && self.far.is_some()
    }
}

/// Knowledge of the target outside of a tree.
pub(super) enum Final {
    /// All of the target is in the tree.
    Always,
    /// Boxes of the other cells, which may hold something nearer.
    Outside(Vec<Bounds>),
    /// Everything within this distance is in the tree.
    Within(f64),
}

impl Final {
    /// True if nothing outside of the tree is nearer to a point than `distance`.
    fn holds(&self, point: Vector, distance: f64) -> bool {
        match self {
            Final::Always => true,
            Final::Within(reach) => distance <= *reach,
            Final::Outside(boxes) => {
                let distance_sq = distance * distance;
                boxes.iter().all(|other| other.distance_sq(point) >= distance_sq)
            }
        }
    }
}

/// A piece, and target triangles that proved what it was cut from, or are near the middle of that.
#[derive(Clone, Copy)]
struct Open {
    piece: Piece,
    slots: [u32; KEPT],
}

/// One target tree, and what is being found out about the source.
pub(super) struct Cover<'a> {
    tree: &'a Tree,
    is_final: Final,
    goal: Goal,
    per_cut: f64,
    progress: &'a Progress,
    hint: u32,
    /// Proofs by sheets, where it is known which target triangles hang together.
    sheets: Option<Sheets<'a>>,
    stack: Vec<Open>,
    /// The farthest place of the present source triangle beyond what is listed.
    worst: Option<Beyond>,
    pub found: Found,
    /// Pieces that this tree does not prove.
    pub left: Vec<Piece>,
}

impl<'a> Cover<'a> {
    pub fn new(
        tree: &'a Tree,
        is_final: Final,
        goal: Goal,
        per_cut: f64,
        progress: &'a Progress,
    ) -> Self {
        Cover {
            tree,
            is_final,
            goal,
            per_cut,
            progress,
            hint: u32::MAX,
            sheets: None,
            stack: Vec::new(),
            worst: None,
            found: Found::default(),
            left: Vec::new(),
        }
    }

    /// The same where it is known which triangles of the tree hang together.
    pub fn with_sheets(self, neighbours: &'a Neighbours) -> Self {
        Cover { sheets: Some(Sheets::new(self.tree, neighbours)), ..self }
    }

    /// Proves one piece, or leaves parts of it.
    pub fn cover(&mut self, piece: Piece) -> Result<()> {
        self.found.n_steps += 1;
        if self.tree.is_empty() {
            self.left.push(piece);
            return Ok(());
        }
        match self.at_once(&piece) {
            Ok(upper) => {
                self.found.is_apart |= upper > 0.0;
                self.found.upper = self.found.upper.max(self.goal.bound);
                Ok(())
            }
            Err(nearest) => {
                self.found.is_apart = true;
                self.worst = None;
                self.by_sheets(piece, nearest)?;
                let worst = self.worst.take();
                self.found.beyond.extend(worst.filter(|_| self.found.beyond.len() <= MOST_BEYOND));
                Ok(())
            }
        }
    }

    /// Proves a source triangle, or halves of it, by sheets; searches where that fails.
    fn by_sheets(&mut self, whole: Piece, nearest: Option<u32>) -> Result<()> {
        let size = whole.size();
        if self.sheets.is_none() {
            return self.search(whole, nearest, size);
        }
        let mut waiting = vec![(whole, nearest, self.hint)];
        while let Some((piece, nearest, near)) = waiting.pop() {
            let limit = self.limits(self.goal.bound).at(piece.depth);
            let tried = self.sheets.as_mut().map(|sheets| sheets.prove(&piece, near, limit));
            match tried {
                Some(Ok(())) => {
                    self.found.n_steps += 1;
                    self.found.upper = self.found.upper.max(self.goal.bound);
                }
                Some(Err(n)) if n > FEW && piece.depth < whole.depth + MOST_HALVED => {
                    for half in piece.halves() {
                        self.found.n_steps += 1;
                        if let Err(nearest) = self.at_once(&half) {
                            waiting.push((half, nearest, self.hint));
                        }
                    }
                }
                _ => {
                    self.search(piece, nearest, size)?;
                    if self.found.is_over(&self.goal) {
                        return Ok(());
                    }
                }
            }
        }
        Ok(())
    }

    /// The bound that one triangle proves for the whole piece, if that is near enough. Otherwise the triangle that is nearest
    /// to the middle, if it is known.
    fn at_once(&mut self, piece: &Piece) -> Result<f64, Option<u32>> {
        let limit = self.limits(self.goal.bound).at(piece.depth);
        // Where everything may be in its place still, only that counts at first.
        let lazy = if self.goal.bound <= self.goal.floor { 0.0 } else { limit };
        let guess = |slot: u32| piece.upper_within(self.tree.corners(slot), limit);
        if (self.hint as usize) < self.tree.len()
            && let Some(upper) = guess(self.hint)
            && upper <= lazy
        {
            return Ok(upper);
        }
        let middle = piece.middle();
        // So near to the middle, a triangle is near enough to the corners as well.
        let enough = limit - piece.radius(middle);
        let enough_sq = if enough > 0.0 && lazy > 0.0 { enough * enough } else { -1.0 };
        let near = self.tree.guess(middle, self.hint);
        let found = self.tree.nearest_unless_within(middle, near, enough_sq);
        self.hint = found.slot;
        // One that ended the search before its end need not be the nearest.
        let is_nearest = found.distance_sq > enough_sq;
        guess(found.slot).ok_or(is_nearest.then_some(found.slot))
    }

    fn limits(&self, bound: f64) -> Limits {
        Limits { bound, per_cut: self.per_cut }
    }

    fn search(&mut self, whole: Piece, mut nearest: Option<u32>, size: f64) -> Result<()> {
        let mut bound = self.goal.bound;
        let mut steps = 0;
        self.stack.clear();
        self.stack.push(Open { piece: whole, slots: [self.hint; KEPT] });
        while let Some(Open { piece, slots }) = self.stack.pop() {
            steps += 1;
            if steps % STOP_STEPS == 0 {
                self.progress.check()?;
            }
            let middle = piece.middle();
            // So near to the middle, a triangle proves the piece, and need not be the nearest.
            // It must be clearly nearer than what raises the bound, which takes the nearest.
            let enough = self.limits(bound).at(piece.depth + CLEARLY) - piece.radius(middle);
            let enough_sq = if enough > 0.0 { enough * enough } else { -1.0 };
            let near = nearest.take().unwrap_or_else(|| {
                let guess = self.tree.guess(middle, slots[0]);
                self.tree.nearest_unless_within(middle, guess, enough_sq).slot
            });
            let distance = upper(middle, self.tree.corners(near));
            let is_final = self.is_final.holds(middle, distance);
            if is_final {
                let limits = self.limits(bound);
                bound = self.found.raise(&self.goal, limits, (middle, distance), piece.depth);
                if self.found.is_over(&self.goal) {
                    return Ok(());
                }
                let most = self.worst.map_or(self.goal.listed_above, |worst| worst.distance);
                if distance > most {
                    let other = Piece::whole(*self.tree.corners(near)).size();
                    let size = size.max(other).max(distance);
                    self.worst = Some(Beyond { point: middle, distance, size });
                }
            }
            if steps > MOST_STEPS {
                let off = f64::from(piece.depth) * self.per_cut;
                bound = bound.max(piece.upper(self.tree.corners(near)) + off);
                self.found.is_given_up = true;
                continue;
            }
            let limits = self.limits(bound);
            let slots = [near, slots[0], slots[1]];
            let n = 1 + KEPT - usize::from(slots[1] == slots[2]);
            let candidates = slots[..n].iter().map(|&slot| self.tree.corners(slot));
            let kept = [near, if slots[1] == near { slots[2] } else { slots[1] }];
            let open = |piece: Piece| Open { piece, slots: kept };
            match piece.cut(candidates, limits) {
                Cut::Proven => {}
                Cut::Rest(pieces) => self.stack.extend(pieces.into_iter().flatten().map(open)),
                Cut::TooLittle => {
                    let limit = limits.at(piece.depth);
                    let corners = self.tree.corners(near);
                    let parts = if distance <= limit { piece.part(corners, limit) } else { None };
                    if let Some(parts) = parts {
                        self.stack.extend(parts.into_iter().flatten().map(open));
                    } else if is_final || distance <= COVERABLE * limit {
                        self.stack.extend(piece.halves().map(open));
                    } else {
                        self.left.push(piece);
                    }
                }
            }
        }
        self.found.n_steps += steps;
        self.found.upper = self.found.upper.max(bound);
        Ok(())
    }
}
