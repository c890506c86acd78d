//! Output vertex layout: the properties that are written, without texture that is at corners, and normals.

use crate::config::Normals;
use std::ops::Range;
use stonecut_mesh::property::{Origin, Property, REACH, Scalar, write_scalar};
use stonecut_mesh::record::VertexSchema;

/// The components of a normal.
pub const NORMAL: [&str; 3] = ["nx", "ny", "nz"];

/// Plan of turning records into records of the output.
pub struct Shape {
    /// The layout of the output's records.
    pub schema: VertexSchema,
    /// Bytes of a record that are kept, in order.
    kept: Vec<Range<usize>>,
    /// Type and place of the components of a new normal.
    normal: Option<[(Scalar, usize); 3]>,
    /// Place of the distance from the input.
    reach: Option<usize>,
}

impl Shape {
    /// Leaves out the last `n_texture` properties. New normals take the place of old ones, or come last. With
    /// `has_reach` the distance from the input follows, as one more property.
    pub fn new(
        schema: &VertexSchema,
        n_texture: usize,
        normals: Normals,
        has_reach: bool,
    ) -> Shape {
        let properties = &schema.properties[..schema.properties.len() - n_texture];
        let float = |name: &&str| {
            let found = schema.own_property(name).and_then(|i| properties.get(i));
            found.is_some_and(|p| !p.scalar.is_integer())
        };
        let has_floats = NORMAL.iter().all(float);
        let stays = |p: &Property| match normals {
            _ if p.origin == Origin::Lock => false,
            Normals::Keep => true,
            Normals::Recompute if has_floats => true,
            Normals::Recompute | Normals::Drop => {
                p.origin != Origin::Vertex || !NORMAL.contains(&p.name.as_str())
            }
        };
        let mut at = schema.position_bytes();
        let mut kept: Vec<_> = std::iter::once(0..at).collect();
        let mut out = VertexSchema { coordinate: schema.coordinate, properties: Vec::new() };
        for property in properties {
            let end = at + property.scalar.bytes();
            if stays(property) {
                kept.push(at..end);
                out.properties.push(property.clone());
            }
            at = end;
        }
        if normals == Normals::Recompute && !has_floats {
            let new = NORMAL.map(|name| Property::new(name, Scalar::F32));
            out.properties.extend(new);
        }
        let place = |name: &str| {
            let i = out.own_property(name)?;
            let before: usize = out.properties[..i].iter().map(|p| p.scalar.bytes()).sum();
            Some((out.properties[i].scalar, out.position_bytes() + before))
        };
        let normal = match (normals, NORMAL.map(place)) {
            (Normals::Recompute, [Some(x), Some(y), Some(z)]) => Some([x, y, z]),
            _ => None,
        };
        let reach = has_reach.then(|| out.record_bytes());
        if has_reach {
            out.properties.push(Property::new(REACH, Scalar::F32));
        }
        Shape { schema: out, kept, normal, reach }
    }

    /// Appends the output's record.
    pub fn put(&self, record: &[u8], normal: Option<[f64; 3]>, reach: f32, out: &mut Vec<u8>) {
        let start = out.len();
        for range in &self.kept {
            out.extend_from_slice(&record[range.clone()]);
        }
        out.resize(start + self.schema.record_bytes(), 0);
        if let (Some(places), Some(normal)) = (self.normal, normal) {
            for ((scalar, at), value) in places.into_iter().zip(normal) {
                write_scalar(scalar, &mut out[start..], at, value);
            }
        }
        if let Some(at) = self.reach {
            write_scalar(Scalar::F32, &mut out[start..], at, f64::from(reach));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn schema(names: &[(&str, Scalar)]) -> VertexSchema {
        let property = |&(name, scalar): &(&str, Scalar)| Property::new(name, scalar);
        let properties = names.iter().map(property).collect();
        VertexSchema { coordinate: Scalar::F32, properties }
    }

    #[test]
    fn normals_stay_go_or_are_replaced_where_they_are() {
        use Scalar::{F32, F64, U8};
        let full = [("red", U8), ("nx", F32), ("ny", F32), ("nz", F64), ("texture_u", F32)];
        let full = schema(&full);
        let record: Vec<u8> = (0..full.record_bytes() as u8).collect();
        let put = |shape: &Shape| {
            let mut out = Vec::new();
            shape.put(&record, Some([0.0, 0.6, -0.8]), 0.25, &mut out);
            out
        };
        let keep = Shape::new(&full, 1, Normals::Keep, false);
        assert_eq!(put(&keep), record[..record.len() - 4]);
        let drop = Shape::new(&full, 1, Normals::Drop, false);
        assert_eq!(drop.schema, schema(&[("red", U8)]));
        assert_eq!(put(&drop), record[..13]);
        let new = Shape::new(&full, 1, Normals::Recompute, false);
        assert_eq!(new.schema, keep.schema);
        assert_eq!(put(&new)[..13], record[..13]);
        assert_eq!(put(&new)[21..], (-0.8f64).to_le_bytes());
        let none = schema(&[("red", U8), ("nx", Scalar::I16)]);
        let added = Shape::new(&none, 0, Normals::Recompute, false);
        assert_eq!(added.schema, schema(&[("red", U8), ("nx", F32), ("ny", F32), ("nz", F32)]));
        assert_eq!(put(&added)[17..21], 0.6f32.to_le_bytes());
        let with_reach = Shape::new(&full, 1, Normals::Drop, true);
        assert_eq!(with_reach.schema, schema(&[("red", U8), (REACH, F32)]));
        assert_eq!(put(&with_reach)[13..], 0.25f32.to_le_bytes());
    }
}
