//! Finds what a cut along three edges would separate from the rest of the surface.
//!
//! Both sides of the cut are walked in turn, so that the smaller one sets the price. If the walks meet, the cut
//! opens a handle and separates nothing. Changes nothing; `topology` decides what may be cut.

use super::legal::Class;
use super::surface::{GONE, MAX_VALENCE, Surface};

/// Vertices that are visited before the search gives up.
const MAX_VISITED: usize = 1024;

/// The effect of a cut on the component it runs through.
pub(crate) enum Separation {
    /// It stays in one piece.
    None,
    /// These triangles would be a component of their own.
    Part(Vec<u32>),
    /// Neither was found out; both sides are large, or a locked vertex may join them elsewhere.
    Unknown,
}

/// Triangles around the three corners of a cut on one of its sides, corner by corner.
pub(crate) type Side = [Vec<u32>; 3];

/// Walks from both sides of a cut along `cycle`.
pub(crate) fn separation(surface: &Surface, cycle: [u32; 3], sides: &[Side; 2]) -> Separation {
    let mut reached = Reached::new();
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
        if lists[0].len() + lists[1].len() > MAX_VISITED {
            return Separation::Unknown;
        }
    }
}

/// Table of the side that each vertex was reached from, with open addressing, at most half full.
struct Reached(Vec<u64>);

impl Reached {
    const BITS: u32 = 12;
    const EMPTY: u64 = u64::MAX;

    fn new() -> Self {
        // One more step adds a ring at most.
        const { assert!((1 << Self::BITS) >= 2 * (MAX_VISITED + 4 * MAX_VALENCE as usize)) };
        Reached(vec![Self::EMPTY; 1 << Self::BITS])
    }

    /// Notes a vertex; gives back the side that it was reached from before, and leaves it at that.
    fn insert(&mut self, v: u32, side: usize) -> Option<usize> {
        let mask = self.0.len() - 1;
        let mut at = (v.wrapping_mul(0x9E37_79B1) >> (32 - Self::BITS)) as usize;
        loop {
            let slot = &mut self.0[at];
            if *slot == Self::EMPTY {
                *slot = u64::from(v) << 1 | side as u64;
                return None;
            }
            if *slot >> 1 == u64::from(v) {
                return Some((*slot & 1) as usize);
            }
            at = (at + 1) & mask;
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
