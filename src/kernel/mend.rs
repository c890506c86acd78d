//! Makes the surface manifold where it can be: joins boundaries that touch, takes sheets apart that only
//! share a vertex or an edge, drops triangles that are there twice.
//!
//! Under `Topology::Error` only, and only around vertices that are not inside of the surface, so that a
//! clean scan costs nothing. Half-edges are paired first: those that belong together already, then those of
//! opposite direction whose ends coincide, the flattest first. The corners that hang together over pairs
//! become one vertex each; so no vertex has two fans. Where that would repeat a directed edge, or where
//! neighbours disagree in orientation, all is left as found. Locked vertices stay what they are.
//!
//! Source: cutting and stitching after Gueziec et al. 1998 (docs/references.md).

use std::collections::BTreeSet;

use super::lanes::Simd;
use super::legal::Class;
use super::surface::{GONE, Ring, Surface};
use super::vector::{Vec3, dot, length_sq, normal};

/// What was mended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Mended {
    /// Vertices that became one with another in the same place.
    pub(crate) joined: u64,
    /// Vertices that were made of one with several fans.
    pub(crate) split: u64,
    /// Triangles that were there twice.
    pub(crate) duplicates: u64,
    /// Vertices that would have to be made, but there was no source for them yet.
    pub(crate) missing: u64,
}

/// A side of a triangle. Ordered by where it lies, then by direction.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Side {
    /// Places of both ends, the lesser first.
    ends: [u32; 2],
    /// Whether it runs from the greater place to the lesser.
    is_backward: bool,
    /// The corners it runs from and to, as three times the triangle plus the corner.
    from: u32,
    to: u32,
}

/// Mends a surface. New vertices take over `spare` sources; sources of vertices that go are added to it.
/// Sorts what touches a boundary or a non-manifold place, nothing else.
///
/// Also, for each vertex its number in the surface that was built anew; nothing if it was not.
pub(crate) fn mend(surface: &mut Surface, spare: &mut Vec<u32>, simd: Simd) -> (Mended, Vec<u32>) {
    let place = places(surface);
    let mut mended = Mended { duplicates: drop_duplicates(surface, &place), ..Mended::default() };
    let sides = sides(surface, &place);
    let mut frozen = BTreeSet::new();
    let mut crossed = BTreeSet::new();
    let mut corners;
    let mut plan;
    loop {
        corners = Corners::new(&sides);
        pair_up(surface, &sides, &place, &mut corners, (&mut frozen, &crossed));
        plan = Plan::new(surface, &mut corners, spare.len());
        let (bad, doubled) = conflicts(surface, &sides, &place, &corners, &plan);
        let known = (frozen.len(), crossed.len());
        frozen.extend(bad);
        crossed.extend(doubled);
        if (frozen.len(), crossed.len()) == known {
            break;
        }
    }
    mended.missing = plan.missing;
    if plan.is_idle() && mended.duplicates == 0 {
        return (mended, Vec::new());
    }
    plan.carry_out(surface, &corners, spare, &mut mended);
    let place = surface.compact(simd);
    (mended, place)
}

/// Whether a vertex may be on a boundary or in a non-manifold place, and is free to change.
fn is_open(surface: &Surface, v: u32) -> bool {
    let ring = &surface.rings[v as usize];
    ring.len > 0 && matches!(ring.class, Some(Class::Boundary | Class::Complex))
}

/// For each vertex the first one in exactly the same place, if both are open; else itself.
fn places(surface: &Surface) -> Vec<u32> {
    // Adding 0 makes -0 and 0 the same place.
    let at = |v: u32| surface.vertices[v as usize].position.map(|x| (x + 0.0).to_bits());
    let mut open: Vec<([u64; 3], u32)> = (0..surface.vertices.len() as u32)
        .filter(|&v| is_open(surface, v))
        .map(|v| (at(v), v))
        .collect();
    open.sort_unstable();
    let mut place: Vec<u32> = (0..surface.vertices.len() as u32).collect();
    for same in open.chunk_by(|a, b| a.0 == b.0) {
        for &(_, v) in same {
            place[v as usize] = same[0].1;
        }
    }
    place
}

/// Triangles, ascending, with at least one open corner.
fn open_triangles(surface: &Surface) -> Vec<u32> {
    let mut triangles: Vec<u32> = (0..surface.vertices.len() as u32)
        .filter(|&v| is_open(surface, v))
        .flat_map(|v| surface.ring(v).iter().copied())
        .filter(|&t| surface.triangles[t as usize][0] != GONE)
        .collect();
    triangles.sort_unstable();
    triangles.dedup();
    triangles
}

/// Of triangles over the same three places in the same sense of rotation, only the first stays.
fn drop_duplicates(surface: &mut Surface, place: &[u32]) -> u64 {
    let mut known: Vec<([u32; 3], u32)> = open_triangles(surface)
        .into_iter()
        .map(|t| {
            let mut at = surface.triangles[t as usize].map(|v| place[v as usize]);
            let least = (0..3).min_by_key(|&i| at[i]).unwrap_or(0);
            at.rotate_left(least);
            (at, t)
        })
        .collect();
    known.sort_unstable();
    let mut dropped = 0;
    for same in known.chunk_by(|a, b| a.0 == b.0) {
        for &(_, t) in &same[1..] {
            for v in surface.triangles[t as usize] {
                surface.remove_from_ring(v, t);
            }
            surface.triangles[t as usize][0] = GONE;
            surface.n_alive -= 1;
            dropped += 1;
        }
    }
    dropped
}

/// All sides of all triangles with an open corner, in order.
fn sides(surface: &Surface, place: &[u32]) -> Vec<Side> {
    let mut sides = Vec::new();
    for t in open_triangles(surface) {
        let corners = surface.triangles[t as usize];
        for (i, j) in [(0, 1), (1, 2), (2, 0)] {
            let (a, b) = (place[corners[i] as usize], place[corners[j] as usize]);
            let (from, to) = (3 * t + i as u32, 3 * t + j as u32);
            sides.push(Side { ends: [a.min(b), a.max(b)], is_backward: a > b, from, to });
        }
    }
    sides.sort_unstable();
    sides
}

/// Corners that hang together: a forest over the corners of the triangles concerned.
struct Corners {
    /// Ascending.
    ids: Vec<u32>,
    parent: Vec<u32>,
}

impl Corners {
    fn new(sides: &[Side]) -> Self {
        let mut ids: Vec<u32> = sides.iter().map(|side| side.from).collect();
        ids.sort_unstable();
        let parent = (0..ids.len() as u32).collect();
        Corners { ids, parent }
    }

    fn index(&self, corner: u32) -> u32 {
        self.ids.partition_point(|&id| id < corner) as u32
    }

    fn root(&mut self, index: u32) -> u32 {
        let mut at = index;
        while self.parent[at as usize] != at {
            let above = self.parent[self.parent[at as usize] as usize];
            self.parent[at as usize] = above;
            at = above;
        }
        at
    }

    fn unite(&mut self, a: u32, b: u32) {
        let (a, b) = (self.index(a), self.index(b));
        let (a, b) = (self.root(a), self.root(b));
        self.parent[a.max(b) as usize] = a.min(b);
    }
}

fn vertex_of(surface: &Surface, corner: u32) -> u32 {
    surface.triangles[corner as usize / 3][corner as usize % 3]
}

/// Pairs sides of opposite direction and unites their corners; what may not change is united whole.
/// At the `crossed` edges those that bend most are paired first.
fn pair_up(
    surface: &Surface,
    sides: &[Side],
    place: &[u32],
    corners: &mut Corners,
    (frozen, crossed): (&mut BTreeSet<u32>, &BTreeSet<[u32; 2]>),
) {
    // Neighbours that disagree in orientation: nothing can be paired, cutting would tear them apart.
    for edge in sides.chunk_by(|a, b| a.ends == b.ends).filter(|edge| edge.len() > 1) {
        let backward = edge.iter().filter(|side| side.is_backward).count();
        if backward == 0 || backward == edge.len() {
            frozen.extend(edge[0].ends);
        }
    }
    let ends = |side: &Side| {
        let (a, b) = (vertex_of(surface, side.from), vertex_of(surface, side.to));
        [a.min(b), a.max(b)]
    };
    let mut choices = Vec::new();
    for edge in sides.chunk_by(|a, b| a.ends == b.ends) {
        let backward = edge.partition_point(|side| !side.is_backward);
        let (forward, backward) = edge.split_at(backward);
        choices.clear();
        let is_simple = forward.len() == 1 && backward.len() == 1;
        let sign = if crossed.contains(&edge[0].ends) { -1.0 } else { 1.0 };
        let may_join = !edge[0].ends.iter().any(|end| frozen.contains(end));
        for (i, f) in forward.iter().enumerate() {
            for (j, b) in backward.iter().enumerate() {
                let is_joined = ends(f) == ends(b);
                if is_joined || may_join {
                    let bend = if is_simple { 0.0 } else { sign * bend(surface, f, b) };
                    choices.push((!is_joined, bend, i, j));
                }
            }
        }
        choices.sort_unstable_by(|a, b| {
            (a.0.cmp(&b.0)).then(a.1.total_cmp(&b.1)).then((a.2, a.3).cmp(&(b.2, b.3)))
        });
        let (mut used_f, mut used_b) = (0u64, 0u64);
        for &(_, _, i, j) in &choices {
            let (bit_f, bit_b) = (1 << i.min(63), 1 << j.min(63));
            if used_f & bit_f == 0 && used_b & bit_b == 0 {
                (used_f, used_b) = (used_f | bit_f, used_b | bit_b);
                corners.unite(forward[i].from, backward[j].to);
                corners.unite(forward[i].to, backward[j].from);
            }
        }
    }
    // What is not open, or frozen, stays one vertex.
    let mut whole: Vec<(u32, u32)> = corners
        .ids
        .iter()
        .map(|&corner| (vertex_of(surface, corner), corner))
        .filter(|&(v, _)| !is_open(surface, v) || frozen.contains(&place[v as usize]))
        .collect();
    whole.sort_unstable();
    for same in whole.windows(2).filter(|same| same[0].0 == same[1].0) {
        corners.unite(same[0].1, same[1].1);
    }
}

/// How far two triangles bend at their common edge: 0 flat, 2 folded onto each other.
fn bend(surface: &Surface, a: &Side, b: &Side) -> f64 {
    let normal = |side: &Side| {
        let triangle = surface.triangles[side.from as usize / 3];
        let at = |v: u32| surface.vertices[v as usize].position;
        let first = at(triangle[0]);
        let relative =
            |v: u32| super::vector::scale(super::vector::sub(at(v), first), surface.scale);
        normal([[0.0; 3], relative(triangle[1]), relative(triangle[2])])
    };
    let (a, b): (Vec3, Vec3) = (normal(a), normal(b));
    let lengths = (length_sq(a) * length_sq(b)).sqrt();
    if lengths > 0.0 { 1.0 - dot(a, b) / lengths } else { 1.0 }
}

/// Which vertex each set of corners becomes.
struct Plan {
    /// For each corner of `Corners` the vertex it belongs to afterwards; beyond the last one, vertices that
    /// have to be made.
    vertex: Vec<u32>,
    /// What each new vertex is a copy of.
    copies: Vec<u32>,
    /// Vertices that nothing uses any more.
    gone: Vec<u32>,
    missing: u64,
}

impl Plan {
    /// `n_spare`: sources that are to be had beyond those of vertices that go.
    fn new(surface: &Surface, corners: &mut Corners, n_spare: usize) -> Self {
        let n = corners.ids.len();
        // Sets of corners, in the order of their least source and of their roots.
        let mut members: Vec<(u32, u32, u32)> = (0..n as u32)
            .map(|i| {
                let root = corners.root(i);
                let v = vertex_of(surface, corners.ids[i as usize]);
                (root, v, i)
            })
            .collect();
        members.sort_unstable_by_key(|&(root, v, i)| {
            (root, is_open(surface, v), surface.source[v as usize], i)
        });
        let mut sets: Vec<&[(u32, u32, u32)]> = members.chunk_by(|a, b| a.0 == b.0).collect();
        // Larger sets first: the main fan keeps its vertex.
        sets.sort_by_key(|set| (std::cmp::Reverse(set.len()), set[0].0));
        let first_new = surface.vertices.len() as u32;
        let mut plan =
            Plan { vertex: vec![GONE; n], copies: Vec::new(), gone: Vec::new(), missing: 0 };
        let mut taken = BTreeSet::new();
        let mut waiting = Vec::new();
        for set in sets {
            match set.iter().find(|(_, v, _)| !taken.contains(v)) {
                Some(&(_, v, _)) => {
                    taken.insert(v);
                    set.iter().for_each(|&(_, _, i)| plan.vertex[i as usize] = v);
                }
                None => waiting.push(set),
            }
        }
        let mut used: Vec<u32> = members.iter().map(|&(_, v, _)| v).collect();
        used.sort_unstable();
        used.dedup();
        plan.gone = used.into_iter().filter(|v| !taken.contains(v)).collect();
        let room = n_spare + plan.gone.len();
        for set in waiting {
            let original = set[0].1;
            if plan.copies.len() == room {
                plan.missing += 1;
                set.iter().for_each(|&(_, v, i)| plan.vertex[i as usize] = v);
                continue;
            }
            let new = first_new + plan.copies.len() as u32;
            plan.copies.push(original);
            set.iter().for_each(|&(_, _, i)| plan.vertex[i as usize] = new);
        }
        plan
    }

    fn is_idle(&self) -> bool {
        self.copies.is_empty() && self.gone.is_empty()
    }

    fn carry_out(
        self,
        surface: &mut Surface,
        corners: &Corners,
        spare: &mut Vec<u32>,
        mended: &mut Mended,
    ) {
        for &v in &self.gone {
            spare.push(surface.source[v as usize]);
            surface.rings[v as usize].len = 0;
        }
        for &original in &self.copies {
            let Some(source) = spare.pop() else { break };
            surface.vertices.push(surface.vertices[original as usize]);
            surface.source.push(source);
            let n = surface.n_channels;
            surface.channels.extend_from_within(original as usize * n..(original as usize + 1) * n);
            // Of some length, so that it is not taken for gone; rings are built anew.
            let class = Some(Class::Complex);
            surface.rings.push(Ring { start: 0, len: 1, room: 0, class });
        }
        for (&corner, &v) in corners.ids.iter().zip(&self.vertex) {
            surface.triangles[corner as usize / 3][corner as usize % 3] = v;
        }
        mended.joined = self.gone.len() as u64;
        mended.split = self.copies.len() as u64;
    }

    fn of(&self, corners: &Corners, corner: u32) -> u32 {
        self.vertex[corners.index(corner) as usize]
    }
}

/// Places where the plan would make what was not there (a directed edge twice, or a corner twice), and
/// edges at which sheets still touch: their ends hang together elsewhere, so another pairing may part them.
fn conflicts(
    surface: &Surface,
    sides: &[Side],
    place: &[u32],
    corners: &Corners,
    plan: &Plan,
) -> (Vec<u32>, Vec<[u32; 2]>) {
    let mut edges: Vec<([u32; 2], [u32; 2], [u32; 2])> = Vec::with_capacity(sides.len());
    let (mut bad, mut doubled) = (Vec::new(), Vec::new());
    for side in sides {
        let after = [plan.of(corners, side.from), plan.of(corners, side.to)];
        let before = [vertex_of(surface, side.from), vertex_of(surface, side.to)];
        let at = before.map(|v| place[v as usize]);
        if after[0] == after[1] {
            bad.extend(at);
        }
        edges.push((after, before, at));
    }
    edges.sort_unstable();
    for same in edges.chunk_by(|a, b| a.0 == b.0) {
        // As found is no conflict.
        if same.iter().any(|edge| edge.1 != same[0].1) {
            bad.extend(same.iter().flat_map(|edge| edge.2));
        } else if same.len() > 1 {
            let [a, b] = same[0].2;
            doubled.push([a.min(b), a.max(b)]);
        }
    }
    (bad, doubled)
}
