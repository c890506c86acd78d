//! The distance by which the rim of a thin sheet would recede: that of both ends of a collapse from what would be around
//! the survivor.
//!
//! Quadrics of planes see where a surface goes, not where it ends. At folds, terms of edges and tips hold it in the mean;
//! the farthest place is made at the corners of thin wedges, whose planes hardly differ. So a collapse there waits until
//! others are as dear as its distance. Open boundaries gain nothing by it: their quadrics see how far they move.
//!
//! docs/algorithm.md, section 3, has the price.

use crate::surface::Surface;
use crate::vertex::GONE;
use stonecut_mesh::vec3::{Vec3, length_sq, sub, triangle_distance_sq};

/// Vertices of more triangles than this are not looked at.
const MOST: u32 = 64;

/// A collapse and where its ends are, in scaled units, relative to the midpoint of its edge.
pub(crate) struct Recession {
    edge: (u32, u32),
    half: [f64; 3],
    survivor: [f64; 3],
}

impl Recession {
    /// `place` is that of the survivor unless the second vertex is fixed.
    pub(crate) fn of(surface: &Surface, edge: (u32, u32), place: [f32; 3]) -> Recession {
        let half = surface.edge(edge.0, edge.1).map(|x| 0.5 * f64::from(x));
        let is_fixed = surface.stays_at_v1(edge.0, edge.1);
        let survivor = if is_fixed { half } else { place.map(f64::from) };
        Recession { edge, half, survivor }
    }

    /// Positions of both ends of the edge.
    fn ends(&self) -> [Vec3; 2] {
        [self.half.map(|x| -x), self.half]
    }

    /// At least `distance_sq`, from the survivor alone.
    pub(crate) fn most_sq(&self) -> f64 {
        let [a, b] = self.ends().map(|end| length_sq(sub(end, self.survivor)));
        a.max(b)
    }

    /// Squared distance of the ends from the triangles around the survivor, the larger one.
    pub(crate) fn distance_sq(&self, surface: &Surface) -> f64 {
        let (v0, v1) = self.edge;
        if [v0, v1].iter().any(|&v| surface.rings[v as usize].len > MOST) {
            return 0.0;
        }
        let at = |v: u32| {
            let edge = surface.edge(v0, v);
            let other: Vec3 = std::array::from_fn(|k| f64::from(edge[k]) - self.half[k]);
            if v == v0 || v == v1 { self.survivor } else { other }
        };
        let mut nearest_sq = [f64::INFINITY; 2];
        for v in [v0, v1] {
            for &t in surface.ring(v) {
                let corners = surface.triangles[t as usize];
                if corners[0] == GONE || (corners.contains(&v0) && corners.contains(&v1)) {
                    continue;
                }
                let corners = corners.map(at);
                for (least, end) in nearest_sq.iter_mut().zip(self.ends()) {
                    *least = least.min(triangle_distance_sq(end, corners));
                }
            }
        }
        let farthest_sq = nearest_sq[0].max(nearest_sq[1]);
        if farthest_sq.is_finite() { farthest_sq } else { 0.0 }
    }
}
