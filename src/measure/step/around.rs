//! Lists of triangles around vertices, of a mesh and its version.

use std::ops::Range;
use stonecut_mesh::Mesh;

/// A mesh and its version, on the way from one to the other.
pub(super) struct Forward<'a> {
    pub(super) fine: &'a Mesh,
    pub(super) coarse: &'a Mesh,
    /// The triangles at each vertex of the version.
    pub(super) around: &'a Around,
}

/// No vertex, or no triangle.
pub(super) const NONE: u32 = u32::MAX;

/// For each of some vertices a list of triangles; 4 bytes an entry and a vertex.
pub(super) struct Around {
    first: Vec<u32>,
    triangles: Vec<u32>,
}

impl Around {
    /// The triangles at each vertex of a mesh.
    pub(super) fn vertices(mesh: &Mesh) -> Around {
        Around::build(mesh.positions.len(), &mesh.triangles, |v| v)
    }

    /// For each of `n` vertices the triangles of `mesh` that have a corner with that hint.
    pub(super) fn hints(mesh: &Mesh, hints: &[u32], n: usize) -> Around {
        Around::build(n, &mesh.triangles, |v| hints[v as usize])
    }

    fn build(n: usize, triangles: &[[u32; 3]], place: impl Fn(u32) -> u32) -> Around {
        let mut first = vec![0u32; n + 1];
        each(triangles, &place, |v, _| first[v as usize] += 1);
        let mut sum = 0;
        for first in &mut first {
            sum += *first;
            *first = sum;
        }
        let mut list = vec![0u32; sum as usize];
        // From behind, so that each start ends where its list begins.
        each(triangles, &place, |v, t| {
            let at = &mut first[v as usize];
            *at -= 1;
            list[*at as usize] = t;
        });
        Around { first, triangles: list }
    }

    /// The triangles of a vertex.
    #[inline]
    pub(super) fn of(&self, vertex: u32) -> &[u32] {
        &self.triangles[self.range(vertex)]
    }

    /// The place of a vertex's list among all entries.
    #[inline]
    pub(super) fn range(&self, vertex: u32) -> Range<usize> {
        let v = vertex as usize;
        self.first[v] as usize..self.first[v + 1] as usize
    }

    /// All entries.
    pub(super) fn len(&self) -> usize {
        self.triangles.len()
    }
}

/// Visits every triangle with the places of its corners, each place once.
#[inline]
fn each(triangles: &[[u32; 3]], place: &impl Fn(u32) -> u32, mut visit: impl FnMut(u32, u32)) {
    for (t, corners) in (0u32..).zip(triangles) {
        let [a, b, c] = corners.map(place);
        if a != NONE {
            visit(a, t);
        }
        if b != NONE && b != a {
            visit(b, t);
        }
        if c != NONE && c != a && c != b {
            visit(c, t);
        }
    }
}
