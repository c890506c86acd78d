//! Bounds on the steps of vertices in a fit.
//!
//! The normal equations know the original from where the samples are, and there only: between them a vertex
//! could run away from a crease, or turn a triangle over, and they would not notice. Bounds are relative to
//! the surface as it was before the fit, so that two sweeps do not do what one may not.

use super::Work;
use super::normal_equations::{FaceTerm, V};
use crate::fit::nearest::off_ring;
use crate::simd::Simd;
use stonecut_mesh::vec3::{add, cross, dot, scale, sub};

/// A step squared is at most this share of the area around the vertex: without any bound the fit diverges
/// (../shared/KERNEL.md). Between 0.01 and 0.05 it makes no difference.
const TRUST: f32 = 0.02;
/// No vertex goes farther from the triangles that were around it than this many times the RMS of the
/// samples. Without that bound single vertices ran off creases, by 20 times the RMS; 2 to 10 differ by less
/// than 0.5 % in RMS (docs/design/kernel.md, "The fit").
const MAX_OFF: f64 = 3.0;
/// No triangle turns further than this cosine (25 degrees) in the whole fit: at 60 degrees a sweep the
/// error is the same, but triangles end up facing against the original (terrain: 26 instead of 11).
const TURN_COSINE: f32 = 0.9;
/// Double area over the sum of squared sides: no triangle that is worse than this gets worse still. Three times
/// what the collapses call a needle; not measured.
const MIN_SHAPE: f32 = 0.02;
/// Times that steps are cut in half where triangles would turn or become needles; then they are left out. Not
/// measured.
const HALVINGS: usize = 3;
/// Limit of the rounds of holding back; each halves or drops a step, so that it ends long before that.
const MAX_ROUNDS: usize = 64;

impl Work<'_> {
    /// Moves the vertices by `steps` as far as they may; `mean_sq`: squared RMS of the samples.
    pub(super) fn go(&mut self, terms: &[FaceTerm], mut steps: Vec<V>, mean_sq: f64, simd: Simd) {
        let most_off_sq = (MAX_OFF * MAX_OFF * mean_sq) as f32;
        let mut moved = self.place.clone();
        for (v, step) in steps.iter_mut().enumerate() {
            let sq = dot(*step, *step);
            let most = TRUST * 0.5 * self.around[v];
            let is_sound = sq.is_finite() && self.free[v];
            if !is_sound {
                *step = [0.0; 3];
            } else if sq > most {
                *step = scale(*step, (most / sq).sqrt());
            }
            // No farther from the triangles than from where it was.
            let way = sub(add(self.place[v], *step), self.before[v]);
            if is_sound && dot(way, way) > most_off_sq {
                *step = scale(*step, self.share_within(v, *step, most_off_sq, simd));
            }
            moved[v] = add(self.place[v], *step);
        }
        let mut touched = unsound(terms.iter(), &self.before, &moved);
        let mut is_touched = vec![false; moved.len()];
        for round in 0..MAX_ROUNDS {
            if touched.is_empty() {
                break;
            }
            for &v in &touched {
                let v = v as usize;
                steps[v] = if round < HALVINGS { scale(steps[v], 0.5) } else { [0.0; 3] };
                moved[v] = add(self.place[v], steps[v]);
                is_touched[v] = true;
            }
            // The others are as sound as they were.
            let around = terms.iter().filter(|t| t.corners.iter().any(|&v| is_touched[v as usize]));
            let next = unsound(around, &self.before, &moved);
            touched.iter().for_each(|&v| is_touched[v as usize] = false);
            touched = next;
        }
        self.place = moved;
    }

    /// The share of a step, in eighths, that leaves the vertex near the triangles that were around it.
    fn share_within(&mut self, v: usize, step: V, most_off_sq: f32, simd: Simd) -> f32 {
        let from = sub(self.place[v], self.before[v]);
        let share = |i: usize| 1.0 - i as f32 / 8.0;
        let points: [[f32; 8]; 3] =
            std::array::from_fn(|k| std::array::from_fn(|i| from[k] + step[k] * share(i)));
        let off_sq =
            off_ring(&self.state.surface, &self.before, v as u32, &points, simd, &mut self.faces);
        (0..8).find(|&i| off_sq[i] <= most_off_sq).map_or(0.0, share)
    }
}

/// Corners of triangles that turn too far or become needles on the way from one place to the other: those
/// that do move.
fn unsound<'a>(terms: impl Iterator<Item = &'a FaceTerm>, from: &[V], to: &[V]) -> Vec<u32> {
    let mut corners = Vec::new();
    for term in terms {
        let before = term.corners.map(|v| from[v as usize]);
        let after = term.corners.map(|v| to[v as usize]);
        if before != after && !stays_sound(before, after) {
            let moves = |v: &&u32| from[**v as usize] != to[**v as usize];
            corners.extend(term.corners.iter().filter(moves));
        }
    }
    corners.sort_unstable();
    corners.dedup();
    corners
}

/// Returns whether a triangle neither turns too far nor becomes a needle.
fn stays_sound(before: [V; 3], after: [V; 3]) -> bool {
    let shape = |t: [V; 3]| {
        let e = [sub(t[1], t[0]), sub(t[2], t[0]), sub(t[2], t[1])];
        let n = cross(e[0], e[1]);
        let length = dot(n, n).sqrt();
        (n, length, length / (dot(e[0], e[0]) + dot(e[1], e[1]) + dot(e[2], e[2])))
    };
    let ((n0, l0, s0), (n1, l1, s1)) = (shape(before), shape(after));
    dot(n0, n1) >= TURN_COSINE * l0 * l1 && (s1 >= MIN_SHAPE || s1 >= s0)
}
