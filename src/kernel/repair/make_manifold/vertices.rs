//! Plans the vertex that each set of connected corners becomes, and makes the surface so.
//!
//! A vertex whose corners all hang together, with no other's, stays what it is. New vertices need a source.

use super::half_edges::{PairingState, Patch};
use super::places::NONE;
use crate::options::Placement;
use crate::simd::Simd;
use crate::state::MeshState;
use crate::state::recompute::recompute_vertices;
use crate::surface::class::Class;
use crate::surface::{Ring, Surface};
use stonecut_mesh::union_find::Union;

/// Counts of a mending.
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
    /// If the whole surface was built again, with stamps from zero: the new number of each vertex, or `GONE`.
    pub(crate) rebuilt: Option<Vec<u32>>,
}

/// Plan of a mending: the vertex that each set of corners becomes.
pub(super) struct VertexPlan {
    /// For each corner of the patch the vertex it belongs to afterwards; beyond the last one, vertices that
    /// have to be made.
    pub(super) vertex: Vec<u32>,
    /// Original of each new vertex.
    copies: Vec<u32>,
    /// Vertices that nothing uses any more.
    gone: Vec<u32>,
    pub(super) missing: u64,
}

impl VertexPlan {
    /// `n_spare`: sources that are at hand beyond those of vertices that go. `root_of` is scratch space, a
    /// number a vertex.
    pub(super) fn new(
        surface: &Surface,
        patch: &Patch,
        corners: &mut Union,
        n_spare: usize,
        root_of: &mut [u32],
    ) -> Self {
        // A vertex all of whose corners hang together, with no other's, stays what it is.
        const SEVERAL: u32 = NONE - 1;
        let n = patch.vertex.len() as u32;
        let affected = |c: &u32| patch.is_affected(patch.vertex[*c as usize]);
        let mut vertex_of = vec![NONE; n as usize];
        for c in (0..n).filter(affected) {
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
        for c in (0..n).filter(affected) {
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
        let mut plan = VertexPlan {
            vertex: patch.vertex.clone(),
            copies: Vec::new(),
            gone: Vec::new(),
            missing: 0,
        };
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

    /// Notes places where this plan would make what was not there (a directed edge twice, or a corner twice),
    /// and edges at which sheets still touch: their ends hang together elsewhere, so another pairing may part
    /// them. True if there is any that was not known.
    pub(super) fn has_conflicts(&self, patch: &Patch, known: &mut PairingState) -> bool {
        let mut is_new = false;
        let mut freeze = |known: &mut PairingState, ends: [u32; 2]| {
            for end in ends {
                is_new |= !std::mem::replace(&mut known.is_frozen[end as usize], true);
            }
        };
        let mut crossed = Vec::new();
        let mut edges: Vec<([u32; 2], [u32; 2])> = Vec::new();
        for (edge, sides) in patch.edges().enumerate() {
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
                (
                    corners.map(|c| self.vertex[c as usize]),
                    corners.map(|c| patch.vertex[c as usize]),
                )
            }));
            edges.sort_unstable();
            if edges.iter().any(|(after, _)| after[0] == after[1]) {
                freeze(known, ends);
            }
            for same in edges.chunk_by(|a, b| a.0 == b.0) {
                // As found is not a conflict.
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

    /// Changes nothing; `missing` vertices would have to be made.
    pub(super) fn as_found(patch: &Patch, missing: u64) -> Self {
        VertexPlan { vertex: patch.vertex.clone(), copies: Vec::new(), gone: Vec::new(), missing }
    }

    pub(super) fn is_idle(&self) -> bool {
        self.copies.is_empty() && self.gone.is_empty()
    }

    pub(super) fn carry_out(
        &self,
        state: &mut MeshState,
        patch: &Patch,
        spare: &mut Vec<u32>,
        mended: &mut Mended,
    ) {
        let MeshState { surface, wedges, .. } = state;
        for &v in &self.gone {
            if wedges.is_none() {
                spare.push(surface.source[v as usize]);
            }
            surface.rings[v as usize].len = 0;
        }
        let first_new = surface.vertices.len() as u32;
        for &original in &self.copies {
            let source = match wedges {
                None => spare.pop(),
                Some(_) => Some(surface.source[original as usize]),
            };
            let Some(source) = source else { break };
            surface.vertices.push(surface.vertices[original as usize]);
            surface.source.push(source);
            surface.models.note(source, surface.source[original as usize]);
            let n = surface.n_channels;
            surface.channels.extend_from_within(original as usize * n..(original as usize + 1) * n);
            // Of some length, so that it is not taken for gone; rings are built again.
            let class = Some(Class::Complex);
            surface.rings.push(Ring { start: 0, len: 1, room: 0, class });
        }
        if let Some(wedges) = wedges {
            for (c, &v) in self.vertex.iter().enumerate().filter(|(_, v)| **v >= first_new) {
                let source = wedges.source_at(patch.triangles[c / 3], c % 3);
                surface.source[v as usize] = match surface.placement {
                    Placement::Subset => wedges.models.of(source),
                    _ => source,
                };
            }
        }
        for (&t, vertices) in patch.triangles.iter().zip(self.vertex.as_chunks::<3>().0) {
            surface.triangles[t as usize] = *vertices;
        }
        mended.joined = self.gone.len() as u64;
        mended.split = self.copies.len() as u64;
    }

    /// Rings, quadrics and classes of what changed, after `carry_out`; `touched`: further vertices that lost
    /// triangles.
    pub(super) fn rewire(
        &self,
        state: &mut MeshState,
        patch: &Patch,
        mut touched: Vec<u32>,
        simd: Simd,
    ) {
        let surface = &mut state.surface;
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
            surface.set_ring(ring[0].0, &list);
        }
        if let Some(wedges) = &mut state.wedges {
            wedges.look_at(surface, &changed);
        }
        touched.extend(changed);
        recompute_vertices(state, &mut touched, simd);
    }
}
