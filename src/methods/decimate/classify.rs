//! The kind of a vertex (Schroeder et al. 1992, section 3.1), the loop around it, and the distance that its removal costs.

use crate::surface::Surface;
use stonecut_mesh::vec3::{Vec3, add, cross, dot, length_sq, normal, scale, sub, unit};

/// Triangles around a vertex at most; beyond them the loop is not filled.
pub(super) const MOST_AROUND: usize = 32;

/// The kind of a vertex.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Kind {
    /// Its triangles are a closed fan, without a feature edge.
    Simple,
    /// Its triangles are an open fan.
    Boundary,
    /// A closed fan with two feature edges.
    InteriorEdge,
    /// A closed fan with one, or with more than two.
    Corner,
    /// Its triangles are not one fan: never removed.
    Complex,
}

/// The surroundings of a vertex.
pub(super) struct Around {
    pub(super) kind: Kind,
    /// Neighbours in order, counter-clockwise seen from outside; from one end of a boundary to the other.
    pub(super) ring: Vec<u32>,
    /// Triangles, the one between `ring[i]` and `ring[i + 1]` at `i`.
    pub(super) triangles: Vec<u32>,
    /// Places in `ring` of the two feature neighbours of an interior edge vertex.
    pub(super) feature: Option<(usize, usize)>,
    /// Unit normal of the average plane.
    pub(super) normal: Vec3,
    /// Distance to the average plane, or to the line that the vertex would leave.
    pub(super) distance: f64,
}

impl Around {
    /// Looks at a vertex that triangles use; `cosine` is that of the feature angle.
    pub(super) fn look(surface: &Surface, vertex: u32, cosine: f64) -> Around {
        let mut around = Around {
            kind: Kind::Complex,
            ring: Vec::new(),
            triangles: Vec::new(),
            feature: None,
            normal: [0.0; 3],
            distance: f64::INFINITY,
        };
        let Some(is_closed) = around.fan(surface, vertex) else { return around };
        let at = |v: u32| surface.positions[v as usize];
        let weighted: Vec<Vec3> =
            around.triangles.iter().map(|&t| normal(surface.corners(t).map(at))).collect();
        let sum = weighted.iter().fold([0.0; 3], |sum, &n| add(sum, n));
        let Some(plane) = unit(sum) else { return around };
        around.normal = plane;
        let units: Vec<Vec3> = weighted.iter().map(|&n| unit(n).unwrap_or(plane)).collect();
        let position = at(vertex);
        if !is_closed {
            around.kind = Kind::Boundary;
            let ends = [around.ring[0], around.ring[around.ring.len() - 1]].map(at);
            around.distance = line_distance(position, ends);
            return around;
        }
        let n = around.ring.len();
        // Neighbour i lies between triangles i - 1 and i.
        let is_feature = |i: &usize| dot(units[(i + n - 1) % n], units[*i]) < cosine;
        let features: Vec<usize> = (0..n).filter(is_feature).collect();
        let to_plane = || {
            // The mean of the triangles' centres, by area: relative to the vertex, a third of the sum of two neighbours.
            let (mut centre, mut area) = ([0.0; 3], 0.0);
            for (i, weighted) in weighted.iter().enumerate() {
                let size = length_sq(*weighted).sqrt();
                let ends = add(
                    sub(at(around.ring[i]), position),
                    sub(at(around.ring[(i + 1) % n]), position),
                );
                centre = add(centre, scale(ends, size / 3.0));
                area += size;
            }
            dot(centre, plane).abs() / area
        };
        (around.kind, around.distance) = match features[..] {
            [] => (Kind::Simple, to_plane()),
            [i, j] => {
                around.feature = Some((i, j));
                (
                    Kind::InteriorEdge,
                    line_distance(position, [around.ring[i], around.ring[j]].map(at)),
                )
            }
            _ => (Kind::Corner, to_plane()),
        };
        around
    }

    /// Orders the triangles around a vertex into one fan; returns whether it is closed, `None` if there is not one fan.
    fn fan(&mut self, surface: &Surface, vertex: u32) -> Option<bool> {
        // The edge opposite to the vertex in each triangle, in its orientation.
        let mut edges: Vec<(u32, u32, u32)> = Vec::new();
        for triangle in surface.around(vertex) {
            if edges.len() == MOST_AROUND {
                return None;
            }
            let corners = surface.corners(triangle);
            let place = corners.iter().position(|&v| v == vertex)?;
            edges.push((corners[(place + 1) % 3], corners[(place + 2) % 3], triangle));
        }
        let begins = |v: u32| edges.iter().filter(|edge| edge.0 == v).count();
        let ends = |v: u32| edges.iter().filter(|edge| edge.1 == v).count();
        if edges.iter().any(|&(from, to, _)| begins(from) > 1 || ends(to) > 1) {
            return None;
        }
        // From the end of a boundary, if there is one.
        let first = edges.iter().find(|edge| ends(edge.0) == 0).or(edges.first())?;
        let is_closed = ends(first.0) > 0;
        let start = first.0;
        let mut at = start;
        while let Some(&(_, to, triangle)) = edges.iter().find(|edge| edge.0 == at) {
            self.ring.push(at);
            self.triangles.push(triangle);
            at = to;
            if at == start {
                break;
            }
        }
        if !is_closed {
            self.ring.push(at);
        }
        (self.triangles.len() == edges.len()).then_some(is_closed)
    }
}

/// Distance of a point from the line through two others.
fn line_distance(point: Vec3, [a, b]: [Vec3; 2]) -> f64 {
    let (along, from) = (sub(b, a), sub(point, a));
    let length_squared = length_sq(along);
    match length_squared > 0.0 {
        true => (length_sq(cross(along, from)) / length_squared).sqrt(),
        false => length_sq(from).sqrt(),
    }
}
