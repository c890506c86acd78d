//! Bounding boxes.

use super::Mesh;
use super::vec3::{Vec3, add, length_sq, scale, sub};
use serde::{Deserialize, Serialize};

/// An axis-aligned box; empty if no point was added.
///
/// Stored as its two corners. An empty box cannot be stored: JSON has no infinities.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(from = "[Vec3; 2]", into = "[Vec3; 2]")]
pub struct Bounds {
    /// The corner of least coordinates.
    pub low: Vec3,
    /// The corner of greatest coordinates.
    pub high: Vec3,
}

impl Default for Bounds {
    fn default() -> Bounds {
        Bounds::EMPTY
    }
}

impl From<[Vec3; 2]> for Bounds {
    fn from([low, high]: [Vec3; 2]) -> Bounds {
        Bounds { low, high }
    }
}

impl From<Bounds> for [Vec3; 2] {
    fn from(bounds: Bounds) -> [Vec3; 2] {
        [bounds.low, bounds.high]
    }
}

impl Bounds {
    /// The box of no points.
    pub const EMPTY: Bounds = Bounds { low: [f64::INFINITY; 3], high: [f64::NEG_INFINITY; 3] };

    /// The box of the vertices that triangles use.
    pub fn of(mesh: &Mesh) -> Self {
        let mut bounds = Bounds::EMPTY;
        mesh.triangles.iter().flatten().for_each(|&v| bounds.add(mesh.positions[v as usize]));
        bounds
    }

    /// The box of some points.
    pub fn around(points: &[Vec3]) -> Self {
        let mut bounds = Bounds::EMPTY;
        points.iter().for_each(|&point| bounds.add(point));
        bounds
    }

    /// True if no point was added.
    pub fn is_empty(&self) -> bool {
        self.low[0] > self.high[0]
    }

    /// The box itself, or that of the origin if it is empty.
    pub fn or_origin(self) -> Bounds {
        if self.is_empty() { Bounds { low: [0.0; 3], high: [0.0; 3] } } else { self }
    }

    /// The middle; not a number for an empty box.
    pub fn middle(&self) -> Vec3 {
        scale(add(self.low, self.high), 0.5)
    }

    /// Takes in a point.
    #[inline]
    pub fn add(&mut self, point: Vec3) {
        self.low = [0, 1, 2].map(|k| self.low[k].min(point[k]));
        self.high = [0, 1, 2].map(|k| self.high[k].max(point[k]));
    }

    /// The box between the images of the corners.
    pub fn map(&self, place: impl Fn(Vec3) -> Vec3) -> Bounds {
        Bounds { low: place(self.low), high: place(self.high) }
    }

    /// The box of both.
    pub fn joined(&self, other: &Bounds) -> Bounds {
        Bounds {
            low: [0, 1, 2].map(|k| self.low[k].min(other.low[k])),
            high: [0, 1, 2].map(|k| self.high[k].max(other.high[k])),
        }
    }

    /// Squared distance from a point to the box; infinite for an empty box.
    #[inline]
    pub fn distance_sq(&self, point: Vec3) -> f64 {
        let off = [0, 1, 2].map(|k| (self.low[k] - point[k]).max(point[k] - self.high[k]).max(0.0));
        length_sq(off)
    }

    /// Returns whether two boxes have a common point.
    pub fn touches(&self, other: &Bounds) -> bool {
        (0..3).all(|k| self.low[k] <= other.high[k] && other.low[k] <= self.high[k])
    }

    /// Squared distance to another box; a lower bound for the distances between their points.
    #[inline]
    pub fn gap_sq(&self, other: &Bounds) -> f64 {
        let off = [0, 1, 2]
            .map(|k| (self.low[k] - other.high[k]).max(other.low[k] - self.high[k]).max(0.0));
        length_sq(off)
    }

    /// The length of the longest side; 0 for an empty box.
    pub fn side(&self) -> f64 {
        (0..3).map(|k| self.high[k] - self.low[k]).fold(0.0, f64::max)
    }

    /// Refuses, in words, a mesh that is wider than the largest of `sizes`, or narrower than the smallest, for the sake of `what`:
    /// products of lengths would overflow or vanish. A mesh without any extent is not a matter of its size.
    pub fn hold(&self, what: &str, sizes: [f64; 2]) -> Result<(), String> {
        let width = (0..3).map(|axis| self.high[axis] - self.low[axis]).fold(0.0, f64::max);
        let [least, most] = sizes;
        // Not a number where nothing is.
        if !(width > most || (width > 0.0 && width < least)) {
            return Ok(());
        }
        let remedy = format!(
            "scale its coordinates with --scale {:e}",
            10f64.powf(-width.log10().round().clamp(-300.0, 300.0))
        );
        Err(format!(
            "it is {width:.1e} units wide, and {what} takes meshes of {least:e} to {most:e}; {remedy}"
        ))
    }

    /// The length of the diagonal; 0 for an empty box.
    pub fn diagonal(&self) -> f64 {
        if self.is_empty() {
            return 0.0;
        }
        length_sq(sub(self.high, self.low)).sqrt()
    }
}
