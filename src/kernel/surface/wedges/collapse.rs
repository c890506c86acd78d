//! Collapses at attribute seams: which wedges become one, and which values they get.
//!
//! Its cost is in `cost::seam`; its legality is decided by the caller.

use super::Wedges;
use super::pairs::Pairs;
use crate::surface::class::Class;
use crate::surface::{MAX_VALENCE, Surface};
use stonecut_mesh::blend::between;
use stonecut_mesh::corners::others;

/// A collapse at a seam under way.
pub(crate) struct SeamPlan {
    pairs: Pairs,
    /// New values of all wedges that the survivor will have.
    values: Vec<(u32, Vec<f32>)>,
}

impl Wedges {
    /// Plans a collapse at a seam before it is carried out; `s` is its place on the edge, 0 at `v0`.
    pub(crate) fn plan(&self, surface: &Surface, (v0, v1): (u32, u32), s: f32) -> SeamPlan {
        let pairs = Pairs::of(self, surface, v0, v1);
        let mix = |a: f32, b: f32| match s {
            1.0 => b,
            0.0 => a,
            _ => between(a, b, s),
        };
        let common: Vec<Option<f32>> = (0..self.n_channels)
            .map(|channel| {
                let ends = [v0, v1].map(|v| self.common(surface, v, channel));
                ends[0].zip(ends[1]).map(|(a, b)| mix(a, b))
            })
            .collect();
        let mut values: Vec<(u32, Vec<f32>)> = Vec::new();
        let after0 = surface.ring(v0).iter().map(|&t| {
            let wedge = self.at(surface, t, v0);
            pairs.of_v0(wedge).map_or(wedge, |pair| pair.1)
        });
        for wedge in after0.chain(surface.ring(v1).iter().map(|&t| self.at(surface, t, v1))) {
            if values.iter().any(|(known, _)| *known == wedge) {
                continue;
            }
            let own = self.values_of(wedge);
            let from = pairs.of_v1(wedge).map(|pair| self.values_of(pair.0));
            let value = |channel: usize| match (common[channel], from) {
                (Some(value), _) => value,
                (None, Some(from)) => mix(from[channel], own[channel]),
                (None, None) => own[channel],
            };
            values.push((wedge, (0..self.n_channels).map(value).collect()));
        }
        SeamPlan { pairs, values }
    }

    /// True if one of these triangles of `v0` will use the wedge that came with `v1`.
    pub(crate) fn becomes_own(
        &self,
        surface: &Surface,
        triangles: &[u32],
        (v0, v1): (u32, u32),
    ) -> bool {
        let pairs = Pairs::of(self, surface, v0, v1);
        triangles.iter().any(|&t| {
            let pair = pairs.of_v0(self.at(surface, t, v0));
            pair.is_some_and(|(_, new)| self.source[new as usize] == surface.source[v1 as usize])
        })
    }

    /// The value of a channel that all wedges of a vertex have in common, if they do.
    fn common(&self, surface: &Surface, v: u32, channel: usize) -> Option<f32> {
        let ring = surface.ring(v);
        let value = |&t: &u32| self.values_of(self.at(surface, t, v))[channel];
        let first = value(ring.first()?);
        let same =
            !self.is_seam[v as usize] || ring.iter().all(|t| value(t).to_bits() == first.to_bits());
        same.then_some(first)
    }

    /// After the collapse: renames the corners that came from `v0` (those of `triangles`), and sets values.
    pub(crate) fn carry_out(
        &mut self,
        surface: &mut Surface,
        triangles: &[u32],
        v1: u32,
        plan: SeamPlan,
    ) {
        for (wedge, values) in plan.values {
            let at = wedge as usize * self.n_channels;
            self.values[at..at + self.n_channels].copy_from_slice(&values);
        }
        for &t in triangles {
            let corners = surface.triangles[t as usize];
            for (corner, &v) in self.corner[t as usize].iter_mut().zip(&corners) {
                if let (true, Some((_, new))) = (v == v1, plan.pairs.of_v0(*corner)) {
                    *corner = new;
                }
            }
        }
        // What it was before says nothing of what came with `v0`.
        self.is_seam[v1 as usize] = true;
        self.look_again(surface, v1);
        // Charts may have vanished from the third corners, too.
        let mut around: Vec<u32> = Vec::with_capacity(2 * surface.ring(v1).len());
        for &t in surface.ring(v1) {
            let (b, c) = others(surface.triangles[t as usize], v1);
            around.extend([b, c]);
        }
        around.sort_unstable();
        around.dedup();
        for w in around {
            self.look_again(surface, w);
        }
    }

    /// Updates `is_seam` of `v`; off the seams, the values of its wedge become the surface's.
    pub(crate) fn look_again(&mut self, surface: &mut Surface, v: u32) {
        if !self.is_seam[v as usize] {
            return;
        }
        let ring = surface.ring(v);
        // A vertex of more triangles takes part in no collapse, and its seams stay.
        if ring.len() > MAX_VALENCE as usize {
            return;
        }
        // Wedges that have come to the same values are one: the seam is closed there.
        // That of a locked vertex is the one to stay: other cells know it.
        let own =
            ring.iter().find(|&&t| self.is_own(surface, t, v)).map(|&t| self.at(surface, t, v));
        let is_locked = surface.rings[v as usize].class == Some(Class::Locked);
        let mut kept: Vec<u32> = own.filter(|_| is_locked).into_iter().collect();
        for &t in ring {
            let wedge = self.at(surface, t, v);
            let own = self.values_of(wedge);
            match kept.iter().find(|&&w| w == wedge || self.values_of(w) == own).copied() {
                None => kept.push(wedge),
                Some(same) if same != wedge => {
                    let k = surface.triangles[t as usize].iter().position(|&x| x == v);
                    self.corner[t as usize][k.unwrap_or(0)] = same;
                }
                Some(_) => {}
            }
        }
        let Some(first) = self.single(surface, v) else { return };
        self.is_seam[v as usize] = ring.iter().any(|&t| self.at(surface, t, v) != first);
        if !self.is_seam[v as usize] {
            let at = v as usize * surface.n_channels;
            surface.channels[at..at + self.n_channels].copy_from_slice(self.values_of(first));
        }
    }
}
