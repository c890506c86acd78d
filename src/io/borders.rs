//! Open edges of meshes that become one, and the vertices at them: all that joining looks at.
//!
//! Found for each part while its rows are at hand, so that nothing is read again. Memory: 4 bytes for each vertex of a part,
//! within windows.

use super::external_sort::{ExternalSort, halves, whole};
use super::open_edges::hash;
use super::open_options::StageOptions;
use super::restaged::{RowLayout, corner, each_row};
use crate::ply::MeshSource;
use crate::ply::lookup::Lookup;
use crate::ply::raw::{RawFile, Spool};
use crate::records::NumberRecords;
use stonecut_mesh::bounds::Bounds;
use stonecut_mesh::property::Scalar;
use stonecut_mesh::record::VertexSchema;
use stonecut_mesh::vec3::Vec3;
use stonecut_system::error::Result;

/// Vertices at once at least.
const LEAST_WINDOW: u64 = 1 << 20;

/// An open edge of a face.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct OpenEdge {
    /// In the sense of the face.
    pub ends: [u64; 2],
    /// The face.
    pub row: u64,
}

/// Open edges on their way.
pub(crate) struct BorderSpools {
    /// Number and position of each vertex, ascending.
    vertices: Spool,
    edges: Spool,
    grain: f64,
}

/// Open edges of a mesh and the vertices at them.
pub(crate) struct OpenBorders {
    vertices: RawFile,
    edges: RawFile,
    /// Half a step of the coarsest coordinates of any part, by its own type: near ones may be floats and far ones doubles.
    pub grain: f64,
    /// The box of each part, before the mesh is placed.
    pub boxes: Vec<Bounds>,
}

impl BorderSpools {
    pub fn new(options: &StageOptions) -> BorderSpools {
        BorderSpools { vertices: options.spool(), edges: options.spool(), grain: 0.0 }
    }

    /// Appends the borders of a part, whose vertices and faces come behind all others.
    pub fn append(&mut self, part: &OpenBorders, first_vertex: u64, first_row: u64) -> Result<()> {
        self.grain = self.grain.max(part.grain);
        NumberRecords::new(&part.vertices)?.each(|[v, x, y, z]| {
            self.vertices.write(bytemuck::bytes_of(&[v + first_vertex, x, y, z]))
        })?;
        NumberRecords::new(&part.edges)?.each(|[ends, row]| {
            let both = first_vertex << 32 | first_vertex;
            self.edges.write(bytemuck::bytes_of(&[ends + both, row + first_row]))
        })
    }

    pub fn finish(self, source: &std::path::Path, boxes: Vec<Bounds>) -> Result<OpenBorders> {
        let (vertices, edges) = (self.vertices.finish(source)?, self.edges.finish(source)?);
        Ok(OpenBorders { vertices, edges, grain: self.grain, boxes })
    }
}

impl OpenBorders {
    /// OpenBorders of a part, whose faces stand in `rows`; all numbers are below 2^32.
    pub fn of(
        (vertices, schema): (&RawFile, &VertexSchema),
        (rows, layout): (&RawFile, RowLayout),
        options: &StageOptions,
    ) -> Result<OpenBorders> {
        let n_bytes = schema.record_bytes() as u64;
        let n_vertices = vertices.len() / n_bytes;
        let at_once = (options.memory_bytes / 12).max(LEAST_WINDOW);
        let mut out = BorderSpools::new(options);
        let mut positions = Lookup::new(vertices, 0, n_bytes, |row| schema.position(row));
        let mut first = 0;
        while first < n_vertices {
            let end = (first + at_once).min(n_vertices);
            let mut sums = vec![0u32; (end - first) as usize];
            let mut add = |v: u64, hash: u32| {
                if let Some(sum) = sums.get_mut(v.wrapping_sub(first) as usize) {
                    *sum ^= hash;
                }
            };
            each_row(rows, 0..rows.len(), layout, |row| {
                if row[0] == 3 {
                    let [a, b, c] = [0, 1, 2].map(|i| u64::from(corner(row, i)));
                    let [ab, bc, ca] = [hash(a, b), hash(b, c), hash(c, a)];
                    add(a, ab ^ ca);
                    add(b, ab ^ bc);
                    add(c, bc ^ ca);
                    return Ok(());
                }
                each_side(row, |[a, b]| {
                    add(a, hash(a, b));
                    add(b, hash(a, b));
                    Ok(())
                })
            })?;
            let mut sides = options.sort::<4>((options.memory_bytes / 3) as usize);
            let mut number = 0u64;
            // Of sides that lead out of the window only the lower end is known.
            let may_be_open = |v: u64| sums.get(v.wrapping_sub(first) as usize) != Some(&0);
            each_row(rows, 0..rows.len(), layout, |row| {
                each_side(row, |[a, b]| {
                    let low = a.min(b);
                    if (first..end).contains(&low) && may_be_open(a) && may_be_open(b) {
                        let [p, q] = halves(number << 1 | u64::from(a > b));
                        return sides.push([low as u32, a.max(b) as u32, p, q]);
                    }
                    Ok(())
                })?;
                number += 1;
                Ok(())
            })?;
            out.put_open(sides)?;
            for (v, _) in (first..).zip(&sums).filter(|(_, sum)| **sum != 0) {
                let place = positions.position(v)?;
                let far = place.iter().fold(0.0, |most, x| f64::max(most, x.abs()));
                out.grain = out.grain.max(schema.rounding() * far);
                let place = place.map(f64::to_bits);
                out.vertices.write(bytemuck::bytes_of(&[v, place[0], place[1], place[2]]))?;
            }
            first = end;
        }
        out.finish(vertices.path(), Vec::new())
    }

    pub fn n_vertices(&self) -> u64 {
        self.vertices.len() / 32
    }

    /// Calls `each` with every vertex at an open edge and its place in `source`, which all parts became; ascending.
    pub fn each_vertex(
        &self,
        source: &MeshSource,
        mut each: impl FnMut(u64, Vec3) -> Result<()>,
    ) -> Result<()> {
        let is_float = source.schema().coordinate == Scalar::F32;
        NumberRecords::new(&self.vertices)?.each(|[v, x, y, z]| {
            let place = source.placed_point([x, y, z].map(f64::from_bits));
            each(v, if is_float { place.map(|x| f64::from(x as f32)) } else { place })
        })
    }

    /// Calls `each` with every open edge; part by part.
    pub fn each_edge(&self, mut each: impl FnMut(OpenEdge) -> Result<()>) -> Result<()> {
        NumberRecords::new(&self.edges)?.each(|[ends, row]| {
            let ends = [ends >> 32, ends & u64::from(u32::MAX)];
            each(OpenEdge { ends, row })
        })
    }
}

impl BorderSpools {
    /// Writes the sides that an odd number of faces have.
    fn put_open(&mut self, sides: ExternalSort<4>) -> Result<()> {
        let (mut last, mut n) = (None::<[u32; 4]>, 0);
        let mut put = |side: Option<[u32; 4]>, n: u64| {
            let Some([low, high, p, q]) = side.filter(|_| n % 2 == 1) else { return Ok(()) };
            let place = whole(p, q);
            let (a, b) = if place & 1 == 1 { (high, low) } else { (low, high) };
            self.edges.write(bytemuck::bytes_of(&[whole(a, b), place >> 1]))
        };
        sides.drain(|side| {
            if last.is_some_and(|last| last[..2] == side[..2]) {
                n += 1;
                return Ok(());
            }
            put(last, n)?;
            (last, n) = (Some(side), 1);
            Ok(())
        })?;
        put(last, n)
    }
}

/// Calls `each` with the ends of the sides of a face.
#[inline(always)]
fn each_side(row: &[u8], mut each: impl FnMut([u64; 2]) -> Result<()>) -> Result<()> {
    let n = usize::from(row[0]);
    let Some(last) = n.checked_sub(1) else { return Ok(()) };
    let mut from = u64::from(corner(row, last));
    for i in 0..n {
        let to = u64::from(corner(row, i));
        each([from, to])?;
        from = to;
    }
    Ok(())
}
