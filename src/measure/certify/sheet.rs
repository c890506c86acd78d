//! Proves a whole piece by the sheet of target triangles that lies over it.
//!
//! Triangles that hang together are shown on the plane of the piece. If nothing of them over the piece is farther than the
//! limit, no edge of their common border meets the piece, and one of its points is covered by an odd number of them, then they
//! cover all of it: the degree of a map, modulo 2, is constant off the image of the border. Where this fails, nothing is known.
//! docs/design/certificate.md, "Sheets".

// Three axes run through several arrays side by side; an index shows that best.
#![allow(clippy::needless_range_loop)]

use super::bound::{ROUNDING, UNDERFLOW};
use super::piece::Piece;
use crate::tree::Tree;
use crate::triangle::{Vector, rotate, rotation};
use robust::{Coord, orient2d};
use stonecut_mesh::Mesh;
use stonecut_mesh::vec3::{cross, dot, length_sq, scale, sub};

/// No triangle, or several, across an edge.
const NONE: u32 = u32::MAX;

/// Triangles that are looked at for one piece.
const MOST: usize = 1 << 14;

/// Shares beyond this have lost too many digits.
const FAR: f64 = 1e5;

/// Share of the limit that rounding may take where heights are cut off.
const IN_HAND: f64 = 1e-9;

/// The point that is counted, in shares of the second and third corner: where edges hardly ever are.
const COUNTED: Coord<f64> = Coord { x: 0.345_771_3, y: 0.318_930_7 };

/// Corners of the piece, in these shares.
const CORNERS: [Coord<f64>; 3] =
    [Coord { x: 0.0, y: 0.0 }, Coord { x: 1.0, y: 0.0 }, Coord { x: 0.0, y: 1.0 }];

/// For each triangle of a tree those across its three edges, the first being that from the first corner to the second.
///
/// Memory: 12 bytes a triangle, 36 while it is built, when the tree has been.
pub(super) struct Neighbours(Vec<[u32; 3]>);

impl Neighbours {
    /// Of the tree over all triangles of a mesh.
    pub fn new(tree: &Tree, mesh: &Mesh) -> Neighbours {
        let slots = 0..tree.len() as u32;
        let corners = |slot: u32| {
            let triangle = tree.id(slot) as usize;
            rotate(mesh.triangles[triangle], rotation(&mesh.corners(triangle)))
        };
        let edges = |slot: u32| {
            let [a, b, c] = corners(slot);
            [[a, b], [b, c], [c, a]].map(|[v, w]| (v.min(w), v.max(w)))
        };
        // Edges by the lesser of their ends; for their number it does not count which corner is the first.
        let mut ends = vec![0u32; mesh.positions.len() + 1];
        for slot in slots.clone() {
            let [a, b, c] = mesh.triangles[tree.id(slot) as usize];
            for low in [a.min(b), b.min(c), c.min(a)] {
                ends[low as usize] += 1;
            }
        }
        let mut sum = 0;
        for end in &mut ends {
            sum += *end;
            *end = sum;
        }
        let mut list = vec![(0u32, 0u32, 0u8); sum as usize];
        for slot in slots {
            for (k, (low, high)) in edges(slot).into_iter().enumerate() {
                ends[low as usize] -= 1;
                list[ends[low as usize] as usize] = (high, slot, k as u8);
            }
        }
        let mut across = vec![[NONE; 3]; tree.len()];
        for pair in ends.windows(2) {
            let some = &mut list[pair[0] as usize..pair[1] as usize];
            some.sort_unstable();
            for run in some.chunk_by(|a, b| a.0 == b.0) {
                if let [(_, s, i), (_, t, k)] = *run {
                    across[s as usize][usize::from(i)] = t;
                    across[t as usize][usize::from(k)] = s;
                }
            }
        }
        Neighbours(across)
    }
}

/// A corner of a target triangle, shown on the plane of the piece.
#[derive(Clone, Copy)]
struct Shown {
    /// Shares of the second and third corner of the piece: exactly these, whatever the projection should have been.
    at: Coord<f64>,
    /// Share of the first one, rounded.
    first: f64,
    /// Height along the normal of the piece, of the way from there to the corner.
    height: f64,
    /// The rest of that way, and bounds on all rounding.
    off: f64,
    /// A bit for each side of the piece that it is surely beyond.
    beyond: u8,
}

impl Shown {
    fn share(&self, side: usize) -> f64 {
        [self.first, self.at.x, self.at.y][side]
    }
}

/// The plane of a piece, or of a target triangle.
pub(super) struct Frame {
    corners: [Vector; 3],
    edges: [Vector; 2],
    shares: [Vector; 2],
    up: Vector,
}

impl Frame {
    /// `None` where rounding would leave too little.
    pub(super) fn new(corners: &[Vector; 3]) -> Option<Frame> {
        let [p, q, r] = *corners;
        let (a, b) = (sub(q, p), sub(r, p));
        let normal = cross(a, b);
        let area_sq = length_sq(normal);
        if !(area_sq > 1e-280 && area_sq < 1e280) {
            return None;
        }
        Some(Frame {
            corners: *corners,
            edges: [a, b],
            shares: [
                scale(cross(b, normal), 1.0 / area_sq),
                scale(cross(normal, a), 1.0 / area_sq),
            ],
            up: scale(normal, 1.0 / area_sq.sqrt()),
        })
    }

    /// True if a point is shown at a place of the triangle that is within `limit` of it; false says nothing.
    #[inline]
    pub(super) fn is_below(&self, point: Vector, limit: f64) -> bool {
        let shown = self.show(point);
        // A sum that is not less than 1 is rounded to no less.
        shown.at.x >= 0.0
            && shown.at.y >= 0.0
            && shown.at.x + shown.at.y < 1.0
            && shown.height.abs() + shown.off <= limit
    }

    #[inline]
    fn show(&self, point: Vector) -> Shown {
        let from = sub(point, self.corners[0]);
        let at = Coord { x: dot(from, self.shares[0]), y: dot(from, self.shares[1]) };
        let (mut way, mut size) = ([0.0; 3], 0.0);
        for k in 0..3 {
            let (along, across) = (at.x * self.edges[0][k], at.y * self.edges[1][k]);
            way[k] = from[k] - along - across;
            size += from[k].abs() + along.abs() + across.abs();
        }
        let height = dot(way, self.up);
        let rest: f64 = (0..3).map(|k| (way[k] - height * self.up[k]).abs()).sum();
        let sum = at.x + at.y;
        // A sum that is rounded to more than 1 is more than 1.
        let beyond = u8::from(sum > 1.0) | u8::from(at.x < 0.0) << 1 | u8::from(at.y < 0.0) << 2;
        Shown { at, first: 1.0 - sum, height, off: rest + (ROUNDING * size + UNDERFLOW), beyond }
    }
}

/// Sheets over pieces; knows one tree and who is beside whom in it.
pub(super) struct Sheets<'a> {
    tree: &'a Tree,
    neighbours: &'a Neighbours,
    /// A bit for each triangle of the tree that the present sheet has.
    has: Vec<u64>,
    sheet: Vec<SheetTriangle>,
    /// The corners of those that were looked at, in the order of `sheet`.
    shown: Vec<[Shown; 3]>,
}

/// A triangle of a sheet: its place in the tree, and the edge over which it was taken, as a place in `sheet` and a side there.
#[derive(Clone, Copy)]
struct SheetTriangle {
    slot: u32,
    from: u32,
    side: u8,
}

impl<'a> Sheets<'a> {
    pub fn new(tree: &'a Tree, neighbours: &'a Neighbours) -> Self {
        let has = vec![0; tree.len().div_ceil(64)];
        Sheets { tree, neighbours, has, sheet: Vec::new(), shown: Vec::new() }
    }

    /// Proves that all of a piece is within `limit` of the sheet that the triangle `seed` belongs to; gives back a triangle that is
    /// over about its middle. `Err` says nothing but the number of triangles that were looked at.
    pub fn prove(&mut self, piece: &Piece, seed: u32, limit: f64) -> Result<u32, usize> {
        let frame = Frame::new(&piece.corners);
        let proven = frame.and_then(|frame| self.spread(&frame, seed, limit));
        let n = self.sheet.len();
        for taken in self.sheet.drain(..) {
            self.has[taken.slot as usize / 64] = 0;
        }
        self.shown.clear();
        proven.ok_or(n)
    }

    /// Gathers the sheet from its seed.
    fn spread(&mut self, frame: &Frame, seed: u32, limit: f64) -> Option<u32> {
        self.take(SheetTriangle { slot: seed, from: NONE, side: 0 });
        let (mut is_counted, mut over) = (false, seed);
        let mut next = 0;
        while let Some(&taken) = self.sheet.get(next) {
            let (shown, entered) = self.show(frame, taken);
            if shown.iter().any(|p| !(p.at.x.abs() <= FAR && p.at.y.abs() <= FAR)) {
                return None;
            }
            if !is_within(&shown, limit) {
                return None;
            }
            match covers(&shown) {
                Some(false) => {}
                Some(true) => {
                    is_counted = !is_counted;
                    over = taken.slot;
                }
                None => return None,
            }
            self.shown.push(shown);
            for k in 0..3 {
                if k == entered || !meets(&shown[k], &shown[(k + 1) % 3]) {
                    continue;
                }
                let other = self.neighbours.0[taken.slot as usize][k];
                if other == NONE {
                    return None;
                }
                self.take(SheetTriangle { slot: other, from: next as u32, side: k as u8 });
            }
            if self.sheet.len() > MOST {
                return None;
            }
            next += 1;
        }
        is_counted.then_some(over)
    }

    /// Shows the corners of a triangle; those that it has in common with the one it was taken from are known. Also gives back
    /// the side between these, 3 if there is none.
    #[inline]
    fn show(&self, frame: &Frame, taken: SheetTriangle) -> ([Shown; 3], usize) {
        let corners = self.tree.corners(taken.slot);
        let Some(known) = self.shown.get(taken.from as usize) else {
            return ([frame.show(corners[0]), frame.show(corners[1]), frame.show(corners[2])], 3);
        };
        let before = self.tree.corners(self.sheet[taken.from as usize].slot);
        let [i, j] = [usize::from(taken.side), (usize::from(taken.side) + 1) % 3];
        // No closures: they are not inlined here.
        let (mut new, mut n_known) = (0, 0);
        let mut shown = *known;
        for k in 0..3 {
            if corners[k] == before[i] {
                (shown[k], n_known) = (known[i], n_known + 1);
            } else if corners[k] == before[j] {
                (shown[k], n_known) = (known[j], n_known + 1);
            } else {
                (shown[k], new) = (frame.show(corners[k]), k);
            }
        }
        (shown, if n_known == 2 { (new + 1) % 3 } else { 3 })
    }

    fn take(&mut self, taken: SheetTriangle) {
        let slot = taken.slot;
        let (word, bit) = (&mut self.has[slot as usize / 64], 1 << (slot % 64));
        if *word & bit == 0 {
            *word |= bit;
            self.sheet.push(taken);
        }
    }
}

/// True if an edge may meet the piece, its border included; false is certain.
#[inline]
fn meets(p: &Shown, q: &Shown) -> bool {
    if p.beyond & q.beyond != 0 {
        return false;
    }
    if p.beyond == 0 || q.beyond == 0 {
        return true;
    }
    let sides = CORNERS.map(|corner| orient2d(p.at, q.at, corner));
    !(sides.iter().all(|&side| side > 0.0) || sides.iter().all(|&side| side < 0.0))
}

/// True if a triangle covers the point that is counted; `None` if that lies on one of its edges.
#[inline]
fn covers(corners: &[Shown; 3]) -> Option<bool> {
    let is_beside = |of: fn(&Shown) -> f64, at: f64| {
        corners.iter().all(|p| of(p) < at) || corners.iter().all(|p| of(p) > at)
    };
    if is_beside(|p| p.at.x, COUNTED.x) || is_beside(|p| p.at.y, COUNTED.y) {
        return Some(false);
    }
    let [p, q, r] = corners.map(|p| p.at);
    let sides = [orient2d(p, q, COUNTED), orient2d(q, r, COUNTED), orient2d(r, p, COUNTED)];
    if sides.contains(&0.0) {
        return None;
    }
    Some(sides.iter().all(|&side| side > 0.0) || sides.iter().all(|&side| side < 0.0))
}

/// Proves that what of a triangle lies over the piece is within `limit` of the place it is shown at.
#[inline]
fn is_within(corners: &[Shown; 3], limit: f64) -> bool {
    let off = corners.iter().fold(0f64, |most, p| most.max(p.off));
    let most = (limit - off) * (1.0 - IN_HAND);
    // Not so for NaN.
    if corners.iter().all(|p| p.height.abs() <= most) {
        return true;
    }
    [1.0, -1.0].into_iter().all(|sign| {
        let heights = corners.map(|p| sign * p.height);
        heights.iter().all(|&height| height <= most)
            || (0..3).any(|side| one_side(corners, heights, side, most))
            || (0..3).any(|corner| two_sides(corners, heights, corner, most))
    })
}

/// Proves it by the part of the triangle that is beyond one side of the piece.
///
/// Over the piece all shares are at least 0, so a height is at most what it is with any multiple of a share added; and that is
/// linear, so it is greatest at a corner.
fn one_side(corners: &[Shown; 3], heights: [f64; 3], side: usize, most: f64) -> bool {
    let mut factor = 0f64;
    for i in 0..3 {
        let share = corners[i].share(side);
        if heights[i] > most && share < 0.0 {
            factor = factor.max((heights[i] - most) / -share);
        }
    }
    let mut factors = [0.0; 3];
    factors[side] = factor;
    holds(corners, heights, factors, most)
}

/// The same for two sides, where the piece has a corner over the triangle: such multiples that all three are equal.
fn two_sides(corners: &[Shown; 3], heights: [f64; 3], corner: usize, most: f64) -> bool {
    let sides = [(corner + 1) % 3, (corner + 2) % 3];
    let step = |of: &dyn Fn(usize) -> f64| [of(0) - of(2), of(1) - of(2)];
    let height = step(&|i| heights[i]);
    let [a, b] = sides.map(|side| step(&|i| corners[i].share(side)));
    let det = a[0] * b[1] - a[1] * b[0];
    let mut factors = [0.0; 3];
    factors[sides[0]] = (height[1] * b[0] - height[0] * b[1]) / det;
    factors[sides[1]] = (height[0] * a[1] - height[1] * a[0]) / det;
    factors.iter().all(|&factor| factor >= 0.0 && factor.is_finite())
        && holds(corners, heights, factors, most)
}

/// True if heights with multiples of shares added, rounding included, are at most `most` and what was kept in hand.
fn holds(corners: &[Shown; 3], heights: [f64; 3], factors: [f64; 3], most: f64) -> bool {
    let in_hand = 0.5 * IN_HAND * most;
    (0..3).all(|i| {
        let p = &corners[i];
        let (mut sum, mut size) = (heights[i], heights[i].abs());
        for side in 0..3 {
            let term = factors[side] * p.share(side);
            sum += term;
            size += term.abs();
        }
        // The share of the first corner is rounded where the others are exact.
        size += factors[0] * (1.0 + p.at.x.abs() + p.at.y.abs());
        sum <= most + in_hand && ROUNDING * size <= 0.25 * in_hand
    })
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)] // A test fails by panicking.

    use super::*;

    /// A grid of `n` by `n` squares from -1 to 2, both ways, at the heights given.
    fn grid(n: u32, height: impl Fn(f64, f64) -> f64) -> Mesh {
        let at = |i: u32| 3.0 * f64::from(i) / f64::from(n) - 1.0;
        let place = |v: u32| [at(v % (n + 1)), at(v / (n + 1))];
        let positions =
            (0..(n + 1) * (n + 1)).map(place).map(|[x, y]| [x, y, height(x, y)]).collect();
        let corners = |square: u32| {
            let a = square / n * (n + 1) + square % n;
            [[a, a + 1, a + n + 2], [a, a + n + 2, a + n + 1]]
        };
        Mesh::new(positions, (0..n * n).flat_map(corners).collect())
    }

    fn proves(mesh: &Mesh, limit: f64) -> bool {
        let tree = Tree::build(mesh.triangles.len(), |i| mesh.corners(i));
        let neighbours = Neighbours::new(&tree, mesh);
        let piece = Piece::whole([[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
        let seed = tree.nearest(piece.middle(), crate::tree::Nearest::NONE).slot;
        let mut sheets = Sheets::new(&tree, &neighbours);
        let first = sheets.prove(&piece, seed, limit).is_ok();
        // What one proof leaves behind does not show in the next.
        assert_eq!(sheets.prove(&piece, seed, limit).is_ok(), first);
        first
    }

    #[test]
    fn a_sheet_is_as_near_as_its_highest_place_over_the_piece() {
        for n in [1, 2, 3, 7, 30] {
            let flat = grid(n, |_, _| 0.25);
            assert!(proves(&flat, 0.2501) && !proves(&flat, 0.2499), "{n}");
            let slope = grid(n, |x, y| -0.5 + x + 2.0 * y);
            // From -0.5 at the first corner to 1.5 at the last, though it goes on to 5.5 beside the piece.
            assert!(proves(&slope, 1.5001) && !proves(&slope, 1.4999), "{n}");
            assert!(proves(&grid(n, |x, _| -0.5 + x), 0.5001), "{n}");
        }
    }

    #[test]
    fn holes_count_only_over_the_piece() {
        let holed = |x: f64, y: f64| {
            let mut mesh = grid(30, |_, _| 0.1);
            let corners: Vec<_> = (0..mesh.triangles.len()).map(|i| mesh.corners(i)).collect();
            let is_there = |t: &[Vector; 3]| {
                t.iter().all(|p| (p[0] - x).abs() < 0.11 && (p[1] - y).abs() < 0.11)
            };
            let mut i = 0;
            mesh.triangles.retain(|_| {
                i += 1;
                !is_there(&corners[i - 1])
            });
            assert!(mesh.triangles.len() < corners.len());
            proves(&mesh, 1.0)
        };
        assert!(!holed(0.3, 0.3) && !holed(0.1, 0.8) && !holed(0.0, 0.0) && !holed(0.5, 0.5));
        assert!(holed(0.7, 0.7) && holed(-0.3, 0.5) && holed(1.3, -0.2));
    }

    #[test]
    fn what_is_covered_twice_or_torn_is_not_proven() {
        // Every triangle twice: no edge has two triangles.
        let mut twice = grid(3, |_, _| 0.1);
        twice.triangles.extend_from_within(..);
        assert!(!proves(&twice, 1.0));
        // Folded along x = 1.5, so that it lies over the piece twice, above and below, and hangs together.
        let folded = |x: f64, y: f64| {
            let mut mesh = grid(6, |_, _| 0.1);
            for p in &mut mesh.positions {
                if p[0] > x {
                    *p = [2.0 * x - p[0], p[1], -0.1 - y];
                }
            }
            proves(&mesh, 1.0)
        };
        assert!(!folded(0.5, 0.0));
    }
}
