//! Faces with texture coordinates at their corners, one after another.
//!
//! For `formats::wedges`, which turns them into vertices. Reads the rows in file order, whatever the
//! encoding; checks indices as `rows` does.

use super::header::{Kind, Wire};
use super::layout::{FaceLayout, explain, with_scan};
use super::rows::{MAX_CORNERS, out_of_range};
use super::scan::{Fault, Mark, Scan, Scanned};
use super::source::MeshSource;
use crate::error::Result;
use crate::schema::Scalar;

/// The property of a face that says which image it is on.
const IMAGE: &str = "texnumber";

/// One face.
#[derive(Debug, Default)]
pub(crate) struct TexturedFace {
    pub corners: Vec<u64>,
    /// Texture coordinates of each corner; zeros where the face has none.
    pub texture: Vec<[f32; 2]>,
    /// Which image; 0 if the file does not say.
    pub image: i32,
}

impl MeshSource {
    /// Whether the faces have lists of texture coordinates, and whether they name an image.
    pub(crate) fn corner_texture(&self) -> Option<bool> {
        let property = self.texture()?.property;
        let properties = &self.face().properties;
        let is_list = |kind: &Kind| matches!(kind, Kind::List { .. });
        let there = properties.iter().any(|p| p.name == property && is_list(&p.kind));
        let image = properties.iter().any(|p| p.name == IMAGE && !is_list(&p.kind));
        there.then_some(image)
    }

    /// Calls `each` with every face that is whole; returns how many were left out with `skip_bad`.
    pub(crate) fn each_textured_face(
        &self,
        mut each: impl FnMut(&TexturedFace) -> Result<()>,
    ) -> Result<u64> {
        let start = match &self.layout.faces {
            FaceLayout::Fixed { offset, .. } => Mark { offset: *offset, ..Mark::default() },
            FaceLayout::Indexed(rows) => rows.blocks.first().map_or(Mark::default(), |b| b.0),
            FaceLayout::None | FaceLayout::Strips(_) => return Ok(0),
        };
        let element = self.face();
        let Some(list) = element.index_list() else { return Ok(0) };
        let property = self.texture().map(|texture| texture.property);
        let kinds: Vec<(Role, Kind)> = element
            .properties
            .iter()
            .enumerate()
            .map(|(i, p)| {
                let role = match p.kind {
                    _ if i == list => Role::Corners,
                    Kind::List { .. } if Some(&p.name) == property.as_ref() => Role::Texture,
                    Kind::Scalar(_) if p.name == IMAGE => Role::Image,
                    _ => Role::Other,
                };
                (role, p.kind)
            })
            .collect();
        let (n_vertices, n_faces) = (self.n_vertices(), self.n_faces());
        let (mut face, mut n_bad) = (TexturedFace::default(), 0);
        with_scan!(&self.file, self.header.encoding, start, |scan| {
            for row in 0..n_faces {
                let whole = match read(&mut scan, &kinds, n_vertices, &mut face) {
                    Ok(whole) => whole,
                    Err(fault) => {
                        return Err(explain(&self.file, element, row, scan.last(), fault));
                    }
                };
                if whole && !face.corners.iter().any(|&v| self.bad_vertices.contains(v)) {
                    each(&face)?;
                } else if self.options.skip_bad {
                    n_bad += 1;
                } else {
                    let fault = Fault::Text(out_of_range(n_vertices));
                    return Err(explain(&self.file, element, row, scan.last(), fault));
                }
            }
            Ok(n_bad)
        })
    }
}

/// What a property of a face is.
#[derive(Clone, Copy)]
enum Role {
    Corners,
    Texture,
    Image,
    Other,
}

/// Reads a row; false if a corner names no vertex.
fn read<S: Scan>(
    scan: &mut S,
    kinds: &[(Role, Kind)],
    n_vertices: u64,
    face: &mut TexturedFace,
) -> Scanned<bool> {
    face.corners.clear();
    face.texture.clear();
    face.image = 0;
    for &(role, kind) in kinds {
        match (role, kind) {
            (Role::Corners, Kind::List { count, item }) => {
                let n = scan.count(count)?;
                if n > MAX_CORNERS {
                    let what = format!("a face has {n} corners ({MAX_CORNERS} at most)");
                    return Err(Fault::Text(what));
                }
                for _ in 0..n {
                    face.corners.push(scan.index(item)?);
                }
            }
            (Role::Texture, Kind::List { count, item }) => {
                let n = scan.count(count)?;
                if n > 2 * MAX_CORNERS {
                    return Err(Fault::Text(format!("a face has {n} texture coordinates")));
                }
                for _ in 0..n / 2 {
                    face.texture.push([float(scan, item)?, float(scan, item)?]);
                }
                scan.skip(item, n % 2)?;
            }
            (Role::Image, Kind::Scalar(wire)) => {
                let mut bytes = [0; 4];
                scan.store(wire, Scalar::I32, &mut bytes)?;
                face.image = i32::from_le_bytes(bytes);
            }
            (_, Kind::Scalar(wire)) => scan.skip(wire, 1)?,
            (_, Kind::List { count, item }) => {
                let n = scan.count(count)?;
                scan.skip(item, n)?;
            }
        }
    }
    face.texture.resize(face.corners.len(), [0.0; 2]);
    Ok(face.corners.iter().all(|&v| v < n_vertices))
}

fn float<S: Scan>(scan: &mut S, item: Wire) -> Scanned<f32> {
    let mut bytes = [0; 4];
    scan.store(item, Scalar::F32, &mut bytes)?;
    Ok(f32::from_le_bytes(bytes))
}
