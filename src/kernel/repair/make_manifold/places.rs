//! Vertices that lie in the same place, and those that mending has to look at.

use crate::repair::curves::Curves;
use crate::surface::Surface;
use crate::surface::class::Class;
use crate::vertex::GONE;
use stonecut_mesh::vec3::place_bits;

/// No number of a vertex or corner.
pub(super) const NONE: u32 = u32::MAX;

/// Vertices that lie in the same place, and those that mending looks at.
pub(super) struct Places {
    /// For each vertex the first one in exactly the same place, if both are open or locked; else itself.
    pub(super) place: Vec<u32>,
    /// Non-manifold vertices off junction curves, and open ones that share their place. All others stay what they are: one fan.
    pub(super) is_affected: Vec<bool>,
    /// Edges at which bodies meet (`Curves::into_rims`).
    pub(super) rims: Vec<[u32; 2]>,
}

impl Places {
    /// `None` if no vertex is affected. With `has_seams`, sheets between locked vertices of one place belong together.
    pub(super) fn new(surface: &Surface, has_seams: bool) -> Option<Self> {
        let is_complex =
            |v: u32| surface.rings[v as usize].class.is_some_and(Class::is_non_manifold);
        // Locked wedges in one place are not joined, but the sheets between them belong together all the same.
        let is_locked = |v: u32| surface.rings[v as usize].class == Some(Class::Locked);
        let mut open: Vec<([u64; 3], u32)> = Vec::new();
        for (v, ring) in surface.rings.iter().enumerate() {
            let is_open = match ring.class {
                Some(Class::Boundary | Class::Junction | Class::Complex) => true,
                Some(Class::Locked) => has_seams,
                Some(Class::Interior) | None => false,
            };
            if ring.len > 0 && is_open {
                open.push((place_bits(surface.vertices[v].position), v as u32));
            }
        }
        open.sort_unstable();
        let groups = || open.chunk_by(|a, b| a.0 == b.0);
        let is_met =
            |same: &[([u64; 3], u32)], v: u32| !is_locked(v) && (same.len() > 1 || is_complex(v));
        if groups().all(|same| same.iter().all(|&(_, v)| !is_met(same, v))) {
            return None;
        }
        let mut place: Vec<u32> = (0..surface.vertices.len() as u32).collect();
        let mut is_affected = vec![false; surface.vertices.len()];
        for same in groups() {
            for &(_, v) in same {
                place[v as usize] = same[0].1;
                is_affected[v as usize] = is_met(same, v);
            }
        }
        let mut places = Places { place, is_affected, rims: Vec::new() };
        places.spare_curves(surface);
        places.is_affected.contains(&true).then_some(places)
    }

    /// Sheets that meet along a curve stay together.
    fn spare_curves(&mut self, surface: &Surface) {
        // Copies of a locked vertex count as one here, whether they are joined or not.
        let locked = |v: &u32| surface.rings[*v as usize].class == Some(Class::Locked);
        let mut copies: Vec<([u64; 3], u32)> = (0..surface.rings.len() as u32)
            .filter(locked)
            .map(|v| (place_bits(surface.vertices[v as usize].position), v))
            .collect();
        copies.sort_unstable();
        let mut place = self.place.clone();
        for same in copies.chunk_by(|a, b| a.0 == b.0) {
            same.iter().for_each(|&(_, v)| place[v as usize] = same[0].1);
        }
        let is_affected = |v: u32| self.is_affected[v as usize];
        let is_inner = |v: u32| surface.rings[v as usize].class == Some(Class::Interior);
        let curves = Curves::find(surface, |v| place[v as usize], (is_affected, is_inner));
        // Copies that were not joined are paired as ever.
        let mut is_alone = vec![true; place.len()];
        for (v, &first) in self.place.iter().enumerate().filter(|&(v, &first)| first != v as u32) {
            (is_alone[v], is_alone[first as usize]) = (false, false);
        }
        for (v, place) in place.into_iter().enumerate() {
            if is_alone[v] && curves.has(place) {
                (self.place[v], self.is_affected[v]) = (v as u32, false);
            }
        }
        self.rims = curves.into_rims();
    }

    /// Triangles, ascending, of which at least `least` corners are affected.
    pub(super) fn triangles(&self, surface: &Surface, least: usize) -> Vec<u32> {
        let is_met = |t: &[u32; 3]| {
            t[0] != GONE && t.iter().filter(|&&v| self.is_affected[v as usize]).count() >= least
        };
        let all = surface.triangles.iter().enumerate();
        all.filter(|(_, t)| is_met(t)).map(|(id, _)| id as u32).collect()
    }
}
