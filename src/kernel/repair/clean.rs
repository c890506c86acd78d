//! Cleans a surface before anything is collapsed: repeated triangles go, and triangles without area.
//!
//! Whatever the topology policy: nothing of the surface changes by it. Of triangles over the same three
//! vertices the first stays; one that is turned over stays, too, where it belongs to another body
//! (`duplicate_triangles`). A triangle without area whose longest edge is open is dropped, and one that hangs at an edge of
//! several others; otherwise that edge is flipped, so that its neighbour is split by the vertex that lay on the edge.
//! Two corners in one place make an edge whose collapse costs nothing: that is left to the queue, which takes
//! it first. What cannot be done (no manifold neighbour, a lock, an attribute seam, a fan that would fall apart)
//! is left as found.
//!
//! Costs next to nothing where there is nothing to clean: repeats are looked for around non-manifold vertices
//! only, and building the surface notes the triangles that may be without area.

use crate::simd::Simd;
use crate::state::MeshState;
use crate::state::recompute::recompute_vertices;
use crate::surface::class::Class;
use crate::surface::fan::Fan;
use crate::surface::{MAX_VALENCE, Surface};
use crate::vertex::GONE;
use stonecut_mesh::corners::others;
use stonecut_mesh::duplicate_triangles::{Fate, Repeats, fates, from_least};
use stonecut_mesh::vec3::{dot, length_sq, normal, place_bits, sub};

/// Counts of a cleaning.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Cleaned {
    /// Triangles over the three vertices of another.
    pub(crate) duplicates: u64,
    /// Triangles without area that were dropped or flipped away.
    pub(crate) flat: u64,
}

/// Height over the longest edge, as a share of it, below which a triangle has no area: what rounding to f64
/// leaves of a vertex in the middle of an edge, far from the origin.
const FLAT: f64 = 1e-9;
/// A row of vertices on one long edge takes one pass for each of them at worst.
const PASSES: usize = 8;

/// Triangles to clean away if they have no area.
pub(crate) struct MayBeFlat<'a> {
    /// Those that may be so: all that are are among them.
    pub(crate) triangles: &'a [u32],
    /// True if boundaries that touch will be joined at attribute seams: then both sides keep their vertices.
    pub(crate) may_touch: bool,
}

/// Cleans a surface.
pub(crate) fn clean(state: &mut MeshState, flat: MayBeFlat, simd: Simd) -> Cleaned {
    let mut touched = Vec::new();
    let mut cleaned =
        Cleaned { duplicates: drop_repeats(&mut state.surface, &mut touched), flat: 0 };
    recompute_vertices(state, &mut touched, simd);
    // The wedges of a seam would have to be cut with the triangles.
    if !flat.triangles.is_empty() && state.wedges.is_none() {
        let mut waiting: Vec<u32> = flat.triangles.to_vec();
        let copies = if flat.may_touch { copies(&state.surface) } else { Vec::new() };
        for _ in 0..PASSES {
            let before = waiting.len();
            waiting.retain(|&t| match remove(&mut state.surface, t, &copies, &mut touched) {
                Outcome::Done => {
                    cleaned.flat += 1;
                    recompute_vertices(state, &mut touched, simd);
                    false
                }
                Outcome::Later => true,
                Outcome::Never => false,
            });
            if waiting.is_empty() || waiting.len() == before {
                break;
            }
        }
    }
    cleaned
}

fn drop_repeats(surface: &mut Surface, touched: &mut Vec<u32>) -> u64 {
    if surface.has_walls {
        return 0;
    }
    let mut known: Vec<([u32; 3], u32)> = Vec::new();
    for v in 0..surface.vertices.len() as u32 {
        if !surface.rings[v as usize].class.is_some_and(Class::is_non_manifold) {
            continue;
        }
        for &t in surface.ring(v) {
            let mut corners = surface.triangles[t as usize];
            corners.sort_unstable();
            known.push((corners, t));
        }
    }
    known.sort_unstable();
    known.dedup();
    let corners = |t: u32| from_least(surface.triangles[t as usize]);
    let mut found = Repeats::default();
    found.add(&known, corners);
    let Repeats { same: mut repeats, reversed } = found;
    if !reversed.is_empty() {
        let is_known = |v: u32| surface.rings[v as usize].class.is_some_and(Class::is_non_manifold);
        let turned: Vec<[u32; 3]> = reversed.iter().map(|&t| corners(t)).collect();
        let mut all: Vec<u32> = known.iter().map(|&(_, t)| t).collect();
        all.sort_unstable();
        let mut sorted = repeats.clone();
        sorted.sort_unstable();
        all.retain(|t| sorted.binary_search(t).is_err());
        let n_alive = surface.n_alive as usize;
        let fates = fates(&turned, n_alive, all.into_iter().map(corners), is_known);
        let gone = reversed.iter().zip(fates).filter(|(_, fate)| *fate != Fate::Stays);
        repeats.extend(gone.map(|(&t, _)| t));
    }
    repeats.iter().for_each(|&t| drop_triangle(surface, t, touched));
    repeats.len() as u64
}

fn drop_triangle(surface: &mut Surface, t: u32, touched: &mut Vec<u32>) {
    let corners = surface.triangles[t as usize];
    corners.into_iter().for_each(|v| surface.remove_from_ring(v, t));
    touched.extend(corners);
    surface.triangles[t as usize][0] = GONE;
    surface.n_alive -= 1;
}

enum Outcome {
    Done,
    /// Not while a neighbour is flat too.
    Later,
    Never,
}

/// The longest edge of a flat triangle and the corner between its ends: (from, to, middle) in its sense of
/// rotation. `None` if it has an area, or two corners in one place.
fn longest_edge(surface: &Surface, t: u32) -> Option<[u32; 3]> {
    let corners = surface.triangles[t as usize];
    if corners[0] == GONE {
        return None;
    }
    let first = surface.vertices[corners[0] as usize].position;
    let places = corners.map(|v| {
        let relative = sub(surface.vertices[v as usize].position, first);
        relative.map(|x| x * surface.scale)
    });
    let length_of = |i: usize| length_sq(sub(places[(i + 1) % 3], places[i]));
    let longest = (0..3).max_by(|&i, &j| length_of(i).total_cmp(&length_of(j))).unwrap_or(0);
    let longest_sq = length_of(longest);
    let n = normal(places);
    let is_flat = dot(n, n).sqrt() <= FLAT * longest_sq;
    if !is_flat || (0..3).any(|i| length_of(i) == 0.0) {
        return None;
    }
    let at = |i: usize| corners[(longest + i) % 3];
    Some([at(0), at(1), at(2)])
}

/// Vertices that are not the only ones in their place, in order.
fn copies(surface: &Surface) -> Vec<u32> {
    let mut open: Vec<([u64; 3], u32)> = (0..surface.vertices.len() as u32)
        .filter(|&v| surface.rings[v as usize].class != Some(Class::Interior))
        .map(|v| (place_bits(surface.vertices[v as usize].position), v))
        .collect();
    open.sort_unstable();
    let several = open.chunk_by(|a, b| a.0 == b.0).filter(|same| same.len() > 1);
    let mut copies: Vec<u32> = several.flatten().map(|&(_, v)| v).collect();
    copies.sort_unstable();
    copies
}

/// Takes a triangle without area out of the surface; not where all its corners have `copies`.
fn remove(surface: &mut Surface, t: u32, copies: &[u32], touched: &mut Vec<u32>) -> Outcome {
    let Some([a, b, middle]) = longest_edge(surface, t) else { return Outcome::Never };
    let class = |v: u32| surface.rings[v as usize].class;
    if [a, b, middle].into_iter().any(|v| surface.rings[v as usize].len > MAX_VALENCE) {
        return Outcome::Never;
    }
    let across: Vec<u32> = (surface.ring(a).iter().copied())
        .filter(|&u| u != t && surface.triangles[u as usize].contains(&b))
        .collect();
    let neighbours = |v: u32, w: u32| {
        surface.ring(v).iter().filter(|&&u| surface.triangles[u as usize].contains(&w)).count()
    };
    let hangs = |v: u32| neighbours(v, middle) == 1;
    let [u] = across[..] else {
        if across.len() > 1 && class(middle) != Some(Class::Locked) && hangs(a) && hangs(b) {
            drop_triangle(surface, t, touched);
            return Outcome::Done;
        }
        // Open on this side; where a lock is at either end, another cell may lie behind the edge.
        let is_free = class(a) != Some(Class::Locked) || class(b) != Some(Class::Locked);
        let is_last = |v: u32| class(v) == Some(Class::Locked) && surface.ring(v).len() == 1;
        // Between others of an open fan it holds them together.
        let is_held = neighbours(a, middle) > 1
            && neighbours(b, middle) > 1
            && Fan::new().look(surface, middle) != Class::Interior;
        let is_loose =
            !surface.has_walls && is_free && !is_held && ![a, b, middle].into_iter().any(is_last);
        let touches = [a, b, middle].iter().all(|v| copies.binary_search(v).is_ok());
        if across.is_empty() && is_loose && !touches {
            drop_triangle(surface, t, touched);
            return Outcome::Done;
        }
        return Outcome::Never;
    };
    let (next, opposite) = others(surface.triangles[u as usize], b);
    if next != a || opposite == middle {
        return Outcome::Never;
    }
    if longest_edge(surface, u).is_some() {
        return Outcome::Later;
    }
    let is_one_fan = |v: u32| !class(v).is_some_and(Class::is_non_manifold);
    let is_joined = |v: u32, w: u32| {
        surface.ring(v).iter().any(|&t| surface.triangles[t as usize].contains(&w))
    };
    let would_thin = |v: u32| class(v) == Some(Class::Interior) && surface.ring(v).len() <= 3;
    let both_locked =
        class(middle) == Some(Class::Locked) && class(opposite) == Some(Class::Locked);
    if ![a, b, middle, opposite].into_iter().all(is_one_fan)
        || would_thin(a)
        || would_thin(b)
        || both_locked
        || surface.rings[opposite as usize].len >= MAX_VALENCE
        || is_joined(middle, opposite)
    {
        return Outcome::Never;
    }
    surface.triangles[t as usize] = [middle, a, opposite];
    surface.triangles[u as usize] = [opposite, b, middle];
    surface.remove_from_ring(b, t);
    surface.remove_from_ring(a, u);
    for (v, t) in [(opposite, t), (middle, u)] {
        let mut ring = surface.ring(v).to_vec();
        ring.push(t);
        surface.set_ring(v, &ring);
    }
    touched.extend([a, b, middle, opposite]);
    Outcome::Done
}
