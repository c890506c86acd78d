//! Vertices of a GLB file whose faces have names, materials or texture coordinates: one for each label, place and pair of
//! coordinates, out of core.
//!
//! A sort by label, vertex and coordinates numbers them, a sort by corner puts them back into faces. So each
//! label is a primitive with its vertices in the order of the mesh, and faces in the order of the mesh.

use super::document::Primitive;
use crate::by_material::{FaceLabel, LabelOf};
use crate::external_sort::{ExternalSort, halves};
use crate::ply::raw::{RawFile, Spool};
use crate::ply::row_window::RowWindow;
use crate::ply::{OutputHeader, TexturedTriangle};
use std::path::{Path, PathBuf};
use stonecut_system::error::Result;

/// Corners on their way to vertices.
///
/// Memory: that of the header for each of two sorts. Disk: 40 bytes a corner beyond that.
pub(super) struct Split {
    folder: PathBuf,
    memory_bytes: usize,
    corners: Corners,
    n_corners: u64,
}

/// Records of corners: label, vertex, coordinates, number in two halves, and the tangent in two where there is one.
enum Corners {
    Plain(ExternalSort<6>),
    WithTangents(ExternalSort<8>),
}

/// Vertices and faces in their order.
pub(super) struct Parts {
    pub(super) primitives: Vec<Primitive>,
    pub(super) vertices: RawFile,
    /// Label, corner in two halves, number of the vertex within its primitive.
    pub(super) indices: ExternalSort<4>,
}

impl Split {
    pub(super) fn new(folder: &Path, header: &OutputHeader) -> Split {
        Split {
            folder: folder.to_path_buf(),
            memory_bytes: header.sort_memory_bytes,
            corners: match header.has_tangents {
                false => Corners::Plain(ExternalSort::new(folder, header.sort_memory_bytes)),
                true => Corners::WithTangents(ExternalSort::new(folder, header.sort_memory_bytes)),
            },
            n_corners: 0,
        }
    }

    /// Appends a face.
    pub(super) fn push(&mut self, label: u32, face: &TexturedTriangle) -> Result<()> {
        for ((vertex, uv), tangent) in face.corners.iter().zip(face.texture).zip(face.tangents) {
            // glTF has its origin at the top. Adding 0 turns -0 into 0.
            let plain = uv.map(|x| if x.is_finite() { x } else { 0.0 });
            let [u, v] = [plain[0], 1.0 - plain[1]].map(|x| (x + 0.0).to_bits());
            let [high, low] = halves(self.n_corners);
            let vertex = *vertex as u32;
            match &mut self.corners {
                Corners::Plain(sort) => sort.push([label, vertex, u, v, high, low])?,
                Corners::WithTangents(sort) => {
                    let [a, b] = packed(tangent);
                    sort.push([label, vertex, u, v, high, low, a, b])?;
                }
            }
            self.n_corners += 1;
        }
        Ok(())
    }

    /// Makes the vertices: `row` turns the spooled row of a vertex of a primitive into that of the file, before its coordinates.
    pub(super) fn finish(
        self,
        label_of: &LabelOf,
        (spooled, row_bytes): (&RawFile, usize),
        has_own_texture: bool,
        row: impl Fn(FaceLabel, &[u8], &mut Vec<u8>) -> [f64; 3],
    ) -> Result<Parts> {
        let mut rows = RowWindow::new(spooled, row_bytes);
        let mut vertices = Spool::new(&self.folder);
        let mut indices = ExternalSort::<4>::new(&self.folder, self.memory_bytes);
        let mut primitives: Vec<Primitive> = Vec::new();
        let (mut last, mut last_label) = (None, None);
        let mut out = Vec::new();
        let mut take = |[label, vertex, u, v, high, low]: [u32; 6], tangent: Option<[u32; 2]>| {
            if last_label != Some(label) {
                last_label = Some(label);
                primitives.push(Primitive {
                    label: label_of.parts(label),
                    n_vertices: 0,
                    n_corners: 0,
                    low: [f64::MAX; 3],
                    high: [f64::MIN; 3],
                });
            }
            let primitive = primitives.last_mut().expect("the corner's own");
            if last != Some([label, vertex, u, v]) {
                last = Some([label, vertex, u, v]);
                out.clear();
                let steps = row(primitive.label, rows.get(u64::from(vertex))?, &mut out);
                if !has_own_texture {
                    out.extend_from_slice([u, v].map(u32::to_le_bytes).as_flattened());
                }
                // Corners of a vertex differ in their tangents only where faces meet in nothing but the vertex.
                let tangent = tangent.map(|tangent| tangent.map(u32::to_le_bytes));
                tangent.iter().for_each(|bytes| out.extend_from_slice(bytes.as_flattened()));
                vertices.write(&out)?;
                primitive.n_vertices += 1;
                for (axis, step) in steps.into_iter().enumerate() {
                    primitive.low[axis] = primitive.low[axis].min(step);
                    primitive.high[axis] = primitive.high[axis].max(step);
                }
            }
            primitive.n_corners += 1;
            // Fewer vertices than corners, fewer than 2^32: `create` made sure of it.
            indices.push([label, high, low, (primitive.n_vertices - 1) as u32])
        };
        match self.corners {
            Corners::Plain(sort) => {
                sort.drain(|record| take(record, None))?;
            }
            Corners::WithTangents(sort) => {
                sort.drain(|[m, vertex, u, v, h, l, a, b]| {
                    take([m, vertex, u, v, h, l], Some([a, b]))
                })?;
            }
        }
        Ok(Parts { primitives, vertices: vertices.finish(spooled.path())?, indices })
    }
}

/// Four numbers of 16 bits in two words, in the order of the file.
fn packed(tangent: [i16; 4]) -> [u32; 2] {
    let [a, b, c, d] = tangent.map(i16::to_le_bytes);
    [[a, b], [c, d]].map(|[a, b]| u32::from_le_bytes([a[0], a[1], b[0], b[1]]))
}
