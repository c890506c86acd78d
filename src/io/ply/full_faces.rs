//! Faces with all they carry, one after another: texture coordinates at corners, scalar properties.
//!
//! For `formats`, which moves these to vertices, and for converting, which copies them. Reads the rows in
//! file order, whatever the encoding; checks indices as `rows` does.

use super::header::{HeaderProperty, Kind, Wire};
use super::layout::{FaceLayout, explain, with_scan};
use super::placed::Placed;
use super::rows::{MAX_CORNERS, out_of_range};
use super::scan::{Fault, Mark, Scan, Scanned};
use super::source::MeshSource;
use super::{BLOCK_ROWS, FaceBlock};
use crate::materials::NUMBER;
use std::sync::PoisonError;
use stonecut_mesh::property::{Property, Scalar, read_scalar};
use stonecut_system::error::Result;

/// One face.
#[derive(Debug, Default)]
pub struct FullFace {
    /// Numbers of its vertices.
    pub corners: Vec<u64>,
    /// Texture coordinates of each corner; zeros where the face has none.
    pub texture: Vec<[f32; 2]>,
    /// The scalar properties in order, packed, little-endian.
    pub values: Vec<u8>,
    /// A corner names no vertex, or one without a place; only with `skip_bad`.
    pub is_bad: bool,
}

impl MeshSource {
    /// Returns whether the faces have lists of texture coordinates.
    pub fn has_corner_texture(&self) -> bool {
        let Some(property) = self.texture_property() else { return false };
        let is_list = |kind: &Kind| matches!(kind, Kind::List { .. });
        self.face().properties.iter().any(|p| p.name == property && is_list(&p.kind))
    }

    /// Returns whether faces are strips of triangles, which `each_full_face` passes over.
    pub fn has_strips(&self) -> bool {
        matches!(self.layout.faces, FaceLayout::Strips(_))
    }

    /// The scalar properties of faces, in order; triangle strips have none.
    pub fn face_properties(&self) -> Vec<Property> {
        let scalar = |p: &HeaderProperty| match p.kind {
            Kind::Scalar(wire) => Some(Property::new(&p.name, wire.scalar())),
            Kind::List { .. } => None,
        };
        match self.layout.faces {
            FaceLayout::None | FaceLayout::Strips(_) => Vec::new(),
            _ => self
                .face()
                .properties
                .iter()
                .filter(|p| !self.is_hidden(p))
                .filter_map(scalar)
                .collect(),
        }
    }

    fn is_hidden(&self, property: &HeaderProperty) -> bool {
        self.hidden == Some(property.name.as_str())
    }

    /// Names of properties of faces that nothing carries: lists that are neither corners nor texture, and all
    /// that triangle strips have.
    pub fn dropped_face_properties(&self) -> Vec<String> {
        if self.layout.face_element.is_none() {
            return Vec::new();
        }
        let element = self.face();
        let corners = element.index_list();
        let texture = self.texture_property();
        let is_strips = matches!(self.layout.faces, FaceLayout::Strips(_));
        let dropped = element.properties.iter().enumerate().filter(|(i, p)| {
            let is_list = matches!(p.kind, Kind::List { .. });
            Some(*i) != corners && (is_strips || is_list && Some(&p.name) != texture.as_ref())
        });
        dropped.map(|(_, p)| p.name.clone()).collect()
    }

    /// Calls `each` with number and contents of every face; returns how many of them are bad.
    pub fn each_full_face(
        &self,
        mut each: impl FnMut(u64, &FullFace) -> Result<()>,
    ) -> Result<u64> {
        self.visit_full_faces(&mut each)
    }

    /// Compiled once and in this crate, whatever is done with a face.
    fn visit_full_faces(&self, each: &mut dyn FnMut(u64, &FullFace) -> Result<()>) -> Result<u64> {
        let start = match &self.layout.faces {
            FaceLayout::Fixed { offset, .. } => Mark { offset: *offset, ..Mark::default() },
            FaceLayout::Indexed(rows) => rows.blocks.first().map_or(Mark::default(), |b| b.0),
            FaceLayout::None | FaceLayout::Strips(_) => return Ok(0),
        };
        let element = self.face();
        if element.index_list().is_none() {
            return Ok(0);
        }
        let is_mirror = self.placed.as_ref().is_some_and(Placed::is_mirror);
        let kinds = self.kinds();
        let (n_vertices, n_rows) = (self.n_vertices(), self.n_face_rows());
        let (mut face, mut n_bad) = (FullFace::default(), 0);
        with_scan!(&self.file, self.header.encoding, start, |scan| {
            for row in 0..n_rows {
                let limits = (n_vertices, self.options.skip_bad);
                let whole = match read(&mut scan, &kinds, limits, &mut face) {
                    Ok(whole) => whole,
                    Err(fault) => {
                        return Err(explain(&self.file, element, row, scan.last(), fault));
                    }
                };
                face.is_bad = !whole || face.corners.iter().any(|&v| self.bad_vertices.contains(v));
                n_bad += u64::from(face.is_bad);
                // Begins with the same corner.
                if is_mirror && face.corners.len() > 1 {
                    face.corners[1..].reverse();
                    face.texture[1..].reverse();
                }
                if !face.is_bad || self.options.skip_bad {
                    each(row, &face)?;
                } else {
                    let fault = Fault::Text(out_of_range(n_vertices));
                    return Err(explain(&self.file, element, row, scan.last(), fault));
                }
            }
            Ok(n_bad)
        })
    }
}

/// Texture coordinates of a triangle's corners, and the number of its material.
pub type FaceLook = ([[f32; 2]; 3], u32);

/// Looks of the triangles of a block of faces.
#[derive(Debug, Default)]
pub struct FaceLooks {
    /// Texture coordinates of the corners of each triangle.
    pub texture: Vec<[[f32; 2]; 3]>,
    /// The number of its material; `u32::MAX` where it has none.
    pub materials: Vec<u32>,
    face: FullFace,
}

impl FaceLooks {
    /// Coordinates and material of a triangle of the block.
    pub fn of(&self, triangle: usize) -> Option<FaceLook> {
        Some((*self.texture.get(triangle)?, *self.materials.get(triangle)?))
    }
}

impl MeshSource {
    /// Reads a block of faces as triangles, with texture coordinates and materials; callable from any thread.
    ///
    /// The triangles are those of `read_faces`, in the same order. Memory: 28 bytes a triangle.
    pub fn read_faces_with_looks(
        &self,
        index: u64,
        block: &mut FaceBlock,
        out: &mut FaceLooks,
    ) -> Result<()> {
        self.read_faces_with_rows(index, block)?;
        out.texture.clear();
        out.materials.clear();
        let n_rows = self.n_face_rows();
        let (start, end) = match &self.layout.faces {
            FaceLayout::None | FaceLayout::Strips(_) => {
                out.texture.resize(block.triangles.len(), [[f32::NAN; 2]; 3]);
                out.materials.resize(block.triangles.len(), 0);
                return Ok(());
            }
            FaceLayout::Fixed { offset, rows, fallback, .. } => {
                let built = fallback.lock().unwrap_or_else(PoisonError::into_inner).clone();
                let offset = offset + block.first_row * rows.stride as u64;
                let start = Mark { offset, ..Mark::default() };
                let start = built.map_or(start, |rows| rows.blocks[index as usize].0);
                (start, (block.first_row + BLOCK_ROWS).min(n_rows))
            }
            FaceLayout::Indexed(rows) => {
                let next = rows.blocks.get(index as usize + 1).map_or(rows.n_rows, |b| b.1);
                (rows.blocks[index as usize].0, next)
            }
        };
        let kinds = self.kinds();
        let number = self.number_place();
        let mut triangles = block.triangles.iter().zip(&block.rows).peekable();
        with_scan!(&self.file, self.header.encoding, start, |scan| {
            for row in block.first_row..end {
                if triangles.peek().is_none() {
                    break;
                }
                let limits = (self.n_vertices(), self.options.skip_bad);
                if let Err(fault) = read(&mut scan, &kinds, limits, &mut out.face) {
                    return Err(explain(&self.file, self.face(), row, scan.last(), fault));
                }
                let material =
                    number.map_or(0.0, |(scalar, at)| read_scalar(scalar, &out.face.values, at));
                let is_number = (0.0..f64::from(u32::MAX)).contains(&material);
                while let Some((ids, _)) =
                    triangles.next_if(|(_, own)| block.first_row + u64::from(**own) == row)
                {
                    let face = &out.face;
                    let corner = |id: &u64| {
                        let at = face.corners.iter().position(|corner| corner == id);
                        at.and_then(|at| face.texture.get(at)).copied().unwrap_or([f32::NAN; 2])
                    };
                    out.texture.push([corner(&ids[0]), corner(&ids[1]), corner(&ids[2])]);
                    out.materials.push(if is_number { material as u32 } else { u32::MAX });
                }
            }
            Ok(())
        })?;
        if out.texture.len() == block.triangles.len() {
            return Ok(());
        }
        Err(self.file.bad("its faces changed while they were read"))
    }

    /// Type and place of the number of the material among the values of a face.
    fn number_place(&self) -> Option<(Scalar, usize)> {
        let mut at = 0;
        for property in self.face_properties() {
            if property.name == NUMBER {
                return Some((property.scalar, at));
            }
            at += property.scalar.bytes();
        }
        None
    }

    /// The parts of a face.
    fn kinds(&self) -> Vec<(FaceRole, Kind)> {
        let (list, texture) = (self.face().index_list(), self.texture_property());
        let kind = |(i, p): (usize, &HeaderProperty)| {
            let role = match p.kind {
                _ if Some(i) == list => FaceRole::Corners,
                Kind::List { .. } if Some(&p.name) == texture.as_ref() => FaceRole::Texture,
                Kind::Scalar(_) if self.is_hidden(p) => FaceRole::Hidden,
                _ => FaceRole::Other,
            };
            (role, p.kind)
        };
        self.face().properties.iter().enumerate().map(kind).collect()
    }
}

/// Role of a property of a face.
#[derive(Clone, Copy)]
enum FaceRole {
    Corners,
    Texture,
    Hidden,
    Other,
}

/// Reads a row; false if a corner names no vertex or, with `skip_bad`, if a part of it cannot be read.
fn read<S: Scan>(
    scan: &mut S,
    kinds: &[(FaceRole, Kind)],
    (n_vertices, skip_bad): (u64, bool),
    face: &mut FullFace,
) -> Scanned<bool> {
    let mut is_whole = true;
    face.corners.clear();
    face.texture.clear();
    face.values.clear();
    for &(role, kind) in kinds {
        match (role, kind) {
            (FaceRole::Corners, Kind::List { count, item }) => {
                let n = scan.count(count)?;
                let most = (MAX_CORNERS, "corners");
                is_whole &= items(scan, (item, n), most, skip_bad, |scan| {
                    face.corners.push(scan.index(item)?);
                    Ok(())
                })?;
            }
            (FaceRole::Texture, Kind::List { count, item }) => {
                let n = scan.count(count)?;
                let most = (2 * MAX_CORNERS, "texture coordinates");
                let mut first = None;
                is_whole &= items(scan, (item, n), most, skip_bad, |scan| {
                    let x = float(scan, item)?;
                    match first.take() {
                        None => first = Some(x),
                        Some(u) => face.texture.push([u, x]),
                    }
                    Ok(())
                })?;
            }
            (_, Kind::Scalar(wire)) => {
                let mut bytes = [0; 8];
                let scalar = wire.scalar();
                let value = &mut bytes[..scalar.bytes()];
                is_whole &= items(scan, (wire, 1), (1, "values"), skip_bad, |scan| {
                    scan.store(wire, scalar, value)
                })?;
                if !matches!(role, FaceRole::Hidden) {
                    face.values.extend_from_slice(value);
                }
            }
            (_, Kind::List { count, item }) => {
                let n = scan.count(count)?;
                scan.skip(item, n)?;
            }
        }
    }
    face.texture.resize(face.corners.len(), [0.0; 2]);
    Ok(is_whole && face.corners.iter().all(|&v| v < n_vertices))
}

/// Reads `n` items; false if one cannot be read, or if they are too many, and `skip_bad` passes over what is left of them.
fn items<S: Scan>(
    scan: &mut S,
    (item, n): (Wire, u64),
    (most, what): (u64, &str),
    skip_bad: bool,
    mut take: impl FnMut(&mut S) -> Scanned<()>,
) -> Scanned<bool> {
    if n > most {
        if skip_bad {
            return scan.skip(item, n).map(|()| false);
        }
        return Err(Fault::Text(format!("a face has {n} {what} ({most} at most)")));
    }
    for n_read in 0..n {
        match take(scan) {
            Err(Fault::Text(_)) if skip_bad => return scan.skip(item, n - n_read).map(|()| false),
            taken => taken?,
        }
    }
    Ok(true)
}

fn float<S: Scan>(scan: &mut S, item: Wire) -> Scanned<f32> {
    let mut bytes = [0; 4];
    scan.store(item, Scalar::F32, &mut bytes)?;
    Ok(f32::from_le_bytes(bytes))
}
