//! The nearest of a few triangles around one vertex, for eight points at once.

use crate::simd::{Job, Lanes};
use stonecut_mesh::vec3::{cross, dot};

/// A triangle of a ring as seen from the vertex in its centre, with all that does not depend on samples.
#[derive(Clone, Copy)]
pub(crate) struct Face {
    pub(crate) triangle: u32,
    /// Number of the corner of the triangle that the vertex is.
    pub(crate) own: u32,
    pub(crate) b: u32,
    pub(crate) c: u32,
    /// From the vertex to the other corners; unit normal.
    pub(crate) to_b: [f32; 3],
    pub(crate) to_c: [f32; 3],
    pub(crate) normal: [f32; 3],
    /// b with b, b with c, c with c.
    products: [f32; 3],
    /// One over: the determinant, the squared lengths of the sides at b, at c and opposite.
    inverse: [f32; 4],
}

impl Face {
    /// A triangle whose first corner is the vertex; `None` if it has no area.
    #[inline(always)]
    pub(crate) fn new(
        triangle: u32,
        (b, c): (u32, u32),
        to_b: [f32; 3],
        to_c: [f32; 3],
    ) -> Option<Face> {
        let n = cross(to_b, to_c);
        let det = dot(n, n);
        let (bb, bc, cc) = (dot(to_b, to_b), dot(to_b, to_c), dot(to_c, to_c));
        let is_proper = det > 1e-12 * (bb + cc) * (bb + cc);
        let length = det.sqrt();
        let opposite = bb + cc - 2.0 * bc;
        is_proper.then(|| Face {
            triangle,
            own: 0,
            b,
            c,
            to_b,
            to_c,
            normal: n.map(|x| x / length),
            products: [bb, bc, cc],
            inverse: [1.0 / det, 1.0 / bb, 1.0 / cc, 1.0 / opposite],
        })
    }

    /// Squared distances of eight points relative to the vertex, the weights of b and c at the nearest points, and the
    /// signed distances to the plane.
    #[inline(always)]
    pub(crate) fn off<L: Lanes>(&self, p: [L; 3]) -> (L, L, L, L) {
        let along = [dot3(self.to_b, p), dot3(self.to_c, p)];
        let height = dot3(self.normal, p);
        let [bb, bc, cc] = self.products;
        let products = [L::splat(bb), L::splat(bc), L::splat(cc)];
        let [det, by_bb, by_cc, by_opposite] = self.inverse;
        let inverse = [L::splat(det), L::splat(by_bb), L::splat(by_cc), L::splat(by_opposite)];
        let (b, c, off) = nearest_weights(along, products, inverse);
        (height.times(height).plus(off), b, c, height)
    }
}

/// The nearest points of eight samples.
pub(crate) struct Found {
    pub(crate) distance_sq: [f32; 8],
    /// Index of the face; as a number, since that is what the lanes hold.
    pub(crate) face: [f32; 8],
    /// Weights of b and c.
    pub(crate) weights: [[f32; 8]; 2],
    /// Signed distance to the plane of the triangle.
    pub(crate) height: [f32; 8],
}

/// The nearest of some faces around a vertex, to each of eight points, relative to that vertex.
pub(crate) struct Search<'a> {
    pub(crate) faces: &'a [Face],
    pub(crate) points: &'a [[f32; 8]; 3],
}

#[inline(always)]
fn dot3<L: Lanes>(a: [f32; 3], b: [L; 3]) -> L {
    let x = L::splat(a[0]).times(b[0]);
    x.plus(L::splat(a[1]).times(b[1])).plus(L::splat(a[2]).times(b[2]))
}

#[inline(always)]
fn unit_range<L: Lanes>(x: L) -> L {
    let one = L::splat(1.0);
    let x = x.greater(L::splat(0.0));
    L::lt_select(x, one, x, one)
}

/// Weights of b and c at the nearest points of triangles to points, and the squared distances of those from the feet of
/// the points in the triangles' planes.
///
/// Takes the products of the points, relative to the first corner, with the sides to b and c. Then those of the sides, b
/// with b, b with c, c with c. Then one over the determinant and over the squared lengths of the sides at b, at c and
/// opposite.
#[inline(always)]
pub(crate) fn nearest_weights<L: Lanes>(
    [pb, pc]: [L; 2],
    [bb, bc, cc]: [L; 3],
    [inverse, by_bb, by_cc, by_opposite]: [L; 4],
) -> (L, L, L) {
    let (zero, one) = (L::splat(0.0), L::splat(1.0));
    // Where the foot of the point lies in the plane.
    let b = cc.times(pb).minus(bc.times(pc)).times(inverse);
    let c = bb.times(pc).minus(bc.times(pb)).times(inverse);
    let a = one.minus(b).minus(c);
    // Nearest points on the three sides, and how far the foot is from them.
    let on_b = unit_range(pb.times(by_bb));
    let on_c = unit_range(pc.times(by_cc));
    let across = unit_range(pc.minus(pb).minus(bc.minus(bb)).times(by_opposite));
    // A closure would not be inlined into the wide version.
    macro_rules! off {
        ($b:expr, $c:expr) => {{
            let (u, v) = (b.minus($b), c.minus($c));
            let uv = u.times(v).times(bc);
            bb.times(u.times(u)).plus(uv.plus(uv)).plus(cc.times(v.times(v)))
        }};
    }
    let rest = one.minus(across);
    let (off_b, off_c, off_a) = (off!(on_b, zero), off!(zero, on_c), off!(rest, across));
    let near_b = L::lt_select(off_c, off_b, zero, on_b);
    let near_c = L::lt_select(off_c, off_b, on_c, zero);
    let off = L::lt_select(off_c, off_b, off_c, off_b);
    let near_b = L::lt_select(off_a, off, rest, near_b);
    let near_c = L::lt_select(off_a, off, across, near_c);
    let off = L::lt_select(off_a, off, off_a, off);
    // Within the triangle the foot itself is it.
    let ab = L::lt_select(a, b, a, b);
    let lowest = L::lt_select(ab, c, ab, c);
    let near_b = L::lt_select(lowest, zero, near_b, b);
    let near_c = L::lt_select(lowest, zero, near_c, c);
    (near_b, near_c, L::lt_select(lowest, zero, off, zero).greater(zero))
}

impl Job for Search<'_> {
    type Output = Found;

    #[inline(always)]
    fn run<L: Lanes>(self) -> Found {
        let p = [L::load(&self.points[0]), L::load(&self.points[1]), L::load(&self.points[2])];
        let zero = L::splat(0.0);
        let mut least = L::splat(f32::INFINITY);
        let (mut face, mut best_b, mut best_c, mut best_h) = (zero, zero, zero, zero);
        for (i, f) in self.faces.iter().enumerate() {
            let (distance_sq, near_b, near_c, height) = f.off::<L>(p);
            face = L::lt_select(distance_sq, least, L::splat(i as f32), face);
            best_b = L::lt_select(distance_sq, least, near_b, best_b);
            best_c = L::lt_select(distance_sq, least, near_c, best_c);
            best_h = L::lt_select(distance_sq, least, height, best_h);
            least = L::lt_select(distance_sq, least, distance_sq, least);
        }
        Found {
            distance_sq: least.store(),
            face: face.store(),
            weights: [best_b.store(), best_c.store()],
            height: best_h.store(),
        }
    }
}
