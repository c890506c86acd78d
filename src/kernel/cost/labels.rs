//! Cost and place of collapses at the border between two labels of vertices.
//!
//! A label belongs to a vertex, so the border between two of them runs through the middle of the triangles that have both.
//! It stays where it is if those triangles stay as narrow as they are: the rows of vertices on either side are held as
//! boundaries of the surface are, and a vertex that takes the other label costs the area that goes with it. Takes the place of
//! what the others found, edge by edge; on meshes without such labels it is not called.
//!
//! docs/design/attributes.md.

use crate::cost::quadric::{Evaluated, LENGTH_COST, MAX_REACH};
use crate::cost::seam::Line;
use crate::options::Placement;
use crate::surface::wedges::Wedges;
use crate::surface::{MAX_VALENCE, Surface, boundary_quadric};
use crate::vertex::GONE;
use stonecut_mesh::corners::others;
use stonecut_mesh::vec3::{Vec3, add, dot, length_sq, scale, sub};

/// The labels of vertices.
#[derive(Clone, Copy)]
pub(crate) struct Labels {
    /// Their channel.
    pub(crate) channel: usize,
    /// No collapse moves a border between two of them farther, in the units of the surface's quadrics.
    pub(crate) reach: f64,
}

/// Corrects eight edges; where `fixed` is not 0, the survivor stays at `v1`.
#[inline(never)]
pub(crate) fn correct(
    surface: &Surface,
    (wedges, labels): (Option<&Wedges>, Labels),
    v0: &[u32; 8],
    v1: &[u32; 8],
    fixed: &[f32; 8],
    found: &mut Evaluated,
) {
    let Labels { channel, reach } = labels;
    for i in 0..8 {
        let ends = [v0[i], v1[i]];
        if found.cost[i] == f32::INFINITY || ends[0] == ends[1] {
            continue;
        }
        let [Some(border0), Some(border1)] = ends.map(|v| border(surface, channel, v)) else {
            continue;
        };
        let is_free = fixed[i] == 0.0 && surface.placement == Placement::Optimal;
        let place = std::array::from_fn(|k| f64::from(found.place[k][i]));
        let edge = Edge::new(surface, ends, [border0.quadric, border1.quadric]);
        let takes_other = label(surface, channel, ends[0]) != label(surface, channel, ends[1]);
        let (place, more) = if takes_other && 2.0 * length_sq(edge.half).sqrt() > reach {
            (place, f64::INFINITY)
        } else if takes_other {
            (place, edge.area_lost())
        } else if border0.is_none() && border1.is_none() {
            continue;
        } else if is_free && !is_confined(surface, wedges, ends) {
            edge.best(place)
        } else {
            (place, edge.at_borders(place))
        };
        let is_beyond = !takes_other && edge.distance_sq(place) > reach * reach;
        // Written so that NaN is infinite.
        let more = if is_beyond { f64::INFINITY } else { more };
        let cost = f64::from(found.cost[i]) + more;
        found.cost[i] =
            if cost < f64::from(f32::MAX) { cost.max(0.0) as f32 } else { f32::INFINITY };
        for (row, x) in found.place.iter_mut().zip(place) {
            row[i] = x as f32;
        }
    }
}

/// True where something else says which places the survivor may have.
fn is_confined(surface: &Surface, wedges: Option<&Wedges>, [v0, v1]: [u32; 2]) -> bool {
    let planes = |v: u32| surface.flats.as_ref().is_some_and(|flats| flats.of(v) != 0);
    planes(v0) || planes(v1) || wedges.is_some_and(|wedges| wedges.concern(v0, v1))
}

/// The label of a vertex.
#[inline(always)]
pub(crate) fn label(surface: &Surface, channel: usize, v: u32) -> u32 {
    surface.channels_of(v)[channel].to_bits()
}

/// The border of labels at a vertex.
struct Border {
    /// Squared length times squared distance to the line of each edge along the border.
    quadric: [f64; 6],
}

impl Border {
    fn is_none(&self) -> bool {
        self.quadric == [0.0; 6]
    }
}

/// The border at a vertex: its edges that have a vertex of another label across; `None` of a vertex of very many triangles.
fn border(surface: &Surface, channel: usize, v: u32) -> Option<Border> {
    let ring = surface.ring(v);
    if ring.len() > MAX_VALENCE as usize {
        return None;
    }
    let own = label(surface, channel, v);
    let mut quadric = [0.0; 6];
    for &t in ring {
        let t = surface.triangles[t as usize];
        if t[0] == GONE {
            continue;
        }
        let (b, c) = others(t, v);
        let is_own = [b, c].map(|w| label(surface, channel, w) == own);
        let along = match is_own {
            [true, false] => b,
            [false, true] => c,
            _ => continue,
        };
        let one = boundary_quadric(surface.edge(v, along));
        quadric.iter_mut().zip(one).for_each(|(sum, x)| *sum += f64::from(x));
    }
    Some(Border { quadric })
}

/// An edge with the quadrics of its ends and of the borders there; places are relative to its midpoint.
struct Edge {
    half: Vec3,
    quadrics: [[f64; 9]; 2],
    borders: [[f64; 6]; 2],
    quadrics_f32: [[f32; 9]; 2],
}

impl Edge {
    fn new(surface: &Surface, [v0, v1]: [u32; 2], borders: [[f64; 6]; 2]) -> Edge {
        let half = surface.edge(v0, v1).map(|x| 0.5 * f64::from(x));
        let quadrics_f32 = [v0, v1].map(|v| surface.vertices[v as usize].quadric);
        let quadrics = quadrics_f32.map(|q| q.map(f64::from));
        Edge { half, quadrics, borders, quadrics_f32 }
    }

    /// Squared area that changes its label where `v0` takes that of `v1`: a third of what is around it.
    fn area_lost(&self) -> f64 {
        let [q, _] = &self.quadrics;
        ((q[0] + q[3] + q[5]) / 3.0).powi(2)
    }

    /// Cost of moving the borders of both ends to a place.
    fn at_borders(&self, place: Vec3) -> f64 {
        let [q0, q1] = &self.borders;
        product(q0, add(place, self.half)) + product(q1, sub(place, self.half))
    }

    /// Mean squared distance of a place from the lines of both ends' borders.
    fn distance_sq(&self, place: Vec3) -> f64 {
        let length_sq: f64 = self.borders.iter().map(|q| 0.5 * (q[0] + q[3] + q[5])).sum();
        if length_sq > 0.0 { self.at_borders(place) / length_sq } else { 0.0 }
    }

    /// Cost of both ends at a place, as `cost::quadric` has it.
    fn at_quadrics(&self, place: Vec3) -> f64 {
        let [q0, q1] = self.quadrics.map(|q| [q[0], q[1], q[2], q[3], q[4], q[5]]);
        let error = product(&q0, add(place, self.half)) + product(&q1, sub(place, self.half));
        error.max(0.0) + self.trace() * length_sq(self.half) * f64::from(LENGTH_COST)
    }

    fn trace(&self) -> f64 {
        self.quadrics.iter().map(|q| q[0] + q[3] + q[5]).sum()
    }

    /// The best of some places, and what it costs more than the one that was `found`: that, the ends, and the place beside the
    /// edge that keeps the volume and costs least.
    fn best(&self, found: Vec3) -> (Vec3, f64) {
        let mut quadrics = self.quadrics;
        for (quadric, border) in quadrics.iter_mut().zip(&self.borders) {
            quadric.iter_mut().zip(border).for_each(|(sum, x)| *sum += x);
        }
        let on_edge = Line { start: scale(self.half, -1.0), way: scale(self.half, 2.0) };
        let line = Line::of_volume(self.quadrics_f32.each_ref(), self.half).unwrap_or(on_edge);
        let [_, slope, curve] = line.cost(&quadrics, self.half, [0.0; 2]);
        let s = if curve > 0.0 { (-slope / curve).clamp(0.0, 1.0) } else { 0.5 };
        let ends = [self.half, scale(self.half, -1.0)];
        let far_sq = length_sq(self.half) * f64::from(MAX_REACH * MAX_REACH);
        let total = |place: Vec3| self.at_quadrics(place) + self.at_borders(place);
        let mut best = (found, total(found));
        for place in [line.at(s), ends[0], ends[1]] {
            let cost = total(place);
            // Written so that NaN is neither near nor less.
            if length_sq(place) <= far_sq && cost < best.1 {
                best = (place, cost);
            }
        }
        (best.0, best.1 - self.at_quadrics(found))
    }
}

/// x^T A x.
fn product(q: &[f64; 6], x: Vec3) -> f64 {
    dot(x, [dot([q[0], q[1], q[2]], x), dot([q[1], q[3], q[4]], x), dot([q[2], q[4], q[5]], x)])
}
