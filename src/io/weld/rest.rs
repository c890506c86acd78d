//! Vertices that are joined with none, copied as they are.

use super::neighbours::Pairs;
use crate::ply::raw::Spool;
use crate::ply::{BLOCK_ROWS, MeshSource, VertexRecords};
use stonecut_system::error::Result;

/// Vertices that are not joined.
pub(super) struct Rest<'a> {
    records: VertexRecords<'a>,
    /// Those that are.
    joined: Pairs<'a>,
    /// The first that is not copied yet.
    pub next: u64,
}

impl<'a> Rest<'a> {
    pub fn new(source: &'a MeshSource, joined: Pairs<'a>) -> Rest<'a> {
        Rest { records: VertexRecords::new(source), joined, next: 0 }
    }

    /// The first joined vertex from `next` on.
    fn next_joined(&mut self) -> Result<Option<u64>> {
        while self.joined.next().is_some_and(|[v, ..]| v < self.next) {
            self.joined.pass()?;
        }
        Ok(self.joined.next().map(|[v, ..]| v))
    }

    /// Copies those up to a vertex; returns how many.
    pub fn copy_up_to(&mut self, end: u64, out: &mut Spool) -> Result<u64> {
        let n_bytes = self.records.source().schema().record_bytes();
        let mut n = 0;
        while self.next < end {
            let joined = self.next_joined()?;
            if joined == Some(self.next) {
                self.next += 1;
                continue;
            }
            let end_of_block = (self.next / BLOCK_ROWS + 1) * BLOCK_ROWS;
            let stop = joined.unwrap_or(end).min(end).min(end_of_block);
            let n_now = stop - self.next;
            out.write(&self.records.from(self.next)?[..n_now as usize * n_bytes])?;
            n += n_now;
            self.next = stop;
        }
        Ok(n)
    }
}
