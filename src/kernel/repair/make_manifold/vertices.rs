//! Which vertex each set of corners becomes that hangs together, and the surface after that.
//!
//! A vertex whose corners all hang together, with no other's, stays what it is. New vertices need a source.

use super::half_edges::Patch;
use super::{Mended, NONE};
use crate::kernel::collapse::legality::Class;
use crate::kernel::simd::Simd;
use crate::kernel::surface::{Ring, Surface};
use crate::kernel::topology;
use crate::mesh::union_find::Union;

/// Which vertex each set of corners becomes.
pub(super) struct Plan {
    /// For each corner of the patch the vertex it belongs to afterwards; beyond the last one, vertices that
    /// have to be made.
    pub(super) vertex: Vec<u32>,
    /// What each new vertex is a copy of.
    copies: Vec<u32>,
    /// Vertices that nothing uses any more.
    gone: Vec<u32>,
    pub(super) missing: u64,
}

impl Plan {
    /// `n_spare`: sources that are to be had beyond those of vertices that go. `root_of` is scratch space, a
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

    pub(super) fn is_idle(&self) -> bool {
        self.copies.is_empty() && self.gone.is_empty()
    }

    pub(super) fn carry_out(
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
    pub(super) fn rewire(
        &self,
        surface: &mut Surface,
        patch: &Patch,
        mut touched: Vec<u32>,
        simd: Simd,
    ) {
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
