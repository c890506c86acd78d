//! Discs around vertices over which the version is a graph: a triangle over one of them is bounded at once.
//!
//! Triangles around a vertex are seen along their mean normal. If all face the same way and cover the vertex once, they
//! cover everything once in the largest disc around it that no edge of their boundary enters: how often a place is covered
//! changes at the boundary only. There they are the graph of a height whose slope is at most that of the steepest of
//! them, S. Over a triangle with sides of at most L, such a height differs from the linear function with the same values at the
//! corners by at most S L / sqrt 3, and at a corner the height is at most sqrt(1 + S^2) times as far away as the foot.

use super::around::Around;
use crate::measure::triangle::Vector;
use crate::mesh::Mesh;
use crate::mesh::corners::others;
use crate::mesh::vec3::{add, cross, dot, length_sq, scale, sub};

/// The disc around a vertex.
#[derive(Clone, Copy, Default)]
struct Disc {
    /// Steepest slope of its triangles.
    slope: f64,
    /// Radius, squared; 0 if there is none.
    reach_sq: f64,
}

/// The discs of a vertex: of the triangles at it, and of those at its neighbours too.
#[derive(Clone, Copy, Default)]
struct Fan {
    normal: Vector,
    discs: [Disc; 2],
}

/// The discs of a mesh; 56 bytes a vertex.
pub(super) struct Fans<'a> {
    mesh: &'a Mesh,
    around: &'a Around,
    fans: Vec<Fan>,
}

/// Triangles that are seen more from the side than this, as the cosine, make no disc.
const STEEPEST: f64 = 0.1;

/// Neighbours of a vertex that has discs, at most.
const MOST_NEIGHBOURS: usize = 24;

impl Fans<'_> {
    pub(super) fn new<'a>(mesh: &'a Mesh, around: &'a Around) -> Fans<'a> {
        let unit = |t: usize| {
            let [a, b, c] = mesh.corners(t);
            let n = cross(sub(b, a), sub(c, a));
            scale(n, 1.0 / length_sq(n).sqrt())
        };
        let normals = (0..mesh.triangles.len()).map(unit).collect();
        let mut builder = Builder { mesh, around, inner: inner(mesh), normals, ring: Vec::new() };
        let fans = (0..mesh.positions.len() as u32).map(|v| builder.fan(v)).collect();
        Fans { mesh, around, fans }
    }

    /// The distance of a triangle from those around a vertex, at most; infinite if it does not lie over a disc.
    /// `feet`: distances of the corners from triangles, and these.
    #[inline]
    pub(super) fn over(&self, corners: [Vector; 3], feet: [(f64, u32); 3], vertex: u32) -> f64 {
        let fan = &self.fans[vertex as usize];
        let centre = self.mesh.positions[vertex as usize];
        let mut reach_sq = 0.0f64;
        for corner in corners {
            let off = sub(corner, centre);
            let above = dot(off, fan.normal);
            reach_sq = reach_sq.max(length_sq(off) - above * above);
        }
        // A little less than the disc, for the rounding.
        let fits = |disc: &Disc| reach_sq < 0.999 * disc.reach_sq;
        let disc = if fits(&fan.discs[0]) && feet.iter().all(|(_, t)| self.is_at(*t, vertex)) {
            &fan.discs[0]
        } else if fits(&fan.discs[1]) && feet.iter().all(|(_, t)| self.is_near(*t, vertex)) {
            &fan.discs[1]
        } else {
            return f64::INFINITY;
        };
        let side_sq = |i: usize, j: usize| length_sq(sub(corners[i], corners[j]));
        let longest = side_sq(0, 1).max(side_sq(1, 2)).max(side_sq(2, 0));
        let off = feet[0].0.max(feet[1].0).max(feet[2].0);
        let s = disc.slope;
        off * (1.0 + s * s).sqrt() + s * (longest / 3.0).sqrt()
    }

    fn is_at(&self, triangle: u32, vertex: u32) -> bool {
        self.mesh.triangles[triangle as usize].contains(&vertex)
    }

    /// Tells if a triangle has a corner at the vertex or at a neighbour.
    fn is_near(&self, triangle: u32, vertex: u32) -> bool {
        let corners = self.mesh.triangles[triangle as usize];
        let mut own = self.around.of(vertex).iter();
        own.any(|&t| self.mesh.triangles[t as usize].iter().any(|v| corners.contains(v)))
    }
}

/// True for vertices around which every edge is entered as often as it is left: none of their edges is on the boundary of
/// all triangles at them.
fn inner(mesh: &Mesh) -> Vec<bool> {
    let mixed = |v: u32| (v ^ (v >> 15)).wrapping_mul(0x2c1b_3c6d);
    let mut balance = vec![0u32; mesh.positions.len()];
    for &[a, b, c] in &mesh.triangles {
        for (v, next, last) in [(a, b, c), (b, c, a), (c, a, b)] {
            let balance = &mut balance[v as usize];
            *balance = balance.wrapping_add(mixed(next)).wrapping_sub(mixed(last));
        }
    }
    balance.into_iter().map(|x| x == 0).collect()
}

struct Builder<'a> {
    mesh: &'a Mesh,
    around: &'a Around,
    inner: Vec<bool>,
    /// Unit normals of the triangles.
    normals: Vec<Vector>,
    /// Neighbours of the vertex.
    ring: Vec<u32>,
}

impl Builder<'_> {
    fn fan(&mut self, v: u32) -> Fan {
        let own = self.around.of(v);
        if own.is_empty() || own.len() > MOST_NEIGHBOURS || !self.inner[v as usize] {
            return Fan::default();
        }
        let mut normal = [0.0; 3];
        own.iter().for_each(|&t| normal = add(normal, self.normals[t as usize]));
        let length = length_sq(normal).sqrt();
        if !(length > 0.0 && length.is_finite()) {
            return Fan::default();
        }
        let mut seen = Seen::along(scale(normal, 1.0 / length), self.mesh.positions[v as usize]);
        let mut fan = Fan { normal: seen.axes[2], ..Fan::default() };
        self.ring.clear();
        for &t in own {
            let (b, c) = others(self.mesh.triangles[t as usize], v);
            self.ring.push(b);
            if !seen.add_triangle(self.normals[t as usize]) {
                return fan;
            }
            seen.add_edge(self.mesh, b, c);
        }
        let Some(disc) = seen.disc() else { return fan };
        fan.discs[0] = disc;
        if self.ring.iter().any(|&w| !self.inner[w as usize]) {
            return fan;
        }
        seen.forget_edges();
        for &w in &self.ring {
            for &t in self.around.of(w) {
                let (b, c) = others(self.mesh.triangles[t as usize], w);
                if !seen.add_triangle(self.normals[t as usize]) {
                    return fan;
                }
                // All triangles at the vertex and at its neighbours are here, so their edges are not on the boundary.
                let is_inside = |u: u32| u == v || self.ring.contains(&u);
                if !is_inside(b) && !is_inside(c) {
                    seen.add_edge(self.mesh, b, c);
                }
            }
        }
        fan.discs[1] = seen.disc().unwrap_or_default();
        fan
    }
}

/// Some triangles as seen along a normal, from a vertex.
struct Seen {
    origin: Vector,
    /// Two directions across, and the normal.
    axes: [Vector; 3],
    /// Least upward part of a unit normal.
    up: f64,
    /// Nearest edge of the boundary, squared.
    reach_sq: f64,
    /// Times that the boundary goes around the vertex.
    turns: i32,
}

impl Seen {
    fn along(normal: Vector, origin: Vector) -> Seen {
        let least = (0..3).min_by(|&a, &b| normal[a].abs().total_cmp(&normal[b].abs()));
        let mut aside = [0.0; 3];
        aside[least.unwrap_or(0)] = 1.0;
        let across = cross(normal, aside);
        let across = scale(across, 1.0 / length_sq(across).sqrt());
        let axes = [across, cross(normal, across), normal];
        Seen { origin, axes, up: 1.0, reach_sq: f64::INFINITY, turns: 0 }
    }

    /// Adds a triangle with a unit normal; false if it does not face the same way.
    #[inline]
    fn add_triangle(&mut self, normal: Vector) -> bool {
        let up = dot(normal, self.axes[2]);
        self.up = self.up.min(up);
        // False for a triangle without area, too.
        up > STEEPEST
    }

    /// Adds an edge of the boundary.
    #[inline]
    fn add_edge(&mut self, mesh: &Mesh, from: u32, to: u32) {
        let flat = |v: u32| {
            let off = sub(mesh.positions[v as usize], self.origin);
            [dot(off, self.axes[0]), dot(off, self.axes[1])]
        };
        let (p, q) = (flat(from), flat(to));
        let edge = [q[0] - p[0], q[1] - p[1]];
        let length_sq = edge[0] * edge[0] + edge[1] * edge[1];
        let along = -(p[0] * edge[0] + p[1] * edge[1]);
        let share = if length_sq > 0.0 { (along / length_sq).clamp(0.0, 1.0) } else { 0.0 };
        let near = [p[0] + share * edge[0], p[1] + share * edge[1]];
        self.reach_sq = self.reach_sq.min(near[0] * near[0] + near[1] * near[1]);
        // Counted where it crosses the first axis.
        if (p[1] > 0.0) != (q[1] > 0.0) {
            let side = p[0] * edge[1] - p[1] * edge[0];
            if (side > 0.0) == (edge[1] > 0.0) {
                self.turns += if edge[1] > 0.0 { 1 } else { -1 };
            }
        }
    }

    fn forget_edges(&mut self) {
        (self.reach_sq, self.turns) = (f64::INFINITY, 0);
    }

    /// The disc, if the triangles cover the vertex once.
    fn disc(&self) -> Option<Disc> {
        let slope = (1.0 / (self.up * self.up) - 1.0).max(0.0).sqrt();
        (self.turns == 1).then_some(Disc { slope, reach_sq: self.reach_sq })
    }
}
