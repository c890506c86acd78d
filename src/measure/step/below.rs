//! Decides if the mesh covers a triangle of its version: seen along the triangle's normal, without gaps, within a distance.
//!
//! A rim of the triangle may stay uncovered: made smaller around its middle by the factor 1 - f, it lies nowhere farther from what it was
//! than f times the distance of its corners from its middle, and all shares of the smaller one are f / 3 at least.
//!
//! Taken together, triangles that are not farther than allowed over the triangle cover each of its points as often as any other
//! one, counted with their sides, if no edge of their common border lies over it (the degree of a map is constant off the image of
//! the border). So one point that is covered shows that all are.

use crate::triangle::Vector;
use stonecut_mesh::Mesh;
use stonecut_mesh::vec3::{cross, dot, length_sq, scale, sub};

/// The point that is tried, in shares of the corners: where edges hardly ever meet.
pub(super) const POINT: [f64; 2] = [0.345_771_3, 0.318_930_7];

/// Place of a point over the triangle: shares of the corners, and height along the normal.
#[derive(Clone, Copy)]
pub(super) struct Over {
    pub(super) shares: [f64; 3],
    pub(super) height: f64,
    /// A bit for each side of the triangle that it does not lie within, for each side of the point that is tried, and `HIGH`.
    pub(super) out: u8,
}

/// Heights over a triangle may be up to this share of the limit, and what is not covered may be up to the other aside of what is:
/// the two are at right angles, so together they are within the limit.
const HIGH_SHARE: f64 = 0.8;
const ASIDE_SHARE: f64 = 0.6;

/// Shares up to this are 0 in any case: some are not known better.
const RIM: f64 = 1.0 / (1u64 << 46) as f64;

/// Shares from this on are never outside; the point that is tried has more.
const WIDEST_RIM: f64 = 0.25;

/// A bit for each side of the triangle.
const SIDES: u8 = 7;

/// The bit of points that are farther than the limit.
const HIGH: u8 = 8;

/// A bit for each side of the point that is tried, by two of the shares.
const ASIDE: u8 = 0xf0;

/// The triangle that is held against the mesh: its first corner, what gives shares of the other two, and its normal.
pub(super) struct Frame {
    pub(super) origin: Vector,
    pub(super) to_b: Vector,
    pub(super) to_c: Vector,
    pub(super) up: Vector,
    /// Shares up to this are outside.
    pub(super) rim: f64,
    /// Heights beyond this are too far.
    pub(super) limit: f64,
}

#[inline(always)]
fn bit(is_set: bool, bit: u8) -> u8 {
    if is_set { bit } else { 0 }
}

impl Frame {
    /// For what is within `limit` of the triangle; none without an area.
    pub(super) fn new(t: &[Vector; 3], limit: f64) -> Option<Frame> {
        let (a, b) = (sub(t[1], t[0]), sub(t[2], t[0]));
        let normal = cross(a, b);
        let area_sq = length_sq(normal);
        let middle = [0, 1, 2].map(|k| (t[0][k] + t[1][k] + t[2][k]) / 3.0);
        let radius_sq = t.iter().map(|p| length_sq(sub(*p, middle))).fold(0.0, f64::max);
        let rim = ASIDE_SHARE * limit / radius_sq.sqrt() / 3.0;
        (area_sq > 0.0).then(|| Frame {
            origin: t[0],
            to_b: scale(cross(b, normal), 1.0 / area_sq),
            to_c: scale(cross(normal, a), 1.0 / area_sq),
            up: scale(normal, 1.0 / area_sq.sqrt()),
            rim: rim.clamp(RIM, WIDEST_RIM),
            limit: HIGH_SHARE * limit,
        })
    }

    #[inline(always)]
    fn place(&self, point: Vector) -> Over {
        let p = sub(point, self.origin);
        let (b, c, height) = (dot(p, self.to_b), dot(p, self.to_c), dot(p, self.up));
        let shares = [1.0 - b - c, b, c];
        let out = bit(shares[0] <= self.rim, 1)
            | bit(shares[1] <= self.rim, 2)
            | bit(shares[2] <= self.rim, 4)
            | bit(height.abs() > self.limit, HIGH)
            | bit(b < POINT[0], 0x10)
            | bit(b > POINT[0], 0x20)
            | bit(c < POINT[1], 0x40)
            | bit(c > POINT[1], 0x80);
        Over { shares, height, out }
    }
}

/// Triangles of a mesh that may lie over a triangle.
pub(super) struct Below<'a> {
    mesh: &'a Mesh,
    limit: f64,
    /// For each triangle, and each vertex, of the mesh the last query that it was seen in; for a vertex its number in `places`.
    seen: Vec<u32>,
    last: Vec<[u32; 2]>,
    query: u32,
    places: Vec<Over>,
    /// Edges of the triangles that count, without those that two of them have; with the places of their ends.
    border: Vec<([u32; 2], [u32; 2])>,
}

impl Below<'_> {
    /// Of a mesh, within a distance.
    pub(super) fn new(mesh: &Mesh, limit: f64) -> Below<'_> {
        Below {
            mesh,
            limit,
            seen: vec![0; mesh.triangles.len()],
            last: vec![[0; 2]; mesh.positions.len()],
            query: 0,
            places: Vec::new(),
            border: Vec::new(),
        }
    }

    /// True if the triangles of some lists, which may come more than once, cover the triangle `t` as a whole. False says
    /// nothing.
    pub(super) fn covers<'b>(
        &mut self,
        t: &[Vector; 3],
        lists: impl Iterator<Item = &'b [u32]>,
    ) -> bool {
        let Some(frame) = Frame::new(t, self.limit) else { return false };
        self.query += 1;
        self.places.clear();
        self.border.clear();
        let mut times = 0;
        for list in lists {
            for &f in list {
                let seen = &mut self.seen[f as usize];
                if *seen == self.query {
                    continue;
                }
                *seen = self.query;
                let [u, v, w] = self.mesh.triangles[f as usize];
                let places = [self.place(&frame, u), self.place(&frame, v), self.place(&frame, w)];
                let [p, q, r] = places.map(|place| &self.places[place as usize]);
                let out = p.out & q.out & r.out;
                if out & SIDES != 0 {
                    continue;
                }
                let is_high = (p.out | q.out | r.out) & HIGH != 0;
                if is_high && !is_near([*p, *q, *r], &frame) {
                    continue;
                }
                if out & ASIDE == 0 {
                    match turns([p, q, r]) {
                        Some(turns) => times += turns,
                        None => return false,
                    }
                }
                let outs = [p.out & q.out, q.out & r.out, r.out & p.out];
                let ends = [[u, v], [v, w], [w, u]];
                for k in 0..3 {
                    if outs[k] & SIDES == 0 {
                        self.add(ends[k], [places[k], places[(k + 1) % 3]]);
                    }
                }
            }
        }
        let crosses = |ends: [u32; 2]| {
            let [p, q] = ends.map(|place| &self.places[place as usize]);
            crosses([p, q], frame.rim)
        };
        times != 0 && !self.border.iter().any(|(_, ends)| crosses(*ends))
    }

    /// The number of a vertex's place.
    #[inline(always)]
    fn place(&mut self, frame: &Frame, vertex: u32) -> u32 {
        let last = &mut self.last[vertex as usize];
        if last[0] == self.query {
            return last[1];
        }
        let number = self.places.len() as u32;
        *last = [self.query, number];
        self.places.push(frame.place(self.mesh.positions[vertex as usize]));
        number
    }

    /// Adds an edge to the border, or takes away its other side.
    #[inline]
    fn add(&mut self, [v, w]: [u32; 2], ends: [u32; 2]) {
        for i in (0..self.border.len()).rev() {
            if self.border[i].0 == [w, v] {
                self.border.swap_remove(i);
                return;
            }
        }
        self.border.push(([v, w], ends));
    }
}

/// Share of the limit that is kept in hand where heights are not cut off, and multiples of it up to which rounding takes less.
const IN_HAND: f64 = 1e-9;
const ROUNDED: f64 = 1e5;

/// True if what of a triangle lies over the one in question is within the limit.
pub(super) fn is_near(corners: [Over; 3], frame: &Frame) -> bool {
    let leans = |sign: f64| (0..3).any(|side| leans(&corners, (sign, side), frame));
    if leans(1.0) && leans(-1.0) {
        return true;
    }
    is_cut_near(corners, frame)
}

/// Shows it to one side of the triangle in question, by one of its shares.
///
/// Over it no share is below the rim. So a height is at most what it is with any multiple of the share beyond the rim added, and
/// that is linear, so greatest at a corner. False says nothing.
#[inline]
fn leans(corners: &[Over; 3], (sign, side): (f64, usize), frame: &Frame) -> bool {
    let most = frame.limit * (1.0 - IN_HAND);
    let of = |p: &Over| (sign * p.height, p.shares[side] - frame.rim);
    let mut factor = 0f64;
    for (height, share) in corners.iter().map(of) {
        if height > most && share < 0.0 {
            factor = factor.max((height - most) / -share);
        }
    }
    let (most, far) = (frame.limit * (1.0 - 0.5 * IN_HAND), ROUNDED * frame.limit);
    corners.iter().map(of).all(|(height, share)| {
        let added = factor * share;
        height + added <= most && height.abs() <= far && added.abs() <= far
    })
}

/// The same, exactly: by the part that is left after each side.
fn is_cut_near(corners: [Over; 3], frame: &Frame) -> bool {
    // What is left of it after each side.
    let (mut part, mut n) = ([corners[0]; 8], 3);
    part[..3].copy_from_slice(&corners);
    for side in 0..3 {
        let (old, n_old) = (part, n);
        n = 0;
        for i in 0..n_old {
            let (p, q) = (old[i], old[(i + 1) % n_old]);
            let (a, b) = (p.shares[side] - frame.rim, q.shares[side] - frame.rim);
            if a >= 0.0 {
                part[n] = p;
                n += 1;
            }
            if (a < 0.0) != (b < 0.0) {
                part[n] = between(&p, &q, a / (a - b));
                n += 1;
            }
        }
    }
    part[..n].iter().all(|p| p.height.abs() <= frame.limit)
}

fn between(p: &Over, q: &Over, share: f64) -> Over {
    let mix = |a: f64, b: f64| a + share * (b - a);
    Over {
        shares: [0, 1, 2].map(|k| mix(p.shares[k], q.shares[k])),
        height: mix(p.height, q.height),
        out: 0,
    }
}

/// Times that a triangle goes around the point that is tried: 1 or -1 by its side, 0 beside it; none if that is not certain.
fn turns(corners: [&Over; 3]) -> Option<i32> {
    let (mut left, mut right) = (0, 0);
    for k in 0..3 {
        let (p, q) = (corners[k], corners[(k + 1) % 3]);
        let a = (p.shares[1] - POINT[0]) * (q.shares[2] - POINT[1]);
        let b = (p.shares[2] - POINT[1]) * (q.shares[1] - POINT[0]);
        if (a - b).abs() <= 1e-12 * a.abs().max(b.abs()) {
            return None;
        }
        left += i32::from(a > b);
        right += i32::from(a < b);
    }
    Some(i32::from(left == 3) - i32::from(right == 3))
}

/// True if a part of an edge lies over the triangle, but for its rim.
#[inline]
pub(super) fn crosses([p, q]: [&Over; 2], rim: f64) -> bool {
    let (mut from, mut to) = (0.0f64, 1.0f64);
    for k in 0..3 {
        let (a, b) = (p.shares[k] - rim, q.shares[k] - rim);
        if a < 0.0 {
            from = from.max(a / (a - b));
        } else if b < 0.0 {
            to = to.min(a / (a - b));
        }
    }
    from < to
}
