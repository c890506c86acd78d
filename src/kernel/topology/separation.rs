//! Finds what a cut along three edges would separate from the rest of the surface.
//!
//! Both sides of the cut are walked in turn, so that the smaller one sets the price. If the walks meet, the cut
//! opens a handle and separates nothing. Changes nothing; `topology` decides what may be cut.

use crate::surface::class::Class;
use crate::surface::{MAX_VALENCE, Surface};
use crate::vertex::GONE;

/// The effect of a cut on the component it runs through.
pub(crate) enum Separation {
    /// It stays in one piece.
    None,
    /// These triangles would be a separate component.
    Part(Vec<u32>),
    /// Neither was found out; both sides are large, or a locked vertex may join them elsewhere.
    Unknown,
}

/// Limits of the walks, in vertices.
#[derive(Clone, Copy)]
pub(crate) struct WalkReach {
    /// The search ends when both sides have more vertices than this, ...
    each: usize,
    /// ... or both together more than this.
    both: usize,
}

/// Enough to find a part of a few triangles; a fan of 24 of them has 26 vertices.
pub(crate) const NEAR: WalkReach = WalkReach { each: 26, both: 192 };
/// Enough to find out that a cut opens a handle, as a rule.
pub(crate) const FAR: WalkReach = WalkReach { each: usize::MAX, both: 1024 };

/// Slots of the table of reached vertices, twice as many as vertices at most: one more step adds a ring.
const fn slots(reach: WalkReach) -> usize {
    (2 * (reach.both + 4 * MAX_VALENCE as usize)).next_power_of_two()
}

/// Triangles around the three corners of a cut on one of its sides, corner by corner.
pub(crate) type Side = [Vec<u32>; 3];

/// Walks from both sides of a cut along `cycle`, a little way.
pub(crate) fn separation_near(surface: &Surface, cycle: [u32; 3], sides: &[Side; 2]) -> Separation {
    separation::<{ slots(NEAR) }>(surface, cycle, sides, NEAR)
}

/// The same as far as it is worth.
pub(crate) fn separation_far(surface: &Surface, cycle: [u32; 3], sides: &[Side; 2]) -> Separation {
    separation::<{ slots(FAR) }>(surface, cycle, sides, FAR)
}

fn separation<const SLOTS: usize>(
    surface: &Surface,
    cycle: [u32; 3],
    sides: &[Side; 2],
    reach: WalkReach,
) -> Separation {
    let mut reached = Reached::<SLOTS>::new();
    let mut lists: [Vec<u32>; 2] = Default::default();
    for (side, triangles) in sides.iter().enumerate() {
        for &t in triangles.iter().flatten() {
            for v in surface.triangles[t as usize].into_iter().filter(|v| !cycle.contains(v)) {
                match reached.insert(v, side) {
                    Some(other) if other != side => return Separation::None,
                    Some(_) => {}
                    None => lists[side].push(v),
                }
            }
        }
    }
    let mut next = [0usize; 2];
    loop {
        for side in 0..2 {
            let Some(&v) = lists[side].get(next[side]) else {
                return part(surface, cycle, &sides[side], &lists[side]);
            };
            next[side] += 1;
            if surface.rings[v as usize].len > MAX_VALENCE {
                return Separation::Unknown;
            }
            for &t in surface.ring(v) {
                let triangle = surface.triangles[t as usize];
                if triangle[0] == GONE {
                    continue;
                }
                for w in triangle.into_iter().filter(|w| !cycle.contains(w)) {
                    match reached.insert(w, side) {
                        Some(other) if other != side => return Separation::None,
                        Some(_) => {}
                        None => lists[side].push(w),
                    }
                }
            }
        }
        let [left, right] = [lists[0].len(), lists[1].len()];
        if left + right > reach.both || left.min(right) > reach.each {
            return Separation::Unknown;
        }
    }
}

/// Table of the side that each vertex was reached from, with open addressing, at most half full.
struct Reached<const SLOTS: usize>([u32; SLOTS]);

impl<const SLOTS: usize> Reached<SLOTS> {
    const EMPTY: u32 = u32::MAX;

    fn new() -> Self {
        Reached([Self::EMPTY; SLOTS])
    }

    /// Notes a vertex; gives back the side that it was reached from before, and leaves it at that.
    fn insert(&mut self, v: u32, side: usize) -> Option<usize> {
        let entry = v << 1 | side as u32;
        let mut at = (v.wrapping_mul(0x9E37_79B1) >> 8) as usize & (SLOTS - 1);
        loop {
            let slot = &mut self.0[at];
            if *slot == Self::EMPTY {
                *slot = entry;
                return None;
            }
            if *slot >> 1 == v {
                return Some((*slot & 1) as usize);
            }
            at = (at + 1) & (SLOTS - 1);
        }
    }
}

/// All triangles of the vertices of one side; `Unknown` if one of those is locked.
fn part(surface: &Surface, cycle: [u32; 3], side: &Side, vertices: &[u32]) -> Separation {
    let is_locked = |&v: &u32| surface.rings[v as usize].class == Some(Class::Locked);
    if vertices.iter().any(is_locked) {
        return Separation::Unknown;
    }
    let mut triangles: Vec<u32> = side.iter().flatten().copied().collect();
    for &v in vertices {
        triangles
            .extend(surface.ring(v).iter().filter(|&&t| surface.triangles[t as usize][0] != GONE));
    }
    triangles.sort_unstable();
    triangles.dedup();
    debug_assert!(cycle.iter().all(|v| surface.rings[*v as usize].len > 0), "the cut is in use");
    Separation::Part(triangles)
}
