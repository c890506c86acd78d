//! Finds junction curves among vertices that may lie in one place: edges of three or more triangles that are not noise.
//!
//! Before sheets are joined or taken apart: along curves they stay together, everywhere else such edges are
//! mended as ever. Which are curves is decided by what hangs together within the cell; what reaches a locked vertex may go on
//! in another cell and counts as a curve here. Of walls of regions every edge of three or more triangles is one. Curves along which bodies meet that
//! have a copy each of the walls between them are none: every body goes its own way there.

use crate::surface::Surface;
use crate::surface::class::Class;
use crate::vertex::GONE;
use stonecut_mesh::bounds::Bounds;
use stonecut_mesh::curves::are_curves;
use stonecut_mesh::union_find::Union;
use stonecut_mesh::vec3::{Vec3, dot, length_sq, scale, sub};

/// Junction curves of a surface.
#[derive(Default)]
pub(super) struct Curves {
    /// Their edges, the lesser place first, in order.
    edges: Vec<[u32; 2]>,
    /// The places on them, in order.
    places: Vec<u32>,
    /// Edges at which bodies meet that have a copy each of the walls between them, in the same form.
    rims: Vec<[u32; 2]>,
}

impl Curves {
    /// Finds the curves. `place`: for each vertex the first one in the same place; `may_be_on`: vertices that may be on one, of each edge
    /// one end at least; `is_inner`: those that are on none.
    pub(super) fn find(
        surface: &Surface,
        place: impl Fn(u32) -> u32,
        (may_be_on, is_inner): (impl Fn(u32) -> bool, impl Fn(u32) -> bool),
    ) -> Self {
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
        // Triangles over the same three places count once, but for the sense in which they run.
        let n_different = |edge: &[Side]| match surface.has_walls {
            true => edge.len(),
            false => edge.chunk_by(|a, b| a.1 == b.1).count(),
        };
        if !surface.has_walls {
            sides.dedup();
        }
        let is_locked = |v: u32| surface.rings[v as usize].class == Some(Class::Locked);
        let several = sides.chunk_by(|a, b| a.0 == b.0).filter(|edge| n_different(edge) > 2);
        let (mut edges, kinds): (Vec<[u32; 2]>, Vec<MeetKind>) = several
            .map(|edge| {
                (edge[0].0, if surface.has_walls { MeetKind::Other } else { kind(surface, edge) })
            })
            .filter(|(_, kind)| *kind != MeetKind::Double)
            .unzip();
        drop(sides);
        let mut places: Vec<u32> = edges.iter().flatten().copied().collect();
        places.sort_unstable();
        places.dedup();
        let number = |place: u32| places.partition_point(|&other| other < place);
        let mut roots = Union::new(places.len());
        let mut n_ends = vec![0; places.len()];
        for &edge in &edges {
            let [a, b] = edge.map(number);
            roots.join(a as u32, b as u32);
            n_ends[a] += 1;
            n_ends[b] += 1;
        }
        let group: Vec<usize> = roots.into_roots().into_iter().map(|root| root as usize).collect();
        let mut groups = vec![EdgeGroup::default(); places.len()];
        let mut boxes = vec![Bounds::EMPTY; places.len()];
        for ((&place, &group), &n) in places.iter().zip(&group).zip(&n_ends) {
            groups[group].goes_on |= is_locked(place);
            groups[group].n_loose += usize::from(n == 1);
            boxes[group].add(surface.vertices[place as usize].position);
        }
        let mut around = Vec::new();
        for (&[a, b], &kind) in edges.iter().zip(&kinds) {
            let is_large = boxes[group[number(a)]].side() >= surface.long_curve;
            let group = &mut groups[group[number(a)]];
            if kind == MeetKind::Other && is_large && !group.is_long {
                // Not where sheets only lie beside each other.
                surface.junction_neighbours(a, &mut around);
                group.is_long = around.contains(&b);
            }
            group.n_edges += 1;
            group.n_walls += usize::from(kind == MeetKind::Rim);
            group.n_odd += usize::from(kind == MeetKind::Other);
        }
        let group = |place: u32| &groups[group[number(place)]];
        let rims = edges.iter().copied().filter(|&[a, _]| group(a).is_of_bodies()).collect();
        let is_curve = |place: u32| surface.has_walls || group(place).is_curve();
        edges.retain(|&[a, _]| is_curve(a));
        let on_curves = places.iter().copied().filter(|&place| is_curve(place)).collect();
        Curves { edges, places: on_curves, rims }
    }

    /// True for a place on a curve.
    pub(super) fn has(&self, place: u32) -> bool {
        self.places.binary_search(&place).is_ok()
    }

    /// True for an edge of a curve.
    pub(super) fn has_edge(&self, [a, b]: [u32; 2]) -> bool {
        self.edges.binary_search(&[a.min(b), a.max(b)]).is_ok()
    }

    /// The edges at which bodies meet that have a copy each of the walls between them, the lesser place first, in order.
    pub(super) fn into_rims(self) -> Vec<[u32; 2]> {
        self.rims
    }
}

/// Edges that hang together.
#[derive(Clone, Default)]
struct EdgeGroup {
    n_edges: usize,
    n_loose: usize,
    /// Edges at which a double wall ends, and those that are not between bodies.
    n_walls: usize,
    n_odd: usize,
    /// True if it may go on in another cell.
    goes_on: bool,
    /// True if it is long beside the mesh (`Surface::long_curve`).
    is_long: bool,
}

impl EdgeGroup {
    fn is_more_than_noise(&self) -> bool {
        self.goes_on || self.is_long || are_curves(self.n_edges, self.n_loose)
    }

    /// Most of its edges are ends of double walls; where the copies differ, some look as if bodies met in a line.
    fn is_of_bodies(&self) -> bool {
        self.is_more_than_noise() && self.n_odd == 0 && 4 * self.n_walls >= 3 * self.n_edges
    }

    fn is_curve(&self) -> bool {
        self.is_more_than_noise() && !self.is_of_bodies()
    }
}

/// A side of a triangle: the places of its ends, the third place, and whether the triangle runs from the lesser to the greater.
type Side = ([u32; 2], u32, bool);

/// Kind of an edge of three or more triangles.
#[derive(Clone, Copy, PartialEq, Eq)]
enum MeetKind {
    /// Two sheets back to back, as where bodies have a wall in common and each its own copy of it.
    Double,
    /// The end of such a wall.
    Rim,
    /// Bodies that meet in a line.
    Line,
    /// Not as many triangles run one way as the other: not between bodies.
    Other,
}

/// Tells edges of bodies: two triangles that run opposite ways, less than 60 degrees apart, are copies of a wall.
fn kind(surface: &Surface, edge: &[Side]) -> MeetKind {
    let [from, to] = edge[0].0.map(|v| surface.vertices[v as usize].position);
    let along = sub(to, from);
    let away = |side: &&Side| {
        let third = sub(surface.vertices[side.1 as usize].position, from);
        sub(third, scale(along, dot(third, along) / length_sq(along)))
    };
    let (forward, backward): (Vec<&Side>, Vec<&Side>) = edge.iter().partition(|side| side.2);
    let [forward, backward] =
        [forward, backward].map(|sides| sides.iter().map(away).collect::<Vec<Vec3>>());
    if forward.len() != backward.len() {
        return MeetKind::Other;
    }
    let is_near = |p: &Vec3, q: &Vec3| dot(*p, *q) > 0.5 * (length_sq(*p) * length_sq(*q)).sqrt();
    if let ([a, b], [c, d]) = (&forward[..], &backward[..])
        && (is_near(a, c) && is_near(b, d) || is_near(a, d) && is_near(b, c))
    {
        return MeetKind::Double;
    }
    let has_wall = forward.iter().any(|p| backward.iter().any(|q| is_near(p, q)));
    if has_wall { MeetKind::Rim } else { MeetKind::Line }
}
