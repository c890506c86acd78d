//! The nearest triangle of each sample, eight samples of one vertex at once.
//!
//! Samples are sorted by the vertex they are near to and held against its ring. One that lies beyond the
//! rim of the ring goes to the vertex of the rim next to it and is tried again. Where it ends is a local
//! minimum: a sample stays on its own sheet of a thin part. Moves nothing.

use crate::kernel::fit::samples::Sample;
use crate::kernel::simd::Simd;
use crate::kernel::surface::Surface;
use crate::kernel::surface::faces::{Face, Search};
use crate::kernel::vertex::{GONE, others};
use crate::mesh::vec3::sub;

/// Samples around a vertex of more triangles are lost: each of them would look at all of those.
const MOST_FACES: usize = 1024;
/// Rings that a sample may be tried against.
const MAX_RINGS: usize = 5;

/// Nearest point of the surface to a sample.
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
        let own = u32::from(t[1] == v) + 2 * u32::from(t[2] == v);
        if let Some(mut face) = Face::new(triangle, (b, c), to_b, to_c) {
            face.own = own;
            faces.push(face);
        }
    }
}
