//! Writes a mesh again with one vertex for those that are joined.
//!
//! Sorts by vertex (which one it joins), by the vertex that is joined (their values are averaged, labels are the first's),
//! and by vertex again (the numbers that faces get). Vertices of one place with other texture coordinates stay apart, in
//! exactly that place: the kernel keeps such seams together. Faces keep their order and all they carry.

use super::neighbours::Neighbours;
use super::survey::{Found, each_position};
use crate::borders::Borders;
use crate::external_sort::{ExternalSort, halves, whole};
use crate::open_edges::each_open;
use crate::open_options::{StageOptions, Weld, WeldOptions};
use crate::ply::raw::{RawFile, Spool};
use crate::ply::{BLOCK_ROWS, MeshSource, OutputHeader, VertexBlock, WeldReport};
use crate::restaged::{face_rows, restage};
use stonecut_mesh::codec::{ChannelKind, VertexCodec};
use stonecut_mesh::vec3::Vec3;
use stonecut_system::error::{Error, Result};
use stonecut_system::units::show_count;
use xxhash_rust::xxh3::xxh3_64;

/// Words of a vertex by the one that it joins, besides its properties: that one, texture, number, position.
const OWN_WORDS: usize = 12;
/// Stands for the vertex itself, behind all others.
const ITSELF_LAST: [u32; 2] = [u32::MAX; 2];

/// Joins what lies within `found.distance` of each other, at open edges.
pub(super) fn join(
    source: MeshSource,
    found: &Found,
    borders: Option<&Borders>,
    how: &WeldOptions,
    options: &StageOptions,
) -> Result<MeshSource> {
    let schema = source.schema();
    // Records of a sort have a width that the compiler knows.
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
    borders: Option<&Borders>,
    how: &WeldOptions,
    options: &StageOptions,
) -> Result<MeshSource> {
    let memory_bytes = (options.memory_bytes / 3) as usize;
    let pairs = pairs(&source, found, borders, memory_bytes, options)?;
    let (by_first, all, joined) = by_first::<N>(&source, pairs, how, memory_bytes, options)?;
    if joined == 0 {
        return Ok(source);
    }
    let n_before = source.n_vertices();
    let (vertices, numbers, n_vertices) =
        vertices(&source, (by_first, all), how, memory_bytes, options)?;
    // Refuses numbers of more than 32 bits.
    OutputHeader::new(source.schema().clone(), n_vertices, 0).index_type()?;
    let mut numbers = Numbers::new(numbers);
    let number = |v: u64| numbers.get(v);
    let Some(faces) = face_rows(&source, number, options)? else {
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
    report.notes.push(note(&report, &source));
    let schema = source.schema().clone();
    restage(source, schema, (n_vertices, vertices), faces, options, |staged| {
        staged.weld = Some(report);
    })
}

/// Each vertex that joins another: its number, that one's, and the position of both: ten words.
fn pairs(
    source: &MeshSource,
    found: &Found,
    borders: Option<&Borders>,
    memory_bytes: usize,
    options: &StageOptions,
) -> Result<ExternalSort<10>> {
    let sort = options.sort(memory_bytes);
    let mut neighbours = Neighbours::new(sort, &found.bounds, found.distance);
    if let Some(borders) = borders {
        borders.each_vertex(source, |v, position| neighbours.push(v, position))?;
    } else if found.is_loose {
        let mut done = Ok(());
        each_position(source, |v, position| {
            if done.is_ok() {
                done = neighbours.push(v, position);
            }
        })?;
        done?;
    } else {
        let (mut block, mut loaded) = (VertexBlock::default(), None);
        each_open(source, memory_bytes, |v| {
            let index = v / BLOCK_ROWS;
            if loaded != Some(index) {
                source.read_vertices(index, &mut block)?;
                loaded = Some(index);
            }
            let record_bytes = source.schema().record_bytes();
            let at = (v % BLOCK_ROWS) as usize * record_bytes;
            neighbours.push(v, source.schema().position(&block.records[at..at + record_bytes]))
        })?;
    }
    let mut pairs = options.sort(memory_bytes);
    neighbours.finish(|v, first, position| {
        let ([v0, v1], [f0, f1]) = (halves(v), halves(first));
        let [x, y, z] = position.map(|x| halves(x.to_bits()));
        let place = [x[0], x[1], y[0], y[1], z[0], z[1]];
        let row = |[a0, a1]: [u32; 2], [b0, b1]: [u32; 2]| {
            let [x0, x1, y0, y1, z0, z1] = place;
            [a0, a1, b0, b1, x0, x1, y0, y1, z0, z1]
        };
        pairs.push(row([v0, v1], [f0, f1]))?;
        pairs.push(row([f0, f1], ITSELF_LAST))
    })?;
    Ok(pairs)
}

/// Vertices that are joined by the one that they join, and how many join another; their numbers, ascending.
fn by_first<const N: usize>(
    source: &MeshSource,
    pairs: ExternalSort<10>,
    how: &WeldOptions,
    memory_bytes: usize,
    options: &StageOptions,
) -> Result<(ExternalSort<N>, RawFile, u64)> {
    let mut vertices = Vertices {
        source,
        codec: source.schema().kernel_codec(&how.labels),
        texture: Vec::new(),
        channels: Vec::new(),
        block: VertexBlock::default(),
        loaded: None,
        sort: options.sort::<N>(memory_bytes),
    };
    let kinds = vertices.codec.channel_kinds(source.schema());
    vertices.texture = (0..kinds.len()).filter(|&i| kinds[i] == ChannelKind::Texture).collect();
    vertices.channels = vec![0.0; kinds.len()];
    let (mut joined, mut last) = (0, None);
    let mut all = options.spool();
    pairs.drain(|[v0, v1, f0, f1, x0, x1, y0, y1, z0, z1]| {
        let v = whole(v0, v1);
        // One that others join comes once for each of them.
        if last.replace(v) == Some(v) {
            return Ok(());
        }
        let is_itself = [f0, f1] == ITSELF_LAST;
        joined += u64::from(!is_itself);
        all.write(&v.to_le_bytes())?;
        let first = if is_itself { [v0, v1] } else { [f0, f1] };
        vertices.put(v, first, [x0, x1, y0, y1, z0, z1])
    })?;
    Ok((vertices.sort, all.finish(source.path())?, joined))
}

/// Sends vertices on in the order of their numbers.
struct Vertices<'a, const N: usize> {
    source: &'a MeshSource,
    codec: VertexCodec,
    /// Channels of texture coordinates.
    texture: Vec<usize>,
    channels: Vec<f32>,
    block: VertexBlock,
    loaded: Option<u64>,
    sort: ExternalSort<N>,
}

impl<const N: usize> Vertices<'_, N> {
    fn put(&mut self, v: u64, first: [u32; 2], place: [u32; 6]) -> Result<()> {
        let index = v / BLOCK_ROWS;
        if self.loaded.replace(index) != Some(index) {
            self.source.read_vertices(index, &mut self.block)?;
        }
        let schema = self.source.schema();
        let bytes = schema.record_bytes();
        let record = &self.block.records[(v % BLOCK_ROWS) as usize * bytes..][..bytes];
        let mut row = [0; N];
        [row[0], row[1]] = first;
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
        row[6..OWN_WORDS].copy_from_slice(&place);
        let properties = &record[schema.position_bytes()..];
        let values = bytemuck::cast_slice_mut::<u32, u8>(&mut row[OWN_WORDS..]);
        values[..properties.len()].copy_from_slice(properties);
        self.sort.push(row)
    }
}

/// The new vertices, the new number of each old one (4 bytes each), and the number of new ones.
///
/// New vertices come in the order of the first of each; those that are not joined are copied as they are.
fn vertices<const N: usize>(
    source: &MeshSource,
    (by_first, joined): (ExternalSort<N>, RawFile),
    how: &WeldOptions,
    memory_bytes: usize,
    options: &StageOptions,
) -> Result<(RawFile, RawFile, u64)> {
    let mut mixer = Mixer::new(source, how, options.spool());
    let mut rest = Rest::new(source, joined);
    let mut by_vertex = options.sort::<4>(memory_bytes);
    let (mut n_vertices, mut last) = (0u64, None);
    // Files of more vertices than 32 bits can count are refused when their header is written.
    by_first.drain(|row| {
        let own: [u32; 4] = std::array::from_fn(|i| row[i]);
        if last != Some(own) {
            mixer.put()?;
            let first = whole(own[0], own[1]);
            if rest.next <= first {
                let [v0, v1] = halves(rest.next);
                by_vertex.push([v0, v1, COUNTED_FROM, n_vertices as u32])?;
                n_vertices += rest.copy_up_to(first, &mut mixer.out)?;
                rest.next = first + 1;
            }
            last = Some(own);
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
    let mut count_up_to = |end: u64, number: &mut u32, numbers: &mut Spool| {
        while v < end {
            numbers.write(&number.to_le_bytes())?;
            (v, *number) = (v + 1, number.wrapping_add(1));
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
    Ok((mixer.out.finish(path)?, numbers.finish(path)?, n_vertices))
}

/// Kinds of numbers: that of the next vertex that is not joined, that of this vertex.
const COUNTED_FROM: u32 = 0;
const ITSELF: u32 = 1;

/// Vertices that are not joined.
struct Rest<'a> {
    source: &'a MeshSource,
    /// Numbers of those that are, and how many of them are passed.
    joined: RawFile,
    n_passed: u64,
    window: Vec<u64>,
    window_at: Option<u64>,
    block: VertexBlock,
    loaded: Option<u64>,
    /// The first that is not copied yet.
    next: u64,
}

impl<'a> Rest<'a> {
    fn new(source: &'a MeshSource, joined: RawFile) -> Rest<'a> {
        let (window, block) = (Vec::new(), VertexBlock::default());
        Rest { source, joined, n_passed: 0, window, window_at: None, block, loaded: None, next: 0 }
    }

    /// The first joined vertex from `next` on.
    fn next_joined(&mut self) -> Result<Option<u64>> {
        const AT_ONCE: u64 = 1 << 14;
        let n = self.joined.len() / 8;
        while self.n_passed < n {
            let start = self.n_passed / AT_ONCE * AT_ONCE;
            if self.window_at.replace(start) != Some(start) {
                self.window.resize((n - start).min(AT_ONCE) as usize, 0);
                self.joined.read_exact_at(bytemuck::cast_slice_mut(&mut self.window), 8 * start)?;
            }
            let v = self.window[(self.n_passed - start) as usize];
            if v >= self.next {
                return Ok(Some(v));
            }
            self.n_passed += 1;
        }
        Ok(None)
    }

    /// Copies those up to a vertex; returns how many.
    fn copy_up_to(&mut self, end: u64, out: &mut Spool) -> Result<u64> {
        let n_bytes = self.source.schema().record_bytes();
        let mut n = 0;
        while self.next < end {
            let joined = self.next_joined()?;
            if joined == Some(self.next) {
                self.next += 1;
                continue;
            }
            let index = self.next / BLOCK_ROWS;
            if self.loaded.replace(index) != Some(index) {
                self.source.read_vertices(index, &mut self.block)?;
            }
            let stop = joined.unwrap_or(end).min(end).min((index + 1) * BLOCK_ROWS);
            let from = (self.next - index * BLOCK_ROWS) as usize * n_bytes;
            let to = (stop - index * BLOCK_ROWS) as usize * n_bytes;
            out.write(&self.block.records[from..to])?;
            n += stop - self.next;
            self.next = stop;
        }
        Ok(n)
    }
}

/// New numbers of vertices, some pages of which are in memory.
struct Numbers {
    file: RawFile,
    pages: Vec<(u64, Vec<u32>)>,
}

impl Numbers {
    /// Pages kept, and numbers of each: 4 MiB in all.
    const PAGES: u64 = 1024;
    const ROWS: u64 = 1024;

    fn new(file: RawFile) -> Numbers {
        Numbers { file, pages: vec![(u64::MAX, Vec::new()); Self::PAGES as usize] }
    }

    #[inline]
    fn get(&mut self, v: u64) -> Result<u32> {
        let page = v / Self::ROWS;
        let (kept, rows) = &mut self.pages[(page % Self::PAGES) as usize];
        if *kept != page {
            // A page that failed to load must not be taken for a loaded one.
            *kept = u64::MAX;
            let at = 4 * page * Self::ROWS;
            let n = (self.file.len() - at).min(4 * Self::ROWS) as usize;
            rows.resize(n / 4, 0);
            self.file.read_exact_at(bytemuck::cast_slice_mut(rows), at)?;
            *kept = page;
        }
        Ok(rows[(v % Self::ROWS) as usize])
    }
}

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
fn note(report: &WeldReport, source: &MeshSource) -> String {
    format!(
        "{} of {} vertices of {} triangles lay within {:.1e} of another and were joined; --weld off leaves them apart",
        show_count(report.joined),
        show_count(report.vertices),
        show_count(source.n_triangles()),
        report.distance
    )
}
