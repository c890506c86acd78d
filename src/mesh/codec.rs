//! Turns vertex records into kernel channels and back.
//!
//! The one place that says how a property becomes channels and how channels become a property again. Kernel
//! channels are `f32`.

use super::color_channels::Colour;
use super::property::{Origin, Property, Scalar, read_scalar, write_scalar};
use super::record::VertexSchema;

/// Names of properties that hold colours when they are `uchar` or `ushort`.
const COLOUR_NAMES: [&str; 20] = [
    "red",
    "green",
    "blue",
    "alpha",
    "r",
    "g",
    "b",
    "a",
    "diffuse_red",
    "diffuse_green",
    "diffuse_blue",
    "diffuse_alpha",
    "ambient_red",
    "ambient_green",
    "ambient_blue",
    "ambient_alpha",
    "specular_red",
    "specular_green",
    "specular_blue",
    "specular_alpha",
];

/// Groups the properties that are components of one colour; a component without the others is a group by itself.
pub fn colour_groups(properties: &[Property]) -> Vec<Vec<usize>> {
    let mut groups: Vec<Vec<usize>> = Colour::find(properties)
        .iter()
        .map(|colour| colour.fields.into_iter().chain(colour.alpha).collect())
        .collect();
    for (i, property) in properties.iter().enumerate() {
        let is_colour =
            MergeRule::of(property) == MergeRule::Colour && property.scalar != Scalar::I32;
        if is_colour && !groups.iter().any(|group| group.contains(&i)) {
            groups.push(vec![i]);
        }
    }
    groups
}

/// Effect of a collapse on a property.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum MergeRule {
    /// A float: one channel.
    Single,
    /// A double: two channels, the float nearest to its distance from the middle, and the float nearest to what is left.
    Double,
    /// An integer colour component (or the number of an image, or of a region): one channel, rounded and
    /// clamped on the way back.
    Colour,
    /// An integer that means something by its value (a class, a flag, an id): never averaged.
    Label,
}

impl MergeRule {
    fn of(property: &Property) -> MergeRule {
        let name = property.name.as_str();
        match property.scalar {
            _ if property.origin == Origin::Region => MergeRule::Colour,
            _ if matches!(property.origin, Origin::FaceLabel | Origin::Lock) => MergeRule::Label,
            // A label whatever its type.
            _ if property.is_patchy => MergeRule::Label,
            // Wedges of different images must not be taken for the same; equal ones mix to themselves.
            Scalar::I32 if name == "texnumber" => MergeRule::Colour,
            // Three bytes in the bits of a float, as PCL has colours.
            Scalar::F32 if matches!(name, "rgb" | "rgba") => MergeRule::Label,
            Scalar::F32 => MergeRule::Single,
            Scalar::F64 => MergeRule::Double,
            Scalar::U8 | Scalar::U16 if COLOUR_NAMES.contains(&name) => MergeRule::Colour,
            _ => MergeRule::Label,
        }
    }

    const fn n_channels(self) -> usize {
        match self {
            MergeRule::Single | MergeRule::Colour => 1,
            MergeRule::Double => 2,
            MergeRule::Label => 0,
        }
    }
}

/// Kind of a channel, for its weight.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ChannelKind {
    /// One of three perceptual coordinates of a colour, or its alpha.
    Colour,
    /// One of three components of a normal.
    Normal,
    /// One of two texture coordinates.
    Texture,
    /// The number of the region of faces; the same all over it.
    Region,
    /// The number of a vertex's labels that lie in patches; never interpolated, and of no place in a record.
    Label,
    /// A plain number: the property's name.
    Scalar(String),
    /// The low bits of the double in the channel before, which a float cannot hold.
    LowBits,
}

/// Names of texture coordinates at vertices.
pub const TEXTURE_NAMES: [[&str; 2]; 6] = [
    ["s", "t"],
    ["u", "v"],
    ["texture_u", "texture_v"],
    ["texture_s", "texture_t"],
    ["texcoord_u", "texcoord_v"],
    ["tu", "tv"],
];

/// One property of a record, with its places in the record and among the channels.
#[derive(Clone, Copy, Debug)]
struct Field {
    rule: MergeRule,
    scalar: Scalar,
    /// Byte offset in the record.
    at: usize,
    /// First channel; meaningless for a label.
    channel: usize,
    /// Of a double: subtracted from it in its channels.
    middle: f64,
}

impl VertexSchema {
    /// Number of kernel channels of a record's properties; labels have none.
    pub fn n_channels(&self) -> usize {
        let own: usize = self.properties.iter().map(|p| MergeRule::of(p).n_channels()).sum();
        own + usize::from(self.properties.iter().any(|p| p.is_patchy))
    }

    /// The plan for turning records into channels and back; make it once, outside the loop.
    ///
    /// Its channels are the properties' own values; `kernel_codec` is what simplifying uses.
    pub fn codec(&self) -> VertexCodec {
        VertexCodec::new(self, &[], false)
    }

    /// The plan for simplifying: colours become perceptual channels, the properties named in `labels` are
    /// chosen and never averaged.
    pub fn kernel_codec(&self, labels: &[String]) -> VertexCodec {
        VertexCodec::new(self, labels, true)
    }

    /// For each property, whether it is a label of the input's vertices: chosen at a collapse, never averaged.
    pub fn label_properties(&self, labels: &[String]) -> Vec<bool> {
        let fields = self.kernel_codec(labels).fields;
        let all = self.properties.iter().zip(fields);
        all.map(|(p, field)| p.origin == Origin::Vertex && field.rule == MergeRule::Label).collect()
    }

    /// For each property, whether it is a plain number of floats, which is a label where its values say so (`WholeValues`).
    pub fn float_properties(&self, labels: &[String]) -> Vec<bool> {
        let kinds = self.kernel_codec(labels).channel_kinds(self);
        let is_plain = |p: &Property| {
            !p.scalar.is_integer()
                && p.origin == Origin::Vertex
                && kinds.contains(&ChannelKind::Scalar(p.name.clone()))
        };
        self.properties.iter().map(is_plain).collect()
    }

    /// The channels of one record; loops over many vertices take `codec()` once instead.
    pub fn decode_channels(&self, record: &[u8], channels: &mut [f32]) {
        self.codec().decode_channels(record, channels);
    }

    /// Appends one record; loops over many vertices take `codec()` once instead.
    pub fn encode(
        &self,
        position: [f64; 3],
        channels: &[f32],
        label_record: &[u8],
        out: &mut Vec<u8>,
    ) {
        self.codec().encode(position, channels, label_record, out);
    }
}

/// Turns the properties of vertex records into kernel channels and back.
///
/// A property whose channels were not changed since they were decoded from `label_record` comes back
/// bit for bit, whatever its type; this is what keeps the attributes of unmoved vertices exact.
#[derive(Clone, Debug)]
pub struct VertexCodec {
    coordinate: Scalar,
    record_bytes: usize,
    n_channels: usize,
    fields: Vec<Field>,
    /// Indices into `fields` of nx, ny and nz, if all three are there as floats or doubles.
    normal: Option<[usize; 3]>,
    /// Colours whose channels are perceptual; their rule is `Colour`.
    colours: Vec<Colour>,
    /// Bytes of labels that lie in patches; the last channel is their number.
    patchy: Vec<std::ops::Range<usize>>,
}

impl VertexCodec {
    fn new(schema: &VertexSchema, labels: &[String], perceptual: bool) -> Self {
        let mut fields = Vec::with_capacity(schema.properties.len());
        let (mut at, mut channel) = (schema.position_bytes(), 0);
        let is_label = |p: &Property| p.origin == Origin::Vertex && labels.contains(&p.name);
        let mut colours = if perceptual { Colour::find(&schema.properties) } else { Vec::new() };
        colours.retain(|c| !c.fields.iter().any(|&i| is_label(&schema.properties[i])));
        for colour in &mut colours {
            colour.alpha = colour.alpha.filter(|&i| !is_label(&schema.properties[i]));
        }
        for (i, property) in schema.properties.iter().enumerate() {
            let in_colour = colours.iter().any(|c| c.fields.contains(&i) || c.alpha == Some(i));
            let rule = match (is_label(property), in_colour) {
                (true, _) => MergeRule::Label,
                (_, true) => MergeRule::Colour,
                _ => MergeRule::of(property),
            };
            let (scalar, middle) = (property.scalar, property.middle as f64);
            fields.push(Field { rule, scalar, at, channel, middle });
            at += property.scalar.bytes();
            channel += rule.n_channels();
        }
        let is_float = |i: &usize| !schema.properties[*i].scalar.is_integer();
        let find = |name: &str| schema.own_property(name).filter(is_float);
        let normal = match (find("nx"), find("ny"), find("nz")) {
            (Some(x), Some(y), Some(z)) => Some([x, y, z]),
            _ => None,
        };
        let averaged = |i: &usize| fields[*i].rule != MergeRule::Label;
        let normal = normal.filter(|fields| fields.iter().all(averaged));
        let coordinate = schema.coordinate;
        let labels = fields
            .iter()
            .zip(&schema.properties)
            .filter(|(field, property)| property.is_patchy && field.rule == MergeRule::Label);
        let patchy: Vec<_> =
            labels.map(|(field, _)| field.at..field.at + field.scalar.bytes()).collect();
        let n_channels = channel + usize::from(!patchy.is_empty());
        VertexCodec { coordinate, record_bytes: at, n_channels, fields, normal, colours, patchy }
    }

    /// Returns the kind of each channel. `schema` is the one that the plan was made from.
    pub fn channel_kinds(&self, schema: &VertexSchema) -> Vec<ChannelKind> {
        let texture = |p: &Property| {
            let pair = TEXTURE_NAMES.iter().find(|pair| pair.contains(&p.name.as_str()));
            let is_there = |name: &&str| schema.own_property(name).is_some();
            p.origin == Origin::Vertex && pair.is_some_and(|pair| pair.iter().all(is_there))
        };
        let mut channel_kinds = Vec::with_capacity(self.n_channels);
        for (i, (field, property)) in self.fields.iter().zip(&schema.properties).enumerate() {
            let colour = self.colours.iter().any(|c| c.fields.contains(&i) || c.alpha == Some(i));
            let normal = self.normal.is_some_and(|normal| normal.contains(&i));
            let own = match (colour, normal) {
                (true, _) => ChannelKind::Colour,
                (_, true) => ChannelKind::Normal,
                _ if texture(property) => ChannelKind::Texture,
                _ if property.origin == Origin::Region => ChannelKind::Region,
                _ => ChannelKind::Scalar(property.name.clone()),
            };
            match field.rule.n_channels() {
                0 => {}
                1 => channel_kinds.push(own),
                _ => channel_kinds.extend([own, ChannelKind::LowBits]),
            }
        }
        channel_kinds.extend((!self.patchy.is_empty()).then_some(ChannelKind::Label));
        channel_kinds
    }

    /// Returns whether there are texture coordinates or regions, so that there may be attribute seams.
    pub fn has_seams(&self, schema: &VertexSchema) -> bool {
        let channel_kinds = self.channel_kinds(schema);
        channel_kinds.contains(&ChannelKind::Texture)
            || channel_kinds.contains(&ChannelKind::Region)
    }

    /// Returns the number of channels that `decode_channels` fills and `encode` takes.
    pub fn n_channels(&self) -> usize {
        self.n_channels
    }

    /// Writes the channels of `record` into the first `n_channels` places of `channels`.
    pub fn decode_channels(&self, record: &[u8], channels: &mut [f32]) {
        for field in &self.fields {
            match field.rule {
                MergeRule::Label => {}
                MergeRule::Single | MergeRule::Colour => {
                    channels[field.channel] = read_scalar(field.scalar, record, field.at) as f32;
                }
                MergeRule::Double => {
                    let value = read_scalar(Scalar::F64, record, field.at);
                    let (high, low) = split_double(value - field.middle);
                    channels[field.channel] = high;
                    channels[field.channel + 1] = low;
                }
            }
        }
        if !self.patchy.is_empty() {
            channels[self.n_channels - 1] = self.label_number(record);
        }
        for colour in &self.colours {
            let (perceptual, alpha) = self.perceptual(colour, record);
            for (&i, x) in colour.fields.iter().zip(perceptual) {
                channels[self.fields[i].channel] = x;
            }
            if let Some(i) = colour.alpha {
                channels[self.fields[i].channel] = (alpha / colour.white()) as f32;
            }
        }
    }

    /// The number of a vertex's patchy labels: a hash of 24 bits, exact as a float. Two labels that touch are taken for one
    /// with a probability of 6e-8, and then their border is not kept.
    fn label_number(&self, record: &[u8]) -> f32 {
        let hash = self.patchy.iter().fold(0, |seed, bytes| {
            xxhash_rust::xxh3::xxh3_64_with_seed(&record[bytes.clone()], seed)
        });
        (hash >> 40) as f32
    }

    /// The channels of a colour in a record, and its alpha as it stands there.
    fn perceptual(&self, colour: &Colour, record: &[u8]) -> ([f32; 3], f64) {
        let read = |i: usize| read_scalar(self.fields[i].scalar, record, self.fields[i].at);
        let alpha = colour.alpha.map_or(colour.white(), read);
        (colour.channels(colour.fields.map(read), alpha), alpha)
    }

    /// Appends the record of a vertex: `position`, averaged properties from `channels`, labels from
    /// `label_record` (the surviving vertex's own record, as it was read).
    ///
    /// Normals whose channels changed are scaled to length 1; a normal without a direction stays as it
    /// is. Colours are rounded and clamped to their type.
    pub fn encode(
        &self,
        position: [f64; 3],
        channels: &[f32],
        label_record: &[u8],
        out: &mut Vec<u8>,
    ) {
        let start = out.len();
        for value in position {
            match self.coordinate {
                Scalar::F64 => out.extend_from_slice(&value.to_le_bytes()),
                _ => out.extend_from_slice(&(value as f32).to_le_bytes()),
            }
        }
        out.extend_from_slice(&label_record[out.len() - start..self.record_bytes]);
        let record = &mut out[start..];
        for (i, field) in self.fields.iter().enumerate() {
            if self.colours.iter().any(|c| c.fields.contains(&i) || c.alpha == Some(i)) {
                continue;
            }
            if !self.unchanged(field, channels, label_record) {
                write_scalar(field.scalar, record, field.at, self.value(field, channels));
            }
        }
        for colour in &self.colours {
            self.encode_colour(colour, channels, label_record, record);
        }
        if let Some(normal) = self.normal {
            self.renormalise(normal.map(|i| &self.fields[i]), channels, label_record, record);
        }
    }

    fn encode_colour(
        &self,
        colour: &Colour,
        channels: &[f32],
        label_record: &[u8],
        record: &mut [u8],
    ) {
        let (before, alpha) = self.perceptual(colour, label_record);
        let now = colour.fields.map(|i| channels[self.fields[i].channel]);
        let opacity = colour.alpha.map(|i| channels[self.fields[i].channel]);
        let same_alpha =
            opacity.is_none_or(|x| x.to_bits() == ((alpha / colour.white()) as f32).to_bits());
        if same_alpha && now.map(f32::to_bits) == before.map(f32::to_bits) {
            return;
        }
        let white = colour.white();
        let alpha = opacity.map_or(white, |x| f64::from(x).clamp(0.0, 1.0) * white);
        if let Some(i) = colour.alpha {
            write_scalar(self.fields[i].scalar, record, self.fields[i].at, alpha);
        }
        if let Some(rgb) = colour.values(now, alpha) {
            for (&i, value) in colour.fields.iter().zip(rgb) {
                write_scalar(self.fields[i].scalar, record, self.fields[i].at, value);
            }
        }
    }

    fn unchanged(&self, field: &Field, channels: &[f32], label_record: &[u8]) -> bool {
        let same = |a: f32, b: f32| a.to_bits() == b.to_bits();
        let original = read_scalar(field.scalar, label_record, field.at);
        match field.rule {
            MergeRule::Label => true,
            MergeRule::Single | MergeRule::Colour => same(channels[field.channel], original as f32),
            MergeRule::Double => {
                let (high, low) = split_double(original - field.middle);
                same(channels[field.channel], high) && same(channels[field.channel + 1], low)
            }
        }
    }

    fn value(&self, field: &Field, channels: &[f32]) -> f64 {
        let first = f64::from(channels[field.channel]);
        match field.rule {
            MergeRule::Double => first + f64::from(channels[field.channel + 1]) + field.middle,
            _ => first,
        }
    }

    fn renormalise(
        &self,
        normal: [&Field; 3],
        channels: &[f32],
        label_record: &[u8],
        record: &mut [u8],
    ) {
        if normal.iter().all(|field| self.unchanged(field, channels, label_record)) {
            return;
        }
        let n = normal.map(|field| self.value(field, channels));
        let length = (n[0] * n[0] + n[1] * n[1] + n[2] * n[2]).sqrt();
        if length > 0.0 && length.is_finite() {
            for (field, value) in normal.iter().zip(n) {
                write_scalar(field.scalar, record, field.at, value / length);
            }
        }
    }
}

/// The nearest float and the float nearest to the rest; the rest of an infinite or too large value is 0.
fn split_double(value: f64) -> (f32, f32) {
    let high = value as f32;
    let low = if high.is_finite() { (value - f64::from(high)) as f32 } else { 0.0 };
    (high, low)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::property::middle_of;

    fn schema(coordinate: Scalar, properties: &[(&str, Scalar)]) -> VertexSchema {
        let properties = properties.iter().map(|&(name, scalar)| Property::new(name, scalar));
        VertexSchema { coordinate, properties: properties.collect() }
    }

    fn record(schema: &VertexSchema, values: &[f64]) -> Vec<u8> {
        let mut record = vec![0; schema.record_bytes()];
        let scalars = [schema.coordinate; 3].into_iter();
        let mut at = 0;
        for (scalar, &value) in
            scalars.chain(schema.properties.iter().map(|p| p.scalar)).zip(values)
        {
            write_scalar(scalar, &mut record, at, value);
            at += scalar.bytes();
        }
        record
    }

    #[test]
    fn doubles_are_averaged_about_their_middle() {
        let mut schema = schema(Scalar::F32, &[("gps_time", Scalar::F64)]);
        let times = [1_700_000_003.25, 1_700_000_010.5];
        schema.properties[0].middle = middle_of(times.to_vec());
        let codec = schema.codec();
        let rows = times.map(|time| record(&schema, &[0.0, 0.0, 0.0, time]));
        let mut channels = [[0.0f32; 2]; 2];
        for (row, own) in rows.iter().zip(&mut channels) {
            codec.decode_channels(row, own);
        }
        let mean = [0, 1].map(|k| 0.5 * channels[0][k] + 0.5 * channels[1][k]);
        let mut out = Vec::new();
        codec.encode([0.0; 3], &mean, &rows[0], &mut out);
        assert_eq!(read_scalar(Scalar::F64, &out, 12), 1_700_000_006.875);
        for (row, own) in rows.iter().zip(&channels) {
            out.clear();
            codec.encode([0.0; 3], own, &rows[0], &mut out);
            assert_eq!(out, *row);
        }
        for near in [vec![-0.5, 0.25, f64::NAN], vec![100.0, 9000.0], Vec::new()] {
            assert_eq!(middle_of(near), 0);
        }
    }

    #[test]
    fn an_untouched_vertex_comes_back_bit_for_bit() {
        let schema = schema(
            Scalar::F64,
            &[
                ("nx", Scalar::F32),
                ("ny", Scalar::F32),
                ("nz", Scalar::F32),
                ("red", Scalar::U8),
                ("gps_time", Scalar::F64),
                ("class", Scalar::I64),
                ("quality", Scalar::F32),
            ],
        );
        let mut original =
            record(&schema, &[500000.123, 5.4e6, 1e-9, 0.3, 0.2, 0.1, 77.0, 0.1, 9e15, 2.0]);
        let nan = original.len() - 4;
        original[nan..].copy_from_slice(&f32::from_bits(0x7fc0_1234).to_le_bytes());
        let codec = schema.codec();
        assert_eq!(codec.n_channels(), 3 + 1 + 2 + 1);
        assert_eq!(schema.n_channels(), codec.n_channels());
        let mut channels = vec![0.0; codec.n_channels()];
        codec.decode_channels(&original, &mut channels);
        let mut out = Vec::new();
        codec.encode(schema.position(&original), &channels, &original, &mut out);
        assert_eq!(out, original);
    }

    #[test]
    fn averages_round_colours_scale_normals_and_leave_labels_alone() {
        let schema = schema(
            Scalar::F32,
            &[
                ("nx", Scalar::F32),
                ("ny", Scalar::F32),
                ("nz", Scalar::F32),
                ("red", Scalar::U8),
                ("green", Scalar::U16),
                ("class", Scalar::U8),
                ("time", Scalar::F64),
            ],
        );
        let label = record(&schema, &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 2.0, 7.0, 1e9 + 0.125]);
        let mut out = Vec::new();
        let channels = [3.0, 0.0, 4.0, 254.6, 1e9, 1e9, 0.25];
        schema.encode([1.0, 2.0, 3.0], &channels, &label, &mut out);
        let at = |scalar, at| read_scalar(scalar, &out, at);
        assert_eq!(schema.position(&out), [1.0, 2.0, 3.0]);
        assert!((at(Scalar::F32, 12) - 0.6).abs() < 1e-7);
        assert_eq!(at(Scalar::F32, 16), 0.0);
        assert!((at(Scalar::F32, 20) - 0.8).abs() < 1e-7);
        assert_eq!(at(Scalar::U8, 24), 255.0);
        assert_eq!(at(Scalar::U16, 25), 65535.0);
        assert_eq!(at(Scalar::U8, 27), 7.0);
        assert_eq!(at(Scalar::F64, 28), 1e9 + 0.25);
    }

    #[test]
    fn every_byte_of_colour_comes_back_touched_or_not() {
        let names = ["red", "green", "blue", "alpha"];
        let properties: Vec<_> = names.iter().map(|&name| (name, Scalar::U8)).collect();
        for n in [3, 4] {
            let schema = schema(Scalar::F32, &properties[..n]);
            let codec = schema.kernel_codec(&[]);
            let mut channels = vec![0.0; codec.n_channels()];
            for value in 0..=255u8 {
                let v = f64::from(value);
                for rgb in [[v, v, v], [v, 0.0, 255.0], [0.0, v, 13.0], [255.0 - v, 7.0, v]] {
                    for alpha in [255.0, 40.0] {
                        let values = [0.0, 0.0, 0.0, rgb[0], rgb[1], rgb[2], alpha];
                        let original = record(&schema, &values[..3 + n]);
                        codec.decode_channels(&original, &mut channels);
                        let mut out = Vec::new();
                        codec.encode([0.0; 3], &channels, &original, &mut out);
                        assert_eq!(out, original);
                        // The same colour by way of another vertex.
                        let mut other = original.clone();
                        other[12..].fill(99);
                        out.clear();
                        codec.encode([0.0; 3], &channels, &other, &mut out);
                        assert_eq!(out, original, "{rgb:?} {alpha}");
                    }
                }
            }
        }
    }

    #[test]
    fn what_is_transparent_has_no_say_in_a_mixture() {
        let names = ["red", "green", "blue", "alpha"];
        let schema = schema(Scalar::F32, &names.map(|name| (name, Scalar::U8)));
        let codec = schema.kernel_codec(&[]);
        let clear = record(&schema, &[0.0, 0.0, 0.0, 0.0, 255.0, 0.0, 0.0]);
        let solid = record(&schema, &[0.0, 0.0, 0.0, 200.0, 30.0, 60.0, 255.0]);
        let (mut a, mut b) = (vec![0.0; 4], vec![0.0; 4]);
        codec.decode_channels(&clear, &mut a);
        codec.decode_channels(&solid, &mut b);
        let half: Vec<f32> = a.iter().zip(&b).map(|(a, b)| 0.5 * (a + b)).collect();
        let mut out = Vec::new();
        codec.encode([0.0; 3], &half, &clear, &mut out);
        assert_eq!(&out[12..], &[200, 30, 60, 128]);
    }

    #[test]
    fn integers_of_any_width_are_colours() {
        for scalar in [Scalar::I8, Scalar::I16, Scalar::U16, Scalar::I32, Scalar::U32] {
            let properties = ["red", "green", "blue"].map(|name| Property::new(name, scalar));
            let properties = properties.to_vec();
            let schema = VertexSchema { coordinate: Scalar::F32, properties };
            let kinds = schema.kernel_codec(&[]).channel_kinds(&schema);
            assert_eq!(kinds, vec![ChannelKind::Colour; 3], "{scalar:?}");
        }
    }

    #[test]
    fn channels_have_meanings_and_labels_are_no_channels() {
        let schema = schema(
            Scalar::F32,
            &[
                ("s", Scalar::F32),
                ("red", Scalar::U16),
                ("green", Scalar::U16),
                ("blue", Scalar::U16),
                ("t", Scalar::F32),
                ("nx", Scalar::F32),
                ("ny", Scalar::F32),
                ("nz", Scalar::F32),
                ("time", Scalar::F64),
                ("scalar_class", Scalar::F32),
                ("u", Scalar::F32),
            ],
        );
        let codec = schema.kernel_codec(&["scalar_class".to_owned()]);
        use ChannelKind::{Colour, LowBits, Normal, Texture};
        let scalar = |name: &str| ChannelKind::Scalar(name.to_owned());
        let expected = [
            Texture,
            Colour,
            Colour,
            Colour,
            Texture,
            Normal,
            Normal,
            Normal,
            scalar("time"),
            LowBits,
            scalar("u"),
        ];
        assert_eq!(codec.channel_kinds(&schema), expected);
        assert_eq!(codec.n_channels(), expected.len());
    }
}
