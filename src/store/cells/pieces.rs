//! Pieces: what a cell holds of the components of the mesh, and how pieces that are not wanted are left out.
//!
//! Vertices hang together along triangles, and where they lie in exactly the same place: a scan that was split
//! along the seams of a texture is one component, not a heap of charts. The cell of a place holds all vertices
//! there, so each cell settles by itself which of them coincide. Pieces have numbers, in the order of their
//! least vertex; `components` finds out what they belong to.

use super::cell_mesh::CellMesh;
use stonecut_mesh::Mesh;
use stonecut_mesh::bounds::Bounds;
use stonecut_mesh::union_find::Union;
use stonecut_mesh::vec3::place_bits;
use xxhash_rust::xxh3::xxh3_64;

/// Connected pieces of a mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct Pieces {
    /// For each vertex the number of its piece.
    pub of_vertex: Vec<u32>,
    /// Number of pieces; a vertex that nothing uses is one too.
    pub n: usize,
}

/// The size of a piece.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Extent {
    /// Its triangles.
    pub triangles: u64,
    /// The box around its vertices.
    pub bounds: Bounds,
}

impl Pieces {
    /// Finds the pieces of a mesh. Memory while it runs: 15 bytes a vertex, of which 4 stay.
    pub fn find(mesh: &Mesh) -> Pieces {
        let mut union = Union::new(mesh.positions.len());
        for &[a, b, c] in &mesh.triangles {
            union.join(a, b);
            union.join(b, c);
        }
        join_coincident(&mesh.positions, &mut union);
        let mut of_vertex = union.into_roots();
        let mut n = 0;
        for v in 0..of_vertex.len() {
            // Roots come before all others of their set, and have their numbers by then.
            let root = of_vertex[v] as usize;
            of_vertex[v] = if root == v { n } else { of_vertex[root] };
            n += u32::from(root == v);
        }
        Pieces { of_vertex, n: n as usize }
    }

    /// The size of each piece.
    pub fn extents(&self, mesh: &Mesh) -> Vec<Extent> {
        let mut extents = vec![Extent { triangles: 0, bounds: Bounds::EMPTY }; self.n];
        for (&piece, &p) in self.of_vertex.iter().zip(&mesh.positions) {
            extents[piece as usize].bounds.add(p);
        }
        for triangle in &mesh.triangles {
            extents[self.of_vertex[triangle[0] as usize] as usize].triangles += 1;
        }
        extents
    }
}

/// Joins vertices in the same place; -0 and 0 are the same.
fn join_coincident(positions: &[[f64; 3]], union: &mut Union) {
    const EMPTY: u32 = u32::MAX;
    let n_slots = (positions.len() * 4 / 3 + 2).next_power_of_two();
    let mut slots = vec![EMPTY; n_slots];
    let mask = n_slots - 1;
    for (v, position) in positions.iter().enumerate() {
        let bits = place_bits(*position);
        let mut at = xxh3_64(bytemuck::bytes_of(&bits)) as usize & mask;
        while slots[at] != EMPTY && place_bits(positions[slots[at] as usize]) != bits {
            at = (at + 1) & mask;
        }
        match slots[at] {
            EMPTY => slots[at] = v as u32,
            first => union.join(first, v as u32),
        }
    }
}

/// Marks of the pieces of a cell, a bit for each.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct PieceSet(pub Vec<u8>);

impl PieceSet {
    /// None of `n` pieces.
    pub fn none(n: usize) -> PieceSet {
        PieceSet(vec![0; n.div_ceil(8)])
    }

    /// Adds a piece.
    pub fn insert(&mut self, piece: u32) {
        self.0[piece as usize / 8] |= 1 << (piece % 8);
    }

    /// Returns whether a piece is among them.
    pub fn contains(&self, piece: u32) -> bool {
        self.0[piece as usize / 8] >> (piece % 8) & 1 == 1
    }

    /// Returns whether there is none.
    pub fn is_empty(&self) -> bool {
        self.0.iter().all(|&byte| byte == 0)
    }
}

impl CellMesh {
    /// Leaves out some pieces with all their vertices; what stays keeps its order. False, and nothing done, if
    /// the set is one of another mesh.
    pub fn leave_out(&mut self, pieces: &PieceSet, record_bytes: usize) -> bool {
        let Pieces { of_vertex, n } = Pieces::find(&self.mesh);
        if pieces.0.len() != n.div_ceil(8) {
            return false;
        }
        let stays: Vec<bool> = of_vertex.iter().map(|&piece| !pieces.contains(piece)).collect();
        self.mesh.triangles.retain(|t| stays[t[0] as usize]);
        self.mesh.triangles.shrink_to_fit();
        self.keep_vertices(&stays, record_bytes);
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use stonecut_mesh::global_vertex::GlobalVertex;

    fn mesh(positions: &[[f64; 3]], triangles: &[[u32; 3]]) -> Mesh {
        Mesh::new(positions.to_vec(), triangles.to_vec())
    }

    /// Two triangles that share an edge by place only, one by itself, and a vertex that nothing uses.
    ///
    /// ```text
    ///   1      4=1
    ///   |\      | \        6--7
    ///   | \     |  \       | /
    ///   0--2   3=2--5      8       9
    /// ```
    fn example() -> Mesh {
        let p = |x: f64, y: f64| [x, y, 0.0];
        let positions = [
            p(-0.0, 0.0),
            p(0.0, 1.0),
            p(1.0, 0.0),
            p(1.0, -0.0),
            p(0.0, 1.0),
            p(1.0, 1.0),
            p(5.0, 1.0),
            p(6.0, 1.0),
            p(5.0, 0.0),
            p(9.0, 0.0),
        ];
        mesh(&positions, &[[0, 2, 1], [3, 5, 4], [6, 8, 7]])
    }

    #[test]
    fn vertices_in_one_place_hang_together() {
        let mesh = example();
        let pieces = Pieces::find(&mesh);
        assert_eq!(pieces.of_vertex, [0, 0, 0, 0, 0, 0, 1, 1, 1, 2]);
        assert_eq!(pieces.n, 3);
        let extents = pieces.extents(&mesh);
        assert_eq!(extents.iter().map(|e| e.triangles).collect::<Vec<_>>(), [2, 1, 0]);
        assert_eq!(extents[0].bounds, Bounds::from([[0.0; 3], [1.0, 1.0, 0.0]]));
        assert_eq!(extents[1].bounds, Bounds::from([[5.0, 0.0, 0.0], [6.0, 1.0, 0.0]]));
    }

    #[test]
    fn what_is_left_out_goes_with_its_vertices() {
        let mesh = example();
        let mut cell = CellMesh {
            ids: (20..30).map(GlobalVertex).collect(),
            records: (0..20).collect(),
            shared: (0..10).map(|v| v > 4).collect(),
            mesh,
            ..CellMesh::default()
        };
        let mut pieces = PieceSet::none(3);
        assert!(pieces.is_empty());
        pieces.insert(0);
        assert!(!pieces.is_empty() && pieces.contains(0) && !pieces.contains(1));
        assert!(!cell.leave_out(&PieceSet::none(99), 2));
        assert!(cell.leave_out(&pieces, 2));
        assert_eq!(cell.ids, [26, 27, 28, 29].map(GlobalVertex));
        assert_eq!(cell.records, (12..20).collect::<Vec<u8>>());
        assert_eq!(cell.shared, [true; 4]);
        assert_eq!(cell.mesh.triangles, [[0, 2, 1]]);
        assert_eq!(cell.mesh.positions[3], [9.0, 0.0, 0.0]);
    }
}
