//! Bounding boxes.

use super::Mesh;
use super::vec3::{Vec3, length_sq, sub};

/// An axis-aligned box; empty if no point was added.
#[derive(Clone, Copy, Debug)]
pub struct Bounds {
    /// The corner of least coordinates.
    pub low: Vec3,
    /// The corner of greatest coordinates.
    pub high: Vec3,
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

    /// Takes in a point.
    pub fn add(&mut self, point: Vec3) {
        self.low = [0, 1, 2].map(|k| self.low[k].min(point[k]));
        self.high = [0, 1, 2].map(|k| self.high[k].max(point[k]));
    }

    /// The box of both.
    pub fn joined(&self, other: &Bounds) -> Bounds {
        Bounds {
            low: [0, 1, 2].map(|k| self.low[k].min(other.low[k])),
            high: [0, 1, 2].map(|k| self.high[k].max(other.high[k])),
        }
    }

    /// Squared distance from a point to the box; infinite for an empty box.
    pub fn distance_sq(&self, point: Vec3) -> f64 {
        let off = [0, 1, 2].map(|k| (self.low[k] - point[k]).max(point[k] - self.high[k]).max(0.0));
        length_sq(off)
    }

    /// Squared distance to another box; a lower bound for the distances between their points.
    pub fn gap_sq(&self, other: &Bounds) -> f64 {
        let off = [0, 1, 2]
            .map(|k| (self.low[k] - other.high[k]).max(other.low[k] - self.high[k]).max(0.0));
        length_sq(off)
    }

    /// The length of the diagonal; 0 for an empty box.
    pub fn diagonal(&self) -> f64 {
        if self.low[0] > self.high[0] {
            return 0.0;
        }
        length_sq(sub(self.high, self.low)).sqrt()
    }
}
