//! The two-sided Hausdorff distance of two surfaces, enclosed: an interval that is proven, not sampled.
//!
//! From below by one point, whose distance is bounded over all triangles near it (`witness`); from above by
//! covering every source triangle with what lies near target triangles (`cover`). Only triangles count: vertices
//! that no triangle uses do not. docs/design/certificate.md has the proofs, rounding included.

mod bound;
mod cover;
mod exact;
mod nearby;
mod passes;
mod piece;
mod sheet;
mod witness;

use super::certificate::{Certificate, Certify, LEAST_TOLERANCE, MOST_BEYOND, On, Verdict};
use super::parts::{Means, Parts, Place, Survey};
use super::side::Side;
use super::tree::Tree;
use super::triangle::Vector;
use bound::{lower, off_edge, upper};
use cover::{Far, Found, ProofGoal};
use passes::Way;
use std::cmp::Ordering;
use stonecut_mesh::bounds::Bounds;
use stonecut_system::error::Result;

/// Bound on the rounding of all cuts, in that of one cut: pieces are cut that often before they no longer count.
const FLOOR_CUTS: f64 = 1024.0;

/// Places beyond a bound are listed where sampling found none farther than this many times the bound.
const LISTED: f64 = 2.0;

/// Both surfaces in one unit, and the boxes of their parts.
pub(super) struct Pair<'a> {
    parts: [&'a Parts<'a>; 2],
    surveys: [Option<&'a Survey>; 2],
    boxes: [Vec<Bounds>; 2],
    /// Trees over surfaces in memory, where they have been built.
    trees: [Option<Tree>; 2],
}

impl<'a> Pair<'a> {
    /// The pair of the original and the simplified mesh; surveys are needed of what is in cells.
    pub fn new(parts: [&'a Parts<'a>; 2], surveys: [Option<&'a Survey>; 2]) -> Self {
        let boxes = [0, 1].map(|i| match surveys[i] {
            Some(survey) => survey.boxes.clone(),
            None => vec![parts[i].bounds],
        });
        Pair { parts, surveys, boxes, trees: Default::default() }
    }

    /// The same with trees over those that are in memory: each is dropped when it was used.
    pub fn with_trees(self, trees: [Option<Tree>; 2]) -> Self {
        Pair { trees, ..self }
    }

    /// Bound on the rounding.
    fn floor(&self) -> f64 {
        let both = self.parts[0].bounds.or_origin().joined(&self.parts[1].bounds.or_origin());
        FLOOR_CUTS
            * off_edge(both.low.iter().chain(&both.high).fold(0.0, |most, x| x.abs().max(most)))
    }

    /// Encloses the distance; `sides` are those of a measurement, whose farthest points tell where to begin.
    pub fn enclose(
        &mut self,
        sides: [&Side; 2],
        certify: Certify,
        means: Means,
    ) -> Result<Certificate> {
        let tolerance = certify.tolerance.max(LEAST_TOLERANCE);
        let known = [0, 1].map(|i| far_of(sides[i]));
        if sides.iter().any(|side| side.distance.max.is_infinite()) {
            let (lower, upper) = (f64::INFINITY, f64::INFINITY);
            return Ok(Certificate {
                lower,
                upper,
                tolerance,
                certified: false,
                witness: None,
                witness_on: None,
                beyond: Vec::new(),
            });
        }
        if self.is_one_mesh() {
            let (lower, upper) = (0.0, 0.0);
            return Ok(Certificate {
                lower,
                upper,
                tolerance,
                certified: true,
                witness: None,
                witness_on: None,
                beyond: Vec::new(),
            });
        }
        let floor = self.floor();
        let mut goal = ProofGoal {
            bound: 0.0,
            tolerance,
            floor,
            stops_beyond: false,
            listed_above: f64::INFINITY,
        };
        let farthest = known.iter().flatten().map(|far| far.distance).fold(0.0, f64::max);
        goal.bound = goal.raised(0.0, farthest);
        // Far beyond a bound nearly every triangle would have to be cut.
        if let Some(bound) = certify.bound
            && farthest <= LISTED * bound
        {
            goal.bound = goal.bound.min(bound);
            goal.listed_above = bound;
        }
        let mut found = self.prove(&mut goal, means)?;
        let mut farthest: Option<(Far, usize)> = None;
        for i in 0..2 {
            for far in known[i].iter().chain(&found[i].far) {
                if far.beats(&farthest.map(|(far, _)| far)) {
                    farthest = Some((*far, i));
                }
            }
        }
        let lower = self.lower(farthest, means)?;
        let is_apart = found.iter().any(|found| found.is_apart);
        let upper = if is_apart { goal.bound } else { 0.0 };
        let gap = upper - lower;
        let certified = gap <= (tolerance * upper).max(2.0 * floor);
        let witness = farthest.filter(|_| lower > 0.0);
        let on = |i: usize| [On::Original, On::Simplified][i];
        let mut beyond = found.each_mut().map(|found| std::mem::take(&mut found.beyond)).concat();
        // Cells end in any order.
        beyond.sort_unstable_by(|a, b| a.point.partial_cmp(&b.point).unwrap_or(Ordering::Equal));
        if found.iter().any(|found| found.has_too_many) || beyond.len() > MOST_BEYOND {
            beyond.clear();
        }
        Ok(Certificate {
            lower,
            upper,
            tolerance,
            certified,
            witness: witness.map(|(far, _)| far.point),
            witness_on: witness.map(|(_, i)| on(i)),
            beyond,
        })
    }

    /// True if both are in memory and the same to the last bit.
    fn is_one_mesh(&self) -> bool {
        match self.parts.map(|parts| parts.place) {
            [Place::Memory(a), Place::Memory(b)] => {
                a.triangles == b.triangles && a.positions == b.positions
            }
            _ => false,
        }
    }

    /// Proves both ways, one after the other; the bound grows where a point beyond it is found.
    fn prove(&mut self, goal: &mut ProofGoal, means: Means) -> Result<[Found; 2]> {
        let mut found = [Found::default(), Found::default()];
        let asked = goal.bound.min(goal.listed_above);
        for i in 0..2 {
            let (source, target) = (self.parts[i], self.parts[1 - i]);
            // Where places beyond the bound are listed, both ways begin at the bound.
            let bound = if goal.listed_above.is_finite() { asked } else { goal.bound };
            let begin = ProofGoal { bound, ..*goal };
            let way = Way { source, target, survey: self.surveys[1 - i], goal: begin };
            found[i] = way.prove(self.trees[1 - i].take(), means)?;
            goal.bound = goal.bound.max(found[i].upper);
            if found[i].is_over(goal) {
                break;
            }
        }
        Ok(found)
    }

    /// A lower bound of the distance: that of the farthest point known, less what it is off its own surface.
    fn lower(&self, farthest: Option<(Far, usize)>, means: Means) -> Result<f64> {
        let Some((far, i)) = farthest.filter(|(far, _)| far.distance > 0.0) else { return Ok(0.0) };
        let target = (self.parts[1 - i], &self.boxes[1 - i][..]);
        let most = far.distance * (1.0 + 1e-6);
        let distance = witness::least(far.point, target, lower, most, means)?;
        let own = (self.parts[i], &self.boxes[i][..]);
        let off = witness::least(far.point, own, upper, f64::INFINITY, means)?;
        Ok(((distance - off) * (1.0 - f64::EPSILON)).max(0.0))
    }

    /// Finds out if the distance is at most `bound`, and stops as soon as that is certain.
    pub fn within(&mut self, bound: f64, means: Means) -> Result<Verdict> {
        if self.is_one_mesh() {
            return Ok(Verdict::Within(0.0));
        }
        for (i, on) in [On::Original, On::Simplified].into_iter().enumerate() {
            let point = self.any_point(i)?;
            if let (Some(point), None) = (point, self.any_point(1 - i)?) {
                return Ok(Verdict::Beyond { on, point, distance: f64::INFINITY });
            }
        }
        let floor = self.floor();
        let mut goal = ProofGoal {
            bound,
            tolerance: 0.0,
            floor,
            stops_beyond: true,
            listed_above: f64::INFINITY,
        };
        let found = self.prove(&mut goal, means)?;
        let is_apart = found.iter().any(|found| found.is_apart);
        let far = [0, 1].into_iter().find_map(|i| found[i].far.map(|far| (far, i)));
        let lower = self.lower(far, means)?;
        Ok(match far {
            Some((far, i)) if lower > bound => Verdict::Beyond {
                on: [On::Original, On::Simplified][i],
                point: far.point,
                distance: lower,
            },
            None if goal.bound <= bound => Verdict::Within(if is_apart { bound } else { 0.0 }),
            None => Verdict::Undecided { lower, upper: goal.bound },
            // The search has stopped there: nothing is known of the rest.
            Some(_) => self.undecided(lower, bound, means)?,
        })
    }

    /// A point of one of the surfaces, if it has any.
    fn any_point(&self, i: usize) -> Result<Option<Vector>> {
        let parts = self.parts[i];
        let part = (0..parts.n_parts()).find(|&part| parts.n_triangles(part) > 0);
        part.map(|part| Ok(parts.load(part)?.corners(0)[0])).transpose()
    }

    /// The interval of a distance that is about the bound.
    fn undecided(&mut self, lower: f64, bound: f64, means: Means) -> Result<Verdict> {
        let floor = self.floor();
        let mut goal = ProofGoal {
            bound: bound + 2.0 * floor,
            tolerance: LEAST_TOLERANCE,
            floor,
            stops_beyond: false,
            listed_above: f64::INFINITY,
        };
        self.prove(&mut goal, means)?;
        Ok(Verdict::Undecided { lower, upper: goal.bound })
    }
}

/// The farthest point of one direction of a measurement.
fn far_of(side: &Side) -> Option<Far> {
    side.worst.map(|point| Far { point, distance: side.distance.max })
}
