//! The quick look at a triangle of the version: at the patches of its corners alone.
//!
//! Around what went into a corner the triangles of its patch are all that there are. So the border of the three patches together is the
//! edges of their rims that have no such end, and those that are loose in the mesh: no edges have to be matched as in `below`, which
//! has the argument. How often the border goes around a point is how often the triangles cover it.

use super::below::{Frame, Over, POINT, crosses, is_near};
use super::patches::{MOST, Patches};
use crate::triangle::Vector;
use stonecut_mesh::Mesh;

/// A bit for each side of the triangle that a place does not lie within.
const SIDES: u8 = 7;

/// The bit of places that are too far.
const HIGH: u8 = 8;

/// A bit for each corner: of the vertices that went into it.
const OWN: [u8; 3] = [0x10, 0x20, 0x40];

/// The bit of places beyond the line through the point that is tried.
const BEYOND: u8 = 0x80;

/// Outcome of the quick look.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Found {
    /// The triangle is covered.
    Covered,
    /// More of the mesh may cover it.
    Perhaps,
    /// A border of the mesh lies over it, or a part of the mesh that is too far, or nothing that counts.
    Open,
}

/// A vertex of the mesh, and the vertex of its version that it went into. Two to a cache line, none in two.
#[derive(Clone, Copy)]
#[repr(align(32))]
struct Vertex {
    place: Vector,
    hint: u32,
}

/// The vertices of a patch as they lie over a triangle: seen from its first corner, as shares of the other two corners and height,
/// and bits.
pub(super) struct Within<'a> {
    /// Side by side, since a look needs both of each.
    mesh: Vec<Vertex>,
    patches: &'a Patches,
    limit: f64,
    from: [[f64; MOST]; 3],
    shares: [[f64; MOST]; 2],
    height: [f64; MOST],
    bits: [u8; MOST],
}

impl<'a> Within<'a> {
    /// Of a mesh with its patches, and the vertices that its own went into; within a distance.
    pub(super) fn new(mesh: &Mesh, patches: &'a Patches, hints: &[u32], limit: f64) -> Self {
        let zero = [0.0; MOST];
        let (from, shares) = ([zero; 3], [zero; 2]);
        let vertices = mesh.positions.iter().zip(hints);
        let mesh = vertices.map(|(&place, &hint)| Vertex { place, hint }).collect();
        Within { mesh, patches, limit, from, shares, height: zero, bits: [0; MOST] }
    }

    /// True if the patches of the corners `own` of the triangle `t` cover it as a whole, but for its rim.
    pub(super) fn look(&mut self, t: &[Vector; 3], own: [u32; 3]) -> Found {
        let borders = own.map(|v| self.patches.border(v));
        let [Some(a), Some(b), Some(c)] = borders else { return Found::Perhaps };
        let Some(frame) = Frame::new(t, self.limit) else { return Found::Open };
        let all = OWN[0] | OWN[1] | OWN[2];
        let mut times = 0;
        // With the bits of the patches before.
        for (v, border, met) in [(own[0], a, 0), (own[1], b, OWN[0]), (own[2], c, OWN[0] | OWN[1])]
        {
            let any = self.place(&frame, v, own);
            match self.around(border.rim, all, frame.rim) {
                Some(turns) => times += turns,
                None => return Found::Perhaps,
            }
            match self.around(border.loose, met, frame.rim) {
                Some(turns) => times += turns,
                None => return Found::Open,
            }
            if any & HIGH != 0 && self.is_too_far(self.patches.corners(v), &frame) {
                return Found::Open;
            }
        }
        if times != 0 { Found::Covered } else { Found::Open }
    }

    /// The bits of a place.
    #[inline(always)]
    fn bits(&self, k: u16) -> u8 {
        self.bits[usize::from(k) % MOST]
    }

    /// Times that some edges without ends of `but` go around the point that is tried; none if one of them lies over the triangle.
    #[inline(always)]
    fn around(&self, edges: &[[u16; 2]], but: u8, rim: f64) -> Option<i32> {
        let mut times = 0;
        for &[p, q] in edges {
            let (a, b) = (self.bits(p), self.bits(q));
            let (is_over, is_across) = (a & b & SIDES == 0, (a ^ b) & BEYOND != 0);
            // Both are rare, so that there is one branch for each edge.
            if ((a | b) & but == 0) & (is_over | is_across) {
                let ends = [p, q].map(usize::from);
                if is_over && crosses([&self.over(ends[0]), &self.over(ends[1])], rim) {
                    return None;
                }
                times += self.turn(ends);
            }
        }
        Some(times)
    }

    /// True if one of some triangles is too far where it lies over the triangle.
    fn is_too_far(&self, corners: &[[u16; 3]], frame: &Frame) -> bool {
        corners.iter().any(|corners| {
            let [a, b, c] = corners.map(|k| self.bits(k));
            (((a | b | c) & HIGH != 0) & (a & b & c & SIDES == 0))
                && !is_near(corners.map(|k| self.over(usize::from(k))), frame)
        })
    }

    /// Finds the places of a patch; returns all bits that any of them has.
    #[inline(always)]
    fn place(&mut self, frame: &Frame, v: u32, own: [u32; 3]) -> u8 {
        let vertices = self.patches.vertices(v);
        let n = vertices.len();
        let [x, y, z] = self.from.each_mut().map(|row| &mut row[..n]);
        let bits = &mut self.bits[..n];
        for (i, &w) in vertices.iter().enumerate() {
            let Vertex { place, hint } = self.mesh[w as usize];
            x[i] = place[0] - frame.origin[0];
            y[i] = place[1] - frame.origin[1];
            z[i] = place[2] - frame.origin[2];
            bits[i] = (u8::from(hint == own[0]) * OWN[0])
                | (u8::from(hint == own[1]) * OWN[1])
                | (u8::from(hint == own[2]) * OWN[2]);
        }
        let [b, c] = self.shares.each_mut().map(|row| &mut row[..n]);
        let height = &mut self.height[..n];
        for i in 0..n {
            let along = |to: Vector| x[i] * to[0] + y[i] * to[1] + z[i] * to[2];
            (b[i], c[i], height[i]) = (along(frame.to_b), along(frame.to_c), along(frame.up));
        }
        let mut any = 0;
        for i in 0..n {
            bits[i] |= u8::from(1.0 - b[i] - c[i] <= frame.rim)
                | u8::from(b[i] <= frame.rim) << 1
                | u8::from(c[i] <= frame.rim) << 2
                | u8::from(height[i].abs() > frame.limit) << 3
                | u8::from(c[i] >= POINT[1]) << 7;
            any |= bits[i];
        }
        any
    }

    #[inline]
    fn over(&self, k: usize) -> Over {
        let k = k % MOST;
        let (b, c) = (self.shares[0][k], self.shares[1][k]);
        Over { shares: [1.0 - b - c, b, c], height: self.height[k], out: 0 }
    }

    /// Times that an edge goes around the point that is tried, counter-clockwise, as a part of a closed line: where it passes the
    /// line from there along the first share. No edge that does not lie over the triangle does so near the point.
    #[inline]
    fn turn(&self, [p, q]: [usize; 2]) -> i32 {
        let [b, c] = &self.shares;
        let (p, q) = (p % MOST, q % MOST);
        let [from, to] = [p, q].map(|k| c[k] >= POINT[1]);
        if from == to {
            return 0;
        }
        let share = (POINT[1] - c[p]) / (c[q] - c[p]);
        let at = b[p] + share * (b[q] - b[p]);
        (i32::from(to) - i32::from(from)) * i32::from(at > POINT[0])
    }
}
