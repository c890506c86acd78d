//! The mesh around each vertex of its version: the triangles with a corner that went into it, and their vertices.

use super::around::Around;
use stonecut_mesh::Mesh;

/// Patches of more vertices are not looked at as a whole: the table for their edges would grow too large.
pub(super) const MOST: usize = 128;

/// For each vertex of the version its patch; about 35 bytes for each triangle of the mesh.
pub(super) struct Patches {
    near: Around,
    /// The corners of the triangles, as numbers in their patch; beside `near`.
    corners: Vec<[u16; 3]>,
    /// The places at which the vertices, the rim and the loose edges of each patch begin, and their end.
    first: Vec<[u32; 3]>,
    vertices: Vec<u32>,
    rim: Vec<[u16; 2]>,
    loose: Vec<[u16; 2]>,
}

/// The border of a patch, as edges between its vertices, with its triangles to their left.
#[derive(Clone, Copy)]
pub(super) struct Border<'a> {
    /// Edges opposite of the only corner that went into the vertex.
    pub(super) rim: &'a [[u16; 2]],
    /// Edges with an end that went into the vertex: borders of the mesh itself. One for each triangle that has no other beside
    /// it.
    pub(super) loose: &'a [[u16; 2]],
}

impl Patches {
    /// Of a mesh, and the vertices of its version that its own went into; `n` of them.
    pub(super) fn new(mesh: &Mesh, hints: &[u32], n: usize) -> Patches {
        let near = Around::hints(mesh, hints, n);
        let mut corners = Vec::with_capacity(near.len());
        let mut first = Vec::with_capacity(n + 1);
        let mut vertices = Vec::with_capacity(near.len() / 2 + n);
        let (mut rim, mut loose) = (Vec::with_capacity(near.len() / 2), Vec::new());
        // For each vertex of the mesh the last patch that it was seen in, and its number there.
        let mut last = vec![[u32::MAX, 0u32]; mesh.positions.len()];
        let mut edges = Edges::default();
        for v in 0..n as u32 {
            let start = vertices.len();
            first.push([start as u32, rim.len() as u32, loose.len() as u32]);
            let own = corners.len();
            edges.n_own = 0;
            edges.own.clear();
            for &t in near.of(v) {
                let mut places = [0u16; 3];
                for (place, w) in places.iter_mut().zip(mesh.triangles[t as usize]) {
                    let last = &mut last[w as usize];
                    if last[0] != v {
                        *last = [v, (vertices.len() - start) as u32];
                        vertices.push(w);
                        edges.add_vertex(hints[w as usize] == v);
                    }
                    *place = last[1] as u16;
                }
                let [a, b, c] = places;
                corners.push([a, b, c]);
                match [a, b, c].map(|k| edges.own[usize::from(k)] != OTHER) {
                    [true, false, false] => rim.push([b, c]),
                    [false, true, false] => rim.push([c, a]),
                    [false, false, true] => rim.push([a, b]),
                    _ => {}
                }
            }
            if is_small(vertices.len() - start, corners.len() - own) {
                edges.add_loose(&corners[own..], &mut loose);
            }
        }
        first.push([vertices.len() as u32, rim.len() as u32, loose.len() as u32]);
        Patches { near, corners, first, vertices, rim, loose }
    }

    /// The triangles of a patch.
    #[inline]
    pub(super) fn triangles(&self, v: u32) -> &[u32] {
        self.near.of(v)
    }

    /// The corners of the triangles of a patch, as places in `vertices`; wrong where there are more than 65,536.
    #[inline]
    pub(super) fn corners(&self, v: u32) -> &[[u16; 3]] {
        &self.corners[self.near.range(v)]
    }

    /// The vertices of a patch.
    #[inline]
    pub(super) fn vertices(&self, v: u32) -> &[u32] {
        let v = v as usize;
        &self.vertices[self.first[v][0] as usize..self.first[v + 1][0] as usize]
    }

    /// The border of a patch; none if it is too large.
    #[inline]
    pub(super) fn border(&self, v: u32) -> Option<Border<'_>> {
        let at = v as usize;
        let ([first, rim, loose], end) = (self.first[at], self.first[at + 1]);
        is_small((end[0] - first) as usize, self.triangles(v).len()).then(|| Border {
            rim: &self.rim[rim as usize..end[1] as usize],
            loose: &self.loose[loose as usize..end[2] as usize],
        })
    }
}

fn is_small(n_vertices: usize, n_triangles: usize) -> bool {
    n_vertices <= MOST && n_triangles <= MOST * MOST
}

/// Marks that a vertex of a patch did not go into the patch's own vertex.
const OTHER: u16 = u16::MAX;

/// The edges at what went into a vertex.
#[derive(Default)]
struct Edges {
    /// For each vertex of the patch its row, if it is one of those, or `OTHER`.
    own: Vec<u16>,
    n_own: u16,
    /// For each row and vertex of the patch how many more triangles are to the left of that edge than to its right.
    more: Vec<i16>,
}

impl Edges {
    fn add_vertex(&mut self, is_own: bool) {
        self.own.push(if is_own { self.n_own } else { OTHER });
        self.n_own = self.n_own.saturating_add(u16::from(is_own)).min(OTHER - 1);
    }

    /// Adds the edges that have more triangles on their left than on their right, as often as there are more.
    fn add_loose(&mut self, corners: &[[u16; 3]], loose: &mut Vec<[u16; 2]>) {
        let n = self.own.len();
        self.more.clear();
        self.more.resize(usize::from(self.n_own) * n, 0);
        for &[a, b, c] in corners {
            for [a, b, c] in [[a, b, c], [b, c, a], [c, a, b]] {
                let row = self.own[usize::from(a)];
                if row != OTHER {
                    let row = &mut self.more[usize::from(row) * n..][..n];
                    row[usize::from(b)] += 1;
                    row[usize::from(c)] -= 1;
                }
            }
        }
        if self.more.iter().all(|&more| more == 0) {
            return;
        }
        for from in 0..n {
            let row = self.own[from];
            if row == OTHER {
                continue;
            }
            for (to, &more) in self.more[usize::from(row) * n..][..n].iter().enumerate() {
                let (edge, back) = ([from as u16, to as u16], [to as u16, from as u16]);
                // An edge with two such ends is in both rows.
                let is_once = self.own[to] == OTHER;
                loose.extend((0..more).map(|_| edge));
                loose.extend((0..if is_once { -more } else { 0 }).map(|_| back));
            }
        }
    }
}
