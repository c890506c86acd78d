//! Reads a progressive mesh, as far as is asked for.

use super::columns::{Planes, beside};
use super::file::{BlockHead, BlockReader, Head, Kind};
use super::replay::{Ranks, Replay};
use super::rows::Rows;
use super::step_reader::{StepReader, Taken};
use super::steps::Layout;
use std::path::Path;
use stonecut_io::ply::raw::RawFile;
use stonecut_mesh::record::VertexSchema;
use stonecut_system::error::{Error, Result};
use stonecut_system::units::show_bytes;

/// No block holds more vertices, triangles or steps.
const MOST_IN_BLOCK: u32 = 1 << 20;

/// Blocks that are written have fewer.
const WRITTEN_IN_BLOCK: u64 = 1 << 16;

/// Sees a step, and the mesh that it is going to be taken on.
pub(super) type Watch<'a> = dyn FnMut(&Replay, &Taken) -> Result<()> + 'a;

/// A progressive mesh that was opened, at one of its meshes.
///
/// It begins with no triangles. Memory: values and 8 bytes for each vertex, 28 bytes for each triangle.
pub struct Refiner {
    blocks: BlockReader,
    head: Head,
    pub(super) replay: Replay,
    memory_bytes: u64,
    is_base_read: bool,
}

impl Refiner {
    /// Opens a file. Reading ends with `NoMemory` where a mesh would take more than `memory_bytes`.
    pub fn open(path: &Path, memory_bytes: u64) -> Result<Refiner> {
        Ok(Refiner::new(BlockReader::open(path)?, memory_bytes))
    }

    /// The same for the bytes of a file.
    pub fn of_bytes(bytes: Vec<u8>, memory_bytes: u64) -> Result<Refiner> {
        let file = RawFile::from_bytes("progressive mesh", bytes);
        Ok(Refiner::new(BlockReader::of(file)?, memory_bytes))
    }

    fn new((blocks, head): (BlockReader, Head), memory_bytes: u64) -> Refiner {
        let replay = Replay::new(head.rows.stride());
        Refiner { blocks, head, replay, memory_bytes, is_base_read: false }
    }

    /// The description of the file.
    pub fn head(&self) -> &Head {
        &self.head
    }

    /// Memory in bytes that a mesh of `n_triangles` takes while it is reached, about, and never less.
    pub fn expected_bytes(&self, n_triangles: u64) -> u64 {
        let Head { base_triangles, base_vertices, finest_triangles, steps, .. } = self.head;
        let n = n_triangles.clamp(base_triangles, finest_triangles.max(base_triangles));
        let range = finest_triangles.saturating_sub(base_triangles).max(1);
        let share = (n - base_triangles) as f64 / range as f64;
        // A step brings a vertex, some two.
        let vertices = base_vertices + (1.25 * share * steps as f64) as u64;
        let row = self.replay.stride as u64 + 8;
        vertices * row + 28 * n + WRITTEN_IN_BLOCK.min(steps) * (row + 2 * 28)
    }

    /// Records of vertices.
    pub fn schema(&self) -> &VertexSchema {
        &self.head.rows.schema
    }

    /// Triangles of the mesh at hand.
    pub fn n_triangles(&self) -> u64 {
        self.replay.n_triangles
    }

    /// Bytes of the file that were needed so far.
    pub fn bytes_read(&self) -> u64 {
        self.blocks.offset()
    }

    /// Goes to the finest mesh of at most `n` triangles, once: the coarsest if all have more. `check` ends it early.
    ///
    /// Errors: `BadInput` with block and byte offset if a block that is needed is missing or damaged, `NoMemory`.
    pub fn refine(&mut self, n: u64, check: &dyn Fn() -> Result<()>) -> Result<()> {
        self.refine_watched(n, check, &mut |_, _| Ok(()))
    }

    /// The same; `watch` sees each step before it is taken.
    pub(super) fn refine_watched(
        &mut self,
        n: u64,
        check: &dyn Fn() -> Result<()>,
        watch: &mut Watch,
    ) -> Result<()> {
        self.base(check)?;
        loop {
            check()?;
            let remedy = self.remedy();
            let head = match self.blocks.head(&remedy) {
                Ok(head) => head,
                // Nothing finer is needed, so that whatever follows may be missing.
                Err(Error::BadInput { .. }) if self.replay.n_triangles >= n => return Ok(()),
                Err(other) => return Err(other),
            };
            if head.kind == Kind::End || head.least > n {
                return Ok(());
            }
            if head.kind != Kind::Steps {
                return Err(self.blocks.bad(
                    self.blocks.offset(),
                    "a block of steps was expected",
                    &remedy,
                ));
            }
            let at = self.blocks.offset();
            let payload = self.read(&head, &remedy)?;
            let bad = |blocks: &BlockReader, what: &str| blocks.bad(at, what, &remedy);
            let layout = Layout { rows: &self.head.rows, has_keys: self.head.bits.is_none() };
            let ranks = if layout.has_keys { Ranks::default() } else { self.replay.ranks() };
            let mut steps = StepReader::new(&payload, head.n as usize, layout, ranks)
                .map_err(|what| bad(&self.blocks, &what))?;
            // As far as the last mesh that is small enough, if no later block has one.
            let most = i64::try_from(n).unwrap_or(i64::MAX);
            let mut now = self.replay.n_triangles as i64;
            let mut last = 0;
            for (i, freed) in steps.freed().enumerate() {
                now += freed;
                if now <= most {
                    last = i + 1;
                }
            }
            let is_whole = last == head.n as usize || {
                let next = self.peek()?;
                next.is_some_and(|next| next.kind == Kind::Steps && next.least <= n)
            };
            let end = if is_whole { head.n as usize } else { last };
            for _ in 0..end {
                let step = steps.next(&self.replay).map_err(|what| bad(&self.blocks, &what))?;
                watch(&self.replay, &step)?;
                step.carry_out(&mut self.replay);
            }
            self.blocks.number += 1;
            if !is_whole {
                return Ok(());
            }
            if self.replay.n_triangles != head.triangles {
                return Err(bad(
                    &self.blocks,
                    "the block gives another number of triangles than it says",
                ));
            }
        }
    }

    /// The head of the next block; `None` where the file is cut off, which matters once that block is needed.
    fn peek(&self) -> Result<Option<BlockHead>> {
        match self.blocks.head("") {
            Ok(head) => Ok(Some(head)),
            Err(Error::BadInput { .. }) => Ok(None),
            Err(other) => Err(other),
        }
    }

    fn remedy(&self) -> String {
        match self.replay.n_triangles >= self.head.base_triangles {
            true => format!(
                "what comes before is whole: --triangles {} or fewer can be had, or make the file again",
                self.replay.n_triangles
            ),
            false => "make the file again".to_owned(),
        }
    }

    /// Reads a block's bytes if the mesh behind it fits into memory.
    fn read(&mut self, head: &BlockHead, remedy: &str) -> Result<Vec<u8>> {
        if head.n > MOST_IN_BLOCK {
            return Err(self.blocks.bad(self.blocks.offset(), "no block holds that much", remedy));
        }
        let element = self.replay.stride as u64 + 8 + 2 * 28;
        let needed = self.replay.bytes() + u64::from(head.n) * element;
        if needed > self.memory_bytes {
            return Err(Error::NoMemory(format!(
                "a mesh of {} triangles needs more than {} of memory; ask for fewer triangles, or give more --memory",
                head.triangles.max(self.replay.n_triangles),
                show_bytes(self.memory_bytes)
            )));
        }
        self.blocks.payload(head, remedy)
    }

    /// Reads the coarsest mesh, once.
    pub(super) fn base(&mut self, check: &dyn Fn() -> Result<()>) -> Result<()> {
        if std::mem::replace(&mut self.is_base_read, true) {
            return Ok(());
        }
        let remedy = self.remedy();
        let Head { base_vertices, base_triangles, .. } = self.head;
        let (mut last, mut last_key) = (vec![0; self.replay.stride], 0);
        let (mut last_corners, mut last_triangle) = ([0u32; 3], 0);
        while (self.replay.keys.len() as u64) < base_vertices
            || self.replay.n_triangles < base_triangles
        {
            check()?;
            let head = self.blocks.head(&remedy)?;
            let at = self.blocks.offset();
            let wanted = match (self.replay.keys.len() as u64) < base_vertices {
                true => Kind::Vertices,
                false => Kind::Triangles,
            };
            if head.kind != wanted || head.n == 0 {
                return Err(self.blocks.bad(
                    at,
                    "another part of the coarsest mesh was expected",
                    &remedy,
                ));
            }
            let payload = self.read(&head, &remedy)?;
            let n = head.n as usize;
            let parsed = match wanted {
                Kind::Vertices => self.vertices(&payload, n, &mut last, &mut last_key),
                _ => self.triangles(&payload, n, &mut last_corners, &mut last_triangle),
            };
            parsed.map_err(|what| self.blocks.bad(at, &what, &remedy))?;
            self.blocks.number += 1;
        }
        let is_it = self.replay.keys.len() as u64 == base_vertices
            && self.replay.n_triangles == base_triangles;
        match is_it {
            true => Ok(()),
            false => {
                let what = "the coarsest mesh has other numbers of vertices or triangles than the head says";
                Err(self.blocks.bad(self.blocks.offset(), what, &remedy))
            }
        }
    }

    fn vertices(
        &mut self,
        mut payload: &[u8],
        n: usize,
        last: &mut [u8],
        last_key: &mut u32,
    ) -> Result<(), String> {
        let rows = &self.head.rows;
        let values = Planes::read(&mut payload, n, rows.stride())?;
        let keys =
            self.head.bits.is_none().then(|| Planes::read(&mut payload, n, 4)).transpose()?;
        let mut row = last.to_vec();
        for i in 0..n {
            rows.pull(&values, i, last, &mut row);
            *last_key = match &keys {
                Some(keys) => beside(keys.get(i) as u32, *last_key),
                None => self.replay.keys.len() as u32,
            };
            self.replay.add_vertex(&row, *last_key);
            last.copy_from_slice(&row);
        }
        Ok(())
    }

    fn triangles(
        &mut self,
        mut payload: &[u8],
        n: usize,
        last: &mut [u32; 3],
        last_key: &mut u32,
    ) -> Result<(), String> {
        let corners = Planes::read(&mut payload, n, 12)?;
        let keys =
            self.head.bits.is_none().then(|| Planes::read(&mut payload, n, 4)).transpose()?;
        let n_vertices = self.replay.keys.len() as u32;
        for i in 0..n {
            let mut bytes = [0; 12];
            corners.get_bytes(i, 0, &mut bytes);
            for (k, word) in bytes.as_chunks::<4>().0.iter().enumerate() {
                last[k] = beside(u32::from_le_bytes(*word), last[k]);
            }
            let [a, b, c] = *last;
            if a == b || b == c || c == a || last.iter().any(|&v| v >= n_vertices) {
                return Err(format!(
                    "a triangle has the corners {last:?} of {n_vertices} vertices"
                ));
            }
            *last_key = match &keys {
                Some(keys) => beside(keys.get(i) as u32, *last_key),
                None => self.replay.triangles.len() as u32,
            };
            self.replay.add_triangle(*last, *last_key);
        }
        Ok(())
    }

    pub(super) fn rows(&self) -> &Rows {
        &self.head.rows
    }
}
