//! From the bytes of vertex rows to packed little-endian records, whole blocks at a time.
//!
//! A `FieldPlan` says where each coordinate and carried property lies in a row of fixed size and where it
//! goes in the record. Rows that already are records are copied whole; all others go column by column.

use super::header::{Element, Encoding, Kind, Wire};
use stonecut_mesh::property::{Property, Scalar, write_scalar};
use stonecut_mesh::record::VertexSchema;
use stonecut_system::error::Error;

/// One number of a row and its place in the record.
#[derive(Clone, Copy, Debug)]
pub struct Field {
    pub wire: Wire,
    /// Byte offset in a binary row of fixed size.
    pub source: usize,
    /// Byte offset in the record.
    pub target: usize,
    /// The type in the record.
    pub scalar: Scalar,
}

/// One step from a property of the vertex element to the record, in header order.
#[derive(Clone, Copy, Debug)]
pub enum FieldStep {
    /// The number goes to this field.
    Take(Field),
    /// A list is left out: records have a fixed size.
    SkipList { count: Wire, item: Wire },
}

/// Plan of turning rows of the vertex element into records.
#[derive(Debug)]
pub struct FieldPlan {
    pub schema: VertexSchema,
    pub steps: Vec<FieldStep>,
    /// Names of list properties that are not carried.
    pub dropped_lists: Vec<String>,
    /// True if a row and its record are the same bytes.
    identity: bool,
    swap: bool,
}

impl FieldPlan {
    /// Plans the vertex element; fails if it has no x, y and z.
    pub fn new(element: &Element, encoding: Encoding) -> Result<Self, String> {
        let axis = |name: &str| ["x", "y", "z"].iter().position(|a| *a == name);
        let mut coordinates = [None; 3];
        for property in &element.properties {
            let (Some(axis), Kind::Scalar(wire)) = (axis(&property.name), property.kind) else {
                continue;
            };
            if coordinates[axis].replace(wire).is_some() {
                return Err(format!("property '{}' appears twice", property.name));
            }
        }
        let [Some(x), Some(y), Some(z)] = coordinates else {
            return Err("it has no properties x, y and z; stonecut needs positions".to_owned());
        };
        let coordinate =
            if [x, y, z].into_iter().all(fits_float) { Scalar::F32 } else { Scalar::F64 };
        let mut schema = VertexSchema { coordinate, properties: Vec::new() };
        let (mut steps, mut dropped_lists) = (Vec::new(), Vec::new());
        let (mut source, mut target) = (0, 3 * coordinate.bytes());
        for property in &element.properties {
            let wire = match property.kind {
                Kind::List { count, item } => {
                    dropped_lists.push(property.name.clone());
                    steps.push(FieldStep::SkipList { count, item });
                    continue;
                }
                Kind::Scalar(wire) => wire,
            };
            if let Some(axis) = axis(&property.name) {
                let target = axis * coordinate.bytes();
                steps.push(FieldStep::Take(Field { wire, source, target, scalar: coordinate }));
            } else {
                let scalar = wire.scalar();
                steps.push(FieldStep::Take(Field { wire, source, target, scalar }));
                schema.properties.push(Property::new(&property.name, scalar));
                target += scalar.bytes();
            }
            source += wire.bytes() as usize;
        }
        let swap = encoding == Encoding::BinaryBigEndian;
        let same = |step: &FieldStep| {
            matches!(step, FieldStep::Take(f)
            if f.source == f.target && f.wire == Wire::Plain(f.scalar))
        };
        let identity = encoding == Encoding::BinaryLittleEndian && steps.iter().all(same);
        Ok(FieldPlan { schema, steps, dropped_lists, identity, swap })
    }

    /// Returns whether rows can be read straight into records.
    pub fn is_identity(&self) -> bool {
        self.identity
    }

    /// Turns rows of `row_bytes` bytes into records; `records` has room for exactly as many.
    pub fn convert(&self, rows: &[u8], row_bytes: usize, records: &mut [u8]) {
        let record_bytes = self.schema.record_bytes();
        for step in &self.steps {
            let FieldStep::Take(field) = *step else { continue };
            let rows = rows.chunks_exact(row_bytes);
            let records = records.chunks_exact_mut(record_bytes);
            let column = FieldColumn { field, swap: self.swap };
            match (field.wire == Wire::Plain(field.scalar), field.scalar.bytes()) {
                (true, 1) => column.copy::<1>(rows, records),
                (true, 2) => column.copy::<2>(rows, records),
                (true, 4) => column.copy::<4>(rows, records),
                (true, _) => column.copy::<8>(rows, records),
                (false, _) => column.change_type(rows, records),
            }
        }
    }
}

/// One field over all rows of a block.
struct FieldColumn {
    field: Field,
    swap: bool,
}

impl FieldColumn {
    fn copy<'a, const N: usize>(
        &self,
        rows: impl Iterator<Item = &'a [u8]>,
        records: impl Iterator<Item = &'a mut [u8]>,
    ) {
        let (from, to) = (self.field.source, self.field.target);
        for (row, record) in rows.zip(records) {
            let mut bytes: [u8; N] = row[from..from + N].try_into().expect("N bytes");
            if self.swap {
                bytes.reverse();
            }
            record[to..to + N].copy_from_slice(&bytes);
        }
    }

    fn change_type<'a>(
        &self,
        rows: impl Iterator<Item = &'a [u8]>,
        records: impl Iterator<Item = &'a mut [u8]>,
    ) {
        for (row, record) in rows.zip(records) {
            let value = wire_value(self.field.wire, &row[self.field.source..], self.swap);
            write_scalar(self.field.scalar, record, self.field.target, value);
        }
    }
}

/// Returns whether every value of the type is a float exactly.
fn fits_float(wire: Wire) -> bool {
    use Scalar::{F32, I8, I16, U8, U16};
    matches!(wire, Wire::F16 | Wire::Plain(F32 | I8 | U8 | I16 | U16))
}

/// The number at the beginning of `bytes`, as a double.
pub fn wire_value(wire: Wire, bytes: &[u8], swap: bool) -> f64 {
    let n = wire.bytes() as usize;
    let mut little = [0u8; 8];
    little[..n].copy_from_slice(&bytes[..n]);
    if swap {
        little[..n].reverse();
    }
    match wire {
        Wire::Plain(scalar) => stonecut_mesh::property::read_scalar(scalar, &little, 0),
        Wire::F16 => half_to_double(u16::from_le_bytes([little[0], little[1]])),
    }
}

/// IEEE 754 half precision, exactly.
fn half_to_double(bits: u16) -> f64 {
    let sign = if bits & 0x8000 == 0 { 1.0 } else { -1.0 };
    let exponent = i32::from((bits >> 10) & 0x1f);
    let fraction = f64::from(bits & 0x3ff);
    let magnitude = match exponent {
        0 => fraction * 2f64.powi(-24),
        31 if fraction == 0.0 => f64::INFINITY,
        31 => f64::NAN,
        _ => (1024.0 + fraction) * 2f64.powi(exponent - 25),
    };
    sign * magnitude
}

/// Floats from here on are not places: programs for terrain write -3.4e38 where nothing was measured.
const BEYOND: f32 = 1e30;

/// Doubles of any size are places, but for these marks.
const MARKS: [f64; 2] = [f32::MAX as f64, f64::MAX];

/// True for a coordinate of that type that is finite, and not a mark for missing data.
pub fn is_place(coordinate: Scalar, x: f64) -> bool {
    match coordinate {
        Scalar::F64 => x.is_finite() && !MARKS.contains(&x.abs()),
        _ => x.abs() < f64::from(BEYOND),
    }
}

/// The first record in `records` whose position is not finite, or absurdly far.
pub fn first_not_finite(schema: &VertexSchema, records: &[u8]) -> Option<usize> {
    let record_bytes = schema.record_bytes();
    match schema.coordinate {
        Scalar::F64 => records.chunks_exact(record_bytes).position(|r| !is_finite_f64(r)),
        _ if record_bytes == 12 => first_bad_float(records).map(|i| i / 3),
        _ => records.chunks_exact(record_bytes).position(|r| first_bad_float(&r[..12]).is_some()),
    }
}

fn first_bad_float(bytes: &[u8]) -> Option<usize> {
    const SIGN: u32 = 1 << 31;
    // Bits of floats without their sign are in the order of their values; infinity and NaN are last.
    let bad =
        |b: &[u8]| u32::from_le_bytes(b.try_into().expect("4 bytes")) & !SIGN >= BEYOND.to_bits();
    // Whole strides first, without an early exit, so that the compiler can use vectors.
    for (i, stride) in bytes.chunks(4096).enumerate() {
        if stride.chunks_exact(4).fold(false, |any, b| any | bad(b)) {
            let within = stride.chunks_exact(4).position(bad)?;
            return Some(i * 1024 + within);
        }
    }
    None
}

fn is_finite_f64(record: &[u8]) -> bool {
    record[..24]
        .chunks_exact(8)
        .all(|b| is_place(Scalar::F64, f64::from_le_bytes(b.try_into().expect("8 bytes"))))
}

/// The message for a coordinate that is not a number.
pub fn not_finite(
    path: &std::path::Path,
    row: u64,
    place: impl std::fmt::Display,
    position: [f64; 3],
) -> Error {
    let [x, y, z] = position.map(|x| if x.abs() < 1e30 { x.to_string() } else { format!("{x:e}") });
    let what = match position.iter().all(|x| x.is_finite()) {
        true => "is not a place (beyond 1e30, a mark for missing data?)",
        false => "is not finite",
    };
    Error::bad_input(
        path,
        format!(
            "element vertex, row {row}, {place}: the position ({x}, {y}, {z}) {what}; \
             repair the file, or drop such vertices and their faces with --skip-bad"
        ),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_floats_are_exact() {
        let cases = [(0x3c00, 1.0), (0xc000, -2.0), (0x0001, 2f64.powi(-24)), (0x7bff, 65504.0)];
        for (bits, value) in cases {
            assert_eq!(half_to_double(bits), value);
        }
        assert!(half_to_double(0x7e00).is_nan());
        assert_eq!(half_to_double(0xfc00), f64::NEG_INFINITY);
    }
}
