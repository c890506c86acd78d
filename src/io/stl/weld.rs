//! Joins the corners of loose triangles at equal positions, out of core, into a canonical PLY.
//!
//! Three sorts: by position (which corners are one vertex), by first corner (which number the vertex
//! gets), by corner (back into faces). Vertices are numbered in the order in which the file first names
//! them, so neighbours stay neighbours. Equal means equal in every bit, but -0 equals 0.

use crate::error::Result;
use crate::io::external_sort::{ExternalSort, halves, whole};
use crate::io::open_options::StageOptions;
use crate::io::ply::OutputHeader;
use crate::io::ply::header::Encoding;
use crate::io::ply::raw::RawFile;
use crate::mesh::property::Scalar;
use crate::mesh::record::VertexSchema;
use std::path::Path;

/// Takes loose triangles, gives a PLY.
pub(crate) struct Welder {
    corners: ExternalSort<5>,
    n_corners: u64,
    options: StageOptions,
    memory_bytes: usize,
}

impl Welder {
    /// Memory: a third of the stage's for each sort; disk at peak 60 bytes a corner.
    pub fn new(options: &StageOptions) -> Self {
        let memory_bytes = (options.memory_bytes / 3) as usize;
        let corners = options.sort(memory_bytes);
        Welder { corners, n_corners: 0, options: options.clone(), memory_bytes }
    }

    /// Appends a triangle.
    pub fn push(&mut self, triangle: [[f32; 3]; 3]) -> Result<()> {
        for position in triangle {
            // Adding 0 turns -0 into 0 and changes nothing else.
            let [x, y, z] = position.map(|v| (v + 0.0).to_bits());
            let [high, low] = halves(self.n_corners);
            self.corners.push([x, y, z, high, low])?;
            self.n_corners += 1;
        }
        Ok(())
    }

    /// The welded mesh as a PLY of that name.
    pub fn finish(self, name: &Path, comments: Vec<String>) -> Result<RawFile> {
        let mut by_first = self.options.sort::<7>(self.memory_bytes);
        let mut n_vertices = 0u64;
        let mut current = None;
        self.corners.drain(|[x, y, z, high, low]| {
            let corner = [high, low];
            let first = match current {
                Some((position, first)) if position == [x, y, z] => first,
                _ => {
                    n_vertices += 1;
                    current = Some(([x, y, z], corner));
                    corner
                }
            };
            by_first.push([first[0], first[1], corner[0], corner[1], x, y, z])
        })?;

        let schema = VertexSchema { coordinate: Scalar::F32, properties: Vec::new() };
        let mut header = OutputHeader::new(schema, n_vertices, self.n_corners / 3);
        header.comments = comments;
        let index = header.index_type()?;
        let mut out = self.options.spool();
        out.write(header.text_signed(Encoding::BinaryLittleEndian, index, None).as_bytes())?;
        let mut by_corner = self.options.sort::<4>(self.memory_bytes);
        let (mut id, mut last) = (0u64, None);
        by_first.drain(|[first_high, first_low, high, low, x, y, z]| {
            let first = whole(first_high, first_low);
            if last != Some(first) {
                id += u64::from(last.is_some());
                last = Some(first);
                let mut record = [0u8; 12];
                for (place, bits) in record.chunks_exact_mut(4).zip([x, y, z]) {
                    place.copy_from_slice(&bits.to_le_bytes());
                }
                out.write(&record)?;
            }
            let [id_high, id_low] = halves(id);
            by_corner.push([high, low, id_high, id_low])
        })?;

        let (mut row, mut filled) = ([3u8; 13], 0);
        by_corner.drain(|[_, _, _, id]| {
            row[1 + 4 * filled..5 + 4 * filled].copy_from_slice(&id.to_le_bytes());
            filled += 1;
            if filled == 3 {
                filled = 0;
                out.write(&row)?;
            }
            Ok(())
        })?;
        out.finish(name)
    }
}
