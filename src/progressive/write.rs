//! Writes a progressive mesh from the history of a run, coarse to fine.
//!
//! Takes the steps back on a `Replay` while it tells them, and holds the end against the numbers that the history had.

use super::columns::{Planes, apart};
use super::file::{Head, Kind, write_block, write_head};
use super::order;
use super::replay::{NONE, Ranks, Replay};
use super::rows::{Extremes, Rows};
use super::steps::{Layout, Other, Spent, Split, StepWriter};
use std::collections::BTreeMap;
use stonecut_kernel::{Cursor, History, Step};
use stonecut_mesh::record::VertexSchema;
use stonecut_mesh::vec3::Vec3;
use stonecut_system::error::{Error, Result};
use stonecut_system::pending_file::{PendingFile, Place};

/// Vertices or triangles of the base in a block.
const BASE_BLOCK: usize = 1 << 16;

/// Encodes the record of a vertex from its input vertex, place and channels.
pub type Encode<'a> = &'a dyn Fn(u32, Vec3, &[f32], &mut Vec<u8>);

/// The original of a progressive mesh, besides its steps.
#[derive(Clone, Copy)]
pub struct Original<'a> {
    /// Records of vertices in outputs.
    pub schema: &'a VertexSchema,
    /// Makes such a record.
    pub encode: Encode<'a>,
    /// Comments of the input.
    pub comments: &'a [String],
    /// `obj_info` of the input.
    pub obj_infos: &'a [String],
    /// Settings of the run.
    pub settings: &'a BTreeMap<String, String>,
    /// Bits of coordinates and other floats; `None`: bit by bit, and the order of direct runs.
    pub bits: Option<u32>,
}

/// Result of writing.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Written {
    /// Bytes of the file.
    pub bytes: u64,
    /// Of these, bytes of steps, by their meaning.
    pub spent: Spent,
    /// Steps.
    pub steps: u64,
    /// Vertices that the steps add.
    pub vertices: u64,
    /// Triangles of the finest mesh.
    pub finest: u64,
}

/// The replay with the numbers that the history has.
struct Teller<'a> {
    history: &'a History,
    original: Original<'a>,
    layout: Layout<'a>,
    replay: Replay,
    /// Numbers in the replay of vertices and triangles of the history.
    vertex: Vec<u32>,
    triangle: Vec<u32>,
    record: Vec<u8>,
}

/// Writes the file. `check` ends it early with an error.
///
/// Memory: that of the finest mesh, about 48 bytes a triangle, besides the history.
pub fn write(
    place: Place,
    history: &History,
    original: Original,
    check: &dyn Fn() -> Result<()>,
) -> Result<Written> {
    let left: Vec<(u32, [u32; 3])> = history.left().collect();
    let mut used: Vec<(u32, u32)> = left.iter().flat_map(|(_, t)| t).map(|&v| (v, 0)).collect();
    used.iter_mut().for_each(|v| *v = (history.source[v.0 as usize], v.0));
    used.sort_unstable();
    used.dedup();
    let steps = history.back();
    let (n_steps, base) = (steps.len() as u64, left.len() as u64);
    let (finest, rows) = survey(history, original, &used, &steps);
    let head = Head {
        program: format!("stonecut {}", env!("CARGO_PKG_VERSION")),
        bits: original.bits,
        rows,
        comments: original.comments.to_vec(),
        obj_infos: original.obj_infos.to_vec(),
        settings: original.settings.clone(),
        base_triangles: base,
        base_vertices: used.len() as u64,
        finest_triangles: finest,
        steps: n_steps,
    };
    let blocks = match original.bits {
        None => order::in_order(steps),
        Some(_) => order::in_batches(history, steps, used.len()),
    };
    let leasts = leasts(history, &blocks, base, original.bits.is_none());
    let mut file = PendingFile::create(place)?;
    write_head(&mut file, &head)?;
    let layout = Layout { rows: &head.rows, has_keys: original.bits.is_none() };
    let mut teller = Teller {
        history,
        original,
        layout,
        replay: Replay::new(head.rows.stride()),
        vertex: vec![NONE; history.positions.len()],
        triangle: vec![NONE; history.triangles.len()],
        record: Vec::new(),
    };
    teller.write_base(
        &mut file,
        &used,
        &left,
        leasts.first().copied().unwrap_or(base).min(base),
    )?;
    drop((used, left));
    let mut spent = Spent::default();
    let n_base = teller.replay.keys.len();
    for (block, &least) in blocks.into_iter().zip(&leasts) {
        check()?;
        let ranks = if layout.has_keys { Ranks::default() } else { teller.replay.ranks() };
        let mut out = StepWriter::new(layout, ranks);
        teller.tell(block, &mut out);
        let n = out.len();
        let payload = out.finish(&mut spent);
        write_block(&mut file, Kind::Steps, n, (teller.replay.n_triangles, least), &payload)?;
    }
    let n = teller.replay.n_triangles;
    if n != finest {
        return Err(Error::Internal(format!("{n} triangles at the end, {finest} expected")));
    }
    write_block(&mut file, Kind::End, 0, (n, n), &[])?;
    let vertices = (teller.replay.keys.len() - n_base) as u64;
    Ok(Written { bytes: file.finish()?, spent, steps: n_steps, vertices, finest })
}

/// Triangles of the finest mesh, and the layout of rows.
fn survey(
    history: &History,
    original: Original,
    used: &[(u32, u32)],
    steps: &[Cursor],
) -> (u64, Rows) {
    let mut finest = history.left().count() as i64;
    let schema = original.schema;
    let mut extremes = Extremes::new(schema);
    let mut record = Vec::new();
    let mut add = |source: u32, place: Vec3, channels: &[f32]| {
        if original.bits.is_some() {
            record.clear();
            (original.encode)(source, place, channels, &mut record);
            extremes.add(schema, &record);
        }
    };
    let add_last = |v: u32, add: &mut dyn FnMut(u32, Vec3, &[f32])| {
        let channels = history.channels_of(v);
        add(history.source[v as usize], history.positions[v as usize], channels);
    };
    used.iter().for_each(|&(_, v)| add_last(v, &mut add));
    for &cursor in steps {
        let step = history.step(cursor);
        finest += step.freed();
        match step {
            Step::Collapse { removed, sources, place, channels, .. } => {
                add(sources[1], place, channels);
                add_last(removed, &mut add);
            }
            Step::Vanish { gone } | Step::Cut { gone, .. } => {
                for v in gone.iter().flat_map(|&t| history.corners(t)) {
                    add_last(v, &mut add);
                }
            }
        }
    }
    let rows = match original.bits {
        None => Rows::exact(schema),
        Some(bits) => Rows::of_steps(schema, &extremes, bits),
    };
    (finest.max(0) as u64, rows)
}

/// For each block at most the fewest triangles behind any step in it or in later ones.
fn leasts(history: &History, blocks: &[Vec<Cursor>], base: u64, is_ordered: bool) -> Vec<u64> {
    let mut now = base as i64;
    let mut leasts: Vec<u64> = Vec::with_capacity(blocks.len());
    for block in blocks {
        let (start, mut least, mut falls) = (now, i64::MAX, 0);
        for &cursor in block {
            let freed = history.step(cursor).freed();
            now += freed;
            falls += freed.min(0);
            least = least.min(now);
        }
        // Steps of a batch come in another order: all that take triangles away may be the first.
        let least = if is_ordered { least } else { start + if falls < 0 { falls } else { 1 } };
        leasts.push(least.max(0) as u64);
    }
    let mut least = u64::MAX;
    for own in leasts.iter_mut().rev() {
        least = least.min(*own);
        *own = least;
    }
    leasts
}

impl Teller<'_> {
    fn put_row(&mut self, source: u32, place: Vec3, channels: &[f32], out: &mut Vec<u8>) {
        self.record.clear();
        (self.original.encode)(source, place, channels, &mut self.record);
        self.layout.rows.put_row(&self.record, out);
    }

    /// Appends the row of a vertex as it was last.
    fn put_last_row(&mut self, v: u32, out: &mut Vec<u8>) {
        let (history, i) = (self.history, v as usize);
        self.put_row(history.source[i], history.positions[i], history.channels_of(v), out);
    }

    fn write_base(
        &mut self,
        file: &mut PendingFile,
        used: &[(u32, u32)],
        left: &[(u32, [u32; 3])],
        least: u64,
    ) -> Result<()> {
        let (rows, has_keys) = (self.layout.rows, self.layout.has_keys);
        let mut last = vec![0; rows.stride()];
        let mut row = Vec::new();
        let mut last_key = 0;
        for block in used.chunks(BASE_BLOCK) {
            let (mut values, mut keys) = (Planes::new(rows.stride()), Planes::new(4));
            for &(key, v) in block {
                row.clear();
                self.put_last_row(v, &mut row);
                rows.push(&row, &last, &mut values);
                keys.push(u64::from(apart(key, last_key)));
                self.vertex[v as usize] = self.replay.add_vertex(&row, key);
                (last_key, last) = (key, row.clone());
            }
            let mut payload = Vec::new();
            values.write(&mut payload);
            if has_keys {
                keys.write(&mut payload);
            }
            write_block(file, Kind::Vertices, block.len(), (0, least), &payload)?;
        }
        let (mut last, mut last_key) = ([0; 3], 0);
        for block in left.chunks(BASE_BLOCK) {
            let (mut corners, mut keys) = (Planes::new(12), Planes::new(4));
            for &(key, t) in block {
                let t = t.map(|v| self.vertex[v as usize]);
                let differences: Vec<u8> =
                    (0..3).flat_map(|k| apart(t[k], last[k]).to_le_bytes()).collect();
                corners.push_bytes(&differences);
                keys.push(u64::from(apart(key, last_key)));
                self.triangle[key as usize] = self.replay.add_triangle(t, key);
                (last, last_key) = (t, key);
            }
            let mut payload = Vec::new();
            corners.write(&mut payload);
            if has_keys {
                keys.write(&mut payload);
            }
            let n = self.replay.n_triangles;
            write_block(file, Kind::Triangles, block.len(), (n, least), &payload)?;
        }
        Ok(())
    }

    /// Writes the steps of a block.
    fn tell(&mut self, mut block: Vec<Cursor>, out: &mut StepWriter) {
        let history = self.history;
        if !self.layout.has_keys {
            block.sort_by_cached_key(|&cursor| match history.step(cursor) {
                Step::Collapse { kept, .. } => (1, out.rank(self.vertex[kept as usize])),
                _ => (0, 0),
            });
        }
        for cursor in block {
            match history.step(cursor) {
                Step::Collapse { removed, kept, sources, place, channels, gone, fan } => {
                    // Vertices that no triangle is left around come back first.
                    let corners = gone.iter().flat_map(|&t| self.history.corners(t));
                    let missing: Vec<u32> = corners
                        .filter(|&v| v != removed && self.vertex[v as usize] == NONE)
                        .collect();
                    if !missing.is_empty() {
                        let mut other = Other::default();
                        self.appear(&missing, &mut other);
                        out.other(&mut self.replay, &other);
                    }
                    let (mut of_kept, mut of_new) = (Vec::new(), Vec::new());
                    self.put_row(sources[1], place, channels, &mut of_kept);
                    let i = removed as usize;
                    let last = self.history.channels_of(removed);
                    self.put_row(sources[0], self.history.positions[i], last, &mut of_new);
                    self.vertex[i] = self.replay.keys.len() as u32;
                    let mut fan: Vec<u32> =
                        fan.iter().map(|&t| self.triangle[t as usize]).collect();
                    fan.sort_unstable();
                    let of = |&t: &[u32; 2]| {
                        (self.history.corners(t).map(|v| self.vertex[v as usize]), t[0])
                    };
                    let corners: Vec<([u32; 3], u32)> = gone.iter().map(of).collect();
                    let kept = self.vertex[kept as usize];
                    let rows = [of_new, of_kept];
                    let split = Split { kept, fan, gone: corners, keys: sources, rows };
                    let first = self.replay.triangles.len() as u32;
                    let order = out.split(&mut self.replay, split);
                    for (place, i) in (first..).zip(order) {
                        self.triangle[gone[i][0] as usize] = place;
                    }
                }
                Step::Vanish { gone } => {
                    let other = self.appearing(gone);
                    out.other(&mut self.replay, &other);
                }
                Step::Cut { cycle, new, caps, gone } => {
                    let mut other = self.appearing(gone);
                    let of = |v: u32| self.vertex[v as usize];
                    other.join =
                        Some((cycle.map(of), new.map(of), caps.map(|t| self.triangle[t as usize])));
                    out.other(&mut self.replay, &other);
                }
            }
        }
    }

    /// Gives vertices numbers that follow those of the replay, and puts them into a step.
    fn appear(&mut self, vertices: &[u32], other: &mut Other) {
        for &v in vertices {
            if self.vertex[v as usize] == NONE {
                self.vertex[v as usize] = (self.replay.keys.len() + other.keys.len()) as u32;
                let mut row = Vec::new();
                self.put_last_row(v, &mut row);
                other.rows.extend(row);
                other.keys.push(self.history.source[v as usize]);
            }
        }
    }

    /// The step in which vanished triangles appear.
    fn appearing(&mut self, gone: &[[u32; 2]]) -> Other {
        let mut other = Other::default();
        let corners: Vec<u32> = gone.iter().flat_map(|&t| self.history.corners(t)).collect();
        self.appear(&corners, &mut other);
        for &t in gone {
            let corners = self.history.corners(t).map(|v| self.vertex[v as usize]);
            let number = (self.replay.triangles.len() + other.triangles.len()) as u32;
            self.triangle[t[0] as usize] = number;
            other.triangles.push((corners, t[0]));
        }
        other
    }
}
