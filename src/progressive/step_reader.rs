//! Steps out of columns, checked and taken. Nothing that is read is trusted.

use super::columns::{Planes, beside, read, unzigzag};
use super::frame::Frame;
use super::replay::{NONE, Order, Ranks, Replay};
use super::steps::{
    ARCS, BITS_IN_BYTE, BY_BITS, Columns, FREED_BYTES, INDEX_BYTES, KEYS_BYTES, Layout,
    MOST_IN_BYTE, OTHER, Other, PLACES_BYTES, SPLIT, Split, arc_column, first_key, side, turned,
};
use stonecut_system::error::Result;

/// No step changes more triangles or vertices than this, besides those around a vertex.
const MOST_OTHERS: u32 = 1 << 16;

/// A step that was read and checked.
pub(super) enum Taken {
    Split(Split),
    Other(Other),
}

impl Taken {
    /// Triangles that it adds.
    fn freed(&self) -> i64 {
        match self {
            Taken::Split(split) => split.gone.len() as i64,
            Taken::Other(other) => other.freed(),
        }
    }

    /// Takes it.
    pub(super) fn carry_out(&self, replay: &mut Replay) {
        match self {
            Taken::Split(split) => split.carry_out(replay),
            Taken::Other(other) => other.carry_out(replay),
        }
    }
}

/// A block of steps that was read. Nothing in it is trusted.
pub(super) struct StepReader<'a> {
    layout: Layout<'a>,
    columns: Columns,
    /// Steps taken, splits among them, and bytes of `extra` that were used.
    at: usize,
    splits: usize,
    used: usize,
    /// Bytes of each column of fans that were used, those of long ones last.
    arcs: [usize; ARCS + 1],
    ranks: Ranks,
    last_rank: u32,
}

impl<'a> StepReader<'a> {
    /// Takes the columns of `n` steps out of a block. `ranks`: of the vertices that are there, for compact files.
    pub(super) fn new(
        mut bytes: &[u8],
        n: usize,
        layout: Layout<'a>,
        ranks: Ranks,
    ) -> Result<Self, String> {
        let input = &mut bytes;
        let kinds = read(input)?;
        if kinds.len() != n || kinds.iter().any(|&kind| kind > OTHER) {
            return Err(format!("{} steps of known kinds were expected", n));
        }
        let n_splits = kinds.iter().filter(|&&kind| kind == SPLIT).count();
        let stride = layout.rows.stride();
        let skipped = if layout.has_keys { 0 } else { layout.rows.place_bytes() };
        let columns = Columns {
            kinds,
            freed: Planes::read(input, n, FREED_BYTES)?,
            kept: Planes::read(input, n_splits, INDEX_BYTES)?,
            arcs: {
                let mut arcs: [Vec<u8>; ARCS] = Default::default();
                for arc in &mut arcs {
                    *arc = read(input)?;
                }
                arcs
            },
            long_arcs: read(input)?,
            shapes: read(input)?,
            extra: read(input)?,
            keys: match layout.has_keys {
                true => Planes::read(input, n_splits, KEYS_BYTES)?,
                false => Planes::default(),
            },
            places: match layout.has_keys {
                true => Planes::default(),
                false => Planes::read(input, n_splits, PLACES_BYTES)?,
            },
            of_kept: Planes::read_from(input, n_splits, skipped, stride)?,
            of_new: Planes::read_from(input, n_splits, skipped, stride)?,
        };
        if columns.shapes.len() != n_splits || !input.is_empty() {
            return Err("columns do not fit each other".to_owned());
        }
        Ok(StepReader {
            layout,
            columns,
            at: 0,
            splits: 0,
            used: 0,
            arcs: [0; ARCS + 1],
            ranks,
            last_rank: 0,
        })
    }

    /// Triangles that each step adds.
    pub(super) fn freed(&self) -> impl Iterator<Item = i64> {
        (0..self.columns.kinds.len()).map(|i| self.freed_by(i))
    }

    fn freed_by(&self, i: usize) -> i64 {
        i64::from(unzigzag(self.columns.freed.get(i), 16) as u16 as i16)
    }

    fn bytes(&mut self, n: usize) -> Result<&[u8], String> {
        let end = self.used.saturating_add(n);
        let found = self.columns.extra.get(self.used..end).ok_or("too few numbers")?;
        self.used = end;
        Ok(found)
    }

    /// The fan of the next split, whose vertex has `n` triangles: its beginning and its length.
    fn arc(&mut self, n: usize, order: Order) -> Result<(usize, u8), String> {
        let is_short = n <= MOST_IN_BYTE && order != Order::None;
        let i = if is_short { arc_column(n) } else { ARCS };
        let column = self.columns.arcs.get(i).unwrap_or(&self.columns.long_arcs);
        let left = column.get(self.arcs[i]..).unwrap_or_default();
        let (arc, used) = match *left {
            [BITS_IN_BYTE, ..] if is_short => ((0, BY_BITS), 1),
            [byte, ..] if is_short => ((usize::from(byte >> 4), byte & 15), 1),
            [start, length, ..] if !is_short => ((usize::from(start), length), 2),
            _ => return Err("too few fans".to_owned()),
        };
        self.arcs[i] += used;
        Ok(arc)
    }

    fn number(&mut self) -> Result<u32, String> {
        let bytes = self.bytes(4)?.first_chunk().ok_or("too few numbers")?;
        Ok(u32::from_le_bytes(*bytes))
    }

    fn numbers<const N: usize>(&mut self) -> Result<[u32; N], String> {
        let mut out = [0; N];
        for x in &mut out {
            *x = self.number()?;
        }
        Ok(out)
    }

    fn count(&mut self) -> Result<usize, String> {
        match self.number()? {
            n if n <= MOST_OTHERS => Ok(n as usize),
            n => Err(format!("{n} things in one step")),
        }
    }

    /// Reads the next step, which is to be taken on `replay`.
    pub(super) fn next(&mut self, replay: &Replay) -> Result<Taken, String> {
        let at = self.at;
        self.at += 1;
        let step = match self.columns.kinds.get(at) {
            Some(&SPLIT) => Taken::Split(self.split(replay)?),
            Some(_) => Taken::Other(self.other(replay)?),
            None => return Err("too few steps".to_owned()),
        };
        match step.freed() == self.freed_by(at) {
            true => Ok(step),
            false => Err("a step adds another number of triangles than it says".to_owned()),
        }
    }

    fn split(&mut self, replay: &Replay) -> Result<Split, String> {
        let i = self.splits;
        self.splits += 1;
        let new = replay.keys.len() as u32;
        let number = self.columns.kept.get(i) as u32;
        let kept = match self.layout.has_keys {
            true => number,
            false => {
                self.last_rank = self.last_rank.wrapping_add(number);
                self.ranks.vertex(self.last_rank)
            }
        };
        if kept >= new {
            return Err(format!("vertex {kept} of {new} is split"));
        }
        let around = replay.around(kept);
        let n = around.triangles.len();
        let (start, length) = self.arc(n, around.order)?;
        let mut fan: Vec<u32> = if length == BY_BITS {
            if self.number()? as usize != n {
                return Err("another number of triangles is around a vertex".to_owned());
            }
            let bits = self.bytes(n.div_ceil(8))?;
            let is_moved = |i: &usize| bits[i / 8] >> (i % 8) & 1 == 1;
            (0..n).filter(is_moved).map(|i| around.triangles[i]).collect()
        } else {
            let length = usize::from(length);
            let fits = match around.order {
                Order::Closed => start < n && length <= n,
                Order::Open => start + length <= n,
                Order::None => false,
            };
            if !fits {
                return Err("triangles around a vertex are named that are not there".to_owned());
            }
            around.arc(start, length).map(|i| around.triangles[i]).collect()
        };
        fan.sort_unstable();
        let shape = self.columns.shapes[i];
        let mut gone: Vec<([u32; 3], u32)> = Vec::new();
        if shape == 0 {
            for _ in 0..self.count()? {
                let t = self.numbers()?;
                check_corners(t, new + 1)?;
                gone.push((t, 0));
            }
        } else {
            let sides = match length {
                BY_BITS => None,
                length => around.sides(start, usize::from(length)),
            };
            let sides = sides.ok_or("a split has no sides")?;
            for (k, turn) in [(0, shape / 4 % 3), (1, shape / 12 % 3)] {
                if shape >> k & 1 == 1 {
                    let t = turned(side(k, sides[k], kept, new), usize::from(turn));
                    check_corners(t, new + 1)?;
                    gone.push((t, 0));
                }
            }
        }
        let mut keys = [new, kept];
        if self.layout.has_keys {
            let mut bytes = [0; KEYS_BYTES];
            self.columns.keys.get_bytes(i, 0, &mut bytes);
            let difference =
                |k: usize| u32::from_le_bytes([0, 1, 2, 3].map(|byte| bytes[4 * k + byte]));
            let (base, own) = (first_key(replay, &around.triangles), replay.keys[kept as usize]);
            keys = [0, 1].map(|k| beside(difference(k), own));
            for (k, t) in gone.iter_mut().enumerate().take(2) {
                t.1 = beside(difference(2 + k), base);
            }
        }
        let rows = self.layout.rows;
        let is_arc = length != BY_BITS && shape != 0;
        let frame = match is_arc && !self.layout.has_keys {
            true => Frame::new(rows, replay, (kept, &around), (start, usize::from(length))),
            false => Frame::plain(rows.place(replay.row(kept))),
        };
        let before = replay.row(kept);
        let (mut of_kept, mut of_new) = (before.to_vec(), vec![0; rows.stride()]);
        let told = |first: usize| {
            let mut bytes = [0; PLACES_BYTES / 2];
            self.columns.places.get_bytes(i, first, &mut bytes);
            let number = |k: usize| [0, 1, 2, 3].map(|byte| bytes[4 * k + byte]);
            [0, 1, 2].map(|k| beside(u32::from_le_bytes(number(k)), 0) as i32)
        };
        rows.pull(&self.columns.of_kept, i, before, &mut of_kept);
        let mut guess = vec![0; rows.stride()];
        if !self.layout.has_keys {
            rows.set_place(&mut of_kept, frame.hear(told(0), None));
        }
        rows.opposite(before, &of_kept, &mut guess);
        rows.pull(&self.columns.of_new, i, &guess, &mut of_new);
        if !self.layout.has_keys {
            let heard = frame.hear(told(PLACES_BYTES / 2), Some(rows.place(&of_kept)));
            rows.set_place(&mut of_new, heard);
        }
        Ok(Split { kept, fan, gone, keys, rows: [of_new, of_kept] })
    }

    fn other(&mut self, replay: &Replay) -> Result<Other, String> {
        let (n_vertices, n_triangles, has_join) = (self.count()?, self.count()?, self.number()?);
        let first = replay.keys.len() as u32;
        let end = first + n_vertices as u32;
        let mut other =
            Other { rows: self.bytes(n_vertices * replay.stride)?.to_vec(), ..Other::default() };
        for i in 0..n_vertices as u32 {
            let key = if self.layout.has_keys { self.number()? } else { first + i };
            other.keys.push(key);
        }
        for _ in 0..n_triangles {
            let t = self.numbers()?;
            check_corners(t, end)?;
            let key = if self.layout.has_keys { self.number()? } else { 0 };
            other.triangles.push((t, key));
        }
        if has_join > 0 {
            let (cycle, new, caps) = (self.numbers()?, self.numbers()?, self.numbers::<2>()?);
            let mut vertices: Vec<u32> = cycle.into_iter().chain(new).collect();
            vertices.sort_unstable();
            vertices.dedup();
            let n_before = replay.triangles.len() as u32;
            let is_there = |t: u32| match t.checked_sub(n_before) {
                Some(i) => (i as usize) < n_triangles,
                None => replay.has_triangle(t),
            };
            if vertices.len() < 6
                || vertices.iter().any(|&v| v >= end)
                || caps[0] == caps[1]
                || !caps.into_iter().all(is_there)
            {
                return Err("a cut is taken back that is not there".to_owned());
            }
            other.join = Some((cycle, new, caps));
        }
        Ok(other)
    }
}

fn check_corners(t: [u32; 3], end: u32) -> Result<(), String> {
    let is_proper = t[0] != t[1] && t[1] != t[2] && t[2] != t[0];
    match is_proper && t.iter().all(|&v| v < end && v != NONE) {
        true => Ok(()),
        false => Err(format!("a triangle has the corners {t:?} of {end} vertices")),
    }
}
