//! Finds junction curves among vertices that may lie in one place: edges of three or more triangles that are not noise.
//!
//! Before sheets are joined or taken apart: along curves they stay together, everywhere else such edges are
//! mended as ever. Which are curves is decided by what hangs together within the cell; what reaches a locked vertex may go on
//! in another cell and counts as a curve here. Of walls of regions every edge of three or more triangles is one.

use crate::surface::Surface;
use crate::surface::class::Class;
use crate::surface::junction::are_curves;
use crate::vertex::GONE;
use stonecut_mesh::union_find::Union;
use stonecut_mesh::vec3::{Vec3, dot, length_sq, scale, sub};

/// Junction curves of a surface.
#[derive(Default)]
pub(super) struct Curves {
    /// Their edges, the lesser place first, in order.
    edges: Vec<[u32; 2]>,
    /// The places on them, in order.
    places: Vec<u32>,
}

impl Curves {
    /// Finds the curves. `place`: for each vertex the first one in the same place; `may_be_on`: vertices that may be on one, of each edge
    /// one end at least.
    pub(super) fn find(
        surface: &Surface,
        place: impl Fn(u32) -> u32,
        may_be_on: impl Fn(u32) -> bool,
    ) -> Self {
        let is_inner = |v: u32| surface.rings[v as usize].class == Some(Class::Interior);
        let mut sides: Vec<Side> = Vec::new();
        for t in surface.triangles.iter().filter(|t| t[0] != GONE) {
            for (a, b, c) in [(t[0], t[1], t[2]), (t[1], t[2], t[0]), (t[2], t[0], t[1])] {
                if (may_be_on(a) || may_be_on(b)) && !is_inner(a) && !is_inner(b) {
                    let (a, b) = (place(a), place(b));
                    sides.push(([a.min(b), a.max(b)], place(c), a < b));
                }
            }
        }
        sides.sort_unstable();
        if !surface.has_walls {
            sides.dedup_by_key(|side| (side.0, side.1));
        }
        let is_locked = |v: u32| surface.rings[v as usize].class == Some(Class::Locked);
        let several = sides.chunk_by(|a, b| a.0 == b.0).filter(|edge| edge.len() > 2);
        let meet = several.filter(|edge| surface.has_walls || !is_double(surface, edge));
        let mut edges: Vec<[u32; 2]> = meet.map(|edge| edge[0].0).collect();
        drop(sides);
        let mut places: Vec<u32> = edges.iter().flatten().copied().collect();
        places.sort_unstable();
        places.dedup();
        let number = |place: u32| places.partition_point(|&other| other < place);
        let mut groups = Union::new(places.len());
        let mut n_ends = vec![0; places.len()];
        for &edge in &edges {
            let [a, b] = edge.map(number);
            groups.join(a as u32, b as u32);
            n_ends[a] += 1;
            n_ends[b] += 1;
        }
        let group: Vec<usize> = groups.into_roots().into_iter().map(|root| root as usize).collect();
        let (mut n_sides, mut n_loose) = (vec![0; places.len()], vec![0; places.len()]);
        let mut goes_on = vec![false; places.len()];
        for ((&place, &group), &n) in places.iter().zip(&group).zip(&n_ends) {
            goes_on[group] |= is_locked(place);
            n_sides[group] += n;
            n_loose[group] += usize::from(n == 1);
        }
        let is_curve = |place: u32| {
            let group = group[number(place)];
            surface.has_walls || goes_on[group] || are_curves(n_sides[group] / 2, n_loose[group])
        };
        edges.retain(|&[a, _]| is_curve(a));
        let on_curves = places.iter().copied().filter(|&place| is_curve(place)).collect();
        Curves { edges, places: on_curves }
    }

    /// True for a place on a curve.
    pub(super) fn has(&self, place: u32) -> bool {
        self.places.binary_search(&place).is_ok()
    }

    /// True for an edge of a curve.
    pub(super) fn has_edge(&self, [a, b]: [u32; 2]) -> bool {
        self.edges.binary_search(&[a.min(b), a.max(b)]).is_ok()
    }
}

/// A side of a triangle: the places of its ends, the third place, and whether the triangle runs from the lesser to the greater.
type Side = ([u32; 2], u32, bool);

/// Returns whether the four triangles of an edge are two sheets back to back, as where bodies have a wall in common and each its
/// own copy of it: on either side two that run opposite ways, less than 60 degrees apart.
fn is_double(surface: &Surface, edge: &[Side]) -> bool {
    let &[(ends, ..), _, _, _] = edge else { return false };
    let [from, to] = ends.map(|v| surface.vertices[v as usize].position);
    let along = sub(to, from);
    let away = |side: &Side| {
        let third = sub(surface.vertices[side.1 as usize].position, from);
        sub(third, scale(along, dot(third, along) / length_sq(along)))
    };
    let (forward, backward): (Vec<&Side>, Vec<&Side>) = edge.iter().partition(|side| side.2);
    let (&[a, b], &[c, d]) = (&forward[..], &backward[..]) else { return false };
    let [a, b, c, d] = [a, b, c, d].map(away);
    let is_near = |p: Vec3, q: Vec3| dot(p, q) > 0.5 * (length_sq(p) * length_sq(q)).sqrt();
    is_near(a, c) && is_near(b, d) || is_near(a, d) && is_near(b, c)
}
