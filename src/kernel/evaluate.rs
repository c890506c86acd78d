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
pub(crate) const REGULARISATION: f32 = 3e-5;
/// Cost of an edge in a plane, as a share of trace times half length squared: prefers short edges where
/// nothing else tells them apart. Rounding alone is worth 1e-7.
pub(crate) const LENGTH_COST: f32 = 1e-6;
/// The volume is kept where |G| is at least this share of the trace; at most it is 2.
pub(crate) const VOLUME_SHARE: f32 = 0.2;
/// The survivor lies at most this many half lengths from the midpoint.
pub(crate) const MAX_REACH: f32 = 4.0;

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
pub(crate) fn dot3<L: Lanes>(a: [L; 3], b: [L; 3]) -> L {
    a[0].times(b[0]).plus(a[1].times(b[1])).plus(a[2].times(b[2]))
}

#[inline(always)]
pub(crate) fn sub3<L: Lanes>(a: [L; 3], b: [L; 3]) -> [L; 3] {
    [a[0].minus(b[0]), a[1].minus(b[1]), a[2].minus(b[2])]
}

#[inline(always)]
pub(crate) fn add3<L: Lanes>(a: [L; 3], b: [L; 3]) -> [L; 3] {
    [a[0].plus(b[0]), a[1].plus(b[1]), a[2].plus(b[2])]
}

#[inline(always)]
pub(crate) fn cross3<L: Lanes>(a: [L; 3], b: [L; 3]) -> [L; 3] {
    [
        a[1].times(b[2]).minus(a[2].times(b[1])),
        a[2].times(b[0]).minus(a[0].times(b[2])),
        a[0].times(b[1]).minus(a[1].times(b[0])),
    ]
}

#[inline(always)]
pub(crate) fn scale3<L: Lanes>(a: [L; 3], s: L) -> [L; 3] {
    [a[0].times(s), a[1].times(s), a[2].times(s)]
}

#[inline(always)]
pub(crate) fn first6<L: Lanes>(q: [L; 9]) -> [L; 6] {
    [q[0], q[1], q[2], q[3], q[4], q[5]]
}

#[inline(always)]
fn last3<L: Lanes>(q: [L; 9]) -> [L; 3] {
    [q[6], q[7], q[8]]
}

#[inline(always)]
pub(crate) fn sub6<L: Lanes>(a: [L; 6], b: [L; 6]) -> [L; 6] {
    let (low, high) = (sub3([a[0], a[1], a[2]], [b[0], b[1], b[2]]), [a[3], a[4], a[5]]);
    let high = sub3(high, [b[3], b[4], b[5]]);
    [low[0], low[1], low[2], high[0], high[1], high[2]]
}

#[inline(always)]
pub(crate) fn add6<L: Lanes>(a: [L; 6], b: [L; 6]) -> [L; 6] {
    let (low, high) = (add3([a[0], a[1], a[2]], [b[0], b[1], b[2]]), [a[3], a[4], a[5]]);
    let high = add3(high, [b[3], b[4], b[5]]);
    [low[0], low[1], low[2], high[0], high[1], high[2]]
}

#[inline(always)]
pub(crate) fn store3<L: Lanes>(a: [L; 3]) -> [[f32; 8]; 3] {
    [a[0].store(), a[1].store(), a[2].store()]
}

/// Symmetric matrix (xx, xy, xz, yy, yz, zz) times vector.
#[inline(always)]
pub(crate) fn product<L: Lanes>(m: [L; 6], x: [L; 3]) -> [L; 3] {
    [dot3([m[0], m[1], m[2]], x), dot3([m[1], m[3], m[4]], x), dot3([m[2], m[4], m[5]], x)]
}

#[inline(always)]
pub(crate) fn select3<L: Lanes>(a: L, b: L, x: [L; 3], y: [L; 3]) -> [L; 3] {
    [L::lt_select(a, b, x[0], y[0]), L::lt_select(a, b, x[1], y[1]), L::lt_select(a, b, x[2], y[2])]
}

/// L D L^T of a symmetric matrix whose pivots are held above `lift`.
pub(crate) struct Factors<L> {
    l10: L,
    l20: L,
    l21: L,
    inverse: [L; 3],
}

impl<L: Lanes> Factors<L> {
    #[inline(always)]
    pub(crate) fn new(m: [L; 6], lift: L) -> Self {
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
    pub(crate) fn solve(&self, r: [L; 3]) -> [L; 3] {
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
        let half = scale3(edge, L::splat(0.5));
        let (q0, q1) = (L::quadrics(self.v0), L::quadrics(self.v1));
        let (a0, a1) = (first6(q0), first6(q1));
        let (sum, difference) = (add6(a0, a1), sub6(a1, a0));
        let trace = sum[0].plus(sum[3]).plus(sum[5]);
        let lift = trace.times(L::splat(REGULARISATION)).plus(L::splat(1e-30));
        let factors = Factors::new(sum, lift);
        let free = factors.solve(product(difference, half));
        // Volume: G . d = (G1 - G0) . h, reached along the metric of the quadric.
        let (g0, g1) = ([q0[6], q0[7], q0[8]], [q1[6], q1[7], q1[8]]);
        let g = add3(g0, g1);
        let wanted = dot3(sub3(g1, g0), half);
        let way = factors.solve(g);
        let per_step = dot3(g, way);
        let step = wanted.minus(dot3(g, free)).over(per_step);
        let kept = add3(free, scale3(way, step));
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
        Evaluated { cost: cost.store(), place: store3(place) }
    }
}

/// What a change of some triangles does to the quadrics of their corners, a row a triangle.
#[derive(Clone)]
pub(crate) struct Rows {
    /// A (6 numbers) and the first two of G.
    pub(crate) first8: [[f32; 8]; 8],
    /// The third of G.
    pub(crate) last: [f32; 8],
}

impl Rows {
    pub(crate) const ZERO: Rows = Rows { first8: [[0.0; 8]; 8], last: [0.0; 8] };

    #[inline(always)]
    fn set<L: Lanes>(&mut self, x: [L; 9]) {
        L::store_rows([x[0], x[1], x[2], x[3], x[4], x[5], x[6], x[7]], &mut self.first8);
        self.last = x[8].store();
    }

    /// Adds one row to a quadric.
    #[inline(always)]
    pub(crate) fn add_to(&self, row: usize, quadric: &mut [f32; 9]) {
        let (head, tail) = quadric.split_at_mut(8);
        if let Ok(head) = <&mut [f32; 8]>::try_from(head) {
            let row = &self.first8[row];
            *head = std::array::from_fn(|i| head[i] + row[i]);
        }
        tail[0] += self.last[row];
    }
}

/// Eight triangles, whose quadrics go to `out`.
pub(crate) struct Triangles<'a> {
    pub(crate) a: [&'a Vertex; 8],
    pub(crate) b: [&'a Vertex; 8],
    pub(crate) c: [&'a Vertex; 8],
    pub(crate) scale: f64,
    pub(crate) out: &'a mut Rows,
}

impl Job for Triangles<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let base: [&[f64; 3]; 8] = std::array::from_fn(|i| &self.a[i].position);
        let b = L::relative(self.b, base, self.scale);
        let c = L::relative(self.c, base, self.scale);
        let (quadric, _) = contribution(cross3(b, c));
        self.out.set(quadric);
    }
}

/// Eight triangles around an edge: the corner that moves, and the other two.
pub(crate) struct RingPart<'a> {
    pub(crate) b: [&'a Vertex; 8],
    pub(crate) c: [&'a Vertex; 8],
    /// Where the moving corner was: -1 at `-half`, 1 at `half`.
    pub(crate) side: &'a [f32; 8],
    /// From `centre` to `v1`, scaled.
    pub(crate) half: [f32; 3],
    /// The moving corner after, relative to `centre`, scaled.
    pub(crate) after: [f32; 3],
    pub(crate) centre: &'a [f64; 3],
    pub(crate) scale: f64,
    /// Lanes from here on vanish in the collapse; from `n_used` on they are empty.
    pub(crate) n_kept: f32,
    pub(crate) n_used: f32,
    pub(crate) out: &'a mut RingGeometry,
}

/// What `RingPart` finds.
#[derive(Clone)]
pub(crate) struct RingGeometry {
    /// Quadric after minus before.
    pub(crate) change: Rows,
    /// Quadrics of all lanes after, summed up.
    pub(crate) total: [f32; 9],
    /// Least cosine by which a normal turns; 1 where there was no normal before.
    pub(crate) cosine: f32,
    /// Least of double area over the sum of squared edges, before and after; 0.289 at best.
    pub(crate) shape_before: f32,
    pub(crate) shape_after: f32,
}

impl RingGeometry {
    pub(crate) const ZERO: RingGeometry = RingGeometry {
        change: Rows::ZERO,
        total: [0.0; 9],
        cosine: 1.0,
        shape_before: 1.0,
        shape_after: 1.0,
    };
}

#[inline(always)]
fn least<L: Lanes>(x: L) -> f32 {
    let x = x.store();
    let (a, b) = (x[0].min(x[1]).min(x[2].min(x[3])), x[4].min(x[5]).min(x[6].min(x[7])));
    a.min(b)
}

#[inline(always)]
fn total<L: Lanes>(x: L) -> f32 {
    let x = x.store();
    ((x[0] + x[4]) + (x[1] + x[5])) + ((x[2] + x[6]) + (x[3] + x[7]))
}

#[inline(always)]
fn masked9<L: Lanes>(at: L, end: L, x: [L; 9]) -> [L; 9] {
    let z = L::splat(0.0);
    [
        L::lt_select(at, end, x[0], z),
        L::lt_select(at, end, x[1], z),
        L::lt_select(at, end, x[2], z),
        L::lt_select(at, end, x[3], z),
        L::lt_select(at, end, x[4], z),
        L::lt_select(at, end, x[5], z),
        L::lt_select(at, end, x[6], z),
        L::lt_select(at, end, x[7], z),
        L::lt_select(at, end, x[8], z),
    ]
}

/// n n^T / (2 |n|) and n itself, and |n|.
#[inline(always)]
fn contribution<L: Lanes>(n: [L; 3]) -> ([L; 9], L) {
    let length = dot3(n, n).root();
    let zero = L::splat(0.0);
    let weight = L::lt_select(zero, length, L::splat(0.5).over(length), zero);
    let w = scale3(n, weight);
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

/// Quadric, double area and shape of the triangle over `b`, `c` and `corner`.
#[inline(always)]
fn side<L: Lanes>(b: [L; 3], c: [L; 3], across_sq: L, corner: [L; 3]) -> ([L; 9], L, L) {
    let (to_b, to_c) = (sub3(b, corner), sub3(c, corner));
    let (quadric, length) = contribution(cross3(to_b, to_c));
    let edges_sq = dot3(to_b, to_b).plus(dot3(to_c, to_c)).plus(across_sq);
    (quadric, length, length.over(edges_sq))
}

impl Job for RingPart<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let b = L::relative(self.b, [self.centre; 8], self.scale);
        let c = L::relative(self.c, [self.centre; 8], self.scale);
        let across = sub3(c, b);
        let across_sq = dot3(across, across);
        let half = [L::splat(self.half[0]), L::splat(self.half[1]), L::splat(self.half[2])];
        let old = scale3(half, L::load(self.side));
        let (before, length0, shape0) = side(b, c, across_sq, old);
        let [x, y, z] = self.after;
        let new = [L::splat(x), L::splat(y), L::splat(z)];
        let (after, length1, shape1) = side(b, c, across_sq, new);
        let turned = dot3([before[6], before[7], before[8]], [after[6], after[7], after[8]]);
        let lengths = length0.times(length1);
        let (one, zero) = (L::splat(1.0), L::splat(0.0));
        // A normal that vanishes is as bad as one that turns over.
        let cosine = L::lt_select(zero, lengths, turned.over(lengths), zero);
        let cosine = L::lt_select(zero, length0, cosine, one);
        let lane = L::load(&[0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]);
        let (kept, used) = (L::splat(self.n_kept), L::splat(self.n_used));
        self.out.cosine = least(L::lt_select(lane, kept, cosine, one));
        self.out.shape_before = least(L::lt_select(lane, kept, shape0, one));
        self.out.shape_after = least(L::lt_select(lane, kept, shape1, one));
        let before = masked9(lane, used, before);
        let after = masked9(lane, kept, after);
        let (low, high) = (sub6(first6(after), first6(before)), sub3(last3(after), last3(before)));
        self.out
            .change
            .set([low[0], low[1], low[2], low[3], low[4], low[5], high[0], high[1], high[2]]);
        self.out.total = [
            total(after[0]),
            total(after[1]),
            total(after[2]),
            total(after[3]),
            total(after[4]),
            total(after[5]),
            total(after[6]),
            total(after[7]),
            total(after[8]),
        ];
    }
}
