//! The geometry of eight edges, or of eight triangles of a ring, at once.
//!
//! Everything is relative to the midpoint of the edge and in scaled units (`Surface::scale`), in f32.
//! The quadric of a vertex is that of its current triangles: A = sum of n n^T / (2 |n|), n the cross
//! product, and G = sum of n. All planes pass through the vertex, so there is nothing else to store.
//! Decides nothing about legality.
//!
//! Source: memoryless quadrics after Hoppe 1999, volume constraint after Lindstrom & Turk 1998
//! (docs/references.md).

use super::lanes::{Job, Lanes};
use super::surface::Vertex;

/// Share of the trace added to the diagonal when the best position is solved for; 1e-2 costs error,
/// 1e-4 to 1e-6 are alike.
const REGULARISATION: f32 = 3e-5;
/// Cost of an edge in a plane, as a share of trace times half length squared: prefers short edges where
/// nothing else tells them apart. Rounding alone is worth 1e-7.
const LENGTH_COST: f32 = 1e-6;
/// The volume is kept where |G| is at least this share of the trace; at most it is 2.
const VOLUME_SHARE: f32 = 0.2;
/// Two of twelve triangles around an edge of even valences are in both rings, so counted twice in G.
const SHARED_NORMALS: f32 = 5.0 / 6.0;
/// The survivor lies at most this many half lengths from the midpoint.
const MAX_REACH: f32 = 4.0;

/// What `Edges` finds: cost and place of the survivor, relative to the midpoint, for each edge.
pub(crate) struct Evaluated {
    pub(crate) cost: [f32; 8],
    pub(crate) place: [[f32; 8]; 3],
}

/// Eight edges from `v0` to `v1`.
pub(crate) struct Edges<'a> {
    pub(crate) v0: [&'a Vertex; 8],
    pub(crate) v1: [&'a Vertex; 8],
    /// 1 where `v1` may not move, else 0.
    pub(crate) fixed: [f32; 8],
    pub(crate) scale: f64,
}

#[inline(always)]
fn dot3<L: Lanes>(a: [L; 3], b: [L; 3]) -> L {
    a[0].times(b[0]).plus(a[1].times(b[1])).plus(a[2].times(b[2]))
}

#[inline(always)]
fn sub3<L: Lanes>(a: [L; 3], b: [L; 3]) -> [L; 3] {
    [a[0].minus(b[0]), a[1].minus(b[1]), a[2].minus(b[2])]
}

#[inline(always)]
fn add3<L: Lanes>(a: [L; 3], b: [L; 3]) -> [L; 3] {
    [a[0].plus(b[0]), a[1].plus(b[1]), a[2].plus(b[2])]
}

#[inline(always)]
fn cross3<L: Lanes>(a: [L; 3], b: [L; 3]) -> [L; 3] {
    [
        a[1].times(b[2]).minus(a[2].times(b[1])),
        a[2].times(b[0]).minus(a[0].times(b[2])),
        a[0].times(b[1]).minus(a[1].times(b[0])),
    ]
}

/// Symmetric matrix (xx, xy, xz, yy, yz, zz) times vector.
#[inline(always)]
fn product<L: Lanes>(m: [L; 6], x: [L; 3]) -> [L; 3] {
    [dot3([m[0], m[1], m[2]], x), dot3([m[1], m[3], m[4]], x), dot3([m[2], m[4], m[5]], x)]
}

#[inline(always)]
fn select3<L: Lanes>(a: L, b: L, x: [L; 3], y: [L; 3]) -> [L; 3] {
    std::array::from_fn(|i| L::lt_select(a, b, x[i], y[i]))
}

/// L D L^T of a symmetric matrix whose pivots are held above `lift`.
struct Factors<L> {
    l10: L,
    l20: L,
    l21: L,
    inverse: [L; 3],
}

impl<L: Lanes> Factors<L> {
    #[inline(always)]
    fn new(m: [L; 6], lift: L) -> Self {
        let one = L::splat(1.0);
        let i0 = one.over(m[0].plus(lift));
        let (l10, l20) = (m[1].times(i0), m[2].times(i0));
        let d1 = m[3].plus(lift).minus(l10.times(m[1])).greater(lift);
        let i1 = one.over(d1);
        let off = m[4].minus(l20.times(m[1]));
        let l21 = off.times(i1);
        let d2 = m[5].plus(lift).minus(l20.times(m[2])).minus(l21.times(off)).greater(lift);
        Factors { l10, l20, l21, inverse: [i0, i1, one.over(d2)] }
    }

    #[inline(always)]
    fn solve(&self, r: [L; 3]) -> [L; 3] {
        let y1 = r[1].minus(self.l10.times(r[0]));
        let y2 = r[2].minus(self.l20.times(r[0])).minus(self.l21.times(y1));
        let z = y2.times(self.inverse[2]);
        let y = y1.times(self.inverse[1]).minus(self.l21.times(z));
        let x = r[0].times(self.inverse[0]).minus(self.l10.times(y)).minus(self.l20.times(z));
        [x, y, z]
    }
}

impl Job for Edges<'_> {
    type Output = Evaluated;

    #[inline(always)]
    fn run<L: Lanes>(self) -> Evaluated {
        let base: [&[f64; 3]; 8] = std::array::from_fn(|i| &self.v0[i].position);
        let edge = L::relative(self.v1, base, self.scale);
        let half = edge.map(|x| x.times(L::splat(0.5)));
        let (q0, q1) = (L::quadrics(self.v0), L::quadrics(self.v1));
        let a0: [L; 6] = std::array::from_fn(|i| q0[i]);
        let a1: [L; 6] = std::array::from_fn(|i| q1[i]);
        let sum: [L; 6] = std::array::from_fn(|i| a0[i].plus(a1[i]));
        let difference: [L; 6] = std::array::from_fn(|i| a1[i].minus(a0[i]));
        let trace = sum[0].plus(sum[3]).plus(sum[5]);
        let lift = trace.times(L::splat(REGULARISATION)).plus(L::splat(1e-30));
        let factors = Factors::new(sum, lift);
        let free = factors.solve(product(difference, half));
        // Volume: G . d = (G1 - G0) . h, reached along the metric of the quadric.
        let (g0, g1) = ([q0[6], q0[7], q0[8]], [q1[6], q1[7], q1[8]]);
        let g = add3(g0, g1).map(|x| x.times(L::splat(SHARED_NORMALS)));
        let wanted = dot3(sub3(g1, g0), half);
        let way = factors.solve(g);
        let per_step = dot3(g, way);
        let step = wanted.minus(dot3(g, free)).over(per_step);
        let kept = add3(free, way.map(|x| x.times(step)));
        let flat = trace.times(L::splat(VOLUME_SHARE));
        let kept = select3(flat.times(flat), dot3(g, g), kept, free);
        // What runs away is put on the midpoint; NaN does too.
        let half_sq = dot3(half, half);
        let zero = L::splat(0.0);
        let reach = half_sq.times(L::splat(MAX_REACH * MAX_REACH));
        let place = select3(dot3(free, free), reach, free, [zero; 3]);
        let place = select3(dot3(kept, kept), reach, kept, place);
        let place = select3(zero, L::load(&self.fixed), half, place);
        let (from0, from1) = (add3(place, half), sub3(place, half));
        let error = dot3(from0, product(a0, from0)).plus(dot3(from1, product(a1, from1)));
        let floor = trace.times(half_sq).times(L::splat(LENGTH_COST));
        let cost = error.greater(zero).plus(floor);
        Evaluated { cost: cost.store(), place: place.map(L::store) }
    }
}

/// Eight triangles around an edge: the corner that moves, and the other two.
pub(crate) struct RingPart<'a> {
    pub(crate) b: [&'a Vertex; 8],
    pub(crate) c: [&'a Vertex; 8],
    /// The moving corner before, relative to `centre`, scaled.
    pub(crate) before: [[f32; 8]; 3],
    /// The moving corner after, relative to `centre`, scaled.
    pub(crate) after: [f32; 3],
    pub(crate) centre: &'a [f64; 3],
    pub(crate) scale: f64,
}

/// What `RingPart` finds; lanes that the caller filled up with anything hold nonsense.
#[derive(Clone)]
pub(crate) struct RingGeometry {
    /// A and G of each triangle before, and after.
    pub(crate) before: [[f32; 8]; 9],
    pub(crate) after: [[f32; 8]; 9],
    /// Cosine by which each normal turns; 1 where there was no normal before.
    pub(crate) cosine: [f32; 8],
    /// Double area over the sum of squared edges, before and after; 0.289 at best.
    pub(crate) shape_before: [f32; 8],
    pub(crate) shape_after: [f32; 8],
}

/// n n^T / (2 |n|) and n itself, and |n|.
#[inline(always)]
fn contribution<L: Lanes>(n: [L; 3]) -> ([L; 9], L) {
    let length = dot3(n, n).root();
    let zero = L::splat(0.0);
    let weight = L::lt_select(zero, length, L::splat(0.5).over(length), zero);
    let w = n.map(|x| x.times(weight));
    let a = [
        n[0].times(w[0]),
        n[0].times(w[1]),
        n[0].times(w[2]),
        n[1].times(w[1]),
        n[1].times(w[2]),
        n[2].times(w[2]),
        n[0],
        n[1],
        n[2],
    ];
    (a, length)
}

impl Job for RingPart<'_> {
    type Output = RingGeometry;

    #[inline(always)]
    fn run<L: Lanes>(self) -> RingGeometry {
        let b = L::relative(self.b, [self.centre; 8], self.scale);
        let c = L::relative(self.c, [self.centre; 8], self.scale);
        let across = sub3(c, b);
        let across_sq = dot3(across, across);
        let side = |corner: [L; 3]| {
            let (to_b, to_c) = (sub3(b, corner), sub3(c, corner));
            let (a, length) = contribution(cross3(to_b, to_c));
            let edges_sq = dot3(to_b, to_b).plus(dot3(to_c, to_c)).plus(across_sq);
            (a, length, length.over(edges_sq))
        };
        let (before, length0, shape0) =
            side([L::load(&self.before[0]), L::load(&self.before[1]), L::load(&self.before[2])]);
        let (after, length1, shape1) = side(self.after.map(L::splat));
        let turned = dot3([before[6], before[7], before[8]], [after[6], after[7], after[8]]);
        let lengths = length0.times(length1);
        let one = L::splat(1.0);
        let cosine = L::lt_select(L::splat(0.0), lengths, turned.over(lengths), one);
        RingGeometry {
            before: before.map(L::store),
            after: after.map(L::store),
            cosine: cosine.store(),
            shape_before: shape0.store(),
            shape_after: shape1.store(),
        }
    }
}
