//! Takes out of a freshly partitioned cell what no simplification should see: repeated faces, idle vertices.
//!
//! Partitioning sends a triangle to the cell of its corner of lowest index, so triangles with the same three
//! corners always meet in one cell, and each cell can be tidied by itself. Later rounds have nothing to tidy.

use super::cell_mesh::{CellMesh, Dropped};
use stonecut_mesh::duplicate_triangles::{Going, Repeats, from_least, remove};

impl CellMesh {
    /// Brings the triangles into the order of their lowest vertex id; those that share it keep their order.
    ///
    /// Memory while it runs: 4 bytes a vertex (8 if local numbers are not in the order of ids) and 12 a triangle.
    pub fn order_by_lowest_id(&mut self) {
        let (ids, triangles) = (&self.ids, &self.mesh.triangles);
        // A cell owns the corner of lowest id of each of its triangles, and has its own vertices first, in the
        // order of ids. Only cells that were split have them otherwise.
        let is_in_order = triangles.iter().all(|t| {
            let least = ids[t[0].min(t[1]).min(t[2]) as usize];
            t.iter().all(|&v| least <= ids[v as usize])
        }) && {
            let mut owns = vec![false; ids.len()];
            triangles.iter().for_each(|t| owns[t[0].min(t[1]).min(t[2]) as usize] = true);
            (0..ids.len()).filter(|&v| owns[v]).map(|v| ids[v]).is_sorted()
        };
        let rank: Vec<u32> = match is_in_order {
            true => Vec::new(),
            false => {
                let mut by_id: Vec<u32> = (0..ids.len() as u32).collect();
                by_id.sort_unstable_by_key(|&v| ids[v as usize]);
                let mut rank = vec![0; ids.len()];
                (0u32..).zip(&by_id).for_each(|(place, &v)| rank[v as usize] = place);
                rank
            }
        };
        let least = |t: &[u32; 3]| match rank.is_empty() {
            true => t[0].min(t[1]).min(t[2]) as usize,
            false => t.map(|v| rank[v as usize]).into_iter().min().unwrap_or(0) as usize,
        };
        let mut place = vec![0u32; ids.len() + 1];
        triangles.iter().for_each(|t| place[least(t) + 1] += 1);
        for v in 1..place.len() {
            place[v] += place[v - 1];
        }
        let mut ordered = vec![[0; 3]; triangles.len()];
        for t in triangles {
            let place = &mut place[least(t)];
            ordered[*place as usize] = *t;
            *place += 1;
        }
        self.mesh.triangles = ordered;
    }

    /// Drops repeated triangles (the first stays) and vertices that nothing uses; all others keep their order.
    ///
    /// The triangles must be in the order of their lowest vertex id. `record_bytes` is the length of one of
    /// `records`. A shared vertex is used by definition, if not here. Memory while it runs: 4 bytes a vertex.
    pub fn tidy(&mut self, record_bytes: usize) -> Dropped {
        let Going { triangles, backs: back_faces } = self.drop_duplicates();
        let unreferenced_vertices = self.drop_unreferenced(record_bytes);
        Dropped { duplicate_faces: triangles.len() as u64, back_faces, unreferenced_vertices }
    }

    fn drop_duplicates(&mut self) -> Going {
        let triangles = &self.mesh.triangles;
        let lowest = |t: &[u32; 3]| t.map(|v| self.ids[v as usize]).into_iter().min();
        let mut found = Repeats::default();
        let mut keys: Vec<([u32; 3], u32)> = Vec::new();
        let mut start = 0u32;
        // Repeats are in the same group.
        for group in triangles.chunk_by(|a, b| lowest(a) == lowest(b)) {
            keys.clear();
            keys.extend((start..).zip(group).map(|(i, t)| {
                let mut corners = *t;
                corners.sort_unstable();
                (corners, i)
            }));
            start += group.len() as u32;
            keys.sort_unstable();
            found.add(&keys, |i| from_least(triangles[i as usize]));
        }
        let going = found.that_go(triangles, |v| !self.shared[v as usize]);
        remove(&mut self.mesh.triangles, &going.triangles);
        going
    }

    fn drop_unreferenced(&mut self, record_bytes: usize) -> u64 {
        let mut stays = self.shared.clone();
        self.mesh.triangles.iter().flatten().for_each(|&v| stays[v as usize] = true);
        let n_idle = stays.iter().filter(|stays| !**stays).count() as u64;
        if n_idle > 0 {
            self.keep_vertices(&stays, record_bytes);
        }
        n_idle
    }

    /// Keeps the vertices that stay, in their order; every triangle's corners must be among them.
    pub(super) fn keep_vertices(&mut self, stays: &[bool], record_bytes: usize) {
        let n_channels = self.mesh.n_channels;
        let (mut place, mut n) = (vec![0u32; stays.len()], 0);
        for v in (0..stays.len()).filter(|&v| stays[v]) {
            place[v] = n as u32;
            self.ids[n] = self.ids[v];
            self.shared[n] = self.shared[v];
            self.records.copy_within(v * record_bytes..(v + 1) * record_bytes, n * record_bytes);
            self.mesh.positions[n] = self.mesh.positions[v];
            let channels = v * n_channels..(v + 1) * n_channels;
            self.mesh.channels.copy_within(channels, n * n_channels);
            n += 1;
        }
        self.ids.truncate(n);
        self.shared.truncate(n);
        self.records.truncate(n * record_bytes);
        self.mesh.positions.truncate(n);
        self.mesh.channels.truncate(n * n_channels);
        self.mesh.triangles.iter_mut().flatten().for_each(|v| *v = place[*v as usize]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use stonecut_mesh::Mesh;
    use stonecut_mesh::global_vertex::GlobalVertex;

    #[test]
    fn repeats_and_idle_vertices_go_and_the_rest_keeps_its_order() {
        // 0 -- 1    4 idle, 5 used by another cell only
        // | \  |
        // 2 -- 3
        let triangles = vec![[0, 2, 3], [0, 3, 1], [3, 0, 2], [1, 0, 3], [0, 2, 3], [1, 3, 2]];
        let mut cell = CellMesh {
            ids: [10, 11, 12, 13, 14, 15].map(GlobalVertex).to_vec(),
            records: (0..12).collect(),
            shared: vec![true, false, false, false, false, true],
            mesh: Mesh {
                positions: (0..6).map(|i| [f64::from(i), 0.0, 0.0]).collect(),
                channels: (0..6).map(|i| i as f32).collect(),
                n_channels: 1,
                triangles,
                ..Mesh::default()
            },
            ..CellMesh::default()
        };
        cell.order_by_lowest_id();
        let dropped = cell.tidy(2);
        assert_eq!(
            dropped,
            Dropped { duplicate_faces: 3, unreferenced_vertices: 1, ..Dropped::default() }
        );
        assert_eq!(cell.mesh.triangles, [[0, 2, 3], [0, 3, 1], [1, 3, 2]]);
        assert_eq!(cell.ids, [10, 11, 12, 13, 15].map(GlobalVertex));
        assert_eq!(cell.records, [0, 1, 2, 3, 4, 5, 6, 7, 10, 11]);
        assert_eq!(cell.shared, [true, false, false, false, true]);
        assert_eq!(cell.mesh.channels, [0.0, 1.0, 2.0, 3.0, 5.0]);
        assert_eq!(cell.mesh.positions[4], [5.0, 0.0, 0.0]);
        assert_eq!(cell.tidy(2), Dropped::default());
    }

    #[test]
    fn walls_of_two_bodies_stay_at_the_border_of_a_cell() {
        // Other cells hold what else there is at its edges.
        let mut cell = CellMesh {
            ids: [10, 11, 12].map(GlobalVertex).to_vec(),
            shared: vec![true; 3],
            ..CellMesh::default()
        };
        cell.mesh = Mesh::new(vec![[0.0; 3]; 3], vec![[0, 1, 2], [0, 2, 1]]);
        assert_eq!(cell.tidy(0), Dropped::default());
        assert_eq!(cell.mesh.triangles.len(), 2);
        // Beside a face that is there twice in a sheet it is one of these.
        cell.ids.extend([13, 14, 15].map(GlobalVertex));
        cell.shared.extend([false; 3]);
        cell.mesh.positions.extend([[0.0; 3]; 3]);
        cell.mesh.triangles.extend([[3, 4, 5], [3, 5, 4], [4, 3, 0]]);
        assert_eq!(cell.tidy(0).duplicate_faces, 2);
    }

    #[test]
    fn triangles_are_in_the_order_of_their_lowest_id_however_vertices_came() {
        // Ids in and out of order: as a cell holds them, and as the part of a split cell does.
        for ids in [[10, 11, 12, 13, 4], [12, 4, 10, 13, 11]] {
            let ids = ids.map(GlobalVertex);
            let find = |id: u64| ids.iter().position(|known| known.0 == id).unwrap() as u32;
            let given = [[11, 12, 13], [13, 10, 12], [4, 11, 10], [12, 11, 13], [11, 10, 13]];
            let mut cell = CellMesh { ids: ids.to_vec(), ..CellMesh::default() };
            cell.mesh.triangles = given.map(|t| t.map(find)).to_vec();
            cell.order_by_lowest_id();
            let found: Vec<[u64; 3]> =
                cell.mesh.triangles.iter().map(|t| t.map(|v| ids[v as usize].0)).collect();
            let expected = [[4, 11, 10], [13, 10, 12], [11, 10, 13], [11, 12, 13], [12, 11, 13]];
            assert_eq!(found, expected);
        }
    }
}
