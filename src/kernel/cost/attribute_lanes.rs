//! The attribute part of eight edges, or of eight triangles, at once.
//!
//! An attribute is a linear function over each triangle: gradient g, area A. All functions around a vertex
//! agree in the vertex itself, so its quadric relative to the vertex is three sums: M = sum of A g g^T over
//! all attributes together (6 numbers), L = sum of A g for each attribute (3 numbers), and the sum of A,
//! which is the trace of the geometric quadric. Attributes are lengths here: scaled by their weights.
//! Decides nothing about legality.
//!
//! Source: the gradient form of Hoppe 1999, memoryless as the geometric part (docs/algorithm.md, section 7).

use crate::cost::quadric::{
    Evaluated, Factors, REGULARISATION, Volume, add3, add6, cost, cross3, dot3, first6, last3,
    positions, product, scale3, store3, sub3, sub6,
};
use crate::simd::{Job, Lanes};
use crate::vertex::Vertex;

/// Squared double area over the squared sum of squared edges below which a gradient is damped: a needle's
/// gradient has no bounds. That of an aspect of about 30.
pub(crate) const LEAST_SHAPE_SQ: f32 = 2.5e-4;

/// Eight numbers of each of eight vertices or triangles, `K` times.
pub(crate) type Rows<const K: usize> = [[[f32; 8]; 8]; K];

/// Attribute numbers a vertex: M and an L for each attribute.
pub(crate) const fn numbers(n_attributes: usize) -> usize {
    6 + 3 * n_attributes
}

/// Eight edges, with the attributes of their ends. `K` eights of numbers a vertex.
pub(crate) struct AttributeEdges<'a, const K: usize> {
    pub(crate) v0: [&'a Vertex; 8],
    pub(crate) v1: [&'a Vertex; 8],
    pub(crate) numbers0: [&'a [[f32; 8]; K]; 8],
    pub(crate) numbers1: [&'a [[f32; 8]; K]; 8],
    /// For each attribute half of what it is more at `v1` than at `v0`.
    pub(crate) half_step: &'a [[f32; 8]],
    /// 1 where `v1` may not move, else 0.
    pub(crate) fixed: [f32; 8],
    pub(crate) scale: f64,
}

#[inline(always)]
fn outer_plus<L: Lanes>(m: [L; 6], a: [L; 3], b: [L; 3]) -> [L; 6] {
    [
        m[0].plus(a[0].times(b[0])),
        m[1].plus(a[0].times(b[1])),
        m[2].plus(a[0].times(b[2])),
        m[3].plus(a[1].times(b[1])),
        m[4].plus(a[1].times(b[2])),
        m[5].plus(a[2].times(b[2])),
    ]
}

#[inline(always)]
fn load_rows<L: Lanes, const K: usize>(rows: [&[[f32; 8]; K]; 8], out: &mut [[L; 8]; K]) {
    for (k, out) in out.iter_mut().enumerate() {
        *out = L::columns([
            &rows[0][k],
            &rows[1][k],
            &rows[2][k],
            &rows[3][k],
            &rows[4][k],
            &rows[5][k],
            &rows[6][k],
            &rows[7][k],
        ]);
    }
}

#[inline(always)]
fn first_order<L: Lanes, const K: usize>(rows: &[[L; 8]; K], attribute: usize) -> [L; 3] {
    let at = 6 + 3 * attribute;
    [rows[at / 8][at % 8], rows[(at + 1) / 8][(at + 1) % 8], rows[(at + 2) / 8][(at + 2) % 8]]
}

#[inline(always)]
fn second_order<L: Lanes, const K: usize>(rows: &[[L; 8]; K]) -> [L; 6] {
    let r = &rows[0];
    [r[0], r[1], r[2], r[3], r[4], r[5]]
}

impl<const K: usize> Job for AttributeEdges<'_, K> {
    type Output = Evaluated;

    #[inline(always)]
    fn run<L: Lanes>(self) -> Evaluated {
        let base = positions(self.v0);
        let zero = L::splat(0.0);
        let edge = L::relative(self.v1, base, self.scale);
        let half = scale3(edge, L::splat(0.5));
        let (q0, q1) = (L::quadrics(self.v0), L::quadrics(self.v1));
        let (mut rows0, mut rows1) = ([[zero; 8]; K], [[zero; 8]; K]);
        load_rows(self.numbers0, &mut rows0);
        load_rows(self.numbers1, &mut rows1);
        let (a0, a1) = (first6(q0), first6(q1));
        let (area0, area1) = (a0[0].plus(a0[3]).plus(a0[5]), a1[0].plus(a1[3]).plus(a1[5]));
        let area = area0.plus(area1);
        let per_area = L::splat(1.0).over(area.plus(L::splat(1e-30)));
        let (a0, a1) = (add6(a0, second_order(&rows0)), add6(a1, second_order(&rows1)));
        let mut sum = add6(a0, a1);
        let trace = sum[0].plus(sum[3]).plus(sum[5]);
        let mut right = product(sub6(a1, a0), half);
        // Each attribute's own best value is put in for it; what is left depends on the place alone.
        for (j, step) in self.half_step.iter().enumerate() {
            let (l0, l1) = (first_order(&rows0, j), first_order(&rows1, j));
            let (l, difference, step) = (add3(l0, l1), sub3(l0, l1), L::load(step));
            let start = dot3(difference, half).plus(area1.minus(area0).times(step));
            let share = scale3(l, per_area);
            right = add3(right, add3(scale3(difference, step), scale3(share, start)));
            sum = sub6(sum, outer_plus([zero; 6], share, l));
        }
        let lift = trace.times(L::splat(REGULARISATION)).plus(L::splat(1e-30));
        let factors = Factors::new(sum, lift);
        let free = factors.solve(right);
        let fixed = L::load(&self.fixed);
        let volume = Volume { g0: last3(q0), g1: last3(q1), trace: area };
        let place = volume.place(&factors, free, half, fixed);
        let (from0, from1) = (add3(place, half), sub3(place, half));
        let mut error = dot3(from0, product(a0, from0)).plus(dot3(from1, product(a1, from1)));
        for (j, step) in self.half_step.iter().enumerate() {
            let (l0, l1) = (first_order(&rows0, j), first_order(&rows1, j));
            let step = L::load(step);
            let (x0, x1) = (dot3(l0, from0), dot3(l1, from1));
            let best = x0.plus(x1).plus(area1.minus(area0).times(step)).times(per_area);
            let value = L::lt_select(zero, fixed, step, best);
            let (r0, r1) = (step.plus(value), step.minus(value));
            let two = L::splat(2.0);
            error = error
                .plus(r0.times(area0.times(r0).minus(two.times(x0))))
                .plus(r1.times(area1.times(r1).plus(two.times(x1))));
        }
        Evaluated { cost: cost(error, area, half).store(), place: store3(place) }
    }
}

/// Adds what triangles add to the sums of their corners: `corner` relative to `b` and `c`, and for each
/// attribute its values relative to the same origin.
#[inline(always)]
fn triangle_numbers<L: Lanes, const K: usize>(
    (b, c): ([L; 3], [L; 3]),
    steps: impl Iterator<Item = (L, L)>,
) -> [[L; 8]; K] {
    let zero = L::splat(0.0);
    let n = cross3(b, c);
    let length_sq = dot3(n, n);
    let area = length_sq.root().times(L::splat(0.5));
    let across = sub3(c, b);
    let edges_sq = dot3(b, b).plus(dot3(c, c)).plus(dot3(across, across));
    let least = edges_sq.times(edges_sq).times(L::splat(LEAST_SHAPE_SQ));
    let inverse = L::splat(1.0).over(length_sq.greater(least).plus(L::splat(1e-30)));
    // g = to_b * (step to b) + to_c * (step to c).
    let to_b = scale3(cross3(c, n), inverse);
    let to_c = scale3(cross3(n, b), inverse);
    let mut numbers = [[zero; 8]; K];
    let mut second = [zero; 6];
    let mut at = 6;
    for (step_b, step_c) in steps {
        let g = add3(scale3(to_b, step_b), scale3(to_c, step_c));
        let l = scale3(g, area);
        second = outer_plus(second, g, l);
        for x in l {
            numbers[at / 8][at % 8] = x;
            at += 1;
        }
    }
    numbers[0][0] = second[0];
    numbers[0][1] = second[1];
    numbers[0][2] = second[2];
    numbers[0][3] = second[3];
    numbers[0][4] = second[4];
    numbers[0][5] = second[5];
    numbers
}

/// Eight triangles: what each adds to its corners.
pub(crate) struct AttributeTriangles<'a, const K: usize> {
    pub(crate) a: [&'a Vertex; 8],
    pub(crate) b: [&'a Vertex; 8],
    pub(crate) c: [&'a Vertex; 8],
    /// For each attribute its values at the corners.
    pub(crate) values: &'a [[[f32; 8]; 3]],
    pub(crate) scale: f64,
    /// A row a triangle.
    pub(crate) out: &'a mut Rows<K>,
}

impl<const K: usize> Job for AttributeTriangles<'_, K> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let base = positions(self.a);
        let b = L::relative(self.b, base, self.scale);
        let c = L::relative(self.c, base, self.scale);
        let steps = self.values.iter().map(|[a, b, c]| {
            let a = L::load(a);
            (L::load(b).minus(a), L::load(c).minus(a))
        });
        let numbers: [[L; 8]; K] = triangle_numbers((b, c), steps);
        for (columns, rows) in numbers.into_iter().zip(self.out) {
            L::store_rows(columns, rows);
        }
    }
}

/// Eight triangles around an edge whose moving corner goes from its old place to the survivor's.
pub(crate) struct AttributeRing<'a, const K: usize> {
    pub(crate) b: [&'a Vertex; 8],
    pub(crate) c: [&'a Vertex; 8],
    /// For each attribute its values at `b` and `c`, relative to the middle of the edge's.
    pub(crate) values: &'a [[[f32; 8]; 2]],
    /// For each attribute half its step from `v0` to `v1`, and the survivor's value.
    pub(crate) corner: &'a [[f32; 2]],
    /// From `centre` to `v1`, scaled.
    pub(crate) half: [f32; 3],
    /// The moving corner after, relative to `centre`, scaled.
    pub(crate) place: [f32; 3],
    pub(crate) centre: &'a [f64; 3],
    pub(crate) scale: f64,
    /// The moving corner was `v0` in this many lanes, then `v1`.
    pub(crate) n0: f32,
    /// Lanes from here on vanish in the collapse; from `n_used` on they are empty.
    pub(crate) n_kept: f32,
    pub(crate) n_used: f32,
    /// Numbers after minus before, a row a triangle.
    pub(crate) change: &'a mut Rows<K>,
    /// Numbers after are added here, one row a lane.
    pub(crate) after: &'a mut Rows<K>,
}

impl<const K: usize> Job for AttributeRing<'_, K> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let b = L::relative(self.b, [self.centre; 8], self.scale);
        let c = L::relative(self.c, [self.centre; 8], self.scale);
        let lane = L::load(&[0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]);
        let side = L::lt_select(lane, L::splat(self.n0), L::splat(-1.0), L::splat(1.0));
        let [hx, hy, hz] = self.half;
        let old = scale3([L::splat(hx), L::splat(hy), L::splat(hz)], side);
        let steps = self.values.iter().zip(self.corner).map(|([b, c], [half, _])| {
            let corner = L::splat(*half).times(side);
            (L::load(b).minus(corner), L::load(c).minus(corner))
        });
        let before: [[L; 8]; K] = triangle_numbers((sub3(b, old), sub3(c, old)), steps);
        let [x, y, z] = self.place;
        let new = [L::splat(x), L::splat(y), L::splat(z)];
        let steps = self.values.iter().zip(self.corner).map(|([b, c], [_, value])| {
            let corner = L::splat(*value);
            (L::load(b).minus(corner), L::load(c).minus(corner))
        });
        let after: [[L; 8]; K] = triangle_numbers((sub3(b, new), sub3(c, new)), steps);
        let (kept, used) = (L::splat(self.n_kept), L::splat(self.n_used));
        let zero = L::splat(0.0);
        for k in 0..K {
            let mut change = [zero; 8];
            for i in 0..8 {
                let new = L::lt_select(lane, kept, after[k][i], zero);
                let old = L::lt_select(lane, used, before[k][i], zero);
                change[i] = new.minus(old);
                let sum = &mut self.after[k][i];
                *sum = L::load(sum).plus(new).store();
            }
            L::store_rows(change, &mut self.change[k]);
        }
    }
}
