//! Attributes of vertices as arrays: from borrowed arrays to the kernel's channels and back to records.
//!
//! A column is one number a vertex, with a name and a type as in a PLY header; names and types decide what it means
//! (docs/design/attributes.md): colours are averaged as they are seen, normals keep length 1, texture coordinates
//! keep their seams, other integers are labels and never averaged.

use super::regions::FaceRegions;
use crate::error::{Error, Result};
use crate::mesh::Mesh;
use crate::mesh::codec::{ChannelKind, TEXTURE_NAMES, VertexCodec};
use crate::mesh::patches::{PatchCount, WholeValues};
use crate::mesh::property::{MIDDLE_SAMPLE, Origin, Property, Scalar, middle_of, read_scalar};
use crate::mesh::record::VertexSchema;
use crate::system::parallel::in_blocks;
use crate::system::progress::Progress;
use std::ops::Range;

/// Vertices worked on at a time by one thread.
const BLOCK: usize = 1 << 14;

/// One number a vertex, borrowed.
#[derive(Clone, Debug)]
pub struct Column<'a> {
    /// Its name and type.
    pub property: Property,
    /// Little-endian values, `stride` bytes from one vertex to the next.
    pub bytes: &'a [u8],
    /// Byte of the first vertex's value.
    pub offset: usize,
    /// Bytes from one vertex to the next.
    pub stride: usize,
}

/// All columns of a mesh.
#[derive(Debug, Default)]
pub struct Attributes<'a> {
    columns: Vec<Column<'a>>,
    plan: Option<(VertexSchema, VertexCodec)>,
    labels: Vec<String>,
    channel_kinds: Vec<ChannelKind>,
    regions: Option<FaceRegions>,
}

impl<'a> Attributes<'a> {
    /// Checks that every column has a value for each vertex; `labels` are never averaged.
    ///
    /// Errors: `Usage` for a column that is too short, a name that comes twice, and a label that is not there.
    pub fn new(columns: Vec<Column<'a>>, n_vertices: usize, labels: &[String]) -> Result<Self> {
        for (i, column) in columns.iter().enumerate() {
            let name = &column.property.name;
            let last = n_vertices.checked_sub(1).map_or(Some(0), |last| {
                let end = column.offset + column.property.scalar.bytes();
                last.checked_mul(column.stride)?.checked_add(end)
            });
            if last.is_none_or(|end| end > column.bytes.len()) {
                let what =
                    format!("attribute {name} has no value for each of {n_vertices} vertices");
                return Err(Error::Usage(what));
            }
            if columns[..i].iter().any(|other| other.property.name == *name) {
                return Err(Error::Usage(format!("attribute {name} is given twice")));
            }
        }
        let names = || columns.iter().map(|column| column.property.name.as_str());
        if let Some(unknown) = labels.iter().find(|label| !names().any(|name| name == *label)) {
            let known: Vec<&str> = names().collect();
            let known = if known.is_empty() { "none".to_owned() } else { known.join(", ") };
            return Err(Error::Usage(format!(
                "--label {unknown}: there is no such attribute; there are {known}"
            )));
        }
        if columns.is_empty() {
            return Ok(Attributes::default());
        }
        let property =
            |column| Property { middle: middle(column, n_vertices), ..column.property.clone() };
        let properties = columns.iter().map(property).collect();
        let schema = VertexSchema { coordinate: Scalar::F32, properties };
        let codec = schema.kernel_codec(labels);
        let channel_kinds = codec.channel_kinds(&schema);
        let labels = labels.to_vec();
        let plan = Some((schema, codec));
        Ok(Attributes { columns, plan, labels, channel_kinds, regions: None })
    }

    /// Takes in the regions by which vertices were parted: another channel.
    pub(super) fn set_regions(&mut self, regions: FaceRegions) {
        let none = VertexSchema { coordinate: Scalar::F32, properties: Vec::new() };
        let mut schema = self.plan.take().map_or(none, |(schema, _)| schema);
        let property = Property::new("region", Scalar::I32);
        schema.properties.push(Property { origin: Origin::Region, ..property });
        let codec = schema.kernel_codec(&self.labels);
        self.channel_kinds = codec.channel_kinds(&schema);
        self.plan = Some((schema, codec));
        self.regions = Some(regions);
    }

    /// Returns the regions by which vertices were parted.
    pub(super) fn regions(&self) -> Option<&FaceRegions> {
        self.regions.as_ref()
    }

    /// Finds the labels that lie in patches, whose borders are kept.
    pub(super) fn find_patches(&mut self, triangles: &[[u32; 3]]) {
        let Some((schema, codec)) = &mut self.plan else { return };
        let step = triangles.len().div_ceil(PatchCount::SAMPLE).max(1);
        let is_label = schema.label_properties(&self.labels);
        let may_be_label = schema.float_properties(&self.labels);
        let looked_at = |(i, _): &(usize, _)| is_label[*i] || may_be_label[*i];
        for (i, column) in self.columns.iter().enumerate().filter(looked_at) {
            let (mut count, mut whole) = (PatchCount::default(), WholeValues::default());
            let scalar = column.property.scalar;
            for t in triangles.iter().step_by(step) {
                let values = t.map(|v| {
                    let at = v as usize * column.stride + column.offset;
                    column.bytes.get(at..at + scalar.bytes())
                });
                let number =
                    |bytes: Option<&[u8]>| bytes.map_or(f64::NAN, |b| read_scalar(scalar, b, 0));
                let numbers = values.map(number);
                count.add(values, numbers);
                if may_be_label[i] {
                    numbers.into_iter().for_each(|value| whole.add(value));
                }
            }
            let is_one = is_label[i] || whole.are_labels();
            let is_patchy = count.is_patchy(&column.property.name, &self.labels, step == 1);
            schema.properties[i].is_patchy = is_one && is_patchy;
        }
        *codec = schema.kernel_codec(&self.labels);
        self.channel_kinds = codec.channel_kinds(schema);
    }

    /// Returns the kind of each channel.
    pub fn channel_kinds(&self) -> &[ChannelKind] {
        &self.channel_kinds
    }

    /// Bytes of a record of `encode`: the values of all columns, packed in their order.
    pub fn record_bytes(&self) -> usize {
        self.columns.iter().map(|column| column.property.scalar.bytes()).sum()
    }

    /// Bytes of a record that tell charts apart: texture coordinates and the number of their image.
    pub(super) fn chart_bytes(&self) -> Vec<Range<usize>> {
        let mut at = 0;
        let places = self.columns.iter().map(|column| {
            let bytes = column.property.scalar.bytes();
            at += bytes;
            (column.property.name.as_str(), at - bytes..at)
        });
        let is_chart =
            |name: &str| name == "texnumber" || TEXTURE_NAMES.iter().flatten().any(|n| *n == name);
        places.filter(|(name, _)| is_chart(name)).map(|(_, bytes)| bytes).collect()
    }

    /// Gathers the values of a vertex behind an unused position.
    fn gather(&self, id: u32, position_bytes: usize, record: &mut Vec<u8>) {
        record.clear();
        record.resize(position_bytes, 0);
        let row = self.regions.as_ref().map_or(id, |regions| regions.row(id)) as usize;
        for column in &self.columns {
            let at = row * column.stride + column.offset;
            record.extend_from_slice(&column.bytes[at..at + column.property.scalar.bytes()]);
        }
        if let Some(regions) = &self.regions {
            record.extend_from_slice(&regions.number(id).to_le_bytes());
        }
    }

    /// Gives the mesh its channels; `ids` are the rows of its vertices.
    pub(super) fn decode(
        &self,
        mesh: &mut Mesh,
        ids: &[u32],
        means: (usize, &Progress),
    ) -> Result<()> {
        let Some((schema, codec)) = &self.plan else { return Ok(()) };
        let (n_channels, n_vertices) = (codec.n_channels(), mesh.positions.len());
        mesh.n_channels = n_channels;
        mesh.channels.reserve_exact(n_vertices * n_channels);
        in_blocks((n_vertices, BLOCK), means, &mut mesh.channels, |some, out| {
            out.resize(some.len() * n_channels, 0.0);
            let mut record = Vec::new();
            for (row, &id) in ids[some].iter().enumerate() {
                self.gather(id, schema.position_bytes(), &mut record);
                codec.decode_channels(&record, &mut out[row * n_channels..]);
            }
            Ok(())
        })
    }

    /// Records of the vertices of a result; labels come from the vertex that survived as each (`source`).
    pub(super) fn encode(&self, mesh: &Mesh, source: &[u32]) -> Vec<u8> {
        let Some((schema, codec)) = &self.plan else { return Vec::new() };
        let mut records = Vec::with_capacity(source.len() * self.record_bytes());
        let (mut before, mut after) = (Vec::new(), Vec::new());
        for (v, &from) in (0u32..).zip(source) {
            self.gather(from, schema.position_bytes(), &mut before);
            after.clear();
            codec.encode([0.0; 3], mesh.channels_of(v), &before, &mut after);
            // Without the number of the region.
            records.extend_from_slice(&after[schema.position_bytes()..][..self.record_bytes()]);
        }
        records
    }
}
/// The number that a column of doubles is averaged about, by its first values.
fn middle(column: &Column, n_vertices: usize) -> i64 {
    let scalar = column.property.scalar;
    if scalar != Scalar::F64 {
        return 0;
    }
    let at = |v: usize| v * column.stride + column.offset;
    let values =
        (0..n_vertices.min(MIDDLE_SAMPLE)).map(|v| read_scalar(scalar, column.bytes, at(v)));
    middle_of(values.collect())
}
