//! Distances of points from the input: a walk from a vertex nearby.

use super::fan::Fans;
use super::input::BoundInput;
use crate::simd::Lanes;
use stonecut_mesh::vec3::{dot, sub};

/// Steps that a search takes from vertex to vertex.
const MAX_STEPS: usize = 16;

impl BoundInput {
    /// Place of the input near a point, found by walking downhill from a witness. The fan that it lies in is the last one.
    #[inline(always)]
    pub(super) fn nearest<L: Lanes>(
        &self,
        point: [f32; 3],
        from: u32,
        limit: f32,
        fans: &mut Fans,
    ) -> Nearest {
        let mut at = from;
        let mut best = Nearest { distance_sq: f32::INFINITY, before: 0.0 };
        for _ in 0..MAX_STEPS {
            let fan = fans.load::<L>(self, at, limit);
            let found = fan.nearest::<L>(sub(point, self.witnesses[at as usize].at));
            let is_nearer = found.distance_sq < best.distance_sq;
            if !is_nearer {
                break;
            }
            best = Nearest { distance_sq: found.distance_sq, before: found.before };
            let [b, c] = found.weights;
            if 1.0 - b - c > 0.5 {
                break;
            }
            at = found.corners[usize::from(c > b)];
        }
        if best.distance_sq.is_infinite() {
            let witness = &self.witnesses[from as usize];
            let relative = sub(point, witness.at);
            best = Nearest { distance_sq: dot(relative, relative), before: self.behind(from) };
        }
        best
    }
}

/// A place of the input that is near a point: hardly ever not the nearest.
#[derive(Clone, Copy)]
pub(super) struct Nearest {
    /// Squared, scaled.
    pub(super) distance_sq: f32,
    /// Distance of the input from the original there, scaled.
    pub(super) before: f32,
}
