//! The geometry of eight edges, or of eight triangles of a ring, at once.
//!
//! Everything is relative to the midpoint of the edge and in scaled units (`Surface::scale`), in f32.
//! The quadric of a vertex is that of its current triangles: A = sum of n n^T / (2 |n|), n the cross
//! product, and G = sum of n. All planes pass through the vertex, so there is nothing else to store.
//! Decides nothing about legality.
//!
//! Source: quadrics of Garland & Heckbert 1997, memoryless and with the volume constraint of Lindstrom & Turk 1998
//! (docs/references.md; docs/algorithm.md, sections 1 to 3).

use crate::simd::{Job, Lanes};
use crate::vertex::Vertex;

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

/// Triangles that may be without area by a double area of f32, as a share of the squares of two edges.
pub(crate) const MAY_BE_FLAT: f32 = 1e-5;

/// Result of `edges`: cost and place of the survivor, relative to the midpoint, for each edge.
pub(crate) struct Evaluated {
    pub(crate) cost: [f32; 8],
    pub(crate) place: [[f32; 8]; 3],
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
pub(crate) fn last3<L: Lanes>(q: [L; 9]) -> [L; 3] {
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

/// Evaluates eight edges from `v0` to `v1`; `fixed` is 1 where `v1` may not move, else 0.
#[inline(always)]
pub(crate) fn edges<L: Lanes>(
    v0: [&Vertex; 8],
    v1: [&Vertex; 8],
    fixed: &[f32; 8],
    scale: f64,
) -> Evaluated {
    let edge = L::relative(v1, positions(v0), scale);
    let half = scale3(edge, L::splat(0.5));
    let (q0, q1) = (L::quadrics(v0), L::quadrics(v1));
    let (a0, a1) = (first6(q0), first6(q1));
    let (sum, difference) = (add6(a0, a1), sub6(a1, a0));
    let trace = sum[0].plus(sum[3]).plus(sum[5]);
    let lift = trace.times(L::splat(REGULARISATION)).plus(L::splat(1e-30));
    let factors = Factors::new(sum, lift);
    let free = factors.solve(product(difference, half));
    let volume = Volume { g0: last3(q0), g1: last3(q1), trace };
    let place = volume.place(&factors, free, half, L::load(fixed));
    let (from0, from1) = (add3(place, half), sub3(place, half));
    let error = dot3(from0, product(a0, from0)).plus(dot3(from1, product(a1, from1)));
    Evaluated { cost: cost(error, trace, half).store(), place: store3(place) }
}

/// Volume constraint of eight edges: the sums of normals at both ends, and the trace of their quadrics.
pub(crate) struct Volume<L> {
    pub(crate) g0: [L; 3],
    pub(crate) g1: [L; 3],
    pub(crate) trace: L,
}

impl<L: Lanes> Volume<L> {
    /// Moves the survivors from `free`, where they would be best, along the metric of the quadric, until the
    /// volume stays. On the midpoint if that runs away, on `v1`, at `half`, where `fixed` is 1.
    #[inline(always)]
    pub(crate) fn place(
        &self,
        factors: &Factors<L>,
        free: [L; 3],
        half: [L; 3],
        fixed: L,
    ) -> [L; 3] {
        // G . d = (G1 - G0) . h.
        let g = add3(self.g0, self.g1);
        let wanted = dot3(sub3(self.g1, self.g0), half);
        let way = factors.solve(g);
        let per_step = dot3(g, way);
        let step = wanted.minus(dot3(g, free)).over(per_step);
        let kept = add3(free, scale3(way, step));
        let flat = self.trace.times(L::splat(VOLUME_SHARE));
        let kept = select3(flat.times(flat), dot3(g, g), kept, free);
        // NaN runs away, too.
        let zero = L::splat(0.0);
        let reach = dot3(half, half).times(L::splat(MAX_REACH * MAX_REACH));
        let place = select3(dot3(free, free), reach, free, [zero; 3]);
        let place = select3(dot3(kept, kept), reach, kept, place);
        select3(zero, fixed, half, place)
    }
}

/// Costs of collapses: the error, and a little for the length.
#[inline(always)]
pub(crate) fn cost<L: Lanes>(error: L, trace: L, half: [L; 3]) -> L {
    let floor = trace.times(dot3(half, half)).times(L::splat(LENGTH_COST));
    error.greater(L::splat(0.0)).plus(floor)
}

/// Change of the quadrics of the corners of some triangles, a row a triangle.
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

/// Returns the positions of eight vertices.
#[inline(always)]
pub(crate) fn positions(v: [&Vertex; 8]) -> [&[f64; 3]; 8] {
    let [a, b, c, d, e, f, g, h] = v;
    [
        &a.position,
        &b.position,
        &c.position,
        &d.position,
        &e.position,
        &f.position,
        &g.position,
        &h.position,
    ]
}

impl Job for Triangles<'_> {
    /// Bit `i`: triangle `i` may be without area.
    type Output = u32;

    #[inline(always)]
    fn run<L: Lanes>(self) -> u32 {
        let base = positions(self.a);
        let b = L::relative(self.b, base, self.scale);
        let c = L::relative(self.c, base, self.scale);
        let (quadric, double_area) = contribution(cross3(b, c));
        self.out.set(quadric);
        // Written so that what underflows counts.
        let edges_sq = dot3(b, b).plus(dot3(c, c)).times(L::splat(MAY_BE_FLAT));
        !edges_sq.below(double_area) & 0xFF
    }
}

/// Around which edge triangles are measured, and where its survivor goes.
pub(crate) struct Around {
    /// The midpoint.
    pub(crate) centre: [f64; 3],
    pub(crate) scale: f64,
    /// From the midpoint to `v1`, scaled.
    pub(crate) half: [f32; 3],
    /// Place of the survivor, relative to the midpoint, scaled.
    pub(crate) after: [f32; 3],
}

/// Sums and extremes over all triangles of both rings, lane by lane.
pub(crate) struct RingSums<L> {
    /// Quadrics after, summed up.
    total: [L; 9],
    cosine: L,
    shape_before: L,
    shape_after: L,
}

impl<L: Lanes> RingSums<L> {
    #[inline(always)]
    pub(crate) fn new() -> Self {
        let (zero, one) = (L::splat(0.0), L::splat(1.0));
        RingSums { total: [zero; 9], cosine: one, shape_before: one, shape_after: one }
    }

    /// The quadric of the survivor, but for its open edges.
    #[inline(always)]
    pub(crate) fn quadric(&self) -> [f32; 9] {
        let t = &self.total;
        [
            t[0].sum(),
            t[1].sum(),
            t[2].sum(),
            t[3].sum(),
            t[4].sum(),
            t[5].sum(),
            t[6].sum(),
            t[7].sum(),
            t[8].sum(),
        ]
    }

    /// Least cosine by which a normal turns; 1 where there was no normal before.
    #[inline(always)]
    pub(crate) fn cosine(&self) -> f32 {
        self.cosine.least()
    }

    /// Least of double area over the sum of squared edges, before and after; 0.289 at best.
    #[inline(always)]
    pub(crate) fn shapes(&self) -> (f32, f32) {
        (self.shape_before.least(), self.shape_after.least())
    }

    /// Looks at eight triangles of the rings: corners `b` and `c`. The third corner is `v0` in the first `n0`
    /// lanes, then `v1`. Lanes from `n_kept` on vanish in the collapse; an empty lane has `b` in the place
    /// of `c`. `change` becomes the quadrics after minus before.
    #[inline(always)]
    pub(crate) fn look(
        &mut self,
        around: &Around,
        (b, c): ([&Vertex; 8], [&Vertex; 8]),
        (n0, n_kept): (f32, f32),
        change: &mut Rows,
    ) {
        let b = L::relative(b, [&around.centre; 8], around.scale);
        let c = L::relative(c, [&around.centre; 8], around.scale);
        let across = sub3(c, b);
        let across_sq = dot3(across, across);
        let [x, y, z] = around.half;
        let lane = L::load(&[0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]);
        let side = L::lt_select(lane, L::splat(n0), L::splat(-1.0), L::splat(1.0));
        let old = scale3([L::splat(x), L::splat(y), L::splat(z)], side);
        let [x, y, z] = around.after;
        let new = [L::splat(x), L::splat(y), L::splat(z)];
        let (one, zero) = (L::splat(1.0), L::splat(0.0));
        let kept = L::splat(n_kept);
        let (n0, edges_sq0) = corner(b, c, old);
        let (n1, edges_sq1) = corner(b, c, new);
        let n1 = select3(lane, kept, n1, [zero; 3]);
        let (before, length0) = contribution(n0);
        let (after, length1) = contribution(n1);
        let turned = dot3(n0, n1);
        let lengths = length0.times(length1);
        // A normal that vanishes is as bad as one that turns over.
        let cosine = L::lt_select(zero, lengths, turned.over(lengths), zero);
        let cosine = L::lt_select(zero, length0, cosine, one);
        let shape0 = length0.over(edges_sq0.plus(across_sq));
        let shape1 = length1.over(edges_sq1.plus(across_sq));
        self.cosine = self.cosine.lesser(L::lt_select(lane, kept, cosine, one));
        self.shape_before = self.shape_before.lesser(L::lt_select(lane, kept, shape0, one));
        self.shape_after = self.shape_after.lesser(L::lt_select(lane, kept, shape1, one));
        let (low, high) = (sub6(first6(after), first6(before)), sub3(last3(after), last3(before)));
        change.set([low[0], low[1], low[2], low[3], low[4], low[5], high[0], high[1], high[2]]);
        let t = &mut self.total;
        t[0] = t[0].plus(after[0]);
        t[1] = t[1].plus(after[1]);
        t[2] = t[2].plus(after[2]);
        t[3] = t[3].plus(after[3]);
        t[4] = t[4].plus(after[4]);
        t[5] = t[5].plus(after[5]);
        t[6] = t[6].plus(after[6]);
        t[7] = t[7].plus(after[7]);
        t[8] = t[8].plus(after[8]);
    }
}

/// Normal of the triangle over `b`, `c` and `at`, and the squared lengths of its edges at that corner.
#[inline(always)]
fn corner<L: Lanes>(b: [L; 3], c: [L; 3], at: [L; 3]) -> ([L; 3], L) {
    let (to_b, to_c) = (sub3(b, at), sub3(c, at));
    (cross3(to_b, to_c), dot3(to_b, to_b).plus(dot3(to_c, to_c)))
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
