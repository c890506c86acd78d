//! Properties of faces, and their form while the mesh is simplified.
//!
//! The kernel works with values at vertices and seams between them; it has no values of faces. So a scalar property
//! of faces becomes one of vertices, and comes back at the end. Names (labels, flags, the number of an image) become
//! regions, whose borders are attribute seams. Measurements (quality, a colour that differs from face to face) become
//! averages. A value that is the same everywhere is only noted. Decides that, and turns values of faces into those of
//! vertices and back. Does not read files (`io::survey_faces`, `io::faces_to_vertices`) and does not write them
//! (`write`).

use crate::codec::VertexCodec;
use crate::property::{Origin, Property, Scalar};
use crate::record::VertexSchema;
use serde::{Deserialize, Serialize};

/// A colour, and a label, that would make more than this many vertices of one are not a region:
/// docs/design/attributes.md.
pub const MAX_COLOUR_VERTICES: f64 = 1.5;
/// The same for a label.
pub const MAX_LABEL_VERTICES: f64 = 2.5;

/// Below this many faces everything that may be a region is one: a cube has a colour a side.
pub const FEW_FACES: u64 = 1000;

/// Fate of a property of faces.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum FacePolicy {
    /// The same on every face: written back.
    Constant,
    /// Constant on regions: their borders are kept as seams, and every face has the value of its region.
    Region,
    /// A label that differs nearly everywhere: a face has that of one of the faces near by.
    Chosen,
    /// Averaged at the vertices, and from there back to faces.
    Averaged,
    /// Left out.
    Dropped,
}

/// A property of faces.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FaceProperty {
    /// Name and type in the input.
    pub property: Property,
    /// Fate of the property.
    pub how: FacePolicy,
    /// Its bytes, if it is constant.
    pub constant: Vec<u8>,
    /// Reason why it is dropped, if it is.
    pub reason: &'static str,
}

impl FaceProperty {
    /// Returns whether it goes to the vertices.
    fn is_moved(&self) -> bool {
        matches!(self.how, FacePolicy::Region | FacePolicy::Chosen | FacePolicy::Averaged)
    }

    /// The property of vertices that it becomes.
    fn at_vertices(&self) -> Property {
        let is_mean = self.how == FacePolicy::Averaged;
        let origin = if is_mean { Origin::FaceMean } else { Origin::FaceLabel };
        Property { origin, ..self.property.clone() }
    }
}

/// Properties of faces besides their corners, with the fate of each.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct FacePropertyPlan {
    /// Texture coordinates at the corners.
    pub texture: bool,
    /// Scalar properties in the order of the input.
    pub properties: Vec<FaceProperty>,
    /// Names of lists, which are not carried.
    pub lists: Vec<String>,
    /// True if walls between the same two regions are wound both ways: they are turned to agree.
    pub turns_walls: bool,
}

impl FacePropertyPlan {
    /// Returns whether anything goes to the vertices.
    pub fn is_moved(&self) -> bool {
        self.texture || self.properties.iter().any(FaceProperty::is_moved)
    }

    /// Leaves a property out.
    pub fn drop_property(&mut self, name: &str, reason: &'static str) {
        for property in self.properties.iter_mut().filter(|p| p.property.name == name) {
            (property.how, property.reason) = (FacePolicy::Dropped, reason);
        }
    }

    /// Returns whether there are regions.
    pub fn has_regions(&self) -> bool {
        self.properties.iter().any(|p| p.how == FacePolicy::Region)
    }

    /// Returns the properties of the faces of the output.
    pub fn written(&self) -> impl Iterator<Item = &FaceProperty> {
        self.properties.iter().filter(|p| p.how != FacePolicy::Dropped)
    }

    /// The properties that vertices get, in the order in which they follow their own: values of faces,
    /// texture coordinates, the number of the region.
    pub fn vertex_properties(&self) -> Vec<Property> {
        let mut list: Vec<Property> = self.moved().map(FaceProperty::at_vertices).collect();
        let texture = ["texture_u", "texture_v"].into_iter().filter(|_| self.texture);
        list.extend(texture.map(|name| Property::new(name, Scalar::F32)));
        if self.has_regions() {
            let (name, origin) = ("region".to_owned(), Origin::Region);
            list.push(Property {
                name,
                scalar: Scalar::I32,
                origin,
                white: None,
                is_patchy: false,
                middle: 0,
            });
        }
        list
    }

    fn moved(&self) -> impl Iterator<Item = &FaceProperty> {
        self.properties.iter().filter(|p| p.is_moved())
    }

    /// Packs the values that go to vertices, of a face's `values` in the order of the input.
    pub fn pack(&self, values: &[u8], out: &mut Vec<u8>) {
        let mut at = 0;
        for property in &self.properties {
            let end = at + property.property.scalar.bytes();
            if property.is_moved() {
                out.extend_from_slice(&values[at..end]);
            }
            at = end;
        }
    }

    /// The same of those that make regions.
    pub fn pack_region(&self, values: &[u8], out: &mut Vec<u8>) {
        let mut at = 0;
        for property in &self.properties {
            let end = at + property.property.scalar.bytes();
            if property.how == FacePolicy::Region {
                out.extend_from_slice(&values[at..end]);
            }
            at = end;
        }
    }

    /// The properties of a face of the output from the packed values that went to vertices.
    pub fn unpack(&self, moved: &[u8], out: &mut Vec<u8>) {
        let mut at = 0;
        for property in self.written() {
            if property.is_moved() {
                let end = at + property.property.scalar.bytes();
                out.extend_from_slice(&moved[at..end]);
                at = end;
            } else {
                out.extend_from_slice(&property.constant);
            }
        }
    }
}

/// Makes one value of several: colours and measures are averaged, labels chosen.
pub struct FaceMixer {
    codec: VertexCodec,
    position_bytes: usize,
    value_bytes: usize,
    /// Bytes of labels.
    labels: Vec<std::ops::Range<usize>>,
    sums: Vec<(f64, u32)>,
    channels: Vec<f32>,
    record: Vec<u8>,
    encoded: Vec<u8>,
}

impl FaceMixer {
    /// For the values that `carry` moves to vertices.
    pub fn new(carry: &FacePropertyPlan) -> FaceMixer {
        let properties = carry.moved().map(FaceProperty::at_vertices).collect();
        let schema = VertexSchema { coordinate: Scalar::F32, properties };
        let (mut at, mut labels) = (0, Vec::new());
        for property in carry.moved() {
            let end = at + property.property.scalar.bytes();
            if property.how != FacePolicy::Averaged {
                labels.push(at..end);
            }
            at = end;
        }
        let codec = schema.kernel_codec(&[]);
        let n = codec.n_channels();
        FaceMixer {
            position_bytes: schema.position_bytes(),
            value_bytes: at,
            labels,
            sums: vec![(0.0, 0); n],
            channels: vec![0.0; n],
            record: Vec::new(),
            encoded: Vec::new(),
            codec,
        }
    }

    /// Bytes of the packed values.
    pub fn value_bytes(&self) -> usize {
        self.value_bytes
    }

    /// Begins with the first of several values; its labels are those of the mixture.
    pub fn begin(&mut self, values: &[u8]) {
        self.sums.fill((0.0, 0));
        self.record.clear();
        self.record.resize(self.position_bytes, 0);
        self.record.extend_from_slice(&values[..self.value_bytes]);
        self.add(values);
    }

    /// Adds one value; non-finite values are ignored.
    pub fn add(&mut self, values: &[u8]) {
        if self.sums.is_empty() {
            return;
        }
        self.encoded.clear();
        self.encoded.resize(self.position_bytes, 0);
        self.encoded.extend_from_slice(&values[..self.value_bytes]);
        self.codec.decode_channels(&self.encoded, &mut self.channels);
        for ((sum, n), &value) in self.sums.iter_mut().zip(&self.channels) {
            if value.is_finite() {
                *sum += f64::from(value);
                *n += 1;
            }
        }
    }

    /// Appends the mixture.
    pub fn end(&mut self, out: &mut Vec<u8>) {
        self.codec.decode_channels(&self.record, &mut self.channels);
        for (channel, &(sum, n)) in self.channels.iter_mut().zip(&self.sums) {
            if n > 0 {
                *channel = (sum / f64::from(n)) as f32;
            }
        }
        self.encoded.clear();
        self.codec.encode([0.0; 3], &self.channels, &self.record, &mut self.encoded);
        out.extend_from_slice(&self.encoded[self.position_bytes..]);
    }

    /// Appends the value of a triangle from those of its corners: the mean, and labels that two agree on, or
    /// else the first's.
    pub fn of_corners(&mut self, corners: [&[u8]; 3], out: &mut Vec<u8>) {
        self.begin(corners[0]);
        self.add(corners[1]);
        self.add(corners[2]);
        for label in &self.labels {
            let [second, third] = [corners[1], corners[2]].map(|values| &values[label.clone()]);
            if second == third {
                let at = self.position_bytes;
                self.record[at + label.start..at + label.end].copy_from_slice(second);
            }
        }
        self.end(out);
    }
}

/// Numbers of regions: dense as long as there are few.
#[derive(Default)]
pub struct Regions {
    known: std::collections::HashMap<Vec<u8>, i32>,
}

impl Regions {
    /// Number of regions that are counted in an array.
    const DENSE: usize = 65_536;
    /// Numbers are exact as floats.
    const END: u64 = 1 << 24;

    /// The number of the region with these values. Beyond 65,536 different values it is a hash: two regions
    /// that touch are taken for one with a probability of 6e-8, and then their border is not kept.
    pub fn number(&mut self, values: &[u8]) -> i32 {
        if let Some(&number) = self.known.get(values) {
            return number;
        }
        let n = self.known.len();
        if n < Self::DENSE {
            self.known.insert(values.to_vec(), n as i32);
            return n as i32;
        }
        let rest = Self::END - Self::DENSE as u64;
        (Self::DENSE as u64 + xxhash_rust::xxh3::xxh3_64(values) % rest) as i32
    }
}
