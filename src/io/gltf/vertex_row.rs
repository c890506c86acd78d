//! A vertex of a glTF mesh, and one that others in its place are joined with.

/// A vertex of the input in its place.
#[derive(Clone, Copy)]
pub(super) struct VertexRow {
    pub(super) position: [f64; 3],
    pub(super) colour: [u8; 4],
    pub(super) normal: [f32; 3],
    pub(super) uv: [f32; 2],
}

/// A joined vertex that gathers the normals of those in its place.
pub(super) struct Open {
    pub(super) first: u64,
    pub(super) position: [f64; 3],
    pub(super) colour: [u8; 4],
    pub(super) normal: [f64; 3],
}

impl Open {
    /// The vertex of this number, the first in its place.
    pub(super) fn of(first: u64, row: &VertexRow) -> Open {
        let position = row.position.map(|x| x + 0.0);
        Open { first, position, colour: row.colour, normal: [0.0; 3] }
    }

    pub(super) fn add(&mut self, normal: [u32; 3]) {
        for (sum, bits) in self.normal.iter_mut().zip(normal) {
            *sum += f64::from(f32::from_bits(bits));
        }
    }
}
