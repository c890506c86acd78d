//! The unit of length in which a measurement computes: a power of two, so that changing it rounds nothing.
//!
//! Areas are products of two lengths and the closest point of a triangle takes products of four, so
//! coordinates of 1e150 would overflow and those of 1e-150 vanish. Ordinary meshes keep their own unit.

use super::deviation::Deviation;
use super::side::{Side, Spread};
use super::triangle::Vector;
use stonecut_mesh::Mesh;
use stonecut_mesh::bounds::Bounds;

/// Powers of two up to which products of four lengths, and of small parts of them, are far from all limits.
const FREE: i32 = 60;

/// The largest change; twice that is beyond what one factor can express.
const MOST: i32 = 1000;

/// A factor from input units to those computed in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Unit {
    exponent: i32,
}

impl Unit {
    /// The input's own unit.
    pub const OWN: Unit = Unit { exponent: 0 };

    /// The unit for everything within `bounds`.
    pub fn around(bounds: &Bounds) -> Unit {
        let half = |k: usize| 0.5 * bounds.high[k] - 0.5 * bounds.low[k];
        let extent = (0..3).map(half).fold(0.0, f64::max);
        if !(extent > 0.0 && extent.is_finite()) {
            return Unit::OWN;
        }
        let exponent = extent.log2().ceil() as i32;
        match exponent.abs() > FREE {
            true => Unit { exponent: (-exponent).clamp(-MOST, MOST) },
            false => Unit::OWN,
        }
    }

    /// Returns whether lengths stay what they are.
    pub fn is_own(self) -> bool {
        self == Unit::OWN
    }

    /// A length or coordinate in this unit.
    pub fn of(self, length: f64) -> f64 {
        length * 2f64.powi(self.exponent)
    }

    /// A place in this unit.
    pub fn place(self, point: Vector) -> Vector {
        point.map(|x| self.of(x))
    }

    /// A length of this unit in input units.
    pub fn back(self, length: f64) -> f64 {
        length * 2f64.powi(-self.exponent)
    }

    /// Turns a whole mesh.
    pub fn turn(self, mesh: &mut Mesh) {
        if !self.is_own() {
            mesh.positions.iter_mut().for_each(|p| *p = self.place(*p));
        }
    }

    /// A deviation in input units.
    pub fn deviation(self, mut deviation: Deviation) -> Deviation {
        if !self.is_own() {
            for length in [&mut deviation.rms, &mut deviation.diagonal] {
                *length = self.back(*length);
            }
            self.side(&mut deviation.forward);
            self.side(&mut deviation.backward);
        }
        deviation
    }

    fn side(self, side: &mut Side) {
        let spreads = [Some(&mut side.distance), side.near.as_mut(), side.far.as_mut()];
        for Spread { mean, rms, p999, max, .. } in spreads.into_iter().flatten() {
            for length in [mean, rms, p999, max] {
                *length = self.back(*length);
            }
        }
        side.worst = side.worst.map(|point| point.map(|x| self.back(x)));
    }
}
