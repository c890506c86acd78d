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

use super::lanes::Simd;
use super::legal::Class;
use super::repeats::{Repeats, from_least};
use super::surface::{GONE, Ring, Surface};
use super::topology;
use super::vector::{Vec3, dot, length_sq, normal};

/// Edges at which more pairs than this could be made are left as found.
const MOST_PAIRS: usize = 1 << 12;
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
    let mut corners = Corners { parent: Vec::new() };
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

/// A side of a triangle, from one corner of the patch to the next of the same triangle. Ordered by where it
/// lies, then by direction.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Side {
    /// Places of both ends, the lesser in the higher half.
    ends: u64,
    /// The corner it runs from; in the highest bit, whether it runs from the greater place to the lesser.
    from: u32,
}

const BACKWARD: u32 = 1 << 31;

impl Side {
    fn is_backward(self) -> bool {
        self.from & BACKWARD != 0
    }

    fn from(self) -> u32 {
        self.from & !BACKWARD
    }

    fn to(self) -> u32 {
        let from = self.from();
        if from % 3 == 2 { from - 2 } else { from + 1 }
    }

    fn ends(self) -> [u32; 2] {
        [(self.ends >> 32) as u32, self.ends as u32]
    }
}

/// The triangles concerned. A corner of the patch is three times a triangle's place in it, plus 0, 1 or 2.
struct Patch {
    triangles: Vec<u32>,
    /// Vertex of each corner.
    vertex: Vec<u32>,
    /// Sides with an end that is concerned, in order.
    sides: Vec<Side>,
    places: Places,
}

impl Patch {
    fn new(surface: &Surface, places: Places) -> Self {
        let triangles = places.triangles(surface, 1);
        let vertex: Vec<u32> =
            triangles.iter().flat_map(|&t| surface.triangles[t as usize]).collect();
        let mut sides = Vec::with_capacity(vertex.len());
        let is_concerned = |v: u32| places.is_concerned[v as usize];
        for (first, t) in vertex.as_chunks::<3>().0.iter().enumerate() {
            for (i, j) in [(0, 1), (1, 2), (2, 0)] {
                if is_concerned(t[i]) || is_concerned(t[j]) {
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
    fn edges(&self) -> impl Iterator<Item = &[Side]> {
        self.sides.chunk_by(|a, b| a.ends == b.ends)
    }

    fn is_concerned(&self, v: u32) -> bool {
        self.places.is_concerned[v as usize]
    }

    /// The vertices of a side, the lesser first.
    fn vertices(&self, side: Side) -> [u32; 2] {
        let (a, b) = (self.vertex[side.from() as usize], self.vertex[side.to() as usize]);
        [a.min(b), a.max(b)]
    }

    /// Pairs sides of opposite direction and unites their corners; what is frozen is united whole.
    /// At the crossed edges those that bend most are paired first.
    fn pair_up(&self, surface: &Surface, corners: &mut Corners, known: &Known, first: &mut [u32]) {
        corners.parent.clear();
        corners.parent.extend(0..self.vertex.len() as u32);
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
                    corners.pair(*f, *b);
                }
                continue;
            }
            if forward.len() * backward.len() > MOST_PAIRS {
                continue;
            }
            let sign = if known.is_crossed[edge] { -1.0 } else { 1.0 };
            choices.clear();
            for (i, &f) in forward.iter().enumerate() {
                for (j, &b) in backward.iter().enumerate() {
                    let is_joined = self.vertices(f) == self.vertices(b);
                    if is_joined || may_join {
                        choices.push((!is_joined, sign * self.bend(surface, f, b), i, j));
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
                    corners.pair(forward[i], backward[j]);
                }
            }
        }
        // What is frozen stays one vertex; what is not concerned is not asked.
        let is_whole = |v: u32| {
            self.is_concerned(v) && known.is_frozen[self.places.place[v as usize] as usize]
        };
        for (corner, &v) in self.vertex.iter().enumerate().filter(|&(_, &v)| is_whole(v)) {
            let first = &mut first[v as usize];
            if *first == NONE {
                *first = corner as u32;
            } else {
                corners.unite(*first, corner as u32);
            }
        }
        self.vertex.iter().for_each(|&v| first[v as usize] = NONE);
    }

    /// How far two triangles bend at their common edge: 0 flat, 2 folded onto each other.
    fn bend(&self, surface: &Surface, a: Side, b: Side) -> f64 {
        let normal = |side: Side| {
            let triangle = surface.triangles[self.triangles[side.from() as usize / 3] as usize];
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

    /// Notes places where the plan would make what was not there (a directed edge twice, or a corner twice),
    /// and edges at which sheets still touch: their ends hang together elsewhere, so another pairing may part
    /// them. True if there is any that was not known.
    fn has_conflicts(&self, plan: &Plan, known: &mut Known) -> bool {
        let mut is_new = false;
        let mut freeze = |known: &mut Known, ends: [u32; 2]| {
            for end in ends {
                is_new |= !std::mem::replace(&mut known.is_frozen[end as usize], true);
            }
        };
        let mut crossed = Vec::new();
        let mut edges: Vec<([u32; 2], [u32; 2])> = Vec::new();
        for (edge, sides) in self.edges().enumerate() {
            let ends = sides[0].ends();
            // Only corners in the same place become one, so one side each way cannot be in conflict.
            let is_point = ends[0] == ends[1];
            if !is_point
                && (sides.len() == 1
                    || sides.len() == 2 && sides[0].is_backward() != sides[1].is_backward())
            {
                continue;
            }
            edges.clear();
            edges.extend(sides.iter().map(|side| {
                let corners = [side.from(), side.to()];
                (corners.map(|c| plan.vertex[c as usize]), corners.map(|c| self.vertex[c as usize]))
            }));
            edges.sort_unstable();
            if edges.iter().any(|(after, _)| after[0] == after[1]) {
                freeze(known, ends);
            }
            for same in edges.chunk_by(|a, b| a.0 == b.0) {
                // As found is no conflict.
                if same.iter().any(|(_, before)| *before != same[0].1) {
                    freeze(known, ends);
                } else if same.len() > 1 {
                    crossed.push(edge);
                }
            }
        }
        for edge in crossed {
            is_new |= !std::mem::replace(&mut known.is_crossed[edge], true);
        }
        is_new
    }
}

/// What one attempt at pairing has taught the next.
struct Known {
    /// Places that are left as found.
    is_frozen: Vec<bool>,
    /// Edges, in the order of the patch, at which sheets still touched.
    is_crossed: Vec<bool>,
}

impl Known {
    fn new(patch: &Patch) -> Self {
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
        Known { is_frozen, is_crossed: vec![false; n_edges] }
    }
}

/// Corners that hang together: a forest over the corners of the patch. The root is the least.
struct Corners {
    parent: Vec<u32>,
}

impl Corners {
    fn root(&mut self, corner: u32) -> u32 {
        let mut at = corner;
        while self.parent[at as usize] != at {
            let above = self.parent[self.parent[at as usize] as usize];
            self.parent[at as usize] = above;
            at = above;
        }
        at
    }

    fn unite(&mut self, a: u32, b: u32) {
        let (a, b) = (self.root(a), self.root(b));
        self.parent[a.max(b) as usize] = a.min(b);
    }

    /// Unites both ends of two sides of opposite direction.
    fn pair(&mut self, a: Side, b: Side) {
        self.unite(a.from(), b.to());
        self.unite(a.to(), b.from());
    }
}

/// Which vertex each set of corners becomes.
struct Plan {
    /// For each corner of the patch the vertex it belongs to afterwards; beyond the last one, vertices that
    /// have to be made.
    vertex: Vec<u32>,
    /// What each new vertex is a copy of.
    copies: Vec<u32>,
    /// Vertices that nothing uses any more.
    gone: Vec<u32>,
    missing: u64,
}

impl Plan {
    /// `n_spare`: sources that are to be had beyond those of vertices that go. `root_of` is scratch space, a
    /// number a vertex.
    fn new(
        surface: &Surface,
        patch: &Patch,
        corners: &mut Corners,
        n_spare: usize,
        root_of: &mut [u32],
    ) -> Self {
        // A vertex all of whose corners hang together, with no other's, stays what it is.
        const SEVERAL: u32 = NONE - 1;
        let n = patch.vertex.len() as u32;
        let concerned = |c: &u32| patch.is_concerned(patch.vertex[*c as usize]);
        let mut vertex_of = vec![NONE; n as usize];
        for c in (0..n).filter(concerned) {
            let (root, v) = (corners.root(c), patch.vertex[c as usize]);
            let note = |known: &mut u32, x: u32| {
                *known = if *known == NONE || *known == x { x } else { SEVERAL };
            };
            note(&mut vertex_of[root as usize], v);
            note(&mut root_of[v as usize], root);
        }
        // A set of several vertices, or one of the sets of a vertex of several.
        let changes = |root: u32, root_of: &[u32]| {
            let v = vertex_of[root as usize];
            v == SEVERAL || root_of[v as usize] == SEVERAL
        };
        // Sets of corners, in the order of their least source and of their roots.
        let mut members: Vec<(u32, u32, u32)> = Vec::new();
        for c in (0..n).filter(concerned) {
            let root = corners.root(c);
            if changes(root, root_of) {
                members.push((root, patch.vertex[c as usize], c));
            }
        }
        patch.vertex.iter().for_each(|&v| root_of[v as usize] = NONE);
        members.sort_unstable_by_key(|&(root, v, c)| (root, surface.source[v as usize], c));
        let mut sets: Vec<&[(u32, u32, u32)]> = members.chunk_by(|a, b| a.0 == b.0).collect();
        // Larger sets first: the main fan keeps its vertex.
        sets.sort_by_key(|set| (std::cmp::Reverse(set.len()), set[0].0));
        let first_new = surface.vertices.len() as u32;
        let mut plan =
            Plan { vertex: patch.vertex.clone(), copies: Vec::new(), gone: Vec::new(), missing: 0 };
        let is_taken = &mut *root_of;
        let mut waiting = Vec::new();
        for set in sets {
            match set.iter().find(|(_, v, _)| is_taken[*v as usize] == NONE) {
                Some(&(_, v, _)) => {
                    is_taken[v as usize] = v;
                    set.iter().for_each(|&(_, _, c)| plan.vertex[c as usize] = v);
                }
                None => waiting.push(set),
            }
        }
        let mut used: Vec<u32> = members.iter().map(|&(_, v, _)| v).collect();
        used.sort_unstable();
        used.dedup();
        plan.gone = used.iter().copied().filter(|&v| is_taken[v as usize] == NONE).collect();
        used.iter().for_each(|&v| is_taken[v as usize] = NONE);
        let room = n_spare + plan.gone.len();
        for set in waiting {
            let original = set[0].1;
            if plan.copies.len() == room {
                plan.missing += 1;
                continue;
            }
            let new = first_new + plan.copies.len() as u32;
            plan.copies.push(original);
            set.iter().for_each(|&(_, _, c)| plan.vertex[c as usize] = new);
        }
        plan
    }

    fn is_idle(&self) -> bool {
        self.copies.is_empty() && self.gone.is_empty()
    }

    fn carry_out(
        &self,
        surface: &mut Surface,
        patch: &Patch,
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
        for (&t, vertices) in patch.triangles.iter().zip(self.vertex.as_chunks::<3>().0) {
            surface.triangles[t as usize] = *vertices;
        }
        mended.joined = self.gone.len() as u64;
        mended.split = self.copies.len() as u64;
    }

    /// Rings, quadrics and classes of what changed, after `carry_out`; `touched`: further vertices that lost
    /// triangles.
    fn rewire(&self, surface: &mut Surface, patch: &Patch, mut touched: Vec<u32>, simd: Simd) {
        let mut changed = Vec::new();
        let corners = patch.vertex.as_chunks::<3>().0.iter().zip(self.vertex.as_chunks::<3>().0);
        for (before, after) in corners.filter(|(before, after)| before != after) {
            touched.extend(after);
            for (b, a) in before.iter().zip(after).filter(|(b, a)| b != a) {
                changed.extend([*b, *a]);
            }
        }
        changed.sort_unstable();
        changed.dedup();
        // Whatever uses one of these is in the patch.
        let mut rings: Vec<(u32, u32)> = (self.vertex.iter().enumerate())
            .filter(|(_, v)| changed.binary_search(v).is_ok())
            .map(|(corner, &v)| (v, patch.triangles[corner / 3]))
            .collect();
        rings.sort_unstable();
        changed.iter().for_each(|&v| surface.rings[v as usize].len = 0);
        let mut list = Vec::new();
        for ring in rings.chunk_by(|a, b| a.0 == b.0) {
            list.clear();
            list.extend(ring.iter().map(|&(_, t)| t));
            topology::set_ring(surface, ring[0].0, &list);
        }
        touched.extend(changed);
        topology::settle(surface, &mut touched, simd);
    }
}
