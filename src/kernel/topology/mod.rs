//! Changes of topology, priced like collapses: small components vanish, thin tubes are cut.
//!
//! Called when a collapse was refused for the sake of topology under `Topology::Error`. The price of a change is
//! what a collapse may cost that makes as much squared error for each triangle that it sets free; a change
//! happens when collapses cost as much. Locked, boundary and non-manifold vertices are never touched by a
//! cut, locked ones by nothing. No change leaves a component that was not there before.
//!
//! docs/algorithm.md, section 6, has the prices.

pub(crate) mod components;
pub(crate) mod cut;
pub(crate) mod separation;

use crate::collapse::collapser::Collapser;
use crate::surface::Surface;
use crate::surface::class::Class;
use crate::topology::separation::{Separation, Side, separation_far, separation_near};
use crate::vertex::GONE;
use std::collections::HashSet;
use stonecut_mesh::corners::others;
use stonecut_mesh::vec3::{length_sq, normal, sub, triangle_distance_sq};

/// Cost of the dearest collapse over the squared error, integrated over the surface, that a collapse adds at that
/// moment. Measured at the end of ten runs on five meshes: 13.4 to 18, most near 14
/// (docs/design/kernel.md, "One currency").
const COST_PER_ERROR: f64 = 14.0;
/// A collapse sets two triangles free.
const FREED_BY_COLLAPSE: f64 = 2.0;
/// A removal makes an error on one side of a two-sided measure only; collapses make it on both.
const ONE_SIDE: f64 = 0.5;
/// Squared side of an equilateral triangle over the mean squared distance of its points from the nearest side.
const SIDE_SQ_OVER_DEPTH_SQ: f64 = 72.0;
/// A cut handle sets free what a collapse does, as far as is known: what goes later pays for itself.
const FREED_BY_HANDLE: usize = 2;
/// Components of more triangles than this do not vanish: collapses have work to do there first.
pub const MAX_SPECK: usize = 24;
/// The same once components on which collapses are stuck may vanish. Those of the legion of honor have up to 120.
pub(crate) const MAX_STUCK: usize = 1024;

/// Change of topology after a rejection.
pub(crate) enum TopologyChange {
    /// The component around a vertex may vanish: all of its triangles.
    Vanish(Vec<u32>),
    /// The surface may be cut along this triangle of edges and both ends capped.
    Cut([u32; 3]),
}

/// Cost of a collapse that is as dear as a change which makes an error on one side, in scaled units, and
/// sets `n_freed` triangles free.
pub(crate) fn price(error: f64, n_freed: usize) -> f32 {
    (COST_PER_ERROR * ONE_SIDE * error * FREED_BY_COLLAPSE / n_freed.max(1) as f64) as f32
}

/// The inverse of `price`: the error that a change may make which collapses of this cost pay for.
pub(crate) fn error_worth(cost: f32, n_freed: usize) -> f64 {
    f64::from(cost) * n_freed.max(1) as f64 / (COST_PER_ERROR * ONE_SIDE * FREED_BY_COLLAPSE)
}

/// Finds a change of topology for a rejected collapse of `v0` into `v1`. A component of at most `most` triangles may
/// vanish.
pub(crate) fn find_change(
    surface: &Surface,
    (v0, v1): (u32, u32),
    collapser: &Collapser,
    most: usize,
) -> Option<TopologyChange> {
    let speck = match most {
        0 => None,
        1..=MAX_SPECK => speck(surface, v0),
        most => stuck(surface, v0, most),
    };
    if let Some(speck) = speck {
        return Some(TopologyChange::Vanish(speck));
    }
    let w = collapser.common_neighbour(surface)?;
    let inner = |v: u32| surface.rings[v as usize].class == Some(Class::Interior);
    if !(inner(v0) && inner(v1) && inner(w)) {
        return None;
    }
    // Around a vertex of three triangles the cut would only strip that vertex off.
    let cycle = [v0, v1, w];
    for (i, &v) in cycle.iter().enumerate() {
        let (next, prev) = (cycle[(i + 1) % 3], cycle[(i + 2) % 3]);
        for (from, to) in [(next, prev), (prev, next)] {
            let (mut n, mut first) = (0, GONE);
            each_of_sector(surface, v, from, to, |t| {
                if n == 0 {
                    first = t;
                }
                n += 1;
            })?;
            if n == 2 {
                let middle = others(surface.triangles[first as usize], v).1;
                if surface.rings[middle as usize].len == 3 {
                    return None;
                }
            }
        }
    }
    Some(TopologyChange::Cut(cycle))
}

/// A cut along three edges, planned and priced in scaled units.
pub(crate) enum CutPlan {
    /// Strips these triangles off, which vanish, at this cost. The farthest corner is as far from the cut, squared.
    Strip(Vec<u32>, f32, f64),
    /// Opens a handle, or separates too much to be made; at this cost in the first case. `opens_handle` tells.
    Handle(f32, Box<[Side; 2]>),
}

/// Squared error of the cap of a cut, in scaled units^4: it is as far from the original as the points of a
/// triangle are from its sides.
fn cap_error(surface: &Surface, cycle: [u32; 3]) -> f64 {
    let corners = cycle.map(|v| surface.edge(cycle[0], v).map(f64::from));
    let area = 0.5 * length_sq(normal(corners)).sqrt();
    let sides_sq = (0..3).map(|i| length_sq(sub(corners[i], corners[(i + 1) % 3])));
    area * sides_sq.fold(0.0, f64::max) / SIDE_SQ_OVER_DEPTH_SQ
}

/// The least that a cut along three edges can cost, in scaled units, whatever it does.
pub(crate) fn least_cut_cost(surface: &Surface, cycle: [u32; 3]) -> f32 {
    price(cap_error(surface, cycle), MAX_SPECK - 1)
}

/// Finds out what a cut along three edges would do, and its cost; `None` if it must not be.
///
/// A handle is capped twice. What a cut would separate must vanish with it, and is as far from what stays as
/// from the cut.
pub(crate) fn plan_cut(surface: &Surface, cycle: [u32; 3]) -> Option<CutPlan> {
    let side = |turned: bool| -> Option<Side> {
        let mut lists: Side = Default::default();
        for (i, list) in lists.iter_mut().enumerate() {
            let (next, prev) = (cycle[(i + 1) % 3], cycle[(i + 2) % 3]);
            let (from, to) = if turned { (prev, next) } else { (next, prev) };
            *list = sector(surface, cycle[i], from, to)?;
        }
        Some(lists)
    };
    let sides = [side(false)?, side(true)?];
    match separation_near(surface, cycle, &sides) {
        Separation::None | Separation::Unknown => {
            let cost = price(2.0 * cap_error(surface, cycle), FREED_BY_HANDLE);
            Some(CutPlan::Handle(cost, Box::new(sides)))
        }
        Separation::Part(triangles) if triangles.len() <= MAX_SPECK => {
            let corners = cycle.map(|v| surface.edge(cycle[0], v).map(f64::from));
            let (mut error, mut farthest_sq) = (cap_error(surface, cycle), 0.0f64);
            for &t in &triangles {
                let t = surface.triangles[t as usize].map(|v| surface.edge(cycle[0], v));
                let t = t.map(|corner| corner.map(f64::from));
                let area = 0.5 * length_sq(normal(t)).sqrt();
                for p in t {
                    let distance_sq = triangle_distance_sq(p, corners);
                    error += area * distance_sq / 3.0;
                    farthest_sq = farthest_sq.max(distance_sq);
                }
            }
            let cost = price(error, triangles.len() - 1);
            Some(CutPlan::Strip(triangles, cost, farthest_sq))
        }
        Separation::Part(_) => None,
    }
}

/// True if a cut along three edges leaves the surface in one piece. A long search: only once the cut is due.
pub(crate) fn opens_handle(surface: &Surface, cycle: [u32; 3], sides: &[Side; 2]) -> bool {
    matches!(separation_far(surface, cycle, sides), Separation::None)
}

/// All triangles that hang together with a vertex, if they are few and none is locked.
fn speck(surface: &Surface, start: u32) -> Option<Vec<u32>> {
    // Each triangle of a component is in three rings.
    const MOST_CORNERS: u32 = 3 * MAX_SPECK as u32;
    let mut vertices = [start; MOST_CORNERS as usize];
    let mut n = 1;
    let mut n_corners = surface.rings[start as usize].len;
    let mut next = 0;
    while next < n {
        let v = vertices[next];
        next += 1;
        if surface.rings[v as usize].class == Some(Class::Locked) || n_corners > MOST_CORNERS {
            return None;
        }
        for &t in surface.ring(v) {
            for w in surface.triangles[t as usize] {
                if !vertices[..n].contains(&w) {
                    n_corners += surface.rings[w as usize].len.max(1);
                    if n_corners > MOST_CORNERS {
                        return None;
                    }
                    vertices[n] = w;
                    n += 1;
                }
            }
        }
    }
    let mut triangles = Vec::new();
    for &v in &vertices[..n] {
        // Each comes up once as that of its first corner.
        let of_v = surface.ring(v).iter().filter(|&&t| surface.triangles[t as usize][0] == v);
        triangles.extend(of_v);
    }
    (!triangles.is_empty()).then_some(triangles)
}

/// The same for more triangles, at most `most`.
fn stuck(surface: &Surface, start: u32, most: usize) -> Option<Vec<u32>> {
    let mut seen = HashSet::from([start]);
    let (mut vertices, mut triangles) = (vec![start], Vec::new());
    while let Some(v) = vertices.pop() {
        if surface.rings[v as usize].class == Some(Class::Locked) {
            return None;
        }
        for &t in surface.ring(v) {
            let corners = surface.triangles[t as usize];
            if corners[0] == v {
                triangles.push(t);
            }
            vertices.extend(corners.into_iter().filter(|&w| seen.insert(w)));
        }
        if triangles.len() > most {
            return None;
        }
    }
    (!triangles.is_empty()).then_some(triangles)
}

/// The triangles of `v` from its edge to `from` up to its edge to `to`, in their sense of rotation.
pub(super) fn sector(surface: &Surface, v: u32, from: u32, to: u32) -> Option<Vec<u32>> {
    let mut found = Vec::with_capacity(surface.ring(v).len());
    each_of_sector(surface, v, from, to, |t| found.push(t))?;
    Some(found)
}

/// Hands the same triangles to `take`; `None`, after some of them perhaps, if the sector does not exist.
fn each_of_sector(
    surface: &Surface,
    v: u32,
    from: u32,
    to: u32,
    mut take: impl FnMut(u32),
) -> Option<()> {
    let ring = surface.ring(v);
    let (mut at, mut n) = (from, 0);
    while at != to {
        if n == ring.len() {
            return None;
        }
        let next = ring.iter().find_map(|&t| {
            let (b, c) = others(surface.triangles[t as usize], v);
            (b == at).then_some((t, c))
        });
        let (t, c) = next?;
        take(t);
        at = c;
        n += 1;
    }
    (n > 0).then_some(())
}

/// Removes triangles and leaves their vertices without any.
pub(crate) fn vanish(surface: &mut Surface, triangles: &[u32]) {
    for &t in triangles {
        for v in surface.triangles[t as usize] {
            surface.rings[v as usize].len = 0;
        }
        surface.triangles[t as usize][0] = GONE;
        surface.n_alive -= 1;
    }
}
