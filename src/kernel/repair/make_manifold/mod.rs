//! Makes the surface manifold where it can be: joins boundaries that touch, takes sheets apart that only
//! share a vertex or an edge, drops triangles that are there twice.
//!
//! Under `Topology::Error` only, and only around the affected vertices: non-manifold ones, and boundary
//! vertices in the place of another. So a clean scan, or one with open edges alone, costs nothing. Half-edges
//! are paired first: those that belong together already, then those of opposite direction whose ends coincide,
//! the flattest first. The corners that hang together over pairs become one vertex each; so no vertex has two
//! fans. Where that would repeat a directed edge, or where neighbours disagree in orientation, all is left as
//! found. Wedges of seams that sheets share are copied. Locked vertices stay what they are. Memory: 9 bytes a vertex, 40 an affected triangle.
//!
//! Source: cutting and stitching after Gueziec et al. 1998 (docs/references.md).

mod half_edges;
mod places;
mod vertices;

pub(crate) use vertices::Mended;

use crate::options::MAX_VERTICES;
use crate::simd::Simd;
use crate::state::MeshState;
use crate::surface::Surface;
use crate::surface::class::Class;
use crate::vertex::GONE;
use half_edges::{PairingState, Patch};
use places::{NONE, Places};
use stonecut_mesh::duplicate_triangles::{Repeats, from_least};
use stonecut_mesh::union_find::Union;
use vertices::VertexPlan;

/// Share of affected triangles (one in this many) above which the surface is built again as a whole.
const REBUILD_SHARE: usize = 4;

/// Mends a surface. New vertices take over `spare` sources; sources of vertices that go are added to it.
/// Sorts what touches an affected vertex, nothing else.
pub(crate) fn mend(state: &mut MeshState, spare: &mut Vec<u32>, simd: Simd) -> Mended {
    let has_seams = state.wedges.is_some();
    let surface = &mut state.surface;
    let Some(mut places) = Places::new(surface, has_seams) else { return Mended::default() };
    let mut touched = Vec::new();
    let duplicates = drop_duplicates(surface, &mut places, &mut touched);
    let mut mended = Mended { duplicates, ..Mended::default() };
    let patch = Patch::new(surface, places);
    let mut known = PairingState::new(&patch);
    let mut corners = Union::default();
    let mut scratch = vec![NONE; surface.vertices.len()];
    let mut plan;
    // Beside wedges, which have the sources, vertices need none.
    let n_spare = if state.wedges.is_some() { MAX_VERTICES as usize } else { spare.len() };
    loop {
        patch.pair_up(surface, &mut corners, &known, &mut scratch);
        plan = VertexPlan::new(surface, &patch, &mut corners, n_spare, &mut scratch);
        if !plan.has_conflicts(&patch, &mut known) {
            break;
        }
    }
    let parting = state.wedges.as_ref().map(|wedges| wedges.part(&patch.triangles, &plan.vertex));
    if let Some(parting) = parting.as_ref().filter(|parting| parting.n_new > spare.len()) {
        plan = VertexPlan::as_found(&patch, (parting.n_new - spare.len()) as u64);
    }
    mended.missing = plan.missing;
    if plan.is_idle() && mended.duplicates == 0 {
        return mended;
    }
    let wedges = state.wedges.as_deref_mut().filter(|_| !plan.is_idle());
    if let (Some(wedges), Some(parting)) = (wedges, &parting) {
        wedges.parted(parting, spare);
    }
    plan.carry_out(state, &patch, spare, &mut mended);
    let is_large = patch.triangles.len() > state.surface.triangles.len() / REBUILD_SHARE;
    if is_large && state.wedges.is_none() {
        drop((patch, corners, known, scratch));
        mended.rebuilt = Some(state.compact(simd));
    } else {
        plan.rewire(state, &patch, touched, simd);
    }
    mended
}

/// Of triangles over the same three places in the same sense of rotation, only the first stays, and any that is the last
/// of a locked vertex. Their corners are added to `touched`.
fn drop_duplicates(surface: &mut Surface, places: &mut Places, touched: &mut Vec<u32>) -> u64 {
    // The sense is part of the key, so that none comes out as turned over.
    let oriented = |surface: &Surface, places: &Places, t: u32| {
        from_least(surface.triangles[t as usize].map(|v| places.place[v as usize]))
    };
    // Two of them that have two corners in common make an edge, and both its ends, non-manifold; where they
    // have fewer, the others share their places.
    let mut known: Vec<([u32; 3], u32)> = places
        .triangles(surface, 2)
        .into_iter()
        .map(|t| (oriented(surface, places, t), t))
        // Over two places only there may be triangles of several sheets.
        .filter(|([a, b, c], _)| a != b && b != c && c != a)
        .collect();
    known.sort_unstable();
    let mut found = Repeats::default();
    found.add(&known, |t| oriented(surface, places, t));
    let mut n = 0;
    for &t in &found.same {
        // Another cell knows a locked vertex, so it keeps its last triangle.
        let is_last = |v: u32| {
            let ring = &surface.rings[v as usize];
            ring.class == Some(Class::Locked) && ring.len == 1
        };
        if surface.triangles[t as usize].into_iter().any(is_last) {
            continue;
        }
        n += 1;
        for v in surface.triangles[t as usize] {
            surface.remove_from_ring(v, t);
            // Its fan is open now, or falls into several.
            let class = &mut surface.rings[v as usize].class;
            if *class != Some(Class::Locked) {
                *class = Some(Class::Complex);
                places.is_affected[v as usize] = true;
            }
        }
        touched.extend(surface.triangles[t as usize]);
        surface.triangles[t as usize][0] = GONE;
        surface.n_alive -= 1;
    }
    n
}
