//! Collapses that were refused: each is again as long as neither end has changed.

use crate::options::MAX_VERTICES;
use crate::surface::Surface;
use crate::vertex::GONE;

/// Bit of the first end: a triangle would turn far.
const TURNS: u32 = 1 << 31;
const _: () = assert!(MAX_VERTICES < TURNS as u64);

/// Places that the ends of a collapse may be in: those of one line of the cache.
const WAYS: usize = 4;
/// Triangles of the surface for each place: when nearly all is refused, a tenth to a hundredth of them is left.
const TRIANGLES: usize = 4;

/// A collapse that was refused, and the stamps of its ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Refused {
    ends: [u32; 2],
    stamps: [u32; 2],
}

impl Refused {
    const NONE: Refused = Refused { ends: [GONE; 2], stamps: [0; 2] };
}

/// Refused collapses as far as there is room for them.
#[derive(Clone, Debug)]
pub(super) struct RefusedCollapses {
    /// A power of two of them, two or more. The last to come is the first of its line.
    lines: Vec<[Refused; WAYS]>,
}

impl RefusedCollapses {
    pub(super) fn new(n_triangles: usize) -> RefusedCollapses {
        let n_lines = (n_triangles / TRIANGLES / WAYS).max(2).next_power_of_two();
        RefusedCollapses { lines: vec![[Refused::NONE; WAYS]; n_lines] }
    }

    /// Memory of it in bytes: at most 8 a triangle.
    pub(super) fn bytes(&self) -> u64 {
        size_of_val(&*self.lines) as u64
    }

    fn line(&self, [v0, v1]: [u32; 2]) -> usize {
        let hash = (v0 & !TURNS).wrapping_mul(0x9E37_79B1) ^ v1.wrapping_mul(0x85EB_CA77);
        (hash >> (32 - self.lines.len().trailing_zeros())) as usize
    }

    fn add_one(&mut self, refused: Refused) {
        let place = self.line(refused.ends);
        let line = &mut self.lines[place];
        let old = line.iter().position(|one| one.ends == refused.ends).unwrap_or(WAYS - 1);
        line[..=old].rotate_right(1);
        line[0] = refused;
    }

    /// Adds a collapse that was refused just now.
    pub(super) fn add(&mut self, surface: &Surface, ends: [u32; 2], turns: bool) {
        let stamps = ends.map(|v| surface.vertices[v as usize].stamp);
        self.add_one(Refused { ends: key(ends, turns), stamps });
    }

    /// True if a collapse was refused, and both ends are as they were then.
    #[inline(always)]
    pub(super) fn holds(&self, surface: &Surface, ends: [u32; 2], turns: bool) -> bool {
        let stamps = ends.map(|v| surface.vertices[v as usize].stamp);
        self.lines[self.line(ends)].contains(&Refused { ends: key(ends, turns), stamps })
    }

    /// Forgets collapses with an end that has changed, before a compaction, which begins with new stamps.
    pub(super) fn forget_changed(&mut self, surface: &Surface) {
        let is_as_it_was = |one: &Refused| {
            let ends = [one.ends[0] & !TURNS, one.ends[1]];
            let are_there = one.ends[1] != GONE
                && ends.iter().all(|&v| surface.rings[v as usize].class.is_some());
            are_there && ends.map(|v| surface.vertices[v as usize].stamp) == one.stamps
        };
        for one in self.lines.as_flattened_mut() {
            *one =
                if is_as_it_was(one) { Refused { stamps: [0; 2], ..*one } } else { Refused::NONE };
        }
    }

    /// Takes over new numbers of the vertices, after the compaction.
    pub(super) fn renumber(&mut self, place: &[u32]) {
        let lines = vec![[Refused::NONE; WAYS]; self.lines.len()];
        let old = std::mem::replace(&mut self.lines, lines);
        for Refused { ends, stamps } in
            old.into_iter().flatten().filter(|one| *one != Refused::NONE)
        {
            let now = [ends[0] & !TURNS, ends[1]].map(|v| place[v as usize]);
            if !now.contains(&GONE) {
                self.add_one(Refused { ends: [now[0] | ends[0] & TURNS, now[1]], stamps });
            }
        }
    }
}

fn key([v0, v1]: [u32; 2], turns: bool) -> [u32; 2] {
    [v0 | if turns { TURNS } else { 0 }, v1]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::Simd;
    use crate::state::MeshState;
    use stonecut_mesh::Mesh;

    #[test]
    fn what_was_refused_is_known_until_an_end_changes_also_by_new_numbers() {
        //  3---2---5
        //  | / | / |
        //  0---1---4
        let triangles = vec![[0, 1, 2], [0, 2, 3], [1, 4, 5], [1, 5, 2]];
        let at = |x: f64, y: f64| [x, y, 0.1 * x * y];
        let corners = [[0.0; 2], [1.0, 0.0], [1.0; 2], [0.0, 1.0], [2.0, 0.0], [2.0, 1.0]];
        let mesh = Mesh::new(corners.map(|[x, y]| at(x, y)).to_vec(), triangles);
        let mut surface = MeshState::new(mesh, &[false; 6], (&[], &[]), Simd::Portable).0.surface;
        let mut refused = RefusedCollapses::new(1);
        refused.add(&surface, [1, 2], false);
        refused.add(&surface, [3, 2], true);
        assert!(refused.holds(&surface, [1, 2], false) && refused.holds(&surface, [3, 2], true));
        assert!(!refused.holds(&surface, [1, 2], true) && !refused.holds(&surface, [2, 1], false));
        surface.vertices[3].stamp = 7;
        assert!(!refused.holds(&surface, [3, 2], true));
        refused.forget_changed(&surface);
        surface.vertices[3].stamp = 0;
        assert!(!refused.holds(&surface, [3, 2], true));
        refused.renumber(&[GONE, 0, 1, 2, 3, 4]);
        assert!(refused.holds(&surface, [0, 1], false) && !refused.holds(&surface, [1, 2], false));
        // More than there is room for: the last ones stay, and the others are looked at again.
        let mut all = (0..6).flat_map(|v| (0..6).map(move |w| [v, w])).filter(|[v, w]| v != w);
        all.clone().for_each(|ends| refused.add(&surface, ends, false));
        assert!(refused.holds(&surface, [5, 4], false));
        assert!(all.any(|ends| !refused.holds(&surface, ends, false)));
    }
}
