//! Cost and place of collapses along junction curves.
//!
//! The same as elsewhere but for the volume: normals of sheets that meet have no common side, so their sum says nothing of it.
//! The survivor is held by the planes of all sheets and, as at a boundary, the lines of the curve's edges. At attribute
//! seams the cost is that of `seam`.

use crate::cost::quadric::{self, Evaluated};
use crate::simd::Lanes;
use crate::surface::Surface;
use crate::surface::class::Class;
use crate::surface::wedges::Wedges;
use crate::vertex::Vertex;

/// Corrects those of eight edges that lead along a junction curve.
#[inline(never)]
pub(crate) fn correct<L: Lanes>(
    (surface, wedges): (&Surface, Option<&Wedges>),
    v0: &[u32; 8],
    v1: &[u32; 8],
    fixed: &[f32; 8],
    found: &mut Evaluated,
) {
    for i in 0..8 {
        let is_along = surface.rings[v0[i] as usize].class == Some(Class::Junction);
        if !is_along || wedges.is_some_and(|wedges| wedges.concern(v0[i], v1[i])) {
            continue;
        }
        let plain = |v: u32| {
            let mut vertex: Vertex = surface.vertices[v as usize];
            vertex.quadric[6..].fill(0.0);
            vertex
        };
        let (from, to) = (plain(v0[i]), plain(v1[i]));
        let one = quadric::edges::<L>([&from; 8], [&to; 8], &[fixed[i]; 8], surface.scale);
        found.cost[i] = one.cost[0];
        (0..3).for_each(|k| found.place[k][i] = one.place[k][0]);
    }
}
