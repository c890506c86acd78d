//! The mesh while its vertices are removed: triangles in place, and for each vertex a list of those around it.

/// The mark of a removed triangle, and of the end of a list.
const NONE: u32 = u32::MAX;

/// A triangle mesh that loses triangles and takes fewer new ones in their places.
pub(super) struct Surface {
    pub(super) positions: Vec<[f64; 3]>,
    triangles: Vec<[u32; 3]>,
    /// First corner (`3 * triangle + place`) at each vertex.
    first: Vec<u32>,
    /// The next corner at the same vertex.
    next: Vec<[u32; 3]>,
    /// The corner before, so that a vertex of a million triangles lets go of one as fast as any other.
    previous: Vec<[u32; 3]>,
    n_alive: usize,
}

impl Surface {
    /// Memory for a mesh, in bytes, without positions.
    pub(super) fn bytes(n_vertices: u64, n_triangles: u64) -> u64 {
        4 * n_vertices + 36 * n_triangles
    }

    /// Most triangles that corners can be numbered for.
    pub(super) const MOST_TRIANGLES: u64 = (NONE as u64 - 1) / 3;

    pub(super) fn new(positions: Vec<[f64; 3]>, triangles: Vec<[u32; 3]>) -> Surface {
        let n_alive = triangles.len();
        let mut surface = Surface {
            first: vec![NONE; positions.len()],
            next: vec![[NONE; 3]; triangles.len()],
            previous: vec![[NONE; 3]; triangles.len()],
            positions,
            triangles,
            n_alive,
        };
        // From the last, so that lists begin with the first.
        for triangle in (0..n_alive as u32).rev() {
            surface.link(triangle);
        }
        surface
    }

    /// Triangles that are left.
    pub(super) fn n_alive(&self) -> usize {
        self.n_alive
    }

    /// All triangles that are left, in the order of their places.
    pub(super) fn alive(&self) -> impl Iterator<Item = [u32; 3]> + '_ {
        self.triangles.iter().copied().filter(|t| t[0] != NONE)
    }

    /// True for a vertex that a triangle uses.
    pub(super) fn is_used(&self, vertex: u32) -> bool {
        self.first[vertex as usize] != NONE
    }

    /// The corners of a triangle that is left.
    pub(super) fn corners(&self, triangle: u32) -> [u32; 3] {
        self.triangles[triangle as usize]
    }

    /// Triangles around a vertex.
    pub(super) fn around(&self, vertex: u32) -> impl Iterator<Item = u32> + '_ {
        let mut corner = self.first[vertex as usize];
        std::iter::from_fn(move || {
            if corner == NONE {
                return None;
            }
            let triangle = corner / 3;
            corner = self.next[triangle as usize][(corner % 3) as usize];
            Some(triangle)
        })
    }

    /// True if any triangle has both vertices. Takes as long as the shorter of both lists.
    pub(super) fn has_edge(&self, a: u32, b: u32) -> bool {
        let (mut of_a, mut of_b) = (self.around(a), self.around(b));
        while let (Some(s), Some(t)) = (of_a.next(), of_b.next()) {
            if self.corners(s).contains(&b) || self.corners(t).contains(&a) {
                return true;
            }
        }
        false
    }

    /// Puts `filling` in the places of the triangles `hole`, which are at least as many.
    pub(super) fn replace(&mut self, hole: &[u32], filling: &[[u32; 3]]) {
        debug_assert!(filling.len() <= hole.len());
        for &triangle in hole {
            self.unlink(triangle);
            self.triangles[triangle as usize] = [NONE; 3];
        }
        for (&triangle, &corners) in hole.iter().zip(filling) {
            self.triangles[triangle as usize] = corners;
            self.link(triangle);
        }
        self.n_alive -= hole.len() - filling.len();
    }

    fn link(&mut self, triangle: u32) {
        for place in 0..3 {
            let vertex = self.triangles[triangle as usize][place] as usize;
            let (corner, after) = (3 * triangle + place as u32, self.first[vertex]);
            self.next[triangle as usize][place] = after;
            self.previous[triangle as usize][place] = NONE;
            if after != NONE {
                *at(&mut self.previous, after) = corner;
            }
            self.first[vertex] = corner;
        }
    }

    fn unlink(&mut self, triangle: u32) {
        for place in 0..3 {
            let vertex = self.triangles[triangle as usize][place] as usize;
            let after = self.next[triangle as usize][place];
            let before = self.previous[triangle as usize][place];
            match before {
                NONE => self.first[vertex] = after,
                _ => *at(&mut self.next, before) = after,
            }
            if after != NONE {
                *at(&mut self.previous, after) = before;
            }
        }
    }
}

/// The link of a corner.
fn at(links: &mut [[u32; 3]], corner: u32) -> &mut u32 {
    &mut links[(corner / 3) as usize][(corner % 3) as usize]
}
