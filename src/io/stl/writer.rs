//! STL out: loose triangles of floats, binary or ASCII, with the normal of each.

use super::facet_colours::{packed, unpacked};
use crate::ply::lookup::Lookup;
use crate::ply::raw::{RawFile, Spool};
use crate::ply::writer::Shortest;
use crate::ply::{Encoding, FaceSchema, OutputHeader, TexturedTriangle};
use crate::sidecars::place_words;
use std::io::Write;
use stonecut_mesh::property::Scalar;
use stonecut_mesh::vec3::{normal, unit};
use stonecut_system::disk::folder_of;
use stonecut_system::error::{Error, Result};
use stonecut_system::pending_file::{PendingFile, Place};

/// Writes STL; positions are spooled until the faces come.
pub struct StlWriter {
    out: PendingFile,
    header: OutputHeader,
    ascii: bool,
    spool: Option<Spool>,
    positions: Option<RawFile>,
    faces_left: u64,
    /// Places of red, green and blue among a face's packed values.
    colour: Option<[usize; 3]>,
    /// Facets whose colour has more than the 5 bits a channel that are written.
    pub(crate) n_rounded: u64,
}

/// Places of the colours of faces that a binary STL holds, behind each facet as VisCAM and SolidView have them.
pub(crate) fn colour_of_facets(faces: &FaceSchema, encoding: Encoding) -> Option<[usize; 3]> {
    let place = |name: &str| faces.place_of(name).filter(|(scalar, _)| *scalar == Scalar::U8);
    let [red, green, blue] = ["red", "green", "blue"].map(place);
    let places = [red?.1, green?.1, blue?.1];
    (encoding != Encoding::Ascii).then_some(places)
}

impl StlWriter {
    /// Creates the output; fails above 2^32 - 1 triangles, which binary STL cannot count.
    pub fn create(
        place: impl Into<Place>,
        header: OutputHeader,
        encoding: Encoding,
    ) -> Result<Self> {
        let place = place.into();
        let path = place.path.clone();
        let ascii = encoding == Encoding::Ascii;
        let Ok(n_faces) = u32::try_from(header.n_faces) else {
            return Err(Error::Usage(format!(
                "the output would have {} triangles; STL holds at most {}: write PLY",
                header.n_faces,
                u32::MAX
            )));
        };
        let mut out = PendingFile::create(place)?;
        let version = env!("CARGO_PKG_VERSION");
        let place = place_words(&header.comments);
        if ascii {
            let name = if place.is_empty() { "stonecut" } else { &place };
            out.write(format!("solid {name}\n").as_bytes())?;
        } else {
            let text = format!("{place} stonecut {version} {}", header.settings);
            let mut text = text.trim_start().as_bytes().to_vec();
            text.resize(80, 0);
            out.write(&text)?;
            out.write(&n_faces.to_le_bytes())?;
        }
        let spool = Some(Spool::new(folder_of(&path)));
        let faces_left = header.n_faces;
        let colour = colour_of_facets(&header.faces, encoding);
        let positions = None;
        Ok(StlWriter { out, header, ascii, spool, positions, faces_left, colour, n_rounded: 0 })
    }

    /// Appends packed records of the header's schema.
    pub fn write_vertices(&mut self, records: &[u8]) -> Result<()> {
        let Some(spool) = &mut self.spool else { return Ok(()) };
        for record in records.chunks_exact(self.header.schema.record_bytes()) {
            let mut bytes = [0u8; 12];
            let position = self.header.schema.position(record);
            for (place, value) in bytes.chunks_exact_mut(4).zip(position) {
                place.copy_from_slice(&(value as f32).to_le_bytes());
            }
            spool.write(&bytes)?;
        }
        Ok(())
    }

    /// Appends triangles; all vertices must have been written.
    pub fn write_faces(&mut self, triangles: &[[u64; 3]]) -> Result<()> {
        self.put(triangles.iter().map(|&corners| (corners, 0)))
    }

    /// The same with the packed values of their properties, of which colours are written.
    pub fn write_full_faces(
        &mut self,
        triangles: &[TexturedTriangle],
        values: &[u8],
    ) -> Result<()> {
        let places = self.colour;
        let value_bytes = self.header.faces.value_bytes();
        let colour = |i: usize| places.map(|at| at.map(|at| values[i * value_bytes + at]));
        let colours = || (0..triangles.len()).map(colour);
        let is_rounded = |rgb: &Option<[u8; 3]>| rgb.is_some_and(|c| unpacked(packed(c)) != c);
        self.n_rounded += colours().filter(is_rounded).count() as u64;
        let words = colours().map(|rgb| rgb.map_or(0, packed));
        self.put(triangles.iter().map(|triangle| triangle.corners).zip(words))
    }

    fn put(&mut self, triangles: impl ExactSizeIterator<Item = ([u64; 3], u16)>) -> Result<()> {
        if let Some(spool) = self.spool.take() {
            assert!(spool.len() == 12 * self.header.n_vertices, "as many vertices as promised");
            self.positions = Some(spool.finish(self.out.target())?);
        }
        let Some(positions) = &self.positions else { return Ok(()) };
        assert!(triangles.len() as u64 <= self.faces_left, "no more faces than promised");
        self.faces_left -= triangles.len() as u64;
        let mut lookup = Lookup::new(positions, 0, 12, |row| {
            [0, 4, 8].map(|at| {
                f64::from(f32::from_le_bytes(row[at..at + 4].try_into().expect("4 bytes")))
            })
        });
        let mut rows = Vec::new();
        for (triangle, colour) in triangles {
            let mut corners = [[0.0; 3]; 3];
            for (place, vertex) in corners.iter_mut().zip(triangle) {
                *place = lookup.position(vertex)?;
            }
            let n = unit(normal(corners)).unwrap_or_default();
            if self.ascii {
                put_text(n, corners, &mut rows);
            } else {
                for vector in [n].iter().chain(&corners) {
                    for &value in vector {
                        rows.extend_from_slice(&(value as f32).to_le_bytes());
                    }
                }
                rows.extend_from_slice(&colour.to_le_bytes());
            }
            if rows.len() > 1 << 18 {
                self.out.write(&rows)?;
                rows.clear();
            }
        }
        self.out.write(&rows)
    }

    /// Syncs and renames; returns the file's length in bytes.
    pub fn finish(mut self) -> Result<u64> {
        assert!(self.faces_left == 0, "as many faces as promised");
        if self.ascii {
            self.out.write(b"endsolid stonecut\n")?;
        }
        self.out.finish()
    }
}

fn put_text(n: [f64; 3], corners: [[f64; 3]; 3], rows: &mut Vec<u8>) {
    let s = |value: f64| Shortest(value as f32);
    // Writing into memory cannot fail.
    let _ = writeln!(rows, "facet normal {} {} {}\n outer loop", s(n[0]), s(n[1]), s(n[2]));
    for c in corners {
        let _ = writeln!(rows, "  vertex {} {} {}", s(c[0]), s(c[1]), s(c[2]));
    }
    rows.extend_from_slice(b" endloop\nendfacet\n");
}
