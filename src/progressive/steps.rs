//! Steps from coarse to fine as columns: what a step says is relative to the mesh it is taken on.
//!
//! A split says which vertex is split, which of the triangles around it go to the new vertex, which triangles appear
//! between the two, and what both vertices carry. Where the triangles around the vertex are in order, two small numbers
//! say all of the second, and one number all of the third. Anything else is spelt out.

use super::columns::{Planes, apart, write, zigzag};
use super::frame::Frame;
use super::replay::{Order, Ranks, Replay};
use super::rows::Rows;

/// Kinds of steps.
pub(super) const SPLIT: u8 = 0;
pub(super) const OTHER: u8 = 1;

/// Stands for a length where triangles are told by a bit each.
pub(super) const BY_BITS: u8 = 255;

/// A vertex split: the inverse of a collapse. Corners are vertices of the replay, or `Replay::keys.len()` for the new one.
pub(super) struct Split {
    pub(super) kept: u32,
    /// Triangles that go from it to the new vertex, in order.
    pub(super) fan: Vec<u32>,
    /// New triangles and their keys; two at most.
    pub(super) gone: Vec<([u32; 3], u32)>,
    /// Keys of the new vertex and of `kept`.
    pub(super) keys: [u32; 2],
    /// Rows of both.
    pub(super) rows: [Vec<u8>; 2],
}

/// Any other step: vertices and triangles appear, then a cut may be taken back.
#[derive(Default)]
pub(super) struct Other {
    pub(super) rows: Vec<u8>,
    pub(super) keys: Vec<u32>,
    /// Corners may be the new vertices.
    pub(super) triangles: Vec<([u32; 3], u32)>,
    /// Vertices of the cut, those that go, and caps.
    pub(super) join: Option<([u32; 3], [u32; 3], [u32; 2])>,
}

impl Split {
    /// Takes it.
    pub(super) fn carry_out(&self, replay: &mut Replay) {
        let kept = self.kept;
        let new = replay.add_vertex(&self.rows[0], self.keys[0]);
        replay.set_row(kept, &self.rows[1]);
        replay.keys[kept as usize] = self.keys[1];
        replay.move_corners(kept, new, |t| self.fan.binary_search(&t).is_ok());
        for &(t, key) in &self.gone {
            replay.add_triangle(t, key);
        }
    }
}

impl Other {
    /// Takes it.
    pub(super) fn carry_out(&self, replay: &mut Replay) {
        let stride = replay.stride;
        for (i, &key) in self.keys.iter().enumerate() {
            replay.add_vertex(&self.rows[i * stride..(i + 1) * stride], key);
        }
        for &(t, key) in &self.triangles {
            replay.add_triangle(t, key);
        }
        if let Some((cycle, new, caps)) = self.join {
            replay.join(cycle, new, caps);
        }
    }

    /// Triangles that it adds.
    pub(super) fn freed(&self) -> i64 {
        self.triangles.len() as i64 - if self.join.is_some() { 2 } else { 0 }
    }
}

/// Facts that the columns depend on.
#[derive(Clone, Copy)]
pub(super) struct Layout<'a> {
    pub(super) rows: &'a Rows,
    /// True if vertices and triangles have places in an order; otherwise splits come in the order of their vertices' ranks.
    pub(super) has_keys: bool,
}

/// The columns of a block.
pub(super) struct Columns {
    pub(super) kinds: Vec<u8>,
    pub(super) freed: Planes,
    pub(super) kept: Planes,
    /// Fans by the number of triangles around their vertex, and those of more than fifteen.
    pub(super) arcs: [Vec<u8>; ARCS],
    pub(super) long_arcs: Vec<u8>,
    pub(super) shapes: Vec<u8>,
    pub(super) keys: Planes,
    /// Compact: places of both ends in their frames.
    pub(super) places: Planes,
    pub(super) of_kept: Planes,
    pub(super) of_new: Planes,
    pub(super) extra: Vec<u8>,
}

/// Fans have a column for each number of triangles around their vertex, from `FEWEST` or fewer to as many as fit.
pub(super) const ARCS: usize = 8;
const FEWEST: usize = 4;
/// Fans around vertices of more triangles take two bytes.
pub(super) const MOST_IN_BYTE: usize = 15;
/// In place of a fan in one byte: triangles are told by a bit each.
pub(super) const BITS_IN_BYTE: u8 = 0xFF;

/// The column of a fan around a vertex of `n` triangles.
pub(super) fn arc_column(n: usize) -> usize {
    n.clamp(FEWEST, FEWEST + ARCS - 1) - FEWEST
}

/// Width of the places of both ends: six numbers.
pub(super) const PLACES_BYTES: usize = 24;

/// Widths: of a count of triangles, an index, and the keys of two vertices and two triangles.
pub(super) const FREED_BYTES: usize = 2;
pub(super) const INDEX_BYTES: usize = 4;
pub(super) const KEYS_BYTES: usize = 16;

/// Bytes that columns take, by their meaning.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Spent {
    /// Vertices that are split, and the triangles that go.
    pub connectivity: u64,
    /// Places in the order of the output.
    pub order: u64,
    /// Positions and other values.
    pub values: u64,
}

/// A block of steps that is being written.
pub(super) struct StepWriter<'a> {
    layout: Layout<'a>,
    columns: Columns,
    ranks: Ranks,
    last_rank: u32,
}

/// The corners of a new triangle on one side of a split: on the first side of the fan, or on the second.
pub(super) fn side(i: usize, rim: u32, kept: u32, new: u32) -> [u32; 3] {
    if i == 0 { [new, kept, rim] } else { [new, rim, kept] }
}

pub(super) fn turned(t: [u32; 3], by: usize) -> [u32; 3] {
    std::array::from_fn(|k| t[(k + 3 - by) % 3])
}

impl<'a> StepWriter<'a> {
    /// `ranks`: of the vertices that are there, for compact files.
    pub(super) fn new(layout: Layout<'a>, ranks: Ranks) -> StepWriter<'a> {
        let stride = layout.rows.stride();
        StepWriter {
            layout,
            columns: Columns {
                kinds: Vec::new(),
                freed: Planes::new(FREED_BYTES),
                kept: Planes::new(INDEX_BYTES),
                arcs: Default::default(),
                long_arcs: Vec::new(),
                shapes: Vec::new(),
                keys: Planes::new(KEYS_BYTES),
                places: Planes::new(PLACES_BYTES),
                of_kept: Planes::new(stride),
                of_new: Planes::new(stride),
                extra: Vec::new(),
            },
            ranks,
            last_rank: 0,
        }
    }

    /// Rank of a vertex that is split.
    pub(super) fn rank(&self, vertex: u32) -> u32 {
        self.ranks.of(vertex)
    }

    /// Steps so far.
    pub(super) fn len(&self) -> usize {
        self.columns.kinds.len()
    }

    fn extra(&mut self, x: u32) {
        self.columns.extra.extend(x.to_le_bytes());
    }

    fn begin(&mut self, kind: u8, freed: i64) {
        self.columns.kinds.push(kind);
        self.columns.freed.push(zigzag(freed as u64, 16));
    }

    /// Takes a split; returns the order in which `gone` became triangles.
    pub(super) fn split(&mut self, replay: &mut Replay, mut split: Split) -> Vec<usize> {
        let new = replay.keys.len() as u32;
        let kept = split.kept;
        self.begin(SPLIT, split.gone.len() as i64);
        let difference = match self.layout.has_keys {
            true => kept,
            false => {
                let rank = self.ranks.of(kept);
                rank.wrapping_sub(std::mem::replace(&mut self.last_rank, rank))
            }
        };
        self.columns.kept.push(u64::from(difference));
        let around = replay.around(kept);
        let n = around.triangles.len();
        let is_moved: Vec<bool> =
            around.triangles.iter().map(|t| split.fan.binary_search(t).is_ok()).collect();
        let length = is_moved.iter().filter(|&&moved| moved).count();
        let starts = match around.order {
            Order::None => 0..0,
            Order::Closed => 0..n,
            Order::Open => 0..n + 1 - length,
        };
        let is_arc = |&start: &usize| around.arc(start, length).all(|i| is_moved[i]);
        // Where no triangle goes, the place on the rim is that of the new triangle.
        let sides_of = |start: usize| {
            let sides = around.sides(start, length)?;
            let of = |t: &[u32; 3]| {
                (0..6).find(|&at| turned(side(at / 3, sides[at / 3], kept, new), at % 3) == *t)
            };
            let mut at: Vec<(usize, usize)> = split
                .gone
                .iter()
                .enumerate()
                .map(|(i, (t, _))| of(t).map(|at| (at, i)))
                .collect::<Option<_>>()?;
            at.sort_unstable();
            let is_each_once = at.chunk_by(|a, b| a.0 / 3 == b.0 / 3).all(|one| one.len() == 1);
            (is_each_once && !at.is_empty()).then_some(at)
        };
        let found = starts.clone().filter(is_arc).find_map(|start| Some((start, sides_of(start)?)));
        let start = found.as_ref().map(|found| found.0).or_else(|| starts.clone().find(is_arc));
        match start {
            Some(start) => match n <= MOST_IN_BYTE {
                true => self.columns.arcs[arc_column(n)].push((start << 4 | length) as u8),
                false => self.columns.long_arcs.extend([start as u8, length as u8]),
            },
            None => {
                match n <= MOST_IN_BYTE && around.order != Order::None {
                    true => self.columns.arcs[arc_column(n)].push(BITS_IN_BYTE),
                    false => self.columns.long_arcs.extend([0, BY_BITS]),
                }
                self.extra(n as u32);
                for eight in is_moved.chunks(8) {
                    let bits =
                        eight.iter().rev().fold(0u8, |bits, &moved| bits << 1 | u8::from(moved));
                    self.columns.extra.push(bits);
                }
            }
        }
        let order: Vec<usize> = match &found {
            Some((_, sides)) => {
                let (mut shape, mut factor) = (0, [4, 12]);
                for &(at, _) in sides {
                    let turn = if self.layout.has_keys { at % 3 } else { 0 };
                    shape += (1 << (at / 3)) + factor[at / 3] * turn as u8;
                    factor[at / 3] = 0;
                }
                self.columns.shapes.push(shape);
                sides.iter().map(|&(_, i)| i).collect()
            }
            None => {
                self.columns.shapes.push(0);
                self.extra(split.gone.len() as u32);
                for (t, _) in &split.gone {
                    t.iter().for_each(|&v| self.extra(v));
                }
                (0..split.gone.len()).collect()
            }
        };
        let turn = |i: usize| match &found {
            // Without an order corners begin with the new vertex.
            Some((_, sides)) if !self.layout.has_keys => {
                let at = sides.iter().find(|side| side.1 == i).map_or(0, |side| side.0 % 3);
                turned(split.gone[i].0, (3 - at) % 3)
            }
            _ => split.gone[i].0,
        };
        let gone: Vec<([u32; 3], u32)> =
            order.iter().map(|&i| (turn(i), split.gone[i].1)).collect();
        if self.layout.has_keys {
            let base = first_key(replay, &around.triangles);
            let key = |i: usize| gone.get(i).map_or(0, |t| apart(t.1, base));
            let [of_new, of_kept] = split.keys.map(|key| apart(key, replay.keys[kept as usize]));
            let bytes: Vec<u8> =
                [of_new, of_kept, key(0), key(1)].iter().flat_map(|x| x.to_le_bytes()).collect();
            self.columns.keys.push_bytes(&bytes);
        }
        let frame = match (self.layout.has_keys, start, &found) {
            (false, Some(start), Some(_)) => {
                Frame::new(self.layout.rows, replay, (kept, &around), (start, length))
            }
            _ => Frame::plain(self.layout.rows.place(replay.row(kept))),
        };
        self.put_rows(replay, &mut split, &frame);
        Split { gone, ..split }.carry_out(replay);
        order
    }

    /// Puts the values of both ends into the columns, and makes the rows those that a reader gets.
    fn put_rows(&mut self, replay: &Replay, split: &mut Split, frame: &Frame) {
        let rows = self.layout.rows;
        let before = replay.row(split.kept);
        let [of_new, of_kept] = &mut split.rows;
        if !self.layout.has_keys {
            let mut told = frame.tell(rows.place(of_kept), None).to_vec();
            rows.set_place(of_kept, frame.hear([told[0], told[1], told[2]], None));
            let kept = rows.place(of_kept);
            told.extend(frame.tell(rows.place(of_new), Some(kept)));
            let heard = [told[3], told[4], told[5]];
            rows.set_place(of_new, frame.hear(heard, Some(kept)));
            let bytes: Vec<u8> =
                told.iter().flat_map(|&x| apart(x as u32, 0).to_le_bytes()).collect();
            self.columns.places.push_bytes(&bytes);
        }
        rows.push(of_kept, before, &mut self.columns.of_kept);
        let mut guess = vec![0; rows.stride()];
        rows.opposite(before, of_kept, &mut guess);
        rows.push(of_new, &guess, &mut self.columns.of_new);
    }

    /// Takes another step.
    pub(super) fn other(&mut self, replay: &mut Replay, other: &Other) {
        let freed = other.freed();
        self.begin(OTHER, freed);
        let counts = [other.keys.len(), other.triangles.len(), usize::from(other.join.is_some())];
        counts.into_iter().for_each(|n| self.extra(n as u32));
        self.columns.extra.extend_from_slice(&other.rows);
        if self.layout.has_keys {
            other.keys.iter().for_each(|&key| self.extra(key));
        }
        for &(t, key) in &other.triangles {
            t.into_iter().for_each(|v| self.extra(v));
            if self.layout.has_keys {
                self.extra(key);
            }
        }
        if let Some((cycle, new, caps)) = other.join {
            cycle.into_iter().chain(new).chain(caps).for_each(|x| self.extra(x));
        }
        other.carry_out(replay);
    }

    /// The block's bytes.
    pub(super) fn finish(self, spent: &mut Spent) -> Vec<u8> {
        let columns = self.columns;
        let mut out = Vec::new();
        write(&columns.kinds, &mut out);
        columns.freed.write(&mut out);
        columns.kept.write(&mut out);
        let lists = [&columns.long_arcs, &columns.shapes, &columns.extra];
        columns.arcs.iter().chain(lists).for_each(|column| write(column, &mut out));
        spent.connectivity += out.len() as u64;
        let before = out.len();
        if self.layout.has_keys {
            columns.keys.write(&mut out);
        }
        spent.order += (out.len() - before) as u64;
        let before = out.len();
        // Places that frames tell are not told again.
        let skipped = match self.layout.has_keys {
            true => 0,
            false => {
                columns.places.write(&mut out);
                self.layout.rows.place_bytes()
            }
        };
        columns.of_kept.write_from(skipped, &mut out);
        columns.of_new.write_from(skipped, &mut out);
        spent.values += (out.len() - before) as u64;
        out
    }
}

pub(super) fn first_key(replay: &Replay, around: &[u32]) -> u32 {
    around.first().map_or(0, |&t| replay.triangle_keys[t as usize])
}
