//! Joins the corners of loose triangles at equal positions, out of core, into a canonical PLY.
//!
//! Three sorts: by position (which corners are one vertex), by first corner (which number the vertex
//! gets), by corner (back into faces). Vertices are numbered in the order in which the file first names
//! them, so neighbours stay neighbours. Equal means equal in every bit, but -0 equals 0.

use crate::external_sort::{ExternalSort, halves, whole};
use crate::open_options::StageOptions;
use crate::ply::header::Encoding;
use crate::ply::raw::{RawFile, Spool};
use crate::ply::row_window::RowWindow;
use crate::ply::{FaceSchema, OutputHeader};
use std::path::Path;
use stonecut_mesh::property::{Property, Scalar};
use stonecut_mesh::record::VertexSchema;
use stonecut_system::error::Result;

/// Words of a corner with its place in floats or doubles, and the same with the first corner at that place.
pub(super) const FLOATS: usize = 5;
pub(super) const FLOATS_BY_FIRST: usize = 7;
pub(super) const DOUBLES: usize = 8;
pub(super) const DOUBLES_BY_FIRST: usize = 10;

/// Takes loose triangles, gives a PLY. `N` and `M` are the words above.
pub struct Welder<const N: usize, const M: usize> {
    corners: ExternalSort<N>,
    n_corners: u64,
    options: StageOptions,
    memory_bytes: usize,
}

impl<const N: usize, const M: usize> Welder<N, M> {
    /// Memory: a third of the stage's for each sort; disk at peak 60 bytes a corner, 84 for doubles.
    pub fn new(options: &StageOptions) -> Self {
        let memory_bytes = (options.memory_bytes / 3) as usize;
        let corners = options.sort(memory_bytes);
        Welder { corners, n_corners: 0, options: options.clone(), memory_bytes }
    }

    /// Appends a triangle.
    pub fn push(&mut self, triangle: [[f64; 3]; 3]) -> Result<()> {
        for position in triangle {
            let mut record = [0; N];
            for (axis, value) in position.into_iter().enumerate() {
                // Adding 0 turns -0 into 0 and changes nothing else.
                if N == DOUBLES {
                    [record[2 * axis], record[2 * axis + 1]] = halves((value + 0.0).to_bits());
                } else {
                    record[axis] = (value as f32 + 0.0).to_bits();
                }
            }
            [record[N - 2], record[N - 1]] = halves(self.n_corners);
            self.corners.push(record)?;
            self.n_corners += 1;
        }
        Ok(())
    }

    /// The welded mesh as a PLY of that name; `colours` has three bytes for each triangle.
    pub fn finish(
        self,
        name: &Path,
        comments: Vec<String>,
        colours: Option<Spool>,
    ) -> Result<RawFile> {
        let mut by_first = self.options.sort::<M>(self.memory_bytes);
        let mut n_vertices = 0u64;
        let mut current: Option<[u32; N]> = None;
        self.corners.drain(|record| {
            let first = match current {
                Some(first) if first[..N - 2] == record[..N - 2] => first,
                _ => {
                    n_vertices += 1;
                    current = Some(record);
                    record
                }
            };
            let mut out = [0; M];
            out[..2].copy_from_slice(&first[N - 2..]);
            out[2..4].copy_from_slice(&record[N - 2..]);
            out[4..].copy_from_slice(&record[..N - 2]);
            by_first.push(out)
        })?;

        let coordinate = if N == DOUBLES { Scalar::F64 } else { Scalar::F32 };
        let schema = VertexSchema { coordinate, properties: Vec::new() };
        let mut header = OutputHeader::new(schema, n_vertices, self.n_corners / 3);
        header.comments = comments;
        if colours.is_some() {
            let property = |name: &&str| Property::new(name, Scalar::U8);
            let properties = ["red", "green", "blue"].iter().map(property).collect();
            header.faces = FaceSchema { texture: false, properties };
        }
        let index = header.index_type()?;
        let mut out = self.options.spool();
        out.write(header.text_signed(Encoding::BinaryLittleEndian, index, None).as_bytes())?;
        let mut by_corner = self.options.sort::<4>(self.memory_bytes);
        let (mut id, mut last) = (0u64, None);
        by_first.drain(|record| {
            let first = whole(record[0], record[1]);
            if last != Some(first) {
                id += u64::from(last.is_some());
                last = Some(first);
                if N == DOUBLES {
                    for bits in record[4..].chunks_exact(2) {
                        out.write(&whole(bits[0], bits[1]).to_le_bytes())?;
                    }
                } else {
                    out.write(bytemuck::cast_slice(&[record[4], record[5], record[6]]))?;
                }
            }
            let [id_high, id_low] = halves(id);
            by_corner.push([record[2], record[3], id_high, id_low])
        })?;

        let colours = colours.map(|spool| spool.finish(name)).transpose()?;
        let mut colours = colours.map(|file| RowWindow::new(file, 3));
        let (mut row, mut filled, mut face) = (vec![3u8; 13], 0, 0);
        row.resize(if colours.is_some() { 16 } else { 13 }, 0);
        by_corner.drain(|[_, _, _, id]| {
            row[1 + 4 * filled..5 + 4 * filled].copy_from_slice(&id.to_le_bytes());
            filled += 1;
            if filled == 3 {
                filled = 0;
                if let Some(colours) = &mut colours {
                    row[13..].copy_from_slice(colours.get(face)?);
                }
                face += 1;
                out.write(&row)?;
            }
            Ok(())
        })?;
        out.finish(name)
    }
}
