//! The nearest triangle of each sample, eight samples of one vertex at once.
//!
//! Samples are sorted by the vertex they are near to and held against its ring. One that lies beyond the
//! rim of the ring goes to the vertex of the rim next to it and is tried again. Where it ends is a local
//! minimum: a sample stays on its own sheet of a thin part. Moves nothing.

use crate::kernel::fit::samples::Sample;
use crate::kernel::simd::{Job, Lanes, Simd};
use crate::kernel::surface::{GONE, Surface, others};
use crate::mesh::vec3::{cross, dot, sub};

/// Samples around a vertex of more triangles are lost: each of them would look at all of those.
const MOST_FACES: usize = 1024;
/// Rings that a sample may be tried against.
const MAX_RINGS: usize = 5;

/// A triangle of a ring as seen from the vertex in its centre, with all that does not depend on samples.
#[derive(Clone, Copy)]
pub(crate) struct Face {
    triangle: u32,
    /// Which corner of the triangle the vertex is.
    own: u32,
    b: u32,
    c: u32,
    /// From the vertex to the other corners; unit normal.
    to_b: [f32; 3],
    to_c: [f32; 3],
    normal: [f32; 3],
    bb: f32,
    bc: f32,
    cc: f32,
    /// One over: the determinant, the squared lengths of the sides at b, at c and opposite.
    inverse: [f32; 4],
}

/// The nearest points of eight samples.
struct Found {
    distance_sq: [f32; 8],
    /// Index of the face; as a number, since that is what the lanes hold.
    face: [f32; 8],
    /// Weights of b and c.
    weights: [[f32; 8]; 2],
    /// Signed distance to the plane of the triangle.
    height: [f32; 8],
}

struct Search<'a> {
    faces: &'a [Face],
    points: &'a [[f32; 8]; 3],
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

impl Job for Search<'_> {
    type Output = Found;

    #[inline(always)]
    fn run<L: Lanes>(self) -> Found {
        let p = [L::load(&self.points[0]), L::load(&self.points[1]), L::load(&self.points[2])];
        let (zero, one) = (L::splat(0.0), L::splat(1.0));
        let mut least = L::splat(f32::INFINITY);
        let (mut face, mut best_b, mut best_c, mut best_h) = (zero, zero, zero, zero);
        for (i, f) in self.faces.iter().enumerate() {
            let (bb, bc, cc) = (L::splat(f.bb), L::splat(f.bc), L::splat(f.cc));
            let (pb, pc) = (dot3(f.to_b, p), dot3(f.to_c, p));
            let height = dot3(f.normal, p);
            let inverse = L::splat(f.inverse[0]);
            // Where the foot of the sample lies in the plane.
            let b = cc.times(pb).minus(bc.times(pc)).times(inverse);
            let c = bb.times(pc).minus(bc.times(pb)).times(inverse);
            let a = one.minus(b).minus(c);
            // Nearest points on the three sides, and how far the foot is from them.
            let on_b = unit_range(pb.times(L::splat(f.inverse[1])));
            let on_c = unit_range(pc.times(L::splat(f.inverse[2])));
            let across = pc.minus(pb).minus(bc.minus(bb)).times(L::splat(f.inverse[3]));
            let across = unit_range(across);
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
            let off = L::lt_select(lowest, zero, off, zero).greater(zero);
            let distance_sq = height.times(height).plus(off);
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

/// Where a sample meets the surface.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Foot {
    pub(crate) triangle: u32,
    /// Barycentric, in the order of the triangle's corners.
    pub(crate) weights: [f32; 3],
    /// Signed distance to the triangle's plane.
    pub(crate) height: f32,
    pub(crate) distance_sq: f32,
}

/// Finds the feet of `samples` on the surface whose vertices lie at `place`, and hands them to `take` in an
/// order that depends on nothing but the arguments. Hints are improved; lost samples are dropped.
pub(crate) fn feet(
    surface: &Surface,
    place: &[[f32; 3]],
    samples: &mut Vec<Sample>,
    simd: Simd,
    mut take: impl FnMut(&Sample, Foot),
) {
    let mut faces = Vec::new();
    let mut done = Vec::new();
    let mut starts = vec![0u32; place.len() + 1];
    let mut list = std::mem::take(samples);
    let mut sorted = Vec::new();
    for round in 1..=MAX_RINGS {
        sort_by_hint(&list, &mut starts, &mut sorted);
        if round == 1 {
            // The samples end up in the memory they came in.
            done = std::mem::take(&mut list);
            done.clear();
        }
        list.clear();
        for v in 0..place.len() {
            let own = &sorted[starts[v] as usize..starts[v + 1] as usize];
            if own.is_empty() || surface.ring(v as u32).len() > MOST_FACES {
                continue;
            }
            ring_faces(surface, place, v as u32, &mut faces);
            for eight in own.chunks(8) {
                let mut points = [[0.0f32; 8]; 3];
                for (i, sample) in eight.iter().enumerate() {
                    for k in 0..3 {
                        points[k][i] = sample.at[k] - place[v][k];
                    }
                }
                let found = simd.run(Search { faces: &faces, points: &points });
                for (i, sample) in eight.iter().enumerate() {
                    let is_found = found.distance_sq[i] < f32::INFINITY;
                    if !is_found {
                        continue;
                    }
                    let face = &faces[found.face[i] as usize];
                    let (b, c) = (found.weights[0][i], found.weights[1][i]);
                    let a = 1.0 - b - c;
                    if a <= 1e-6 && round < MAX_RINGS {
                        let hint = if b >= c { face.b } else { face.c };
                        list.push(Sample { hint, ..*sample });
                        continue;
                    }
                    let mut weights = [a, b, c];
                    weights.rotate_right(face.own as usize);
                    done.push(*sample);
                    take(
                        sample,
                        Foot {
                            triangle: face.triangle,
                            weights,
                            height: found.height[i],
                            distance_sq: found.distance_sq[i],
                        },
                    );
                }
            }
        }
        if list.is_empty() {
            break;
        }
    }
    *samples = done;
}

/// Of the triangles around a vertex the one that is nearest to a point relative to it, and the weights of its
/// corners there; `None` if all are without area.
pub(crate) fn nearest_around(
    surface: &Surface,
    place: &[[f32; 3]],
    v: u32,
    point: [f32; 3],
    simd: Simd,
    faces: &mut Vec<Face>,
) -> Option<(u32, [f32; 3])> {
    ring_faces(surface, place, v, faces);
    let found = simd.run(Search { faces, points: &point.map(|x| [x; 8]) });
    if !found.distance_sq[0].is_finite() {
        return None;
    }
    let face = faces.get(found.face[0] as usize)?;
    let (b, c) = (found.weights[0][0], found.weights[1][0]);
    let mut weights = [1.0 - b - c, b, c];
    weights.rotate_right(face.own as usize);
    Some((face.triangle, weights))
}

/// Squared distances of eight points, relative to a vertex, from the triangles around it.
pub(crate) fn off_ring(
    surface: &Surface,
    place: &[[f32; 3]],
    v: u32,
    points: &[[f32; 8]; 3],
    simd: Simd,
    faces: &mut Vec<Face>,
) -> [f32; 8] {
    ring_faces(surface, place, v, faces);
    simd.run(Search { faces, points }).distance_sq
}

/// Sorts by hint; those of vertex v end up from `starts[v]` to `starts[v + 1]`, in their old order.
fn sort_by_hint(list: &[Sample], starts: &mut [u32], sorted: &mut Vec<Sample>) {
    starts.fill(0);
    let Some(&filler) = list.first() else { return };
    let mut n = 0;
    for sample in list.iter().filter(|sample| sample.hint != GONE) {
        starts[sample.hint as usize] += 1;
        n += 1;
    }
    let mut sum = 0;
    for start in starts.iter_mut() {
        sum += std::mem::replace(start, sum);
    }
    sorted.clear();
    sorted.resize(n, filler);
    for sample in list.iter().filter(|sample| sample.hint != GONE) {
        let start = &mut starts[sample.hint as usize];
        sorted[*start as usize] = *sample;
        *start += 1;
    }
    // Each start has become the end of its vertex, hence the start of the next.
    starts.copy_within(0..starts.len() - 1, 1);
    starts[0] = 0;
}

fn ring_faces(surface: &Surface, place: &[[f32; 3]], v: u32, faces: &mut Vec<Face>) {
    faces.clear();
    let centre = place[v as usize];
    for &triangle in surface.ring(v) {
        let t = surface.triangles[triangle as usize];
        // Long rings keep what is gone.
        if t[0] == GONE {
            continue;
        }
        let (b, c) = others(t, v);
        let (to_b, to_c) = (sub(place[b as usize], centre), sub(place[c as usize], centre));
        let n = cross(to_b, to_c);
        let det = dot(n, n);
        let (bb, bc, cc) = (dot(to_b, to_b), dot(to_b, to_c), dot(to_c, to_c));
        let is_proper = det > 1e-12 * (bb + cc) * (bb + cc);
        if !is_proper {
            continue;
        }
        let length = det.sqrt();
        let opposite = bb + cc - 2.0 * bc;
        faces.push(Face {
            triangle,
            own: u32::from(t[1] == v) + 2 * u32::from(t[2] == v),
            b,
            c,
            to_b,
            to_c,
            normal: n.map(|x| x / length),
            bb,
            bc,
            cc,
            inverse: [1.0 / det, 1.0 / bb, 1.0 / cc, 1.0 / opposite],
        });
    }
}
