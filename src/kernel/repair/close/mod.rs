//! Fills holes: boundary loops up to a size get triangles between their own vertices.
//!
//! Only loops of free boundary vertices off attribute seams; what other cells know, and where sheets only touch, stays open. Of
//! nested loops in one plane, as the wall of a tube leaves them where a scan ends, the inner one becomes a hole in the filling of
//! the outer one. A filling that meets other triangles is tried again without those of its triangles that do.

pub(crate) mod crumbs;
pub(crate) mod excise;
mod polygon;
mod rims;

use crate::crossing::Crossings;
use crate::simd::Simd;
use crate::state::MeshState;
use crate::state::recompute::recompute_vertices;
use crate::surface::Surface;
use crate::vertex::GONE;
use polygon::{Forbidden, LeastWeights};
use rims::{Rim, parents, place};
use std::collections::BTreeSet;
use stonecut_mesh::bounds::Bounds;
use stonecut_mesh::vec3::{Vec3, add as add_vec, scale};

/// Loops of more edges are left open: triangulating them takes the square of that.
const MOST_EDGES: usize = 1 << 14;
/// Attempts at a filling that meets nothing, and the most corners of a loop that is filled by least area, which takes the third power
/// of that.
struct Effort {
    attempts: usize,
    most_by_area: usize,
}

const FIRST: Effort = Effort { attempts: 12, most_by_area: 100 };
const LAST: Effort = Effort { attempts: 40, most_by_area: 200 };
/// Shares of its size by which a loop moves outwards, tried in turn, and the most of them as a share of the surface's extent.
const STEPS_OUT: [f64; 7] = [0.0025, 0.005, 0.01, 0.02, 0.05, 0.1, 0.25];
const MOST_MOVED: f64 = 0.01;

/// Holes that were filled.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct FilledHoles {
    pub(crate) holes: u64,
    pub(crate) triangles: u64,
    /// Fillings that were tried.
    pub(crate) attempts: u64,
}

/// Holes that are open.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct OpenHoles {
    pub(crate) holes: u64,
    /// Of these, the larger ones.
    pub(crate) large: u64,
    /// LeastWeights of holes that end at vertices of other cells or at others that are held.
    pub(crate) parts: u64,
}

/// Counts what is open.
pub(crate) fn open(state: &MeshState, size: f64) -> OpenHoles {
    let (rims, parts) = rims::find(state, |_| false);
    let large = rims.iter().filter(|rim| rim.size > size).count() as u64;
    OpenHoles { holes: rims.len() as u64, large, parts }
}

/// Fills the holes whose box has at most this diagonal, in input units. Where a filling would meet the surface, the loop moves
/// outwards if it `yields`, by little.
pub(crate) fn close(state: &mut MeshState, size: f64, yields: bool, simd: Simd) -> FilledHoles {
    let is_seam = |v: u32| state.wedges.as_ref().is_some_and(|wedges| wedges.is_seam(v));
    let (mut rims, _) = rims::find(state, is_seam);
    rims.retain(|rim| rim.size <= size && rim.ring.len() <= MOST_EDGES);
    let mut filled = FilledHoles::default();
    if rims.is_empty() {
        return filled;
    }
    // Largest first, so that what lies in a loop comes after it.
    rims.sort_by(|a, b| b.area().total_cmp(&a.area()).then(a.ring.cmp(&b.ring)));
    let parent = parents(&state.surface, &rims);
    let mut crossings = Crossings::new(&state.surface, simd);
    let most = if yields { MOST_MOVED * bounds(&state.surface).diagonal() } else { 0.0 };
    for (i, rim) in rims.iter().enumerate().filter(|&(i, _)| parent[i].is_none()) {
        let inner: Vec<&Rim> =
            (i + 1..rims.len()).filter(|&k| parent[k] == Some(i)).map(|k| &rims[k]).collect();
        if fill(state, &mut crossings, (rim, &inner), most, &mut filled) {
            filled.holes += 1 + inner.len() as u64;
            continue;
        }
        // Each alone, where all together does not do.
        for rim in inner {
            filled.holes += u64::from(fill(state, &mut crossings, (rim, &[]), 0.0, &mut filled));
        }
    }
    let mut touched: Vec<u32> = rims.into_iter().flat_map(|rim| rim.ring).collect();
    if let Some(wedges) = &mut state.wedges {
        wedges.look_at(&mut state.surface, &touched);
    }
    recompute_vertices(state, &mut touched, simd);
    filled
}

/// The box of the surface.
fn bounds(surface: &Surface) -> Bounds {
    let mut bounds = Bounds::EMPTY;
    let all = surface.triangles.iter().filter(|t| t[0] != GONE).flatten();
    all.for_each(|&v| bounds.add(place(surface, v)));
    bounds
}

/// Fills one loop around others; false if that cannot be without passing through the surface. Where it cannot, all of them may move
/// outwards by at most this length, if no triangle at them comes to meet others by that.
fn fill(
    state: &mut MeshState,
    crossings: &mut Crossings,
    (rim, inner): (&Rim, &[&Rim]),
    most: f64,
    filled: &mut FilledHoles,
) -> bool {
    let Some(ring) = polygon::bridged(&state.surface, rim, inner) else { return false };
    let mut polygon = BridgedLoop { ring, rim, parts: None };
    if polygon.fill(state, crossings, FIRST, filled) {
        return true;
    }
    let steps = STEPS_OUT.map(|share| share * rim.size).into_iter();
    let mut steps = steps.take_while(|step| *step <= most && rim.area() > 0.0).peekable();
    if steps.peek().is_none() {
        return false;
    }
    let corners: Vec<u32> =
        [rim].iter().chain(inner).flat_map(|rim| rim.ring.iter().copied()).collect();
    let places: Vec<Vec3> = corners.iter().map(|&v| place(&state.surface, v)).collect();
    let mut around: Vec<u32> =
        corners.iter().flat_map(|&v| state.surface.ring(v).iter().copied()).collect();
    around.sort_unstable();
    around.dedup();
    let n_met = crossings.before(&state.surface, &around);
    for step in steps {
        for (&v, &from) in corners.iter().zip(&places) {
            let to = add_vec(from, scale(rim.normal, step / rim.area()));
            state.surface.vertices[v as usize].position = state.surface.rounded(to);
        }
        crossings.moved(&state.surface, &around);
        if crossings.before(&state.surface, &around) <= n_met
            && polygon.fill(state, crossings, LAST, filled)
        {
            return true;
        }
    }
    for (&v, &from) in corners.iter().zip(&places) {
        state.surface.vertices[v as usize].position = from;
    }
    crossings.moved(&state.surface, &around);
    false
}

/// A loop, with a way to each of those within it and back, and the parts of it, once they are known.
struct BridgedLoop<'a> {
    ring: Vec<u32>,
    rim: &'a Rim,
    parts: Option<LeastWeights>,
}

impl BridgedLoop<'_> {
    /// Fills it where it lies now; false if that cannot be without passing through the surface.
    fn fill(
        &mut self,
        state: &mut MeshState,
        crossings: &mut Crossings,
        effort: Effort,
        filled: &mut FilledHoles,
    ) -> bool {
        let BridgedLoop { ring, rim, parts } = self;
        let surface = &state.surface;
        let mut forbidden = Forbidden::new();
        let mut parts = (3 < ring.len() && ring.len() <= effort.most_by_area)
            .then(|| parts.get_or_insert_with(|| LeastWeights::new(surface, ring)).clone());
        for _ in 0..effort.attempts {
            filled.attempts += 1;
            let triangles = match (&ring[..], &mut parts) {
                (&[a, b, c], _) => {
                    Some(vec![[a, b, c]]).filter(|t| !forbidden.contains(&polygon::sorted(t[0])))
                }
                (_, Some(parts)) => polygon::by_area(ring, &forbidden, parts),
                (_, None) => polygon::by_ears(surface, ring, rim, &forbidden),
            };
            let Some(triangles) = triangles.filter(|t| is_sound(surface, t)) else { break };
            if let Some(bad) = crossings.first_to_meet(surface, &triangles) {
                forbidden.insert(polygon::sorted(triangles[bad]));
                continue;
            }
            filled.triangles += triangles.len() as u64;
            add(state, &triangles);
            crossings.extend(&state.surface);
            return true;
        }
        false
    }
}

/// True if no side is there twice the same way round, here or in the surface.
fn is_sound(surface: &Surface, triangles: &[[u32; 3]]) -> bool {
    let sides = || triangles.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]);
    let own: BTreeSet<[u32; 2]> = sides().collect();
    let is_there = |[a, b]: [u32; 2]| {
        let mut around = surface.ring(a).iter().map(|&t| surface.triangles[t as usize]);
        around.any(|t| (0..3).any(|k| t[k] == a && t[(k + 1) % 3] == b))
    };
    // An inner side has its other triangle in the filling, a side of the rim in the surface.
    own.len() == 3 * triangles.len()
        && sides().all(|[a, b]| !is_there([a, b]) && own.contains(&[b, a]) != is_there([b, a]))
}

/// Adds triangles to the surface, to their wedges and to the rings of their corners.
fn add(state: &mut MeshState, triangles: &[[u32; 3]]) {
    let MeshState { surface, wedges, .. } = state;
    if let Some(wedges) = wedges {
        let wedge = |v: u32| wedges.at(surface, surface.ring(v)[0], v);
        let corners: Vec<[u32; 3]> = triangles.iter().map(|t| t.map(wedge)).collect();
        wedges.corner.extend(corners);
    }
    let first = surface.triangles.len() as u32;
    surface.triangles.extend(triangles);
    surface.n_alive += triangles.len() as u64;
    let mut corners: Vec<(u32, u32)> =
        triangles.iter().zip(first..).flat_map(|(t, id)| t.map(|v| (v, id))).collect();
    corners.sort_unstable();
    for new in corners.chunk_by(|a, b| a.0 == b.0) {
        let mut ring = surface.ring(new[0].0).to_vec();
        ring.extend(new.iter().map(|&(_, id)| id));
        surface.set_ring(new[0].0, &ring);
    }
}
