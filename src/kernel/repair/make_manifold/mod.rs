//! Makes the surface manifold where it can be: joins boundaries that touch, takes sheets apart that only
//! share a vertex or an edge, drops triangles that are there twice.
//!
//! Under `Topology::Error` only, and only around the vertices concerned: non-manifold ones, and boundary
//! vertices in the place of another. So a clean scan, or one with open edges alone, costs nothing. Half-edges
//! are paired first: those that belong together already, then those of opposite direction whose ends coincide,
//! the flattest first. The corners that hang together over pairs become one vertex each; so no vertex has two
//! fans. Where that would repeat a directed edge, or where neighbours disagree in orientation, all is left as
//! found. Locked vertices stay what they are. Memory: 9 bytes a vertex, 40 a triangle concerned.
//!
//! Source: cutting and stitching after Gueziec et al. 1998 (docs/references.md).

mod half_edges;
mod vertices;

use crate::kernel::collapse::legality::Class;
use crate::kernel::repair::duplicate_triangles::{Repeats, from_least};
use crate::kernel::simd::Simd;
use crate::kernel::surface::{GONE, Surface};
use crate::mesh::union_find::Union;
use half_edges::{Known, Patch};
use vertices::Plan;

/// Where more than one in so many triangles is concerned, the surface is built anew.
const REBUILD_SHARE: usize = 4;

/// What was mended.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Mended {
    /// Vertices that became one with another in the same place.
    pub(crate) joined: u64,
    /// Vertices that were made of one with several fans.
    pub(crate) split: u64,
    /// Triangles that were there twice.
    pub(crate) duplicates: u64,
    /// Vertices that would have to be made, but there was no source for them yet.
    pub(crate) missing: u64,
    /// If the whole surface was built anew, with stamps from zero: the new number of each vertex, or `GONE`.
    pub(crate) rebuilt: Option<Vec<u32>>,
}

/// Mends a surface. New vertices take over `spare` sources; sources of vertices that go are added to it.
/// Sorts what touches a vertex concerned, nothing else.
pub(crate) fn mend(surface: &mut Surface, spare: &mut Vec<u32>, simd: Simd) -> Mended {
    let Some(mut places) = Places::new(surface) else { return Mended::default() };
    let mut touched = Vec::new();
    let duplicates = drop_duplicates(surface, &mut places, &mut touched);
    let mut mended = Mended { duplicates, ..Mended::default() };
    let patch = Patch::new(surface, places);
    let mut known = Known::new(&patch);
    let mut corners = Union::default();
    let mut scratch = vec![NONE; surface.vertices.len()];
    let mut plan;
    loop {
        patch.pair_up(surface, &mut corners, &known, &mut scratch);
        plan = Plan::new(surface, &patch, &mut corners, spare.len(), &mut scratch);
        if !patch.has_conflicts(&plan, &mut known) {
            break;
        }
    }
    mended.missing = plan.missing;
    if plan.is_idle() && mended.duplicates == 0 {
        return mended;
    }
    plan.carry_out(surface, &patch, spare, &mut mended);
    if patch.triangles.len() > surface.triangles.len() / REBUILD_SHARE {
        drop((patch, corners, known, scratch));
        mended.rebuilt = Some(surface.compact(simd));
    } else {
        plan.rewire(surface, &patch, touched, simd);
    }
    mended
}

const NONE: u32 = u32::MAX;

/// Which vertices lie in the same place, and which are to be looked at.
struct Places {
    /// For each vertex the first one in exactly the same place, if both are open; else itself.
    place: Vec<u32>,
    /// Non-manifold vertices, and open ones that share their place. All others stay what they are: one fan.
    is_concerned: Vec<bool>,
}

impl Places {
    /// `None` if no vertex is concerned.
    fn new(surface: &Surface) -> Option<Self> {
        // Adding 0 makes -0 and 0 the same place.
        let at = |v: usize| surface.vertices[v].position.map(|x| (x + 0.0).to_bits());
        let is_complex = |v: u32| surface.rings[v as usize].class == Some(Class::Complex);
        let mut open: Vec<([u64; 3], u32)> = Vec::new();
        for (v, ring) in surface.rings.iter().enumerate() {
            if ring.len > 0 && matches!(ring.class, Some(Class::Boundary | Class::Complex)) {
                open.push((at(v), v as u32));
            }
        }
        open.sort_unstable();
        let groups = || open.chunk_by(|a, b| a.0 == b.0);
        if groups().all(|same| same.len() == 1 && !is_complex(same[0].1)) {
            return None;
        }
        let mut place: Vec<u32> = (0..surface.vertices.len() as u32).collect();
        let mut is_concerned = vec![false; surface.vertices.len()];
        for same in groups() {
            for &(_, v) in same {
                place[v as usize] = same[0].1;
                is_concerned[v as usize] = same.len() > 1 || is_complex(v);
            }
        }
        Some(Places { place, is_concerned })
    }

    /// Triangles, ascending, of which at least `least` corners are concerned.
    fn triangles(&self, surface: &Surface, least: usize) -> Vec<u32> {
        let is_met = |t: &[u32; 3]| {
            t[0] != GONE && t.iter().filter(|&&v| self.is_concerned[v as usize]).count() >= least
        };
        let all = surface.triangles.iter().enumerate();
        all.filter(|(_, t)| is_met(t)).map(|(id, _)| id as u32).collect()
    }
}

/// Of triangles over the same three places in the same sense of rotation, only the first stays. Their corners
/// are added to `touched`.
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
    for &t in &found.same {
        for v in surface.triangles[t as usize] {
            surface.remove_from_ring(v, t);
            // Its fan is open now, or falls into several.
            let class = &mut surface.rings[v as usize].class;
            if *class != Some(Class::Locked) {
                *class = Some(Class::Complex);
                places.is_concerned[v as usize] = true;
            }
        }
        touched.extend(surface.triangles[t as usize]);
        surface.triangles[t as usize][0] = GONE;
        surface.n_alive -= 1;
    }
    found.same.len() as u64
}
