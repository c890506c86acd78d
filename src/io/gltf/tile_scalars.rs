//! Properties of vertices that tiles carry as attributes: their names, the types of their numbers, their parts.
//!
//! The name of an attribute that glTF does not know begins with an underscore, and its numbers have 1 or 2 bytes or are
//! floats (Khronos, section 3.7.2.1). A number of 4 or 8 bytes becomes the sum of up to three floats, an attribute each. Decides nothing
//! about the choice of properties.

use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use stonecut_mesh::property::{Property, Scalar};

/// Numbers of glTF 2.0 for types of components.
const I8: u32 = 5120;
const U8: u32 = 5121;
const I16: u32 = 5122;
const U16: u32 = 5123;
const F32: u32 = 5126;

/// Ends of the names of the attributes that hold one property: the nearest float, and twice the nearest to what is left.
const PARTS: [&str; 3] = ["", "_LOW", "_LOWEST"];

/// Integers below this are doubles.
const MOST_INTEGER: f64 = 9_007_199_254_740_992.0;

/// A property of vertices in tiles.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct TileScalar {
    /// Its name in the input.
    pub name: String,
    /// Its type in the input.
    #[serde(rename = "type")]
    pub scalar: Scalar,
    /// The name of the attribute, or of the first of them.
    pub attribute: String,
}

/// Numbers of an attribute as they are stored.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Part {
    pub(super) attribute: String,
    pub(super) component: u32,
    pub(super) values: Vec<f64>,
}

impl TileScalar {
    /// Names the attributes of properties: upper case, with `_` for what is not a letter or a digit. What would get a
    /// name for the second time gets a number.
    pub fn list<'a>(properties: impl IntoIterator<Item = &'a Property>) -> Vec<TileScalar> {
        let mut used = BTreeSet::new();
        let mut out = Vec::new();
        for property in properties {
            let letter =
                |c: char| if c.is_ascii_alphanumeric() { c.to_ascii_uppercase() } else { '_' };
            let plain = format!("_{}", property.name.chars().map(letter).collect::<String>());
            let mut attribute = plain.clone();
            let mut n = 1;
            while PARTS.iter().any(|part| used.contains(&format!("{attribute}{part}"))) {
                n += 1;
                attribute = format!("{plain}_{n}");
            }
            used.extend(PARTS.map(|part| format!("{attribute}{part}")));
            out.push(TileScalar {
                name: property.name.clone(),
                scalar: property.scalar,
                attribute,
            });
        }
        out
    }

    /// Reads the list of a tree; none if it has none. The error says what is wrong with it.
    pub fn read_list(value: &Value) -> Result<Vec<TileScalar>, String> {
        if value.is_null() {
            return Ok(Vec::new());
        }
        let list: Vec<TileScalar> = serde_json::from_value(value.clone())
            .map_err(|e| format!("its list of properties of vertices: {e}"))?;
        let mut names = BTreeSet::new();
        for scalar in &list {
            let name = scalar.name.as_str();
            let is_word = !name.is_empty() && !name.contains(|c: char| c.is_whitespace());
            if !is_word || ["x", "y", "z"].contains(&name) || !names.insert(name) {
                return Err(format!("'{name}' cannot be the name of a property of vertices"));
            }
        }
        Ok(list)
    }

    /// True if tiles hold a number exactly.
    pub fn holds(&self, value: f64) -> bool {
        match self.scalar {
            Scalar::I64 | Scalar::U64 => value.abs() < MOST_INTEGER,
            Scalar::F64 => {
                let near = |x: f64| f64::from(x as f32);
                let first = near(value);
                let second = near(value - first);
                first + second + near(value - first - second) == value
            }
            _ => value.is_finite(),
        }
    }

    /// The number that tiles hold instead of one that they cannot: 0 for what is not a number, the largest float beyond it.
    pub fn held(value: f64) -> f64 {
        let most = f64::from(f32::MAX);
        if value.is_nan() { 0.0 } else { value.clamp(-most, most) }
    }

    /// The type of the numbers of its attributes.
    pub(super) fn component(&self) -> u32 {
        match self.scalar {
            Scalar::I8 => I8,
            Scalar::U8 => U8,
            Scalar::I16 => I16,
            Scalar::U16 => U16,
            _ => F32,
        }
    }

    /// Takes numbers apart into those of attributes; parts that are zero everywhere are left out.
    pub(super) fn parts(&self, values: &[f64]) -> Vec<Part> {
        let component = self.component();
        let mut rest = values.to_vec();
        let mut out = Vec::new();
        for end in PARTS {
            let attribute = format!("{}{end}", self.attribute);
            if component != F32 {
                return vec![Part { attribute, component, values: rest }];
            }
            let values: Vec<f64> = rest.iter().map(|&x| f64::from(x as f32)).collect();
            if out.is_empty() || values.iter().any(|x| *x != 0.0) {
                rest.iter_mut().zip(&values).for_each(|(rest, x)| *rest -= x);
                out.push(Part { attribute, component, values });
            }
        }
        out
    }

    /// Puts the numbers of attributes together again; they are taken out of `attributes`.
    fn joined(
        &self,
        attributes: &mut BTreeMap<String, (u32, Vec<f64>)>,
    ) -> Result<Vec<f64>, String> {
        let mut out: Option<Vec<f64>> = None;
        for end in PARTS {
            let name = format!("{}{end}", self.attribute);
            let Some((component, values)) = attributes.remove(&name) else { continue };
            if component != self.component() || (!end.is_empty() && component != F32) {
                return Err(format!("its attribute {name} has components of type {component}"));
            }
            if values.iter().any(|x| !x.is_finite()) {
                return Err(format!("its attribute {name} has a number that is not finite"));
            }
            match &mut out {
                None if end.is_empty() => out = Some(values),
                None => break,
                Some(sum) => sum.iter_mut().zip(&values).for_each(|(sum, x)| *sum += x),
            }
        }
        out.ok_or_else(|| format!("it lacks the attribute {}", self.attribute))
    }
}

/// The numbers of each property out of all attributes of a tile; the error says what is wrong.
pub(super) fn join_all(
    scalars: &[TileScalar],
    mut attributes: BTreeMap<String, (u32, Vec<f64>)>,
) -> Result<Vec<Vec<f64>>, String> {
    let columns: Result<_, _> = scalars.iter().map(|s| s.joined(&mut attributes)).collect();
    match attributes.keys().next() {
        Some(name) if columns.is_ok() => {
            Err(format!("it has an attribute {name} that its tree does not name"))
        }
        _ => columns,
    }
}

/// A number as an element of 4 bytes.
pub(super) fn element(component: u32, value: f64) -> [u8; 4] {
    match component {
        I8 => [(value as i8) as u8, 0, 0, 0],
        U8 => [value as u8, 0, 0, 0],
        I16 => {
            let [a, b] = (value as i16).to_le_bytes();
            [a, b, 0, 0]
        }
        U16 => {
            let [a, b] = (value as u16).to_le_bytes();
            [a, b, 0, 0]
        }
        _ => (value as f32).to_le_bytes(),
    }
}

/// The number in the bytes of an element.
pub(super) fn number(component: u32, bytes: &[u8]) -> Result<f64, String> {
    Ok(match (component, bytes) {
        (I8, &[a]) => f64::from(a as i8),
        (U8, &[a]) => f64::from(a),
        (I16, &[a, b]) => f64::from(i16::from_le_bytes([a, b])),
        (U16, &[a, b]) => f64::from(u16::from_le_bytes([a, b])),
        (F32, &[a, b, c, d]) => f64::from(f32::from_le_bytes([a, b, c, d])),
        _ => return Err(format!("an attribute with components of type {component}")),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scalar(name: &str, scalar: Scalar) -> TileScalar {
        TileScalar::list(&[Property::new(name, scalar)]).remove(0)
    }

    #[test]
    fn names_are_those_that_gltf_allows_and_differ() {
        let names = ["quality", "Quality", "gps-time", "gps_time", "a_low", "a", "é", "_x"];
        let properties = names.map(|name| Property::new(name, Scalar::F64));
        let attributes: Vec<String> =
            TileScalar::list(&properties).into_iter().map(|s| s.attribute).collect();
        let expected =
            ["_QUALITY", "_QUALITY_2", "_GPS_TIME", "_GPS_TIME_2", "_A_LOW", "_A_2", "__", "__X"];
        assert_eq!(attributes, expected);
    }

    #[test]
    fn numbers_of_every_type_come_back() {
        for (kind, values, n_parts) in [
            (Scalar::I8, &[-128.0, 127.0][..], 1),
            (Scalar::U8, &[0.0, 255.0], 1),
            (Scalar::I16, &[-32_768.0, 32_767.0], 1),
            (Scalar::U16, &[0.0, 65_535.0], 1),
            (Scalar::F32, &[0.0, f64::from(0.1f32), f64::from(f32::MAX)], 1),
            (Scalar::I32, &[3.0, -7.0], 1),
            (Scalar::I32, &[f64::from(i32::MAX), f64::from(i32::MIN)], 2),
            (Scalar::U32, &[f64::from(u32::MAX), 16_777_217.0], 2),
            (Scalar::I64, &[4_503_599_694_479_361.0, -1.0], 3),
            (Scalar::F64, &[0.1, 1_234_567_890.123_456_7, -0.3], 3),
        ] {
            let scalar = scalar("a", kind);
            assert!(values.iter().all(|x| scalar.holds(*x)));
            let parts = scalar.parts(values);
            assert_eq!(parts.len(), n_parts, "{kind:?}");
            let mut attributes = BTreeMap::new();
            for part in parts {
                let size = kind.bytes().min(4);
                let back =
                    |x: &f64| number(part.component, &element(part.component, *x)[..size]).unwrap();
                let values = part.values.iter().map(back).collect();
                attributes.insert(part.attribute, (part.component, values));
            }
            assert_eq!(join_all(&[scalar], attributes).unwrap(), [values], "{kind:?}");
        }
        let float = scalar("a", Scalar::F32);
        assert!(!float.holds(f64::NAN) && !float.holds(f64::INFINITY));
        assert_eq!(TileScalar::held(f64::NAN), 0.0);
        assert_eq!(TileScalar::held(f64::NEG_INFINITY), -f64::from(f32::MAX));
        assert!(!scalar("a", Scalar::U64).holds(1e17));
        let double = scalar("a", Scalar::F64);
        let not_held = [f64::NAN, f64::INFINITY, 1e300, 1e-300];
        assert!(not_held.iter().all(|x| !double.holds(*x)));
    }

    #[test]
    fn lists_that_are_not_names_are_refused() {
        let read = |name: &str| {
            TileScalar::read_list(
                &serde_json::json!([{ "name": name, "type": "F32", "attribute": "_A" }]),
            )
        };
        assert_eq!(read("a").unwrap(), [scalar("a", Scalar::F32)]);
        assert_eq!(TileScalar::read_list(&Value::Null).unwrap(), []);
        for name in ["", "a b", "a\nend_header", "x"] {
            assert!(read(name).is_err(), "{name:?}");
        }
        assert!(TileScalar::read_list(&serde_json::json!([3])).is_err());
    }
}
