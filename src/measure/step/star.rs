//! The triangles around a vertex of the version, seen along their normal: distances of triangles that lie over them.
//!
//! If all of them face the same way and go around the vertex once at most, they are the graph of a height over what they
//! cover. A triangle over it is cut along the edges at the vertex; each piece is laid along the normal into one of them. The
//! distance between a point and its image is linear over a piece, so largest at the piece's corners: the triangle's
//! own, the places where its edges cross those at the vertex, and the vertex.

use crate::measure::triangle::Vector;
use crate::mesh::Mesh;
use crate::mesh::corners::others;
use crate::mesh::vec3::{add, cross, dot, length_sq, scale, sub};

/// Triangles at a vertex, at most.
const MOST: usize = 16;

/// Triangles that are seen more from the side than this, as the cosine, are not taken.
const STEEPEST: f64 = 0.1;

/// Rounding of places as a share of the size of a star; of products of two lengths, as a share of its square.
const ROUNDING: f64 = 1e-12;

/// An edge at the vertex, and the triangle that follows it counter-clockwise.
#[derive(Clone, Copy, Default)]
struct Ray {
    /// Its other end, seen from the vertex; `z` is the height along the normal.
    x: f64,
    y: f64,
    z: f64,
    /// One over its squared length, as it is seen.
    inverse_sq: f64,
    /// Slope of the triangle.
    slope: [f64; 2],
    triangle: u32,
}

/// The triangles around a vertex.
pub(super) struct Star {
    n: usize,
    is_closed: bool,
    origin: Vector,
    /// Two directions across, and the normal.
    axes: [Vector; 3],
    /// Counter-clockwise; at the end the edge behind the last triangle.
    rays: [Ray; MOST + 1],
    /// The largest squared length of an edge at the vertex, as it is seen.
    size_sq: f64,
    /// Products of two lengths up to this are 0.
    tiny: f64,
    /// Added to distances for the rounding.
    rounding: f64,
}

/// A triangle over a star.
pub(super) struct Over {
    /// Its distance, at most.
    pub(super) most: f64,
    /// Triangles that its corners lie over.
    pub(super) feet: [u32; 3],
    /// True if it lies over the vertex.
    pub(super) is_over_vertex: bool,
}

impl Star {
    pub(super) fn new() -> Star {
        Star {
            n: 0,
            is_closed: false,
            origin: [0.0; 3],
            axes: [[0.0; 3]; 3],
            rays: [Ray::default(); MOST + 1],
            size_sq: 0.0,
            tiny: 0.0,
            rounding: 0.0,
        }
    }

    /// Takes the triangles at a vertex; false if they are not a graph.
    pub(super) fn set(&mut self, mesh: &Mesh, v: u32, own: &[u32]) -> bool {
        let n = own.len();
        if n == 0 || n > MOST {
            return false;
        }
        self.n = n;
        self.origin = mesh.positions[v as usize];
        let at = |w: u32| sub(mesh.positions[w as usize], self.origin);
        let mut sides = [(0u32, 0u32); MOST];
        let mut normals = [[0.0; 3]; MOST];
        let mut normal = [0.0; 3];
        for (k, &t) in own.iter().enumerate() {
            let (b, c) = others(mesh.triangles[t as usize], v);
            sides[k] = (b, c);
            normals[k] = cross(at(b), at(c));
            normal = add(normal, normals[k]);
        }
        let length = length_sq(normal).sqrt();
        if !(length > 0.0 && length.is_finite()) {
            return false;
        }
        let normal = scale(normal, 1.0 / length);
        let is_seen = |n: &Vector| {
            let up = dot(*n, normal);
            up > 0.0 && up * up > STEEPEST * STEEPEST * length_sq(*n)
        };
        if !normals[..n].iter().all(is_seen) {
            return false;
        }
        let Some((order, is_closed)) = around(&sides[..n]) else { return false };
        self.is_closed = is_closed;
        let aside = if normal[0].abs() < 0.6 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
        let across = cross(normal, aside);
        let across = scale(across, 1.0 / length_sq(across).sqrt());
        self.axes = [across, cross(normal, across), normal];
        let mut size_sq = 0.0f64;
        for step in 0..=n {
            let k = order[step.min(n - 1)];
            let (b, c) = sides[k];
            let [x, y, z] = self.seen(mesh.positions[if step < n { b } else { c } as usize]);
            let length_sq = x * x + y * y;
            size_sq = size_sq.max(length_sq);
            let [across, along, up] = self.axes;
            let up = -1.0 / dot(normals[k], up);
            let slope = [up * dot(normals[k], across), up * dot(normals[k], along)];
            let inverse_sq = 1.0 / length_sq;
            self.rays[step] = Ray { x, y, z, inverse_sq, slope, triangle: own[k] };
        }
        self.size_sq = size_sq;
        self.tiny = ROUNDING * size_sq;
        self.rounding = 16.0 * ROUNDING * size_sq.sqrt();
        self.turns_once()
    }

    /// A place seen from the vertex.
    #[inline(always)]
    fn seen(&self, place: Vector) -> Vector {
        let off = sub(place, self.origin);
        let [x, y, z] = &self.axes;
        [dot(off, *x), dot(off, *y), dot(off, *z)]
    }

    /// Tells if no place is covered twice. No triangle goes half around.
    fn turns_once(&self) -> bool {
        let pairs = self.rays[..=self.n].windows(2).map(|pair| (&pair[0], &pair[1]));
        if self.is_closed {
            return pairs.filter(|(b, c)| b.y <= 0.0 && c.y > 0.0).count() == 1;
        }
        let angle = |(b, c): (&Ray, &Ray)| {
            let (sine, cosine) = (b.x * c.y - b.y * c.x, b.x * c.x + b.y * c.y);
            sine.atan2(cosine)
        };
        pairs.map(angle).sum::<f64>() < 0.999 * std::f64::consts::TAU
    }

    /// The distance of a triangle, if it lies over the star.
    pub(super) fn over(&self, corners: &[Vector; 3]) -> Option<Over> {
        let n = self.n;
        let p = [self.seen(corners[0]), self.seen(corners[1]), self.seen(corners[2])];
        if p.iter().any(|[x, y, _]| x * x + y * y > self.size_sq) {
            return None;
        }
        // The side of each edge at the vertex on which the corners lie.
        let mut sides = [[0.0f64; 3]; MOST + 1];
        for (side, ray) in sides.iter_mut().zip(&self.rays[..=n]) {
            for (side, [x, y, _]) in side.iter_mut().zip(&p) {
                let area = ray.x * y - ray.y * x;
                *side = if area.abs() <= self.tiny { 0.0 } else { area };
            }
        }
        let mut most = 0.0f64;
        let mut feet = [0; 3];
        for (i, &[x, y, z]) in p.iter().enumerate() {
            let k = (0..n).find(|&k| sides[k][i] >= 0.0 && sides[k + 1][i] <= 0.0)?;
            let (b, c) = (&self.rays[k], &self.rays[k + 1]);
            let inwards = (c.x - b.x) * (y - b.y) - (c.y - b.y) * (x - b.x);
            if inwards < -self.tiny {
                return None;
            }
            most = most.max((z - b.slope[0] * x - b.slope[1] * y).abs());
            feet[i] = b.triangle;
        }
        let mut is_over_vertex = false;
        if feet[0] != feet[1] || feet[1] != feet[2] {
            most = most.max(self.crossings(&p, &sides)?);
            let product = |i: usize, j: usize| p[i][0] * p[j][1] - p[i][1] * p[j][0];
            let (a, b, c) = (product(1, 2), product(2, 0), product(0, 1));
            let sum = a + b + c;
            let is_around = a.min(b).min(c) >= 0.0 || a.max(b).max(c) <= 0.0;
            if is_around && sum != 0.0 {
                let height = a * p[0][2] + b * p[1][2] + c * p[2][2];
                most = most.max((height / sum).abs());
                is_over_vertex = true;
            }
        }
        Some(Over { most: most + self.rounding, feet, is_over_vertex })
    }

    /// The largest distance where edges of a triangle cross those at the vertex; none if that leads out of the star.
    fn crossings(&self, p: &[Vector; 3], sides: &[[f64; 3]; MOST + 1]) -> Option<f64> {
        let mut most = 0.0f64;
        // Where it is closed, the last edge is the first one again.
        let n = if self.is_closed { self.n } else { self.n + 1 };
        for (k, (ray, side)) in self.rays[..n].iter().zip(sides).enumerate() {
            for (i, j) in [(0, 1), (1, 2), (2, 0)] {
                if side[i] * side[j] >= 0.0 {
                    continue;
                }
                let share = side[i] / (side[i] - side[j]);
                let at = |c: usize| p[i][c] + share * (p[j][c] - p[i][c]);
                let (x, y, z) = (at(0), at(1), at(2));
                let along = (ray.x * x + ray.y * y) * ray.inverse_sq;
                if along <= 0.0 {
                    continue;
                }
                let leads_out = !self.is_closed && (k == 0 || k == self.n);
                if leads_out || along > 1.0 + ROUNDING {
                    return None;
                }
                most = most.max((z - along * ray.z).abs());
            }
        }
        Some(most)
    }
}

/// Puts the triangles at a vertex in order, given their other corners, beginning behind the gap if there is one; tells if
/// there is none. Fails if they are not one row.
fn around(sides: &[(u32, u32)]) -> Option<([usize; MOST], bool)> {
    let follows = |w: u32| sides.iter().position(|side| side.0 == w);
    let first = (0..sides.len()).find(|&k| !sides.iter().any(|side| side.1 == sides[k].0));
    let start = first.unwrap_or(0);
    let mut order = [0; MOST];
    let mut at = start;
    for (step, place) in order[..sides.len()].iter_mut().enumerate() {
        *place = at;
        let is_last = step + 1 == sides.len();
        match follows(sides[at].1) {
            Some(next) if is_last == (next == start) => at = next,
            None if is_last => {}
            _ => return None,
        }
    }
    Some((order, first.is_none()))
}
