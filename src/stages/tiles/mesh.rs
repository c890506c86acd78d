//! Turns a part of a cell into a tile: positions on the lattice, normals, linear colours, further properties.

use super::scalars::Columns;
use std::sync::LazyLock;
use stonecut_io::{TileMesh, find3};
use stonecut_mesh::Mesh;
use stonecut_mesh::colours::{ColourPlace, linear_word as linear};
use stonecut_mesh::global_vertex::GlobalVertex;
use stonecut_mesh::property::{Scalar, read_scalar};
use stonecut_mesh::vec3::{length_sq, normal};
use stonecut_store::cells::{Lattice, VertexLayout};

/// A cell whose tiles are made.
pub(super) struct Whole<'a> {
    pub(super) mesh: &'a Mesh,
    /// Records as first read.
    pub(super) records: &'a [u8],
    /// Numbers of the vertices in the input.
    pub(super) ids: &'a [GlobalVertex],
    /// True for vertices on the border of the group.
    pub(super) shared: &'a [bool],
    /// Normals by the cell's triangles, of any length.
    normals: Vec<[f64; 3]>,
    layout: &'a VertexLayout,
    colour: Option<ColourPlace>,
    normal: Option<[(Scalar, usize); 3]>,
    /// Further properties.
    pub(super) columns: Columns,
}

/// A tile before it is encoded.
#[derive(Default)]
pub(super) struct Part {
    pub(super) mesh: TileMesh,
    /// The number of each of its vertices in the cell.
    pub(super) used: Vec<u32>,
    /// Values of further properties that it cannot hold exactly.
    pub(super) inexact: u64,
}

impl<'a> Whole<'a> {
    pub(super) fn new(
        mesh: &'a Mesh,
        records: &'a [u8],
        (ids, shared): (&'a [GlobalVertex], &'a [bool]),
        layout: &'a VertexLayout,
    ) -> Whole<'a> {
        let colour = ColourPlace::find(&layout.schema);
        let given = find3(&layout.schema, ["nx", "ny", "nz"]);
        let mut normals = Vec::new();
        if given.is_none() {
            normals = vec![[0.0; 3]; mesh.positions.len()];
            for t in 0..mesh.triangles.len() {
                let n = normal(mesh.corners(t));
                for v in mesh.triangles[t] {
                    (0..3).for_each(|k| normals[v as usize][k] += n[k]);
                }
            }
        }
        let columns = Columns::new(&layout.schema);
        Whole { mesh, records, ids, shared, normals, layout, colour, normal: given, columns }
    }

    /// The tile of some triangles; `local` has a place for every vertex, `u32::MAX` in all of them before and after.
    pub(super) fn tile(
        &self,
        triangles: impl Iterator<Item = usize>,
        lattice: &Lattice,
        level: u32,
        local: &mut [u32],
    ) -> Part {
        let mut used: Vec<u32> = Vec::new();
        let mut out = TileMesh::default();
        let mut inexact = 0;
        for t in triangles {
            out.triangles.push(self.mesh.triangles[t].map(|v| {
                let place = &mut local[v as usize];
                if *place == u32::MAX {
                    *place = used.len() as u32;
                    used.push(v);
                }
                *place
            }));
        }
        let mut record = Vec::new();
        for &v in &used {
            let vertex = v as usize;
            local[vertex] = u32::MAX;
            let place = self.mesh.positions[vertex];
            // Tiles of this level and of the next one meet at the border of a group: on the coarser lattice.
            out.positions.push(match self.shared[vertex] {
                true => lattice.nearest(level + 1, place).map(|x| 2 * x),
                false => lattice.nearest(level, place),
            });
            if self.needs_records() {
                let n = self.layout.schema.record_bytes();
                let old = &self.records[vertex * n..(vertex + 1) * n];
                record.clear();
                self.layout.codec.encode(place, self.mesh.channels_of(v), old, &mut record);
            }
            out.normals.push(unit(match self.normal {
                Some(fields) => fields.map(|(scalar, at)| read_scalar(scalar, &record, at)),
                None => self.normals[vertex],
            }));
            if let Some(colour) = self.colour {
                out.colours.push(match colour.fields() {
                    [(Scalar::U8, r), (Scalar::U8, g), (Scalar::U8, b)] => {
                        [r, g, b].map(|at| light_of(record[at]))
                    }
                    _ => colour.shares(&record).map(linear),
                });
            }
            inexact += self.columns.push(&record, &mut out.scalars);
        }
        Part { mesh: out, used, inexact }
    }

    fn needs_records(&self) -> bool {
        self.colour.is_some() || self.normal.is_some() || !self.columns.scalars.is_empty()
    }
}

/// A direction in 127ths; upwards if there is none.
fn unit(n: [f64; 3]) -> [i8; 3] {
    let length = length_sq(n).sqrt();
    let n = if length > 0.0 && length.is_finite() { n.map(|x| x / length) } else { [0., 0., 1.] };
    n.map(|x| (x * 127.0).round() as i8)
}

/// The light of a byte of sRGB: of the numbers that are nearer to it than to other bytes, the one that ends in most zeros.
///
/// Views are packed byte by byte, and the lower bytes of exact light are noise: of a scan with colours they were a seventh of the
/// tiles. Black and white stay what they are.
fn light_of(byte: u8) -> u16 {
    static LIGHTS: LazyLock<[u16; 256]> = LazyLock::new(|| {
        std::array::from_fn(|byte| {
            let edge = |at: f64| linear(at.clamp(0.0, 255.0) / 255.0);
            let (low, high) = (edge(byte as f64 - 0.49), edge(byte as f64 + 0.49));
            match byte {
                0 => 0,
                255 => u16::MAX,
                _ => roundest(low, high),
            }
        })
    });
    LIGHTS[usize::from(byte)]
}

/// The number from `low` to `high` that ends in most binary zeros.
fn roundest(low: u16, high: u16) -> u16 {
    (0..16).rev().map(|zeros| high >> zeros << zeros).find(|&number| number >= low).unwrap_or(high)
}

#[cfg(test)]
mod tests {
    use super::*;
    use stonecut_mesh::oklab::srgb_of_linear;

    #[test]
    fn every_byte_of_colour_comes_back() {
        for byte in 0..=255 {
            let light = f64::from(light_of(byte)) / 65_535.0;
            assert_eq!((255.0 * srgb_of_linear(light)).round(), f64::from(byte));
        }
        let even = (0..=255).filter(|&byte| light_of(byte).is_multiple_of(256)).count();
        assert!(even > 130, "{even}");
        assert_eq!([0, 255].map(light_of), [0, 65_535]);
    }
}
