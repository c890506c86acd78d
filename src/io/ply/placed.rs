//! Places what is read: positions, normals and the sense of faces, block by block as they leave the reader.

use super::VertexBlock;
use stonecut_mesh::bounds::Bounds;
use stonecut_mesh::placing::{Placing, offset_comment, offset_in, offset_of};
use stonecut_mesh::property::{Scalar, read_scalar, write_scalar};
use stonecut_mesh::record::VertexSchema;

/// Distance from the origin, in sides of the mesh, from which on coordinates are doubles, as for OBJ and glTF.
const FAR: f64 = 8.0;

/// A placing, made for one file.
#[derive(Debug)]
pub(super) struct Placed {
    placing: Placing,
    of_normals: [[f64; 3]; 3],
    /// Subtracted after that.
    offset: [f64; 3],
    /// Layout of the records that leave the reader.
    pub(super) schema: VertexSchema,
    /// Types and places of the components of normals in them.
    normal: Option<[(Scalar, usize); 3]>,
    comments: Vec<String>,
}

/// Types and places of the components of normals.
fn normal_of(schema: &VertexSchema) -> Option<[(Scalar, usize); 3]> {
    let place = |name: &str| {
        let i = schema.own_property(name)?;
        let before: usize = schema.properties[..i].iter().map(|p| p.scalar.bytes()).sum();
        Some((schema.properties[i].scalar, schema.position_bytes() + before))
    };
    let [x, y, z] = ["nx", "ny", "nz"].map(place);
    Some([x?, y?, z?])
}

impl Placed {
    /// The placing of a file whose records are laid out as `schema`, which it moves to `bounds`; `None` where coordinates are
    /// then not finite.
    ///
    /// Coordinates become doubles where the file has doubles, or where the mesh comes to lie so far from the origin that floats
    /// would not do.
    pub(super) fn new(
        placing: &Placing,
        mut schema: VertexSchema,
        bounds: &Bounds,
        comments: &[String],
    ) -> Option<Placed> {
        let offset = if placing.recentres { Placing::offset(bounds) } else { [0.0; 3] };
        if !bounds.is_empty() {
            let corners = [bounds.low, bounds.high].map(|c| [0, 1, 2].map(|k| c[k] - offset[k]));
            if !corners.as_flattened().iter().all(|x| x.is_finite()) {
                return None;
            }
            let extent = (0..3).map(|k| corners[1][k] - corners[0][k]).fold(0.0, f64::max);
            let far = corners.as_flattened().iter().fold(0.0, |far: f64, x| far.max(x.abs()));
            if far > FAR * extent || far > f64::from(f32::MAX) {
                schema.coordinate = Scalar::F64;
            }
        }
        let mut comments = comments.to_vec();
        if let Some(turned) = offset_in(&comments).and_then(|offset| placing.vector(offset)) {
            // An offset is turned and scaled with what it is added to.
            comments.retain(|comment| offset_of(comment).is_none());
            comments.push(offset_comment(turned));
        }
        if placing.recentres {
            // One comment: whoever adds one of two would be off by the other.
            let before = offset_in(&comments).unwrap_or_default();
            comments.retain(|comment| offset_of(comment).is_none());
            comments.push(offset_comment([0, 1, 2].map(|k| before[k] + offset[k])));
        }
        Some(Placed {
            of_normals: placing.of_normals(),
            placing: placing.clone(),
            offset,
            normal: normal_of(&schema),
            schema,
            comments,
        })
    }

    /// Comments of the file, and the one on the offset.
    pub(super) fn comments(&self) -> &[String] {
        &self.comments
    }

    /// Moves a position.
    pub(super) fn point(&self, position: [f64; 3]) -> [f64; 3] {
        let place = self.placing.point(position);
        [0, 1, 2].map(|k| place[k] - self.offset[k])
    }

    /// Turns records of the file into those of the placed mesh.
    pub(super) fn put_vertices(&self, from: &VertexSchema, block: &mut VertexBlock) {
        let mut out = std::mem::take(&mut block.scratch);
        out.clear();
        let n_bytes = self.schema.record_bytes();
        for record in block.records.chunks_exact(from.record_bytes()) {
            let start = out.len();
            self.schema.encode_position(self.point(from.position(record)), &mut out);
            out.extend_from_slice(&record[from.position_bytes()..]);
            if let Some(fields) = self.normal {
                self.turn(&mut out[start..start + n_bytes], fields);
            }
        }
        block.scratch = std::mem::replace(&mut block.records, out);
    }

    /// Turns the normal in a record; its length stays.
    fn turn(&self, record: &mut [u8], fields: [(Scalar, usize); 3]) {
        let length = |v: [f64; 3]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
        let old = fields.map(|(scalar, at)| read_scalar(scalar, record, at));
        let new = self.of_normals.map(|row| row[0] * old[0] + row[1] * old[1] + row[2] * old[2]);
        let share = length(old) / length(new);
        if share.is_finite() {
            for ((scalar, at), value) in fields.into_iter().zip(new) {
                write_scalar(scalar, record, at, value * share);
            }
        }
    }

    /// Returns whether faces are turned around.
    pub(super) fn is_mirror(&self) -> bool {
        self.placing.determinant() < 0.0
    }
}
