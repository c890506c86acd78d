//! Triangles of the mesh laid over the stars of the vertices that their corners went into, star by star.
//!
//! A triangle over none of its stars is quartered once, and its quarters are tried over the same stars. What is found for a
//! corner over a star serves all triangles around it.

use super::around::{Forward, NONE};
use super::patches::Patches;
use super::star::{Place, Star};
use crate::triangle::Vector;
use crate::wide::{WideJob, run};

/// Corners of the four quarters of a triangle, by the numbers of its corners and of the middles of its sides.
pub(super) const QUARTERS: [[usize; 3]; 4] = [[0, 3, 5], [1, 4, 3], [2, 5, 4], [3, 4, 5]];

/// Triangles as they lie over stars.
pub(super) struct Covered {
    /// The distance of each triangle of the mesh, at most; infinite for those that do not lie over stars, whole or in quarters.
    pub(super) most: Vec<f64>,
    /// Triangles of which only some quarters lie over stars, or none.
    pub(super) rest: Vec<Quartered>,
}

/// A triangle over no star.
#[derive(Clone, Copy)]
pub(super) struct Quartered {
    pub(super) triangle: u32,
    /// Quarters that lie over stars; a bit for each.
    pub(super) done: u32,
    /// Their distance, at most.
    pub(super) most: f64,
}

/// A look at all triangles as a whole.
struct StarLook<'a> {
    covered: &'a mut Covered,
    forward: &'a Forward<'a>,
    patches: &'a Patches,
}

impl WideJob for StarLook<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        self.covered.whole(self.forward, self.patches);
    }
}

/// Corners of a triangle and the middles of its sides.
pub(super) fn with_middles([a, b, c]: [Vector; 3]) -> [Vector; 6] {
    let middle = |p: Vector, q: Vector| [0, 1, 2].map(|k| 0.5 * (p[k] + q[k]));
    [a, b, c, middle(a, b), middle(b, c), middle(c, a)]
}

impl Covered {
    /// Looks at every triangle over the stars of the vertices that its corners went into; `hints` are these by the vertices
    /// of the mesh.
    pub(super) fn find(forward: &Forward, patches: &Patches, hints: &[u32]) -> Covered {
        let fine = forward.fine;
        let mut covered =
            Covered { most: vec![f64::INFINITY; fine.triangles.len()], rest: Vec::new() };
        run(StarLook { covered: &mut covered, forward, patches });
        covered.quarters(forward, hints);
        covered
    }

    #[inline(always)]
    pub(super) fn whole(&mut self, forward: &Forward, patches: &Patches) {
        let Forward { fine, coarse, around } = *forward;
        let mut star = Star::new();
        let mut places: Vec<Place> = Vec::new();
        for v in 0..coarse.positions.len() as u32 {
            let (triangles, vertices) = (patches.triangles(v), patches.vertices(v));
            let is_small = vertices.len() <= usize::from(u16::MAX);
            if triangles.is_empty() || !is_small || !star.set(coarse, v, around.of(v)) {
                continue;
            }
            places.clear();
            places.resize(vertices.len(), Place::UNKNOWN);
            for (&t, corners) in triangles.iter().zip(patches.corners(v)) {
                let most = &mut self.most[t as usize];
                if most.is_finite() {
                    continue;
                }
                let mut is_over = true;
                for k in corners.map(usize::from) {
                    if places[k].is_unknown() {
                        places[k] = star.place(fine.positions[vertices[k] as usize]);
                    }
                    is_over &= !places[k].is_outside();
                    if !is_over {
                        break;
                    }
                }
                let corners = corners.map(|k| &places[usize::from(k)]);
                if is_over && let Some(over) = star.over(corners) {
                    *most = over;
                }
            }
        }
    }

    /// Tries the quarters of triangles over no star, star by star.
    fn quarters(&mut self, forward: &Forward, hints: &[u32]) {
        let Forward { fine, coarse, around } = *forward;
        let left = (0..self.most.len() as u32).filter(|&t| !self.most[t as usize].is_finite());
        let rest = left.map(|triangle| Quartered { triangle, done: 0, most: 0.0 });
        let mut rest: Vec<Quartered> = rest.collect();
        let mut tries: Vec<(u32, u32)> = Vec::new();
        for (n, quartered) in (0u32..).zip(&rest) {
            let near = fine.triangles[quartered.triangle as usize].map(|v| hints[v as usize]);
            for k in 0..3 {
                if near[k] != NONE && !near[..k].contains(&near[k]) {
                    tries.push((near[k], n));
                }
            }
        }
        tries.sort_unstable();
        let mut star = Star::new();
        for tries in tries.chunk_by(|a, b| a.0 == b.0) {
            let v = tries[0].0;
            if !star.set(coarse, v, around.of(v)) {
                continue;
            }
            for &(_, n) in tries {
                let quartered = &mut rest[n as usize];
                let corners = fine.corners(quartered.triangle as usize);
                let places = with_middles(corners).map(|point| star.place(point));
                for (quarter, parts) in QUARTERS.iter().enumerate() {
                    let parts = parts.map(|k| &places[k]);
                    let bit = 1 << quarter;
                    if quartered.done & bit != 0 || parts.iter().any(|p| p.is_outside()) {
                        continue;
                    }
                    if let Some(over) = star.over(parts) {
                        quartered.done |= bit;
                        quartered.most = quartered.most.max(over);
                    }
                }
            }
        }
        let all = (1 << QUARTERS.len()) - 1;
        rest.retain(|quartered| {
            let is_done = quartered.done == all;
            if is_done {
                self.most[quartered.triangle as usize] = quartered.most;
            }
            !is_done
        });
        self.rest = rest;
    }
}
