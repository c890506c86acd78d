//! Values of vertices as they lie in a progressive mesh: exactly, or floats as steps between their extremes.

use super::columns::{Planes, unzigzag, zigzag};
use serde::{Deserialize, Serialize};
use stonecut_mesh::property::{Scalar, read_scalar, write_scalar};
use stonecut_mesh::record::VertexSchema;
use stonecut_mesh::vec3::Vec3;

/// A component of a row: of a position, or a property.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Field {
    /// Type in the file.
    stored: Scalar,
    /// Value of 0 and length of a step, if the value is a number of steps; a step of 0: the value as it is.
    origin: f64,
    step: f64,
}

/// Layout of rows, and the records they stand for.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Rows {
    /// Records of the output.
    pub(super) schema: VertexSchema,
    fields: Vec<Field>,
}

/// Types of the components of a record.
fn scalars(schema: &VertexSchema) -> impl Iterator<Item = Scalar> {
    std::iter::repeat_n(schema.coordinate, 3).chain(schema.properties.iter().map(|p| p.scalar))
}

/// The components of packed values of some types, with their places.
fn places(scalars: impl Iterator<Item = Scalar>) -> impl Iterator<Item = (Scalar, usize)> {
    scalars.scan(0, |at, scalar| {
        *at += scalar.bytes();
        Some((scalar, *at - scalar.bytes()))
    })
}

/// Extremes of the floats of records.
pub(super) struct Extremes(Vec<(f64, f64)>);

impl Extremes {
    pub(super) fn new(schema: &VertexSchema) -> Extremes {
        Extremes(vec![(f64::INFINITY, f64::NEG_INFINITY); scalars(schema).count()])
    }

    pub(super) fn add(&mut self, schema: &VertexSchema, record: &[u8]) {
        for ((scalar, at), (low, high)) in places(scalars(schema)).zip(&mut self.0) {
            let x = read_scalar(scalar, record, at);
            if x.is_finite() {
                (*low, *high) = (low.min(x), high.max(x));
            }
        }
    }

    /// The same step for all coordinates, so that angles stay.
    fn of_position(&self) -> f64 {
        self.0.iter().take(3).fold(0.0, |most: f64, (low, high)| most.max(high - low))
    }
}

impl Rows {
    /// Rows that are the records.
    pub(super) fn exact(schema: &VertexSchema) -> Rows {
        let field = |stored| Field { stored, origin: 0.0, step: 0.0 };
        Rows { schema: schema.clone(), fields: scalars(schema).map(field).collect() }
    }

    /// Rows whose floats have 2^`bits` values; integers stay as they are.
    pub(super) fn of_steps(schema: &VertexSchema, extremes: &Extremes, bits: u32) -> Rows {
        let stored = if bits <= 16 { Scalar::U16 } else { Scalar::U32 };
        let most = f64::from(u32::MAX >> (32 - bits));
        let field = |(i, (scalar, &(low, high))): (usize, (Scalar, &(f64, f64)))| {
            let extent = if i < 3 { extremes.of_position() } else { high - low };
            match scalar.is_integer() {
                true => Field { stored: scalar, origin: 0.0, step: 0.0 },
                false if extent > 0.0 && extent.is_finite() => {
                    Field { stored, origin: low, step: extent / most }
                }
                false => {
                    Field { stored, origin: if low.is_finite() { low } else { 0.0 }, step: 1.0 }
                }
            }
        };
        let fields = scalars(schema).zip(&extremes.0).enumerate().map(field).collect();
        Rows { schema: schema.clone(), fields }
    }

    /// Bytes of a row.
    pub(super) fn stride(&self) -> usize {
        self.fields.iter().map(|field| field.stored.bytes()).sum()
    }

    /// Says what is wrong with a layout that was read; `is_stepped` if its places are counted in steps.
    pub(super) fn fault(&self, is_stepped: bool) -> Option<&'static str> {
        let is_position = matches!(self.schema.coordinate, Scalar::F32 | Scalar::F64);
        let fits = |(scalar, field): (Scalar, &Field)| match field.step {
            0.0 => field.stored == scalar,
            step => {
                step > 0.0
                    && step.is_finite()
                    && field.origin.is_finite()
                    && !scalar.is_integer()
                    && matches!(field.stored, Scalar::U16 | Scalar::U32)
            }
        };
        let n = scalars(&self.schema).count();
        let is_fit = n == self.fields.len() && scalars(&self.schema).zip(&self.fields).all(fits);
        let is_small = n <= 1024;
        // `place` takes the three components of a place as numbers of one width.
        let is_place = self.fields.iter().take(3).all(|field| {
            field.stored == self.fields[0].stored && (!is_stepped || field.step > 0.0)
        });
        let is_sound = is_position && is_fit && is_small && is_place;
        (!is_sound).then_some("describes values that cannot be")
    }

    fn fields(&self) -> impl Iterator<Item = (Scalar, usize)> {
        places(self.fields.iter().map(|field| field.stored))
    }

    /// Appends the row of a record.
    pub(super) fn put_row(&self, record: &[u8], out: &mut Vec<u8>) {
        let start = out.len();
        out.resize(start + self.stride(), 0);
        let row = &mut out[start..];
        let records = places(scalars(&self.schema));
        for (((stored, at), field), (scalar, from)) in self.fields().zip(&self.fields).zip(records)
        {
            if field.step == 0.0 {
                row[at..at + stored.bytes()].copy_from_slice(&record[from..from + scalar.bytes()]);
            } else {
                let x = read_scalar(scalar, record, from);
                // What is not a number becomes the least.
                write_scalar(stored, row, at, ((x - field.origin) / field.step).round());
            }
        }
    }

    /// Appends the record of a row.
    pub(super) fn put_record(&self, row: &[u8], out: &mut Vec<u8>) {
        let start = out.len();
        out.resize(start + self.schema.record_bytes(), 0);
        let record = &mut out[start..];
        let records = places(scalars(&self.schema));
        for (((stored, at), field), (scalar, to)) in self.fields().zip(&self.fields).zip(records) {
            if field.step == 0.0 {
                record[to..to + scalar.bytes()].copy_from_slice(&row[at..at + stored.bytes()]);
            } else {
                let x = read_scalar(stored, row, at) * field.step + field.origin;
                write_scalar(scalar, record, to, x);
            }
        }
    }

    /// Place in a row of steps, in steps.
    pub(super) fn place(&self, row: &[u8]) -> Vec3 {
        let width = self.fields.first().map_or(0, |field| field.stored.bytes());
        [0, 1, 2].map(|k| raw(row, k * width, width) as f64)
    }

    /// Sets the place in a row of steps to the nearest that it can hold.
    pub(super) fn set_place(&self, row: &mut [u8], place: Vec3) {
        for ((stored, at), x) in self.fields().zip(place) {
            write_scalar(stored, row, at, x.round());
        }
    }

    /// Position of a row, in input units.
    pub(super) fn position(&self, row: &[u8]) -> Vec3 {
        let mut position = [0.0; 3];
        for (((stored, at), field), x) in self.fields().zip(&self.fields).zip(&mut position) {
            let value = read_scalar(stored, row, at);
            *x = if field.step == 0.0 { value } else { value * field.step + field.origin };
        }
        position
    }

    /// Bytes of the place in a row.
    pub(super) fn place_bytes(&self) -> usize {
        self.fields.iter().take(3).map(|field| field.stored.bytes()).sum()
    }

    /// Appends the difference of a row from a guess.
    pub(super) fn push(&self, row: &[u8], guess: &[u8], planes: &mut Planes) {
        let mut bytes = vec![0; self.stride()];
        for (scalar, at) in self.fields() {
            let (x, from) = (ordered(scalar, row, at), ordered(scalar, guess, at));
            let bits = 8 * scalar.bytes() as u32;
            let difference = zigzag(x.wrapping_sub(from) & mask(bits), bits).to_le_bytes();
            bytes[at..at + scalar.bytes()].copy_from_slice(&difference[..scalar.bytes()]);
        }
        planes.push_bytes(&bytes);
    }

    /// Writes row `i` from a guess into `out`.
    pub(super) fn pull(&self, planes: &Planes, i: usize, guess: &[u8], out: &mut [u8]) {
        let mut bytes = [0; 8];
        for (scalar, at) in self.fields() {
            let width = scalar.bytes();
            bytes.fill(0);
            planes.get_bytes(i, at, &mut bytes[..width]);
            let bits = 8 * width as u32;
            let difference = unzigzag(u64::from_le_bytes(bytes), bits);
            let x = ordered(scalar, guess, at).wrapping_add(difference) & mask(bits);
            let x = disordered(scalar, x).to_le_bytes();
            out[at..at + width].copy_from_slice(&x[..width]);
        }
    }

    /// Guesses the vertex that vanished into one that was at `kept` before and at `merged` after: as far from there on the
    /// other side.
    pub(super) fn opposite(&self, merged: &[u8], kept: &[u8], out: &mut [u8]) {
        for (scalar, at) in self.fields() {
            let width = scalar.bytes();
            let raw = |row: &[u8]| raw(row, at, width);
            let x = match scalar {
                Scalar::F32 => {
                    let [m, k] = [merged, kept].map(|row| f32::from_bits(raw(row) as u32));
                    let x = m + (m - k);
                    u64::from((if x.is_finite() { x } else { m }).to_bits())
                }
                Scalar::F64 => {
                    let [m, k] = [merged, kept].map(|row| f64::from_bits(raw(row)));
                    let x = m + (m - k);
                    (if x.is_finite() { x } else { m }).to_bits()
                }
                _ => raw(merged).wrapping_mul(2).wrapping_sub(raw(kept)),
            };
            out[at..at + width].copy_from_slice(&x.to_le_bytes()[..width]);
        }
    }
}

fn mask(bits: u32) -> u64 {
    u64::MAX >> (64 - bits)
}

fn raw(row: &[u8], at: usize, width: usize) -> u64 {
    let mut bytes = [0; 8];
    bytes[..width].copy_from_slice(&row[at..at + width]);
    u64::from_le_bytes(bytes)
}

/// The bits of a scalar as a number of the same width that grows with it.
fn ordered(scalar: Scalar, row: &[u8], at: usize) -> u64 {
    let (width, bits) = (scalar.bytes(), 8 * scalar.bytes() as u32);
    let x = raw(row, at, width);
    let sign = 1 << (bits - 1);
    match scalar {
        Scalar::F32 | Scalar::F64 if x & sign != 0 => !x & mask(bits),
        Scalar::F32 | Scalar::F64 => x | sign,
        _ => x,
    }
}

/// The inverse of `ordered`.
fn disordered(scalar: Scalar, x: u64) -> u64 {
    let bits = 8 * scalar.bytes() as u32;
    let sign = 1 << (bits - 1);
    match scalar {
        Scalar::F32 | Scalar::F64 if x & sign == 0 => !x & mask(bits),
        Scalar::F32 | Scalar::F64 => x & !sign,
        _ => x,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use stonecut_mesh::property::Property;

    fn schema() -> VertexSchema {
        let list = [Scalar::U8, Scalar::I16, Scalar::F64, Scalar::U64, Scalar::F32];
        let properties = list.iter().map(|&scalar| Property::new("p", scalar)).collect();
        VertexSchema { coordinate: Scalar::F32, properties }
    }

    #[test]
    fn every_bit_of_a_row_comes_back_from_any_guess() {
        let rows = Rows::exact(&schema());
        let n = rows.stride();
        let row_of = |seed: u8| -> Vec<u8> {
            (0..n)
                .map(|i| (i as u8).wrapping_mul(37).wrapping_add(seed).wrapping_mul(seed))
                .collect()
        };
        let nan = vec![0xFF; n];
        for (a, b, c) in [(1, 2, 3), (200, 100, 50), (5, 5, 5)] {
            let (row, merged, kept) = (row_of(a), row_of(b), row_of(c));
            for merged in [merged, nan.clone()] {
                let mut guess = vec![0; n];
                rows.opposite(&merged, &kept, &mut guess);
                let mut planes = Planes::new(n);
                rows.push(&row, &guess, &mut planes);
                let mut found = vec![0; n];
                rows.pull(&planes, 0, &guess, &mut found);
                assert_eq!(found, row);
            }
        }
    }

    #[test]
    fn floats_become_steps_and_come_back_within_half_a_step() {
        let schema = schema();
        let mut extremes = Extremes::new(&schema);
        let record = |x: f32, w: f64| {
            let mut out = vec![0; schema.record_bytes()];
            write_scalar(Scalar::F32, &mut out, 0, f64::from(x));
            write_scalar(Scalar::F64, &mut out, 15, w);
            out[12] = 77;
            out
        };
        let all = [record(-3.0, 5.0), record(7.0, 9.0), record(0.123, 6.789)];
        all.iter().for_each(|record| extremes.add(&schema, record));
        let rows = Rows::of_steps(&schema, &extremes, 16);
        assert_eq!(rows.fault(true), None);
        for record in &all {
            let (mut row, mut found) = (Vec::new(), Vec::new());
            rows.put_row(record, &mut row);
            rows.put_record(&row, &mut found);
            for (scalar, at, extent) in [(Scalar::F32, 0, 10.0), (Scalar::F64, 15, 4.0)] {
                let [a, b] = [record, &found].map(|r| read_scalar(scalar, r, at));
                assert!((a - b).abs() <= 0.51 * extent / 65535.0, "{a} {b}");
            }
            assert_eq!(found[12], 77);
        }
    }

    /// A damaged head may give the components of a place different widths, or none of them a step.
    #[test]
    fn places_of_mixed_widths_and_without_steps_are_faults() {
        let schema = schema();
        let mut extremes = Extremes::new(&schema);
        let mut record = vec![0; schema.record_bytes()];
        extremes.add(&schema, &record);
        write_scalar(Scalar::F32, &mut record, 0, 3.0);
        extremes.add(&schema, &record);
        let rows = Rows::of_steps(&schema, &extremes, 20);
        assert_eq!(rows.fault(true), None);
        for narrow in 0..3 {
            let mut mixed = rows.clone();
            mixed.fields[narrow].stored = Scalar::U16;
            assert!(mixed.fault(true).is_some() && mixed.fault(false).is_some(), "{narrow}");
        }
        let exact = Rows::exact(&schema);
        assert!(exact.fault(true).is_some());
        assert_eq!(exact.fault(false), None);
    }
}
