//! The witnesses, and the triangles of the surface that they belong to.

use super::input::{BoundInput, NONE, Witness};
use super::original::original_points;
use super::refused::RefusedCollapses;
use super::scratch::Scratch;
use super::tight::TightPlaces;
use crate::options::Tight;
use crate::simd::Simd;
use crate::surface::Surface;
use crate::vertex::GONE;
use std::collections::HashSet;
use stonecut_mesh::extremes::Extremes;
use stonecut_mesh::vec3::{Vec3, triangle_distance_sq};

/// The witnesses, and which triangle each belongs to.
///
/// Memory: 41 bytes a vertex and 24 a triangle of the input, 36 a point of the original and then 5 a vertex more, 4 a triangle of the surface, and
/// 8 a triangle for what was refused.
#[derive(Clone)]
pub(crate) struct Tracker {
    /// Scaled.
    pub(super) limit: f32,
    pub(super) centre: Vec3,
    pub(super) scale: f64,
    pub(super) simd: Simd,
    pub(super) input: BoundInput,
    /// The first witness of each triangle.
    pub(super) head: Vec<u32>,
    /// Place of each witness in `scratch`, if it is.
    pub(super) slot: Vec<u32>,
    pub(super) scratch: Scratch,
    pub(super) refused: RefusedCollapses,
    /// Triangles that a cut has made.
    pub(super) caps: HashSet<u32>,
    /// The part of `Witness::before` that only keeps the bound tighter there, negative outside of all balls; empty if there are
    /// none. Scaled.
    pub(super) margins: Vec<f32>,
    /// While an earlier run is repeated: true for each vertex of the surface that is not as it was then. Else empty.
    pub(crate) changed: Vec<bool>,
}

/// Share of the bound that is used: what lies between the points that are looked at may be a little farther.
const KEPT: f64 = 0.98;

/// Share that counts of what a round before has used at a vertex, where points of the surface are held against the input and
/// points of the original are known: all of it would add up what points the other way (docs/design/bound.md).
const CARRIED: f32 = 0.6;

/// Coordinates are rounded to `f32` about the centre, which moves distances there by at most this share of the largest of them; and
/// of this many scaled units near the centre.
const ROUNDING: f32 = 4.0 * f32::EPSILON;
const LEAST_FAR: f32 = 64.0;
/// Vertices whose middle coordinates are the centre, at most.
const MOST_SAMPLES: usize = 4096;

impl Tracker {
    /// Begins to watch a surface, in input units; `before` is for each vertex how far it is from the original, `extremes` are
    /// points of the original over each triangle. If there are any, they alone tell how far it is away, but within the balls of `tight`.
    pub(crate) fn new(
        surface: &Surface,
        limit: f64,
        simd: Simd,
        tight: &[Tight],
        (before, extremes): (impl Fn(u32) -> f32, &[Extremes]),
    ) -> Tracker {
        let tight = TightPlaces::new(tight);
        let n_vertices = surface.vertices.len();
        let n_points: usize = extremes.iter().map(|extremes| extremes.offsets().count()).sum();
        // Where points of the original are relied on, vertices that are not on it say nothing of it.
        let has_points = n_points > 0;
        let n_margins = if tight.is_empty() { 0 } else { n_vertices + n_points };
        let mut margins: Vec<f32> = Vec::with_capacity(n_margins);
        let centre = middle(surface);
        let mut witness = |place: Vec3, before: f32, margin: Option<f64>| {
            let at = [0, 1, 2].map(|k| ((place[k] - centre[k]) * surface.scale) as f32);
            let far = at.iter().fold(LEAST_FAR, |far, x| far.max(x.abs()));
            if n_margins > 0 {
                margins.push(margin.map_or(-1.0, |margin| (margin * surface.scale) as f32));
            }
            let margin = (margin.unwrap_or(0.0) * surface.scale) as f32;
            Witness {
                at,
                before: before * surface.scale as f32 + margin + ROUNDING * far,
                longest: 0.0,
                distance: 0.0,
                owner: GONE,
                next: NONE,
            }
        };
        let mut witnesses = Vec::with_capacity(n_vertices + n_points);
        let n_behind = if has_points { n_vertices } else { 0 };
        let (mut behind, mut is_original) =
            (Vec::with_capacity(n_behind), Vec::with_capacity(n_behind));
        for (v, vertex) in surface.vertices.iter().enumerate() {
            let (before, margin) = (before(v as u32), tight.margin(vertex.position));
            let (counts, is_behind) = match has_points && margin.is_none() {
                true => (0.0, CARRIED * before),
                false => (before, 0.0),
            };
            witnesses.push(witness(vertex.position, counts, margin));
            if has_points {
                behind.push(is_behind * surface.scale as f32);
                is_original.push(before == 0.0);
            }
        }
        let mut input = BoundInput::new(witnesses, &surface.triangles);
        (input.behind, input.is_original) = (behind, is_original);
        for point in original_points(surface, extremes) {
            let corners = surface.triangles[point.triangle as usize]
                .map(|v| surface.vertices[v as usize].position);
            let distance = triangle_distance_sq(point.at, corners).sqrt();
            let witness = witness(point.at, point.rounding, tight.margin(point.at));
            let distance = (distance * surface.scale) as f32;
            input.witnesses.push(Witness { distance, ..witness });
        }
        let n = input.witnesses.len();
        let mut tracker = Tracker {
            limit: (KEPT * limit * surface.scale) as f32,
            centre,
            scale: surface.scale,
            simd,
            input,
            head: vec![NONE; surface.triangles.len()],
            slot: vec![0; n],
            scratch: Scratch::default(),
            refused: RefusedCollapses::new(surface.triangles.len()),
            caps: HashSet::new(),
            margins,
            changed: Vec::new(),
        };
        for (id, t) in surface.triangles.iter().enumerate().filter(|(_, t)| t[0] != GONE) {
            for &v in t {
                if tracker.input.witnesses[v as usize].owner == GONE {
                    tracker.own(v, id as u32);
                }
            }
        }
        for (id, point) in (n_vertices as u32..).zip(original_points(surface, extremes)) {
            tracker.own(id, point.triangle);
        }
        tracker
    }

    /// True for a witness that is a point of the original, exactly.
    pub(super) fn is_original(&self, witness: u32) -> bool {
        self.input.is_original.get(witness as usize).is_none_or(|&is_original| is_original)
    }

    /// True if points of the original stand for it.
    #[inline(always)]
    pub(super) fn has_points(&self) -> bool {
        !self.input.is_original.is_empty()
    }

    /// True for a witness within a ball.
    #[inline(always)]
    pub(super) fn is_in_ball(&self, witness: u32) -> bool {
        self.margins.get(witness as usize).is_some_and(|&margin| margin >= 0.0)
    }

    /// True for a witness that tells how far the surface is from the original: a point of it, or a vertex whose whole distance
    /// from it counts.
    fn tells(&self, witness: u32) -> bool {
        self.is_original(witness) || self.input.behind[witness as usize] == 0.0
    }

    /// Memory that it holds, in bytes.
    pub(crate) fn bytes(&self) -> u64 {
        let places = 4 * (self.head.len() + self.slot.len() + self.margins.len());
        self.input.bytes() + self.refused.bytes() + places as u64
    }

    /// Gives a witness to a triangle. The farthest one comes first: it is the most likely to forbid a collapse.
    pub(super) fn own(&mut self, witness: u32, triangle: u32) {
        let first = self.head[triangle as usize];
        let is_first = first == NONE || self.far(witness) >= self.far(first);
        let next = match is_first {
            true => std::mem::replace(&mut self.head[triangle as usize], witness),
            false => std::mem::replace(&mut self.input.witnesses[first as usize].next, witness),
        };
        let witness = &mut self.input.witnesses[witness as usize];
        (witness.owner, witness.next) = (triangle, next);
    }

    /// Distance of the surface from the original at a witness, at most; scaled.
    pub(super) fn far(&self, witness: u32) -> f32 {
        let witness = &self.input.witnesses[witness as usize];
        witness.distance + witness.before
    }

    pub(super) fn local(&self, position: Vec3) -> [f32; 3] {
        std::array::from_fn(|k| ((position[k] - self.centre[k]) * self.scale) as f32)
    }

    /// Takes over the new numbers of the vertices of a surface that is compact.
    pub(crate) fn after_compaction(&mut self, place: &[u32]) {
        self.refused.renumber(place);
    }

    /// Takes over the numbers that triangles get when those that are gone are dropped.
    pub(crate) fn before_compaction(&mut self, surface: &Surface) {
        self.refused.forget_changed(surface);
        let triangles = &surface.triangles;
        let mut place = vec![GONE; triangles.len()];
        let mut n = 0;
        for (place, _) in place.iter_mut().zip(triangles).filter(|(_, t)| t[0] != GONE) {
            *place = n;
            n += 1;
        }
        let mut head = vec![NONE; n as usize];
        for (&first, &place) in self.head.iter().zip(&place).filter(|(_, place)| **place != GONE) {
            head[place as usize] = first;
        }
        self.head = head;
        let caps = std::mem::take(&mut self.caps).into_iter().map(|t| place[t as usize]);
        self.caps = caps.filter(|&t| t != GONE).collect();
        for witness in self.input.witnesses.iter_mut().filter(|witness| witness.owner != GONE) {
            witness.owner = place[witness.owner as usize];
        }
    }

    /// For each vertex of the surface how far it and the triangles around it are from the original, at most; in
    /// input units.
    pub(crate) fn reach(&self, surface: &Surface) -> Vec<f32> {
        let mut reach = vec![0.0f32; surface.vertices.len()];
        let owned = self.input.witnesses.iter().enumerate().filter(|(_, one)| one.owner != GONE);
        for (witness, one) in owned.filter(|&(witness, _)| self.tells(witness as u32)) {
            let margin = self.margins.get(witness).map_or(0.0, |margin| margin.max(0.0));
            let far = self.far(witness as u32) - margin;
            for v in surface.triangles[one.owner as usize] {
                let reach = &mut reach[v as usize];
                *reach = reach.max(far);
            }
        }
        let unscale = surface.unscale as f32;
        reach.iter_mut().for_each(|reach| *reach *= unscale);
        reach
    }
}

/// The middle coordinates of a sample of the vertices: a few that lie far from all others do not move it.
fn middle(surface: &Surface) -> Vec3 {
    let step = surface.vertices.len().div_ceil(MOST_SAMPLES).max(1);
    [0, 1, 2].map(|k| {
        let sample = surface.vertices.iter().step_by(step);
        let mut along: Vec<f64> = sample.map(|vertex| vertex.position[k]).collect();
        let half = along.len() / 2;
        if along.is_empty() { 0.0 } else { *along.select_nth_unstable_by(half, f64::total_cmp).1 }
    })
}
