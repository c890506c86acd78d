//! Vertices that are joined with none, copied as they are, and the new numbers of all.

use crate::ply::raw::{RawFile, Spool};
use crate::ply::{BLOCK_ROWS, MeshSource, VertexBlock};
use stonecut_system::error::Result;

/// Vertices that are not joined.
pub(super) struct Rest<'a> {
    source: &'a MeshSource,
    /// Numbers of those that are, and how many of them are passed.
    joined: RawFile,
    n_passed: u64,
    window: Vec<u64>,
    window_at: Option<u64>,
    block: VertexBlock,
    loaded: Option<u64>,
    /// The first that is not copied yet.
    pub next: u64,
}

impl<'a> Rest<'a> {
    pub fn new(source: &'a MeshSource, joined: RawFile) -> Rest<'a> {
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
    pub fn copy_up_to(&mut self, end: u64, out: &mut Spool) -> Result<u64> {
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
pub(super) struct Numbers {
    file: RawFile,
    pages: Vec<(u64, Vec<u32>)>,
}

impl Numbers {
    /// Pages kept, and numbers of each: 4 MiB in all.
    const PAGES: u64 = 1024;
    const ROWS: u64 = 1024;

    pub fn new(file: RawFile) -> Numbers {
        Numbers { file, pages: vec![(u64::MAX, Vec::new()); Self::PAGES as usize] }
    }

    /// The numbers as they were given.
    pub fn into_file(self) -> RawFile {
        self.file
    }

    #[inline]
    pub fn get(&mut self, v: u64) -> Result<u32> {
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
