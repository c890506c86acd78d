//! Points of the original that go on to the next round: of the witnesses of each triangle those that say most of how
//! far it is away, however it is tilted later.
//!
//! Over a triangle, heights of the original and places are one set of points in space; the largest height over any
//! plane is at a corner of its convex hull. Taken are extreme points: up, down, and either towards the corners of the
//! triangle, as far as there is room (after Agarwal, Har-Peled & Varadarajan 2004).

use super::input::NONE;
use super::tracker::Tracker;
use crate::surface::Surface;
use crate::vertex::GONE;
use stonecut_mesh::extremes::Extremes;
use stonecut_mesh::vec3::{dot, normal, scale, sub};

/// A witness as it is chosen.
#[derive(Clone, Copy)]
struct ExtremeCandidate {
    witness: u32,
    /// Weight of each corner at the place below it, and the height above the plane.
    weights: [f64; 3],
    height: f64,
}

impl Tracker {
    /// The points that go on, for each triangle that is there, in their order.
    pub(crate) fn extremes(&self, surface: &Surface) -> Vec<Extremes> {
        let mut candidates = Vec::new();
        let there = surface.triangles.iter().enumerate().filter(|(_, t)| t[0] != GONE);
        let of_triangle = |(id, t): (usize, &[u32; 3])| {
            let corners = t.map(|v| self.local(surface.vertices[v as usize].position));
            self.candidates(id, corners, &mut candidates);
            let offset = |candidate: &ExtremeCandidate| {
                let at = self.input.witnesses[candidate.witness as usize].at;
                std::array::from_fn(|k| (at[k] - corners[0][k]) * surface.unscale as f32)
            };
            let chosen: Vec<[f32; 3]> = chosen(&mut candidates).iter().map(offset).collect();
            Extremes::new(&chosen)
        };
        there.map(of_triangle).collect()
    }

    /// Lists the witnesses of a triangle that are points of the original, off its surface.
    fn candidates(&self, triangle: usize, corners: [[f32; 3]; 3], out: &mut Vec<ExtremeCandidate>) {
        out.clear();
        let corners = corners.map(|corner| corner.map(f64::from));
        let across = normal(corners);
        let doubled_sq = dot(across, across);
        if doubled_sq <= 0.0 {
            return;
        }
        let unit = scale(across, 1.0 / doubled_sq.sqrt());
        let mut id = self.head[triangle];
        while id != NONE {
            let witness = &self.input.witnesses[id as usize];
            if self.is_original(id) && witness.distance > 0.0 {
                let at = witness.at.map(f64::from);
                let weight = |k: usize| {
                    let side = [at, corners[(k + 1) % 3], corners[(k + 2) % 3]];
                    dot(normal(side), across) / doubled_sq
                };
                out.push(ExtremeCandidate {
                    witness: id,
                    weights: [weight(0), weight(1), weight(2)],
                    height: dot(unit, sub(at, corners[0])),
                });
            }
            id = witness.next;
        }
    }
}

/// Those of the candidates that are kept, at most `Extremes::MOST`.
fn chosen(candidates: &mut [ExtremeCandidate]) -> &[ExtremeCandidate] {
    let largest = candidates.iter().fold(0.0f64, |most, one| most.max(one.height.abs()));
    if candidates.len() <= Extremes::MOST || largest == 0.0 {
        return &candidates[..candidates.len().min(Extremes::MOST)];
    }
    let corner = |k: usize| std::array::from_fn(|i| if i == k { 1.0 } else { 0.0 });
    let towards = [[0.0; 3], corner(0), corner(1), corner(2)];
    let directions = towards.into_iter().flat_map(|towards| [(1.0, towards), (-1.0, towards)]);
    let mut n = 0;
    for (sign, towards) in directions {
        let score =
            |one: &ExtremeCandidate| sign * one.height / largest + dot(towards, one.weights);
        // The first of equals, so that the order of the list decides.
        let best = (0..candidates.len()).fold(0, |best, i| {
            if score(&candidates[i]) > score(&candidates[best]) { i } else { best }
        });
        if best >= n {
            candidates.swap(n, best);
            n += 1;
        }
        if n == Extremes::MOST {
            break;
        }
    }
    // Places that are left go to the farthest.
    candidates[n..]
        .sort_by(|a, b| b.height.abs().total_cmp(&a.height.abs()).then(a.witness.cmp(&b.witness)));
    &candidates[..Extremes::MOST]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_goes_on_tells_how_far_planes_are() {
        let mut state = 1u64;
        let mut next = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (state >> 40) as f64 / (1u64 << 24) as f64
        };
        let (mut sum, mut n, mut least) = (0.0, 0, 1.0f64);
        for _ in 0..200 {
            let one = |witness: u32, next: &mut dyn FnMut() -> f64| {
                let (u, v) = (next(), next());
                let [b, c] = if u + v > 1.0 { [1.0 - u, 1.0 - v] } else { [u, v] };
                let weights = [1.0 - b - c, b, c];
                ExtremeCandidate { witness, weights, height: 2.0 * next() - 1.0 }
            };
            let all: Vec<ExtremeCandidate> =
                (0..40).map(|witness| one(witness, &mut next)).collect();
            let kept = chosen(&mut all.clone()).to_vec();
            assert_eq!(kept.len(), Extremes::MOST);
            for _ in 0..20 {
                let plane = [next(), next(), next()].map(|x| 2.0 * x - 1.0);
                let farthest = |some: &[ExtremeCandidate]| {
                    let off = |one: &ExtremeCandidate| (one.height - dot(plane, one.weights)).abs();
                    some.iter().map(off).fold(0.0, f64::max)
                };
                let share = farthest(&kept) / farthest(&all);
                (sum, n, least) = (sum + share, n + 1, least.min(share));
            }
        }
        assert!(sum / f64::from(n) > 0.92 && least > 0.3, "{} {least}", sum / f64::from(n));
    }

    #[test]
    fn few_are_all_kept_and_what_lies_on_the_triangle_says_nothing() {
        let at = |height: f64| ExtremeCandidate { witness: 0, weights: [1.0, 0.0, 0.0], height };
        assert_eq!(chosen(&mut [at(0.5), at(-0.1)]).len(), 2);
        assert_eq!(chosen(&mut []).len(), 0);
        assert!(chosen(&mut [at(0.0); 9]).len() <= Extremes::MOST);
    }
}
