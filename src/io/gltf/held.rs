//! Joins the vertices of a glTF mesh in memory: by a table of places.

use super::vertex_row::{MOST_APART, Open, VertexRow, are_same};

/// Bytes of a vertex in all, its places in the table and in the result included, and of a face.
const VERTEX_BYTES: u64 = 176;
const FACE_BYTES: u64 = 24;
/// An empty place of the table.
const FREE: u32 = u32::MAX;
/// An odd number without a pattern, 2^64 over the golden ratio (Knuth, The Art of Computer Programming 3, section 6.4).
const MIX: u64 = 0x9e37_79b9_7f4a_7c15;

/// Vertices and faces as they came.
pub(super) struct Held {
    pub(super) vertices: Vec<VertexRow>,
    pub(super) corners: Vec<[u32; 3]>,
    memory_bytes: u64,
    ids: std::cell::OnceCell<Vec<u32>>,
}

impl Held {
    pub(super) fn new(memory_bytes: u64) -> Held {
        let ids = std::cell::OnceCell::new();
        Held { vertices: Vec::new(), corners: Vec::new(), memory_bytes, ids }
    }

    /// True if one more fits into the memory.
    pub(super) fn has_room(&self) -> bool {
        let vertices = VERTEX_BYTES * self.vertices.len() as u64;
        vertices + FACE_BYTES * self.corners.len() as u64 + VERTEX_BYTES < self.memory_bytes
    }

    /// The joined vertices, in the order of the first of each; with `keeps_normals`, only those whose normals agree.
    pub(super) fn join(&self, keeps_normals: bool) -> Vec<Open> {
        let n_places = (2 * self.vertices.len()).next_power_of_two();
        let mut firsts = vec![FREE; n_places];
        let (mut ids, mut joined) = (Vec::with_capacity(self.vertices.len()), Vec::new());
        for (number, row) in (0u32..).zip(&self.vertices) {
            let key = key(row);
            let mut place = hash(&key) as usize & (n_places - 1);
            let mut n_apart = 0;
            while firsts[place] != FREE {
                let other = &self.vertices[firsts[place] as usize];
                if self::key(other) == key {
                    n_apart += 1;
                    let normals = [other, row].map(|row| row.normal.map(f32::to_bits));
                    let is_same = are_same(normals[0], normals[1]);
                    if !keeps_normals || is_same || n_apart == MOST_APART {
                        break;
                    }
                }
                place = (place + 1) & (n_places - 1);
            }
            if firsts[place] == FREE {
                firsts[place] = number;
                ids.push(joined.len() as u32);
                joined.push(Open::of(u64::from(number), row));
            } else {
                ids.push(ids[firsts[place] as usize]);
            }
            joined[ids[number as usize] as usize].add(row.normal.map(f32::to_bits));
        }
        self.ids.get_or_init(|| ids);
        joined
    }

    /// The joined vertex that one of the input became.
    pub(super) fn id(&self, vertex: u32) -> u64 {
        self.ids.get().map_or(0, |ids| u64::from(ids[vertex as usize]))
    }
}

/// All that vertices of one place have in common. Adding 0 makes -0 and 0 the same.
fn key(row: &VertexRow) -> [u64; 5] {
    let [x, y, z] = row.position.map(|x| (x + 0.0).to_bits());
    let [u, v] = row.uv.map(|x| u64::from((x + 0.0).to_bits()));
    [x, y, z, u << 32 | v, u64::from(u32::from_le_bytes(row.colour))]
}

fn hash(key: &[u64; 5]) -> u64 {
    let all = key.iter().fold(0u64, |all, word| (all.rotate_left(29) ^ word).wrapping_mul(MIX));
    all ^ (all >> 32)
}

#[cfg(test)]
mod tests {
    use crate::gltf::join::{FaceParts, Joiner};
    use crate::gltf::vertex_row::VertexRow;
    use crate::open_options::{HardEdges, StageOptions};
    use crate::ply::raw::RawFile;

    fn joined(hard_edges: HardEdges, memory_bytes: u64) -> (Vec<u8>, u64) {
        let folder = tempfile::tempdir().unwrap();
        let options = StageOptions { memory_bytes, hard_edges, ..StageOptions::new(folder.path()) };
        let mut joiner = Joiner::new(&options, true, true);
        joiner.has = FaceParts { texture: true, numbers: true, names: true };
        for n in 0..3000u32 {
            let [a, b] = [n % 37, n % 5].map(|x| x as f32);
            let position = [f64::from(a) - 18.0, -0.0 * f64::from(b), 1e-3 * f64::from(n % 2)];
            let colour = [(n % 2) as u8, 7, 9, 255 - (n % 2) as u8];
            let (sin, cos) = f32::sin_cos(0.01 * (n % 7) as f32 + (n % 3) as f32);
            let normal = if n % 13 == 0 { [0.0; 3] } else { [sin, 0.0, cos] };
            let row = VertexRow { position, colour, normal, uv: [0.0, 0.5 * b] };
            joiner.put_vertex(&row).unwrap();
            if n % 2 == 1 {
                let corners = [n, n / 2, n / 3].map(u64::from);
                joiner.put_face(corners, [n as i32, -(n as i32)]).unwrap();
            }
        }
        let (file, n_hard) = joiner.finish(&RawFile::from_bytes("mesh", Vec::new())).unwrap();
        let mut bytes = vec![0; file.len() as usize];
        file.read_exact_at(&mut bytes, 0).unwrap();
        (bytes, n_hard)
    }

    #[test]
    fn a_mesh_comes_out_the_same_in_memory_by_sorts_and_from_one_to_the_other() {
        let [averaged, kept] = [HardEdges::Averaged(""), HardEdges::Kept].map(|hard_edges| {
            let [held, sorted, spilled] =
                [64 << 20, 0, 100_000].map(|memory| joined(hard_edges, memory));
            assert!(held.0.starts_with(b"ply") && held.0.len() > 40_000);
            assert!(held == sorted && held == spilled, "{hard_edges:?}");
            held
        });
        assert!(averaged.0.len() < kept.0.len() && averaged.1 > 0 && kept.1 == 0);
    }
}
