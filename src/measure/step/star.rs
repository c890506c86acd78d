//! The triangles around a vertex of the version, seen along their normal: distances of triangles that lie over them.
//!
//! If all of them face the same way and go around the vertex once at most, they are the graph of a height over what they
//! cover. A triangle over it is cut along the edges at the vertex; each piece is laid along the normal into one of them. The
//! distance between a point and its image is linear over a piece, so largest at the piece's corners: the triangle's
//! own, the places where its edges cross those at the vertex, and the vertex. What belongs to a corner alone is found
//! once for all triangles that have it (`Place`).

use crate::triangle::Vector;
use stonecut_mesh::Mesh;
use stonecut_mesh::corners::others;
use stonecut_mesh::vec3::{add, cross, dot, length_sq, scale, sub};

/// Triangles at a vertex, at most.
const MOST: usize = 15;

/// Edges that are looked at together.
const LANES: usize = 8;

/// Triangles that are seen more from the side than this, as the cosine, are not taken.
const STEEPEST: f64 = 0.1;

/// Rounding of places as a share of the size of a star; of products of two lengths, as a share of its square.
const ROUNDING: f64 = 1e-12;

/// The sector of a place that lies over no triangle of a star, and of one that was not looked for.
const OUTSIDE: u32 = u32::MAX;
const UNKNOWN: u32 = u32::MAX - 1;

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
}

/// The triangles around a vertex.
pub(super) struct Star {
    n: usize,
    is_closed: bool,
    origin: Vector,
    /// Two directions across, and the normal: first of all of them the first coordinates.
    axes: [[f64; 4]; 3],
    /// Counter-clockwise; at the end the edge behind the last triangle.
    rays: [Ray; MOST + 1],
    /// Ends of the edges once more, side by side, and 0 behind the last.
    ends: [[f64; MOST + 1]; 2],
    /// The largest squared length of an edge at the vertex, as it is seen.
    size_sq: f64,
    /// Products of two lengths up to this are 0.
    tiny: f64,
    /// For each edge at the vertex: a place is to its right if the product is below this. Beside a gap that is a little
    /// in favour of the star.
    limits: [f64; MOST + 1],
    /// Added to distances for the rounding.
    rounding: f64,
}

/// A point as it lies over a star.
#[derive(Clone, Copy)]
pub(super) struct Place {
    x: f64,
    y: f64,
    z: f64,
    /// Its distance along the normal.
    off: f64,
    /// The triangle that it lies over, as a number at the vertex; `OUTSIDE` if none.
    sector: u32,
}

impl Place {
    /// A place that was not looked for.
    pub(super) const UNKNOWN: Place = Place { x: 0.0, y: 0.0, z: 0.0, off: 0.0, sector: UNKNOWN };

    /// True if it was not looked for.
    pub(super) fn is_unknown(&self) -> bool {
        self.sector == UNKNOWN
    }

    /// True if it lies over none of the triangles.
    pub(super) fn is_outside(&self) -> bool {
        self.sector == OUTSIDE
    }
}

impl Star {
    pub(super) fn new() -> Star {
        Star {
            n: 0,
            is_closed: false,
            origin: [0.0; 3],
            axes: [[0.0; 4]; 3],
            rays: [Ray::default(); MOST + 1],
            ends: [[0.0; MOST + 1]; 2],
            size_sq: 0.0,
            tiny: 0.0,
            limits: [0.0; MOST + 1],
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
        let mut sides = [(0u32, 0u32); MOST];
        for (side, &t) in sides.iter_mut().zip(own) {
            *side = others(mesh.triangles[t as usize], v);
        }
        let Some((order, is_closed)) = around(&sides[..n]) else { return false };
        self.is_closed = is_closed;
        // The ends of the edges, the first one again behind the last where there is no gap.
        let mut ends = [[0.0; 3]; MOST + 1];
        let at = |w: u32| sub(mesh.positions[w as usize], self.origin);
        for (end, &k) in ends.iter_mut().zip(&order[..n]) {
            *end = at(sides[k].0);
        }
        ends[n] = if is_closed { ends[0] } else { at(sides[order[n - 1]].1) };
        let mut normals = [[0.0; 3]; MOST];
        let mut normal = [0.0; 3];
        for k in 0..n {
            normals[k] = cross(ends[k], ends[k + 1]);
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
        let aside = if normal[0].abs() < 0.6 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
        let across = cross(normal, aside);
        let across = scale(across, 1.0 / length_sq(across).sqrt());
        let along = cross(normal, across);
        self.axes = [0, 1, 2].map(|k| [across[k], along[k], normal[k], 0.0]);
        self.ends = [[0.0; MOST + 1]; 2];
        let mut size_sq = 0.0f64;
        for k in 0..=n {
            let [x, y, z, _] = self.along(ends[k]);
            (self.ends[0][k], self.ends[1][k]) = (x, y);
            let length_sq = x * x + y * y;
            size_sq = size_sq.max(length_sq);
            let last = k.min(n - 1);
            let up = -1.0 / dot(normals[last], normal);
            let slope = [up * dot(normals[last], across), up * dot(normals[last], along)];
            let inverse_sq = 1.0 / length_sq;
            self.rays[k] = Ray { x, y, z, inverse_sq, slope };
        }
        self.size_sq = size_sq;
        self.tiny = ROUNDING * size_sq;
        self.limits = [0.0; MOST + 1];
        if !is_closed {
            (self.limits[0], self.limits[n]) = (-self.tiny, self.tiny);
        }
        self.rounding = 16.0 * ROUNDING * size_sq.sqrt();
        self.turns_once()
    }

    /// True if no place is covered twice. No triangle goes half around.
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

    /// A direction by the three axes.
    #[inline(always)]
    fn along(&self, from: Vector) -> [f64; 4] {
        let [first, second, third] = &self.axes;
        let mut along = [0.0; 4];
        for k in 0..4 {
            along[k] = from[0] * first[k] + from[1] * second[k] + from[2] * third[k];
        }
        along
    }

    /// A bit for each edge at the vertex, of some of them, that a place is to the right of.
    #[inline(always)]
    fn right<const FROM: usize>(&self, x: f64, y: f64) -> u64 {
        let [ray_x, ray_y] = self.ends.each_ref().map(|row| &row[FROM..FROM + LANES]);
        let limits = &self.limits[FROM..FROM + LANES];
        let mut right = 0;
        for k in 0..LANES {
            let is_right = ray_x[k] * y - ray_y[k] * x < limits[k];
            right |= if is_right { 1 << (FROM + k) } else { 0 };
        }
        right
    }

    /// A point as it lies over the star.
    #[inline(always)]
    pub(super) fn place(&self, point: Vector) -> Place {
        let [x, y, z, _] = self.along(sub(point, self.origin));
        let mut place = Place { x, y, z, off: 0.0, sector: OUTSIDE };
        // What is not a number is outside.
        if x * x + y * y <= self.size_sq {
            let mut right = self.right::<0>(x, y);
            if self.n >= LANES {
                right |= self.right::<LANES>(x, y);
            }
            // Not to the right of an edge, but of the next one.
            let k = (!right & (right >> 1)).trailing_zeros();
            if (k as usize) < self.n {
                let (b, c) = (&self.rays[k as usize], &self.rays[k as usize + 1]);
                let inwards = (c.x - b.x) * (y - b.y) - (c.y - b.y) * (x - b.x);
                if inwards >= -self.tiny {
                    place.sector = k;
                    place.off = (z - b.slope[0] * x - b.slope[1] * y).abs();
                }
            }
        }
        place
    }

    /// The distance of a triangle, if it lies over the star; all its corners do.
    #[inline(always)]
    pub(super) fn over(&self, corners: [&Place; 3]) -> Option<f64> {
        let [a, b, c] = corners;
        let mut most = a.off.max(b.off).max(c.off);
        if a.sector != b.sector || b.sector != c.sector {
            let (u, v, w) = (product(b, c), product(c, a), product(a, b));
            for (p, q, turn) in [(b, c, u), (c, a, v), (a, b, w)] {
                // What two places of one triangle have between them lies in it too.
                if p.sector != q.sector {
                    // Counter-clockwise.
                    let (p, q) = if turn >= 0.0 { (p, q) } else { (q, p) };
                    if !self.cross(p, q, &mut most) {
                        return None;
                    }
                }
            }
            let sum = u + v + w;
            let is_around = u.min(v).min(w) >= 0.0 || u.max(v).max(w) <= 0.0;
            if is_around && sum != 0.0 {
                let height = u * a.z + v * b.z + w * c.z;
                most = most.max((height / sum).abs());
            }
        }
        Some(most + self.rounding)
    }

    /// Looks at the places where an edge of a triangle crosses those at the vertex, counter-clockwise. False if that leads out
    /// of the star.
    #[inline(always)]
    fn cross(&self, p: &Place, q: &Place, most: &mut f64) -> bool {
        let mut k = p.sector as usize;
        while k != q.sector as usize {
            k += 1;
            let ray = &self.rays[k];
            if k == self.n {
                if !self.is_closed {
                    return false;
                }
                k = 0;
            }
            let (from, to) = (ray.x * p.y - ray.y * p.x, ray.x * q.y - ray.y * q.x);
            // The ends lie on both sides of it, up to rounding.
            let sum = to - from;
            if sum <= self.tiny {
                // Along the edge: both ends count already, and one of them may be beyond it.
                continue;
            }
            let share = (-from / sum).clamp(0.0, 1.0);
            let (x, y) = (p.x + share * (q.x - p.x), p.y + share * (q.y - p.y));
            let along = (ray.x * x + ray.y * y) * ray.inverse_sq;
            if along > 1.0 + ROUNDING {
                return false;
            }
            let z = p.z + share * (q.z - p.z);
            *most = most.max((z - along * ray.z).abs());
        }
        true
    }
}

fn product(p: &Place, q: &Place) -> f64 {
    p.x * q.y - p.y * q.x
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
