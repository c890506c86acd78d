//! Cells of vertices by blocks, found from the input when they are needed and kept while memory allows.
//!
//! For one of many processes, whose part of the faces uses few blocks of vertices. Where faces use vertices near each
//! other in the input, each block is read about once.

use std::collections::{BTreeMap, VecDeque};
use std::sync::{Arc, Mutex, PoisonError};
use stonecut_io::ply::{BLOCK_ROWS, MeshSource, VertexBlock};
use stonecut_store::cell_id::CellId;
use stonecut_store::cells::CellMap;
use stonecut_system::error::Result;

/// The cells of a block of vertices.
pub(super) type Page = Arc<Vec<CellId>>;

/// Bytes of a page.
const PAGE_BYTES: u64 = BLOCK_ROWS * size_of::<CellId>() as u64;

/// Pages of the table of cells.
pub(super) struct Pages<'a> {
    source: &'a MeshSource,
    tree: &'a CellMap,
    most: usize,
    kept: Mutex<Kept>,
}

#[derive(Default)]
struct Kept {
    pages: BTreeMap<u64, Page>,
    /// Their blocks, those that came first in front.
    order: VecDeque<u64>,
}

impl<'a> Pages<'a> {
    /// Keeps about `memory_bytes` of pages, and one at least.
    pub(super) fn new(source: &'a MeshSource, tree: &'a CellMap, memory_bytes: u64) -> Pages<'a> {
        let most = (memory_bytes / PAGE_BYTES).max(1) as usize;
        Pages { source, tree, most, kept: Mutex::default() }
    }

    /// The most that pages take.
    pub(super) fn most_bytes(&self) -> u64 {
        self.most as u64 * PAGE_BYTES
    }

    /// The page of a block.
    pub(super) fn page(&self, block: u64) -> Result<Page> {
        let kept = |kept: &Kept| kept.pages.get(&block).cloned();
        if let Some(page) = kept(&self.kept.lock().unwrap_or_else(PoisonError::into_inner)) {
            return Ok(page);
        }
        // Another thread may find the same one meanwhile; both are right.
        let mut vertices = VertexBlock::default();
        self.source.read_vertices(block, &mut vertices)?;
        let schema = self.source.schema();
        let records = vertices.records.chunks_exact(schema.record_bytes());
        let mut finder = self.tree.finder();
        let page: Page = Arc::new(records.map(|r| finder.cell_of(schema.position(r))).collect());
        self.keep(block, Arc::clone(&page));
        Ok(page)
    }

    /// Keeps the page of a block, as long as none that came later need its room.
    pub(super) fn keep(&self, block: u64, page: Page) {
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        if kept.pages.insert(block, page).is_none() {
            kept.order.push_back(block);
        }
        if kept.order.len() > self.most
            && let Some(first) = kept.order.pop_front()
        {
            kept.pages.remove(&first);
        }
    }
}
