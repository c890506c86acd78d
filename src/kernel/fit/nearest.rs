//! The nearest triangle of each sample, eight samples of one vertex at once.
//!
//! Samples are sorted by the vertex they are near to and held against its ring. One that lies beyond the
//! rim of the ring goes to the vertex of the rim next to it and is tried again. Where it ends is a local
//! minimum: a sample stays on its own sheet of a thin part. One that ends suspiciously far away looks at everything that is
//! connected to that place within the distance found (`wider`). Moves nothing.

use crate::fit::samples::Sample;
use crate::simd::Simd;
use crate::surface::Surface;
use crate::surface::faces::{Face, Search};
use crate::vertex::GONE;
use stonecut_mesh::corners::others;
use stonecut_mesh::vec3::sub;

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
/// order that depends on nothing but the arguments. Hints are improved; lost samples are dropped. Beyond the
/// squared distance `far_sq` a foot is looked for in a wider search.
pub(crate) fn feet(
    surface: &Surface,
    place: &[[f32; 3]],
    samples: &mut Vec<Sample>,
    far_sq: f32,
    simd: Simd,
    mut take: impl FnMut(&Sample, Foot),
) {
    let mut far = Vec::new();
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
                    let foot = Foot {
                        triangle: face.triangle,
                        weights,
                        height: found.height[i],
                        distance_sq: found.distance_sq[i],
                    };
                    if foot.distance_sq > far_sq {
                        far.push((*sample, foot));
                        continue;
                    }
                    done.push(*sample);
                    take(sample, foot);
                }
            }
        }
        if list.is_empty() {
            break;
        }
    }
    let mut wider = WiderSearch::default();
    for (mut sample, foot) in far {
        let foot = wider.search(surface, place, &mut sample, foot, simd);
        done.push(sample);
        take(&sample, foot);
    }
    *samples = done;
}

/// Vertices whose rings a wider search looks at, at most.
const MOST_LOOKED_AT: usize = 48;
/// Triangles up to this multiple of the least squared distance lead the search on: the way to a nearer one may lie a little
/// farther away.
const DETOUR_SQ: f32 = 2.25;

/// Search among all that is connected to a first foot near a sample: best first, from vertex to vertex.
#[derive(Default)]
struct WiderSearch {
    seen: Vec<u32>,
    /// Vertices to look at, with the squared distance of the triangle that led there.
    open: Vec<(f32, u32)>,
    faces: Vec<Face>,
}

impl WiderSearch {
    /// The nearest foot that was found, `foot` or a better one; the sample's hint goes along.
    fn search(
        &mut self,
        surface: &Surface,
        place: &[[f32; 3]],
        sample: &mut Sample,
        foot: Foot,
        simd: Simd,
    ) -> Foot {
        let mut best = foot;
        self.seen.clear();
        self.seen.push(sample.hint);
        self.open.clear();
        let first = surface.triangles[foot.triangle as usize];
        self.add(first, foot.distance_sq);
        for &triangle in surface.ring(sample.hint).iter().take(MOST_FACES) {
            self.add(surface.triangles[triangle as usize], f32::INFINITY);
        }
        while self.seen.len() < MOST_LOOKED_AT {
            let next = self
                .open
                .iter()
                .enumerate()
                .min_by(|(_, a), (_, b)| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            let Some((at, &(distance_sq, v))) = next else { break };
            if distance_sq.is_finite() && distance_sq > DETOUR_SQ * best.distance_sq {
                break;
            }
            self.open.swap_remove(at);
            if self.seen.contains(&v) {
                continue;
            }
            self.seen.push(v);
            if surface.ring(v).len() > MOST_FACES {
                continue;
            }
            ring_faces(surface, place, v, &mut self.faces);
            let point = sub(sample.at, place[v as usize]);
            let found = simd.run(Search { faces: &self.faces, points: &point.map(|x| [x; 8]) });
            let distance_sq = found.distance_sq[0];
            if distance_sq < best.distance_sq {
                let face = self.faces[found.face[0] as usize];
                let (b, c) = (found.weights[0][0], found.weights[1][0]);
                let mut weights = [1.0 - b - c, b, c];
                weights.rotate_right(face.own as usize);
                let (triangle, height) = (face.triangle, found.height[0]);
                best = Foot { triangle, weights, height, distance_sq };
                sample.hint = v;
            }
            if distance_sq <= DETOUR_SQ * best.distance_sq {
                for face in std::mem::take(&mut self.faces) {
                    self.add([face.b, face.c, v], distance_sq);
                }
            }
        }
        best
    }

    fn add(&mut self, corners: [u32; 3], distance_sq: f32) {
        if corners[0] == GONE {
            return;
        }
        for v in corners {
            if !self.seen.contains(&v) {
                self.open.push((distance_sq, v));
            }
        }
    }
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
