//! Content of a certificate: an interval that holds the Hausdorff distance, or a verdict about a bound.
//!
//! `certify` finds them.

use super::triangle::Vector;
use super::unit::Unit;

/// The least tolerance: below it rounding would decide.
pub const LEAST_TOLERANCE: f64 = 1e-9;

/// Places beyond a bound that are listed at most; a list that would be longer is left empty.
pub const MOST_BEYOND: usize = 16_384;

/// A place where a surface is farther from the other one than the bound that was asked for.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Beyond {
    /// The farthest point of one triangle that was come upon, on either surface.
    pub point: [f64; 3],
    /// Its distance from the other surface.
    pub distance: f64,
    /// Size of the triangle that it is on, or of the nearest one on the other surface: the longest edge, but twice the edge of a regular
    /// triangle of the same area at most, and the distance at least.
    pub size: f64,
}

/// Claim to be certified.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Certify {
    /// Width of the interval wanted, relative to its upper end.
    pub tolerance: f64,
    /// A bound that the upper end shall not exceed if the surfaces keep it, in input units.
    pub bound: Option<f64>,
}

impl Certify {
    /// The same in another unit of length.
    pub(super) fn in_unit(self, unit: Unit) -> Certify {
        Certify { bound: self.bound.map(|bound| unit.of(bound)), ..self }
    }
}

/// An interval that holds the two-sided Hausdorff distance. Lengths are in input units.
///
/// Infinite where one surface is empty and the other one is not, which JSON shows as null.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Certificate {
    /// Some point of one surface is at least so far from the other.
    pub lower: f64,
    /// No point of either surface is farther from the other.
    pub upper: f64,
    /// The width that was wanted, relative to `upper`.
    pub tolerance: f64,
    /// `upper - lower` is at most `tolerance * upper`, or what rounding hides.
    pub certified: bool,
    /// The point that is at least `lower` away; without one if the distance is 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub witness: Option<[f64; 3]>,
    /// The surface that the point is on.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub witness_on: Option<On>,
    /// Places farther apart than the bound that was asked for, one a triangle; empty if it is kept, or if the
    /// distance is more than twice the bound, or if there are more than `MOST_BEYOND`.
    #[serde(skip)]
    pub beyond: Vec<Beyond>,
}

/// One of the two surfaces.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum On {
    /// The original.
    Original,
    /// The simplified mesh.
    Simplified,
}

/// Verdict on two surfaces being within a distance of each other, both ways.
#[derive(Clone, Debug, PartialEq)]
pub enum Verdict {
    /// No point of either surface is farther than this from the other, which is at most the bound.
    Within(f64),
    /// This point of a surface is farther than the bound, by a distance that is a proven lower bound.
    Beyond {
        /// The surface that the point is on.
        on: On,
        /// Position of the point.
        point: [f64; 3],
        /// Least distance from the other surface.
        distance: f64,
    },
    /// The distance is so near the bound that rounding decides: it lies in this interval.
    Undecided {
        /// Lower end.
        lower: f64,
        /// Upper end.
        upper: f64,
    },
}

impl Certificate {
    /// The same in input units.
    pub(super) fn back(self, unit: Unit) -> Certificate {
        let place = |point: Vector| point.map(|x| unit.back(x));
        Certificate {
            lower: unit.back(self.lower),
            upper: unit.back(self.upper),
            witness: self.witness.map(place),
            beyond: self.beyond.into_iter().map(|one| one.back(unit)).collect(),
            ..self
        }
    }
}

impl Beyond {
    /// The same in input units.
    fn back(self, unit: Unit) -> Beyond {
        Beyond {
            point: self.point.map(|x| unit.back(x)),
            distance: unit.back(self.distance),
            size: unit.back(self.size),
        }
    }
}

impl Verdict {
    /// The same in input units.
    pub(super) fn back(self, unit: Unit) -> Verdict {
        match self {
            Verdict::Within(upper) => Verdict::Within(unit.back(upper)),
            Verdict::Beyond { on, point, distance } => Verdict::Beyond {
                on,
                point: point.map(|x| unit.back(x)),
                distance: unit.back(distance),
            },
            Verdict::Undecided { lower, upper } => {
                Verdict::Undecided { lower: unit.back(lower), upper: unit.back(upper) }
            }
        }
    }
}
