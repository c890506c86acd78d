//! Results for C callers: a report as text and numbers, and of a simplified mesh its arrays.

use crate::errors::{End, text};
use crate::given::{Attribute, GivenMesh, Mesh};
use serde_json::Value;
use std::ffi::CString;
use stonecut::pipeline::in_memory::Output;
use stonecut::{Error, Result};

/// A result, `stonecut_result` of the header.
pub struct Outcome {
    report: Value,
    as_text: CString,
    arrays: Option<Box<Arrays>>,
}

/// The arrays of a mesh, and the structure that points to them.
struct Arrays {
    shown: Mesh,
    /// Never touched again: `shown` points into all of them.
    _positions: Positions,
    _triangles: Vec<[u32; 3]>,
    _labels: Vec<u32>,
    _source: Vec<u32>,
    _attributes: Vec<Attribute>,
    _names: Vec<CString>,
    /// In words of 8 bytes, so that every type is aligned.
    _values: Vec<Vec<u64>>,
}

enum Positions {
    Single(Vec<[f32; 3]>),
    Double(Vec<[f64; 3]>),
}

impl Outcome {
    /// A report alone.
    pub fn of_report(report: Value, is_short: bool) -> Result<(Outcome, End)> {
        let end = if is_short { End::Short(shortness(&report)) } else { End::Whole };
        let as_text = text(&report.to_string());
        Ok((Outcome { report, as_text, arrays: None }, end))
    }

    /// A simplified mesh with the attributes that `given` had.
    pub fn of_mesh(output: Output, given: &GivenMesh, is_short: bool) -> Result<(Outcome, End)> {
        let report = serde_json::to_value(&output.report)
            .map_err(|e| Error::Internal(format!("the report cannot be written as JSON: {e}")))?;
        let (outcome, end) = Outcome::of_report(report, is_short)?;
        Ok((Outcome { arrays: Some(Arrays::new(output, given)), ..outcome }, end))
    }

    /// The mesh, or null.
    pub fn mesh(&self) -> *const Mesh {
        self.arrays.as_ref().map_or(std::ptr::null(), |arrays| &raw const arrays.shown)
    }

    /// The report as JSON.
    pub fn report(&self) -> &CString {
        &self.as_text
    }

    /// A number of the report.
    pub fn number(&self, pointer: &str) -> Result<f64> {
        let found = self.report.pointer(pointer);
        let number = found.and_then(|v| v.as_f64().or(v.as_bool().map(f64::from)));
        number.ok_or_else(|| {
            let found = match found {
                None => "there is none",
                Some(Value::Null) => {
                    "it is null, which stands for infinity and for what is not known"
                }
                Some(_) => "it is not a number",
            };
            Error::Usage(format!("pointer \"{pointer}\": {found} in the report"))
        })
    }
}

impl Arrays {
    fn new(output: Output, given: &GivenMesh) -> Box<Arrays> {
        let Output { positions, triangles, source, records, labels, .. } = output;
        let n_vertices = positions.len();
        let n_triangles = triangles.len();
        let positions = if given.is_single {
            Positions::Single(positions.iter().map(|p| p.map(|x| x as f32)).collect())
        } else {
            Positions::Double(positions)
        };
        let record_bytes = records.len() / n_vertices.max(1);
        let (mut names, mut values, mut attributes) = (Vec::new(), Vec::new(), Vec::new());
        let mut at = 0;
        for attribute in &given.attributes {
            let row_bytes = attribute.columns.len() * attribute.scalar.bytes();
            let mut words = vec![0u64; (n_vertices * row_bytes).div_ceil(8)];
            let rows = bytemuck::cast_slice_mut::<u64, u8>(&mut words).chunks_exact_mut(row_bytes);
            for (row, record) in rows.zip(records.chunks_exact(record_bytes)) {
                row.copy_from_slice(&record[at..at + row_bytes]);
            }
            at += row_bytes;
            let name = attribute.name.to_owned();
            attributes.push(Attribute {
                name: name.as_ptr(),
                values: words.as_ptr().cast(),
                stride: row_bytes,
                scalar: attribute.code,
                width: attribute.columns.len() as u32,
            });
            names.push(name);
            values.push(words);
        }
        let (first, position_stride) = match &positions {
            Positions::Single(rows) => (rows.as_ptr().cast(), 12),
            Positions::Double(rows) => (rows.as_ptr().cast(), 24),
        };
        let shown = Mesh {
            size: size_of::<Mesh>(),
            n_vertices,
            positions: first,
            position_stride,
            position_type: if given.is_single { 9 } else { 10 },
            reserved: 0,
            n_triangles,
            triangles: triangles.as_ptr().cast(),
            labels: if labels.is_empty() { std::ptr::null() } else { labels.as_ptr() },
            n_attributes: attributes.len(),
            attributes: attributes.as_ptr(),
            source: source.as_ptr(),
        };
        Box::new(Arrays {
            shown,
            _positions: positions,
            _triangles: triangles,
            _labels: labels,
            _source: source,
            _attributes: attributes,
            _names: names,
            _values: values,
        })
    }
}

/// Says in what a result falls short of what was asked for.
fn shortness(report: &Value) -> String {
    let left = &report["output"]["triangles"];
    if report["target_met"] == false {
        return format!(
            "{left} triangles are left; short of the target of {}: {}",
            report["target"],
            report["stop_reason"].as_str().unwrap_or_default()
        );
    }
    if report["quality"]["bearable"] == false {
        return format!(
            "{left} triangles are left; too few for this mesh, whose surface comes apart; ask for at least {}",
            report["quality"]["sensible_triangles"]
        );
    }
    "done, but a part of the input was left out or lost; the report names it (faults, losses)"
        .to_owned()
}
