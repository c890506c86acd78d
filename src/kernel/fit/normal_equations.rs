//! The normal equations of the fit: what the samples ask of each triangle, and how far each vertex should go.
//!
//! It moves nothing, and knows no bounds.

use crate::fit::nearest::Foot;
use stonecut_mesh::vec3::{add, dot, scale, sub};

/// A vector in scaled units, relative to the centre of the samples.
pub(super) type V = [f32; 3];

/// Steps of conjugate gradients a sweep. With three the samples are 0.6 % farther off, with six nothing is
/// gained (docs/design/kernel.md, "The fit").
const STEPS: usize = 4;
/// Share of a vertex' trace that is added to its diagonal. 1e-2 costs 9 % of error at 10 % kept, 1e-3 0.5
/// %; 1e-4 gains 0.2 % at most (docs/design/kernel.md, "The fit").
const DAMPING: f32 = 3e-4;

/// Terms of one triangle from its samples: sums of weight times products of barycentric weights (00, 01,
/// 02, 11, 12, 22), and of weight times barycentric weight times height.
#[derive(Clone, Copy)]
pub(super) struct Element {
    mass: [f32; 6],
    pull: [f32; 3],
}

impl Element {
    pub(super) const ZERO: Element = Element { mass: [0.0; 6], pull: [0.0; 3] };

    /// Sums of the weights times products of two barycentric weights, as a full matrix, and those with the height.
    pub(super) fn moments(&self) -> ([[f64; 3]; 3], [f64; 3]) {
        let m = self.mass.map(f64::from);
        let mass = [[m[0], m[1], m[2]], [m[1], m[3], m[4]], [m[2], m[4], m[5]]];
        (mass, self.pull.map(f64::from))
    }

    #[inline]
    pub(super) fn add(&mut self, weight: f32, foot: &Foot) {
        let b = foot.weights;
        let w = b.map(|b| b * weight);
        let products =
            [w[0] * b[0], w[0] * b[1], w[0] * b[2], w[1] * b[1], w[1] * b[2], w[2] * b[2]];
        for (sum, product) in self.mass.iter_mut().zip(products) {
            *sum += product;
        }
        for (sum, w) in self.pull.iter_mut().zip(w) {
            *sum += w * foot.height;
        }
    }
}

/// An element in its place.
pub(super) struct FaceTerm {
    pub(super) corners: [u32; 3],
    pub(super) normal: V,
    pub(super) element: Element,
}

impl FaceTerm {
    /// Change of the weighted squared heights of the samples when the vertices go from one place to another, as far as each
    /// sample keeps its foot.
    pub(super) fn change(&self, from: &[V], to: &[V]) -> f64 {
        let rise = |v: u32| f64::from(dot(self.normal, sub(to[v as usize], from[v as usize])));
        let d = self.corners.map(rise);
        let (mass, pull) = self.element.moments();
        (0..3).map(|k| d[k] * (dot64(mass[k], d) - 2.0 * pull[k])).sum()
    }
}

fn dot64(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Solves for the step of each vertex; those that are not `free` stay.
pub(super) fn solve(terms: &[FaceTerm], free: &[bool]) -> Vec<V> {
    let n = free.len();
    let mut blocks = vec![[0.0f32; 6]; n];
    let mut rest = vec![[0.0f32; 3]; n];
    for term in terms {
        let m = term.normal;
        let outer = [m[0] * m[0], m[0] * m[1], m[0] * m[2], m[1] * m[1], m[1] * m[2], m[2] * m[2]];
        for (k, diagonal) in [0, 3, 5].into_iter().enumerate() {
            let v = term.corners[k] as usize;
            let mass = term.element.mass[diagonal];
            for (sum, x) in blocks[v].iter_mut().zip(outer) {
                *sum += mass * x;
            }
            rest[v] = add(rest[v], scale(m, term.element.pull[k]));
        }
    }
    let mut damping = vec![0.0f32; n];
    for v in 0..n {
        let trace = blocks[v][0] + blocks[v][3] + blocks[v][5];
        let is_used = free[v] && trace > 0.0;
        if !is_used {
            rest[v] = [0.0; 3];
            continue;
        }
        damping[v] = DAMPING * trace;
        for k in [0, 3, 5] {
            blocks[v][k] += damping[v];
        }
        blocks[v] = inverse(blocks[v]);
    }
    conjugate_gradients(terms, &damping, &blocks, rest)
}

/// The inverse of a symmetric positive definite matrix (xx, xy, xz, yy, yz, zz).
fn inverse(m: [f32; 6]) -> [f32; 6] {
    let m = m.map(f64::from);
    let c = [
        m[3] * m[5] - m[4] * m[4],
        m[2] * m[4] - m[1] * m[5],
        m[1] * m[4] - m[2] * m[3],
        m[0] * m[5] - m[2] * m[2],
        m[1] * m[2] - m[0] * m[4],
        m[0] * m[3] - m[1] * m[1],
    ];
    let determinant = m[0] * c[0] + m[1] * c[1] + m[2] * c[2];
    c.map(|c| (c / determinant) as f32)
}

fn product(m: [f32; 6], x: V) -> V {
    [dot([m[0], m[1], m[2]], x), dot([m[1], m[3], m[4]], x), dot([m[2], m[4], m[5]], x)]
}

/// Solves (sum over the terms + damping) x = `rest`, with inverse blocks as preconditioner; where a block is zero,
/// x stays zero. Sums run in f64 and in one order.
fn conjugate_gradients(
    terms: &[FaceTerm],
    damping: &[f32],
    blocks: &[[f32; 6]],
    mut rest: Vec<V>,
) -> Vec<V> {
    let n = rest.len();
    let mut x = vec![[0.0f32; 3]; n];
    let mut image = vec![[0.0f32; 3]; n];
    let mut way: Vec<V> = rest.iter().zip(blocks).map(|(&r, &b)| product(b, r)).collect();
    let total =
        |a: &[V], b: &[V]| -> f64 { a.iter().zip(b).map(|(a, b)| f64::from(dot(*a, *b))).sum() };
    let mut left = total(&rest, &way);
    for step in 0..STEPS {
        for v in 0..n {
            image[v] = scale(way[v], damping[v]);
        }
        for term in terms {
            let h = term.corners.map(|v| dot(term.normal, way[v as usize]));
            let m = &term.element.mass;
            let g = [
                m[0] * h[0] + m[1] * h[1] + m[2] * h[2],
                m[1] * h[0] + m[3] * h[1] + m[4] * h[2],
                m[2] * h[0] + m[4] * h[1] + m[5] * h[2],
            ];
            for (&v, g) in term.corners.iter().zip(g) {
                let image = &mut image[v as usize];
                *image = add(*image, scale(term.normal, g));
            }
        }
        let along = total(&way, &image);
        let goes_on = along > 0.0 && left > 0.0;
        if !goes_on {
            break;
        }
        let length = (left / along) as f32;
        let is_last = step + 1 == STEPS;
        let mut next = 0.0f64;
        for v in 0..n {
            x[v] = add(x[v], scale(way[v], length));
            if !is_last {
                rest[v] = sub(rest[v], scale(image[v], length));
                image[v] = product(blocks[v], rest[v]);
                next += f64::from(dot(rest[v], image[v]));
            }
        }
        if is_last {
            break;
        }
        let share = (next / left) as f32;
        left = next;
        for v in 0..n {
            way[v] = add(image[v], scale(way[v], share));
        }
    }
    x
}
