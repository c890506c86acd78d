//! Layout of a vertex record: position and carried properties, as packed little-endian bytes.
//!
//! The reader turns every dialect into these records, cells keep them on disk, and the writer turns them back.
//! A loaded cell keeps the records beside its `Mesh`, so a position is in memory twice (12 or 24 bytes a vertex):
//! what a collapse does not touch comes back from the record bit for bit.

use super::property::{Origin, Property, Scalar};

/// The layout of a vertex record: x, y, z in `coordinate`, then `properties` in order, packed,
/// little-endian.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct VertexSchema {
    /// `F32` or `F64`.
    pub coordinate: Scalar,
    /// Further properties of each vertex, in the order of the input's header.
    pub properties: Vec<Property>,
}

impl VertexSchema {
    /// Bytes of x, y and z.
    pub fn position_bytes(&self) -> usize {
        3 * self.coordinate.bytes()
    }

    /// Bytes of one record.
    pub fn record_bytes(&self) -> usize {
        self.position_bytes() + self.properties.iter().map(|p| p.scalar.bytes()).sum::<usize>()
    }

    /// The index of a property that came with the vertices themselves; those that came from faces have the names of faces.
    pub fn own_property(&self, name: &str) -> Option<usize> {
        self.properties.iter().position(|p| p.origin == Origin::Vertex && p.name == name)
    }

    /// Says what the last properties are. Panics if their types are others than before.
    pub fn set_last(&mut self, properties: Vec<Property>) {
        let own = self.properties.len().checked_sub(properties.len()).expect("there are as many");
        let types = |list: &[Property]| list.iter().map(|p| p.scalar).collect::<Vec<_>>();
        assert_eq!(types(&self.properties[own..]), types(&properties), "types stay");
        self.properties.truncate(own);
        self.properties.extend(properties);
    }

    /// Says which property locks vertices without being one of the input.
    pub fn set_lock(&mut self, name: &str) {
        if let Some(i) = self.own_property(name) {
            self.properties[i].origin = Origin::Lock;
        }
    }

    /// Type and place in a record of the property that locks vertices: that of this name, or the one that is not the
    /// input's.
    pub fn lock_place(&self, name: Option<&str>) -> Option<(Scalar, usize)> {
        let i = match name {
            Some(name) => self.own_property(name)?,
            None => self.properties.iter().position(|p| p.origin == Origin::Lock)?,
        };
        let before: usize = self.properties[..i].iter().map(|p| p.scalar.bytes()).sum();
        Some((self.properties[i].scalar, self.position_bytes() + before))
    }

    /// Largest relative error of a coordinate.
    pub fn rounding(&self) -> f64 {
        match self.coordinate {
            Scalar::F64 => f64::EPSILON / 2.0,
            _ => f64::from(f32::EPSILON) / 2.0,
        }
    }

    /// The position in a record, exactly, as doubles.
    pub fn position(&self, record: &[u8]) -> [f64; 3] {
        match self.coordinate {
            Scalar::F64 => [0, 8, 16].map(|at| {
                f64::from_le_bytes(record[at..at + 8].try_into().expect("a slice of 8 bytes"))
            }),
            _ => [0, 4, 8].map(|at| {
                f64::from(f32::from_le_bytes(
                    record[at..at + 4].try_into().expect("a slice of 4 bytes"),
                ))
            }),
        }
    }

    /// Appends a position in the coordinate type; exact for a position that came out of a record.
    pub fn encode_position(&self, position: [f64; 3], out: &mut Vec<u8>) {
        for value in position {
            match self.coordinate {
                Scalar::F64 => out.extend_from_slice(&value.to_le_bytes()),
                _ => out.extend_from_slice(&(value as f32).to_le_bytes()),
            }
        }
    }
}
