//! Pairs half-edges of opposite direction, to find the corners of triangles that belong to one vertex.
//!
//! Only those around the affected vertices. It changes nothing; what becomes of the corners that hang
//! together, `vertices` decides.

use super::places::{NONE, Places};
use crate::surface::Surface;
use std::f64::consts::TAU;
use stonecut_mesh::union_find::Union;
use stonecut_mesh::vec3::{Vec3, cross, dot, length_sq, normal, scale, sub};

/// Edges at which more pairs than this could be made are left as found.
const MOST_PAIRS: usize = 1 << 12;
/// Angle below which two walls, copies that differ a little, do not have a body between them: 20 degrees.
const THIN: f64 = TAU / 18.0;

/// A side of a triangle, from one corner of the patch to the next of the same triangle. Ordered by where it
/// lies, then by direction.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Side {
    /// Places of both ends, the lesser in the higher half.
    ends: u64,
    /// The corner it runs from; in the highest bit, whether it runs from the greater place to the lesser.
    from: u32,
}

const BACKWARD: u32 = 1 << 31;

impl Side {
    pub(super) fn is_backward(self) -> bool {
        self.from & BACKWARD != 0
    }

    pub(super) fn from(self) -> u32 {
        self.from & !BACKWARD
    }

    pub(super) fn to(self) -> u32 {
        let from = self.from();
        if from % 3 == 2 { from - 2 } else { from + 1 }
    }

    pub(super) fn ends(self) -> [u32; 2] {
        [(self.ends >> 32) as u32, self.ends as u32]
    }
}

/// The affected triangles. A corner of the patch is three times a triangle's place in it, plus 0, 1 or 2.
pub(super) struct Patch {
    pub(super) triangles: Vec<u32>,
    /// Vertex of each corner.
    pub(super) vertex: Vec<u32>,
    /// Sides with an end that is affected, in order.
    sides: Vec<Side>,
    places: Places,
}

impl Patch {
    pub(super) fn new(surface: &Surface, places: Places) -> Self {
        let triangles = places.triangles(surface, 1);
        let vertex: Vec<u32> =
            triangles.iter().flat_map(|&t| surface.triangles[t as usize]).collect();
        let mut sides = Vec::with_capacity(vertex.len());
        let is_affected = |v: u32| places.is_affected[v as usize];
        for (first, t) in vertex.as_chunks::<3>().0.iter().enumerate() {
            for (i, j) in [(0, 1), (1, 2), (2, 0)] {
                if is_affected(t[i]) || is_affected(t[j]) {
                    let (a, b) = (places.place[t[i] as usize], places.place[t[j] as usize]);
                    let from = (3 * first + i) as u32 | if a > b { BACKWARD } else { 0 };
                    sides
                        .push(Side { ends: u64::from(a.min(b)) << 32 | u64::from(a.max(b)), from });
                }
            }
        }
        sides.sort_unstable();
        Patch { triangles, vertex, sides, places }
    }

    /// The sides edge by edge.
    pub(super) fn edges(&self) -> impl Iterator<Item = &[Side]> {
        self.sides.chunk_by(|a, b| a.ends == b.ends)
    }

    pub(super) fn is_affected(&self, v: u32) -> bool {
        self.places.is_affected[v as usize]
    }

    /// The vertices of a side, the lesser first.
    fn vertices(&self, side: Side) -> [u32; 2] {
        let (a, b) = (self.vertex[side.from() as usize], self.vertex[side.to() as usize]);
        [a.min(b), a.max(b)]
    }

    /// Pairs sides of opposite direction and unites their corners; what is frozen is united whole.
    /// At the crossed edges those that bend most are paired first.
    pub(super) fn pair_up(
        &self,
        surface: &Surface,
        corners: &mut Union,
        known: &PairingState,
        first: &mut [u32],
    ) {
        corners.reset(self.vertex.len());
        let mut choices = Vec::new();
        for (edge, sides) in self.edges().enumerate() {
            let n_forward = sides.iter().take_while(|side| !side.is_backward()).count();
            let (forward, backward) = sides.split_at(n_forward);
            if forward.is_empty() || backward.is_empty() {
                continue;
            }
            let may_join = !sides[0].ends().iter().any(|&end| known.is_frozen[end as usize]);
            if let ([f], [b]) = (forward, backward) {
                if may_join || self.vertices(*f) == self.vertices(*b) {
                    pair(corners, *f, *b);
                }
                continue;
            }
            if forward.len() * backward.len() > MOST_PAIRS {
                continue;
            }
            let sign = if known.is_crossed[edge] { -1.0 } else { 1.0 };
            let is_rim = self.places.rims.binary_search(&sides[0].ends()).is_ok();
            choices.clear();
            for (i, &f) in forward.iter().enumerate() {
                for (j, &b) in backward.iter().enumerate() {
                    let is_joined = self.vertices(f) == self.vertices(b);
                    if is_joined || may_join {
                        let bend = match is_rim {
                            true => self.inside(surface, f, b),
                            false => self.bend(surface, f, b),
                        };
                        choices.push((!is_joined, sign * bend, i, j));
                    }
                }
            }
            choices.sort_unstable_by(|a, b| {
                (a.0.cmp(&b.0)).then(a.1.total_cmp(&b.1)).then((a.2, a.3).cmp(&(b.2, b.3)))
            });
            let (mut used_f, mut used_b) = ([0u64; MOST_PAIRS / 64], [0u64; MOST_PAIRS / 64]);
            for &(_, _, i, j) in &choices {
                let (bit_f, bit_b) = (1 << (i % 64), 1 << (j % 64));
                if used_f[i / 64] & bit_f == 0 && used_b[j / 64] & bit_b == 0 {
                    used_f[i / 64] |= bit_f;
                    used_b[j / 64] |= bit_b;
                    pair(corners, forward[i], backward[j]);
                }
            }
        }
        // What is frozen stays one vertex; vertices that are not affected are skipped.
        let is_whole =
            |v: u32| self.is_affected(v) && known.is_frozen[self.places.place[v as usize] as usize];
        for (corner, &v) in self.vertex.iter().enumerate().filter(|&(_, &v)| is_whole(v)) {
            let first = &mut first[v as usize];
            if *first == NONE {
                *first = corner as u32;
            } else {
                corners.join(*first, corner as u32);
            }
        }
        self.vertex.iter().for_each(|&v| first[v as usize] = NONE);
    }

    /// Returns the angle within a body between two triangles at their common edge, of which `forward` runs from the lesser place to the
    /// greater. Those nearly on each other are the walls of two bodies, not of a thin one.
    fn inside(&self, surface: &Surface, forward: Side, backward: Side) -> f64 {
        let place = |corner: u32| surface.vertices[self.vertex[corner as usize] as usize].position;
        let (from, to) = (place(forward.from()), place(forward.to()));
        let third = |side: Side| 3 * (side.from() / 3) + (side.from() + 2) % 3;
        let along = sub(to, from);
        let away = |side: Side| {
            let third = sub(place(third(side)), from);
            sub(third, scale(along, dot(third, along) / length_sq(along)))
        };
        let (f, b) = (away(forward), away(backward));
        let turn = dot(cross(b, f), along) / length_sq(along).sqrt();
        let angle = turn.atan2(dot(b, f));
        if angle < THIN { angle + TAU } else { angle }
    }

    /// Returns how far two triangles bend at their common edge: 0 flat, 2 folded onto each other.
    fn bend(&self, surface: &Surface, a: Side, b: Side) -> f64 {
        let normal = |side: Side| {
            let triangle = surface.triangles[self.triangles[side.from() as usize / 3] as usize];
            let at = |v: u32| surface.vertices[v as usize].position;
            let first = at(triangle[0]);
            let relative = |v: u32| scale(sub(at(v), first), surface.scale);
            normal([[0.0; 3], relative(triangle[1]), relative(triangle[2])])
        };
        let (a, b): (Vec3, Vec3) = (normal(a), normal(b));
        let lengths = (length_sq(a) * length_sq(b)).sqrt();
        if lengths > 0.0 { 1.0 - dot(a, b) / lengths } else { 1.0 }
    }
}

/// State kept between attempts at pairing.
pub(super) struct PairingState {
    /// Places that are left as found.
    pub(super) is_frozen: Vec<bool>,
    /// Edges, in the order of the patch, at which sheets still touched.
    pub(super) is_crossed: Vec<bool>,
}

impl PairingState {
    pub(super) fn new(patch: &Patch) -> Self {
        let mut is_frozen = vec![false; patch.places.place.len()];
        let mut n_edges = 0;
        for sides in patch.edges() {
            n_edges += 1;
            let backward = sides.iter().filter(|side| side.is_backward()).count();
            let forward = sides.len() - backward;
            // Neighbours that disagree in orientation: nothing can be paired, cutting would tear them apart.
            let disagree = sides.len() > 1 && (backward == 0 || forward == 0);
            if disagree || forward * backward > MOST_PAIRS {
                sides[0].ends().into_iter().for_each(|end| is_frozen[end as usize] = true);
            }
        }
        PairingState { is_frozen, is_crossed: vec![false; n_edges] }
    }
}

/// Unites both ends of two sides of opposite direction.
fn pair(corners: &mut Union, a: Side, b: Side) {
    corners.join(a.from(), b.to());
    corners.join(a.to(), b.from());
}
