//! Findings of one cell on components: those that are settled within it, and its pieces that touch others.

use super::sizes::{ComponentSizes, Least};
use stonecut_mesh::bounds::Bounds;
use stonecut_mesh::vec3::place_bits;
use stonecut_store::cells::{CellMesh, Extent, PieceSet, Pieces};
use stonecut_store::pack_format::{u32_at, u64_at};

/// The pack of what the cells know by themselves.
pub(super) const FOUND_NAME: &str = "components.cells";

/// A piece that touches other cells.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Open {
    /// Its number in the cell.
    pub piece: u32,
    /// Its size.
    pub extent: Extent,
}

/// The place of a vertex that other cells may hold, and the number of its piece among the open ones.
pub(super) type Link = ([u64; 3], u32);

/// The note of a cell.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Found {
    /// Components that lie in this cell alone.
    pub settled: ComponentSizes,
    /// Those of them that go, among all pieces.
    pub goes: PieceSet,
    /// Pieces with vertices that other cells may hold.
    pub open: Vec<Open>,
    /// Those vertices.
    pub links: Vec<Link>,
}

const OPEN_BYTES: usize = 60;
const LINK_BYTES: usize = 28;

impl Found {
    /// Notes what `cell` knows. If it is a part of a split cell, any of its vertices may coincide with one of
    /// another part.
    pub fn new(cell: &CellMesh, pieces: &Pieces, is_part: bool, least: Least) -> Found {
        let extents = pieces.extents(&cell.mesh);
        const CLOSED: u32 = u32::MAX;
        let mut place = vec![CLOSED; pieces.n];
        let is_open = |v: usize| cell.shared[v] || is_part;
        let open_vertices = || (0..pieces.of_vertex.len()).filter(|&v| is_open(v));
        open_vertices().for_each(|v| place[pieces.of_vertex[v] as usize] = 0);
        let mut found = Found {
            settled: ComponentSizes::none(),
            goes: PieceSet::none(pieces.n),
            ..Found::default()
        };
        for (piece, extent) in extents.into_iter().enumerate() {
            let number = piece as u32;
            if place[piece] != CLOSED {
                place[piece] = found.open.len() as u32;
                found.open.push(Open { piece: number, extent });
            } else if found.settled.count(extent.triangles, extent.bounds, least) {
                found.goes.insert(number);
            }
        }
        let link =
            |v: usize| (place_bits(cell.mesh.positions[v]), place[pieces.of_vertex[v] as usize]);
        found.links = open_vertices().map(link).collect();
        found
    }

    /// Bytes on disk: lengths, sizes as JSON, bits, open pieces, links.
    pub fn encode(&self) -> Vec<u8> {
        let settled = serde_json::to_vec(&self.settled).expect("plain data");
        let rows = self.open.len() * OPEN_BYTES + self.links.len() * LINK_BYTES;
        let mut out = Vec::with_capacity(32 + settled.len() + self.goes.0.len() + rows);
        for n in [settled.len(), self.goes.0.len(), self.open.len(), self.links.len()] {
            out.extend_from_slice(&(n as u64).to_le_bytes());
        }
        out.extend_from_slice(&settled);
        out.extend_from_slice(&self.goes.0);
        for open in &self.open {
            out.extend_from_slice(&open.piece.to_le_bytes());
            out.extend_from_slice(&open.extent.triangles.to_le_bytes());
            let corners: [[f64; 3]; 2] = open.extent.bounds.into();
            for value in corners.as_flattened() {
                out.extend_from_slice(&value.to_le_bytes());
            }
        }
        for (place, open) in &self.links {
            place.iter().for_each(|bits| out.extend_from_slice(&bits.to_le_bytes()));
            out.extend_from_slice(&open.to_le_bytes());
        }
        out
    }

    /// The note of these bytes; `None` if they are none, or name what is not there.
    pub fn decode(bytes: &[u8]) -> Option<Found> {
        let mut rest = bytes;
        let mut take = |n: usize| -> Option<&[u8]> {
            let (head, tail) = rest.split_at_checked(n)?;
            rest = tail;
            Some(head)
        };
        let mut lengths = [0usize; 4];
        for n in &mut lengths {
            *n = usize::try_from(u64_at(take(8)?, 0)).ok()?;
        }
        let [n_settled, n_bytes, n_open, n_links] = lengths;
        let settled = serde_json::from_slice(take(n_settled)?).ok()?;
        let goes = PieceSet(take(n_bytes)?.to_vec());
        let open: Vec<Open> = take(n_open.checked_mul(OPEN_BYTES)?)?
            .chunks_exact(OPEN_BYTES)
            .map(|row| {
                let value = |i: usize| f64::from_bits(u64_at(row, 12 + 8 * i));
                let bounds = Bounds::from([[0, 1, 2].map(value), [3, 4, 5].map(value)]);
                Open { piece: u32_at(row, 0), extent: Extent { triangles: u64_at(row, 4), bounds } }
            })
            .collect();
        let links: Vec<Link> = take(n_links.checked_mul(LINK_BYTES)?)?
            .chunks_exact(LINK_BYTES)
            .map(|row| ([0, 8, 16].map(|at| u64_at(row, at)), u32_at(row, 24)))
            .collect();
        let is_sound = open.iter().all(|open| (open.piece as usize) < 8 * n_bytes)
            && links.iter().all(|(_, open)| (*open as usize) < n_open);
        is_sound.then_some(Found { settled, goes, open, links })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use stonecut_mesh::Mesh;
    use stonecut_mesh::global_vertex::GlobalVertex;

    #[test]
    fn a_note_comes_back_and_damage_does_not_panic() {
        // Two triangles, the second with a shared vertex, and a shared vertex by itself.
        let positions: Vec<[f64; 3]> = (0..7).map(|i| [f64::from(i), -0.0, 1.5]).collect();
        let cell = CellMesh {
            ids: (0..7).map(GlobalVertex).collect(),
            shared: vec![false, false, false, false, true, false, true],
            mesh: Mesh::new(positions, vec![[0, 1, 2], [3, 4, 5]]),
            ..CellMesh::default()
        };
        let least = Least { triangles: 2, diameter: 0.0 };
        let found = Found::new(&cell, &Pieces::find(&cell.mesh), false, least);
        assert_eq!((found.settled.found, found.settled.dropped), (1, 1));
        assert_eq!(found.goes, PieceSet(vec![1]));
        assert_eq!(found.open.iter().map(|o| o.piece).collect::<Vec<_>>(), [1, 2]);
        assert_eq!(found.open[0].extent.bounds, Bounds::from([[3.0, 0.0, 1.5], [5.0, 0.0, 1.5]]));
        assert_eq!(found.links.iter().map(|link| link.1).collect::<Vec<_>>(), [0, 1]);
        let part = Found::new(&cell, &Pieces::find(&cell.mesh), true, least);
        assert_eq!((part.settled.found, part.open.len(), part.links.len()), (0, 3, 7));
        let bytes = found.encode();
        assert_eq!(Found::decode(&bytes), Some(found));
        for n in 0..bytes.len() {
            assert_eq!(Found::decode(&bytes[..n]), None, "{n} bytes");
        }
        let mut wrong = bytes.clone();
        wrong[24] = 255;
        assert_eq!(Found::decode(&wrong), None);
    }
}
