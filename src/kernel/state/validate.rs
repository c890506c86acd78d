//! Checks a surface as a whole: every triangle, ring, class and wedge against the others.
//!
//! Called in builds with debug assertions after each stage that changes the topology, and after each single
//! change of it where the mesh is small. What the unchecked places of the inner loop rely on is here as code.

use crate::state::MeshState;
#[cfg(debug_assertions)]
use crate::{
    surface::{HUB, MAX_VALENCE, Surface, class::Class, fan::Fan},
    vertex::GONE,
};

/// Meshes of at most this many triangles are checked after every single change, too.
#[cfg(debug_assertions)]
const SMALL: usize = 1 << 10;

/// Panics if the surface contradicts itself; in builds without debug assertions it does nothing.
#[inline(always)]
pub(crate) fn validate(state: &MeshState) {
    #[cfg(debug_assertions)]
    if let Err(contradiction) = check(state) {
        panic!("the surface is sound: {contradiction}");
    }
    #[cfg(not(debug_assertions))]
    let _ = state;
}

/// The same for small meshes only: after a single change.
#[inline(always)]
pub(crate) fn validate_small(state: &MeshState) {
    #[cfg(debug_assertions)]
    if state.surface.triangles.len() <= SMALL {
        validate(state);
    }
    #[cfg(not(debug_assertions))]
    let _ = state;
}

/// The first contradiction found, in words.
#[cfg(debug_assertions)]
fn check(state: &MeshState) -> Result<(), String> {
    let surface = &state.surface;
    let n = surface.vertices.len();
    let lengths = [surface.rings.len(), surface.source.len()];
    if lengths != [n, n] || surface.channels.len() != n * surface.n_channels {
        return Err(format!("{n} vertices, {lengths:?} rings and sources"));
    }
    check_triangles(surface)?;
    check_rings(surface)?;
    if let Some(wedges) = &state.wedges {
        wedges.check(surface)?;
    }
    if let Some(attributes) = &state.attributes {
        attributes.check(surface)?;
    }
    Ok(())
}

/// Corners exist, differ, and are those of vertices that are not gone; the count is right.
#[cfg(debug_assertions)]
fn check_triangles(surface: &Surface) -> Result<(), String> {
    let mut n_alive = 0;
    for (id, t) in surface.triangles.iter().enumerate().filter(|(_, t)| t[0] != GONE) {
        n_alive += 1;
        if t[0] == t[1] || t[1] == t[2] || t[2] == t[0] {
            return Err(format!("triangle {id} repeats a corner: {t:?}"));
        }
        for &v in t {
            let Some(ring) = surface.rings.get(v as usize) else {
                return Err(format!("triangle {id} has a corner that does not exist: {t:?}"));
            };
            if ring.class.is_none() || ring.len == 0 {
                return Err(format!("triangle {id} has a corner that is gone: {t:?}, {ring:?}"));
            }
        }
    }
    match n_alive == surface.n_alive {
        true => Ok(()),
        false => Err(format!("{n_alive} triangles are there, {} are counted", surface.n_alive)),
    }
}

/// Rings lie in the arena apart from each other, list the triangles of their vertex, each once, and no other;
/// mergers lead to a vertex. Quadrics are numbers. The ring of a hub may list triangles that are gone.
#[cfg(debug_assertions)]
fn check_rings(surface: &Surface) -> Result<(), String> {
    let mut n_listed = vec![0u32; surface.vertices.len()];
    for t in surface.triangles.iter().filter(|t| t[0] != GONE) {
        t.iter().for_each(|&v| n_listed[v as usize] += 1);
    }
    if let Some(t) = surface.arena.iter().find(|&&t| t as usize >= surface.triangles.len()) {
        return Err(format!("the arena lists triangle {t}, which does not exist"));
    }
    let mut parts: Vec<(u32, u32, usize)> = Vec::new();
    let mut seen = Vec::new();
    for (v, ring) in surface.rings.iter().enumerate() {
        let Some(class) = ring.class else {
            // The vertex it was merged into; of later ones, as they were then.
            if ring.start as usize >= surface.vertices.len() || ring.start as usize == v {
                return Err(format!("vertex {v} was merged into {}", ring.start));
            }
            continue;
        };
        if ring.len > ring.room && ring.len > 0 {
            return Err(format!("the ring of {v} is longer than its room: {ring:?}"));
        }
        let Some(list) = surface.arena.get(ring.start as usize..(ring.start + ring.len) as usize)
        else {
            return Err(format!("the ring of {v} lies beyond the arena: {ring:?}"));
        };
        if ring.len > 0 {
            parts.push((ring.start, ring.len, v));
        }
        seen.clear();
        seen.extend_from_slice(list);
        seen.sort_unstable();
        let has_v = |t: &&u32| surface.triangles[**t as usize].contains(&(v as u32));
        let is_there = |t: &&u32| surface.triangles[**t as usize][0] != GONE;
        let alive = seen.iter().filter(is_there);
        if seen.windows(2).any(|pair| pair[0] == pair[1])
            || !alive.clone().all(|t| has_v(&t))
            || alive.clone().count() != n_listed[v] as usize
            || ring.len <= HUB && alive.count() != seen.len()
        {
            return Err(format!(
                "the ring of {v} lists {seen:?}; {} triangles have it",
                n_listed[v]
            ));
        }
        check_class(surface, v as u32, class)?;
    }
    parts.sort_unstable();
    match parts.windows(2).find(|pair| pair[0].0 + pair[0].1 > pair[1].0) {
        Some(pair) => Err(format!("the rings of {} and {} overlap", pair[0].2, pair[1].2)),
        None => Ok(()),
    }
}

/// An interior vertex has one closed fan, one of a boundary one open fan, one on a junction curve a book.
#[cfg(debug_assertions)]
fn check_class(surface: &Surface, v: u32, class: Class) -> Result<(), String> {
    let ring = surface.ring(v);
    let is_checked = matches!(class, Class::Interior | Class::Boundary | Class::Junction);
    if !is_checked || ring.is_empty() {
        return Ok(());
    }
    if ring.len() > MAX_VALENCE as usize {
        return Err(format!("vertex {v} of {} triangles is called {class:?}", ring.len()));
    }
    match Fan::new().look(surface, v) {
        found if found == class => Ok(()),
        found => Err(format!("vertex {v} is called {class:?}, but is {found:?}")),
    }
}
