//! The triangles of the input around one vertex, eight side by side: how far a point is from each of them.

use super::input::{BoundInput, NONE};
use crate::simd::Lanes;
use crate::surface::faces::nearest_weights;
use stonecut_mesh::vec3::sub;

/// Triangles around one vertex that are looked at: their number has a bit each.
const MOST_FACES: usize = 64;

/// Fans that are kept loaded; a power of two. Edges around one survivor are looked at from the same vertex.
const KEPT: usize = 32;

/// The triangles around some vertices of the input; one of them was asked for last.
#[derive(Clone)]
pub(super) struct Fans {
    /// Placed by the last bits of the vertex.
    fans: Vec<Fan>,
    last: usize,
}

impl Default for Fans {
    fn default() -> Fans {
        Fans { fans: vec![Fan::default(); KEPT], last: 0 }
    }
}

impl Fans {
    /// The triangles around a vertex; `limit`, always the same, is how far a point may be from the original.
    #[inline(always)]
    pub(super) fn load<L: Lanes>(&mut self, input: &BoundInput, centre: u32, limit: f32) -> &Fan {
        self.last = centre as usize % KEPT;
        let fan = &mut self.fans[self.last];
        fan.load::<L>(input, centre, limit);
        fan
    }

    /// The fan that was asked for last.
    #[inline(always)]
    pub(super) fn last(&self) -> &Fan {
        &self.fans[self.last]
    }
}

/// The triangles around a vertex of the input.
#[derive(Clone)]
pub(super) struct Fan {
    /// The vertex.
    pub(super) centre: u32,
    /// The first `n_eights` count.
    eights: Vec<EightFaces>,
    n_eights: usize,
}

impl Default for Fan {
    fn default() -> Fan {
        Fan { centre: NONE, eights: Vec::new(), n_eights: 0 }
    }
}

/// Eight triangles around a vertex, one a lane, with all that does not depend on points.
#[derive(Clone)]
struct EightFaces {
    /// Second and third corners.
    corners: [[u32; 2]; 8],
    /// From the vertex to them; their cross product.
    to_b: [[f32; 8]; 3],
    to_c: [[f32; 8]; 3],
    normal: [[f32; 8]; 3],
    /// Products of the two sides at the vertex: b with b, b with c, c with c.
    products: [[f32; 8]; 3],
    /// One over: the determinant, the squared lengths of the sides at b, at c and opposite.
    inverse: [[f32; 8]; 4],
    /// Infinite in lanes without a triangle, or where it has no area; else 0.
    absent: [f32; 8],
    /// Distance of the input from the original, at most.
    before: [f32; 8],
    /// Squared distance that a point may be away.
    reach_sq: [f32; 8],
}

/// The nearest triangle of a fan.
#[derive(Clone, Copy)]
pub(super) struct FoundFace {
    pub(super) distance_sq: f32,
    /// Weights of the second and third corner at the nearest point, and the corners.
    pub(super) weights: [f32; 2],
    pub(super) corners: [u32; 2],
    /// Distance of the input from the original, at most.
    pub(super) before: f32,
}

impl Fan {
    /// Loads the triangles around a vertex, unless they are loaded.
    #[inline(always)]
    fn load<L: Lanes>(&mut self, input: &BoundInput, centre: u32, limit: f32) {
        if self.centre == centre {
            return;
        }
        self.centre = centre;
        let around = input.around(centre);
        let around = &around[..around.len().min(MOST_FACES)];
        // In place: they are large.
        self.n_eights = around.len().div_ceil(8);
        if self.eights.len() < self.n_eights {
            self.eights.resize(self.n_eights, EightFaces::EMPTY);
        }
        for (eight, around) in self.eights.iter_mut().zip(around.chunks(8)) {
            eight.load::<L>(input, centre, around, limit);
        }
    }

    /// The triangle that is nearest to a point relative to the vertex; its distance is infinite if there is none.
    #[inline(always)]
    pub(super) fn nearest<L: Lanes>(&self, point: [f32; 3]) -> FoundFace {
        let mut best = FoundFace {
            distance_sq: f32::INFINITY,
            weights: [0.0; 2],
            corners: [self.centre; 2],
            before: 0.0,
        };
        for eight in &self.eights[..self.n_eights] {
            let (distance_sq, b, c) = eight.off::<L>(point);
            if distance_sq.below(L::splat(best.distance_sq)) == 0 {
                continue;
            }
            let (distances, b, c) = (distance_sq.store(), b.store(), c.store());
            for i in 0..8 {
                if distances[i] < best.distance_sq {
                    best = FoundFace {
                        distance_sq: distances[i],
                        weights: [b[i], c[i]],
                        corners: eight.corners[i],
                        before: eight.before[i],
                    };
                }
            }
        }
        best
    }

    /// The triangles that a point relative to the vertex is near enough to, one a bit.
    #[inline(always)]
    pub(super) fn reaching<L: Lanes>(&self, point: [f32; 3]) -> u64 {
        let mut found = 0;
        for (i, eight) in self.eights[..self.n_eights].iter().enumerate() {
            let (distance_sq, ..) = eight.off::<L>(point);
            let near = distance_sq.below(L::load(&eight.reach_sq));
            found |= u64::from(near) << (8 * i);
        }
        found
    }
}

impl EightFaces {
    const EMPTY: EightFaces = EightFaces {
        corners: [[NONE; 2]; 8],
        to_b: [[1.0; 8], [0.0; 8], [0.0; 8]],
        to_c: [[0.0; 8], [1.0; 8], [0.0; 8]],
        normal: [[0.0; 8]; 3],
        products: [[0.0; 8]; 3],
        inverse: [[0.0; 8]; 4],
        absent: [f32::INFINITY; 8],
        before: [0.0; 8],
        reach_sq: [0.0; 8],
    };

    /// Takes the triangles with these other corners; lanes that are left keep what they hold, infinitely far.
    #[inline(always)]
    fn load<L: Lanes>(&mut self, input: &BoundInput, centre: u32, around: &[[u32; 2]], limit: f32) {
        let own = input.witnesses[centre as usize];
        let behind = input.behind(centre);
        self.absent = [f32::INFINITY; 8];
        for (i, corners) in around.iter().enumerate() {
            let [b, c] = corners.map(|v| &input.witnesses[v as usize]);
            let (to_b, to_c) = (sub(b.at, own.at), sub(c.at, own.at));
            for k in 0..3 {
                self.to_b[k][i] = to_b[k];
                self.to_c[k][i] = to_c[k];
            }
            self.corners[i] = *corners;
            let [of_b, of_c] = corners.map(|v| input.behind(v));
            self.before[i] = behind.max(of_b).max(of_c);
        }
        let (b, c) = (load3::<L>(&self.to_b), load3::<L>(&self.to_c));
        let normal = [
            b[1].times(c[2]).minus(b[2].times(c[1])),
            b[2].times(c[0]).minus(b[0].times(c[2])),
            b[0].times(c[1]).minus(b[1].times(c[0])),
        ];
        let det = dot(normal, normal);
        let (bb, bc, cc) = (dot(b, b), dot(b, c), dot(c, c));
        let sum = bb.plus(cc);
        let is_proper = L::splat(1e-12).times(sum).times(sum).below(det);
        for (i, absent) in self.absent.iter_mut().enumerate().take(around.len()) {
            if is_proper >> i & 1 == 1 {
                *absent = 0.0;
            }
        }
        let one = L::splat(1.0);
        let opposite = sum.minus(bc.plus(bc));
        self.normal = [normal[0].store(), normal[1].store(), normal[2].store()];
        self.products = [bb.store(), bc.store(), cc.store()];
        self.inverse = [
            one.over(det).store(),
            one.over(bb).store(),
            one.over(cc).store(),
            one.over(opposite).store(),
        ];
        let reach = L::splat(limit).minus(L::load(&self.before));
        // A negative reach squared would be one.
        let zero = L::splat(0.0);
        self.reach_sq = L::lt_select(reach, zero, L::splat(-1.0), reach.times(reach)).store();
    }

    /// Squared distances of a point relative to the vertex, and the weights of the second and third corners at the nearest
    /// points.
    #[inline(always)]
    fn off<L: Lanes>(&self, point: [f32; 3]) -> (L, L, L) {
        // No closures here: they would not be compiled for wide lanes.
        let p = [L::splat(point[0]), L::splat(point[1]), L::splat(point[2])];
        let along = [dot(load3(&self.to_b), p), dot(load3(&self.to_c), p)];
        let height = dot(load3(&self.normal), p);
        let products = load3(&self.products);
        let [det, bb, cc, opposite] = &self.inverse;
        let inverse = [L::load(det), L::load(bb), L::load(cc), L::load(opposite)];
        let (b, c, off) = nearest_weights(along, products, inverse);
        let distance_sq = height.times(height).times(inverse[0]).plus(off);
        (distance_sq.plus(L::load(&self.absent)), b, c)
    }
}

#[inline(always)]
fn load3<L: Lanes>(rows: &[[f32; 8]; 3]) -> [L; 3] {
    [L::load(&rows[0]), L::load(&rows[1]), L::load(&rows[2])]
}

#[inline(always)]
fn dot<L: Lanes>(a: [L; 3], b: [L; 3]) -> L {
    a[0].times(b[0]).plus(a[1].times(b[1])).plus(a[2].times(b[2]))
}
