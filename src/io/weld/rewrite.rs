//! Writes a mesh again with one vertex for those that are joined.
//!
//! Sorts by vertex (which one it joins), by the vertex that is joined (their values are averaged, labels are the first's),
//! and by vertex again (the numbers that faces get). Vertices of one place with other texture coordinates stay apart, in
//! exactly that place: the kernel keeps such seams together. Faces keep their order and all they carry.

use super::edits::Edits;
use super::neighbours::{ITSELF_LAST, Neighbours, Pairs};
use super::overlaps::{self, JoinedPairs, Overlap};
use super::rest::Rest;
use super::splits;
use super::survey::{Found, each_position};
use crate::borders::OpenBorders;
use crate::external_sort::{ExternalSort, halves, whole};
use crate::open_edges::each_open;
use crate::open_options::{StageOptions, Weld, WeldOptions};
use crate::ply::raw::{RawFile, Spool};
use crate::ply::{BLOCK_ROWS, MeshSource, OutputHeader, VertexRecords, WeldReport};
use crate::restaged::{FewRows, Numbers, face_rows_with, restage};
use stonecut_mesh::codec::{ChannelKind, VertexCodec};
use stonecut_mesh::vec3::Vec3;
use stonecut_system::error::{Error, Result};
use stonecut_system::units::show_count;
use xxhash_rust::xxh3::xxh3_64;

/// Words of a vertex by the one that it joins, besides its properties: that one, texture, number, position.
const OWN_WORDS: usize = 12;

/// Joins what lies within `found.distance` of each other, at open edges.
pub(super) fn join(
    source: MeshSource,
    found: &Found,
    borders: Option<&OpenBorders>,
    how: &WeldOptions,
    options: &StageOptions,
) -> Result<MeshSource> {
    let schema = source.schema();
    // NumberRecords of a sort have a width that the compiler knows.
    match (schema.record_bytes() - schema.position_bytes()).div_ceil(4) {
        0 => join_records::<OWN_WORDS>(source, found, borders, how, options),
        1 => join_records::<{ OWN_WORDS + 1 }>(source, found, borders, how, options),
        2 => join_records::<{ OWN_WORDS + 2 }>(source, found, borders, how, options),
        3..=4 => join_records::<{ OWN_WORDS + 4 }>(source, found, borders, how, options),
        5..=8 => join_records::<{ OWN_WORDS + 8 }>(source, found, borders, how, options),
        9..=16 => join_records::<{ OWN_WORDS + 16 }>(source, found, borders, how, options),
        17..=64 => join_records::<{ OWN_WORDS + 64 }>(source, found, borders, how, options),
        _ if how.how == Weld::Auto => Ok(source),
        _ => Err(Error::Usage(format!(
            "--weld {}: vertices of {} have more than 256 bytes of properties; give the option up",
            how.how,
            source.path().display()
        ))),
    }
}

fn join_records<const N: usize>(
    source: MeshSource,
    found: &Found,
    borders: Option<&OpenBorders>,
    how: &WeldOptions,
    options: &StageOptions,
) -> Result<MeshSource> {
    let memory_bytes = (options.memory_bytes / 3) as usize;
    let JoinedPairs { pairs, overlap, alone } = match borders {
        Some(borders) => overlaps::pairs(&source, borders, found, options)?,
        None => JoinedPairs {
            pairs: pairs(&source, found, memory_bytes, options)?,
            overlap: Overlap::None,
            alone: Vec::new(),
        },
    };
    let (by_first, joined) =
        by_first::<N>(&source, Pairs::new(&pairs)?, how, memory_bytes, options)?;
    if joined == 0 {
        let (vertices, mut source) = (source.n_vertices(), source);
        if borders.is_some() {
            let notes = Edits::new(&source).notes(overlap);
            source.note_weld(WeldReport { vertices, notes, ..WeldReport::default() });
        }
        return Ok(source);
    }
    let n_before = source.n_vertices();
    let Made { vertices, numbers, n_vertices, shared } =
        vertices(&source, (by_first, Pairs::new(&pairs)?), how, memory_bytes, options)?;
    drop(pairs);
    // Refuses numbers of more than 32 bits.
    OutputHeader::new(source.schema().clone(), n_vertices, 0).index_type()?;
    let mut edits = Edits::new(&source);
    match (borders, overlap) {
        (Some(_), Overlap::Copies) => edits.drop_repeated(&source, (&numbers, &shared), options)?,
        (Some(borders), _) => {
            edits.split(splits::find(
                &source,
                borders,
                &mut Numbers::new(&numbers),
                found.split_distance,
                options,
            )?);
        }
        (None, _) => {}
    }
    let put = |place, rows: FewRows, out: &mut Spool| edits.put(place, rows, out);
    let Some(faces) = face_rows_with(&source, Some(&numbers), options, put)? else {
        return match how.how {
            Weld::Auto => Ok(source),
            _ => Err(Error::bad_input(
                source.path(),
                format!("--weld {}: it has a face of more than 127 corners", how.how),
            )),
        };
    };

    let mut report = WeldReport {
        vertices: n_before,
        joined: n_before - n_vertices,
        distance: found.distance,
        notes: Vec::new(),
    };
    match borders {
        Some(_) => {
            report.notes.extend(edits.notes(overlap));
            report.notes.extend(note_alone(&alone, &source));
        }
        None => report.notes.push(note(&report, how, &source)),
    }
    let schema = source.schema().clone();
    restage(source, schema, (n_vertices, vertices), faces, options, |staged| {
        staged.weld = Some(report);
        staged.numbers = how.keeps_numbers.then_some(numbers);
    })
}

/// A line on parts that fit to none of the others, if they are few.
fn note_alone(alone: &[usize], source: &MeshSource) -> Option<String> {
    let parts = source.parts();
    let first = alone.first().filter(|_| 4 * alone.len() <= parts.len())?;
    let path = &parts[*first].path;
    let more = match alone.len() {
        1 => String::new(),
        n => format!(" ({n} such in all)"),
    };
    Some(format!(
        "{path}: no vertex of it lies at one of the other files{more}: if it belongs to them, its units, axes or offset are others"
    ))
}

/// The records of `Pairs` of a mesh.
fn pairs(
    source: &MeshSource,
    found: &Found,
    memory_bytes: usize,
    options: &StageOptions,
) -> Result<RawFile> {
    let sort = options.sort(memory_bytes);
    let mut neighbours = Neighbours::new(sort, &found.bounds, found.distance);
    if found.is_loose {
        let mut done = Ok(());
        each_position(source, |v, position| {
            if done.is_ok() {
                done = neighbours.push(v, position);
            }
        })?;
        done?;
    } else {
        let mut records = VertexRecords::new(source);
        each_open(source, memory_bytes, |v| neighbours.push(v, records.position(v)?))?;
    }
    neighbours.pairs(source.path(), options)
}

/// Vertices that are joined by the one that they join, and how many join another.
fn by_first<const N: usize>(
    source: &MeshSource,
    pairs: Pairs,
    how: &WeldOptions,
    memory_bytes: usize,
    options: &StageOptions,
) -> Result<(ExternalSort<N>, u64)> {
    let mut vertices = Vertices {
        records: VertexRecords::new(source),
        codec: source.schema().kernel_codec(&how.labels),
        texture: Vec::new(),
        channels: Vec::new(),
        sort: options.sort::<N>(memory_bytes),
    };
    let kinds = vertices.codec.channel_kinds(source.schema());
    vertices.texture = (0..kinds.len()).filter(|&i| kinds[i] == ChannelKind::Texture).collect();
    vertices.channels = vec![0.0; kinds.len()];
    let mut joined = 0;
    pairs.each(|[v, first, place @ ..]| {
        let is_itself = first == ITSELF_LAST;
        joined += u64::from(!is_itself);
        vertices.put(v, if is_itself { v } else { first }, place)
    })?;
    Ok((vertices.sort, joined))
}

/// Sends vertices on in the order of their numbers.
struct Vertices<'a, const N: usize> {
    records: VertexRecords<'a>,
    codec: VertexCodec,
    /// Channels of texture coordinates.
    texture: Vec<usize>,
    channels: Vec<f32>,
    sort: ExternalSort<N>,
}

impl<const N: usize> Vertices<'_, N> {
    fn put(&mut self, v: u64, first: u64, place: [u64; 3]) -> Result<()> {
        let schema = self.records.source().schema();
        let record = self.records.get(v)?;
        let mut row = [0; N];
        [row[0], row[1]] = halves(first);
        if !self.texture.is_empty() {
            self.codec.decode_channels(record, &mut self.channels);
            // Copies of coordinates differ in their last bits too.
            let mut key = Vec::with_capacity(4 * self.texture.len());
            for &channel in &self.texture {
                key.extend_from_slice(&((self.channels[channel] * 65_536.0).round()).to_le_bytes());
            }
            [row[2], row[3]] = halves(xxh3_64(&key));
        }
        [row[4], row[5]] = halves(v);
        row[6..OWN_WORDS].copy_from_slice(place.map(halves).as_flattened());
        let properties = &record[schema.position_bytes()..];
        let values = bytemuck::cast_slice_mut::<u32, u8>(&mut row[OWN_WORDS..]);
        values[..properties.len()].copy_from_slice(properties);
        self.sort.push(row)
    }
}

/// New vertices.
struct Made {
    vertices: RawFile,
    /// The new number of each old one, 4 bytes.
    numbers: RawFile,
    n_vertices: u64,
    /// A bit for each old one that became one with others; empty where it would take more than a share of the memory.
    shared: Vec<u64>,
}

/// Makes the new vertices.
///
/// New vertices come in the order of the first of each; those that are not joined are copied as they are.
fn vertices<const N: usize>(
    source: &MeshSource,
    (by_first, joined): (ExternalSort<N>, Pairs),
    how: &WeldOptions,
    memory_bytes: usize,
    options: &StageOptions,
) -> Result<Made> {
    let mut mixer = Mixer::new(source, how, options.spool());
    let mut rest = Rest::new(source, joined);
    let mut by_vertex = options.sort::<4>(memory_bytes);
    let (mut n_vertices, mut last, mut first_of_last) = (0u64, None, 0);
    let has_bits = source.n_vertices() / 8 <= memory_bytes as u64;
    let mut shared = Vec::new();
    let mut mark = |v: u64| {
        if has_bits {
            let word = (v / 64) as usize;
            shared.resize(shared.len().max(word + 1), 0u64);
            shared[word] |= 1 << (v % 64);
        }
    };
    // Files of more vertices than 32 bits can count are refused when their header is written.
    by_first.drain(|row| {
        let own: [u32; 4] = std::array::from_fn(|i| row[i]);
        let v = whole(row[4], row[5]);
        if last == Some(own) {
            mark(first_of_last);
            mark(v);
        } else {
            mixer.put()?;
            let first = whole(own[0], own[1]);
            if rest.next <= first {
                let [v0, v1] = halves(rest.next);
                by_vertex.push([v0, v1, COUNTED_FROM, n_vertices as u32])?;
                n_vertices += rest.copy_up_to(first, &mut mixer.out)?;
                rest.next = first + 1;
            }
            (last, first_of_last) = (Some(own), v);
            n_vertices += 1;
        }
        let place: Vec3 = [6, 8, 10].map(|i| f64::from_bits(whole(row[i], row[i + 1])));
        mixer.add(place, bytemuck::cast_slice(&row[OWN_WORDS..]));
        by_vertex.push([row[4], row[5], ITSELF, (n_vertices - 1) as u32])
    })?;
    mixer.put()?;
    let [v0, v1] = halves(rest.next);
    by_vertex.push([v0, v1, COUNTED_FROM, n_vertices as u32])?;
    n_vertices += rest.copy_up_to(source.n_vertices(), &mut mixer.out)?;
    let (mut numbers, mut v, mut number) = (options.spool(), 0, 0u32);
    let mut some = Vec::new();
    let mut count_up_to = |end: u64, number: &mut u32, numbers: &mut Spool| {
        while v < end {
            let n = (end - v).min(BLOCK_ROWS) as u32;
            some.clear();
            some.extend((0..n).map(|i| number.wrapping_add(i)));
            numbers.write(bytemuck::cast_slice(&some))?;
            (v, *number) = (v + u64::from(n), number.wrapping_add(n));
        }
        Ok::<u64, Error>(v)
    };
    by_vertex.drain(|[v0, v1, kind, own]| {
        let at = whole(v0, v1);
        count_up_to(at, &mut number, &mut numbers)?;
        if kind == COUNTED_FROM {
            number = own;
            return Ok(());
        }
        let after = number;
        number = own;
        count_up_to(at + 1, &mut number, &mut numbers)?;
        number = after;
        Ok(())
    })?;
    count_up_to(source.n_vertices(), &mut number, &mut numbers)?;
    let path = source.path();
    let vertices = mixer.out.finish(path)?;
    Ok(Made { vertices, numbers: numbers.finish(path)?, n_vertices, shared })
}

/// Kinds of numbers: that of the next vertex that is not joined, that of this vertex.
const COUNTED_FROM: u32 = 0;
const ITSELF: u32 = 1;

/// Makes one record of those that are joined: numbers are averaged, labels are the first's.
struct Mixer<'a> {
    source: &'a MeshSource,
    codec: VertexCodec,
    sums: Vec<(f64, u32)>,
    channels: Vec<f32>,
    place: Vec3,
    n: u64,
    /// The first of them, and the one at work.
    first: Vec<u8>,
    record: Vec<u8>,
    out: Spool,
}

impl<'a> Mixer<'a> {
    fn new(source: &'a MeshSource, how: &WeldOptions, out: Spool) -> Mixer<'a> {
        let codec = source.schema().kernel_codec(&how.labels);
        let n = codec.n_channels();
        let (sums, channels) = (vec![(0.0, 0); n], vec![0.0; n]);
        let (first, record) = (Vec::new(), Vec::new());
        Mixer { source, codec, sums, channels, place: [0.0; 3], n: 0, first, record, out }
    }

    fn add(&mut self, place: Vec3, values: &[u8]) {
        let schema = self.source.schema();
        let n_bytes = schema.record_bytes() - schema.position_bytes();
        self.record.clear();
        schema.encode_position(place, &mut self.record);
        self.record.extend_from_slice(&values[..n_bytes]);
        if self.n == 0 {
            self.place = place;
            self.first.clone_from(&self.record);
            self.sums.fill((0.0, 0));
        }
        self.n += 1;
        if self.sums.is_empty() {
            return;
        }
        self.codec.decode_channels(&self.record, &mut self.channels);
        for ((sum, n), &value) in self.sums.iter_mut().zip(&self.channels) {
            if value.is_finite() {
                *sum += f64::from(value);
                *n += 1;
            }
        }
    }

    /// Writes what was added, if anything was.
    fn put(&mut self) -> Result<()> {
        match self.n {
            0 => return Ok(()),
            // As it was, bit for bit.
            1 => self.out.write(&self.first)?,
            _ => {
                self.codec.decode_channels(&self.first, &mut self.channels);
                for (channel, &(sum, n)) in self.channels.iter_mut().zip(&self.sums) {
                    if n > 0 {
                        *channel = (sum / f64::from(n)) as f32;
                    }
                }
                self.record.clear();
                self.codec.encode(self.place, &self.channels, &self.first, &mut self.record);
                self.out.write(&self.record)?;
            }
        }
        self.n = 0;
        Ok(())
    }
}

/// Words for what was joined.
fn note(report: &WeldReport, how: &WeldOptions, source: &MeshSource) -> String {
    let less = match how.how {
        Weld::Distance(asked) if asked > report.distance => {
            format!(
                " (not {asked:.1e}: more than a tenth of the median edge would join what is apart)"
            )
        }
        _ => String::new(),
    };
    format!(
        "{} of {} vertices of {} triangles lay within {:.1e} of another and were joined{less}; --weld off leaves them apart",
        show_count(report.joined),
        show_count(report.vertices),
        show_count(source.n_triangles()),
        report.distance
    )
}
