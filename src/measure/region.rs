//! The part of space near given points or edges, to hold the error there against the error elsewhere.
//!
//! A tool for those who look for seams: give it the vertices or edges along which cells met, and the
//! samples near them are counted apart.

use super::tree::{Nearest, Tree};
use super::unit::Unit;
use crate::mesh::bounds::Bounds;

/// All points within some distance of given points and segments.
#[derive(Clone, Debug)]
pub struct Region {
    tree: Tree,
    within: f64,
}

impl Region {
    /// Everything within `within` (input units) of any of `points`.
    pub fn around_points(points: &[[f64; 3]], within: f64) -> Self {
        // A point is a triangle without extent, a segment one without width: the tree takes both.
        let tree = Tree::build(points.len(), |i| [points[i]; 3]);
        Region { tree, within }
    }

    /// Everything within `within` (input units) of any of `segments`.
    pub fn around_segments(segments: &[[[f64; 3]; 2]], within: f64) -> Self {
        let tree =
            Tree::build(segments.len(), |i| [segments[i][0], segments[i][1], segments[i][1]]);
        Region { tree, within }
    }

    /// The same region in another unit of length.
    pub(crate) fn in_unit(&self, unit: Unit) -> Self {
        if unit.is_own() {
            return self.clone();
        }
        let corners = |i: usize| self.tree.corners(i as u32).map(|corner| unit.place(corner));
        Region { tree: Tree::build(self.tree.len(), corners), within: unit.of(self.within) }
    }

    /// Returns whether `point` lies in the region.
    pub fn contains(&self, point: [f64; 3]) -> bool {
        let within_sq = self.within * self.within;
        let found = self.tree.nearest_unless_within(point, Nearest::NONE, within_sq);
        found.distance_sq <= within_sq
    }
}

/// Mean areas of a mesh's triangles near and far from a region (square input units), and their numbers.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct TriangleSizes {
    /// Triangles whose centroid lies in the region.
    pub near_triangles: u64,
    /// Their mean area; 0 if there are none.
    pub near_mean_area: f64,
    /// All others.
    pub far_triangles: u64,
    /// Their mean area; 0 if there are none.
    pub far_mean_area: f64,
}

impl TriangleSizes {
    /// Counts and areas of `mesh`, split by the position of the centroids.
    pub fn of(mesh: &crate::Mesh, region: &Region) -> Self {
        let mut counts = [0u64; 2];
        let mut areas = [0f64; 2];
        let unit = Unit::around(&Bounds::of(mesh));
        let turned = (!unit.is_own()).then(|| region.in_unit(unit));
        let region = turned.as_ref().unwrap_or(region);
        for i in 0..mesh.triangles.len() {
            let t = mesh.corners(i).map(|corner| unit.place(corner));
            let third = 1.0 / 3.0;
            let centroid = super::triangle::point_at(&t, [third, third, third]);
            let side = usize::from(!region.contains(centroid));
            counts[side] += 1;
            areas[side] += super::triangle::area(&t);
        }
        let mean = |side: usize| unit.back(unit.back(areas[side] / counts[side].max(1) as f64));
        TriangleSizes {
            near_triangles: counts[0],
            near_mean_area: mean(0),
            far_triangles: counts[1],
            far_mean_area: mean(1),
        }
    }
}
