//! The quick look at a triangle of the version: at the patches of its corners alone.
//!
//! Around what went into a corner the triangles of its patch are all that there are. So the border of the three patches together is the
//! edges of their rims that have no such end, and those that are loose in the mesh: no edges have to be matched as in `below`, which
//! has the argument. How often the border goes around a point is how often the triangles cover it.

use super::below::{Frame, Over, POINT, crosses, is_near};
use super::patches::{MOST, Patches};
use crate::measure::triangle::Vector;
use crate::mesh::Mesh;

/// A bit for each side of the triangle that a place does not lie within.
const SIDES: u64 = 7;

/// The bit of places that are too far.
const HIGH: u64 = 8;

/// A bit for each corner: of the vertices that went into it.
const OWN: [u64; 3] = [0x10, 0x20, 0x40];

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

/// The vertices of a patch as they lie over a triangle: seen from its first corner, as shares of the other two corners and height,
/// and bits.
pub(super) struct Within<'a> {
    mesh: &'a Mesh,
    patches: &'a Patches,
    hints: &'a [u32],
    limit: f64,
    from: [[f64; MOST]; 3],
    shares: [[f64; MOST]; 2],
    height: [f64; MOST],
    bits: [u64; MOST],
}

impl<'a> Within<'a> {
    /// Of a mesh with its patches, and the vertices that its own went into; within a distance.
    pub(super) fn new(mesh: &'a Mesh, patches: &'a Patches, hints: &'a [u32], limit: f64) -> Self {
        let zero = [0.0; MOST];
        let (from, shares) = ([zero; 3], [zero; 2]);
        Within { mesh, patches, hints, limit, from, shares, height: zero, bits: [0; MOST] }
    }

    /// Tells if the patches of the corners `own` of the triangle `t` cover it as a whole, but for its rim.
    pub(super) fn look(&mut self, t: &[Vector; 3], own: [u32; 3]) -> Found {
        let borders = own.map(|v| self.patches.border(v));
        let [Some(a), Some(b), Some(c)] = borders else { return Found::Perhaps };
        let Some(frame) = Frame::new(t, self.limit) else { return Found::Open };
        let mut times = 0;
        // With the bits of the patches before.
        for (v, border, met) in [(own[0], a, 0), (own[1], b, OWN[0]), (own[2], c, OWN[0] | OWN[1])]
        {
            let any = self.place(&frame, v, own);
            let ends = |edge: &[u16; 2]| edge.map(usize::from);
            let either = |[p, q]: [usize; 2]| self.bits[p] | self.bits[q];
            let own = OWN[0] | OWN[1] | OWN[2];
            let is_over = |[p, q]: [usize; 2]| {
                self.bits[p] & self.bits[q] & SIDES == 0
                    && crosses([&self.over(p), &self.over(q)], frame.rim)
            };
            for edge in border.rim.iter().map(ends).filter(|&edge| either(edge) & own == 0) {
                if is_over(edge) {
                    return Found::Perhaps;
                }
                times += self.turn(edge);
            }
            for edge in border.loose.iter().map(ends).filter(|&edge| either(edge) & met == 0) {
                if is_over(edge) {
                    return Found::Open;
                }
                times += self.turn(edge);
            }
            if any & HIGH == 0 {
                continue;
            }
            for corners in self.patches.corners(v) {
                let [p, q, r] = corners.map(usize::from);
                let [a, b, c] = [self.bits[p], self.bits[q], self.bits[r]];
                if (a | b | c) & HIGH != 0
                    && a & b & c & SIDES == 0
                    && !is_near([p, q, r].map(|k| self.over(k)), &frame)
                {
                    return Found::Open;
                }
            }
        }
        if times != 0 { Found::Covered } else { Found::Open }
    }

    /// Finds the places of a patch; returns all bits that any of them has.
    #[inline(always)]
    fn place(&mut self, frame: &Frame, v: u32, own: [u32; 3]) -> u64 {
        let vertices = self.patches.vertices(v);
        let n = vertices.len();
        let [x, y, z] = self.from.each_mut().map(|row| &mut row[..n]);
        let bits = &mut self.bits[..n];
        for (i, &w) in vertices.iter().enumerate() {
            let p = self.mesh.positions[w as usize];
            x[i] = p[0] - frame.origin[0];
            y[i] = p[1] - frame.origin[1];
            z[i] = p[2] - frame.origin[2];
            let hint = self.hints[w as usize];
            bits[i] = if hint == own[0] {
                OWN[0]
            } else if hint == own[1] {
                OWN[1]
            } else if hint == own[2] {
                OWN[2]
            } else {
                0
            };
        }
        let [b, c] = self.shares.each_mut().map(|row| &mut row[..n]);
        let height = &mut self.height[..n];
        let mut any = 0;
        for i in 0..n {
            let along = |to: Vector| x[i] * to[0] + y[i] * to[1] + z[i] * to[2];
            (b[i], c[i], height[i]) = (along(frame.to_b), along(frame.to_c), along(frame.up));
            bits[i] |= u64::from(1.0 - b[i] - c[i] <= frame.rim)
                | u64::from(b[i] <= frame.rim) << 1
                | u64::from(c[i] <= frame.rim) << 2
                | u64::from(height[i].abs() > frame.limit) << 3;
            any |= bits[i];
        }
        any
    }

    #[inline]
    fn over(&self, k: usize) -> Over {
        let (b, c) = (self.shares[0][k], self.shares[1][k]);
        Over { shares: [1.0 - b - c, b, c], height: self.height[k], out: 0 }
    }

    /// Times that an edge goes around the point that is tried, counter-clockwise, as a part of a closed line: where it passes the
    /// line from there along the first share. No edge that does not lie over the triangle does so near the point.
    #[inline]
    fn turn(&self, [p, q]: [usize; 2]) -> i32 {
        let [b, c] = &self.shares;
        let [from, to] = [p, q].map(|k| c[k] >= POINT[1]);
        if from == to {
            return 0;
        }
        let share = (POINT[1] - c[p]) / (c[q] - c[p]);
        let at = b[p] + share * (b[q] - b[p]);
        (i32::from(to) - i32::from(from)) * i32::from(at > POINT[0])
    }
}
