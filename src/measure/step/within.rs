//! The quick look at a triangle of the version: at the patches of its corners alone.
//!
//! Around what went into a corner the triangles of its patch are all that there are. So the border of the three patches together is the
//! edges of their rims that have no such end, and those that are loose in the mesh: no edges have to be matched as in `below`, which
//! has the argument. How often the border goes around a point is how often the triangles cover it.

use super::around::NONE;
use super::below::{Frame, Over, POINT, crosses, is_near};
use super::patches::{MOST, Patches};
use crate::triangle::Vector;
use crate::wide::{WideJob, run};
use stonecut_mesh::Mesh;

/// A bit for each side of the triangle that a place does not lie within.
const SIDES: u64 = 7;

/// The bit of places that are too far.
const HIGH: u64 = 8;

/// A bit for each corner: of the vertices that went into it.
const OWN: [u64; 3] = [0x10, 0x20, 0x40];

/// The bit of places beyond the line through the point that is tried.
const BEYOND: u64 = 0x80;

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

/// Patches of at most this many vertices are kept for the triangles to come, and this many of them: those of about two rows of
/// triangles.
const SMALL: usize = 32;
const KEPT: usize = 512;

/// The vertices of a patch side by side: their places, and the vertices of the version that they went into.
#[derive(Clone)]
struct PatchRows<const N: usize> {
    /// The vertex of the patch.
    of: u32,
    place: [[f64; N]; 3],
    hint: [u32; N],
}

impl<const N: usize> PatchRows<N> {
    const EMPTY: PatchRows<N> = PatchRows { of: NONE, place: [[0.0; N]; 3], hint: [0; N] };

    /// Gathers a patch, if it is not there already.
    #[inline(always)]
    fn gather(&mut self, v: u32, vertices: &[u32], mesh: &Mesh, hints: &[u32]) {
        if self.of == v {
            return;
        }
        self.of = v;
        for (i, &w) in vertices.iter().enumerate() {
            let place = mesh.positions[w as usize];
            (0..3).for_each(|k| self.place[k][i] = place[k]);
            self.hint[i] = hints[w as usize];
        }
    }
}

/// The vertices of a patch as they lie over a triangle: seen from its first corner, as shares of the other two corners and height,
/// and bits.
pub(super) struct Within<'a> {
    mesh: &'a Mesh,
    hints: &'a [u32],
    patches: &'a Patches,
    limit: f64,
    small: Vec<PatchRows<SMALL>>,
    large: Box<PatchRows<MOST>>,
    over: Places,
}

/// Places over a triangle, side by side.
struct Places {
    shares: [[f64; MOST]; 2],
    height: [f64; MOST],
    /// As wide as the numbers that they come from: narrow ones take longer.
    bits: [u64; MOST],
}

/// A bit for each of up to 64 that count. They are rare, and nothing foretells them: found without a branch for each.
#[inline(always)]
fn marked<T: Copy>(few: &[T], counts: impl Fn(T) -> bool) -> u64 {
    let mut marked = 0;
    for (k, &one) in few.iter().enumerate() {
        marked |= u64::from(counts(one)) << k;
    }
    marked
}

/// True if an edge may lie over the triangle, by the bits of its ends.
#[inline(always)]
fn is_over(a: u64, b: u64) -> bool {
    a & b & SIDES == 0
}

/// True if an edge leads across the line through the point that is tried.
#[inline(always)]
fn is_across(a: u64, b: u64) -> bool {
    (a ^ b) & BEYOND != 0
}

/// A look at one triangle.
struct Look<'a, 'b> {
    within: &'a mut Within<'b>,
    triangle: &'a [Vector; 3],
    own: [u32; 3],
}

impl WideJob for Look<'_, '_> {
    type Output = Found;

    #[inline(always)]
    fn run(self) -> Found {
        self.within.look_wide(self.triangle, self.own)
    }
}

impl<'a> Within<'a> {
    /// Of a mesh with its patches, and the vertices that its own went into; within a distance. `n` is the number of the patches.
    pub(super) fn new(
        mesh: &'a Mesh,
        (patches, n): (&'a Patches, usize),
        hints: &'a [u32],
        limit: f64,
    ) -> Self {
        let zero = [0.0; MOST];
        let over = Places { shares: [zero; 2], height: zero, bits: [0; MOST] };
        let small = vec![PatchRows::EMPTY; n.clamp(1, KEPT)];
        Within { mesh, hints, patches, limit, small, large: Box::new(PatchRows::EMPTY), over }
    }

    /// True if the patches of the corners `own` of the triangle `t` cover it as a whole, but for its rim.
    pub(super) fn look(&mut self, triangle: &[Vector; 3], own: [u32; 3]) -> Found {
        run(Look { within: self, triangle, own })
    }

    #[inline(always)]
    pub(super) fn look_wide(&mut self, t: &[Vector; 3], own: [u32; 3]) -> Found {
        let borders = own.map(|v| self.patches.border(v));
        let [Some(a), Some(b), Some(c)] = borders else { return Found::Perhaps };
        let Some(frame) = Frame::new(t, self.limit) else { return Found::Open };
        let all = OWN[0] | OWN[1] | OWN[2];
        let mut times = 0;
        // With the bits of the patches before.
        for (v, border, met) in [(own[0], a, 0), (own[1], b, OWN[0]), (own[2], c, OWN[0] | OWN[1])]
        {
            let any = self.place(&frame, v, own);
            match self.over.around(border.rim, all, frame.rim) {
                Some(turns) => times += turns,
                None => return Found::Perhaps,
            }
            match self.over.around(border.loose, met, frame.rim) {
                Some(turns) => times += turns,
                None => return Found::Open,
            }
            if any & HIGH != 0 && self.over.is_too_far(self.patches.corners(v), &frame) {
                return Found::Open;
            }
        }
        if times != 0 { Found::Covered } else { Found::Open }
    }

    /// Finds the places of a patch; returns all bits that any of them has.
    #[inline(always)]
    fn place(&mut self, frame: &Frame, v: u32, own: [u32; 3]) -> u64 {
        let Within { mesh, hints, patches, small, large, over, .. } = self;
        let vertices = patches.vertices(v);
        let n = vertices.len();
        if n <= SMALL {
            let at = v as usize % small.len();
            small[at].gather(v, vertices, mesh, hints);
            return over.place(&small[at], n, frame, own);
        }
        large.gather(v, vertices, mesh, hints);
        over.place(large, n, frame, own)
    }
}

impl Places {
    /// Finds the places of the first `n` vertices of a patch; returns all bits that any of them has.
    #[inline(always)]
    fn place<const N: usize>(
        &mut self,
        rows: &PatchRows<N>,
        n: usize,
        frame: &Frame,
        own: [u32; 3],
    ) -> u64 {
        let [x, y, z] = rows.place.each_ref().map(|row| &row[..n]);
        let hint = &rows.hint[..n];
        let [b, c] = self.shares.each_mut().map(|row| &mut row[..n]);
        let (height, bits) = (&mut self.height[..n], &mut self.bits[..n]);
        let mut any = 0;
        for i in 0..n {
            let (x, y, z) =
                (x[i] - frame.origin[0], y[i] - frame.origin[1], z[i] - frame.origin[2]);
            let along_b = x * frame.to_b[0] + y * frame.to_b[1] + z * frame.to_b[2];
            let along_c = x * frame.to_c[0] + y * frame.to_c[1] + z * frame.to_c[2];
            let up = x * frame.up[0] + y * frame.up[1] + z * frame.up[2];
            let out = (u64::from(hint[i] == own[0]) * OWN[0])
                | (u64::from(hint[i] == own[1]) * OWN[1])
                | (u64::from(hint[i] == own[2]) * OWN[2])
                | u64::from(1.0 - along_b - along_c <= frame.rim)
                | u64::from(along_b <= frame.rim) << 1
                | u64::from(along_c <= frame.rim) << 2
                | u64::from(up.abs() > frame.limit) << 3
                | u64::from(along_c >= POINT[1]) << 7;
            (b[i], c[i], height[i], bits[i]) = (along_b, along_c, up, out);
            any |= out;
        }
        any
    }

    /// The bits of a place.
    #[inline(always)]
    fn bits(&self, k: u16) -> u64 {
        self.bits[usize::from(k) % MOST]
    }

    /// Times that some edges without ends of `but` go around the point that is tried; none if one of them lies over the triangle.
    #[inline(always)]
    fn around(&self, edges: &[[u16; 2]], but: u64, rim: f64) -> Option<i32> {
        let mut times = 0;
        for few in edges.chunks(64) {
            let mut counted = marked(few, |[p, q]| {
                let (a, b) = (self.bits(p), self.bits(q));
                ((a | b) & but == 0) & (is_over(a, b) | is_across(a, b))
            });
            while counted != 0 {
                let [p, q] = few[counted.trailing_zeros() as usize % 64];
                counted &= counted - 1;
                let ends = [p, q].map(usize::from);
                if is_over(self.bits(p), self.bits(q))
                    && crosses([&self.over(ends[0]), &self.over(ends[1])], rim)
                {
                    return None;
                }
                times += self.turn(ends);
            }
        }
        Some(times)
    }

    /// True if one of some triangles is too far where it lies over the triangle.
    #[inline(always)]
    fn is_too_far(&self, corners: &[[u16; 3]], frame: &Frame) -> bool {
        for few in corners.chunks(64) {
            let mut counted = marked(few, |[a, b, c]| {
                let (a, b, c) = (self.bits(a), self.bits(b), self.bits(c));
                ((a | b | c) & HIGH != 0) & (a & b & c & SIDES == 0)
            });
            while counted != 0 {
                let corners = few[counted.trailing_zeros() as usize % 64];
                counted &= counted - 1;
                if !is_near(corners.map(|k| self.over(usize::from(k))), frame) {
                    return true;
                }
            }
        }
        false
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
