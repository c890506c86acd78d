//! What one vertex record holds: position and carried properties, as packed little-endian bytes.
//!
//! The reader turns every dialect into these records; cells keep them on disk; the writer turns them
//! back. Kernel channels are `f32`; this is the one place that says how a property becomes channels and
//! how channels become a property again.

/// A scalar type of a PLY property.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[allow(missing_docs)]
pub enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F32,
    F64,
}

impl Scalar {
    /// Size in bytes.
    pub const fn bytes(self) -> usize {
        match self {
            Scalar::I8 | Scalar::U8 => 1,
            Scalar::I16 | Scalar::U16 => 2,
            Scalar::I32 | Scalar::U32 | Scalar::F32 => 4,
            Scalar::I64 | Scalar::U64 | Scalar::F64 => 8,
        }
    }

    /// Whether this is an integer type.
    pub const fn is_integer(self) -> bool {
        !matches!(self, Scalar::F32 | Scalar::F64)
    }
}

/// A carried vertex property, besides x, y and z.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Property {
    /// The name in the header: `red`, `nx`, `quality`, ...
    pub name: String,
    /// The type in the header.
    pub scalar: Scalar,
}

/// The layout of a vertex record: x, y, z in `coordinate`, then `properties` in order, packed,
/// little-endian.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct VertexSchema {
    /// `F32` or `F64`.
    pub coordinate: Scalar,
    /// What else each vertex carries, in the order of the input's header.
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
}
