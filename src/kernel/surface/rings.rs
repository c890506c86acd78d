//! Edits of rings: room in the arena, triangles that are taken out, lists that are set.

use crate::surface::{HUB, Surface};

impl Surface {
    /// Room for `n` more places at the end of the arena, filled with the number of some triangle.
    #[inline(always)]
    pub(crate) fn append_room(&mut self, n: usize) -> u32 {
        let start = self.arena.len();
        assert!(start + n <= u32::MAX as usize, "places in the arena are 32 bits wide");
        self.arena.resize(start + n, 0);
        start as u32
    }

    /// Takes a triangle that goes out of the ring of one of its corners; the ring of a hub keeps it until the
    /// vertex is settled or the surface compacted.
    pub(crate) fn remove_from_ring(&mut self, v: u32, triangle: u32) {
        let ring = &mut self.rings[v as usize];
        if ring.len > HUB {
            return;
        }
        let list = &mut self.arena[ring.start as usize..(ring.start + ring.len) as usize];
        if let Some(at) = list.iter().position(|&t| t == triangle) {
            list[at] = list[list.len() - 1];
            ring.len -= 1;
        }
    }

    /// Gives a vertex the triangles of `list` as its ring.
    pub(crate) fn set_ring(&mut self, v: u32, list: &[u32]) {
        let n = list.len() as u32;
        if n > self.rings[v as usize].room {
            let start = self.append_room(list.len());
            let ring = &mut self.rings[v as usize];
            (ring.start, ring.room) = (start, n);
        }
        let ring = &mut self.rings[v as usize];
        ring.len = n;
        let start = ring.start as usize;
        self.arena[start..start + list.len()].copy_from_slice(list);
    }
}
