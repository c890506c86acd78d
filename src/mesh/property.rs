//! Scalar types, and properties of vertices and faces with what they come from.

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

    /// True for an integer type.
    pub const fn is_integer(self) -> bool {
        !matches!(self, Scalar::F32 | Scalar::F64)
    }
}

/// The property of vertices that `simplify --error-field` writes: its distance from the input, or that of vertices of the input from
/// the triangles around it, whichever is larger.
pub const REACH: &str = "error";

/// Origin of a property of vertices.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum Origin {
    /// The input's vertices, or texture coordinates at its corners.
    #[default]
    Vertex,
    /// A property of faces that is averaged (`face_properties`).
    FaceMean,
    /// A property of faces that is a label: never averaged.
    FaceLabel,
    /// The number of the region of faces that a vertex belongs to; no property of the input.
    Region,
    /// A mark of vertices that must stay; no property of the input either.
    Lock,
}

/// A carried property, besides x, y and z.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Property {
    /// The name in the header: `red`, `nx`, `quality`, ... Properties of different origins may share one.
    pub name: String,
    /// The type in the header.
    pub scalar: Scalar,
    /// Its origin; decides together with name and type what a collapse may do with it.
    pub origin: Origin,
    /// Of a component of a colour: its value of full intensity, where the file's values say another than the type (`colours`).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub white: Option<u32>,
    /// Of a label: it lies in patches, whose borders are kept (`io::survey_labels`).
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub is_patchy: bool,
    /// Of a double far from 0: a whole number among its values, which they are averaged about (`middle_of`).
    #[serde(default, skip_serializing_if = "is_zero")]
    pub middle: i64,
}

#[allow(clippy::trivially_copy_pass_by_ref)] // The form that serde calls.
fn is_zero(middle: &i64) -> bool {
    *middle == 0
}

/// Values of a property that are looked at for its middle.
pub const MIDDLE_SAMPLE: usize = 4096;

/// A whole number among `values`, if they are much farther from 0 than from each other; otherwise 0.
///
/// The kernel averages floats: seconds since 1970 would be rounded to steps of 128, map coordinates to half a metre.
pub fn middle_of(mut values: Vec<f64>) -> i64 {
    const FAR: f64 = 1000.0;
    const SPREADS: f64 = 4.0;
    const MOST: f64 = (1u64 << 53) as f64;
    values.retain(|x| x.is_finite());
    values.sort_unstable_by(f64::total_cmp);
    let (Some(least), Some(most)) = (values.first(), values.last()) else { return 0 };
    let middle = values[values.len() / 2].round();
    let is_far = middle.abs() > FAR.max(SPREADS * (most - least)) && middle.abs() < MOST;
    if is_far { middle as i64 } else { 0 }
}

impl Property {
    /// A property that the file itself has.
    pub fn new(name: &str, scalar: Scalar) -> Property {
        let name = name.to_owned();
        Property { name, scalar, origin: Origin::Vertex, white: None, is_patchy: false, middle: 0 }
    }
}

/// Reads a scalar at byte `at` of a little-endian record as a double; 64-bit integers are rounded.
pub fn read_scalar(scalar: Scalar, record: &[u8], at: usize) -> f64 {
    fn bytes<const N: usize>(record: &[u8], at: usize) -> [u8; N] {
        record[at..at + N].try_into().expect("the slice has N bytes")
    }
    match scalar {
        Scalar::I8 => f64::from(record[at] as i8),
        Scalar::U8 => f64::from(record[at]),
        Scalar::I16 => f64::from(i16::from_le_bytes(bytes(record, at))),
        Scalar::U16 => f64::from(u16::from_le_bytes(bytes(record, at))),
        Scalar::I32 => f64::from(i32::from_le_bytes(bytes(record, at))),
        Scalar::U32 => f64::from(u32::from_le_bytes(bytes(record, at))),
        Scalar::I64 => i64::from_le_bytes(bytes(record, at)) as f64,
        Scalar::U64 => u64::from_le_bytes(bytes(record, at)) as f64,
        Scalar::F32 => f64::from(f32::from_le_bytes(bytes(record, at))),
        Scalar::F64 => f64::from_le_bytes(bytes(record, at)),
    }
}

/// Writes a value at byte `at` of a little-endian record; integers are rounded and clamped.
pub fn write_scalar(scalar: Scalar, record: &mut [u8], at: usize, value: f64) {
    let place = &mut record[at..at + scalar.bytes()];
    match scalar {
        Scalar::I8 => place.copy_from_slice(&(value.round() as i8).to_le_bytes()),
        Scalar::U8 => place.copy_from_slice(&(value.round() as u8).to_le_bytes()),
        Scalar::I16 => place.copy_from_slice(&(value.round() as i16).to_le_bytes()),
        Scalar::U16 => place.copy_from_slice(&(value.round() as u16).to_le_bytes()),
        Scalar::I32 => place.copy_from_slice(&(value.round() as i32).to_le_bytes()),
        Scalar::U32 => place.copy_from_slice(&(value.round() as u32).to_le_bytes()),
        Scalar::I64 => place.copy_from_slice(&(value.round() as i64).to_le_bytes()),
        Scalar::U64 => place.copy_from_slice(&(value.round() as u64).to_le_bytes()),
        Scalar::F32 => place.copy_from_slice(&(value as f32).to_le_bytes()),
        Scalar::F64 => place.copy_from_slice(&value.to_le_bytes()),
    }
}
