//! The witnesses, and the triangles of the surface that they belong to.

use super::input::{Input, NONE, Witness};
use super::scratch::{MOST_REFUSED, Refused, Scratch};
use super::tight::TightPlaces;
use crate::kernel::options::Tight;
use crate::kernel::simd::Simd;
use crate::kernel::surface::Surface;
use crate::kernel::vertex::GONE;
use crate::mesh::bounds::Bounds;
use crate::mesh::vec3::Vec3;
use std::collections::HashSet;

/// The witnesses, and which triangle each belongs to.
///
/// Memory: 41 bytes a vertex and 24 a triangle of the input, 4 a triangle of the surface, and 640 KiB for what was
/// refused.
#[derive(Clone)]
pub(crate) struct Tracker {
    /// Scaled.
    pub(super) limit: f32,
    pub(super) centre: Vec3,
    pub(super) scale: f64,
    pub(super) simd: Simd,
    pub(super) input: Input,
    /// The first witness of each triangle.
    pub(super) head: Vec<u32>,
    /// Place of each witness in `scratch`, if it is.
    pub(super) slot: Vec<u32>,
    pub(super) scratch: Scratch,
    pub(super) refused: Vec<Refused>,
    /// Triangles that a cut has made.
    pub(super) caps: HashSet<u32>,
    /// The part of `Witness::before` that only keeps the bound tighter there; empty if it is nowhere. Scaled.
    pub(super) margins: Vec<f32>,
}

/// Share of the bound that is used: what lies between the points that are looked at may be a little farther.
const KEPT: f64 = 0.98;

/// Coordinates are rounded to `f32` about the centre of a surface whose longest side is at most 2,048 scaled units.
const ROUNDING: f32 = 2048.0 * f32::EPSILON;

impl Tracker {
    /// Begins to watch a surface, in input units; `before` is for each vertex how far it is from the original.
    pub(crate) fn new(
        surface: &Surface,
        limit: f64,
        simd: Simd,
        tight: &[Tight],
        before: impl Fn(u32) -> f32,
    ) -> Tracker {
        let tight = TightPlaces::new(tight);
        let margin =
            |v: u32| (tight.margin(surface.vertices[v as usize].position) * surface.scale) as f32;
        let margins: Vec<f32> = match tight.is_empty() {
            true => Vec::new(),
            false => (0..surface.vertices.len() as u32).map(margin).collect(),
        };
        let centre = middle(surface);
        let witness = |v: u32| {
            let position = surface.vertices[v as usize].position;
            let local = |k: usize| ((position[k] - centre[k]) * surface.scale) as f32;
            Witness {
                at: [local(0), local(1), local(2)],
                before: before(v) * surface.scale as f32 + margins.get(v as usize).unwrap_or(&0.0),
                longest: 0.0,
                distance: 0.0,
                owner: GONE,
                next: NONE,
            }
        };
        let witnesses = (0..surface.vertices.len() as u32).map(witness).collect();
        let input = Input::new(witnesses, &surface.triangles);
        let n = input.witnesses.len();
        let mut tracker = Tracker {
            limit: ((KEPT * limit * surface.scale) as f32 - 2.0 * ROUNDING).max(0.0),
            centre,
            scale: surface.scale,
            simd,
            input,
            head: vec![NONE; surface.triangles.len()],
            slot: vec![0; n],
            scratch: Scratch::default(),
            refused: vec![Refused::NONE; MOST_REFUSED],
            caps: HashSet::new(),
            margins,
        };
        for (id, t) in surface.triangles.iter().enumerate().filter(|(_, t)| t[0] != GONE) {
            for &v in t {
                if tracker.input.witnesses[v as usize].owner == GONE {
                    tracker.own(v, id as u32);
                }
            }
        }
        tracker
    }

    /// Memory that it holds, in bytes.
    pub(crate) fn bytes(&self) -> u64 {
        let refused = self.refused.len() * size_of::<Refused>();
        let places = 4 * (self.head.len() + self.slot.len() + self.margins.len());
        self.input.bytes() + (refused + places) as u64
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

    /// Takes over the numbers that triangles get when those that are gone are dropped.
    pub(crate) fn before_compaction(&mut self, triangles: &[[u32; 3]]) {
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
        self.refused.fill(Refused::NONE);
        for witness in self.input.witnesses.iter_mut().filter(|witness| witness.owner != GONE) {
            witness.owner = place[witness.owner as usize];
        }
    }

    /// For each vertex of the surface how far it and the triangles around it are from the original, at most; in
    /// input units.
    pub(crate) fn reach(&self, surface: &Surface) -> Vec<f32> {
        let mut reach = vec![0.0f32; surface.vertices.len()];
        let owned = self.input.witnesses.iter().enumerate().filter(|(_, one)| one.owner != GONE);
        for (witness, one) in owned {
            let far = self.far(witness as u32) - self.margins.get(witness).unwrap_or(&0.0);
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

/// The middle of the surface's box.
fn middle(surface: &Surface) -> Vec3 {
    let mut bounds = Bounds::EMPTY;
    surface.vertices.iter().for_each(|vertex| bounds.add(vertex.position));
    bounds.or_origin().middle()
}
