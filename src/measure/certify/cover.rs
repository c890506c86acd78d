//! Proves source triangles near one tree of target triangles, piece by piece.
//!
//! Most triangles are done with at once: one target triangle is near all three corners. The others are cut and
//! halved until every piece is near some target triangle, depth first. What a cell of the target cannot prove
//! alone is left for other cells. Knows nothing of cells but their boxes.

use super::bound::upper;
use super::piece::{Cut, Limits, Piece};
use super::sheet::{Frame, Neighbours, Sheets};
use crate::certificate::{Beyond, MOST_BEYOND};
use crate::tree::Tree;
use crate::triangle::Vector;
use stonecut_mesh::Mesh;
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

/// Distances to be proven, in what rounding hides, for which a bound that is not the least one will do.
const ROUGH: f64 = 4.0;

/// Vertices for which it is remembered which target triangle was near: those of a block of triangles, as a rule.
const SEEN: usize = 1 << 13;

/// Question that is put.
#[derive(Clone, Copy, Debug)]
pub(super) struct ProofGoal {
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

impl ProofGoal {
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
    /// Triangles farther than `ProofGoal::listed_above`.
    pub beyond: Vec<Beyond>,
    /// There were more than `MOST_BEYOND` of them; none is kept then.
    pub has_too_many: bool,
    /// Something is not proven within the bound that was asked for.
    pub is_given_up: bool,
    /// Pieces looked at.
    pub n_steps: u64,
    /// Source triangles, and halves of them, that the nearest target triangle was searched for.
    pub n_searched: u64,
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
        self.n_searched += other.n_searched;
    }

    /// The bound that holds a point too, which is exactly so far from the target; notes the point if it is far.
    pub fn raise(
        &mut self,
        goal: &ProofGoal,
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
    pub fn is_over(&self, goal: &ProofGoal) -> bool {
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

/// Findings about a piece that was not proven at once.
struct Miss {
    /// The target triangle nearest to its middle, if that is known.
    nearest: Option<u32>,
    /// Target triangles that a sheet over it had, if one was tried.
    n_shown: usize,
}

/// One target tree, and what is being found out about the source.
pub(super) struct Cover<'a> {
    tree: &'a Tree,
    is_final: Final,
    goal: ProofGoal,
    per_cut: f64,
    progress: &'a Progress,
    hint: u32,
    /// Target triangles that were last near a vertex of the source, by the last bits of its number.
    seen: Vec<u32>,
    /// The plane of the triangle that was tried last.
    frame: Option<(u32, Option<Frame>)>,
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
        goal: ProofGoal,
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
            seen: Vec::new(),
            frame: None,
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

    /// Proves a triangle of a mesh, or leaves parts of it; those before it say which target triangles are near its vertices.
    pub fn cover_triangle(&mut self, mesh: &Mesh, triangle: usize) -> Result<()> {
        self.seen.resize(SEEN, u32::MAX);
        let places = mesh.triangles[triangle].map(|v| v as usize % SEEN);
        let near = places.map(|place| self.seen[place]);
        self.cover_near(Piece::whole(mesh.corners(triangle)), &near)?;
        places.into_iter().for_each(|place| self.seen[place] = self.hint);
        Ok(())
    }

    /// Proves one piece, or leaves parts of it.
    pub fn cover(&mut self, piece: Piece) -> Result<()> {
        self.cover_near(piece, &[])
    }

    /// The same; target triangles that may be `near` are tried first.
    fn cover_near(&mut self, piece: Piece, near: &[u32]) -> Result<()> {
        self.found.n_steps += 1;
        if self.tree.is_empty() {
            self.left.push(piece);
            return Ok(());
        }
        match self.at_once(&piece, near) {
            Ok(upper) => {
                self.found.is_apart |= upper > 0.0;
                self.found.upper = self.found.upper.max(self.goal.bound);
                Ok(())
            }
            Err(miss) => {
                self.found.is_apart = true;
                self.worst = None;
                self.by_sheets(piece, miss)?;
                let worst = self.worst.take();
                self.found.beyond.extend(worst.filter(|_| self.found.beyond.len() <= MOST_BEYOND));
                Ok(())
            }
        }
    }

    /// Proves a source triangle, or halves of it, by sheets; searches where that fails.
    fn by_sheets(&mut self, whole: Piece, miss: Miss) -> Result<()> {
        let size = whole.size();
        if self.sheets.is_none() {
            return self.search(whole, miss.nearest, size);
        }
        let mut waiting = vec![(whole, miss, self.hint)];
        while let Some((piece, Miss { nearest, n_shown }, near)) = waiting.pop() {
            let limit = self.limits(self.goal.bound).at(piece.depth);
            let tried = match n_shown > FEW {
                true => Some(Err(n_shown)),
                false => self.sheets.as_mut().map(|sheets| sheets.prove(&piece, near, limit)),
            };
            match tried {
                Some(Ok(over)) => {
                    self.hint = over;
                    self.found.n_steps += 1;
                    self.found.upper = self.found.upper.max(self.goal.bound);
                }
                Some(Err(n)) if n > FEW && piece.depth < whole.depth + MOST_HALVED => {
                    for half in piece.halves() {
                        self.found.n_steps += 1;
                        if let Err(miss) = self.at_once(&half, &[]) {
                            waiting.push((half, miss, self.hint));
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

    /// The bound that one triangle, or a sheet from the first of those that may be `near`, proves for the whole piece, if
    /// that is near enough.
    fn at_once(&mut self, piece: &Piece, near: &[u32]) -> Result<f64, Miss> {
        let limit = self.limits(self.goal.bound).at(piece.depth);
        // Where everything may be in its place still, only that counts at first.
        let is_lazy = self.goal.bound <= self.goal.floor;
        let lazy = if is_lazy { 0.0 } else { limit };
        let last = self.hint;
        let others = near.iter().copied().filter(|&slot| slot != last);
        for slot in std::iter::once(last).chain(others) {
            if (slot as usize) < self.tree.len()
                && let Some(upper) = self.guess(piece, slot, limit)
                && upper <= lazy
            {
                self.hint = slot;
                return Ok(upper);
            }
        }
        // A small piece over an edge of the target: the triangles there are known by now.
        let mut n_shown = 0;
        if !is_lazy && let Some(sheets) = &mut self.sheets {
            for &seed in near.iter().filter(|&&seed| (seed as usize) < self.tree.len()) {
                self.found.n_steps += 1;
                match sheets.prove(piece, seed, limit) {
                    Ok(over) => {
                        self.hint = over;
                        return Ok(limit);
                    }
                    // One alone is beside the piece.
                    Err(n) => n_shown = n_shown.max(n),
                }
                if n_shown > 1 {
                    break;
                }
            }
        }
        self.found.n_searched += 1;
        let middle = piece.middle();
        // So near to the middle, a triangle is near enough to the corners as well.
        let enough = limit - piece.radius(middle);
        let enough_sq = if enough > 0.0 && lazy > 0.0 { enough * enough } else { -1.0 };
        let near = self.tree.guess(middle, self.hint);
        let found = self.tree.nearest_unless_within(middle, near, enough_sq);
        self.hint = found.slot;
        // One that ended the search before its end need not be the nearest.
        let is_nearest = found.distance_sq > enough_sq;
        let guess = piece.upper_within(self.tree.corners(found.slot), limit);
        guess.ok_or(Miss { nearest: is_nearest.then_some(found.slot), n_shown })
    }

    /// A bound for the whole piece by one triangle, if that is at most `limit`; that of the triangle tried last need not be the
    /// least one.
    #[inline]
    fn guess(&mut self, piece: &Piece, slot: u32, limit: f64) -> Option<f64> {
        let corners = self.tree.corners(slot);
        if slot != self.hint || limit <= ROUGH * self.goal.floor {
            return piece.upper_within(corners, limit);
        }
        if self.frame.as_ref().is_none_or(|(of, _)| *of != slot) {
            self.frame = Some((slot, Frame::new(corners)));
        }
        let frame = self.frame.as_ref().and_then(|(_, frame)| frame.as_ref());
        let is_near = |&point: &Vector| {
            frame.is_some_and(|frame| frame.is_below(point, limit))
                || upper(point, corners) <= limit
        };
        piece.corners.iter().all(is_near).then_some(limit)
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

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)] // A test fails by panicking.

    use super::*;
    use crate::certify::bound::off_edge;

    /// A rolling square of `n` by `n` squares, or half as many along each axis.
    fn waves(n: u32, step: u32) -> Mesh {
        let m = n / step;
        let place = |v: u32| {
            let [x, y] = [v % (m + 1), v / (m + 1)].map(|i| f64::from(i * step) / f64::from(n));
            [x, y, 0.1 * (5.0 * x).sin() * (4.0 * y).cos()]
        };
        let corners = |square: u32| {
            let a = square / m * (m + 1) + square % m;
            [[a, a + 1, a + m + 2], [a, a + m + 2, a + m + 1]]
        };
        let positions = (0..(m + 1) * (m + 1)).map(place).collect();
        Mesh::new(positions, (0..m * m).flat_map(corners).collect())
    }

    #[test]
    fn few_triangles_of_a_fine_mesh_need_a_search() {
        let (fine, coarse) = (waves(96, 1), waves(96, 3));
        let tree = Tree::build(coarse.triangles.len(), |i| coarse.corners(i));
        let neighbours = Neighbours::new(&tree, &coarse);
        let goal = ProofGoal {
            bound: 2e-3,
            tolerance: 0.01,
            floor: 1e-12,
            stops_beyond: false,
            listed_above: f64::INFINITY,
        };
        let progress = Progress::default();
        let mut cover = Cover::new(&tree, Final::Always, goal, off_edge(1.0), &progress)
            .with_sheets(&neighbours);
        for i in 0..fine.triangles.len() {
            cover.cover_triangle(&fine, i).unwrap();
        }
        assert_eq!((cover.found.upper, cover.found.far), (goal.bound, None));
        let n = fine.triangles.len() as u64;
        assert!(cover.found.n_searched < n / 8, "{} of {n}", cover.found.n_searched);
    }
}
