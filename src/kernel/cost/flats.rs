//! Cost and place of collapses next to planes that a surface lies in exactly: the survivor stays in all planes of both ends.
//!
//! Takes the place of what `cost::quadric` found, edge by edge, after its lanes are through; on surfaces without such
//! planes it is not called. The costs mean the same: both quadrics at the place.
//!
//! docs/algorithm.md, section 2.

use crate::cost::quadric::{Evaluated, LENGTH_COST, MAX_REACH, REGULARISATION, VOLUME_SHARE};
use crate::surface::Surface;
use crate::surface::class::Class;
use crate::surface::flats::{Flats, PlaneMeeting, across};
use crate::vertex::Vertex;
use stonecut_mesh::vec3::{Vec3, add, cross, dot, length_sq, scale, sub};

/// Multiple of the cost of a collapse that cannot keep its planes.
const BROKEN: f32 = 4.0;

/// Corrects eight edges; where `fixed` is not 0, the survivor stays at `v1`.
#[inline(never)]
pub(crate) fn correct(
    (surface, flats): (&Surface, &Flats),
    v0: &[u32; 8],
    v1: &[u32; 8],
    fixed: &[f32; 8],
    found: &mut Evaluated,
) {
    for i in 0..8 {
        let mask = flats.of(v0[i]) | flats.of(v1[i]);
        if mask == 0 || found.cost[i] == f32::INFINITY {
            continue;
        }
        let (from, to) = (&surface.vertices[v0[i] as usize], &surface.vertices[v1[i] as usize]);
        if fixed[i] != 0.0 {
            if !flats.contain(mask, to.position) {
                found.cost[i] *= BROKEN;
            }
            continue;
        }
        let half = scale(sub(to.position, from.position), 0.5 * surface.scale);
        let centre = scale(add(from.position, to.position), 0.5);
        let best = flats.meeting(mask, centre).and_then(|mut meeting| {
            meeting.nearest = scale(meeting.nearest, surface.scale);
            let keeps_volume = surface.rings[v0[i] as usize].class != Some(Class::Junction);
            best_within((from, to), half, &meeting, keeps_volume)
        });
        match best {
            None => found.cost[i] *= BROKEN,
            Some((place, cost)) => {
                found.cost[i] = cost as f32;
                for (row, x) in found.place.iter_mut().zip(place) {
                    row[i] = x as f32;
                }
            }
        }
    }
}

/// x^T A y for the first six numbers of a quadric.
fn product(q: &[f32; 9], x: Vec3) -> Vec3 {
    let q = q.map(f64::from);
    [dot([q[0], q[1], q[2]], x), dot([q[1], q[3], q[4]], x), dot([q[2], q[4], q[5]], x)]
}

/// Inverse of a quadric within the planes of a meeting: over a plane, along a line, or nothing at a point.
struct Inverse {
    /// Directions that lie in all planes.
    directions: [Vec3; 2],
    /// The inverse between them: of the first, across, of the second.
    numbers: [f64; 3],
}

impl Inverse {
    /// Inverts the quadric that `times` multiplies by; `None` if the plane has no directions.
    fn within(meeting: &PlaneMeeting, times: impl Fn(Vec3) -> Vec3) -> Option<Inverse> {
        let [n0, n1, _] = meeting.normals;
        Some(match meeting.rank {
            1 => {
                let (u, v) = across(n0)?;
                let (ku, kv) = (times(u), times(v));
                let (uu, uv, vv) = (dot(u, ku), dot(u, kv), dot(v, kv));
                let determinant = uu * vv - uv * uv;
                Inverse { directions: [u, v], numbers: [vv, -uv, uu].map(|x| x / determinant) }
            }
            2 => {
                let along = cross(n0, n1);
                let steepness = dot(along, times(along));
                Inverse { directions: [along, [0.0; 3]], numbers: [1.0 / steepness, 0.0, 0.0] }
            }
            _ => Inverse { directions: [[0.0; 3]; 2], numbers: [0.0; 3] },
        })
    }

    fn times(&self, x: Vec3) -> Vec3 {
        let [u, v] = self.directions;
        let ([uu, uv, vv], a, b) = (self.numbers, dot(u, x), dot(v, x));
        add(scale(u, uu * a + uv * b), scale(v, uv * a + vv * b))
    }
}

/// The place of least error where the planes meet, relative to the midpoint, and its cost; `None` where that is too
/// far away.
fn best_within(
    (from, to): (&Vertex, &Vertex),
    half: Vec3,
    meeting: &PlaneMeeting,
    keeps_volume: bool,
) -> Option<(Vec3, f64)> {
    let (q0, q1) = (&from.quadric, &to.quadric);
    let trace: f64 = [0, 3, 5].iter().map(|&k: &usize| f64::from(q0[k]) + f64::from(q1[k])).sum();
    let lift = trace * f64::from(REGULARISATION) + 1e-30;
    let times = |x: Vec3| add(add(product(q0, x), product(q1, x)), scale(x, lift));
    let wanted = sub(product(q1, half), product(q0, half));
    let inverse = Inverse::within(meeting, times)?;
    let nearest = meeting.nearest;
    let free = add(nearest, inverse.times(sub(wanted, times(nearest))));
    // Written so that NaN is too far.
    let half_sq = length_sq(half);
    let is_near = |x: Vec3| length_sq(x) <= half_sq * f64::from(MAX_REACH * MAX_REACH);
    if !is_near(free) {
        return None;
    }
    // The volume is kept as far as the planes let it.
    let normals = |q: &[f32; 9]| [q[6], q[7], q[8]].map(f64::from);
    let (g0, g1) = (normals(q0), normals(q1));
    let g = add(g0, g1);
    let way = inverse.times(g);
    let within = sub(
        g,
        meeting.normals[..meeting.rank]
            .iter()
            .fold([0.0; 3], |sum, n| add(sum, scale(*n, dot(*n, g)))),
    );
    let mut place = free;
    if keeps_volume && length_sq(within) > (trace * f64::from(VOLUME_SHARE)).powi(2) {
        let step = (dot(sub(g1, g0), half) - dot(g, free)) / dot(g, way);
        let kept = add(free, scale(way, step));
        place = if is_near(kept) { kept } else { free };
    }
    let error = |q: &[f32; 9], x: Vec3| dot(x, product(q, x));
    let error = error(q0, add(place, half)) + error(q1, sub(place, half));
    Some((place, error.max(0.0) + trace * half_sq * f64::from(LENGTH_COST)))
}
